"""Where the fit starts: all structures, many starts, continuation from the smoothed residual.

The residual over the angle has many minima in the end of delivery, the volumes and the valve: an edge of the model a
few degrees off gains nothing by a small move. Smoothed by half a stroke it does, so every start walks down a ladder of
smoothings; starts that fall behind leave. The first rung frees only what places the load, the others everything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.prepare import on_grid
from camtorque.fit.problem import FitData, build_problem, with_starts
from camtorque.fit.solver import LiftModes, Solution, lifts_at, no_lift, solve, try_at
from camtorque.laws.chain import angle_grid, evaluate, with_substeps
from camtorque.records import Array
from camtorque.units import DEGREE

SEARCH_GRID = 600
CORE = (
    "dead_volume", "port_closing_lift", "port_width", "end_of_delivery", "spill_lift", "spill_width", "valve_opening",
    "valve_area", "valve_range", "leakage", "trigger_offset", "shaft_compliance", "pressure_zero", "guide_friction",
    "drive_admittance",
)  # fmt: skip
"""Non-linear parameters of the first rung: those that place the load."""
VOLUMES = (1.5, 5.0)
"""Dead volumes that are tried, in swept volumes."""
END_SHARES = (0.5, 0.68, 0.86)
"""Shares of the full lift at which the end of delivery is tried."""
RETRACTIONS = (5.0e-9, 25.0e-9)
"""Retraction volumes that are tried where no end is seen [m^3]."""
SMOOTHINGS_DEG = (14.0, 7.0, 3.5, 1.5, 0.0)
ITERATIONS = 8
SCAN_SHARES = tuple(np.linspace(0.3, 0.97, 14))
SCAN_KEPT = 2
DOUBTFUL, UNEXPLAINED = 20.0, 300.0
"""Chi-square above which further rounds are made, and a swinging hub is tried from the beginning."""
COUPLINGS = tuple((hertz, soft) for hertz in np.geomspace(50.0, 340.0, 6) for soft in (100.0e-6, 300.0e-6, 900.0e-6))
"""Frequency [Hz] of the hub on its coupling alone, and the coupling's compliance [rad/(N m)]."""
SHAFTS = ((60.0e-6, 700.0), (400.0e-6, 900.0), (400.0e-6, 300.0))
"""Compliance of the shaft [rad/(N m)] and the frequency at which the cam rings on it [Hz]."""
FAR = 30.0
"""A structure whose chi-square exceeds the best one's by this factor gets no further starts."""
KEEP_FACTOR, KEEP_MARGIN = 4.0, 150.0
"""A start is followed while its chi-square is below the best one's times and plus these."""


@dataclass(frozen=True)
class Start:
    """A recording whose rows start where a short fit ended, and that fit."""

    data: FitData
    solution: Solution

    @property
    def chi_square(self) -> float:
        """Chi-square of the short fit."""
        return self.solution.chi_square


def rising_angles(data: FitData, shares: tuple[float, ...]) -> tuple[Array, Array]:
    """Return cam angle and lift where the rising flank reaches shares of the full lift."""
    lift = data.chain.law.evaluate(data.chain.theta, 0)
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    wanted = np.array(shares) * np.max(lift)
    return np.interp(wanted, np.maximum.accumulate(lift[: top + 1]), data.chain.theta[: top + 1]), wanted


def candidates(data: FitData, structure: str) -> list[FitData]:
    """Return the recording with the starts of one structure."""
    item = replace(data, structure=structure)
    if structure == "line":
        return [replace(item, chain=replace(item.chain, uses_chamber=False))]
    swept = data.chain.pump.plunger_area * data.chain.top_lift
    if structure == "open":
        pairs = [(v, {"retraction_volume": r}) for v in VOLUMES for r in RETRACTIONS]
    else:
        angles, lifts = rising_angles(data, END_SHARES)
        name, places = ("end_of_delivery", angles) if structure == "land" else ("spill_lift", lifts)
        pairs = [(v, {name: float(place)}) for v in VOLUMES for place in places]
    return [with_starts(item, {"dead_volume": v * swept, **rest}) for v, rest in pairs]


def coarse(data: FitData, grid: int = SEARCH_GRID) -> FitData:
    """Return the recording on another grid of the model."""
    chain = data.chain
    if chain.theta.size == grid:
        return data
    return replace(data, chain=replace(
        chain, theta=angle_grid(grid), line_pressure=on_grid(chain.line_pressure, grid),
        shaft_torque=on_grid(chain.shaft_torque, grid), substeps=np.zeros(0, dtype=np.int64),
        deviation=on_grid(chain.deviation, grid) if chain.deviation.size else chain.deviation,
    ))  # fmt: skip


def refined(data: FitData, values: Mapping[str, float]) -> FitData:
    """Return the recording with the time steps of the chamber where the valve moves at some values."""
    output = evaluate(data.chain, values)
    return replace(data, chain=replace(data.chain, substeps=with_substeps(data.chain, output, values)))


def grid_for(smoothing_deg: float) -> int:
    """Return the grid that a smoothing needs."""
    return SEARCH_GRID if smoothing_deg > 5.0 else 2 * SEARCH_GRID


def continued(data: FitData, smoothing_deg: float, core: bool, iterations: int = ITERATIONS) -> Start | None:
    """Return a start after some iterations on the smoothed residual."""
    held = {}
    if core:
        full = build_problem([data])
        held = {
            slot.row.name: slot.row.start for slot in full.slots[: full.n_nonlinear] if slot.row.name not in CORE
        }  # fmt: skip
    data = refined(
        coarse(data, grid_for(smoothing_deg)), build_problem([data]).values(build_problem([data]).start, 0)[0]
    )
    problem = build_problem([data], held)
    lifts: tuple[LiftModes, ...] = (no_lift(),) if smoothing_deg > 2.0 else lifts_at(problem, problem.start)
    try:
        solution = solve(problem, None, iterations, lifts, smoothing_deg * DEGREE)
    except (FloatingPointError, np.linalg.LinAlgError):
        return None  # a start so far off that its tangents overflow
    starts = {slot.row.name: float(z) for slot, z in zip(problem.slots, solution.z, strict=True)}
    return Start(with_starts(data, starts), solution)


def descend(items: dict[str, list[FitData]], smoothings: tuple[float, ...], core_first: bool) -> dict[str, list[Start]]:
    """Return what is left of the starts of each structure after a ladder of smoothings, least chi-square first."""
    result: dict[str, list[Start]] = {}
    for rung, smoothing in enumerate(smoothings):
        result = {}
        for name, group in items.items():
            starts = [
                start for start in (continued(item, smoothing, core_first and rung == 0) for item in group) if start
            ]
            result[name] = sorted(starts, key=lambda s: s.chi_square)
        if not any(result.values()):
            return {}
        best = min(group[0].chi_square for group in result.values() if group)
        limit = KEEP_FACTOR * best + KEEP_MARGIN
        if smoothing < 5.0:
            result = {
                name: group
                for name, group in result.items()
                if group and (name == "line" or group[0].chi_square < 100.0 * limit)
            }
        last = len(smoothings) - 1 - rung
        result = {name: [s for k, s in enumerate(group) if k == 0 or s.chi_square < limit][: max(1, last)]
                  for name, group in result.items()}  # fmt: skip
        items = {name: [start.data for start in group] for name, group in result.items()}
    return result


def with_coupling(item: FitData) -> list[FitData]:
    """Return a start with a hub that swings on a yielding coupling, at several frequencies and compliances."""
    return [
        with_starts(item, {"coupling_resonance": 2.0 * np.pi * hertz, "coupling_compliance": soft})
        for hertz, soft in COUPLINGS
    ]  # fmt: skip


def with_hub_alone(best: Start, structure: str) -> list[FitData]:
    """Return the best start with a swinging hub on a stiff shaft, all but what places the load as expected.

    A shaft that has bent itself to stand in for the hub does not let go of it.
    """
    if structure != best.data.structure:
        return []
    return with_coupling(with_starts(as_expected(best), {"shaft_compliance": 60.0e-6, "drive_admittance": 1.0}))


def with_shaft(item: FitData) -> list[FitData]:
    """Return a start with other shafts: stiff and soft, ringing fast and slowly."""
    return [
        with_starts(item, {"shaft_compliance": soft, "shaft_resonance": 2.0 * np.pi * hertz})
        for soft, hertz in SHAFTS
    ]  # fmt: skip


def rescanned(start: Start, structure: str) -> list[FitData]:
    """Return a start in the same or another structure with the end of delivery at the best places of a scan."""
    item = replace(start.data, structure=structure)
    if structure == "open":
        return [with_starts(item, {"retraction_volume": volume}) for volume in RETRACTIONS]
    angles, lifts = rising_angles(item, SCAN_SHARES)
    name, places = ("end_of_delivery", angles) if structure == "land" else ("spill_lift", lifts)
    rest: dict[str, float] = {}
    if structure == "spill" and start.data.structure != "spill":
        rest = {row: item.rows[row].prior[0] for row in ("spill_width", "spill_span")}  # type: ignore[index]
    tried = [with_starts(item, {name: float(place), **rest}) for place in places]
    scored = []
    for number, trial in enumerate(tried):
        problem = build_problem([trial])
        scored.append((try_at(problem, problem.start, (no_lift(),)).chi_square, number))
    return [tried[number] for _, number in sorted(scored)[:SCAN_KEPT]]


def as_expected(start: Start) -> FitData:
    """Return a start with all but what places the load back at what is expected of it."""
    rows = start.data.rows
    names = [slot.row.name for slot in build_problem([start.data]).slots if slot.row.name not in CORE]
    return with_starts(start.data, {name: rows[name].prior[0] for name in names if rows[name].prior})  # type: ignore[index]


def search(data: FitData, structures: tuple[str, ...] = ("land", "spill", "open")) -> dict[str, list[Start]]:
    """Return the best starts of each structure, least chi-square first.

    Further rounds are for recordings that the rounds before do not explain: a swinging hub from the best start, other
    shafts and a swinging hub from the beginning.
    """
    rough = coarse(data)
    result = descend({name: candidates(rough, name) for name in structures}, SMOOTHINGS_DEG, True)
    if not result:
        return {}
    result = merged(result, rescanned, SMOOTHINGS_DEG[2:])
    if least(result).chi_square > DOUBTFUL:
        result = merged(result, lambda best, name: with_coupling(best.data) if name == best.data.structure else [],
                        SMOOTHINGS_DEG[1:])  # fmt: skip
        if least(result).chi_square > UNEXPLAINED:
            result = merged(result, with_hub_alone, SMOOTHINGS_DEG[1:])
        result = merged(result, lambda best, name: [as_expected(start) for start in result[name][:2]]
                        if name in likely(result) else [], SMOOTHINGS_DEG[1:])  # fmt: skip
        result = merged(result, rescanned, SMOOTHINGS_DEG[2:])
    if least(result).chi_square > DOUBTFUL:
        near = [name for name in likely(result) if name != "line"]
        hub = least(result).chi_square > UNEXPLAINED
        fresh = {name: from_the_beginning(rough, name, hub) for name in near}
        result = joined(result, descend(fresh, SMOOTHINGS_DEG, True))
        result = merged(result, rescanned, SMOOTHINGS_DEG[2:])
    return result


def from_the_beginning(rough: FitData, structure: str, hub: bool) -> list[FitData]:
    """Return first starts with other shafts, and where wanted with a swinging hub."""
    firsts = candidates(rough, structure)
    result = [item for one in firsts for item in with_shaft(one)]
    if hub:
        result += with_coupling(firsts[1])
    return result


def likely(result: Mapping[str, list[Start]]) -> list[str]:
    """Return the structures that are not far behind the best one."""
    limit = FAR * least(result).chi_square
    return [name for name, group in result.items() if group and group[0].chi_square < limit]


def joined(one: Mapping[str, list[Start]], other: Mapping[str, list[Start]]) -> dict[str, list[Start]]:
    """Return the starts of both by structure, best first."""
    return {name: sorted([*group, *other.get(name, [])], key=lambda start: start.chi_square)
            for name, group in one.items()}  # fmt: skip


def least(result: Mapping[str, list[Start]]) -> Start:
    """Return the start of least chi-square."""
    return min((group[0] for group in result.values() if group), key=lambda start: start.chi_square)


def merged(
    result: dict[str, list[Start]], more: Callable[[Start, str], list[FitData]], smoothings: tuple[float, ...]
) -> dict[str, list[Start]]:
    """Return the starts with those that further ones (of the best start, for a structure) lead to, best first."""
    best = least(result)
    items = {name: more(best, name) for name in result if name != "line"}
    return joined(result, descend({name: group for name, group in items.items() if group}, smoothings, False))

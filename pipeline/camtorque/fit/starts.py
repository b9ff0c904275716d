"""Where descents start, and how a start walks to the minimum next to it: from the smoothed residual, on a coarse grid.

The residual over the angle has many minima in the end of delivery, the volumes and the valve: an edge of the model a
few degrees off gains nothing by a small move. Smoothed by half a stroke it does, so every start walks down a ladder of
smoothings; starts that fall behind leave. The first rung frees only what places the load, the others everything.
Weights are as large as the residual, so that what is usual counts from the first step on.

What smoothing hides starts from scans of the driveline: hubs that swing on a yielding coupling, shafts that ring
elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np

from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.problem import FitData, Problem, build_problem, in_structure, started_at, with_starts
from camtorque.fit.solver import LiftModes, Trial, approach, lift_at, no_lift, output_at, smoother, try_at
from camtorque.laws.chain import ChainOutput, evaluate, with_substeps, with_transfer
from camtorque.laws.chamber import integrate
from camtorque.laws.driveline import HALF_NAMES
from camtorque.process.second_process import in_two
from camtorque.records import Array
from camtorque.units import DEGREE, angle_grid, on_grid

CORE = (
    "dead_volume", "port_closing_lift", "port_width", "end_of_delivery", "spill_lift", "spill_width", "valve_opening",
    "valve_area", "valve_range", "leakage", "trigger_offset", "shaft_compliance", "pressure_zero", "guide_friction",
    "drive_admittance",
)  # fmt: skip
"""Non-linear parameters of the first rung: those that place the load."""
SET = ("outlet_return", "half_damping", "valve_spring")
"""Parameters that a start sets and the ladder leaves: one acts in steps, one matters when the load is placed."""
VOLUMES = (1.5, 5.0)
"""Dead volumes that are tried, in swept volumes."""
END_SHARES = (0.5, 0.68, 0.86)
"""Shares of the full lift at which the end of delivery is tried."""
RETRACTIONS = (5.0e-9, 25.0e-9)
"""Retraction volumes that are tried where no end is seen [m^3]."""
SMOOTHINGS_DEG = (14.0, 7.0, 3.5, 1.5, 0.0)
SEARCH_LIFT_CUT = 0.3
"""Weakest mode of the lift correction in the search, where only what is large counts."""
ITERATIONS, REWEIGHTINGS = 8, 2
"""Iterations of a rung, and how often the weights are adapted to the residual within them."""
LEFT_AT_LAST = 2
"""Starts of a structure that are followed to the end of the ladder."""
KEEP_FACTOR, KEEP_MARGIN = 4.0, 150.0
"""A start is followed while its chi-square is below the best one's times and plus these."""
HUB_RUNGS = ((3.5, 4, 8), (1.5, 8, 3))
"""Smoothing [deg] of the scan of hubs, iterations, and how many are followed after it."""
SHAFTS_WITH_HUB = ((60.0e-6, 1200.0), (200.0e-6, 620.0), (400.0e-6, 450.0))
"""Compliance [rad/(N m)] and frequency of ringing [Hz] of the shafts on which hubs are tried."""
RINGINGS = tuple(
    {"shaft_resonance": 2.0 * np.pi * hertz, "shaft_damping_ratio": ratio}
    for ratio, count in ((0.02, 72), (0.06, 36), (0.2, 18)) for hertz in np.geomspace(120.0, 2600.0, count)
)  # fmt: skip
"""Shafts on which the cam rings, lightly damped: the true ones stand in a narrow dip of frequency. Ringing is invisible
while the residual is smoothed, and an overdamped shaft does not find it afterwards."""
CAM_SIDES = (1.0, 1.4, 2.0, 3.0)
"""Inertias of the cam's side that are tried, over the sheet's cam."""
STIFFER = (1.0, 0.7, 0.5)
"""Compliances that are tried with them, over that of the shaft which they replace."""
ELASTOMER = 2.0
"""Logarithm of the damping time of a coupling's elastomer over that of steel."""
SCANNED_KEPT = 3
APART = 1.1
"""Least ratio of two frequencies of ringing that are followed."""


@dataclass(frozen=True)
class Start:
    """A recording whose rows start where a short fit ended, its lift correction and chi-square there."""

    data: FitData
    lift: LiftModes
    chi_square: float


Starts = Mapping[str, list[Start]]
"""Short fits by structure, least chi-square first."""


def rising_angles(data: FitData, shares: tuple[float, ...]) -> tuple[Array, Array]:
    """Return cam angle and lift where the rising flank of the first lobe reaches shares of its full lift."""
    lift = data.chain.law.evaluate(data.chain.theta, 0)[: data.chain.theta.size // data.chain.lobes]
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    wanted = np.array(shares) * np.max(lift)
    return np.interp(wanted, np.maximum.accumulate(lift[: top + 1]), data.chain.theta[: top + 1]), wanted


def ends_at(item: FitData, shares: tuple[float, ...]) -> list[dict[str, float]]:
    """Return the end of delivery of a structure with a land or a spill port at shares of the full lift [SI]."""
    angles, lifts = rising_angles(item, shares)
    name, places = ("end_of_delivery", angles) if item.structure == "land" else ("spill_lift", lifts)
    return [{name: float(place)} for place in places]


def chi_square_at_start(item: FitData, lift: LiftModes, held: Mapping[str, float] | None = None) -> float:
    """Return the chi-square of a recording where it starts; ``held`` as in `build_problem`."""
    problem = build_problem([item], held)
    return try_at(problem, problem.start, lift).chi_square


def first_starts(data: FitData, structure: str) -> list[FitData]:
    """Return the recording with the starts of one structure."""
    item = in_structure(data, structure)
    if structure == "line":
        return [item]
    swept = data.chain.pump.plunger_area * data.chain.top_lift
    if structure == "open":
        pairs = [(v, {"retraction_volume": r}) for v in VOLUMES for r in RETRACTIONS]
    else:
        pairs = [(v, end) for v in VOLUMES for end in ends_at(item, END_SHARES)]
    return [with_starts(item, {"dead_volume": v * swept, **rest}) for v, rest in pairs]


def on_search_grid(data: FitData) -> FitData:
    """Return the recording as the search sees it: on its grid, with a coarse correction of the lift."""
    return coarse(replace(data, lift_basis=data.lift_basis.thinned()))


def coarse(data: FitData, each: int = 1) -> FitData:
    """Return the recording on another grid of the model, of so many angles a bin."""
    chain = data.chain
    grid = each * chain.bins
    if chain.theta.size == grid:
        return data
    return replace(data, chain=replace(
        chain, theta=angle_grid(grid), line_pressure=on_grid(chain.line_pressure, grid),
        shaft_torque=on_grid(chain.shaft_torque, grid), substeps=np.zeros(0, dtype=np.int64),
    ))  # fmt: skip


def refined(data: FitData, values: Mapping[str, float]) -> FitData:
    """Return the recording with the time steps of the chamber where the valve moves at some values."""
    output = evaluate(data.chain, values)
    return replace(data, chain=replace(data.chain, substeps=with_substeps(data.chain, output, values)))


def continued(data: FitData, smoothing_deg: float, core: bool, iterations: int = ITERATIONS) -> Start | None:
    """Return a start after some iterations on the smoothed residual."""
    full = build_problem([data])
    free = full.parameters[: full.n_nonlinear]
    held = {parameter.row.name: parameter.row.start for parameter in free
            if parameter.row.name in SET or (core and parameter.row.name not in CORE)}  # fmt: skip
    data = refined(coarse(data, 1 if smoothing_deg > 5.0 else 2), full.values(full.start, 0)[0])
    problem = build_problem([data], held)
    first = output_at(problem, problem.start)
    lift = no_lift(data.chain.bins) if smoothing_deg > 2.0 else lift_at(problem, problem.start, SEARCH_LIFT_CUT, first)
    width = smoothing_deg * DEGREE
    smooth = smoother(width)
    try:
        trial = try_at(problem, problem.start, lift, smooth, first)
        for _ in range(REWEIGHTINGS):
            near = approach(reweighted(problem, trial), trial, iterations // REWEIGHTINGS, lift, width)
            trial = try_at(problem, near.z, lift, smooth, near.output)
    except (FloatingPointError, np.linalg.LinAlgError):
        return None  # a start so far off that its tangents overflow
    return Start(started_at(problem, trial.z)[0], lift, trial.chi_square)


def reweighted(problem: Problem, trial: Trial) -> Problem:
    """Return a problem of one recording whose weights make the residual of a trial just what they expect.

    Far from the truth the sheets and what is usual would else count nothing against a residual of ten thousand, and
    one part of the bench bends to stand in for another.
    """
    scale = max(1.0, np.sqrt(trial.data_chi_square / INDEPENDENT))
    item = problem.data[0]
    return replace(problem, data=(replace(item, weight=item.weight / scale),))


def compile_in_two(data: FitData) -> None:
    """Let two processes compile what a fit calls, where none has before: the chamber's time step takes half of that."""
    if not integrate.is_kept:
        follow = partial(continued, smoothing_deg=SMOOTHINGS_DEG[0], core=True, iterations=REWEIGHTINGS)
        in_two(follow, [first_starts(data, structure)[0] for structure in ("line", "land")], at_once=True)


def descend(items: dict[str, list[FitData]], smoothings: tuple[float, ...], core_first: bool) -> dict[str, list[Start]]:
    """Return what is left of the starts of each structure after a ladder of smoothings, least chi-square first."""
    result: dict[str, list[Start]] = {}
    for rung, smoothing in enumerate(smoothings):
        follow = partial(continued, smoothing_deg=smoothing, core=core_first and rung == 0)
        found = iter(in_two(follow, [item for group in items.values() for item in group]))
        result = {
            name: sorted((start for start in islice(found, len(group)) if start), key=lambda s: s.chi_square)
            for name, group in items.items()
        }
        if not any(result.values()):
            return {}
        best = min(group[0].chi_square for group in result.values() if group)
        limit = KEEP_FACTOR * best + KEEP_MARGIN
        if smoothing < 5.0:
            # the line pressure alone may be ahead for a while: the nearest structure with a chamber stays
            chambers = [group[0].chi_square for name, group in result.items() if group and name != "line"]
            far = max(100.0 * limit, min(chambers, default=0.0))
            result = {name: group for name, group in result.items()
                      if group and (name == "line" or group[0].chi_square <= far)}  # fmt: skip
        last = len(smoothings) - 1 - rung
        result = {name: [s for k, s in enumerate(group) if k == 0 or s.chi_square < limit][: max(LEFT_AT_LAST, last)]
                  for name, group in result.items()}  # fmt: skip
        items = {name: [start.data for start in group] for name, group in result.items()}
    return result


def coupled(hertz: float, soft: float, ratio: float) -> dict[str, float]:
    """Return a hub that swings at a frequency [Hz] on a coupling of some compliance [rad/(N m)] and damping [-]."""
    return {"coupling_resonance": 2.0 * np.pi * hertz, "coupling_compliance": soft, "coupling_damping": ratio}


COUPLINGS = tuple(
    coupled(hertz, soft, ratio)
    for ratio, count in ((0.07, 36), (0.3, 18)) for hertz in np.geomspace(30.0, 3000.0, count)
    for soft in (8.0e-6, 40.0e-6, 200.0e-6)
)  # fmt: skip
"""Couplings on which the hub between drive and transducer swings."""
HUBS = tuple(coupled(hertz, soft, 0.07) for hertz in np.geomspace(30.0, 500.0, 11) for soft in (80.0e-6, 300.0e-6))
"""Hubs that swing on a yielding coupling."""


def expected(data: FitData, names: Iterable[str]) -> dict[str, float]:
    """Return what is expected of the named parameters, those of which something is [SI]."""
    priors = {name: data.rows[name].prior for name in names}
    return {name: prior[0] for name, prior in priors.items() if prior}


def with_hubs(best: Start) -> list[FitData]:
    """Return the best start with the hubs that help it most."""
    return best_of([with_starts(best.data, hub) for hub in HUBS])


def with_hubs_alone(best: Start) -> list[FitData]:
    """Return the best start with hubs on several shafts, all but what places the load as expected.

    A shaft that rings where shaft and hub swing together does not let go of it.
    """
    names = [name for name in build_problem([best.data]).names if name not in CORE]
    item = with_starts(best.data, expected(best.data, names))
    shafts = ({"shaft_compliance": soft, "shaft_resonance": 2.0 * np.pi * hertz} for soft, hertz in SHAFTS_WITH_HUB)
    return best_of([with_starts(item, {**shaft, **hub}) for shaft in shafts for hub in HUBS])


def best_of(items: list[FitData]) -> list[FitData]:
    """Return the best of some starts with other drivelines by two rungs of less and less smoothing.

    Much smoothing hides a hub: at 300 Hz and 600 rpm it swings once in 12 degrees.
    """
    for smoothing, iterations, kept in HUB_RUNGS:
        ends = in_two(partial(continued, smoothing_deg=smoothing, core=False, iterations=iterations), items)
        order = sorted((end for end in ends if end), key=lambda end: end.chi_square)
        items = [end.data for end in order[:kept]]
    return items


def with_heavier_cams(best: Start) -> list[FitData]:
    """Return the best start with shafts on which the torque rings alike, and a cam's side no lighter than the cam.

    With the drive held, the load reaches the transducer over 1 + p s^2 + q s^4::

        p = C (I_c + (1 - h) I_h),   q = C^2 h (1 - h) I_h I_c

    (symbols of `camtorque.laws.driveline`): two numbers, met by any I_c. It is the sheet that tells which.
    """
    return best_of([with_starts(best.data, shaft) for shaft in ringing_alike(best.data)])


def ringing_alike(item: FitData) -> list[dict[str, float]]:
    """Return shafts of the same p and q by inertia of the cam's side and compliance, damped as long as the start's."""
    soft, resonance, ratio, half, place, ln_longer = (
        item.rows[name].start for name in ("shaft_compliance", "shaft_resonance", "shaft_damping_ratio", *HALF_NAMES)
    )
    cam = 1.0 / (resonance**2 * soft)
    linear = soft * (cam + (1.0 - place) * half)
    square = soft**2 * place * (1.0 - place) * half * cam
    found = []
    for yielding in soft * np.array(STIFFER):
        for inertia in item.chain.pump.cam_inertia * np.array(CAM_SIDES):
            rest = linear - yielding * inertia
            share = square / (yielding * inertia * rest) if rest > 0.0 else 1.0
            if share < 1.0:
                ringing = 1.0 / np.sqrt(yielding * inertia)
                shaft = {
                    "shaft_compliance": yielding, "shaft_resonance": ringing, "half_place": share,
                    "half_inertia": rest / (yielding * (1.0 - share)),
                    "shaft_damping_ratio": ratio * ringing / resonance,
                }  # fmt: skip
                found += [{**shaft, "half_damping": way} for way in (ln_longer, -ln_longer, ELASTOMER)]
    return found


def scanned(best: Start, swings: Iterable[Mapping[str, float]], place: str) -> list[FitData]:
    """Return the best start with the best of some drivelines [SI], whose frequencies ``place`` are apart.

    What moves on the cam is held meanwhile: a tenth of a search went into asking the chamber of 126 shafts the same
    again.
    """
    problem = build_problem([best.data])
    output = output_at(problem, problem.start)
    kept: list[Mapping[str, float]] = []
    for swing in sorted(swings, key=lambda swing: _behind(problem, best.lift, output, swing)):
        ratios = [swing[place] / other[place] for other in kept]
        if len(kept) < SCANNED_KEPT and all(max(ratio, 1.0 / ratio) > APART for ratio in ratios):
            kept.append(swing)
    return [with_starts(best.data, swing) for swing in kept]


def _behind(problem: Problem, lift: LiftModes, output: ChainOutput, swing: Mapping[str, float]) -> float:
    """Return chi-square with another driveline behind what the start does on the cam."""
    z = problem.start
    for name, value in swing.items():
        z[problem.index(name)] = value
    z = np.clip(z, *problem.bounds)
    behind = with_transfer(problem.data[0].chain, output, problem.values(z, 0)[0])
    return try_at(problem, z, lift, known=behind).chi_square

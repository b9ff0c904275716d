"""Where the fit starts: the end of delivery and the dead volume are scanned, because the minimum is not unique.

Spill or a closed volume has to be decided first (the wrong type costs 3-13 % of the peak torque); each type is
scanned, its best points are improved by a few iterations, and the better one is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.prepare import with_rows
from camtorque.fit.problem import FitData, Problem, build_problem
from camtorque.fit.solve import Solution, solve, try_at
from camtorque.records import Array

SCAN_EFFECTS = ("chamber", "trigger", "driveline", "sensor", "friction", "damping", "spring")
"""Effects that are on while starts are compared; the lift correction would hide a bad start."""
VOLUMES = (0.5, 1.5, 4.0, 10.0)
"""Dead volumes that are tried, in swept volumes."""
END_SHARES = (0.35, 0.5, 0.62, 0.72, 0.80, 0.86, 0.92, 0.97)
"""Shares of the full lift at which the end of delivery is tried."""
IMPROVED = 2
SHORT = 12
SWEEP_SHARES = tuple(np.linspace(0.3, 0.98, 35))
SWEEP_FACTORS = (0.3, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 3.0)
CLOSING_SHARES = tuple(np.geomspace(0.02, 0.6, 15))
SWEPT = ("dead_volume", "port_closing_lift", "valve_area", "spill_width", "port_width", "valve_opening", "leakage")
MOST_SWEEPS = 12
"""A poor start sweeps: one parameter after the other is scanned with all else where the last iterations left it."""
DRIVES: tuple[dict[str, float], ...] = ({"shaft_compliance": 60.0e-6}, {"shaft_compliance": 400.0e-6})
"""Other drivelines that are tried from the best start: stiff and soft."""
POOR_SHARE = 3.0e-3
"""Residual over peak torque above which a swinging coupling is tried as well."""
COUPLINGS: tuple[dict[str, float], ...] = tuple(
    {"coupling_compliance": 150.0e-6, "coupling_resonance": 2.0 * np.pi * hertz} for hertz in (40.0, 70.0, 110.0, 200.0)
)
COUPLING_SCAN_HZ = (25.0, 70.0, 150.0)
COUPLING_GAIN = 0.5
"""Share of chi-square that a start with a coupling has to reach."""
DELIVERIES = ("closed", "spill")
Solver = Callable[..., Solution]


@dataclass(frozen=True)
class Start:
    """A recording whose rows start in the right basin, and the short fit that showed it."""

    data: FitData
    chi_square: float
    solution: Solution


def rising_angles(data: FitData, shares: tuple[float, ...]) -> tuple[Array, Array]:
    """Return cam angle and lift where the rising flank reaches shares of the full lift."""
    lift = data.chain.law.evaluate(data.chain.theta, 0)
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    wanted = np.array(shares) * np.max(lift)
    return np.interp(wanted, np.maximum.accumulate(lift[: top + 1]), data.chain.theta[: top + 1]), wanted


def candidates(data: FitData, delivery: str) -> list[FitData]:
    """Return the recording with every combination of dead volume and end of delivery as start."""
    angles, lifts = rising_angles(data, END_SHARES)
    swept = data.chain.pump.plunger_area * data.chain.top_lift
    result = []
    for volume in VOLUMES:
        for angle, lift in zip(angles, lifts, strict=True):
            end = {"end_of_delivery": {"start": angle}}
            if delivery == "spill":
                end = {"spill_lift": {"start": lift}, "spill_width": {"start": _expected(data, "spill_width")}}
            changed = {**end, "dead_volume": {"start": volume * swept}}
            if all(_inside(data, name, fields["start"]) for name, fields in changed.items()):
                result.append(with_rows(replace(data, delivery=delivery), changed))
    return result


def _inside(data: FitData, name: str, value: float) -> bool:
    return data.rows[name].lower <= value <= data.rows[name].upper


def find_start(data: FitData) -> Start:
    """Return the recording with type of delivery and starts chosen by the data."""
    found = [_best_of(data, delivery) for delivery in DELIVERIES]
    if all(_residual_share(start) > POOR_SHARE for start in found):
        found = [_swept(start) for start in found]
    best = min(found, key=lambda start: start.chi_square)
    return _with_coupling(_with_other_drives(best))


def _best_of(data: FitData, delivery: str) -> Start:
    """Return the best start of one type of delivery: all candidates compared, the best of them improved."""
    return _improved(candidates(data, delivery), IMPROVED)


def _improved(items: Sequence[FitData], count: int) -> Start:
    """Return the best of the most promising starts after a few iterations."""
    scanned: list[tuple[float, int, FitData]] = []
    for item in items:
        problem = build_problem([item], SCAN_EFFECTS)
        scanned.append((try_at(problem, problem.start()).chi_square, len(scanned), item))
    scanned.sort(key=lambda entry: entry[:2])
    starts = []
    for _, _, item in scanned[:count]:
        problem = build_problem([item], SCAN_EFFECTS)
        solution = solve(problem, max_iterations=SHORT)
        starts.append(Start(started_at(item, problem, solution, 0), solution.chi_square, solution))
    return min(starts, key=lambda start: start.chi_square)


def _swept(best: Start) -> Start:
    """Return the start after sweeps and iterations in turn, until they gain nothing.

    The end of delivery moves by less than a grid step at a time while port, volume and valve lean on it, so the
    iterations stop halfway; a scan with all else held steps over.
    """
    for _ in range(MOST_SWEEPS):
        trial = _improved([_sweep(best.data), _sweep(_as_expected(best.data))], 2)
        if trial.chi_square > 0.99 * best.chi_square:
            return min(best, trial, key=lambda start: start.chi_square)
        best = trial
    return best


def _sweep(data: FitData) -> FitData:
    """Return the recording with its end of delivery, then each parameter of `SWEPT`, at the best of its scan."""
    angles, lifts = rising_angles(data, SWEEP_SHARES)
    if data.delivery == "spill":
        # a spill that hardly opens hides where it opens: its width comes along at what is expected of it
        width = _expected(data, "spill_width")
        data = _scanned(data, [{"spill_lift": float(lift), "spill_width": width} for lift in lifts])
    else:
        data = _scanned(data, [{"end_of_delivery": float(angle)} for angle in angles])
    closings = [share * data.chain.top_lift for share in CLOSING_SHARES]
    data = _scanned(data, [{"port_closing_lift": float(lift)} for lift in closings])
    for swept in SWEPT:
        data = _scanned(data, [{swept: factor * data.rows[swept].start} for factor in SWEEP_FACTORS])
    return data


def _as_expected(data: FitData) -> FitData:
    """Return the recording with everything that has a prior back at what is expected of it."""
    expected = {name: _expected(data, name) for name, row in data.rows.items() if not row.is_linear}
    return with_rows(data, {n: {"start": v} for n, v in expected.items() if _inside(data, n, v)})


def _scanned(data: FitData, tried: Sequence[dict[str, float]]) -> FitData:
    """Return the recording at the best of some starts, its own one among them."""
    items = [data]
    for values in tried:
        if all(_inside(data, name, value) for name, value in values.items()):
            items.append(with_rows(data, {name: {"start": value} for name, value in values.items()}))
    problems = [build_problem([item], SCAN_EFFECTS) for item in items]
    chi = [try_at(problem, problem.start()).chi_square for problem in problems]
    return items[int(np.argmin(chi))]


def _expected(data: FitData, name: str) -> float:
    row = data.rows[name]
    return row.prior[0] if row.prior is not None else row.start


def _residual_share(start: Start) -> float:
    residual = start.solution.residuals[0]
    return float(np.sqrt(np.mean(residual**2)) / np.max(start.data.torque))


def _with_other_drives(best: Start) -> Start:
    """Return the better of the start and the starts with other drivelines."""
    for drive in DRIVES:
        item = with_rows(best.data, {name: {"start": value} for name, value in drive.items()})
        problem = build_problem([item], SCAN_EFFECTS)
        solution = solve(problem, max_iterations=SHORT)
        if solution.chi_square < best.chi_square:
            best = Start(started_at(item, problem, solution, 0), solution.chi_square, solution)
    return best


def _with_coupling(best: Start) -> Start:
    """Return the better of the start and, where the residual is poor, starts with a swinging coupling."""
    if _residual_share(best) < POOR_SHARE:
        return best
    limit = COUPLING_GAIN * best.chi_square
    for coupling in COUPLINGS:
        item = with_rows(best.data, {name: {"start": value} for name, value in coupling.items()})
        problem = build_problem([item], (*SCAN_EFFECTS, "coupling"))
        solution = solve(problem, max_iterations=2 * SHORT)
        if solution.chi_square < min(limit, best.chi_square):
            best = Start(started_at(item, problem, solution, 0), solution.chi_square, solution)
    return best


def with_best_coupling(items: Sequence[FitData], effects: Sequence[str]) -> list[FitData]:
    """Return the recordings with the coupling's resonance started where the whole chain likes it best.

    A resonance is a narrow valley: a start far from it slides into a coupling of no compliance.
    """
    best: tuple[float, list[FitData]] | None = None
    if "coupling" not in effects:
        return list(items)
    for hertz in COUPLING_SCAN_HZ:
        start = {"coupling_compliance": {"start": 50.0e-6}, "coupling_resonance": {"start": 2.0 * np.pi * hertz}}
        tried = [with_rows(item, start) for item in items]
        problem = build_problem(tried, effects)
        solution = solve(problem, max_iterations=SHORT)
        if best is None or solution.chi_square < best[0]:
            chosen = [started_at(item, problem, solution, index) for index, item in enumerate(tried)]
            best = (solution.chi_square, chosen)
    assert best is not None
    return best[1]


VALLEYS: tuple[dict[str, float], ...] = (
    {"drive_admittance": 1.0, "drive_frequency": 2.0 * np.pi * 15.0, "drive_damping": 0.7},
    {"drive_admittance": 0.5, "drive_frequency": 2.0 * np.pi * 4.0, "drive_damping": 0.7},
    {"valve_area": 2.0, "valve_range": 1.0},
    {"valve_area": 0.5, "valve_range": 1.0},
)
"""Neighbouring valleys of a joint minimum: a drive that swings elsewhere [SI], a valve twice or half as wide."""
FACTORS = ("valve_area", "valve_range")
VALLEY_ITERATIONS = 12


def past_valleys(problem: Problem, solution: Solution, solver: Solver) -> Solution:
    """Return the least minimum among a minimum and those in its neighbouring valleys.

    Parameters
    ----------
    solver : ``solve``, or what solves many recordings
    """
    best = solution
    for valley in VALLEYS:
        start = _in_valley(problem, best.x, valley)
        if start is None:
            continue
        trial = solver(problem, start, VALLEY_ITERATIONS)
        if trial.chi_square < best.chi_square * (1.0 - 1e-6):
            best = solver(problem, trial.x)
    return best


def _in_valley(problem: Problem, x: Array, valley: dict[str, float]) -> Array | None:
    names = [slot.name for slot in problem.nonlinear]
    if not set(valley) <= set(names):
        return None
    start = x.copy()
    for name, value in valley.items():
        row = problem.nonlinear[names.index(name)].row
        moved = start[names.index(name)] * value if name in FACTORS else value
        start[names.index(name)] = np.clip(moved, row.lower, row.upper)
    return start


def started_at(item: FitData, problem: Problem, solution: Solution, index: int) -> FitData:
    """Return a recording whose rows start at a solution."""
    changes = {}
    for slot, value in zip(problem.nonlinear, solution.x, strict=True):
        if slot.recording in (-1, index):
            row = item.rows[slot.row.name]
            changes[slot.row.name] = {"start": float(np.clip(value, row.lower, row.upper))}
    return with_rows(item, changes)

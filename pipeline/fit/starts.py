"""Where the fit starts: the end of delivery and the dead volume are scanned, because the minimum is not unique.

Spill or a closed volume has to be decided first (the wrong type costs 3-13 % of the peak torque); each type is
scanned, its best points are improved by a few iterations, and the better one is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.fit.prepare import with_rows
from pipeline.fit.problem import FitData, Problem, build_problem
from pipeline.fit.solve import Solution, solve, try_at
from pipeline.records import Array

SCAN_EFFECTS = ("chamber", "trigger", "driveline", "sensor", "friction", "damping", "spring")
"""Effects that are on while starts are compared; the lift correction would hide a bad start."""
VOLUMES = (0.5, 1.5, 4.0, 10.0)
"""Dead volumes that are tried, in swept volumes."""
END_SHARES = (0.35, 0.5, 0.62, 0.72, 0.80, 0.86, 0.92, 0.97)
"""Shares of the full lift at which the end of delivery is tried."""
IMPROVED = 2
SHORT = 12
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
            end = {"spill_lift": {"start": lift}} if delivery == "spill" else {"end_of_delivery": {"start": angle}}
            changed = {**end, "dead_volume": {"start": volume * swept}}
            if all(_inside(data, name, fields["start"]) for name, fields in changed.items()):
                result.append(with_rows(replace(data, delivery=delivery), changed))
    return result


def _inside(data: FitData, name: str, value: float) -> bool:
    return data.rows[name].lower <= value <= data.rows[name].upper


def find_start(data: FitData) -> Start:
    """Return the recording with type of delivery and starts chosen by the data."""
    best: Start | None = None
    for delivery in DELIVERIES:
        scanned: list[tuple[float, int, FitData]] = []
        for item in candidates(data, delivery):
            problem = build_problem([item], SCAN_EFFECTS)
            scanned.append((try_at(problem, problem.start()).chi_square, len(scanned), item))
        scanned.sort(key=lambda entry: entry[:2])
        for _, _, item in scanned[:IMPROVED]:
            problem = build_problem([item], SCAN_EFFECTS)
            solution = solve(problem, max_iterations=SHORT)
            if best is None or solution.chi_square < best.chi_square:
                best = Start(started_at(item, problem, solution, 0), solution.chi_square, solution)
    assert best is not None
    return _with_coupling(_with_other_drives(best))


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
    residual = best.solution.residuals[0]
    if np.sqrt(np.mean(residual**2)) < POOR_SHARE * np.max(best.data.torque):
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


def started_at(item: FitData, problem: Problem, solution: Solution, index: int) -> FitData:
    """Return a recording whose rows start at a solution."""
    changes = {}
    for slot, value in zip(problem.nonlinear, solution.x, strict=True):
        if slot.recording in (-1, index):
            row = item.rows[slot.row.name]
            changes[slot.row.name] = {"start": float(np.clip(value, row.lower, row.upper))}
    return with_rows(item, changes)

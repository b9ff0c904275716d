"""Stability map of the fit: starts far away, few cycles, collinear effects at one speed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from camtorque.fit import Prepared, prepare
from camtorque.fit.full_space import evaluate_full, full_limits, full_values
from camtorque.fit.problem import Problem, build_problem
from camtorque.fit.solve import Solution, solve, try_at
from camtorque.fit.uncertainty import confounded_with, covariance, parameter_names
from camtorque.records import Array
from camtorque.studies.fitting import EFFECTS, prepared_example
from camtorque.studies.table import Cell, StabilityMap
from camtorque.studies.verdicts import Outcome, cell

SAME = 1.01
"""Chi-square within this factor of the minimum counts as found."""
MISSES = (0.0, 0.25)
FITS = (3.0e-3, 2.0e-2)
FAR = (1.0, 10.0, 100.0)
"""Distance of the starts in steps of the parameter table."""


def _starts(problem: Problem, far: float, count: int) -> Array:
    random = np.random.default_rng(5)
    lower, upper, step = (
        np.array([getattr(slot.row, name) for slot in problem.nonlinear]) for name in ("lower", "upper", "step")
    )
    return np.clip(problem.start() + far * step * random.standard_normal((count, step.size)), lower, upper)


def _own(problem: Problem, best: Solution, far: float, count: int) -> Outcome:
    found = [solve(problem, start) for start in _starts(problem, far, count)]
    missed = [item for item in found if item.chi_square > SAME * best.chi_square]
    told = "not converged" if missed and not any(item.converged for item in missed) else ""
    return len(missed) / count, told


def _numerical(problem: Problem, best: Solution, far: float, count: int) -> Outcome:
    limits, missed = full_limits(problem), 0
    for start in _starts(problem, far, count):
        trial = try_at(problem, start)
        inside = limits.lower + 1e-3 * limits.steps, limits.upper - 1e-3 * limits.steps
        z = np.clip(np.concatenate([trial.x, trial.c]), *inside)
        found = least_squares(
            lambda at: evaluate_full(problem, at).vector, z, bounds=(limits.lower, limits.upper),
            x_scale=limits.steps, max_nfev=40,
        )  # fmt: skip
        missed += int(2.0 * found.cost > SAME * best.chi_square)
    return missed / count, ""


def _few(prepared: Prepared, problem: Problem, count: int) -> Outcome:
    """Return the rms misfit to the mean of all cycles, over the peak, of a fit to the first few."""
    cycles = prepared.cycles
    fewer = replace(
        cycles,
        torque=None if cycles.torque is None else cycles.torque[:count],
        **{name: getattr(cycles, name)[:count] for name in ("pressure", "speed", "index", "held_out")},
    )
    data = prepare(prepared.recording, fewer, prepared.rigid).data
    z = full_values(solve(build_problem([data], EFFECTS)))
    residual = evaluate_full(problem, z).residuals[0]
    return float(np.sqrt(np.mean(residual**2)) / np.max(prepared.data.torque)), ""


def _collinear(problem: Problem, best: Solution) -> Outcome:
    """Return the largest correlation of the drag with another parameter, and with what it is confounded."""
    cov, names = covariance(problem, best), parameter_names(problem)
    place = names.index("shaft_drag")
    row = np.abs(np.delete(cov.correlation[place], place))
    others = ", ".join(confounded_with(cov, place))
    return float(np.max(row)), f"shaft_drag is confounded with {others}" if others else ""


def fit_map(quick: bool, examples: Path) -> StabilityMap:
    """Return what the fit makes of starts, cycles and collinear effects; share of starts that miss the minimum."""
    prepared = prepared_example(examples / "A_0500rpm")
    problem = build_problem([prepared.data], EFFECTS)
    best, count = solve(problem), 4 if quick else 8
    name, other = "variable projection", "least squares, numerical"
    cells: list[Cell] = []
    for far in FAR[1:2] if quick else FAR:
        condition = f"starts {far:g} steps off"
        cells.append(cell(condition, name, partial(_own, problem, best, far, count), MISSES, "missed"))
        if not quick:
            cells.append(cell(condition, other, partial(_numerical, problem, best, far, 2), MISSES, "missed"))
    cells.append(cell("start from the scan", name, partial(_own, problem, best, 0.0, 1), MISSES, "missed", True))
    for few in (3, 6):
        cells.append(cell(f"{few} cycles", name, partial(_few, prepared, problem, few), FITS, "misfit / peak", True))
    cells.append(
        cell("one speed: drag and zero", name, partial(_collinear, problem, best), (0.9, 0.95), "correlation", True)
    )
    note = "recording A_0500rpm; starts are scattered normally around that of the scan, which a user cannot skip"
    return StabilityMap("fitting_starts", "Starts, cycles and collinear effects", tuple(cells), note)

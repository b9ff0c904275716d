"""Profile likelihood: how the best sum of squares rises when one parameter is moved and all others follow.

The interval ends where the rise reaches 3.84 (95 %, one degree of freedom). It follows bent valleys that a covariance
matrix cannot, and it says so where there is no end: a profile that stays low up to a bound gives a one-sided statement,
one that stays low on both sides is flat and gives none (Raue et al., Bioinformatics 25 (2009)).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from camtorque.fit.pinned import pinned, slot_named, softened
from camtorque.fit.problem import Problem
from camtorque.fit.solve import Solution, solve
from camtorque.fit.uncertainty import covariance, parameter_names, parameter_values
from camtorque.laws.rows import ParameterRow
from camtorque.records import Array, freeze_arrays

THRESHOLD = 3.841
"""95 % quantile of chi-square with one degree of freedom."""
MOST_STEPS = 14
ITERATIONS = 25
TOLERANCE = 1.0e-5
"""Relative change of chi-square that ends a step: a hundredth of the threshold for chi-square up to several hundred."""
FIRST_STEP = 0.7
"""First step in standard errors."""
WIDENING = 1.6
PROFILED = ("trigger_offset", "shaft_compliance", "dead_volume", "leakage", "guide_friction")
"""Parameters whose intervals decide what a user concludes, and whose valleys bend or end at a bound."""
KINDS = ("two-sided", "upper limit", "lower limit", "flat")


@dataclass(frozen=True)
class Profile:
    """Profile of one parameter.

    Attributes
    ----------
    name, unit : label, unit of the report
    values : (n,) increasing, in that unit
    rise : (n,) increase of the sum of squares, data variances widened by what the residual exceeds them
    best : value at the minimum
    low, high : ends of the 95 % interval; a bound of the law where the profile never rises that far
    kind : ``two-sided``, ``upper limit`` (no lower end), ``lower limit`` (no upper end) or ``flat``
    lower_minimum : True where a profile point lies below the minimum: the fit had not reached the bottom
    """

    name: str
    unit: str
    values: Array
    rise: Array
    best: float
    low: float
    high: float
    kind: str
    lower_minimum: bool

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"{self.name}: kind {self.kind!r}, expected one of {KINDS}")
        freeze_arrays(self)


def profile(problem: Problem, solution: Solution, name: str) -> Profile:
    """Return the profile of one free parameter.

    Parameters
    ----------
    problem, solution : the chosen model at its minimum
    name : label of a free parameter

    Raises
    ------
    KeyError
        When the problem has no such free parameter.
    """
    row = slot_named(problem, name).row
    cov = covariance(problem, solution)
    soft = softened(problem, cov.inflation)
    bottom = solve(soft, solution.x, ITERATIONS, TOLERANCE)
    best = float(parameter_values(soft, bottom)[parameter_names(soft).index(name)])
    deviation = float(np.sqrt(cov.matrix[cov.names.index(name), cov.names.index(name)]))
    first = FIRST_STEP * (deviation if 0.0 < deviation < row.upper - row.lower else row.step)
    below = _walk(soft, bottom, name, best, -first)
    above = _walk(soft, bottom, name, best, first)
    points = np.array([*reversed(below), (best, 0.0), *above])
    low, has_low = _crossing([(best, 0.0), *below], row.lower)
    high, has_high = _crossing([(best, 0.0), *above], row.upper)
    per = row.per_unit
    return Profile(
        name, row.unit, points[:, 0] / per, points[:, 1], best / per, low / per, high / per, _kind(has_low, has_high),
        bool(np.min(points[:, 1]) < -1e-3),
    )  # fmt: skip


def _kind(has_low: bool, has_high: bool) -> str:
    if has_low and has_high:
        return "two-sided"
    if has_high:
        return "upper limit"
    return "lower limit" if has_low else "flat"


def _walk(problem: Problem, bottom: Solution, name: str, best: float, step: float) -> list[tuple[float, float]]:
    """Return (value, rise) away from the best value, warm-started, until the threshold, a bound, or enough steps."""
    row = slot_named(problem, name).row
    found: list[tuple[float, float]] = []
    value, x = best, np.array(bottom.x)
    while len(found) < MOST_STEPS:
        moved = float(np.clip(value + step, row.lower, row.upper))
        if moved == value:
            break
        held = pinned(problem, name, moved)
        solution = solve(held, _started(held, x, name, moved), ITERATIONS, TOLERANCE)
        rise = solution.chi_square - bottom.chi_square
        found.append((moved, rise))
        if rise > THRESHOLD:
            break
        value, x, step = moved, np.array(solution.x), step * WIDENING
    return found


def _started(problem: Problem, x: Array, name: str, value: float) -> Array:
    return np.array(
        [value if slot.name == name else old for slot, old in zip(problem.nonlinear, x, strict=True)], dtype=float
    )


def _crossing(points: list[tuple[float, float]], bound: float) -> tuple[float, bool]:
    """Return where the rise passes the threshold, and whether it does; the bound where it does not.

    The root of the rise is close to a straight line, so the crossing is interpolated in it.
    """
    for (before, low), (after, high) in pairwise(points):
        if high > THRESHOLD:
            root_low, root_high = np.sqrt(max(low, 0.0)), np.sqrt(high)
            share = (np.sqrt(THRESHOLD) - root_low) / (root_high - root_low)
            return before + share * (after - before), True
    return bound, False


def profiles(problem: Problem, solution: Solution, names: tuple[str, ...] = PROFILED) -> tuple[Profile, ...]:
    """Return the profiles of those parameters that are free."""
    free = parameter_names(problem)
    return tuple(profile(problem, solution, name) for name in names if name in free)


def describe(found: Profile, row: ParameterRow) -> str:
    """Return one sentence for the report: the interval, or why there is none."""
    unit = f" {row.unit}".replace(" -", "")
    if found.kind == "two-sided":
        return f"{found.name} {found.best:.4g}{unit}, 95 % interval {found.low:.4g} to {found.high:.4g}"
    if found.kind == "upper limit":
        return f"{found.name} at most {found.high:.4g}{unit} (95 %); the data set no lower limit"
    if found.kind == "lower limit":
        return f"{found.name} at least {found.low:.4g}{unit} (95 %); the data set no upper limit"
    return f"{found.name}: flat, the data say nothing about it between {found.low:.4g} and {found.high:.4g}{unit}"

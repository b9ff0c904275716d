"""A reference for stated uncertainties: the fit repeated on data and sheets drawn anew.

The model of the minimum plays the rig: every replicate draws the noise that the weights admit and, for every prior, the
value that another certificate might have stated, and is fitted from the minimum. The scatter of the estimates is what a
stated standard uncertainty has to be, without linearisation; it is itself known to ``1/sqrt(2 n)``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from camtorque.fit.problem import Problem, Slot
from camtorque.fit.profiles import PROFILED, profiles
from camtorque.fit.solve import Solution, solve
from camtorque.fit.uncertainty import covariance, parameter_names, parameter_values
from camtorque.records import Array
from camtorque.studies.table import Point

ITERATIONS = 40
HALF_WIDTH = 1.96
"""Half width of a 95 % interval in standard uncertainties."""


def replicate_deviation(problem: Problem, solution: Solution, count: int, seed: int = 0) -> Array:
    """Return the standard deviation of every parameter over replicates, (k,) [SI].

    Parameters
    ----------
    problem, solution : the model at its minimum
    count, seed : number of replicates, seed of the draws
    """
    generator = np.random.default_rng(seed)
    spread = np.sqrt(covariance(problem, solution).inflation)
    values = np.empty((count, len(parameter_names(problem))))
    for k in range(count):
        drawn = _replicate(problem, solution, spread, generator)
        values[k] = parameter_values(drawn, solve(drawn, solution.x, ITERATIONS))
    return np.asarray(np.std(values, axis=0, ddof=1), dtype=np.float64)


def _replicate(problem: Problem, solution: Solution, spread: float, generator: np.random.Generator) -> Problem:
    data = tuple(
        replace(
            item, weight=item.weight / spread,
            torque=item.torque - residual + spread * generator.standard_normal(residual.size) / item.weight,
        )
        for item, residual in zip(problem.data, solution.residuals, strict=True)
    )  # fmt: skip

    def redrawn(slots: tuple[Slot, ...]) -> tuple[Slot, ...]:
        result = []
        for slot in slots:
            prior = slot.row.prior
            if prior is not None:
                prior = (prior[0] + prior[1] * float(generator.standard_normal()), prior[1])
            result.append(replace(slot, row=replace(slot.row, prior=prior)))
        return tuple(result)

    return replace(problem, data=data, nonlinear=redrawn(problem.nonlinear), linear=redrawn(problem.linear))


Stated = tuple[str, str, Array, float]
"""Way, setting, stated standard uncertainty of every parameter (nan where it states none) [SI], time [s]."""


def stated_by_covariance(problem: Problem, solution: Solution) -> Stated:
    """Return what the covariance at the minimum states."""
    started = time.perf_counter()
    deviation = np.sqrt(np.maximum(np.diag(covariance(problem, solution).matrix), 0.0))
    return "covariance at the minimum", "", deviation, time.perf_counter() - started


def stated_by_profiles(problem: Problem, solution: Solution) -> Stated:
    """Return what the profiles state for the parameters that have one."""
    started = time.perf_counter()
    found = profiles(problem, solution)
    seconds = time.perf_counter() - started
    names = parameter_names(problem)
    rows = {slot.name: slot.row for slot in (*problem.nonlinear, *problem.linear)}
    stated = np.full(len(names), np.nan)
    for profile in found:
        if profile.kind == "two-sided":
            width = 0.5 * (profile.high - profile.low) / HALF_WIDTH
            stated[names.index(profile.name)] = width * rows[profile.name].per_unit
    return f"profiles of {len(PROFILED)} parameters", "", stated, seconds


def uncertainty_points(
    reference: Array, stated: Iterator[Stated], is_default: Callable[[str], bool], free: Array
) -> list[Point]:
    """Return how far each way of stating lies from the reference, median over the parameters off their bounds."""
    points = []
    for family, setting, deviation, seconds in stated:
        told = np.isfinite(deviation) & (deviation > 0.0) & (reference > 0.0) & free.astype(bool)
        error = float(np.median(np.abs(deviation[told] / reference[told] - 1.0)))
        points.append(Point(family, setting, error, seconds, is_default(family)))
    return points

"""How stiff a stiff shaft of many recordings is: the joint minimum with the compliance held aside, as for one of them.

All recordings tell the same hyperbola of compliance and inertia (`valleys`), so that their number does not end it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from camtorque.fit.joint_fit import JointCovariance
from camtorque.fit.joint_solver import JointSolution, solve_many
from camtorque.fit.minima import attempted
from camtorque.fit.problem import Problem, build_problem, started_at, with_rows
from camtorque.fit.valleys import COMPLIANCE, FACTOR, HELD, MOST_FACTORS, STIFF, WALKED, Valley
from camtorque.process.threads import Each
from camtorque.records import Array

ITERATIONS = 12
"""Iterations of a joint descent from one place of the walk to the next."""


def softer_shift(problem: Problem, solution: JointSolution, covariance: JointCovariance, each: Each) -> Array:
    """Return how far all parameters move with a stiff shaft that yields by its deviation more, (k,) [SI].

    The deviation is that of the valley along the compliance; nothing moves where a shaft yields enough.
    """
    still, index = np.zeros(problem.size), problem.index(COMPLIANCE)
    if index < 0:
        return still
    row, at = problem.parameters[index].row, float(solution.z[index])
    if at > row.lower + STIFF * covariance.std[index]:
        return still
    places = at * FACTOR ** np.arange(1.0, MOST_FACTORS + 1.0)
    walked = [(at, solution.chi_square, solution)]
    for point in _held(problem, solution, places[places < row.upper], each):
        walked.append(point)
        if point[1] > solution.chi_square + WALKED * covariance.inflation:
            break
    data = np.array([end.data_chi_square for _, _, end in walked])
    prior = np.array([value for _, value, _ in walked]) - data
    softer = at + Valley(np.array([place for place, _, _ in walked]), data, prior, at).std(covariance.inflation)
    if not np.isfinite(softer):
        return still
    nearest = max((point for point in walked if point[0] <= softer), key=lambda point: point[0])[2]
    return next((end.z - solution.z for _, _, end in _held(problem, nearest, np.array([softer]), each)), still)


def _held(
    problem: Problem, solution: JointSolution, places: Array, each: Each
) -> Iterator[tuple[float, float, JointSolution]]:
    """Yield joint minima with the compliance held, each from the one before: place, chi-square with all priors, end."""
    mean, std = problem.parameters[problem.index(COMPLIANCE)].row.prior or (0.0, np.inf)
    for place in places.tolist():
        there = {COMPLIANCE: {"start": place, "prior": (place, HELD)}}
        held = build_problem([with_rows(item, there) for item in started_at(problem, solution.z)])
        end = attempted(solve_many, held, held.start, ITERATIONS, 0.0, each)
        if end is None:
            return
        solution = end
        yield place, end.chi_square + ((place - mean) / std) ** 2, end

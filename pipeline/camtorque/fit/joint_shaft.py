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
from camtorque.fit.valleys import COMPLIANCE, HELD, HeldValue, softer
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
    stiff = HeldValue(float(solution.z[index]), solution.chi_square, solution.data_chi_square, solution)
    row, std = problem.parameters[index].row, float(covariance.std[index])
    end = softer(stiff, row, std, covariance.inflation, lambda near, places: _held(problem, near, places, each))
    return still if end is None else np.asarray(end.z - solution.z)


def _held(problem: Problem, solution: JointSolution, places: Array, each: Each) -> Iterator[HeldValue[JointSolution]]:
    """Yield joint minima with the compliance held, each from the one before."""
    mean, std = problem.parameters[problem.index(COMPLIANCE)].row.prior or (0.0, np.inf)
    for place in places.tolist():
        there = {COMPLIANCE: {"start": place, "prior": (place, HELD)}}
        held = build_problem([with_rows(item, there) for item in started_at(problem, solution.z)])
        end = attempted(solve_many, held, held.start, ITERATIONS, 0.0, each)
        if end is None:
            return
        solution = end
        yield HeldValue(place, end.chi_square + ((place - mean) / std) ** 2, end.data_chi_square, end)

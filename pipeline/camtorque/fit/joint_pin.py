"""The roller's pin of a pump in many recordings: the kind that all together tell, and the other one beside it.

A recording alone hardly tells needles from a plain bush, and the kind that most are taken for is no more than where to
begin. One prior in place of the other changes the Gaussian of the joint minimum by what is known without a fit.
"""

from __future__ import annotations

import math

import numpy as np

from camtorque.fit.joint_fit import JointCovariance, joint_covariance
from camtorque.fit.joint_solver import JointSolution, solve_many
from camtorque.fit.minima import attempted
from camtorque.fit.pin import ARM, OtherKind, other_kind
from camtorque.fit.problem import Problem, build_problem, started_at, with_rows
from camtorque.process.threads import Each
from camtorque.records import Array


def with_likelier_pin(problem: Problem, solution: JointSolution, each: Each) -> tuple[Problem, JointSolution]:
    """Return a joint minimum with the kind of pin that is the more probable one there."""
    other = other_kind_at(problem, solution, joint_covariance(problem, solution))
    if other is None or other.log_odds <= 0.0:
        return problem, solution
    turned = build_problem([with_rows(item, {ARM: other.rows}) for item in started_at(problem, solution.z)])
    ended = attempted(solve_many, turned, turned.start, 25, 0.0, each)
    return (turned, ended) if ended else (problem, solution)


def other_kind_at(problem: Problem, solution: JointSolution, covariance: JointCovariance) -> OtherKind | None:
    """Return what the other kind of pin makes of a joint minimum; None of a foot that slides."""
    place = problem.index(ARM)
    if place < 0:
        return None
    mean = float((solution.z + covariance.arrow.times(solution.gradient / covariance.inflation))[place])
    return other_kind(problem.parameters[place].row, mean, float(covariance.std[place]))


def pin_shift(problem: Problem, solution: JointSolution, covariance: JointCovariance) -> Array:
    """Return how far the other kind of pin moves each parameter, by its probability, (k,) [SI]."""
    other = other_kind_at(problem, solution, covariance)
    if other is None:
        return np.zeros(problem.size)
    place = problem.index(ARM)
    probability = 0.5 * (1.0 + math.tanh(0.5 * other.log_odds))
    along = covariance.arrow.times(np.eye(problem.size)[place]) / covariance.std[place] ** 2
    return np.asarray(math.sqrt(probability) * other.moved * along)

"""A joint minimum, how sure it is, the likelier kind of pin there, and a recording of it as if it were fitted alone.

A recording alone hardly tells needles from a plain bush, and the kind that most are taken for is no more than where to
begin. One prior in place of the other changes the Gaussian of the joint minimum by what is known without a fit.

Of a stiff shaft all recordings tell the same hyperbola of compliance and inertia (`valleys`), so that their number does
not end it: it is walked as that of one recording is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from camtorque.fit.arrow import Arrow, ArrowCovariance, arrow_inverse
from camtorque.fit.derived import modelled, on_cycles
from camtorque.fit.evidence import SMALL_SHARE, Weighed, evidence_of, moves_of, prior_of, where_unexplained
from camtorque.fit.fitted import FittedParameters
from camtorque.fit.joint_input import JointInput
from camtorque.fit.joint_solver import JointSolution, solve_many
from camtorque.fit.kinds import KINDS, PIN, OtherKind, from_log_odds, other_kind
from camtorque.fit.minima import attempted
from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.problem import Problem, build_problem, started_at, with_rows
from camtorque.fit.residual import is_explained, metrics_of_fit
from camtorque.fit.result import parameter_estimates
from camtorque.fit.solver import Minimum, with_slopes
from camtorque.fit.truncated import Gaussian
from camtorque.fit.uncertainty import LEAST_FREEDOM, Covariance, deviation_within, prior_std
from camtorque.fit.valleys import COMPLIANCE, Changes, HeldValue, softer
from camtorque.process.threads import Each, in_turn
from camtorque.records import APART, EITHER_LOSS, Array, LossEvidence, Metrics, ParameterEstimate, ReadOnly

SHAFT_ITERATIONS = 12
"""Iterations of a joint descent from one place of the walk along the compliance to the next."""


@dataclass(frozen=True)
class JointCovariance(ReadOnly):
    """Covariance of all parameters of a joint fit; its fields are those of `uncertainty.Covariance`."""

    arrow: ArrowCovariance
    prior_std: Array
    inflation: float
    freedom: float

    @cached_property
    def std(self) -> Array:
        """Standard deviations, (k,) [SI]; kept, as every recording that is left out asks for them."""
        return self.arrow.std


@dataclass(frozen=True)
class JointFit(ReadOnly):
    """A joint minimum and how sure it is; ``shifts`` and ``other_pin`` as in `FittedParameters`, (m, k) each [SI]."""

    problem: Problem
    solution: JointSolution
    covariance: JointCovariance
    shifts: Mapping[str, Array]
    other_pin: float

    @cached_property
    def unbounded_mean(self) -> Array:
        """`unbounded_mean` of all parameters, (k,) [SI]."""
        return unbounded_mean(self.solution, self.covariance)

    def recording(self, index: int) -> FittedParameters:
        """Return the parameters of one recording and the shared ones as those of a fit of its own.

        What bounds of other recordings' own parameters take away is left out: of a deviation it is a hundredth, rarely
        some.
        """
        places, matrix = self.covariance.arrow.of(index)
        order = np.argsort(places)
        places, matrix = places[order], matrix[np.ix_(order, order)]
        parameters = tuple(self.problem.parameters[k] for k in places)
        small = Problem(
            (self.problem.data[index],), tuple(replace(s, recording=min(s.recording, 0)) for s in parameters),
            int(np.sum(places < self.problem.n_nonlinear)), self.problem.fixed,
        )  # fmt: skip
        cov, found = self.covariance, self.solution
        known = Covariance(matrix, cov.prior_std[places], cov.inflation, cov.freedom, np.zeros((0, 0)))
        within = Gaussian(self.unbounded_mean[places], matrix, *(bound[places] for bound in self.problem.bounds))
        minimum = Minimum(
            found.z[places], found.chi_square, found.data_chi_square, found.gradient[places], found.iterations,
            found.evaluations, found.converged,
        )  # fmt: skip
        shifts = {name: shift[:, places] for name, shift in self.shifts.items()}
        return FittedParameters(small, minimum, known, deviation_within(within, minimum.z), shifts, self.other_pin)


@dataclass(frozen=True)
class JointRecording:
    """One recording of a joint fit: its own parameters, structure, metrics as in its own report."""

    parameters: tuple[ParameterEstimate, ...]
    structure: str
    metrics: Mapping[str, Metrics]
    explained: bool


def joint_covariance(problem: Problem, solution: JointSolution) -> JointCovariance:
    """Return the covariance at a joint minimum, as `uncertainty.covariance` does for one recording."""
    before, count = prior_std(problem), len(problem.data)
    taken = _overlap(_inverse(solution, before, 1.0), solution.hessian) + solution.lift_share
    freedom = max(INDEPENDENT * count - taken, LEAST_FREEDOM * count)
    inflation = max(1.0, solution.data_chi_square / freedom)
    return JointCovariance(_inverse(solution, before, inflation), before, inflation, freedom)


def _inverse(solution: JointSolution, before: Array, inflation: float) -> ArrowCovariance:
    """Return the covariance for a variance of the residual ``inflation`` times that of its weights."""
    information = tuple(block / inflation for block in solution.hessian.blocks)
    return arrow_inverse(replace(solution.hessian, blocks=information, diagonal=1.0 / before**2))


def unbounded_mean(solution: JointSolution, covariance: JointCovariance) -> Array:
    """Return the mean (k,) [SI] of the Gaussian whose maximum within the bounds is a joint minimum (`posterior_at`)."""
    return np.asarray(solution.z + covariance.arrow.times(solution.gradient / covariance.inflation))


def residual_covariance(solution: JointSolution, covariance: JointCovariance) -> ArrowCovariance | None:
    """Return the covariance that the residual alone shows, None where the weights admit no more than that.

    The weights admit an error of the laws, the same in all recordings, even where the residual is smaller. It counts in
    what the parameters truly are. In another run the same laws are wrong again: what that leaves is told by left-out
    recordings and must not be counted twice.
    """
    left = solution.data_chi_square / covariance.freedom
    return None if left >= 1.0 else _inverse(solution, covariance.prior_std, left)


def _overlap(covariance: ArrowCovariance, information: Arrow) -> float:
    """Return the number of values that parameters take: the sum of the products of both matrices' elements."""
    total = 0.0
    for index, (place, block) in enumerate(zip(information.places, information.blocks, strict=True)):
        places, matrix = covariance.of(index)
        order = np.argsort(places)
        kept = order[np.searchsorted(places[order], place)]
        total += float(np.sum(matrix[np.ix_(kept, kept)] * block))
    return total


def joint_recording(fit: JointFit, index: int, item: JointInput) -> JointRecording:
    """Return what the joint fit makes of one recording."""
    means, problem, solution = item.means, fit.problem, fit.solution

    def torque(measured: Array, pressure: Array) -> Array:
        model = modelled(problem, solution.z, index, solution.lift[index], item.measured, (measured, pressure))
        return on_cycles(model, measured.size).torque

    fitted, held = torque(means.torque, means.pressure), torque(means.held_torque, means.held_pressure)
    found = metrics_of_fit(means, fitted, held, item.rigid_torque, item.lift, item.lift_velocity)
    explained = is_explained(means.torque - fitted, means.odd_even, float(np.max(means.torque_all)))
    own = tuple(row for row in parameter_estimates(fit.recording(index)) if row.role == "own")
    return JointRecording(own, problem.data[index].structure, found, explained)


def joint_evidence(fit: JointFit, explained: bool, each: Each = in_turn) -> tuple[LossEvidence, ...]:
    """Return which of friction and damping a pump needs, by what all its recordings tell together.

    At one speed viscous drag of the shaft is a constant like any other; several tell it from the rest. All but the
    guide's friction act on the torque by columns, so that their Gaussian is good enough without a refit.

    Parameters
    ----------
    explained : whether the fit explains all recordings
    each : works at several of them side by side; it changes no number
    """
    problem, solution, cov = fit.problem, fit.solution, fit.covariance
    shared = cov.arrow.shared
    small = SMALL_SHARE * abs(float(np.mean([np.mean(item.torque) for item in problem.data])))
    # never of all parameters: their matrix grows with the square of the recordings
    before = prior_of(problem, cov.prior_std, shared)
    known = Gaussian(fit.unbounded_mean[shared], cov.arrow.matrix, before.lower, before.upper)
    rows = tuple(problem.parameters[k].row for k in shared)
    losses = (*APART, EITHER_LOSS)

    def moved(index: int) -> Mapping[str, Array]:
        return moves_of(with_slopes(problem, solution.z, index)[0], [row.name for row in rows], losses)

    every = each(moved, range(len(problem.data)))
    moves = {loss: np.mean([one[loss] for one in every], axis=0) for loss in losses}
    order = min(item.chain.told_order for item in problem.data)
    found = evidence_of(Weighed(rows, solution.z[shared], known, before, moves, small, order), APART)
    return found if explained else where_unexplained(found)


def with_likelier_pin(problem: Problem, solution: JointSolution, each: Each) -> tuple[Problem, JointSolution]:
    """Return a joint minimum with the kind of pin that is the more probable one there."""
    other = other_kind_at(problem, solution, joint_covariance(problem, solution))
    if other is None or other.log_odds <= 0.0:
        return problem, solution
    turned = build_problem(
        [with_rows(item, {KINDS[PIN].parameter: other.rows}) for item in started_at(problem, solution.z)]
    )
    ended = attempted(solve_many, turned, turned.start, 25, 0.0, each)
    return (turned, ended) if ended else (problem, solution)


def other_kind_at(problem: Problem, solution: JointSolution, covariance: JointCovariance) -> OtherKind | None:
    """Return what the other kind of pin makes of a joint minimum; None of a foot that slides."""
    place = problem.index(KINDS[PIN].parameter)
    if place < 0:
        return None
    mean = float(unbounded_mean(solution, covariance)[place])
    return other_kind(KINDS[PIN], problem.parameters[place].row, mean, float(covariance.std[place]))


def pin_shift(problem: Problem, solution: JointSolution, covariance: JointCovariance) -> tuple[Array, float]:
    """Return how far the other kind of pin moves each parameter, by its probability, (k,) [SI], and that."""
    other = other_kind_at(problem, solution, covariance)
    if other is None:
        return np.zeros(problem.size), 0.0
    probability = from_log_odds(other.log_odds)
    place = problem.index(KINDS[PIN].parameter)
    along = covariance.arrow.times(np.eye(problem.size)[place]) / covariance.std[place] ** 2
    return np.asarray(math.sqrt(probability) * other.moved * along), probability


def softer_shift(problem: Problem, solution: JointSolution, covariance: JointCovariance, each: Each) -> Array:
    """Return how far all parameters move with a stiff shaft that yields by its deviation more, (k,) [SI].

    The deviation is that of the valley along the compliance; nothing moves where a shaft yields enough.
    """
    still, index = np.zeros(problem.size), problem.index(COMPLIANCE)
    if index < 0:
        return still

    def follow(near: JointSolution, there: Changes) -> tuple[JointSolution, float, float] | None:
        held = build_problem([with_rows(item, there) for item in started_at(problem, near.z)])
        end = attempted(solve_many, held, held.start, SHAFT_ITERATIONS, 0.0, each)
        return None if end is None else (end, end.chi_square, end.data_chi_square)

    stiff = HeldValue(float(solution.z[index]), solution.chi_square, solution.data_chi_square, solution)
    row, std = problem.parameters[index].row, float(covariance.std[index])
    end = softer(stiff, row, std, covariance.inflation, follow)
    return still if end is None else np.asarray(end.z - solution.z)

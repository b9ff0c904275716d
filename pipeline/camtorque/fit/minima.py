"""Minima on the fine grid: what a start leads to, and what it is worth on both halves of the cycles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from camtorque.fit.descent import Basin, Effort
from camtorque.fit.problem import FitData, Problem, build_problem, in_structure, started_at
from camtorque.fit.solver import LiftModes, Solution, no_lift, solve, try_at
from camtorque.fit.starts import Start, refined
from camtorque.fit.uncertainty import covariance
from camtorque.laws.causes import cam_torques, filtered_out_torque
from camtorque.laws.driveline import RIGID, cam_side_inertia
from camtorque.process.second_process import in_two
from camtorque.records import Array

T = TypeVar("T")
FILTER_ROUNDS = 2
POLISH = Effort(40)
ASKED_TIMES, ASKED_PLUS = 1.15, 5.0
"""A minimum is asked for while its chi-square may come below the best one's times and plus these: beyond, it has no
weight beside that."""
LIGHT = 0.2
"""Standard error of the logarithm of the cam's inertia: of the sheet, and of what a ringing shaft tells of it."""
RESOLVED = 0.8
"""Part of the highest order of the bins up to which they show how a shaft rings."""
FALLEN = 1e12
"""What chi-square rises by on the other half of the cycles where the tangents overflow there."""


@dataclass(frozen=True)
class Candidate:
    """One structure (or minimum) followed to its end on the fine grid.

    ``holdout_penalty``: what chi-square rises by, as the mean over both halves of the cycles, where the half that is
    held out is asked too
    """

    data: FitData
    problem: Problem
    solution: Solution
    holdout_penalty: float = 0.0

    @property
    def value(self) -> float:
        """Chi-square with priors, and what the other half of the cycles and the sheet's cam say."""
        return self.solution.chi_square + self.holdout_penalty + self.light_cam_penalty

    @property
    def data_value(self) -> float:
        """Chi-square without priors, as the mean over both halves of the cycles."""
        return self.solution.data_chi_square + self.holdout_penalty

    @property
    def basin(self) -> Basin:
        """Where descents of the same problem with the same lift correction have come back to this minimum."""
        return Basin(self.solution.z, self.solution.chi_square, self.solution.hessian)

    @property
    def light_cam_penalty(self) -> float:
        """Chi-square of a cam's side that turns more lightly than the sheet's cam alone: no bench has that."""
        values, _ = self.problem.values(self.solution.z, 0)
        if values["shaft_compliance"] <= RIGID:
            return 0.0
        missing = np.log(self.data.chain.pump.cam_inertia / cam_side_inertia(values)) / LIGHT
        return float(max(missing, 0.0) ** 2)

    @property
    def rings_between_bins(self) -> bool:
        """Whether the shaft rings faster than the bins of a revolution show: how it is damped, nothing tells then."""
        values, _ = self.problem.values(self.solution.z, 0)
        order = values["shaft_resonance"] / self.data.chain.speed
        return bool(values["shaft_compliance"] > RIGID and order > RESOLVED * 0.5 * self.data.chain.bins)

    @property
    def left_to_explain(self) -> float:
        """Chi-square that a search may take away (the *doubt* of decision 0099): not what the lift table explains."""
        return self.value - self.solution.lift.expected_part(self.solution.residual)


def attempted(fit: Callable[..., T], *arguments: object) -> T | None:
    """Return a fit, None where it runs to a point at which the tangents of the model overflow."""
    try:
        return fit(*arguments)
    except (FloatingPointError, np.linalg.LinAlgError):
        return None


@dataclass(frozen=True)
class Halves:
    """A recording with the half of its cycles that is fitted and with the other one, which judges minima."""

    fitted: FitData
    other: FitData

    def judged(self, item: Candidate) -> Candidate:
        """Return a minimum with what it is worth on the half of the cycles that it was not fitted to.

        A delivery valve near chattering can be tuned to follow one mean cycle and be far off on the next: such a
        minimum is not the better one for its lower chi-square.
        """
        lost = item.data.chain.shaft_torque - self.fitted.chain.shaft_torque
        twisting = self.other.chain.shaft_torque + lost
        chain = replace(item.data.chain, line_pressure=self.other.chain.line_pressure, shaft_torque=twisting)
        problem = build_problem([replace(item.data, torque=self.other.torque, chain=chain)])
        trial = attempted(try_at, problem, item.solution.z, item.solution.lift)
        there = FALLEN if trial is None else trial.data_chi_square
        return replace(item, holdout_penalty=0.5 * (there - item.solution.data_chi_square))

    def minimum(self, fit: Callable[..., Candidate], *arguments: object) -> Candidate | None:
        """Return the minimum that a fit ends at, judged; None where it ends at none (`attempted`)."""
        end = attempted(fit, *arguments)
        return end and self.judged(end)

    def again(self, item: Candidate) -> Candidate:
        """Return where a descent from a minimum ends that has the lift correction of the minimum's own force."""
        return self.minimum(at_minimum, item.data) or item


def beside(value: float) -> Effort:
    """Return the effort that minima beside the best one, of that chi-square, are worth."""
    return replace(POLISH, limit=ASKED_TIMES * value + ASKED_PLUS)


def followed(data: FitData, start: Start, effort: Effort = POLISH) -> Candidate:
    """Return the minimum that a start leads to on the fine grid."""
    chain = replace(data.chain, substeps=np.zeros(0, dtype=np.int64))
    item = in_structure(replace(start.data, lift_basis=data.lift_basis, chain=chain), start.data.structure)
    problem = build_problem([item])
    item = refined(item, problem.values(problem.start, 0)[0])
    return at_minimum(item, effort)


def distinct(minima: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Return minima without those that an earlier one stands for."""
    kept: list[Candidate] = []
    for item in minima:
        if not any(_same(item, other) for other in kept):
            kept.append(item)
    return tuple(kept)


def _same(one: Candidate, other: Candidate) -> bool:
    """Return whether two minima are one: no parameter lies a standard deviation of the other one's apart."""
    if one.data.structure != other.data.structure:
        return False
    apart = np.abs(one.solution.z - other.solution.z)
    return bool(np.all(apart < covariance(other.problem, other.solution).std))


def in_bins_of(halves: Halves, minima: Sequence[Candidate]) -> list[Candidate]:
    """Return where minima of the same recording in other bins lead to, least chi-square first."""
    data, none = halves.fitted, no_lift(halves.fitted.chain.bins)
    begun = [replace(data, structure=item.data.structure, rows=item.data.rows) for item in minima]
    follow = partial(halves.minimum, partial(followed, data))
    found = in_two(follow, [Start(item, none, np.inf) for item in begun])
    return sorted((end for end in found if end), key=lambda end: end.value)


def at_minimum(item: FitData, effort: Effort = POLISH, lift: LiftModes | None = None) -> Candidate:
    """Return a recording at the minimum that its own start leads to.

    ``lift`` is its lift correction where that is known from a minimum nearby, else that of the start is taken.
    """
    problem = build_problem([item])
    solution = solve(problem, None, effort, lift)
    item = started_at(problem, solution.z)[0]
    return Candidate(item, build_problem([item]), solution)


def lost_torque(found: Candidate) -> Array:
    """Return the shaft's torque that the transducer's low-pass takes away at a minimum, on the fine grid [N m].

    It twists the shaft all the same.
    """
    chain = found.data.chain
    values, coefficients = found.problem.values(found.solution.z, 0)
    torques, _ = cam_torques(chain, values, found.solution.output, coefficients, np.zeros(chain.theta.size))
    return filtered_out_torque(chain, values, torques)


def with_its_lost_torque(found: Candidate, measured: Array) -> Candidate:
    """Return a minimum with the torque that is lost at it, by fixed-point steps; stiff shafts need none.

    ``measured`` is the shaft's torque as the transducer saw it, on the fine grid [N m].
    """
    for _ in range(FILTER_ROUNDS):
        values, _ = found.problem.values(found.solution.z, 0)
        chain = replace(found.data.chain, shaft_torque=measured + lost_torque(found))
        found = at_minimum(refined(replace(found.data, chain=chain), values))
    return found

"""The way down to a minimum, for 1 to n recordings: one damping, one test of convergence.

Levenberg-Marquardt with the damping of Nielsen (Damping Parameter in Marquardt's Method, IMM-REP-1999-05).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from camtorque.records import Array, Mask, ReadOnly

RELATIVE_GAIN, LEAST_GAIN = 1.0e-4, 0.01
"""An undamped step that promises less than this share of chi-square plus this leads nowhere: a minimum."""
LEAST_DAMPING, LARGEST_DAMPING = 1.0e-8, 1.0e9
LOOKED_BACK, AHEAD = 4, 12
"""Iterations whose mean gain a descent is expected to keep, and for how many more."""
LINEARISED, SEEMED, LINEARISED_GAIN = 3, 1.0e-3, 0.1
"""Descents at most, from the end of one to the next, each linearised about where it begins; another one follows where
the end is worth something else than it seemed, by more than this share of chi-square and this."""
WITHIN = 1.0
"""Chi-square above a minimum, and squared standard deviations from it, within which a descent has come back to it."""


@dataclass(frozen=True)
class DescentTrial:
    """A problem at one point.

    z : (k,) free parameters [SI]
    chi_square : weighted sum of squares with priors and lift; ``data_chi_square`` without the priors
    """

    z: Array
    chi_square: float
    data_chi_square: float


T = TypeVar("T", bound=DescentTrial)
P = TypeVar("P")


@dataclass(frozen=True)
class Descent(Generic[T, P]):
    """What the search for a minimum needs of a problem, of one recording or of many.

    try_at : z -> trial, with ``z`` and ``chi_square``
    linearise : trial -> the normal equations there
    step : normal equations, z, damping -> damped step within bounds [SI] and how much chi-square it promises
    promise : normal equations, z -> how much the undamped step promises
    bounds : lower and upper bounds of z
    """

    try_at: Callable[[Array], T]
    linearise: Callable[[T], P]
    step: Callable[[P, Array, float], tuple[Array, float]]
    promise: Callable[[P, Array], float]
    bounds: tuple[Array, Array]


@dataclass(frozen=True)
class Basin(ReadOnly):
    """The surroundings of a known minimum: its place (k,) [SI], chi-square and normal equations (k, k) [1/SI^2]."""

    z: Array
    chi_square: float
    matrix: Array

    def holds(self, trial: DescentTrial) -> bool:
        """Return whether a trial lies within one standard deviation of the minimum, by place and by chi-square."""
        apart = trial.z - self.z
        return trial.chi_square < self.chi_square + WITHIN and float(apart @ self.matrix @ apart) < WITHIN


@dataclass(frozen=True)
class Effort:
    """How far a descent is followed.

    iterations : of normal equations, at most
    gain : share of chi-square that a step has to promise
    limit : chi-square above which nobody asks for the minimum: the descent is given up where it will not come below
    basin : of a minimum that is known: a descent that has come back into it ends
    """

    iterations: int
    gain: float = RELATIVE_GAIN
    limit: float = np.inf
    basin: Basin | None = None


@dataclass(frozen=True)
class DescentResult(Generic[T, P]):
    """Where a descent ended: the last trial, the normal equations there if they are known, and what it cost.

    ``cost``: iterations, evaluations, whether it converged.
    """

    trial: T
    point: P | None
    cost: tuple[int, int, bool]


def minimise(descent: Descent[T, P], start: T, effort: Effort) -> DescentResult[T, P]:
    """Return where a descent ends that begins at a start within the bounds."""
    lower, upper = descent.bounds
    trial = start
    evaluations, damping, iterations, converged = 1, 1.0e-2, 0, False
    known: P | None = None
    reached: list[float] = []
    while iterations < effort.iterations:
        reached.append(trial.chi_square)
        if cannot_catch_up(reached, effort.limit) or (effort.basin is not None and effort.basin.holds(trial)):
            break
        point = known = descent.linearise(trial)
        iterations += 1
        accepted, failed, gained, undamped = False, False, 0.0, np.nan
        goal = effort.gain * trial.chi_square + LEAST_GAIN
        while not converged and damping < LARGEST_DAMPING:
            step, promise = descent.step(point, trial.z, damping)
            if promise < goal:
                undamped = descent.promise(point, trial.z) if np.isnan(undamped) else undamped
                converged = undamped < goal
                if converged or failed or damping < LEAST_DAMPING:
                    break
                damping *= 0.1  # it hides the way along a narrow valley
                continue
            new = descent.try_at(np.clip(trial.z + step, lower, upper))
            evaluations += 1
            ratio = (trial.chi_square - new.chi_square) / promise
            if ratio > 1e-4 and np.isfinite(new.chi_square):
                gained = trial.chi_square - new.chi_square
                damping = max(damping * max(0.1, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3), LEAST_DAMPING)
                trial, known, accepted = new, None, gained > goal
                break
            failed = True
            damping *= 4.0 if ratio > 0.0 else 8.0
        if not accepted:
            converged = converged or (gained < 5.0 * goal and not failed)  # no way down from a kink is no minimum
            break
    return DescentResult(trial, known, (iterations, evaluations, converged))


def minimise_about(
    about: Array, descent_about: Callable[[Array], Descent[T, P]], start: T, effort: Effort
) -> tuple[T, P, tuple[int, int, bool]]:
    """Return where a descent ends whose trials are linearised about some parameters of one point.

    It goes on from each end, linearised about that, until the end is worth what it seemed to be.

    Parameters
    ----------
    about : (k,) that point at first [SI]
    descent_about : the descent that is linearised about a point
    start : trial there
    """
    iterations = evaluations = 0
    descent = descent_about(about)
    for _ in range(LINEARISED):
        ended = minimise(descent, start, effort)
        descent = descent_about(ended.trial.z)
        start = descent.try_at(ended.trial.z)
        iterations, evaluations = iterations + ended.cost[0], evaluations + ended.cost[1] + 1
        if abs(start.chi_square - ended.trial.chi_square) < SEEMED * start.chi_square + LINEARISED_GAIN:
            break
    return start, ended.point or descent.linearise(ended.trial), (iterations, evaluations, ended.cost[2])


def free_at(z: Array, vector: Array, lower: Array, upper: Array) -> Mask:
    """Return which parameters are not held by a bound that the descent pushes against."""
    return ~(((z <= lower) & (vector < 0.0)) | ((z >= upper) & (vector > 0.0)))


def promised(matrix: Array, vector: Array, free: Mask) -> float:
    """Return how much chi-square the undamped step in the free parameters promises."""
    rhs = vector[free]
    return float(rhs @ np.linalg.lstsq(matrix[np.ix_(free, free)], rhs, rcond=1e-12)[0])


def cannot_catch_up(reached: Sequence[float], limit: float) -> bool:
    """Return whether a descent that goes on gaining as it does stays above a chi-square.

    It would gain less and less: what it has gained lately, times the iterations ahead, is more than it can.
    """
    if len(reached) <= LOOKED_BACK:
        return False
    gain = (reached[-1 - LOOKED_BACK] - reached[-1]) / LOOKED_BACK
    return reached[-1] - AHEAD * gain > limit

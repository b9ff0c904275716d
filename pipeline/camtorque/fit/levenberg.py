"""Levenberg-Marquardt: one schedule of damping for every least-squares problem, and a dense form by orthogonal steps.

`descend` knows nothing of what is minimised: it asks for a linearisation, for a damped trial, and compares sums of
squares. `minimise` is the dense form for a residual vector with its derivative: columns scaled by their largest norm so
far (More 1978), steps by orthogonal factors instead of normal equations (half the digits would be lost), bounds by an
active set, and undamped steps at the end down to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from camtorque.records import Array

VectorFunction = Callable[[Array], Array]


class HasChiSquare(Protocol):
    """What is compared: the sum of squares of a trial."""

    @property
    def chi_square(self) -> float:
        """Sum of squares, infinite where the model cannot be evaluated."""
        ...


Trial = TypeVar("Trial", bound=HasChiSquare)
Linear = TypeVar("Linear")


@dataclass(frozen=True)
class Rule:
    """Schedule of the damping and end of the search.

    A step that lowers the sum of squares is kept and the damping multiplied by ``ease``; one that does not is tried
    again with ``harden`` times the damping. The search ends when a lightly damped step gains less than
    ``relative_tolerance`` of the sum of squares, or no damping helps.
    """

    first: float = 1.0e-2
    ease: float = 0.15
    harden: float = 6.0
    least: float = 1.0e-9
    most: float = 1.0e12
    relative_tolerance: float = 1.0e-9
    max_iterations: int = 80


@dataclass(frozen=True)
class Descent(Generic[Trial]):
    """Where a descent ended and what it cost."""

    trial: Trial
    iterations: int
    evaluations: int
    converged: bool


def descend(
    start: Trial, linearise: Callable[[Trial], Linear], attempt: Callable[[Trial, Linear, float], Trial], rule: Rule
) -> Descent[Trial]:
    """Return the minimum that a start leads to.

    Parameters
    ----------
    start : evaluated start
    linearise : trial -> what `attempt` needs, computed once per accepted point
    attempt : trial, linearisation, damping -> the trial at the end of the damped step
    rule : schedule
    """
    trial, damping, evaluations = start, rule.first, 1
    for iteration in range(rule.max_iterations):
        linear = linearise(trial)
        while True:
            candidate = attempt(trial, linear, damping)
            evaluations += 1
            gain = trial.chi_square - candidate.chi_square
            if gain >= 0.0:
                break
            damping *= rule.harden
            if damping > rule.most:
                return Descent(trial, iteration + 1, evaluations, True)
        settled = gain <= rule.relative_tolerance * trial.chi_square and damping < 1.0
        trial, damping = candidate, max(damping * rule.ease, rule.least)
        if settled:
            return Descent(trial, iteration + 1, evaluations, True)
    return Descent(trial, rule.max_iterations, evaluations, False)


@dataclass(frozen=True)
class Point:
    """Parameters (n,), residual (m,) and its sum of squares."""

    x: Array
    residual: Array
    chi_square: float


@dataclass(frozen=True)
class Minimum:
    """A minimum of a dense problem.

    Attributes
    ----------
    x : (n,)
    residual, jacobian : (m,) and d(residual)/dx (m, n) there
    chi_square : sum of squares
    iterations, evaluations : what it cost
    converged : False when the iterations ran out
    """

    x: Array
    residual: Array
    jacobian: Array
    chi_square: float
    iterations: int
    evaluations: int
    converged: bool


def point_at(residual: VectorFunction, x: Array) -> Point:
    """Return a residual with its sum of squares, infinite where it is not finite."""
    with np.errstate(all="ignore"):
        vector = np.asarray(residual(x), dtype=float)
        chi = float(vector @ vector)
    return Point(x, vector, chi if np.isfinite(chi) else np.inf)


def minimise(
    residual: VectorFunction,
    jacobian: VectorFunction,
    start: Array,
    lower: Array,
    upper: Array,
    rule: Rule | None = None,
) -> Minimum:
    """Return the least-squares minimum within bounds that a start leads to, polished to rounding.

    Parameters
    ----------
    residual : (n,) -> (m,)
    jacobian : (n,) -> (m, n), d(residual)/dx
    start, lower, upper : (n,), infinite bounds allowed
    rule : schedule of the damping
    """
    norms = np.zeros(start.size)

    def linearise(point: Point) -> Array:
        matrix = finite_jacobian(jacobian, point.x)
        np.maximum(norms, np.linalg.norm(matrix, axis=0), out=norms)
        return matrix

    def attempt(point: Point, matrix: Array, damping: float) -> Point:
        step = damped_step(matrix, point.residual, scaling(norms), damping, (lower - point.x, upper - point.x))
        return point_at(residual, np.clip(point.x + step, lower, upper))

    first = point_at(residual, np.clip(start, lower, upper))
    found = descend(first, linearise, attempt, rule or Rule())
    point = polished(residual, jacobian, found.trial, lower, upper)
    matrix = finite_jacobian(jacobian, point.x)
    return Minimum(
        point.x, point.residual, matrix, point.chi_square, found.iterations, found.evaluations, found.converged
    )


def finite_jacobian(jacobian: VectorFunction, x: Array) -> Array:
    """Return the derivative, zero where it is not finite (a model at the edge of its domain)."""
    with np.errstate(all="ignore"):
        return np.nan_to_num(np.asarray(jacobian(x), dtype=float), nan=0.0, posinf=0.0, neginf=0.0)


def scaling(norms: Array) -> Array:
    """Return column norms that may be divided by."""
    return np.where(norms > 0.0, norms, 1.0)


def damped_step(matrix: Array, residual: Array, scale: Array, damping: float, room: tuple[Array, Array]) -> Array:
    """Return the minimum of ``|J d + r|^2 + damping |scale d|^2`` within ``room`` (lower and upper step)."""
    low, high = room
    step = np.zeros(scale.size)
    free = np.ones(scale.size, dtype=bool)
    for _ in range(scale.size):
        shifted = residual + matrix[:, ~free] @ step[~free]
        step[free] = orthogonal_step(matrix[:, free] / scale[free], shifted, damping) / scale[free]
        outside = free & ((step < low) | (step > high))
        if not outside.any():
            break
        step = np.where(outside, np.clip(step, low, high), step)
        free &= ~outside
    return np.clip(step, low, high)


def orthogonal_step(matrix: Array, residual: Array, damping: float) -> Array:
    """Return the minimum of ``|A d + r|^2 + damping |d|^2`` by the singular values of A (m, n)."""
    left, singular, right = np.linalg.svd(matrix, full_matrices=False)
    keep = singular > 1e-15 * np.max(singular, initial=1e-300)
    factor = np.where(keep, singular / np.where(keep, singular**2 + damping, 1.0), 0.0)
    return -(right.T @ (factor * (left.T @ residual)))


def polished(
    residual: VectorFunction, jacobian: VectorFunction, point: Point, lower: Array, upper: Array, most: int = 30
) -> Point:
    """Return the point after undamped steps, as long as they shrink and the sum of squares does not rise.

    Close to the minimum the sum of squares is flat to rounding, long before the parameters are; the length of the step
    still tells.
    """
    best, length = point, np.inf
    for _ in range(most):
        matrix = finite_jacobian(jacobian, best.x)
        scale = scaling(np.linalg.norm(matrix, axis=0))
        step = damped_step(matrix, best.residual, scale, 0.0, (lower - best.x, upper - best.x))
        candidate = point_at(residual, np.clip(best.x + step, lower, upper))
        now = float(np.linalg.norm(step * scale))
        if not candidate.chi_square <= best.chi_square * (1.0 + 1e-9) or now >= 0.9 * length:
            break
        best, length = replace(candidate), now
    return best


def free_inverse(matrix: Array, free: NDArray[np.bool_]) -> Array:
    """Return the inverse of a symmetric matrix over the free rows, zero elsewhere; null directions become very wide."""
    result = np.zeros_like(matrix)
    block = matrix[np.ix_(free, free)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(block), 1e-300))
    values, vectors = np.linalg.eigh(block * np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 1e-15)) @ vectors.T
    result[np.ix_(free, free)] = inverse * np.outer(scale, scale)
    return result


def covariance_of(jacobian: Array, free: NDArray[np.bool_]) -> Array:
    """Return ``(J^T J)^-1`` over the free columns by singular values, zero elsewhere."""
    columns = jacobian[:, free]
    scale = scaling(np.linalg.norm(columns, axis=0))
    _, singular, right = np.linalg.svd(columns / scale, full_matrices=False)
    root = right.T / np.maximum(singular, 1e-15 * np.max(singular, initial=1e-300)) / scale[:, None]
    result = np.zeros((jacobian.shape[1], jacobian.shape[1]))
    result[np.ix_(free, free)] = root @ root.T
    return result

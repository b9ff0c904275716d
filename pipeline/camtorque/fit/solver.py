"""Separable least squares for 1 to n recordings: exact derivatives, bounds, priors, one test of convergence.

At each trial of the non-linear parameters the linear ones are solved within their bounds (variable projection; Golub
& Pereyra, Inverse Problems 19 (2003), Kaufman's form of the derivative). The correction of the lift table enters as
what it is, a Gaussian process times the contact force: it is integrated out, which whitens the residual by a low-rank
factor that changes with the contact force only and is renewed at each start. A smoothing of the residual (Gaussian
over the angle) leads a bad start into the basin; the last stage has none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from camtorque.fit.descent import Descent, minimise
from camtorque.fit.problem import FitData, Problem
from camtorque.laws.chain import BINS, NONLINEAR_NAMES, ChainOutput, binned, evaluate, filtered, transfer
from camtorque.records import Array, freeze_arrays

N_NONLINEAR = len(NONLINEAR_NAMES)
LARGEST_INFORMATION = 1.0e30
"""Beyond this a tangent has run away: the point is far from anything physical."""
LIFT_CUT = 0.05
"""Modes of the lift correction weaker than this (in standard deviations of the residual) are left out."""
UNFELT = 0.2
"""Coefficients whose column is shorter than this share of the weakest mode are left out beforehand."""


@dataclass(frozen=True)
class LiftModes:
    """The lift correction in the weighted residual of one recording: vectors (BINS, k), shrinkage (k,).

    ``vectors diag(strength) `` times standard normal numbers is what it adds; ``to_lift`` (n_basis, k) gives the
    coefficients [m] of the modes.
    """

    vectors: Array
    strength: Array
    to_lift: Array

    @property
    def shrink(self) -> Array:
        """Share of the residual along each mode that the correction takes, s^2/(1 + s^2)."""
        return self.strength**2 / (1.0 + self.strength**2)

    def product(self, left: Array, right: Array) -> Array:
        """Return left^T (I + B B^T)^-1 right."""
        projected = (self.vectors.T @ left).T * self.shrink
        return left.T @ right - projected @ (self.vectors.T @ right)

    def coefficients(self, residual: Array) -> Array:
        """Return the coefficients of the correction that a weighted residual asks for [m]."""
        return self.to_lift @ (self.strength / (1.0 + self.strength**2) * (self.vectors.T @ residual))


def no_lift() -> LiftModes:
    """Return a correction without modes."""
    return LiftModes(np.zeros((BINS, 0)), np.zeros(0), np.zeros((0, 0)))


def lift_modes(
    item: FitData, output: ChainOutput, values: dict[str, float], inflate: float = 1.0, cut: float = LIFT_CUT
) -> LiftModes:
    """Return the lift correction of a recording for its present contact force.

    ``inflate`` multiplies the prior standard deviation (a joint fit does not average the common error away); modes
    weaker than ``cut`` are left out.
    """
    basis = item.lift_basis
    columns = binned(output.load)[:, None] * basis.basis(binned(output.motion.theta), 1)
    shaft, measured, _ = transfer(item.chain, values, BINS)
    columns = filtered(columns, shaft * measured) * (item.weight * basis.prior_std * inflate)[:, None]
    felt = np.sum(columns**2, axis=0) > (UNFELT * cut) ** 2
    squares, right = np.linalg.eigh(columns[:, felt].T @ columns[:, felt])
    kept = squares > cut**2
    strength, right = np.sqrt(squares[kept]), right[:, kept]
    to_lift = np.zeros((felt.size, strength.size))
    to_lift[felt] = right * basis.prior_std * inflate
    return LiftModes(columns[:, felt] @ right / strength, strength, to_lift)


@dataclass(frozen=True)
class Trial:
    """The problem at one point with the best linear parameters.

    ``residuals`` are weighted (and smoothed); ``outputs`` hold the derivative where it was asked for.
    """

    z: Array
    outputs: tuple[ChainOutput, ...]
    residuals: tuple[Array, ...]
    chi_square: float
    data_chi_square: float


@dataclass(frozen=True)
class Solution:
    """A minimum.

    Attributes
    ----------
    z : (k,) free parameters [SI]
    chi_square : weighted sum of squares with priors and lift; ``data_chi_square`` without the priors
    hessian : (k, k) Gauss-Newton matrix in SI units of the parameters, priors included; ``data_hessian`` without
    gradient : (k,) half the gradient of chi-square [1/SI]
    outputs : per recording the chain with its derivative
    residuals : per recording (BINS,) measured - model without lift correction, weighted
    lifts : per recording the modes of the lift correction
    iterations, evaluations : what it cost
    converged : whether an undamped step promises nothing more
    """

    z: Array
    chi_square: float
    data_chi_square: float
    hessian: Array
    data_hessian: Array
    gradient: Array
    outputs: tuple[ChainOutput, ...]
    residuals: tuple[Array, ...]
    lifts: tuple[LiftModes, ...]
    iterations: int
    evaluations: int
    converged: bool

    def __post_init__(self) -> None:
        freeze_arrays(self)


def smoother(width: float) -> Callable[[Array], Array]:
    """Return a Gaussian smoothing over the angle, of a standard deviation in radians, 0 for none."""
    if width <= 0.0:
        return lambda values: values
    response = np.exp(-0.5 * (np.arange(BINS // 2 + 1) * width) ** 2)
    return lambda values: filtered(values, response)


def bounded_quadratic(matrix: Array, vector: Array, lower: Array, upper: Array, start: Array | None = None) -> Array:
    """Return the minimum of ``c^T M c / 2 - v^T c`` within bounds, by an active set.

    Parameters
    ----------
    matrix : (n, n) symmetric positive definite
    vector, lower, upper : (n,)
    start : (n,) a neighbouring solution: its active bounds are tried first
    """
    n = vector.size
    at = np.zeros(n, dtype=int) if start is None else (start >= upper).astype(int) - (start <= lower).astype(int)
    c = np.zeros(n)
    for _ in range(5 * n + 10):
        free = at == 0
        c = np.where(at < 0, lower, np.where(at > 0, upper, 0.0))
        if free.any():
            rhs = vector[free] - matrix[np.ix_(free, ~free)] @ c[~free]
            c[free] = np.linalg.solve(matrix[np.ix_(free, free)], rhs)
        low, high = free & (c < lower), free & (c > upper)
        if low.any() or high.any():
            at[low], at[high] = -1, 1
            continue
        gradient = matrix @ c - vector
        wrong = ((at < 0) & (gradient < 0.0)) | ((at > 0) & (gradient > 0.0))
        if not wrong.any():
            break
        at[np.argmax(np.where(wrong, np.abs(gradient), 0.0))] = 0
    return np.clip(c, lower, upper)


def try_at(
    problem: Problem, z: Array, lifts: tuple[LiftModes, ...], smooth: Callable[[Array], Array] | None = None
) -> Trial:
    """Evaluate all recordings at z and solve for the linear parameters.

    Parameters
    ----------
    z : (k,) free parameters; the linear ones are only where the active set starts
    lifts : lift correction of each recording
    smooth : smoothing of the residual
    """
    smooth = smooth or smoother(0.0)
    k, first = problem.size, problem.n_nonlinear
    steps, (means, stds), (lower, upper) = problem.steps, problem.priors, problem.bounds
    size = k - first
    scale = steps[first:]
    inverse = (scale / stds[first:]) ** 2
    matrix, vector = np.diag(inverse + 1e-9), inverse * means[first:] / scale
    outputs, targets, columns, places = [], [], [], []
    for index, item in enumerate(problem.data):
        values, held = problem.values(np.r_[z[:first], np.zeros(size)], index)
        output = evaluate(item.chain, values)
        own, chain = problem.places[index]
        linear = chain >= N_NONLINEAR
        place = own[linear] - first
        column = smooth(output.linear[:, chain[linear] - N_NONLINEAR] * item.weight[:, None])
        target = smooth((item.torque - output.torque - output.linear @ held) * item.weight)
        scaled = column * scale[place]
        both = lifts[index].product(scaled, np.column_stack([scaled, target]))
        matrix[np.ix_(place, place)] += both[:, :-1]
        vector[place] += both[:, -1]
        outputs.append(output)
        targets.append(target)
        columns.append(column)
        places.append(place)
    near = np.clip(z, lower, upper)[first:] / scale
    c = bounded_quadratic(matrix, vector, lower[first:] / scale, upper[first:] / scale, near) * scale
    full = np.r_[z[:first], c]
    residuals = tuple(t - column @ c[p] for t, column, p in zip(targets, columns, places, strict=True))
    chi = sum(float(lift.product(r, r)) for lift, r in zip(lifts, residuals, strict=True))
    return Trial(full, tuple(outputs), residuals, chi + float(np.sum(((full - means) / stds) ** 2)), chi)


def normal_equations(
    problem: Problem, trial: Trial, lifts: tuple[LiftModes, ...], smooth: Callable[[Array], Array] | None = None
) -> tuple[Array, Array, tuple[ChainOutput, ...]]:
    """Return Gauss-Newton matrix and descent vector (J^T r) without priors in units of the steps, and the outputs."""
    smooth = smooth or smoother(0.0)
    k = problem.size
    matrix, vector = np.zeros((k, k)), np.zeros(k)
    steps = problem.steps
    outputs = []
    for index, item in enumerate(problem.data):
        values, coefficients = problem.values(trial.z, index)
        output = evaluate(item.chain, values, coefficients, tangents=True)
        own, chain = problem.places[index]
        both = np.column_stack([output.derivative, output.linear])[:, chain]  # type: ignore[list-item]
        jacobian = smooth(both * (item.weight[:, None] * steps[own]))
        product = lifts[index].product(jacobian, np.column_stack([jacobian, trial.residuals[index]]))
        matrix[np.ix_(own, own)] += product[:, :-1]
        vector[own] += product[:, -1]
        outputs.append(output)
    return matrix, vector, tuple(outputs)


@dataclass(frozen=True)
class Point:
    """Normal equations at a trial in units of the steps: with and without the priors, descent vector, outputs."""

    matrix: Array
    data_matrix: Array
    vector: Array
    outputs: tuple[ChainOutput, ...]


def solve(
    problem: Problem,
    start: Array | None = None,
    max_iterations: int = 60,
    lifts: tuple[LiftModes, ...] | None = None,
    smoothing: float = 0.0,
) -> Solution:
    """Return a minimum of chi-square.

    Parameters
    ----------
    start : (k,) where to start, None for the starts of the rows
    lifts : lift correction of each recording, None to take it from the start
    smoothing : standard deviation of the residual's smoothing [rad]

    Raises
    ------
    FloatingPointError : a tangent has run away
    """
    bounds, steps, (means, stds) = problem.bounds, problem.steps, problem.priors
    z = np.clip(problem.start if start is None else start, *bounds)
    smooth = smoother(smoothing)
    modes = lifts_at(problem, z) if lifts is None else lifts
    inverse = (steps / stds) ** 2
    first = problem.n_nonlinear

    def linearise(trial: Trial) -> Point:
        data_matrix, vector, outputs = normal_equations(problem, trial, modes, smooth)
        if not np.max(np.abs(data_matrix)) < LARGEST_INFORMATION:
            raise FloatingPointError("the derivative of the chain is not finite")
        matrix = data_matrix + np.diag(inverse)
        return Point(matrix, data_matrix, vector - inverse * (trial.z - means) / steps, outputs)

    descent = Descent[Trial, Point](
        try_at=lambda point: try_at(problem, point, modes, smooth),
        linearise=linearise,
        step=lambda point, at, damping: _step(point.matrix, point.vector, at, damping, first, bounds, steps),
        promise=lambda point, at: _promise(point.matrix, point.vector, _free(at, point.vector, *bounds)),
        bounds=bounds,
    )
    trial, point, cost = minimise(descent, z, max_iterations)
    outer = np.outer(steps, steps)
    return Solution(
        trial.z, trial.chi_square, trial.data_chi_square, point.matrix / outer, point.data_matrix / outer,
        point.vector / steps, point.outputs, trial.residuals, modes, *cost,
    )  # fmt: skip


def lifts_at(problem: Problem, z: Array, inflate: float = 1.0, cut: float = LIFT_CUT) -> tuple[LiftModes, ...]:
    """Return the lift correction of every recording for the contact force at z."""
    result = []
    for index, item in enumerate(problem.data):
        values, _ = problem.values(z, index)
        result.append(lift_modes(item, evaluate(item.chain, values), values, inflate, cut))
    return tuple(result)


def _free(z: Array, vector: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    """Return which parameters are not held by a bound that the descent pushes against."""
    return ~(((z <= lower) & (vector < 0.0)) | ((z >= upper) & (vector > 0.0)))


def _promise(matrix: Array, vector: Array, free: NDArray[np.bool_]) -> float:
    """Return how much chi-square the undamped step in the free parameters promises."""
    rhs = vector[free]
    return float(rhs @ np.linalg.lstsq(matrix[np.ix_(free, free)], rhs, rcond=1e-12)[0])


def _step(
    matrix: Array,
    vector: Array,
    z: Array,
    damping: float,
    first: int,
    bounds: tuple[Array, Array],
    steps: Array,
) -> tuple[Array, float]:
    """Return a damped step within bounds [SI] and how much chi-square it promises."""
    lower, upper = bounds
    damped = matrix.copy()
    diagonal = np.arange(first)
    damped[diagonal, diagonal] += damping * np.maximum(matrix[diagonal, diagonal], 1e-3)
    damped[np.diag_indices_from(damped)] += 1e-9
    free = _free(z, vector, lower, upper)
    step = np.zeros(z.size)
    for _ in range(8):
        rhs = vector[free] - matrix[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(damped[np.ix_(free, free)], rhs)
        reached = (z + step * steps < lower) | (z + step * steps > upper)
        over = reached & free
        if not over.any():
            break
        step = np.clip(step, (lower - z) / steps, (upper - z) / steps)
        free &= ~over
    promise = float(2.0 * vector @ step - step @ matrix @ step)
    return step * steps, promise

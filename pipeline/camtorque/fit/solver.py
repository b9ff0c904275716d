"""Separable least squares for one recording or a few: exact derivatives, bounds, priors, one test of convergence.

At each trial of the non-linear parameters the linear ones are solved within their bounds (variable projection; Golub
& Pereyra, Inverse Problems 19 (2003), Kaufman's form of the derivative). The correction of the lift table enters as
what it is, a Gaussian process times the contact force: it is integrated out, which whitens the residual by a low-rank
factor that changes with the contact force only and is renewed at each start. A smoothing of the residual (Gaussian
over the angle) leads a bad start into the basin; the last stage has none. Many recordings go through `joint_solver`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from camtorque.fit.descent import Descent, Effort, free_at, minimise, promised
from camtorque.fit.problem import FitData, Problem
from camtorque.fit.quadratic import bounded_quadratic, bounded_step, scaled_columns, weighted_columns
from camtorque.laws.chain import BINS, NONLINEAR_NAMES, ChainOutput, evaluate, filtered, transfer
from camtorque.laws.chamber import NO_PATH
from camtorque.laws.torque import bin_restoring
from camtorque.records import Array, ReadOnly

N_NONLINEAR = len(NONLINEAR_NAMES)
LARGEST_INFORMATION = 1.0e30
"""Beyond this a tangent has run away: the point is far from anything physical."""
WHOLE = Effort(60)
SEARCH_GAIN = 1.0e-3
"""Share of chi-square that a step of a search has to promise."""
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

    @cached_property
    def shrink(self) -> Array:
        """Share of the residual along each mode that the correction takes, s^2/(1 + s^2)."""
        return self.strength**2 / (1.0 + self.strength**2)

    def product(self, left: Array, right: Array) -> Array:
        """Return left^T (I + B B^T)^-1 right."""
        seen = self.vectors.T @ right
        projected = (seen if left is right else self.vectors.T @ left).T * self.shrink
        return left.T @ right - projected @ seen

    def gram(self, columns: Array) -> Array:
        """Return columns^T (I + B B^T)^-1 columns."""
        # far from anything physical a square is beyond the largest number: infinity, which the search turns back from
        with np.errstate(over="ignore", invalid="ignore"):
            product = columns.T @ columns
            if self.strength.size:
                projected = self.vectors.T @ columns * np.sqrt(self.shrink)[:, None]
                product -= projected.T @ projected
        return product

    def asked(self, residual: Array) -> Array:
        """Return what a weighted residual asks of each mode, in standard deviations, (k,)."""
        return np.asarray(self.strength / (1.0 + self.strength**2) * (self.vectors.T @ residual))

    def coefficients(self, residual: Array) -> Array:
        """Return the coefficients of the correction that a weighted residual asks for [m]."""
        return self.to_lift @ self.asked(residual)

    def beside(self, residual: Array) -> Array:
        """Return what a weighted residual leaves beside the correction that it asks for, (BINS,)."""
        return residual - self.vectors @ (self.shrink * (self.vectors.T @ residual))

    def expected_part(self, residual: Array) -> float:
        """Return the part of chi-square that the correction takes up, as far as the table's stated error goes."""
        return min(float(np.sum(self.asked(residual) ** 2)), float(np.sum(self.shrink)))


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
    columns = basis.binned_torque(output.motion.theta, output.load, BINS)
    shaft, measured, *_ = transfer(item.chain, values, BINS)
    behind = shaft * measured * bin_restoring(item.chain.theta.size // BINS, BINS)
    columns = filtered(columns, behind) * (item.weight * basis.prior_std * inflate)[:, None]
    felt = np.sum(columns**2, axis=0) > (UNFELT * cut) ** 2
    columns = columns[:, felt]
    squares, right = np.linalg.eigh(columns.T @ columns)
    kept = squares > cut**2
    strength, right = np.sqrt(squares[kept]), right[:, kept]
    to_lift = np.zeros((felt.size, strength.size))
    to_lift[felt] = right * basis.prior_std * inflate
    return LiftModes(columns @ right / strength, strength, to_lift)


@dataclass(frozen=True)
class Trial:
    """The problem at one point with the best linear parameters.

    ``residuals`` are weighted (and smoothed); ``outputs`` are without the derivative, or none where they are not known.
    """

    z: Array
    outputs: tuple[ChainOutput, ...]
    residuals: tuple[Array, ...]
    chi_square: float
    data_chi_square: float


@dataclass(frozen=True)
class Solution(ReadOnly):
    """A minimum.

    Attributes
    ----------
    z : (k,) free parameters [SI]
    chi_square : weighted sum of squares with priors and lift; ``data_chi_square`` without the priors
    hessian : (k, k) Gauss-Newton matrix in SI units of the parameters, priors included; ``data_hessian`` without
    gradient : (k,) half of how much chi-square falls with each parameter [1/SI]
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


def smoother(width: float) -> Callable[[Array], Array]:
    """Return a Gaussian smoothing over the angle, of a standard deviation in radians, 0 for none."""
    if width <= 0.0:
        return lambda values: values
    response = np.exp(-0.5 * (np.arange(BINS // 2 + 1) * width) ** 2)
    return lambda values: filtered(values, response)


def outputs_at(problem: Problem, z: Array) -> tuple[ChainOutput, ...]:
    """Return the chain of every recording at z, whose linear parameters it does not depend on."""
    return tuple(evaluate(item.chain, problem.values(z, index)[0]) for index, item in enumerate(problem.data))


def try_at(
    problem: Problem,
    z: Array,
    lifts: tuple[LiftModes, ...],
    smooth: Callable[[Array], Array] | None = None,
    known: tuple[ChainOutput, ...] | None = None,
) -> Trial:
    """Evaluate all recordings at z and solve for the linear parameters.

    Parameters
    ----------
    z : (k,) free parameters; the linear ones are only where the active set starts
    lifts : lift correction of each recording
    smooth : smoothing of the residual
    known : `outputs_at` the same z, where another smoothing, weight or lift correction has asked for them
    """
    first = problem.n_nonlinear
    (means, stds), (lower, upper) = problem.priors, problem.bounds
    scale = problem.steps[first:]
    inverse = (scale / stds[first:]) ** 2
    matrix, vector = np.diag(inverse + 1e-9), inverse * means[first:] / scale
    fixed = z.copy()
    fixed[first:] = 0.0
    outputs = outputs_at(problem, fixed) if known is None else known
    targets, columns, places = [], [], []
    for index, (item, output) in enumerate(zip(problem.data, outputs, strict=True)):
        _, held = problem.values(fixed, index)
        own, chain = problem.places[index]
        linear = chain >= N_NONLINEAR
        place = own[linear] - first
        column, target = weighted_columns(
            output.linear, chain[linear] - N_NONLINEAR, item.torque - output.torque, held, item.weight
        )
        if smooth is not None:
            column, target = smooth(column), smooth(target)
        both = lifts[index].gram(np.column_stack([column * scale[place], target]))
        matrix[place[:, None], place] += both[:-1, :-1]
        vector[place] += both[:-1, -1]
        targets.append(target)
        columns.append(column)
        places.append(place)
    near = np.minimum(np.maximum(z[first:], lower[first:]), upper[first:]) / scale
    c = bounded_quadratic(matrix, vector, lower[first:] / scale, upper[first:] / scale, near) * scale
    fixed[first:] = c
    residuals = tuple(t - column @ c[p] for t, column, p in zip(targets, columns, places, strict=True))
    chi = sum(float(lift.product(r, r)) for lift, r in zip(lifts, residuals, strict=True))
    return Trial(fixed, outputs, residuals, chi + float(np.sum(((fixed - means) / stds) ** 2)), chi)


def normal_equations(
    problem: Problem, trial: Trial, lifts: tuple[LiftModes, ...], smooth: Callable[[Array], Array] | None = None
) -> tuple[Array, Array, tuple[ChainOutput, ...]]:
    """Return Gauss-Newton matrix and descent vector (J^T r) without priors in units of the steps, and the outputs."""
    k = problem.size
    matrix, vector = np.zeros((k, k)), np.zeros(k)
    outputs = []
    for index, item in enumerate(problem.data):
        values, coefficients = problem.values(trial.z, index)
        known = trial.outputs[index].path if trial.outputs else NO_PATH
        output = evaluate(item.chain, values, coefficients, True, known)
        own, chain = problem.places[index]
        both = np.empty((BINS, own.size + 1))
        scaled_columns(output.derivative, output.linear, chain, item.weight, problem.steps[own], both)
        if smooth is not None:
            both = smooth(both)
        both[:, -1] = trial.residuals[index]
        product = lifts[index].gram(both)
        matrix[own[:, None], own] += product[:-1, :-1]
        vector[own] += product[:-1, -1]
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
    effort: Effort = WHOLE,
    lifts: tuple[LiftModes, ...] | None = None,
    smoothing: float = 0.0,
) -> Solution:
    """Return a minimum of chi-square.

    Parameters
    ----------
    start : (k,) where to start, None for the starts of the rows
    effort : how far the descent is followed
    lifts : lift correction of each recording, None to take it from the start
    smoothing : standard deviation of the residual's smoothing [rad]

    Raises
    ------
    FloatingPointError : a tangent has run away
    """
    z = np.clip(problem.start if start is None else start, *problem.bounds)
    outputs = outputs_at(problem, z)
    modes = lifts_at(problem, z, known=outputs) if lifts is None else lifts
    descent, first = _descent(problem, modes, smoothing), try_at(problem, z, modes, smoother(smoothing), outputs)
    ended = minimise(descent, first, effort)
    trial, point = ended.trial, ended.point or descent.linearise(ended.trial)
    outer = np.outer(problem.steps, problem.steps)
    return Solution(
        trial.z, trial.chi_square, trial.data_chi_square, point.matrix / outer, point.data_matrix / outer,
        point.vector / problem.steps, point.outputs, trial.residuals, modes, *ended.cost,
    )  # fmt: skip


def approach(problem: Problem, start: Trial, iterations: int, lifts: tuple[LiftModes, ...], smoothing: float) -> Trial:
    """Return where some iterations towards a minimum lead: what a search needs of it.

    ``start`` is of the same recordings, which may have had other weights; the other parameters are those of `solve`.
    """
    first = try_at(problem, start.z, lifts, smoother(smoothing), start.outputs)
    return minimise(_descent(problem, lifts, smoothing), first, Effort(iterations, SEARCH_GAIN)).trial


def _descent(problem: Problem, modes: tuple[LiftModes, ...], smoothing: float) -> Descent[Trial, Point]:
    bounds, steps, (means, stds) = problem.bounds, problem.steps, problem.priors
    smooth = smoother(smoothing)
    inverse = (steps / stds) ** 2

    def linearise(trial: Trial) -> Point:
        data_matrix, vector, outputs = normal_equations(problem, trial, modes, smooth)
        if not np.max(np.abs(data_matrix)) < LARGEST_INFORMATION:
            raise FloatingPointError("the derivative of the chain is not finite")
        matrix = data_matrix + np.diag(inverse)
        return Point(matrix, data_matrix, vector - inverse * (trial.z - means) / steps, outputs)

    return Descent[Trial, Point](
        try_at=lambda point: try_at(problem, point, modes, smooth),
        linearise=linearise,
        step=lambda point, at, damping: _step(problem, point, at, damping),
        promise=lambda point, at: promised(point.matrix, point.vector, free_at(at, point.vector, *bounds)),
        bounds=bounds,
    )


def lifts_at(
    problem: Problem, z: Array, cut: float = LIFT_CUT, known: tuple[ChainOutput, ...] | None = None
) -> tuple[LiftModes, ...]:
    """Return the lift correction of every recording for the contact force at z; ``known`` as in `try_at`."""
    outputs = outputs_at(problem, z) if known is None else known
    return tuple(
        lift_modes(item, output, problem.values(z, index)[0], cut=cut)
        for index, (item, output) in enumerate(zip(problem.data, outputs, strict=True))
    )


def _step(problem: Problem, point: Point, z: Array, damping: float) -> tuple[Array, float]:
    """Return a damped step within bounds [SI] and how much chi-square it promises."""
    steps, (lower, upper) = problem.steps, problem.bounds
    more, first = np.full(z.size, 1e-9), problem.n_nonlinear
    more[:first] += damping * np.maximum(np.diag(point.matrix)[:first], 1e-3)
    step, promise = bounded_step(point.matrix, more, point.vector, z / steps, lower / steps, upper / steps)
    return step * steps, promise

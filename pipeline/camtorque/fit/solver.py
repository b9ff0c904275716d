"""Separable least squares for one recording: exact derivatives, bounds, priors, one test of convergence.

At each trial of the non-linear parameters the linear ones are solved within their bounds (variable projection; Golub
& Pereyra, Inverse Problems 19 (2003), Kaufman's form of the derivative). The correction of the lift table enters as
what it is, a Gaussian process times the contact force: it is integrated out, which whitens the residual by a low-rank
factor that changes with the contact force only and is renewed at each start. A smoothing of the residual (Gaussian
over the angle) leads a bad start into the basin; the last stage has none. Many recordings go through `joint_solver`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from camtorque.fit.descent import Descent, DescentTrial, Effort, free_at, minimise, minimise_about, promised
from camtorque.fit.problem import FitData, Indices, Problem
from camtorque.fit.quadratic import bounded_quadratic, bounded_step, scaled_columns, weighted_columns
from camtorque.laws.chain import BINS, NONLINEAR_NAMES, ChainOutput, evaluate, filtered
from camtorque.laws.chamber import NO_PATH
from camtorque.laws.lift import lift_columns
from camtorque.laws.swing_error import swing_error_columns
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
    """The lift correction in the weighted residual of one recording: vectors (bins, k), shrinkage (k,).

    ``vectors diag(strength) `` times standard normal numbers is what it adds; ``to_lift`` (n_basis + e, k) gives
    the coefficients [m] of the modes, and those of the e errors of a wheel's swing.
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
        """Return the coefficients of the correction that a weighted residual asks for [m], and errors of the swing."""
        return self.to_lift @ self.asked(residual)

    def beside(self, residual: Array) -> Array:
        """Return what a weighted residual leaves beside the correction that it asks for, (bins,)."""
        return residual - self.vectors @ (self.shrink * (self.vectors.T @ residual))

    def expected_part(self, residual: Array) -> float:
        """Return the part of chi-square that the correction takes up, as far as the table's stated error goes."""
        return min(float(np.sum(self.asked(residual) ** 2)), float(np.sum(self.shrink)))


def no_lift(bins: int = BINS) -> LiftModes:
    """Return a correction without modes."""
    return LiftModes(np.zeros((bins, 0)), np.zeros(0), np.zeros((0, 0)))


def lift_modes(
    item: FitData, output: ChainOutput, at: tuple[dict[str, float], Array], inflate: float = 1.0, cut: float = LIFT_CUT
) -> LiftModes:
    """Return the lift correction of a recording for its present contact force, at what `Problem.values` gives.

    ``inflate`` multiplies the prior standard deviation (a joint fit does not average the common error away); modes
    weaker than ``cut`` are left out. What a wheel's swing may be off by stands beside the lift.
    """
    prior = item.lift_basis.prior_std * inflate
    both = lift_columns(item.chain, item.lift_basis, output, at[0]), swing_error_columns(item.chain, output, *at)
    unit = np.repeat([prior, inflate], [part.shape[1] for part in both])
    columns = np.hstack(both) * np.outer(item.weight, unit)
    felt = np.sum(columns**2, axis=0) > (UNFELT * cut) ** 2
    columns = columns[:, felt]
    squares, right = np.linalg.eigh(columns.T @ columns)
    kept = squares > cut**2
    strength, right = np.sqrt(squares[kept]), right[:, kept]
    to_lift = np.zeros((felt.size, strength.size))
    to_lift[felt] = right * unit[felt, None]
    return LiftModes(columns @ right / strength, strength, to_lift)


@dataclass(frozen=True)
class Trial(DescentTrial):
    """The problem at one point with the best linear parameters.

    ``residual`` is weighted (and smoothed); ``output`` is without the derivative.
    """

    output: ChainOutput
    residual: Array


@dataclass(frozen=True)
class Minimum(DescentTrial, ReadOnly):
    """Where a descent ended, of one recording or of many.

    Attributes
    ----------
    gradient : (k,) half of how much chi-square falls with each parameter [1/SI]
    iterations, evaluations : what it cost
    converged : whether an undamped step promises nothing more
    """

    gradient: Array
    iterations: int
    evaluations: int
    converged: bool


@dataclass(frozen=True)
class Solution(Minimum):
    """A minimum of one recording.

    Attributes
    ----------
    hessian : (k, k) Gauss-Newton matrix in SI units of the parameters, priors included; ``data_hessian`` without
    output : the chain with its derivative
    residual : (bins,) measured - model without lift correction, weighted
    lift : the modes of the lift correction
    """

    hessian: Array
    data_hessian: Array
    output: ChainOutput
    residual: Array
    lift: LiftModes

    @property
    def left(self) -> Array:
        """What the residual leaves beside the lift correction that it asks for, (bins,), weighted."""
        return self.lift.beside(self.residual)


def smoother(width: float) -> Callable[[Array], Array]:
    """Return a Gaussian smoothing over the angle, of a standard deviation in radians, 0 for none."""
    if width <= 0.0:
        return lambda values: values
    return lambda values: filtered(values, np.exp(-0.5 * (np.arange(values.shape[0] // 2 + 1) * width) ** 2))


def output_at(problem: Problem, z: Array, index: int = 0) -> ChainOutput:
    """Return the chain of a recording at z, about whose linear parameters its torque and columns are linearised."""
    return evaluate(problem.data[index].chain, *problem.values(z, index))


def linear_part(problem: Problem, fixed: Array, index: int, output: ChainOutput) -> tuple[Indices, Array, Array]:
    """Return the places of a recording's linear parameters, their weighted columns, and what is left to explain.

    ``fixed`` are the free parameters with the linear ones at zero.
    """
    item, (own, chain) = problem.data[index], problem.places[index]
    linear = chain >= N_NONLINEAR
    held = problem.values(fixed, index)[1]
    rest = item.torque - output.torque
    return own[linear], *weighted_columns(output.linear, chain[linear] - N_NONLINEAR, rest, held, item.weight)


def try_at(
    problem: Problem,
    z: Array,
    lift: LiftModes,
    smooth: Callable[[Array], Array] | None = None,
    known: ChainOutput | None = None,
    about: Array | None = None,
) -> Trial:
    """Evaluate a recording at z and solve for the linear parameters.

    Parameters
    ----------
    z : (k,) free parameters; the linear ones are only where the active set starts
    smooth : smoothing of the residual
    known : `output_at` the same z, where another smoothing, weight or lift correction has asked for it
    about : (k,) about whose linear parameters the torque is linearised, None for those of z
    """
    first = problem.n_nonlinear
    (means, stds), (lower, upper) = problem.priors, problem.bounds
    scale = problem.steps[first:]
    inverse = (scale / stds[first:]) ** 2
    fixed = z.copy()
    fixed[first:] = 0.0
    there = z if about is None else np.r_[z[:first], about[first:]]
    output = output_at(problem, there) if known is None else known
    _, columns, target = linear_part(problem, fixed, 0, output)
    if smooth is not None:
        columns, target = smooth(columns), smooth(target)
    both = lift.gram(np.column_stack([columns * scale, target]))
    matrix = np.diag(inverse + 1e-9) + both[:-1, :-1]
    vector = inverse * means[first:] / scale + both[:-1, -1]
    near = np.minimum(np.maximum(z[first:], lower[first:]), upper[first:]) / scale
    c = bounded_quadratic(matrix, vector, lower[first:] / scale, upper[first:] / scale, near) * scale
    fixed[first:] = c
    residual = target - columns @ c
    chi = float(lift.product(residual, residual)) + float(np.sum(problem.data[0].tooth_misfit(output.motion) ** 2))
    return Trial(fixed, chi + float(np.sum(((fixed - means) / stds) ** 2)), chi, output, residual)


def with_slopes(problem: Problem, z: Array, index: int, known: Array = NO_PATH) -> tuple[ChainOutput, Array]:
    """Return a recording's chain with its derivative, and weighted columns by its parameters in units of the steps.

    The last of the columns (bins, m + 1) is zero; ``known`` is the path of an output at the same z.
    """
    item, (own, chain) = problem.data[index], problem.places[index]
    values, coefficients = problem.values(z, index)
    output = evaluate(item.chain, values, coefficients, True, known)
    columns = np.empty((item.torque.size, own.size + 1))
    scaled_columns(output.derivative, output.linear, chain, item.weight, problem.steps[own], columns)
    return output, columns


def normal_equations(
    problem: Problem, z: Array, residual: Array, lift: LiftModes, smooth: Callable[[Array], Array] | None = None,
    known: Array = NO_PATH,
) -> tuple[Array, Array, ChainOutput]:  # fmt: skip
    """Return Gauss-Newton matrix and descent vector (J^T r) without priors in units of the steps, and the output."""
    output, both = with_slopes(problem, z, 0, known)
    if smooth is not None:
        both = smooth(both)
    both[:, -1] = residual
    product = lift.gram(both)
    problem.add_teeth(0, output, product)
    return product[:-1, :-1], product[:-1, -1], output


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations at a trial in units of the steps: with and without the priors, descent vector, output."""

    matrix: Array
    data_matrix: Array
    vector: Array
    output: ChainOutput


def solve(
    problem: Problem,
    start: Array | None = None,
    effort: Effort = WHOLE,
    lift: LiftModes | None = None,
    smoothing: float = 0.0,
) -> Solution:
    """Return a minimum of chi-square of one recording.

    Parameters
    ----------
    start : (k,) where to start, None for the starts of the rows
    effort : how far the descent is followed
    lift : lift correction, None to take it from the start
    smoothing : standard deviation of the residual's smoothing [rad]

    Raises
    ------
    FloatingPointError : a tangent has run away
    """
    z = np.clip(problem.start if start is None else start, *problem.bounds)
    output = output_at(problem, z)
    modes = lift_at(problem, z, known=output) if lift is None else lift
    first = try_at(problem, z, modes, smoother(smoothing), output)
    trial, point, cost = minimise_about(z, partial(_descent, problem, modes, smoothing), first, effort)
    outer = np.outer(problem.steps, problem.steps)
    return Solution(
        trial.z, trial.chi_square, trial.data_chi_square, point.vector / problem.steps, *cost,
        point.matrix / outer, point.data_matrix / outer, point.output, trial.residual, modes,
    )  # fmt: skip


def approach(problem: Problem, start: Trial, iterations: int, lift: LiftModes, smoothing: float) -> Trial:
    """Return where some iterations towards a minimum lead: what a search needs of it.

    ``start`` is of the same recording, which may have had other weights; the other parameters are those of `solve`.
    """
    first = try_at(problem, start.z, lift, smoother(smoothing), start.output)
    return minimise(_descent(problem, lift, smoothing, start.z), first, Effort(iterations, SEARCH_GAIN)).trial


def _descent(problem: Problem, lift: LiftModes, smoothing: float, about: Array) -> Descent[Trial, NormalEquations]:
    """Return the way down whose trials are linearised about the linear parameters of one point, (k,)."""
    bounds, steps, (means, stds), smooth = problem.bounds, problem.steps, problem.priors, smoother(smoothing)
    inverse = (steps / stds) ** 2

    def linearise(trial: Trial) -> NormalEquations:
        there = (trial.z, trial.residual, lift, smooth, trial.output.path)
        data_matrix, vector, output = normal_equations(problem, *there)
        if not np.max(np.abs(data_matrix)) < LARGEST_INFORMATION:
            raise FloatingPointError("the derivative of the chain is not finite")
        matrix = data_matrix + np.diag(inverse)
        return NormalEquations(matrix, data_matrix, vector - inverse * (trial.z - means) / steps, output)

    return Descent[Trial, NormalEquations](
        try_at=lambda point: try_at(problem, point, lift, smooth, about=about),
        linearise=linearise,
        step=lambda point, at, damping: _step(problem, point, at, damping),
        promise=lambda point, at: promised(point.matrix, point.vector, free_at(at, point.vector, *bounds)),
        bounds=bounds,
    )


def lift_at(problem: Problem, z: Array, cut: float = LIFT_CUT, known: ChainOutput | None = None) -> LiftModes:
    """Return the lift correction of a recording for the contact force at z; ``known`` as in `try_at`."""
    output = output_at(problem, z) if known is None else known
    return lift_modes(problem.data[0], output, problem.values(z, 0), cut=cut)


def _step(problem: Problem, point: NormalEquations, z: Array, damping: float) -> tuple[Array, float]:
    """Return a damped step within bounds [SI] and how much chi-square it promises."""
    steps, (lower, upper), first = problem.steps, problem.bounds, problem.n_nonlinear
    more = np.full(z.size, 1e-9)
    more[:first] += damping * np.maximum(np.diag(point.matrix)[:first], 1e-3)
    step, promise = bounded_step(point.matrix, more, point.vector, z / steps, lower / steps, upper / steps)
    return step * steps, promise

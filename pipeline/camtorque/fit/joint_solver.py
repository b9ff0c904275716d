"""The solver's steps for many recordings: each is summed up at a point by a small matrix, and forgotten.

The descent is that of one recording (`descent.minimise`), only its linear algebra differs. Parameters of one recording
meet those of another only through the shared ones: the normal equations are an arrow, solved by eliminating each
recording's own ones, so that time and memory are linear in the number of recordings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from camtorque.fit.arrow import Arrow
from camtorque.fit.descent import Descent, DescentTrial, Effort, free_at, minimise_about
from camtorque.fit.problem import Indices, Problem
from camtorque.fit.solver import (
    LARGEST_INFORMATION,
    LiftModes,
    Minimum,
    lift_modes,
    linear_part,
    output_at,
    smoother,
    with_slopes,
)
from camtorque.laws.chain import evaluate
from camtorque.process.threads import Each, in_turn
from camtorque.records import Array
from camtorque.stacks import Shelf

Smooth = Callable[[Array], Array]
NOTHING: Array = np.zeros((0, 0))
HELD_PATHS = 1 << 24
"""Bytes of a trial's paths that stay in memory; a recording has some 40 kB."""


@dataclass(frozen=True)
class JointSolution(Minimum):
    """A minimum of many recordings.

    Attributes
    ----------
    hessian : Gauss-Newton matrix of the residuals, in SI; its diagonal holds the priors
    parts : the part of each recording in the gradient
    misfits : (n,) chi-square of each recording's residual
    lift : per recording the coefficients of the lift correction [m]
    lift_share : number of values that the lift correction takes
    """

    hessian: Arrow
    parts: tuple[Array, ...]
    misfits: Array
    lift: tuple[Array, ...]
    lift_share: float


@dataclass(frozen=True)
class KeptModes:
    """The lift correction of a recording, its two matrices on a shelf: with them a recording would take a megabyte."""

    vectors: Callable[[], Array]
    strength: Array
    to_lift: Callable[[], Array]


@dataclass(frozen=True)
class JointSetup:
    """A problem with what stays the same while it is solved: the lift corrections and the smoothing.

    ``about`` are free parameters (k,), about whose linear ones the torques are linearised.
    """

    problem: Problem
    about: Array
    kept: tuple[KeptModes, ...]
    smooth: Smooth
    recording: Indices
    each: Each

    def lift(self, index: int) -> LiftModes:
        """Return the lift correction of a recording."""
        kept = self.kept[index]
        return LiftModes(kept.vectors(), kept.strength, kept.to_lift())

    def whitened(self, index: int, columns: Array) -> Array:
        """Return the products of columns of weighted residuals (bins, m) with the lift correction taken out."""
        kept = self.kept[index]
        return LiftModes(kept.vectors(), kept.strength, NOTHING).gram(columns)


@dataclass(frozen=True)
class Trial(DescentTrial):
    """The problem at one point with the best linear parameters; ``paths`` spare the chamber's derivative a search."""

    paths: tuple[Callable[[], Array], ...]


def joint_setup(problem: Problem, z: Array, smoothing: float, each: Each = in_turn) -> JointSetup:
    """Return a problem with the lift corrections of a point; their error is one for all recordings.

    ``smoothing`` is that of the residual, a standard deviation [rad].
    """
    inflate, shelf = float(np.sqrt(len(problem.data))), Shelf()

    def modes(index: int) -> KeptModes:
        item, at = problem.data[index], problem.values(z, index)
        found = lift_modes(item, evaluate(item.chain, at[0]), at, inflate)
        return KeptModes(shelf.put(found.vectors), found.strength, shelf.put(found.to_lift))

    lifts = tuple(each(modes, range(len(problem.data))))
    recording = np.array([parameter.recording for parameter in problem.parameters], dtype=np.int64)
    return JointSetup(problem, z, lifts, smoother(smoothing), recording, each)


def _tried(setup: JointSetup, fixed: Array, index: int) -> tuple[Indices, Array, Array]:
    """Return places of a recording's linear parameters, products of their columns and the rest of the torque, and path.

    ``fixed`` are the free parameters with the linear ones at zero.
    """
    problem = setup.problem
    first = problem.n_nonlinear
    output = output_at(problem, np.r_[fixed[:first], setup.about[first:]], index)
    own, columns, target = linear_part(problem, fixed, index, output)
    both = setup.smooth(np.column_stack([columns * problem.steps[own], target]))
    product = setup.whitened(index, both)
    product[-1, -1] += np.sum(problem.data[index].tooth_misfit(output.motion) ** 2)
    return own - problem.n_nonlinear, product, output.path


def try_at(setup: JointSetup, z: Array) -> Trial:
    """Return chi-square at z with the best linear parameters within their bounds."""
    first, bounds, (means, stds) = setup.problem.n_nonlinear, setup.problem.bounds, setup.problem.priors
    scale = setup.problem.steps[first:]
    inverse = (scale / stds[first:]) ** 2
    pulled = inverse * means[first:] / scale
    fixed = np.r_[z[:first], np.zeros(scale.size)]
    found = setup.each(lambda index: _tried(setup, fixed, index), range(len(setup.problem.data)))
    plain = np.zeros(scale.size)
    for place, product, _ in found:
        plain[place] += product[:-1, -1]
    matrix = Arrow(
        tuple(place for place, _, _ in found), tuple(product[:-1, :-1] for _, product, _ in found), inverse + 1e-9,
        setup.recording[first:],
    )  # fmt: skip
    lower, upper = (bound[first:] / scale for bound in bounds)
    c = bounded_quadratic(matrix, plain + pulled, lower, upper, np.clip(z, *bounds)[first:] / scale)
    full = np.r_[z[:first], c * scale]
    square = sum(float(product[-1, -1]) for _, product, _ in found)
    chi = square - 2.0 * float(plain @ c) + float(c @ replace(matrix, diagonal=np.zeros(c.size)).times(c))
    prior, shelf = float(np.sum(((full - means) / stds) ** 2)), Shelf(HELD_PATHS)
    return Trial(full, chi + prior, chi, tuple(shelf.put(path) for _, _, path in found))


def bounded_quadratic(matrix: Arrow, vector: Array, lower: Array, upper: Array, start: Array) -> Array:
    """Return the minimum of ``c^T M c / 2 - v^T c`` within bounds, by an active set that begins with the start's."""
    at = (start >= upper).astype(int) - (start <= lower).astype(int)
    c = np.zeros(vector.size)
    for _ in range(5 * vector.size + 10):
        free = at == 0
        held = np.where(at < 0, lower, np.where(at > 0, upper, 0.0))
        c = held + matrix.solve(free, vector - matrix.times(held))
        low, high = free & (c < lower), free & (c > upper)
        if low.any() or high.any():
            at[low], at[high] = -1, 1
            continue
        gradient = matrix.times(c) - vector
        wrong = ((at < 0) & (gradient < 0.0)) | ((at > 0) & (gradient > 0.0))
        if not wrong.any():
            break
        at[np.argmax(np.where(wrong, np.abs(gradient), 0.0))] = 0
    return np.clip(c, lower, upper)


def _linearised(setup: JointSetup, trial: Trial, index: int) -> tuple[Array, Array, Array]:
    """Return matrix and descent vector of one recording in units of the steps, and its weighted residual (bins,)."""
    problem, item = setup.problem, setup.problem.data[index]
    path = np.require(trial.paths[index](), requirements="W")
    output, both = with_slopes(problem, trial.z, index, path)
    both[:, -1] = item.residual(output, problem.values(trial.z, index)[1])
    both = setup.smooth(both)
    product = setup.whitened(index, both)
    problem.add_teeth(index, output, product)
    return product[:-1, :-1], product[:-1, -1], both[:, -1].copy()


@dataclass(frozen=True)
class Linearised:
    """All recordings at one point: their matrix with the priors, descent vector with them, parts, residuals."""

    matrix: Arrow
    vector: Array
    parts: tuple[Array, ...]
    residuals: tuple[Array, ...]


def linearised(setup: JointSetup, trial: Trial) -> Linearised:
    """Return the normal equations at a trial.

    Raises
    ------
    FloatingPointError : a tangent has run away
    """
    found = setup.each(lambda index: _linearised(setup, trial, index), range(len(setup.problem.data)))
    blocks, parts, residuals = (tuple(column) for column in zip(*found, strict=True))
    if not all(np.max(np.abs(block)) < LARGEST_INFORMATION for block in blocks):
        raise FloatingPointError("the derivative of the chain is not finite")
    steps, (means, stds) = setup.problem.steps, setup.problem.priors
    inverse = (steps / stds) ** 2
    vector = -inverse * (trial.z - means) / steps
    places = tuple(own for own, _ in setup.problem.places)
    for place, part in zip(places, parts, strict=True):
        vector[place] += part
    return Linearised(Arrow(places, blocks, inverse, setup.recording), vector, parts, residuals)


def solve_many(
    problem: Problem, start: Array, max_iterations: int, smoothing: float = 0.0, each: Each = in_turn
) -> JointSolution:
    """Return a joint minimum.

    Parameters
    ----------
    start : (k,) where to start
    smoothing : standard deviation of the residual's smoothing [rad]
    """
    start, effort = np.clip(start, *problem.bounds), Effort(max_iterations)
    setup = joint_setup(problem, start, smoothing, each)
    return _solution(setup, *minimise_about(start, partial(_descent, setup), try_at(setup, start), effort))


def _descent(setup: JointSetup, about: Array) -> Descent[Trial, Linearised]:
    setup = replace(setup, about=about)
    return Descent[Trial, Linearised](
        try_at=lambda z: try_at(setup, z),
        linearise=lambda trial: linearised(setup, trial),
        step=lambda point, z, damping: _step(setup, point, z, damping),
        promise=lambda point, z: _promise(setup, point, z),
        bounds=setup.problem.bounds,
    )


def _solution(setup: JointSetup, trial: Trial, point: Linearised, cost: tuple[int, int, bool]) -> JointSolution:
    """Return the solution in SI units."""
    steps, places = setup.problem.steps, point.matrix.places
    blocks = tuple(block / np.outer(steps[p], steps[p]) for p, block in zip(places, point.matrix.blocks, strict=True))
    misfits, lifts, share = [], [], 0.0
    for index, residual in enumerate(point.residuals):
        lift = setup.lift(index)
        misfits.append(float(lift.product(residual, residual)))
        lifts.append(lift.coefficients(residual))
        share += float(np.sum(lift.shrink))
    return JointSolution(
        trial.z, trial.chi_square, trial.data_chi_square, point.vector / steps, *cost,
        Arrow(places, blocks, point.matrix.diagonal / steps**2, setup.recording),
        tuple(part / steps[p] for p, part in zip(places, point.parts, strict=True)), np.array(misfits), tuple(lifts),
        share,
    )  # fmt: skip


def _promise(setup: JointSetup, point: Linearised, z: Array) -> float:
    """Return how much chi-square the undamped step in the free parameters promises."""
    free = free_at(z, point.vector, *setup.problem.bounds)
    return float(point.vector[free] @ point.matrix.solve(free, point.vector, pseudo=True)[free])


def _step(setup: JointSetup, point: Linearised, z: Array, damping: float) -> tuple[Array, float]:
    """Return a damped step within bounds [SI] and how much chi-square it promises."""
    steps, (lower, upper) = setup.problem.steps, setup.problem.bounds
    more = np.full(z.size, 1e-9)
    first = setup.problem.n_nonlinear
    more[:first] += damping * np.maximum(point.matrix.main_diagonal()[:first], 1e-3)
    damped = replace(point.matrix, diagonal=point.matrix.diagonal + more)
    free = free_at(z, point.vector, lower, upper)
    step = np.zeros(z.size)
    for _ in range(8):
        held = np.where(free, 0.0, step)
        step = held + damped.solve(free, point.vector - point.matrix.times(held))
        over = ((z + step * steps < lower) | (z + step * steps > upper)) & free
        if not over.any():
            break
        step = np.clip(step, (lower - z) / steps, (upper - z) / steps)
        free &= ~over
    promise = float(2.0 * point.vector @ step - step @ point.matrix.times(step))
    return step * steps, promise

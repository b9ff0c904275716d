"""The joint fit of many recordings: each contributes a compact summary, whatever is its own is eliminated first.

At one set of values a recording says about the shared parameters ``s`` and its own ones ``o`` the quadratic form
``G`` (Gauss-Newton). Its own parameters touch no other recording, so they are eliminated where they stand,
``S = G_ss - G_so (G_oo + P_o)^-1 G_os``, and the sum of the summaries ``S`` is solved for the shared parameters
alone (the arrow form of bundle adjustment: Triggs et al., Vision Algorithms (2000), section 6). The step costs the
same for 5 and for 500 recordings; making a summary costs one evaluation of the chain and its derivatives. Leaving a
recording out takes its summary off the sum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from camtorque.fit.predict import HeldOutError
from camtorque.fit.problem import Problem, build_problem
from camtorque.fit.solve import (
    LARGEST_DAMPING,
    RELATIVE_TOLERANCE,
    Solution,
    bounded_quadratic,
    chain_coefficients,
    design_matrix,
    held_torque,
    linear_steps,
    solve,
)
from camtorque.fit.solve import _linear_priors as linear_priors
from camtorque.fit.solve import _priors as priors_of
from camtorque.laws.chain import ChainOutput, chain_derivative, evaluate_chain
from camtorque.records import Array, freeze_arrays

MANY = 12
"""Recordings from which on the joint fit works with summaries."""
MOST_STEPS = 60
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Layout:
    """Where the parameters of a problem stand: non-linear first, then linear, then lift coefficients.

    shared : (k,) places of those that all recordings share; own : per recording, places of its own
    is_nonlinear : (n,) bool; steps, lower, upper, mean, inverse : (n,) scale, bounds and priors [SI]
    """

    shared: Indices
    own: tuple[Indices, ...]
    is_nonlinear: NDArray[np.bool_]
    steps: Array
    lower: Array
    upper: Array
    mean: Array
    inverse: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True)
class Summary:
    """What one recording says at one set of values, in units of the steps.

    gram : (j, j) over its shared, then its own parameters; pull : (j,) half the descent of chi-square
    chi_square : of its data; residual : (m,) [N m]; output : the chain
    """

    gram: Array
    pull: Array
    chi_square: float
    residual: Array
    output: ChainOutput


def layout(problem: Problem) -> Layout:
    """Return where the parameters of a problem stand."""
    slots = (*problem.nonlinear, *problem.linear)
    recording = np.array([slot.recording for slot in slots] + [-1] * problem.n_lift)
    x_mean, x_inverse = priors_of(problem.nonlinear)
    mean, inverse, lower, upper = linear_priors(problem)
    steps = np.r_[[slot.row.step for slot in problem.nonlinear], linear_steps(problem)]
    return Layout(
        np.flatnonzero(recording < 0), tuple(np.flatnonzero(recording == k) for k in range(len(problem.data))),
        np.arange(recording.size) < len(problem.nonlinear), steps,
        np.r_[[slot.row.lower for slot in problem.nonlinear], lower],
        np.r_[[slot.row.upper for slot in problem.nonlinear], upper], np.r_[x_mean, mean], np.r_[x_inverse, inverse],
    )  # fmt: skip


def summarise(problem: Problem, places: Layout, values: Array, index: int) -> Summary:
    """Return the summary of one recording.

    Parameters
    ----------
    values : (n,) all parameters [SI]
    index : the recording
    """
    item, n_x = problem.data[index], len(problem.nonlinear)
    chi_square, residual, output = misfit(problem, values, index)
    named = problem.values(values[:n_x], index)
    used = np.r_[places.shared, places.own[index]]
    nonlinear = used[places.is_nonlinear[used]]
    names = tuple(problem.nonlinear[j].row.name for j in nonlinear)
    coefficients = chain_coefficients(problem, values[n_x:])
    columns = np.zeros((item.torque.size, used.size))
    columns[:, places.is_nonlinear[used]] = chain_derivative(item.chain, named, output, coefficients, names)
    design = design_matrix(problem, index, output)
    columns[:, ~places.is_nonlinear[used]] = design[:, used[~places.is_nonlinear[used]] - n_x]
    weighted = columns * (item.weight[:, None] * places.steps[used])
    return Summary(weighted.T @ weighted, weighted.T @ (residual * item.weight), chi_square, residual, output)


def misfit(problem: Problem, values: Array, index: int) -> tuple[float, Array, ChainOutput]:
    """Return chi-square, residual [N m] and chain of one recording."""
    item, n_x = problem.data[index], len(problem.nonlinear)
    output = evaluate_chain(item.chain, problem.values(values[:n_x], index))
    model = output.torque + held_torque(problem, output) + design_matrix(problem, index, output) @ values[n_x:]
    residual = item.torque - model
    chi = float(np.sum((residual * item.weight) ** 2))
    return (chi if np.isfinite(chi) else np.inf), residual, output


@dataclass(frozen=True)
class Reduced:
    """A summary without the recording's own parameters.

    matrix : (k, k) S; vector : (k,); back : (own, k + 1) what the own parameters follow, for the shared step and nil
    """

    matrix: Array
    vector: Array
    back: Array


def reduced(summary: Summary, places: Layout, values: Array, index: int, damping: float) -> Reduced:
    """Return the summary with the recording's own parameters eliminated, their priors included."""
    k, own = places.shared.size, places.own[index]
    scale = places.steps[own]
    block = summary.gram[k:, k:].copy()
    pull = summary.pull[k:] - places.inverse[own] * (values[own] - places.mean[own]) * scale
    diagonal = np.diag(block) * places.is_nonlinear[own] * damping
    block[np.diag_indices_from(block)] += places.inverse[own] * scale**2 + diagonal + 1e-12
    cross = summary.gram[k:, :k]
    back = np.asarray(np.linalg.solve(block, np.column_stack([cross, pull])), dtype=np.float64)
    matrix = summary.gram[:k, :k] - cross.T @ back[:, :k]
    return Reduced(matrix, summary.pull[:k] - cross.T @ back[:, k], back)


def shared_step(matrix: Array, vector: Array, places: Layout, values: Array, damping: float) -> Array:
    """Return the step of the shared parameters (k,) in units of their steps, within their bounds."""
    shared = places.shared
    scale, now = places.steps[shared], values[shared]
    diagonal = np.diag(matrix) * places.is_nonlinear[shared] * damping
    system = matrix + np.diag(places.inverse[shared] * scale**2 + diagonal + 1e-12)
    rhs = vector - places.inverse[shared] * (now - places.mean[shared]) * scale
    return bounded_quadratic(system, rhs, (places.lower[shared] - now) / scale, (places.upper[shared] - now) / scale)


def total(problem: Problem, places: Layout, values: Array) -> float:
    """Return chi-square of all recordings with all priors."""
    data = sum(misfit(problem, values, k)[0] for k in range(len(problem.data)))
    return data + _prior_chi(places, values)


def _prior_chi(places: Layout, values: Array) -> float:
    return float(np.sum(places.inverse * (values - places.mean) ** 2))


def solve_many(
    problem: Problem,
    start: Array | None = None,
    max_iterations: int = MOST_STEPS,
    tolerance: float = RELATIVE_TOLERANCE,
) -> Solution:
    """Return the minimum that a start leads to; the same as `solve`, in the arrow form.

    Parameters
    ----------
    problem : recordings of one pump
    start : (n_nonlinear,) [SI]; the rows' starts by default
    tolerance : relative change of chi-square that ends the search
    """
    places = layout(problem)
    x = problem.start() if start is None else np.asarray(start, dtype=float)
    values = np.clip(np.r_[x, np.clip(0.0, *_linear_bounds(places))], places.lower, places.upper)
    chi, damping, evaluations, converged, iteration = np.inf, 1.0e-2, 0, False, 0
    while not converged and iteration < max_iterations:
        iteration += 1
        summaries = [summarise(problem, places, values, k) for k in range(len(problem.data))]
        chi = sum(s.chi_square for s in summaries) + _prior_chi(places, values)
        while damping < LARGEST_DAMPING:
            candidate = _moved(summaries, places, values, damping)
            found = total(problem, places, candidate)
            evaluations += 1
            if found <= chi:
                converged = chi - found <= tolerance * chi and damping < 1.0
                values, damping = candidate, max(damping * 0.15, 1.0e-9)
                break
            damping *= 6.0
        else:
            break
    return _solution(problem, places, values, (iteration, evaluations, converged))


def minimise(
    problem: Problem,
    start: Array | None = None,
    max_iterations: int = MOST_STEPS,
    tolerance: float = RELATIVE_TOLERANCE,
) -> Solution:
    """Return the minimum that a start leads to, by summaries where there are many recordings."""
    chosen = solve_many if len(problem.data) >= MANY else solve
    return chosen(problem, start, max_iterations, tolerance)


def _linear_bounds(places: Layout) -> tuple[Array, Array]:
    return places.lower[~places.is_nonlinear], places.upper[~places.is_nonlinear]


def _moved(summaries: Sequence[Summary], places: Layout, values: Array, damping: float) -> Array:
    parts = [reduced(s, places, values, k, damping) for k, s in enumerate(summaries)]
    matrix, vector = sum(p.matrix for p in parts), sum(p.vector for p in parts)
    step = shared_step(matrix, vector, places, values, damping)  # type: ignore[arg-type]
    moved = values.copy()
    moved[places.shared] += step * places.steps[places.shared]
    for part, own in zip(parts, places.own, strict=True):
        moved[own] += (part.back[:, -1] - part.back[:, :-1] @ step) * places.steps[own]
    return np.clip(moved, places.lower, places.upper)


def _solution(problem: Problem, places: Layout, values: Array, counts: tuple[int, int, bool]) -> Solution:
    """Return the record of a minimum, with the Gauss-Newton matrix put together from the summaries."""
    n_x = len(problem.nonlinear)
    hessian = np.zeros((values.size, values.size))
    residuals, outputs, data_chi = [], [], 0.0
    for k in range(len(problem.data)):
        summary = summarise(problem, places, values, k)
        used = np.r_[places.shared, places.own[k]]
        hessian[np.ix_(used, used)] += summary.gram
        residuals.append(summary.residual)
        outputs.append(summary.output)
        data_chi += summary.chi_square
    prior = np.diag(places.inverse * places.steps**2)
    return Solution(
        values[:n_x], values[n_x:], data_chi + _prior_chi(places, values), data_chi, hessian + prior, hessian,
        tuple(residuals), tuple(outputs), *counts,
    )  # fmt: skip


def left_out_misfit(problem: Problem, solution: Solution) -> HeldOutError:
    """Return how well every recording is predicted by the others, from the summaries at the minimum.

    The own parameters of the left-out recording follow within their priors. The rms is that of the weighted residual,
    scaled to the rms of the fit.
    """
    rise = 0.0
    for part, step in left_out_steps(problem, solution):
        rise += float(step @ part.matrix @ step - 2.0 * part.vector @ step)
    misfit_sum = solution.data_chi_square + rise
    rms = float(np.sqrt(np.mean([np.mean(r**2) for r in solution.residuals])))
    return HeldOutError(rms * float(np.sqrt(max(misfit_sum / solution.data_chi_square, 0.0))), misfit_sum)


def left_out_steps(problem: Problem, solution: Solution) -> list[tuple[Reduced, Array]]:
    """Return each recording's summary, and the step (k,) of the shared parameters when it is left out."""
    places = layout(problem)
    values = np.r_[solution.x, solution.c]
    parts = [reduced(summarise(problem, places, values, k), places, values, k, 0.0) for k in range(len(problem.data))]
    matrix, vector = sum(p.matrix for p in parts), sum(p.vector for p in parts)
    return [(p, shared_step(matrix - p.matrix, vector - p.vector, places, values, 0.0)) for p in parts]


def without_one(problem: Problem, solution: Solution, index: int, step: Array) -> tuple[Problem, Solution]:
    """Return the others' problem with the minimum that a left-out recording leaves them, to first order.

    Parameters
    ----------
    step : (k,) of the shared parameters, by `left_out_steps`
    """
    places = layout(problem)
    values = np.r_[solution.x, solution.c]
    values[places.shared] += step * places.steps[places.shared]
    names = [slot.name for slot in (*problem.nonlinear, *problem.linear)]
    known = dict(zip(names, values, strict=False))
    fewer = build_problem([item for k, item in enumerate(problem.data) if k != index], problem.effects)
    x = np.array([known[slot.name] for slot in fewer.nonlinear])
    c = np.r_[[known[slot.name] for slot in fewer.linear], values[len(names) :]]
    return fewer, replace(solution, x=x, c=c)

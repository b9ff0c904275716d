"""Separable least squares: linear parameters eliminated, exact derivatives for the rest, bounds, priors.

At each trial of the non-linear parameters the linear ones (friction and damping coefficients, zeros, lift
correction) are solved exactly within their bounds (variable projection; Golub & Pereyra, Inverse Problems 19 (2003),
Kaufman's form of the derivative). Each recording contributes the Gram matrix of its own columns, so a step costs the
recordings' model evaluations and one small solve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from camtorque.fit.problem import FitData, Problem, Slot
from camtorque.laws.chain import LINEAR_NAMES, ChainOutput, chain_derivative, evaluate_chain
from camtorque.records import Array, freeze_arrays

RELATIVE_TOLERANCE = 1.0e-9
LARGEST_DAMPING = 1.0e12
REMAINING_SHARE = 1.0e-6
"""A minimum is one where the undamped step promises less than this share of chi-square."""


@dataclass(frozen=True)
class Solution:
    """A minimum.

    Attributes
    ----------
    x : (n_nonlinear,) non-linear parameters [SI]
    c : (n_linear + n_lift,) linear parameters, then lift coefficients [SI]
    chi_square : weighted sum of squares with priors; ``data_chi_square`` without
    hessian : Gauss-Newton matrix of all parameters in units of their steps, priors included
    data_hessian : the same without priors
    residuals : per recording (m,) measured - model [N m]
    outputs : per recording, the chain at the minimum
    iterations, evaluations : what it cost
    converged : whether the projected gradient, scaled by the Gauss-Newton matrix, vanishes there
    """

    x: Array
    c: Array
    chi_square: float
    data_chi_square: float
    hessian: Array
    data_hessian: Array
    residuals: tuple[Array, ...]
    outputs: tuple[ChainOutput, ...]
    iterations: int
    evaluations: int
    converged: bool

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True)
class Trial:
    """The problem at one x with the best linear parameters."""

    x: Array
    c: Array
    outputs: tuple[ChainOutput, ...]
    designs: tuple[Array, ...]
    residuals: tuple[Array, ...]
    chi_square: float
    data_chi_square: float


def linear_steps(problem: Problem) -> Array:
    """Return the scale of each linear parameter and lift coefficient [SI]."""
    steps = [slot.row.step for slot in problem.linear]
    if problem.n_lift:
        steps += [problem.data[0].chain.lift_basis.prior_std] * problem.n_lift  # type: ignore[union-attr]
    return np.array(steps)


def design_matrix(problem: Problem, index: int, output: ChainOutput) -> Array:
    """Return d(torque)/d(linear parameter) of one recording, (m, n_linear + n_lift)."""
    m = output.torque.size
    design = np.zeros((m, len(problem.linear) + problem.n_lift))
    for j, slot in enumerate(problem.linear):
        if slot.row.name == "torque_zero":
            if slot.recording == index:
                design[:, j] = 1.0
        else:
            design[:, j] = output.linear[:, LINEAR_NAMES.index(slot.row.name)]
    if problem.n_lift:
        design[:, len(problem.linear) :] = output.linear[:, len(LINEAR_NAMES) :]
    return design


def chain_coefficients(problem: Problem, c: Array) -> Array:
    """Return the coefficients of the chain's linear columns, zero for those that are off."""
    n_basis = problem.data[0].chain.lift_basis
    size = len(LINEAR_NAMES) + (n_basis.n_basis if n_basis is not None else 0)
    result = np.zeros(size)
    for j, slot in enumerate(problem.linear):
        if slot.row.name != "torque_zero":
            result[LINEAR_NAMES.index(slot.row.name)] = c[j]
    for name, value in problem.held_linear.items():
        if name != "torque_zero":
            result[LINEAR_NAMES.index(name)] = value
    if problem.n_lift:
        result[len(LINEAR_NAMES) :] = c[len(problem.linear) :]
    elif problem.uses_lift and problem.held_lift is not None:
        result[len(LINEAR_NAMES) :] = problem.held_lift
    return result


def held_torque(problem: Problem, output: ChainOutput) -> Array:
    """Return the torque of the linear parameters that are held, (m,) [N m]."""
    nothing = np.zeros(len(problem.linear) + problem.n_lift)
    return output.linear @ chain_coefficients(problem, nothing) + problem.held_linear.get("torque_zero", 0.0)


def _priors(slots: tuple[Slot, ...]) -> tuple[Array, Array]:
    """Return prior means and inverse variances; no prior has inverse variance zero."""
    means = np.array([slot.row.prior[0] if slot.row.prior else 0.0 for slot in slots])
    inverse = np.array([1.0 / slot.row.prior[1] ** 2 if slot.row.prior else 0.0 for slot in slots])
    return means, inverse


def _linear_priors(problem: Problem) -> tuple[Array, Array, Array, Array]:
    """Return mean, inverse variance, lower and upper bound of the linear parameters and lift coefficients."""
    mean, inverse = _priors(problem.linear)
    lower = np.array([slot.row.lower for slot in problem.linear])
    upper = np.array([slot.row.upper for slot in problem.linear])
    if problem.n_lift:
        basis = problem.data[0].chain.lift_basis
        assert basis is not None
        ones = np.ones(problem.n_lift)
        mean, inverse = np.r_[mean, 0.0 * ones], np.r_[inverse, ones / basis.prior_std**2]
        lower, upper = np.r_[lower, -basis.bound * ones], np.r_[upper, basis.bound * ones]
    return mean, inverse, lower, upper


def bounded_quadratic(
    matrix: Array, vector: Array, lower: Array, upper: Array, active: NDArray[np.int64] | None = None
) -> Array:
    """Return the minimum of ``c^T M c / 2 - v^T c`` within bounds, by an active set.

    Parameters
    ----------
    matrix : (n, n) symmetric positive definite
    vector, lower, upper : (n,)
    active : (n,) -1 and +1 where a bound is likely to hold, such as those of a neighbouring problem
    """
    n = vector.size
    at = np.zeros(n, dtype=int) if active is None else active.copy()
    c = np.zeros(n)
    for _ in range(5 * n + 10):
        free = at == 0
        c = np.where(at < 0, lower, np.where(at > 0, upper, 0.0))
        if free.any():
            rhs = vector[free] - matrix[np.ix_(free, ~free)] @ c[~free]
            c[free] = _solved(matrix[np.ix_(free, free)], rhs)
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


def _solved(matrix: Array, vector: Array) -> Array:
    """Return the solution of a symmetric system; the shortest one where columns repeat each other."""
    try:
        return np.asarray(np.linalg.solve(matrix, vector), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, vector, rcond=1e-13)[0], dtype=np.float64)


def try_at(problem: Problem, x: Array, near: Trial | None = None) -> Trial:
    """Evaluate all recordings at x and solve for the linear parameters; ``near`` is a trial at a neighbouring x."""
    mean, inverse, lower, upper = _linear_priors(problem)
    steps = linear_steps(problem)
    outputs, designs, targets = [], [], []
    matrix, vector = np.diag(inverse * steps**2), inverse * mean * steps
    for index, item in enumerate(problem.data):
        output = evaluate_chain(item.chain, problem.values(x, index))
        design = design_matrix(problem, index, output)
        target = item.torque - output.torque - held_torque(problem, output)
        weighted = design * (item.weight[:, None] * steps)
        matrix += weighted.T @ weighted
        vector += weighted.T @ (target * item.weight)
        outputs.append(output)
        designs.append(design)
        targets.append(target)
    active = None if near is None else (near.c >= upper).astype(int) - (near.c <= lower).astype(int)
    c = bounded_quadratic(matrix + 1e-13 * np.eye(steps.size), vector, lower / steps, upper / steps, active) * steps
    c = np.clip(c, lower, upper)
    residuals = tuple(target - design @ c for target, design in zip(targets, designs, strict=True))
    data_chi = sum(float(np.sum((r * item.weight) ** 2)) for r, item in zip(residuals, problem.data, strict=True))
    x_mean, x_inverse = _priors(problem.nonlinear)
    chi = data_chi + float(np.sum(inverse * (c - mean) ** 2)) + float(np.sum(x_inverse * (x - x_mean) ** 2))
    chi = chi if np.isfinite(chi) else np.inf
    return Trial(x, c, tuple(outputs), tuple(designs), residuals, chi, data_chi)


def _jacobian(problem: Problem, trial: Trial, item: FitData, index: int) -> Array:
    """Return d(model torque)/d(x) of one recording, (m, n_nonlinear) [N m per SI]."""
    slots = problem.nonlinear
    used = [j for j, slot in enumerate(slots) if slot.recording in (-1, index)]
    names = tuple(slots[j].row.name for j in used)
    jacobian = np.zeros((item.torque.size, len(slots)))
    values = problem.values(trial.x, index)
    coefficients = chain_coefficients(problem, trial.c)
    jacobian[:, used] = chain_derivative(item.chain, values, trial.outputs[index], coefficients, names)
    return jacobian


def _normal_equations(problem: Problem, trial: Trial) -> tuple[Array, Array, Array]:
    """Return Gram matrix of [x, c] without and with priors, and the gradient by x; all in units of the steps."""
    steps = np.r_[[slot.row.step for slot in problem.nonlinear], linear_steps(problem)]
    n_x = len(problem.nonlinear)
    data_gram = np.zeros((steps.size, steps.size))
    gradient = np.zeros(steps.size)
    for index, item in enumerate(problem.data):
        columns = np.column_stack([_jacobian(problem, trial, item, index), trial.designs[index]])
        weighted = columns * item.weight[:, None] * steps
        data_gram += weighted.T @ weighted
        gradient += weighted.T @ (trial.residuals[index] * item.weight)
    x_mean, x_inverse = _priors(problem.nonlinear)
    c_inverse = _linear_priors(problem)[1]
    prior = np.r_[x_inverse, c_inverse] * steps**2
    gradient[:n_x] -= x_inverse * (trial.x - x_mean) * steps[:n_x]
    return data_gram, data_gram + np.diag(prior), gradient[:n_x]


def _step(problem: Problem, trial: Trial, gram: Array, gradient: Array, damping: float) -> Array:
    """Return the damped Gauss-Newton step in x [SI], variables held at their bounds where the step leaves them."""
    n_x = len(problem.nonlinear)
    steps = np.array([slot.row.step for slot in problem.nonlinear])
    lower = np.array([slot.row.lower for slot in problem.nonlinear])
    upper = np.array([slot.row.upper for slot in problem.nonlinear])
    _, _, c_lower, c_upper = _linear_priors(problem)
    inner = np.flatnonzero((trial.c > c_lower) & (trial.c < c_upper)) + n_x
    cross = gram[:n_x][:, inner]
    reduced = gram[:n_x, :n_x]
    if inner.size:
        block = gram[np.ix_(inner, inner)] + 1e-13 * np.eye(inner.size)
        reduced = reduced - cross @ np.linalg.solve(block, cross.T)
    diagonal = np.maximum(np.diag(reduced), 1e-9 * np.max(np.diag(reduced), initial=1e-300))
    matrix = reduced + np.diag(damping * diagonal + 1e-12)
    room_low, room_high = (lower - trial.x) / steps, (upper - trial.x) / steps
    return bounded_quadratic(matrix, gradient, room_low, room_high) * steps


def remaining_gain(problem: Problem, trial: Trial, gram: Array, gradient: Array) -> float:
    """Return an upper limit of what the undamped Gauss-Newton step within the bounds promises chi-square.

    It is the projected gradient in the metric of the Gauss-Newton matrix: free of units, zero at a minimum, and large
    where a search has stopped for want of progress.
    """
    if not problem.nonlinear:
        return 0.0
    steps = np.array([slot.row.step for slot in problem.nonlinear])
    step = _step(problem, trial, gram, gradient, 0.0) / steps
    # the promised fall 2 g.s - s.R.s lies between g.s and 2 g.s, for R is positive and s the best step
    return 2.0 * float(gradient @ step)


def solve(
    problem: Problem, start: Array | None = None, max_iterations: int = 80, tolerance: float = RELATIVE_TOLERANCE
) -> Solution:
    """Return the minimum that a start leads to.

    Parameters
    ----------
    problem : what to fit
    start : (n_nonlinear,) [SI]; the rows' starts by default
    tolerance : relative change of chi-square that ends the search

    Returns
    -------
    Solution
        ``converged`` tells whether the end is a minimum (`remaining_gain`), whatever ended the search.
    """
    x = problem.start() if start is None else np.array(start, dtype=float)
    lower = np.array([slot.row.lower for slot in problem.nonlinear])
    upper = np.array([slot.row.upper for slot in problem.nonlinear])
    trial = try_at(problem, np.clip(x, lower, upper))
    damping, evaluations, ended, iteration = 1.0e-2, 1, not problem.nonlinear, 0
    while not ended and iteration < max_iterations:
        iteration += 1
        _, gram, gradient = _normal_equations(problem, trial)
        while True:
            step = _step(problem, trial, gram, gradient, damping)
            candidate = try_at(problem, np.clip(trial.x + step, lower, upper), trial)
            evaluations += 1
            gain = trial.chi_square - candidate.chi_square
            if gain >= 0.0:
                ended = gain <= tolerance * trial.chi_square and damping < 1.0
                trial, damping = candidate, max(damping * 0.15, 1.0e-9)
                break
            damping *= 6.0
            if damping > LARGEST_DAMPING:
                ended = True
                break
    data_gram, gram, gradient = _normal_equations(problem, trial)
    converged = remaining_gain(problem, trial, gram, gradient) <= REMAINING_SHARE * trial.chi_square
    return Solution(
        trial.x, trial.c, trial.chi_square, trial.data_chi_square, gram, data_gram, trial.residuals, trial.outputs,
        iteration, evaluations, converged,
    )  # fmt: skip

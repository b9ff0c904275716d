"""A problem as one plain least-squares problem: all free parameters side by side, priors as further residuals.

The solver eliminates the linear parameters; ties between parameters, posterior sampling and plain minimisers need them
in view. Order everywhere: non-linear, linear, lift coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.fit.problem import Problem
from camtorque.fit.solve import Solution, Trial, chain_coefficients, design_matrix, held_torque, linear_steps
from camtorque.laws.chain import ChainOutput, chain_derivative, evaluate_chain
from camtorque.laws.rows import ParameterRow
from camtorque.records import Array


@dataclass(frozen=True)
class FullPoint:
    """A problem evaluated at given values of all its parameters.

    Attributes
    ----------
    z : (n,) parameters [SI]
    outputs, designs : chain, and d(torque)/d(linear parameter), per recording
    residuals : per recording (m,) measured - model [N m]
    vector : (n_bins + n_priors,) weighted residuals, then (mean - value)/std of the priors
    """

    z: Array
    outputs: tuple[ChainOutput, ...]
    designs: tuple[Array, ...]
    residuals: tuple[Array, ...]
    vector: Array

    @property
    def chi_square(self) -> float:
        """Sum of squares with priors."""
        return float(self.vector @ self.vector)


@dataclass(frozen=True)
class FullLimits:
    """Bounds, scales and priors of all parameters, each (n,) [SI]; a missing prior has an infinite deviation."""

    lower: Array
    upper: Array
    steps: Array
    prior_mean: Array
    prior_std: Array


def full_rows(problem: Problem) -> tuple[ParameterRow, ...]:
    """Return the rows of the named parameters, in order."""
    return tuple(slot.row for slot in (*problem.nonlinear, *problem.linear))


def full_limits(problem: Problem) -> FullLimits:
    """Return bounds, scales and priors of all parameters, lift coefficients at the end."""
    rows = full_rows(problem)
    lower, upper = [row.lower for row in rows], [row.upper for row in rows]
    mean = [row.prior[0] if row.prior else 0.0 for row in rows]
    std = [row.prior[1] if row.prior else np.inf for row in rows]
    steps = np.r_[[slot.row.step for slot in problem.nonlinear], linear_steps(problem)]
    basis = problem.data[0].chain.lift_basis
    if problem.n_lift and basis is not None:
        ones = np.ones(problem.n_lift)
        lower, upper = np.r_[lower, -basis.bound * ones], np.r_[upper, basis.bound * ones]
        mean, std = np.r_[mean, 0.0 * ones], np.r_[std, basis.prior_std * ones]
    return FullLimits(np.array(lower), np.array(upper), steps, np.array(mean), np.array(std))


def full_values(solution: Solution) -> Array:
    """Return all parameters of a minimum, (n,) [SI]."""
    return np.concatenate([solution.x, solution.c])


def evaluate_full(problem: Problem, z: Array) -> FullPoint:
    """Return the problem at given values of all its parameters, (n,) [SI]."""
    n_x = len(problem.nonlinear)
    outputs, designs, residuals = [], [], []
    for index, item in enumerate(problem.data):
        output = evaluate_chain(item.chain, problem.values(z[:n_x], index))
        design = design_matrix(problem, index, output)
        outputs.append(output)
        designs.append(design)
        residuals.append(item.torque - output.torque - held_torque(problem, output) - design @ z[n_x:])
    return full_point(problem, Trial(z[:n_x], z[n_x:], tuple(outputs), tuple(designs), tuple(residuals), 0.0, 0.0))


def full_point(problem: Problem, trial: Trial) -> FullPoint:
    """Return a trial of the solver with its weighted residuals and those of the priors."""
    z, limits = np.concatenate([trial.x, trial.c]), full_limits(problem)
    weighted = [residual * item.weight for residual, item in zip(trial.residuals, problem.data, strict=True)]
    known = np.isfinite(limits.prior_std)
    prior = (limits.prior_mean[known] - z[known]) / limits.prior_std[known]
    return FullPoint(z, trial.outputs, trial.designs, trial.residuals, np.concatenate([*weighted, prior]))


def full_jacobian(problem: Problem, point: FullPoint) -> Array:
    """Return d(vector)/dz, (n_bins + n_priors, n) [1/SI]."""
    n_x = len(problem.nonlinear)
    coefficients = chain_coefficients(problem, point.z[n_x:])
    blocks = []
    for index, item in enumerate(problem.data):
        used = [j for j, slot in enumerate(problem.nonlinear) if slot.recording in (-1, index)]
        names = tuple(problem.nonlinear[j].row.name for j in used)
        columns = np.zeros((item.torque.size, point.z.size))
        values = problem.values(point.z[:n_x], index)
        columns[:, used] = chain_derivative(item.chain, values, point.outputs[index], coefficients, names)
        columns[:, n_x:] = point.designs[index]
        blocks.append(-columns * item.weight[:, None])
    limits = full_limits(problem)
    known = np.isfinite(limits.prior_std)
    return np.vstack([*blocks, -np.diag(1.0 / limits.prior_std)[known]])


def as_solution(
    problem: Problem, point: FullPoint, jacobian: Array, cost: tuple[int, int], converged: bool
) -> Solution:
    """Return a point in the form of the solver's minimum; ``cost`` is (iterations, evaluations)."""
    n_x, n_bins = len(problem.nonlinear), sum(residual.size for residual in point.residuals)
    scaled = jacobian * full_limits(problem).steps
    data = scaled[:n_bins]
    return Solution(
        point.z[:n_x], point.z[n_x:], point.chi_square, float(np.sum(point.vector[:n_bins] ** 2)), scaled.T @ scaled,
        data.T @ data, point.residuals, point.outputs, *cost, converged,
    )  # fmt: skip

"""Several recordings fitted together by one dense matrix: what sums of small blocks are held against."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from camtorque.fit.descent import Descent, Effort, free_at, minimise_about, promised
from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.problem import Problem
from camtorque.fit.quadratic import bounded_quadratic, bounded_step
from camtorque.fit.solver import LiftModes, linear_part, output_at, smoother, with_slopes
from camtorque.fit.uncertainty import LEAST_FREEDOM, inverse, prior_std
from camtorque.laws.chain import BINS


def dense_solve(
    problem: Problem, start: np.ndarray, iterations: int, lifts: tuple[LiftModes, ...], smoothing: float = 0.0
) -> SimpleNamespace:
    """Return a joint minimum with the lift corrections of the recordings."""
    first, steps, bounds, (means, stds) = problem.n_nonlinear, problem.steps, problem.bounds, problem.priors
    scale, smooth, inverses = steps[first:], smoother(smoothing), (steps / stds) ** 2
    about = np.clip(start, *bounds)

    def try_at(z):
        fixed = np.r_[z[:first], np.zeros(scale.size)]
        matrix, vector = np.diag(inverses[first:] + 1e-9), inverses[first:] * means[first:] / scale
        wide = []
        for index, lift in enumerate(lifts):
            own, columns, target = linear_part(
                problem, fixed, index, output_at(problem, np.r_[z[:first], about[first:]], index)
            )
            full = np.zeros((BINS, scale.size + 1))
            full[:, own - first] = columns * steps[own]
            full[:, -1] = target
            wide.append(smooth(full))
            both = lift.gram(wide[-1])
            matrix, vector = matrix + both[:-1, :-1], vector + both[:-1, -1]
        lower, upper = (bound[first:] / scale for bound in bounds)
        c = bounded_quadratic(matrix, vector, lower, upper, np.clip(z[first:] / scale, lower, upper))
        full = np.r_[z[:first], c * scale]
        residuals = [columns[:, -1] - columns[:, :-1] @ c for columns in wide]
        chi = sum(float(lift.product(r, r)) for lift, r in zip(lifts, residuals, strict=True))
        prior = float(np.sum(((full - means) / stds) ** 2))
        return SimpleNamespace(z=full, residuals=residuals, chi_square=chi + prior, data_chi_square=chi)

    def linearise(trial):
        matrix, vector = np.zeros((problem.size, problem.size)), np.zeros(problem.size)
        for index, lift in enumerate(lifts):
            output, both = with_slopes(problem, trial.z, index)
            both[:, -1] = problem.data[index].residual(output, problem.values(trial.z, index)[1])
            both = smooth(both)
            product, own = lift.gram(both), problem.places[index][0]
            matrix[np.ix_(own, own)] += product[:-1, :-1]
            vector[own] += product[:-1, -1]
        vector = vector - inverses * (trial.z - means) / steps
        return SimpleNamespace(data=matrix, matrix=matrix + np.diag(inverses), vector=vector)

    def step(point, z, damping):
        more = np.full(z.size, 1e-9)
        more[:first] += damping * np.maximum(np.diag(point.matrix)[:first], 1e-3)
        found, promise = bounded_step(point.matrix, more, point.vector, z / steps, *(b / steps for b in bounds))
        return found * steps, promise

    def promise(point, z):
        return promised(point.matrix, point.vector, free_at(z, point.vector, *bounds))

    def descent_about(point):
        nonlocal about
        about = point
        return Descent(try_at, linearise, step, promise, bounds)

    found, point, cost = minimise_about(about, descent_about, try_at(about), Effort(iterations))
    outer, (n_iterations, evaluations, converged) = np.outer(steps, steps), cost
    return SimpleNamespace(
        **vars(found), hessian=point.matrix / outer, data_hessian=point.data / outer, iterations=n_iterations,
        evaluations=evaluations, converged=converged, lift_share=sum(float(np.sum(lift.shrink)) for lift in lifts),
    )  # fmt: skip


def dense_covariance(
    problem: Problem, data_hessian: np.ndarray, data_chi_square: float, lift_share: float
) -> SimpleNamespace:
    """Return the covariance at a joint minimum, as `uncertainty.covariance` does for one recording."""
    prior, count = np.diag(1.0 / prior_std(problem) ** 2), len(problem.data)
    taken = float(np.sum(inverse(data_hessian + prior) * data_hessian)) + lift_share
    freedom = max(INDEPENDENT * count - taken, LEAST_FREEDOM * count)
    inflation = max(1.0, data_chi_square / freedom)
    matrix = inverse(data_hessian / inflation + prior)
    return SimpleNamespace(matrix=matrix, std=np.sqrt(np.diag(matrix)), inflation=inflation, freedom=freedom)

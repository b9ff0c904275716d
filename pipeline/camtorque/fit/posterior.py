"""Posterior by Markov chains, on request: emcee over every named parameter, the lift correction integrated out.

Bounds and priors are exact; the data variances are widened by what the residual exceeds them, as in the covariance.
Given the named parameters the model is linear in the lift coefficients and their prior is normal, so with
``A = P^-1 + B^T W B`` and ``v = B^T W r`` their integral is ``-(r^T W r - v^T A^-1 v + ln det A)/2`` (their bounds,
three deviations away, are left out). Moves: differential evolution with snooker updates (ter Braak & Vrugt, Statistics
and Computing 18 (2008)), which follow the narrow valleys of this model better than the stretch move.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from camtorque.fit.full_space import FullLimits, FullPoint, evaluate_full, full_limits, full_rows, full_values
from camtorque.fit.pinned import softened
from camtorque.fit.problem import Problem
from camtorque.fit.solve import Solution
from camtorque.fit.uncertainty import covariance, parameter_names
from camtorque.records import Array, Refusal, freeze_arrays

WALKERS_PER_PARAMETER = 2.5
BAND = (2.5, 50.0, 97.5)
BAND_DRAWS = 200
ENOUGH = 50.0
"""Chain length over autocorrelation time from which emcee's authors trust the estimate."""


@dataclass(frozen=True)
class Posterior:
    """Samples of the posterior.

    Attributes
    ----------
    names, units : (k,) labels and units of the report
    samples : (n, k) in those units, first third of every chain left out
    log_posterior : (n,)
    acceptance : share of accepted moves
    autocorrelation_steps : largest over the parameters
    trusted : True where the chains are longer than 50 autocorrelation times
    torque_band, pressure_band : recording -> (3, m) [N m] and (3, n_theta) [Pa]: 2.5, 50 and 97.5 %
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    samples: Array
    log_posterior: Array
    acceptance: float
    autocorrelation_steps: float
    trusted: bool
    torque_band: Mapping[str, Array]
    pressure_band: Mapping[str, Array]

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True)
class Marginal:
    """The posterior of the named parameters with the lift correction integrated out."""

    problem: Problem
    limits: FullLimits
    count: int

    def log_density(self, named: Array) -> float:
        """Return the logarithm of the density up to a constant; minus infinity outside the bounds."""
        if np.any(named < self.limits.lower[: self.count]) or np.any(named > self.limits.upper[: self.count]):
            return -np.inf
        point = self.point(named)
        value = -0.5 * point.chi_square
        if self.problem.n_lift:
            factor, vector = self.lift_normal(point)
            value += 0.5 * float(vector @ cho_solve(factor, vector)) - float(np.sum(np.log(np.diag(factor[0]))))
        return float(value) if np.isfinite(value) else -np.inf

    def point(self, named: Array) -> FullPoint:
        """Return the problem at named parameters [SI] with no lift correction."""
        return evaluate_full(self.problem, np.concatenate([named, np.zeros(self.problem.n_lift)]))

    def lift_normal(self, point: FullPoint) -> tuple[tuple[Array, bool], Array]:
        """Return the Cholesky factor of A and v, coefficients in units of their prior deviation."""
        scale = self.limits.prior_std[self.count :]
        matrix, vector = np.eye(scale.size), np.zeros(scale.size)
        n_linear = len(self.problem.linear)
        for item, design, residual in zip(self.problem.data, point.designs, point.residuals, strict=True):
            columns = design[:, n_linear:] * (item.weight[:, None] * scale)
            matrix += columns.T @ columns
            vector += columns.T @ (residual * item.weight)
        return cho_factor(matrix, lower=True), vector

    def drawn_point(self, named: Array, generator: np.random.Generator) -> FullPoint:
        """Return the problem at named parameters with a draw of the lift correction."""
        point = self.point(named)
        if not self.problem.n_lift:
            return point
        (lower, _), vector = self.lift_normal(point)
        white = generator.standard_normal(vector.size)
        lift = cho_solve((lower, True), vector) + np.linalg.solve(np.tril(lower).T, white)
        return evaluate_full(self.problem, np.concatenate([named, lift * self.limits.prior_std[self.count :]]))


def marginal(problem: Problem, solution: Solution) -> Marginal:
    """Return the posterior of a problem with its data variances widened by what the residual exceeds them."""
    soft = softened(problem, covariance(problem, solution).inflation)
    return Marginal(soft, full_limits(soft), len(parameter_names(soft)))


def sample_posterior(problem: Problem, solution: Solution, steps: int = 1500, seed: int = 0) -> Posterior:
    """Return samples of the posterior around a minimum.

    Parameters
    ----------
    problem, solution : the chosen model at its minimum
    steps : length of every chain; the first third is left out
    seed : of start, moves and draws

    Raises
    ------
    Refusal
        When emcee is not installed.
    """
    try:
        import emcee
    except ImportError as error:
        raise Refusal(
            "posterior: emcee is not installed; install the extra with `pip install camtorque[posterior]`"
        ) from error
    target = marginal(problem, solution)
    scale = np.array([row.per_unit for row in full_rows(problem)])
    start = _start(target, problem, solution, seed) / scale
    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
    sampler = emcee.EnsembleSampler(
        start.shape[0], start.shape[1], lambda named: target.log_density(named * scale), moves=moves
    )
    first = emcee.State(start, random_state=np.random.MT19937(seed).state)
    sampler.run_mcmc(first, steps, skip_initial_state_check=True)
    autocorrelation = float(np.max(sampler.get_autocorr_time(tol=0)))
    samples = sampler.get_chain(discard=steps // 3, flat=True)
    torque, pressure = _bands(target, samples * scale, seed)
    return Posterior(
        parameter_names(problem), tuple(row.unit for row in full_rows(problem)), samples,
        sampler.get_log_prob(discard=steps // 3, flat=True), float(np.mean(sampler.acceptance_fraction)),
        autocorrelation, bool(steps > ENOUGH * autocorrelation), torque, pressure,
    )  # fmt: skip


def _start(target: Marginal, problem: Problem, solution: Solution, seed: int) -> Array:
    """Return starts of the walkers inside the bounds, spread as the covariance says, (n_walkers, k) [SI]."""
    generator = np.random.default_rng(seed)
    best, limits, k = full_values(solution)[: target.count], target.limits, target.count
    cov = covariance(problem, solution).matrix
    # a parameter at its bound has no covariance: a small share of its step gets the walkers moving
    deviations = np.where(np.diag(cov) > 0.0, 0.0, 0.1 * limits.steps[:k])
    count = 2 * int(np.ceil(0.5 * WALKERS_PER_PARAMETER * k))
    values, vectors = np.linalg.eigh(cov / np.outer(limits.steps[:k], limits.steps[:k]))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) * limits.steps[:k, None]
    spread = generator.standard_normal((count, k)) @ root.T
    drawn = best + 0.5 * spread + np.abs(generator.standard_normal((count, k))) * deviations
    width = limits.upper[:k] - limits.lower[:k]
    # mirrored at the bounds, so that no two walkers share a coordinate
    folded = limits.lower[:k] + np.abs(drawn - limits.lower[:k])
    folded = limits.upper[:k] - np.abs(limits.upper[:k] - folded)
    return np.clip(folded, limits.lower[:k] + 1e-9 * width, limits.upper[:k] - 1e-9 * width)


def _bands(target: Marginal, samples: Array, seed: int) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return quantiles of model torque and chamber pressure over draws of the posterior, per recording."""
    generator = np.random.default_rng(seed + 1)
    chosen = generator.choice(samples.shape[0], min(BAND_DRAWS, samples.shape[0]), replace=False)
    points = [target.drawn_point(samples[k], generator) for k in chosen]
    torque, pressure = {}, {}
    for index, item in enumerate(target.problem.data):
        curves = np.array([item.torque - point.residuals[index] for point in points])
        torque[item.name] = np.percentile(curves, BAND, axis=0)
        pressure[item.name] = np.percentile([point.outputs[index].pressure for point in points], BAND, axis=0)
    return torque, pressure

"""Posterior sampling against the normal limit, and its refusal without emcee."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from camtorque.fit.posterior import marginal, sample_posterior
from camtorque.fit.problem import build_problem
from camtorque.fit.solve import solve
from camtorque.fit.uncertainty import covariance
from camtorque.records import Refusal
from fit_cases import fit_data


@pytest.fixture(scope="module")
def case():
    problem = build_problem([fit_data()], ("trigger",))
    return problem, solve(problem)


@pytest.mark.slow
def test_nearly_normal_posterior_has_the_covariance(case):
    pytest.importorskip("emcee")
    problem, solution = case
    found = sample_posterior(problem, solution, steps=450, seed=2)
    cov = covariance(problem, solution)
    per = [slot.row.per_unit for slot in (*problem.nonlinear, *problem.linear)]
    expected = np.sqrt(np.diag(cov.matrix)) / per
    # 300 steps of 6 walkers, 30 steps apart: some sixty independent draws tell a deviation to 9 %, three allowed
    assert np.std(found.samples, axis=0) == pytest.approx(expected, rel=0.28)
    # the widened weights let the priors pull more: the centre is the minimum under those
    bottom = solve(marginal(problem, solution).problem, solution.x)
    best = np.r_[bottom.x, bottom.c] / per
    assert np.all(np.abs(np.mean(found.samples, axis=0) - best) < 0.5 * expected)
    low, median, high = found.torque_band["A"]
    assert np.all((low <= median) & (median <= high))
    assert 0.05 < found.acceptance < 0.9
    assert found.names == ("trigger_offset", "torque_zero")


def test_outside_the_bounds_there_is_nothing(case):
    problem, solution = case
    target = marginal(problem, solution)
    inside = np.r_[solution.x, solution.c]
    assert np.isfinite(target.log_density(inside))
    outside = np.array(inside)
    outside[0] = 2.0 * target.limits.upper[0]
    assert target.log_density(outside) == -np.inf


def test_lift_is_integrated_out_exactly():
    # The integral over the coefficients equals density(peak) * sqrt((2 pi)^n / det): compare differences of both.
    problem = build_problem([fit_data()], ("trigger", "lift"))
    solution = solve(problem)
    target = marginal(problem, solution)
    values = []
    for shift in (0.0, 0.5):
        named = np.r_[solution.x, solution.c[:1]]
        named[0] += shift * target.limits.steps[0]
        point = target.point(named)
        columns = point.designs[0][:, 1:] * target.problem.data[0].weight[:, None] * target.limits.prior_std[2:]
        residual = point.residuals[0] * target.problem.data[0].weight
        # normal evidence, the long way: r ~ N(0, 1 + B B^T)
        evidence = np.eye(residual.size) + columns @ columns.T
        prior = point.vector[residual.size :]
        expected = -0.5 * (residual @ np.linalg.solve(evidence, residual) + np.linalg.slogdet(evidence)[1])
        expected -= 0.5 * float(prior @ prior)
        values.append(target.log_density(named) - expected)
    assert values[0] == pytest.approx(values[1], abs=1e-6 * max(1.0, abs(values[0])))
    assert values[0] == pytest.approx(0.0, abs=1e-6 * solution.chi_square)


def test_missing_emcee_is_said_in_one_line(case, monkeypatch):
    monkeypatch.setitem(sys.modules, "emcee", None)
    with pytest.raises(Refusal, match=r"emcee is not installed; install the extra"):
        sample_posterior(*case, steps=2)

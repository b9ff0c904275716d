"""Profile likelihood: parabola where the model is nearly linear, one-sided at a bound, flat where nothing is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.pinned import pinned, softened
from camtorque.fit.problem import build_problem
from camtorque.fit.profiles import THRESHOLD, describe, profile
from camtorque.fit.solve import solve
from camtorque.fit.uncertainty import covariance
from camtorque.units import DEGREE
from fit_cases import TRUE_LINEAR, TRUE_NONLINEAR, fit_data


@pytest.fixture(scope="module")
def fitted():
    problem = build_problem([fit_data()], ("trigger", "friction", "damping"))
    return problem, solve(problem)


def test_nearly_linear_parameter_gives_the_interval_of_the_covariance(fitted):
    problem, solution = fitted
    cov = covariance(problem, solution)
    deviation = float(np.sqrt(cov.matrix[0, 0])) / DEGREE
    found = profile(problem, solution, "trigger_offset")
    assert found.kind == "two-sided"
    # one per cent of interpolation between steps of 0.7, 1.1, 1.8 deviations, a few of curvature and bounds
    assert 0.5 * (found.high - found.low) == pytest.approx(np.sqrt(THRESHOLD) * deviation, rel=0.1)
    assert found.low < TRUE_NONLINEAR["trigger_offset"] / DEGREE < found.high
    assert not found.lower_minimum
    assert "95 % interval" in describe(found, problem.nonlinear[0].row)


def test_limit_is_one_sided_exactly_where_the_bound_costs_nothing():
    # whether there is a lower end is decided by what the bound itself costs
    item = fit_data()
    bare = replace(item, rows={**item.rows, "plunger_viscous": replace(item.rows["plunger_viscous"], prior=None)})
    problem = build_problem([bare], ("trigger", "damping"), {"shaft_viscous": TRUE_LINEAR["shaft_viscous"]})
    solution = solve(problem)
    found = profile(problem, solution, "plunger_viscous")
    assert found.kind in ("upper limit", "two-sided")
    zero = solve(pinned(problem, "plunger_viscous", 0.0))
    inflation = covariance(problem, solution).inflation
    reaches = zero.data_chi_square - solution.data_chi_square > THRESHOLD * inflation
    assert (found.kind == "two-sided") == reaches


def test_flat_profile_is_called_flat():
    # weights a thousand times too small and no prior: neither data nor sheet say anything about the low-pass
    item = fit_data()
    rows = {**item.rows, "cutoff": replace(item.rows["cutoff"], prior=None, lower=900.0, upper=1100.0)}
    still = replace(item, rows=rows, weight=item.weight * 1e-3)
    problem = build_problem([still], ("sensor",))
    solution = solve(problem)
    found = profile(problem, solution, "cutoff")
    assert found.kind == "flat"
    assert (found.low, found.high) == (900.0, 1100.0)
    assert np.all(np.abs(found.rise) < THRESHOLD)
    assert describe(found, rows["cutoff"]).startswith("cutoff: flat")


def test_profile_beyond_the_minimum_is_noticed(fitted):
    problem, solution = fitted
    # a fit that stopped early, far from the bottom along another direction
    early = solve(problem, problem.start(), max_iterations=1)
    found = profile(problem, early, "guide_friction")
    assert np.min(found.rise) > -1e-3 or found.lower_minimum
    assert found.values.size >= 3
    assert np.all(np.diff(found.values) > 0.0)
    assert solution.chi_square <= early.chi_square


def test_unknown_parameter_is_named(fitted):
    with pytest.raises(KeyError, match="no free parameter 'mass'"):
        profile(*fitted, "mass")


def test_softened_weights_divide_the_data_part_alone(fitted):
    problem, solution = fitted
    soft = softened(problem, 4.0)
    again = solve(soft, solution.x)
    assert again.data_chi_square == pytest.approx(solution.data_chi_square / 4.0, rel=0.05)
    assert soft.nonlinear == problem.nonlinear

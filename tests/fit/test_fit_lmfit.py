"""The interface that users meet: fixing, bounds, ties, other priors, and the report."""

from __future__ import annotations

import re
from dataclasses import replace

import lmfit
import numpy as np
import pytest
from camtorque.fit import lmfit_interface
from camtorque.fit.full_space import evaluate_full, full_jacobian, full_limits, full_values
from camtorque.fit.problem import build_problem
from camtorque.fit.solve import solve
from fit_cases import TRUE_LINEAR, TRUE_NONLINEAR, TRUE_ZERO, fit_data

EFFECTS = ("trigger", "friction", "damping")
TRUTH = {**TRUE_LINEAR, **TRUE_NONLINEAR, "torque_zero": TRUE_ZERO}


@pytest.fixture(scope="module")
def problem():
    return build_problem([fit_data()], EFFECTS)


@pytest.fixture(scope="module")
def result(problem):
    return lmfit_interface.minimize(problem)


def test_parameters_are_those_of_the_report(problem):
    params = lmfit_interface.to_lmfit(problem)
    rows = {slot.name: slot.row for slot in (*problem.nonlinear, *problem.linear)}
    assert list(params) == list(rows)
    for name, row in rows.items():
        assert params[name].user_data is row
        assert params[name].vary
        assert params[name].value * row.per_unit == pytest.approx(row.start, abs=1e-12 * row.step)
        assert params[name].min * row.per_unit == pytest.approx(row.lower, abs=1e-12 * row.step)
        assert params[name].max * row.per_unit == pytest.approx(row.upper, abs=1e-12 * row.step)


def test_round_trip_changes_nothing(problem):
    again = lmfit_interface.from_lmfit(problem, lmfit_interface.to_lmfit(problem))
    for before, after in zip((*problem.nonlinear, *problem.linear), (*again.nonlinear, *again.linear), strict=True):
        for field in ("start", "lower", "upper"):
            assert getattr(after.row, field) == pytest.approx(getattr(before.row, field), rel=1e-14, abs=0.0)


def test_same_minimum_as_the_solver(problem, result):
    solution = solve(problem)
    assert result.chisqr == pytest.approx(solution.chi_square, rel=1e-9)
    for slot, value in zip(problem.nonlinear, solution.x, strict=True):
        assert result.params[slot.name].value * slot.row.per_unit == pytest.approx(value, abs=1e-6 * slot.row.step)


def test_report_prints_every_parameter(result):
    text = lmfit.fit_report(result)
    for name in result.params:
        assert f"    {name}:" in text
    assert "least_squares" in text
    assert "Warning" not in text


def test_standard_errors_are_those_of_the_measured_scatter():
    # A sigma wrong by ten has to show. Alone, the trigger angle hardly feels a prior: 2 % for that.
    problem = build_problem([fit_data()], ("trigger",))
    result = lmfit_interface.minimize(problem)
    sharper = [replace(item, weight=10.0 * item.weight) for item in problem.data]
    other = lmfit_interface.minimize(replace(problem, data=tuple(sharper)))
    wide, narrow = result.params["trigger_offset"].stderr, other.params["trigger_offset"].stderr
    assert wide == pytest.approx(10.0 * narrow, rel=0.02)
    scaled = lmfit_interface.minimize(problem, scale_covar=True)
    assert scaled.covar == pytest.approx(result.covar * result.redchi, rel=1e-9)


def test_reduced_chi_square_counts_independent_residuals(result):
    # 720 white bins weighted as 60 independent ones: their chi-square is 60 +- 60 sqrt(2/720) = 60 +- 3.2, and the
    # priors, met within one deviation or two, add a few to nfree and little to the sum
    assert result.nfree == pytest.approx(720 / 12 + len(result.residual) - 720 - len(result.var_names))
    assert np.sum(result.residual[:720] ** 2) == pytest.approx(60.0, abs=4 * 3.2)


def test_truth_is_within_its_error(result):
    for name, truth in TRUTH.items():
        parameter = result.params[name]
        # weights admit twelve times the variance of this white noise: four sigma of it is 14 of what is printed
        assert abs(parameter.value * parameter.user_data.per_unit - truth) < 4.0 * (
            parameter.stderr * parameter.user_data.per_unit
        ), name


def test_fixed_parameter_stays(problem):
    params = lmfit_interface.to_lmfit(problem)
    params["guide_friction"].set(value=0.03, vary=False)
    params["shaft_drag"].set(value=0.4, vary=False)
    fixed = lmfit_interface.minimize(problem, params)
    assert fixed.params["guide_friction"].value == 0.03
    assert fixed.params["shaft_drag"].value == 0.4
    assert fixed.params["shaft_drag"].stderr is None
    assert "guide_friction" not in fixed.var_names
    assert fixed.solution.c[[slot.name for slot in problem.linear].index("shaft_drag")] == pytest.approx(0.4)


def test_bound_is_kept_and_named(problem):
    params = lmfit_interface.to_lmfit(problem)
    params["trigger_offset"].set(max=0.1)  # the truth is 0.25 deg
    bounded = lmfit_interface.minimize(problem, params)
    assert bounded.params["trigger_offset"].value == pytest.approx(0.1)
    assert bounded.params["trigger_offset"].stderr is None
    assert not bounded.errorbars
    assert re.search(r"trigger_offset: +at boundary", lmfit.fit_report(bounded))


@pytest.mark.parametrize("bound", ["min", "max"])
def test_bounds_of_the_law_are_not_left(problem, bound):
    params = lmfit_interface.to_lmfit(problem)
    params["guide_friction"].set(**{bound: -np.inf if bound == "min" else np.inf})
    row = lmfit_interface.from_lmfit(problem, params)
    slot = next(slot for slot in row.nonlinear if slot.name == "guide_friction")
    assert (slot.row.lower, slot.row.upper) == (0.0, 0.35)


def test_start_outside_the_law_is_refused(problem):
    params = lmfit_interface.to_lmfit(problem)
    params["guide_friction"].set(value=0.9, max=1.0)
    with pytest.raises(ValueError, match=r"guide_friction: 0\.9 - is outside \[0\.0, 0\.35\]"):
        lmfit_interface.from_lmfit(problem, params)


def test_missing_parameter_is_named(problem):
    params = lmfit_interface.to_lmfit(problem)
    del params["trigger_offset"]
    with pytest.raises(KeyError, match="trigger_offset"):
        lmfit_interface.from_lmfit(problem, params)


def test_trivial_tie_gives_the_untied_fit(problem, result):
    # One more name and an identity: the same minimum, found by the chain rule instead of the solver.
    params = lmfit_interface.to_lmfit(problem)
    params.add("mu", value=0.06, min=0.0, max=0.3)
    params["guide_friction"].set(expr="mu")
    params.add("arm", value=100.0, min=0.0, max=2000.0)
    params["bearing_arm"].set(expr="2*arm")
    tied = lmfit_interface.minimize(problem, params)
    assert tied.chisqr == pytest.approx(result.chisqr, rel=1e-7)
    assert tied.params["guide_friction"].value == pytest.approx(result.params["guide_friction"].value, rel=1e-3)
    assert tied.params["bearing_arm"].stderr == pytest.approx(result.params["bearing_arm"].stderr, rel=1e-3)
    assert tied.params["arm"].stderr == pytest.approx(0.5 * result.params["bearing_arm"].stderr, rel=1e-3)
    assert "== '2*arm'" in lmfit.fit_report(tied)


def test_tie_between_linear_parameters(problem, result):
    params = lmfit_interface.to_lmfit(problem)
    params["shaft_drag"].set(expr="24*shaft_viscous")  # as in the truth: 0.12 and 0.005
    tied = lmfit_interface.minimize(problem, params)
    assert tied.params["shaft_drag"].value == pytest.approx(24.0 * tied.params["shaft_viscous"].value)
    assert tied.chisqr >= result.chisqr * (1.0 - 1e-9)
    assert "shaft_drag" not in tied.var_names


def test_own_parameters_of_two_recordings_keep_their_names():
    data = [fit_data("A 1", 1), fit_data("B-2", 2, speed=80.0)]
    problem = build_problem(data, EFFECTS)
    params = lmfit_interface.to_lmfit(problem)
    assert {"torque_zero__A_1", "torque_zero__B_2"} < set(params)
    params["torque_zero__A_1"].set(value=0.3, vary=False)
    found = lmfit_interface.minimize(problem, params)
    assert found.params["torque_zero__A_1"].value == pytest.approx(0.3)
    assert "torque_zero__A_1" not in found.var_names
    assert found.params["torque_zero__B_2"].stderr > 0.0


def test_names_that_would_collide_are_refused():
    problem = build_problem([fit_data("A 1"), fit_data("A-1")], ())
    with pytest.raises(ValueError, match="rename one of them"):
        lmfit_interface.to_lmfit(problem)


def test_full_jacobian_is_that_of_the_residuals():
    problem = build_problem([fit_data()], (*EFFECTS, "lift"))
    z = full_values(solve(problem))
    point, steps = evaluate_full(problem, z), full_limits(problem).steps
    exact = full_jacobian(problem, point)
    for j in (0, 1, 3, len(z) - 40):
        ahead, behind = np.array(z), np.array(z)
        ahead[j] += 1e-4 * steps[j]
        behind[j] -= 1e-4 * steps[j]
        numeric = (evaluate_full(problem, ahead).vector - evaluate_full(problem, behind).vector) / (2e-4 * steps[j])
        # central differences with 1e-4 of a step: truncation 1e-8, rounding 1e-9 of the scale
        assert np.max(np.abs(numeric - exact[:, j])) < 1e-6 * np.max(np.abs(exact[:, j]))

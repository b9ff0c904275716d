"""A minimum on data that it has not seen: other cycles, other recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.predict import held_out_error, left_out, model_torque, shared_values, torque_zero
from camtorque.fit.problem import build_problem
from camtorque.fit.solve import solve
from fit_cases import NOISE, TRUE_ZERO, fit_data

EFFECTS = ("trigger", "friction", "damping")


@pytest.fixture(scope="module")
def joint():
    problem = build_problem([fit_data("A", 1, 60.0), fit_data("B", 2, 120.0)], EFFECTS)
    return problem, solve(problem)


def test_model_on_the_fitted_cycles_leaves_the_residual_of_the_fit(joint):
    problem, solution = joint
    for index, item in enumerate(problem.data):
        torque, _ = model_torque(problem, solution, index, item)
        assert item.torque - torque == pytest.approx(solution.residuals[index], abs=1e-12 * np.max(item.torque))


def test_held_out_cycles_are_met_to_their_noise(joint):
    problem, solution = joint
    held = [fit_data("A", 11, 60.0), fit_data("B", 12, 120.0)]
    # 1440 white bins tell a standard deviation to 2 %; ten parameters fitted to as many others add 1 %
    assert held_out_error(problem, solution, held).rms == pytest.approx(NOISE, rel=0.08)


def test_left_out_recording_fits_its_own_zero_alone(joint):
    problem, solution = joint
    moved = fit_data("C", 3, 90.0)
    moved = replace(moved, torque=moved.torque + 0.5, weight=moved.weight * 100.0)
    own, found = left_out(problem, solution, moved)
    assert [slot.name for slot in (*own.nonlinear, *own.linear)] == ["torque_zero"]
    expected = torque_zero(problem, solution, 0)
    # the shift comes back on top of what drag and zero share in the joint fit; prior negligible at this weight
    assert found.c[0] - 0.5 == pytest.approx(expected, abs=0.1)
    assert np.std(found.residuals[0]) == pytest.approx(NOISE, rel=0.15)


def test_blind_prediction_fits_nothing(joint):
    own, found = left_out(*joint, fit_data("C", 3, 90.0), {"torque_zero": TRUE_ZERO})
    assert not own.nonlinear
    assert not own.linear
    assert found.converged
    assert np.std(found.residuals[0]) == pytest.approx(NOISE, rel=0.15)


def test_own_parameters_are_not_shared(joint):
    values, lift = shared_values(*joint)
    assert "torque_zero" not in values
    assert {"trigger_offset", "guide_friction", "bearing_arm", "plunger_viscous"} <= set(values)
    assert lift is None

"""A second tooth: what it tells of the swing of the shaft enters every minimum, and moves nothing where it agrees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.descent import Effort
from camtorque.fit.joint_solver import joint_setup, linearised
from camtorque.fit.joint_solver import try_at as joint_try_at
from camtorque.fit.prepare import further_teeth
from camtorque.fit.problem import build_problem
from camtorque.fit.solver import lift_at, normal_equations, solve, try_at
from camtorque.fit.teeth import PLACE_STD, lead_slopes, leads_at
from camtorque.fit.uncertainty import covariance
from camtorque.laws.chain import NONLINEAR_NAMES, SHIFT_NAMES, cam_motion, drive_response
from camtorque.records import PASSED
from camtorque.units import DEGREE
from fit_cases import bridged, quick, quick_data

KEY = ("soft_driveline",)
PLACES = np.array([1.4, 6.4])


def motion_of(item, values):
    return cam_motion(item.chain, values, drive_response(item.chain, values))


def with_tooth(found, more: float = 0.0):
    """Return a recording with a tooth where its minimum expects it, or where the cam leads by some radians more."""
    item, values = found.data, found.problem.values(found.solution.z, 0)[0]
    place = item.chain.trigger_angle + 60.0 * DEGREE
    lead = leads_at(motion_of(item, values), item.chain, np.array([place]))[0] + more
    return replace(item, teeth=np.array([[place, lead, PLACE_STD]]))


def test_slopes_of_the_leads_are_their_differences():
    item = quick_data(KEY)
    values = build_problem([item]).values(build_problem([item]).start, 0)[0]
    slopes = lead_slopes(motion_of(item, values), item.chain, PLACES)
    for name in SHIFT_NAMES:
        step = 1e-4 * max(abs(values[name]), 1e-6)
        ends = [
            leads_at(motion_of(item, {**values, name: values[name] + sign * step}), item.chain, PLACES)
            for sign in (-1.0, 1.0)
        ]
        expected = (ends[1] - ends[0]) / (2.0 * step)
        scale = np.max(np.abs(expected)) + 1e-12
        assert slopes[:, NONLINEAR_NAMES.index(name)] == pytest.approx(expected, abs=2e-3 * scale), name


def test_a_tooth_where_the_fit_expects_it_narrows_the_trigger_and_moves_nothing():
    found = quick(KEY)
    problem = build_problem([with_tooth(found)])
    again = solve(problem, found.solution.z, Effort(10), found.solution.lift)
    trigger = problem.index("trigger_offset")
    before, after = (
        covariance(one, solution).std[trigger] for one, solution in ((found.problem, found.solution), (problem, again))
    )
    assert after < 0.8 * before
    assert abs(again.z[trigger] - found.solution.z[trigger]) < 0.2 * after
    assert again.chi_square <= found.solution.chi_square + 1e-6


def test_a_tooth_elsewhere_pulls_the_swing_its_way():
    found = quick(KEY)
    more = 4.0 * PLACE_STD
    item = with_tooth(found, more)
    problem = build_problem([item])
    again = solve(problem, found.solution.z, Effort(20), found.solution.lift)
    left = item.tooth_misfit(motion_of(item, problem.values(again.z, 0)[0]))
    assert 0.0 < left[0] < 3.5  # of 4 beforehand
    assert again.chi_square < found.solution.chi_square + 16.0


def test_a_joint_fit_counts_the_tooth_as_a_single_one_does():
    found = quick(KEY)
    problem, z = build_problem([with_tooth(found, 2.0 * PLACE_STD)]), found.solution.z
    lift = lift_at(problem, z)
    single, bare = try_at(problem, z, lift), try_at(found.problem, z, lift)
    assert single.chi_square - bare.chi_square == pytest.approx(4.0, rel=1e-6)
    setup = joint_setup(problem, z, 0.0)
    trial = joint_try_at(setup, z)
    assert trial.chi_square == pytest.approx(single.chi_square, rel=1e-6)
    matrix, vector, _ = normal_equations(problem, single.z, single.residual, lift)
    joint = linearised(setup, trial)
    means, stds = problem.priors
    pulled = vector - (problem.steps / stds) ** 2 * (single.z - means) / problem.steps
    assert joint.vector == pytest.approx(pulled, rel=1e-4, abs=1e-4 * np.max(np.abs(pulled)))
    assert matrix.shape == (problem.size, problem.size)


def test_teeth_on_the_motor_side_say_nothing_of_the_cam():
    config = bridged(KEY)[0].config
    passed = {PASSED: np.array([[1.0, 0.01, 1e-4]])}
    (place, lead, std), *more = further_teeth(config, passed)
    assert (place, lead) == (config.trigger.nominal_angle + 1.0, 0.01)
    assert std == pytest.approx(PLACE_STD, rel=0.02)
    assert not more
    motor = replace(config, trigger=replace(config.trigger, side="motor"))
    assert further_teeth(motor, passed).size == further_teeth(config, {}).size == 0

"""A second tooth enters every minimum and moves nothing where it agrees; a wheel tells where a law does not hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit import single
from camtorque.fit.descent import Effort
from camtorque.fit.findings import wheel_findings
from camtorque.fit.joint_solver import joint_setup, linearised
from camtorque.fit.joint_solver import try_at as joint_try_at
from camtorque.fit.minima import Halves
from camtorque.fit.prepare import further_teeth
from camtorque.fit.problem import build_problem
from camtorque.fit.solver import lift_at, normal_equations, solve, try_at
from camtorque.fit.teeth import PLACE_STD, SWINGS_OTHERWISE, WHEEL_ORDERS, lead_slopes, leads_at, told_otherwise
from camtorque.fit.uncertainty import covariance
from camtorque.laws.chain import NONLINEAR_NAMES, SHIFT_NAMES, cam_motion, drive_response
from camtorque.records import PASSED, TEETH
from camtorque.units import DEGREE, TURN
from fit_cases import bridged, quick, quick_data, quick_prepared

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


def wheel_of(found, more: np.ndarray, teeth: int = 58) -> np.ndarray:
    """Return when teeth pass that stand as milled ones do, where the cam leads by waves of order 1, 2... [rad] more."""
    item, values = found.data, found.problem.values(found.solution.z, 0)[0]
    even = np.arange(teeth) * TURN / (teeth + 2 if teeth > 4 else 4)
    errors = 0.05 * DEGREE * np.random.default_rng(2).normal(size=teeth)
    places = item.chain.trigger_angle + even
    lead = leads_at(motion_of(item, values), item.chain, places) + errors
    return np.column_stack([even, lead + sum(size * np.sin((k + 1) * places + 0.3) for k, size in enumerate(more))])


@pytest.mark.parametrize("teeth", [11, 58])
def test_a_wheel_that_runs_out_and_has_errors_of_teeth_agrees_with_the_law(teeth: int) -> None:
    found = quick(KEY)
    passed = wheel_of(found, 0.3 * DEGREE * np.array([1.0]), teeth)
    assert told_otherwise(found.solution.output.motion, found.data.chain, passed) < 0.5 * SWINGS_OTHERWISE


@pytest.mark.parametrize(("order", "deg"), [(2, 0.2), (3, 0.3), (6, 0.3)])
def test_a_wheel_tells_by_how_much_a_cam_swings_otherwise(order: int, deg: float) -> None:
    found = quick(KEY)
    passed = wheel_of(found, deg * DEGREE * np.eye(8)[order - 1])
    apart = told_otherwise(found.solution.output.motion, found.data.chain, passed)
    assert apart == pytest.approx(deg * DEGREE / np.sqrt(2.0), rel=0.15)


def test_four_teeth_tell_nothing_of_the_law() -> None:
    found = quick(KEY)
    passed = wheel_of(found, DEGREE * np.ones(3), 4)
    assert told_otherwise(found.solution.output.motion, found.data.chain, passed) == 0.0


@pytest.mark.parametrize(
    ("deg", "side", "orders"), [(0.0, "cam", [0]), (1.0, "cam", [0, WHEEL_ORDERS]), (1.0, "motor", [0])]
)
def test_all_is_searched_anew_where_a_wheel_on_the_cam_contradicts_the_law(
    monkeypatch: pytest.MonkeyPatch, deg: float, side: str, orders: list[int]
) -> None:
    """Behind a universal joint the trigger was 1.2 degrees off, sure of it, with a wheel that showed the swing."""
    prepared, searched = quick_prepared(*KEY), []
    best = prepared.candidates[0]

    def found(*given):
        searched.append(given[4] if len(given) > 4 else 0)
        return [best], Halves(best.data, best.data)

    monkeypatch.setattr(single, "searched", found)
    monkeypatch.setattr(single, "kinds_decided", lambda minima, *_: (minima, {}))
    monkeypatch.setattr(single, "weighed_locally", lambda minima, *_: minima)
    monkeypatch.setattr(single, "profile_trigger_angle", lambda one, _: (one, prepared.valley))
    monkeypatch.setattr(single, "softer_shaft", lambda *_: None)
    recording = prepared.recording
    config = replace(recording.config, trigger=replace(recording.config.trigger, side=side))
    details = {**prepared.cycles.details, TEETH: wheel_of(best, np.array([0.0, deg * DEGREE]))}
    again = single.prepare(replace(recording, config=config), replace(prepared.cycles, details=details), prepared.rigid)
    assert searched == orders
    assert again.wheel_orders == orders[-1]


def test_a_cam_that_is_turned_by_the_wheel_is_told() -> None:
    assert wheel_findings(0) == ()
    (found,) = wheel_findings(8)
    assert (found.code, found.severity) == ("swing_by_wheel", "warning")
    assert "taken from it up to order 8" in found.text
    assert 'write side = "motor" in [trigger]' in found.text

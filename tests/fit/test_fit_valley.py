"""The valley along the trigger angle: its width, a deeper place in it, and what it does to the covariance."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from camtorque.fit import forecast
from camtorque.fit.minima import at_minimum
from camtorque.fit.problem import with_rows
from camtorque.fit.uncertainty import (
    LOUDER,
    along_valley,
    covariance,
    pressure_jacobian,
    pressure_moved_to,
    ripple,
    stated_pressure,
    unresolved_amplitude,
    without_spikes,
)
from camtorque.fit.valleys import (
    COMPLIANCE,
    HELD,
    NO_VALLEY,
    TRIGGER_ANGLE,
    WALKED,
    Valley,
    profile_trigger_angle,
    softer_shaft,
)
from camtorque.laws.chain import COLUMN_NAMES, evaluate
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.valve import SEAT_FLOW
from fit_cases import quick, quick_halves, rig
from fit_chain import chain_input, start_values
from scipy.special import expit

LAND, STIFF_SHAFT = ("closed_volume", 0, 1000.0), ("stiff_shaft", 0, 500.0)


@pytest.fixture(scope="module")
def halves():
    return quick_halves(LAND)


def curvature(item):
    return covariance(item.problem, item.solution).std[item.problem.index(TRIGGER_ANGLE)]


@pytest.fixture(scope="module")
def walked(halves):
    return profile_trigger_angle(halves.judged(quick(LAND)), halves)


def test_a_parabola_has_its_own_width():
    angles = np.linspace(-5.0, 5.0, 41)
    valley = Valley(angles, 3.0 + (angles / 0.7) ** 2, np.zeros(angles.size), 0.0)
    assert valley.std(1.0) == pytest.approx(0.7, rel=2e-3)
    assert valley.std(4.0) == pytest.approx(1.4, rel=1e-2)  # cut off at 3.6 of its deviations
    # of one side only, the mean square distance from the minimum stays
    half = Valley(angles[20:], valley.chi_square[20:], valley.prior[20:], 0.0)
    assert half.std(1.0) == pytest.approx(0.7, rel=2e-2)


def test_a_valley_that_was_not_walked_has_no_width():
    assert np.isnan(Valley(np.array([0.0, 0.1]), np.array([0.0, 1.0]), np.zeros(2), 0.0).std(1.0))
    assert np.isnan(NO_VALLEY.std(1.0))


def test_the_walk_holds_the_rigs_angle_and_rises_on_both_sides(walked, halves):
    best, valley = walked
    assert best.value <= halves.judged(quick(LAND)).value
    place = int(np.argmin(np.abs(valley.places - valley.at)))
    assert 0 < place < valley.places.size - 1
    total = valley.chi_square + valley.prior
    assert total[place] == pytest.approx(best.value, abs=0.01)
    assert total[0] > total[place] + 5.0
    assert total[-1] > total[place] + 5.0
    assert 0.5 < valley.std(1.0) / curvature(best) < 2.0


def test_a_minimum_that_was_held_aside_finds_the_deeper_place(walked, halves):
    aside = walked[0].solution.z[walked[0].problem.index(TRIGGER_ANGLE)] + 3.0 * curvature(walked[0])
    rows = {TRIGGER_ANGLE: {"start": aside, "prior": (aside, HELD)}}
    stuck = at_minimum(with_rows(walked[0].data, rows))
    prior = {TRIGGER_ANGLE: {"prior": halves.fitted.rows[TRIGGER_ANGLE].prior}}
    # what a search that stops too early hands on: everything but the angle at its best
    stuck = halves.judged(replace(stuck, data=with_rows(stuck.data, prior)))
    assert stuck.value > walked[0].value + 2.0
    freed, _ = profile_trigger_angle(stuck, halves)
    assert freed.value < walked[0].value + 1.0


def test_a_stiff_shaft_is_walked_up_from_its_value():
    halves = quick_halves(STIFF_SHAFT)
    found = halves.judged(quick(STIFF_SHAFT))
    k = found.problem.index(COMPLIANCE)
    curved, true = (
        covariance(found.problem, found.solution).std[k],
        1.0 / rig(*STIFF_SHAFT).truth.driveline.shaft_stiffness,
    )
    softer = softer_shaft(found, halves)
    assert softer is not None
    assert softer.solution.z[k] > found.solution.z[k] + 0.2 * curved
    assert 0.0 < softer.value - found.value < WALKED
    assert abs(true - found.solution.z[k]) < 2.0 * np.hypot(softer.solution.z[k] - found.solution.z[k], curved)


def test_a_shaft_that_yields_is_not_walked(walked, halves):
    assert softer_shaft(walked[0], halves) is None


def test_a_wider_valley_moves_the_others_along_it():
    found = quick(LAND)
    cov = covariance(found.problem, found.solution)
    k = found.problem.index(TRIGGER_ANGLE)
    along = along_valley(cov.matrix, k, 1.7 * cov.std[k])
    assert cov.std[k] ** 2 + along[k] ** 2 == pytest.approx((1.7 * cov.std[k]) ** 2)
    np.testing.assert_allclose(along / along[k], cov.matrix[:, k] / cov.matrix[k, k])
    for known in (0.6 * cov.std[k], float("nan")):
        assert not along_valley(cov.matrix, k, known).any()


def test_the_pressure_follows_its_parameters():
    found = quick(LAND)
    output = found.solution.output
    jacobian, places = pressure_jacobian(found.problem, output)
    assert jacobian.shape == (output.pressure.size, len(places))
    names = [found.problem.names[k] for k in places]
    assert {"bulk_modulus", "valve_mass", TRIGGER_ANGLE, "shaft_compliance"} <= set(names)
    assert "bearing_arm" not in names


def test_the_pressure_moves_at_the_cam_angle_at_which_it_is_drawn():
    """A trigger that sat elsewhere leaves the pressure where it is in time and moves all of it over the cam angle."""
    found = quick(LAND)
    output, step = found.solution.output, 2e-4
    jacobian, places = pressure_jacobian(found.problem, output)
    by_trigger = jacobian[:, places.index(found.problem.index(TRIGGER_ANGLE))]
    values, coefficients = found.problem.values(found.solution.z, 0)
    turned = {**values, TRIGGER_ANGLE: values[TRIGGER_ANGLE] + step}
    other = evaluate(found.data.chain, turned, coefficients)
    there = np.interp(output.motion.theta, other.motion.theta, other.pressure, period=2.0 * np.pi)
    loaded = output.pressure > 0.1 * np.max(output.pressure)
    size = np.sqrt(np.mean(by_trigger[loaded] ** 2))

    def off(moved):  # the grid's points do not meet the bends of the curve
        return np.sqrt(np.mean((moved - by_trigger)[loaded] ** 2)) / size

    assert off((there - output.pressure) / step) < 0.1
    assert off(pressure_moved_to(output, other) / step) < 0.1
    assert off(output.pressure_tangents[:, len(CHAMBER_NAMES)]) > 0.5


@pytest.mark.parametrize("n", [1800, 7200])
def test_a_ripple_counts_by_its_amplitude_and_a_stroke_does_not(n):
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    stroke = 300.0e5 * np.maximum(np.sin(angle), 0.0) ** 2  # turns within 30 degrees
    swinging = (angle > 1.2) & (angle < 1.6)
    ringing = stroke + 5.0e5 * np.sin(300.0 * angle) * swinging  # 1.2 degrees
    inside = (angle > 1.25) & (angle < 1.55)
    np.testing.assert_allclose(ripple(ringing)[inside], 5.0e5, rtol=0.2)
    far = (angle < 1.1) | (angle > 1.7)
    assert np.max(ripple(ringing)[far]) < 0.001 * 300.0e5
    slow = 5.0e5 * np.sin(36.0 * angle)  # 10 degrees, which a torque does tell
    assert np.max(ripple(slow)) < 0.5e5


@pytest.mark.parametrize("n", [1800, 7200])
def test_a_steep_end_of_delivery_is_no_ripple_of_the_peak_before_it(n):
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    rising = 300.0e5 * np.clip(angle - 0.5, 0.0, 1.0)
    falling = np.where(angle < 1.5, rising, np.maximum(300.0e5 * (1.0 - (angle - 1.5) / 0.01), 0.0))  # 0.6 degrees
    before = (angle > 0.6) & (angle < 1.5)
    assert np.max(ripple(falling)[before]) < 0.01 * 300.0e5
    assert np.max(ripple(falling)) > 0.05 * 300.0e5


def test_what_the_line_swings_the_chamber_may_while_it_delivers():
    angle = np.linspace(0.0, 2.0 * np.pi, 1800, endpoint=False)
    flows = np.zeros((angle.size, 4))
    flows[(angle > 1.0) & (angle < 1.6), SEAT_FLOW] = 1.0
    ringing = 5.0e5 * np.sin(300.0 * angle)
    smooth = SimpleNamespace(pressure=np.zeros(angle.size), flows=flows)
    inside, outside = (angle > 1.0) & (angle < 1.6), (angle < 0.99) | (angle > 1.61)
    np.testing.assert_allclose(unresolved_amplitude(smooth, ringing)[inside], 5.0e5, rtol=0.2)
    assert np.all(unresolved_amplitude(smooth, ringing)[outside] == 0.0)
    louder = SimpleNamespace(pressure=2.0 * ringing, flows=flows)
    np.testing.assert_array_equal(unresolved_amplitude(louder, ringing), ripple(2.0 * ringing))


@pytest.mark.parametrize("n", [1800, 7200])
def test_a_chatter_that_the_line_does_not_have_is_stated_as_its_mean(n):
    """A swing of 1.2 degrees, of which a parabola over three degrees takes a tenth along."""
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    flows = np.zeros((n, 4))
    flows[(angle > 1.0) & (angle < 1.6), SEAT_FLOW] = 1.0
    wave = 1.0e5 * np.sin(300.0 * angle)
    stroke = 100.0e5 * np.maximum(np.sin(angle), 0.0) ** 2
    chain = SimpleNamespace(uses_chamber=True, line_pressure=0.5 * stroke + wave)
    inside, outside = (angle > 1.05) & (angle < 1.55), (angle < 0.9) | (angle > 1.7)
    chattering = SimpleNamespace(pressure=stroke + 20.0 * wave, flows=flows)
    stated = stated_pressure(chain, chattering)
    np.testing.assert_allclose(ripple(stated)[inside], LOUDER * 1.0e5, rtol=0.35)
    np.testing.assert_array_equal(stated[outside], chattering.pressure[outside])
    np.testing.assert_allclose(stated[inside], stroke[inside], atol=1.35 * LOUDER * 1.0e5)
    heard = SimpleNamespace(pressure=stroke + 1.5 * wave, flows=flows)
    assert stated_pressure(chain, heard) is heard.pressure
    measured = SimpleNamespace(uses_chamber=False, line_pressure=chain.line_pressure)
    assert stated_pressure(measured, chattering) is chattering.pressure
    shut = SimpleNamespace(pressure=stroke + 20.0 * wave, flows=np.zeros((n, 4)))
    assert stated_pressure(chain, shut) is shut.pressure  # a drawn chamber that never delivers had none


def test_the_contact_of_a_forecast_carries_the_pressure_that_is_stated(monkeypatch):
    """A chatter taken off the stated pressure had stayed in the contact force."""
    chain, values = chain_input(), {**start_values(), **dict.fromkeys(COLUMN_NAMES, 0.0), "guide_friction": 0.0}
    monkeypatch.setattr(forecast, "stated_pressure", lambda chain, output: output.pressure)
    whole = forecast._parts(chain, values, None)
    monkeypatch.setattr(forecast, "stated_pressure", lambda chain, output: 0.9 * output.pressure)
    calmed = forecast._parts(chain, values, None)
    force = whole["load"] - calmed["load"]
    np.testing.assert_allclose(force, 0.1 * chain.pump.plunger_area * whole["pressure"], rtol=1e-9, atol=1e-9)
    assert np.max(force) > 100.0
    np.testing.assert_allclose(calmed["contact"] * whole["load"], whole["contact"] * calmed["load"], rtol=1e-12)
    np.testing.assert_array_equal(calmed["torque"], whole["torque"])


def test_a_slope_that_runs_away_at_one_angle_is_cut_and_a_steep_flank_is_not() -> None:
    angle = np.linspace(0.0, 360.0, 3600, endpoint=False)
    pressure = 800.0e5 * expit((angle - 100.0) / 0.3) * expit((140.0 - angle) / 0.3)
    std = 5.0e5 + 0.2 * np.abs(np.gradient(pressure, angle))  # 0.2 degrees of its place
    np.testing.assert_array_equal(without_spikes(pressure, std), std)
    spiked = std.copy()
    spiked[[0, 1, 2500, 3599]] = 1000.0e5
    cut = without_spikes(pressure, spiked)
    np.testing.assert_allclose(cut[[0, 1, 2500, 3599]], 5.0e5, rtol=1e-3)
    np.testing.assert_array_equal(cut[800:1600], std[800:1600])

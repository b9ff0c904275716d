"""Every derivative of every law against central differences: each parameter, each structure, each output."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.laws import LINEAR_NAMES, ON_BRIDGE, ON_CONTACT, ROWS, chamber
from camtorque.laws.chain import (
    BINS,
    NONLINEAR_NAMES,
    ON_CAM,
    SENSOR_NAMES,
    SHIFT_NAMES,
    cam_motion,
    chamber_of,
    drive_response,
    evaluate,
    with_transfer,
)
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.chamber import revolution
from camtorque.laws.driveline import (
    COMPLIANCE_NAMES,
    angle_shifts,
    cam_side_inertia,
    compliance,
    shaft_transfer,
    twist_basis,
)
from camtorque.laws.sensor import low_pass, sensor_transfer
from camtorque.laws.torque import bin_restoring, bin_taps, binned_by, cam_torque
from camtorque.mechanism.friction import guide_gain
from camtorque.mechanism.kinematics import path_at
from laws_cases import COEFFICIENTS, chain_input, refined, start_values, total_torque

SPEED = 60.0
OMEGA = np.arange(0.0, 200.0) * SPEED
END_OF = {
    "end_of_delivery": ("land",), "end_width": ("land",), "outlet_return": ("land",),
    "spill_lift": ("spill",), "spill_width": ("spill",), "spill_span": ("spill",),
}  # fmt: skip
"""Parameters that act in one structure alone."""
CASES = [(end, name) for name in NONLINEAR_NAMES for end in END_OF.get(name, ("land", "spill"))]


def transferred(values):
    return shaft_transfer(OMEGA, values, response(values))[0]


@pytest.fixture(scope="module")
def exact():
    found = {}
    for end in ("land", "spill"):
        values = {**start_values(end), "line_inertance": 12e6}
        data = refined(chain_input(), values)
        found[end] = data, values, evaluate(data, values, COEFFICIENTS, tangents=True)
    return found


@pytest.fixture(scope="module")
def starved():
    """A chamber that a throttled suction valve leaves half empty: the revolution begins with that."""
    values = {**start_values("spill"), "port_width": 0.0, "suction_area": 0.05e-6, "leakage": 0.0,
              "line_inertance": 12e6}  # fmt: skip
    data = refined(chain_input(), values)
    output = evaluate(data, values, COEFFICIENTS, tangents=True)
    assert output.pressure[-1] < values["feed_pressure"] - 1e5
    return data, values, output


def step_of(name):
    """Return a step of differences [SI]: small where a valve leaves its stop's cushion, large where little happens."""
    share = {"valve_stroke": 1e-4, "valve_mass": 1e-4, "half_damping": 0.03}
    return share.get(name, 1e-3) * ROWS[name].step


def central(function, value, step):
    """Return the derivative by two central differences and Richardson's extrapolation: error of the fourth order."""
    wide = (function(value + step) - function(value - step)) / (2.0 * step)
    half = (function(value + 0.5 * step) - function(value - 0.5 * step)) / step
    return (4.0 * half - wide) / 3.0


@pytest.mark.parametrize(("end", "name"), CASES)
def test_chain_has_the_derivative_that_it_states(exact, end, name):
    data, values, output = exact[end]
    stated = output.derivative[:, NONLINEAR_NAMES.index(name)]
    found = central(lambda v: total_torque(data, {**values, name: v}), values[name], 2.0 * step_of(name))
    # rounded corners of ports and stops, and Newton's tolerance of 1e-6 bar, over a step of 2e-3
    assert np.max(np.abs(stated)) > 0.0
    assert np.max(np.abs(stated - found)) < 2e-3 * np.max(np.abs(found))


def test_tangents_that_overflow_are_no_numbers_without_a_warning(exact, monkeypatch):
    data, values, _ = exact["land"]

    def overflowing(*arguments):
        pressure, by, *rest = revolution(*arguments)
        return pressure, by * np.where(np.arange(by.shape[1]) % 2, np.inf, 1e308), *rest

    monkeypatch.setattr(chamber, "revolution", overflowing)
    assert not np.all(np.isfinite(evaluate(data, values, COEFFICIENTS, tangents=True).derivative))


@pytest.mark.parametrize(("end", "name"), [case for case in CASES if case[1] in (*CHAMBER_NAMES, *SHIFT_NAMES)])
def test_chamber_has_the_tangents_that_it_states(exact, end, name):
    data, values, output = exact[end]
    order = (*CHAMBER_NAMES, *SHIFT_NAMES)
    stated = output.pressure_tangents[:, order.index(name)]

    def pressure(value):
        moved = {**values, name: value}
        return chamber_of(data, moved, cam_motion(data, moved, drive_response(data, moved, False)), False)[0]

    found = central(pressure, values[name], step_of(name))
    assert np.max(np.abs(stated - found)) < 2e-3 * np.max(np.abs(found))


@pytest.mark.parametrize("name", [name for name in CHAMBER_NAMES if name not in END_OF] + list(SHIFT_NAMES))
def test_a_revolution_that_begins_with_what_is_left_has_the_tangents_that_it_states(starved, name):
    data, values, output = starved
    stated = output.pressure_tangents[:, (*CHAMBER_NAMES, *SHIFT_NAMES).index(name)]

    def pressure(value):
        moved = {**values, name: value}
        return chamber_of(data, moved, cam_motion(data, moved, drive_response(data, moved, False)), False)[0]

    # a little more area fills much more of it: strongly curved
    fine = 0.1 if name in ("port_width", "suction_area") else 1.0
    found = central(pressure, values[name], fine * step_of(name))
    assert np.max(np.abs(stated - found)) < 2e-3 * max(np.max(np.abs(found)), 1e3 / ROWS[name].step)


def test_tangents_do_not_change_the_values(exact):
    for data, values, output in exact.values():
        plain = evaluate(data, values, COEFFICIENTS)
        assert plain.derivative is None
        assert plain.pressure_tangents is None
        # the derivative takes one more iteration of each time step, which adds what is below the chamber's tolerance
        np.testing.assert_allclose(plain.torque, output.torque, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(plain.pressure, output.pressure, rtol=0.0, atol=1.0)


def test_another_transfer_finds_the_cam_as_it_is(exact):
    data, values, output = exact["land"]
    moved = {**values, "cutoff": 0.5 * values["cutoff"], "gain_error": 0.01}
    found, anew = with_transfer(data, output, moved), evaluate(data, moved, COEFFICIENTS)
    # both leave the cam alone; the output known here has had one iteration more of each time step
    np.testing.assert_allclose(found.torque, anew.torque, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(found.linear, anew.linear, rtol=1e-6, atol=1e-9)
    assert np.max(np.abs(found.torque - output.torque)) > 0.01


def test_without_a_chamber_only_the_pressure_zero_moves_the_pressure():
    data, values = chain_input(uses_chamber=False), start_values()
    output = evaluate(data, values, COEFFICIENTS, tangents=True)
    names = [name for k, name in enumerate(CHAMBER_NAMES) if np.any(output.pressure_tangents[:, k])]
    assert names == ["pressure_zero"]
    stated = output.derivative[:, NONLINEAR_NAMES.index("pressure_zero")]
    found = central(lambda v: total_torque(data, {**values, "pressure_zero": v}), values["pressure_zero"], 1e3)
    np.testing.assert_allclose(stated, found, rtol=0.0, atol=1e-8 * np.max(np.abs(found)))


def response(values, omega=OMEGA):
    """Return C(s) and its derivatives side by side."""
    return compliance(omega, values, True)


@pytest.mark.parametrize("name", COMPLIANCE_NAMES)
def test_compliance_of_the_driveline(name):
    values = start_values()
    column = COMPLIANCE_NAMES.index(name)
    stated = response(values)[:, 1 + column]
    step = step_of(name)
    found = central(lambda v: response({**values, name: v})[:, 0], values[name], step)
    assert np.max(np.abs(stated - found)) < 1e-7 * np.max(np.abs(found))
    stated = shaft_transfer(OMEGA, values, response(values))[1][:, column]
    found = central(lambda v: transferred({**values, name: v}), values[name], step)
    assert np.max(np.abs(stated - found)) < 1e-5 * np.max(np.abs(found))


def test_inertia_on_the_cams_side_rings_at_the_resonance():
    values = start_values()
    inertia = cam_side_inertia(values)
    assert inertia * values["shaft_resonance"] ** 2 * values["shaft_compliance"] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("name", COMPLIANCE_NAMES)
def test_shift_of_the_cam_angle_and_its_rates(name):
    data, values = chain_input(), start_values()
    basis = twist_basis(data.shaft_torque, data.speed, data.trigger_angle, 0)
    column = 1 + COMPLIANCE_NAMES.index(name)
    for part in range(3):
        stated = angle_shifts(basis, response(values, basis.omega))[part][:, column]
        found = central(
            lambda v, part=part: angle_shifts(basis, response({**values, name: v}, basis.omega))[part][:, 0],
            values[name], step_of(name),
        )  # fmt: skip
        assert np.max(np.abs(stated - found)) < 1e-6 * np.max(np.abs(found))


@pytest.mark.parametrize("place", range(3), ids=SENSOR_NAMES)
def test_transfer_of_the_sensor(place):
    at = [900.0, 0.72, 4e-6]
    step = [0.5, 1e-3, 1e-8][place]

    def moved(value):
        return sensor_transfer(OMEGA, *[value if k == place else v for k, v in enumerate(at)])[0]

    stated, found = sensor_transfer(OMEGA, *at)[1][:, place], central(moved, at[place], step)
    assert np.max(np.abs(stated - found)) < 1e-7 * np.max(np.abs(found))


@pytest.mark.parametrize("order", [4, 8])
@pytest.mark.parametrize("place", range(3), ids=SENSOR_NAMES)
def test_transfer_of_a_steep_low_pass(place, order):
    at = [900.0, 0.8, 4e-6]
    step = [0.5, 1e-3, 1e-8][place]

    def moved(value):
        return low_pass(OMEGA, order, *[value if k == place else v for k, v in enumerate(at)])[0]

    stated, found = low_pass(OMEGA, order, *at)[1][:, place], central(moved, at[place], step)
    assert np.max(np.abs(stated - found)) < 1e-6 * np.max(np.abs(found))


CAM_TORQUE_BY = ("angle", "rate", "second", "pressure", "guide_friction")


@pytest.mark.parametrize("row", range(5), ids=CAM_TORQUE_BY)
def test_torque_on_the_cam(row):
    data = chain_input()
    law, theta = data.law, data.theta + 1e-3
    rate, second, pressure, mu = np.full(theta.size, 61.0), np.full(theta.size, 300.0), data.line_pressure, 0.06

    def torque(amount):
        moved = [0.0] * 5
        moved[row] = amount
        lift = law.derivatives(theta + moved[0], 3)
        whole, columns, *_ = cam_torque(
            data.constants, mu + moved[4], theta + moved[0], lift, rate + moved[1], second + moved[2],
            pressure + moved[3], COEFFICIENTS[:ON_CAM], False,
        )  # fmt: skip
        sides = np.array([1.0, *(0.0 if bridge else 1.0 for bridge in ON_BRIDGE)])
        parts = np.column_stack([whole, columns * COEFFICIENTS[:ON_CAM]])
        return np.array([parts @ sides, parts @ (1.0 - sides)])

    lift = law.derivatives(theta, 3)
    state = (theta, lift, rate, second, pressure)
    stated = cam_torque(data.constants, mu, *state, COEFFICIENTS[:ON_CAM], True)[2][:, row]
    found = central(torque, 0.0, [2e-5, 1e-2, 1.0, 1e3, 1e-4][row])
    # the sign of the sliding velocity turns within 2e-5 m/rad at both dwells: away from there
    clear = np.abs(law.evaluate(theta, 1)) > 2e-4
    for on_shaft, expected in zip(stated, found, strict=True):
        assert np.max(np.abs(on_shaft - expected)[clear]) <= 1e-6 * np.max(np.abs(expected))


def test_bearings_and_pin_rub_under_what_packing_and_damping_add_to_the_load():
    data = chain_input()
    lift, one, mu = data.law.derivatives(data.theta, 3), np.ones(data.theta.size), 0.05
    state = (data.constants, mu, data.theta, lift, 60.0 * one, 0.0 * one, data.line_pressure)
    c = COEFFICIENTS[:ON_CAM]

    def whole(values, about):
        plain, columns, by, load, _, extra = cam_torque(*state, values if about is None else about, False)
        return plain + columns @ values, columns, by, load, extra

    apart = whole(c, np.zeros(c.size))
    together, columns, by, load, extra = whole(c, None)
    np.testing.assert_array_equal(load, apart[3])
    assert by.shape == (2, 5, 0)
    # the arms' columns are contact forces times levers: as much more torque as there is more contact force
    arms = np.array(ON_CONTACT) | np.char.startswith(LINEAR_NAMES, "bending")  # the bridge feels them as well
    added = (apart[1][:, arms] @ c[arms]) * extra * guide_gain(path_tangent(data, lift), lift[1], mu) / load
    np.testing.assert_allclose(together - apart[0], added, rtol=0.0, atol=1e-9 * np.max(np.abs(together)))
    assert np.max(np.abs(added)) > 1e-3
    for k in range(c.size):
        moved = np.where(np.arange(c.size) == k, c * 1.001 + 1e-9, c)
        slope = (whole(moved, None)[0] - together) / (moved[k] - c[k])
        # what the bridge's arms feel of a force is left to the next iteration; without the arms it were some percent
        np.testing.assert_allclose(slope, columns[:, k], rtol=0.0, atol=0.01 * np.max(np.abs(columns[:, k])))


def path_tangent(data, lift):
    """Return tan phi of the contact, (n,)."""
    pump = data.constants
    return path_at(*lift[:3], pump.base, pump.offset, pump.radius)[1]


def test_twice_the_bins_hold_the_same_torque_and_derivatives():
    """What a slow bench's shaft asks for (decision 0185); between, bins of half the width are their means."""
    values = start_values("land")
    once, twice = (
        evaluate(refined(chain_input(n=6 * BINS, bins=bins), values), values, COEFFICIENTS, tangents=True)
        for bins in (BINS, 2 * BINS)
    )
    for wide, fine in ((once.torque, twice.torque), (once.derivative, twice.derivative), (once.linear, twice.linear)):
        means = fine.reshape(BINS, 2, -1).mean(axis=1)
        size = np.max(np.abs(means), axis=0) + 1e-30
        apart = np.sqrt(np.mean((wide.reshape(BINS, -1) - means) ** 2, axis=0)) / size
        assert np.median(apart) < 1e-3  # of what is faster than order 300
        assert np.max(apart) < 0.1


def test_bins_take_what_is_slow_as_its_mean_and_let_nothing_fast_through():
    each, bins = 3, 600
    theta = np.arange(each * bins) * (2.0 * np.pi / (each * bins))
    taps, restoring = bin_taps(each), bin_restoring(each, bins)
    assert np.sum(taps) == pytest.approx(1.0)

    def binned_signal(order, phase=0.3):
        fine = np.cos(order * theta + phase)[:, None]
        spectrum = np.fft.rfft(binned_by(fine, taps, bins)[:, 0]) * restoring
        return np.fft.irfft(spectrum, bins), fine.reshape(bins, each).mean(axis=1)

    for order in (1, 20, 115, 280):
        found, mean = binned_signal(order)
        np.testing.assert_allclose(found, mean, atol=1e-12)
    for order, most in ((485, 4e-3), (550, 4e-3), (715, 2e-3)):
        # as order 115, 50 and 115 of the bins; a mean alone lets 0.24, 0.09 and 0.16 of it through
        assert np.max(np.abs(binned_signal(order)[0])) < most
    assert np.array_equal(bin_taps(1), np.ones(1))
    np.testing.assert_allclose(bin_restoring(1, bins), 1.0)

"""Driveline and transducer against the time-stepping rig: cam angle and reading, both from the torque."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.laws import ROWS
from camtorque.laws.chain import cam_motion, drive_response, filtered
from camtorque.laws.driveline import COMPLIANCE_NAMES, angle_shifts, compliance, shaft_transfer, twist_basis
from camtorque.laws.sensor import (
    BESSEL,
    BUTTERWORTH,
    LEAST_DAMPING,
    MOST_DAMPING,
    STEEP,
    STEEPEST,
    low_pass,
    poles_of,
    sensor_transfer,
)
from camtorque.laws.swing import Swing
from camtorque.units import angle_grid
from laws_cases import chain_input, start_values
from rigs.cycles import as_cycles, nominal_times
from rigs.families import bare
from rigs.rig import simulate
from rigs.sense import trigger_edges
from rigs.truth import RigTruth, TorqueSensor, change
from scipy import signal

N = 3600
RPM = 900.0


def nominal(run, name):
    """Return a true history at the times that the trigger assigns to the angle grid, mean over cycles, (N,)."""
    times = nominal_times(run, N, trigger_edges(run, None))[1:-1]
    return np.interp(times, run.time, run.history[name]).mean(axis=0)


def driveline_values(truth):
    """Return the parameters of C(s) of a rig."""
    line = truth.driveline
    natural = 2.0 * np.pi * line.control_bandwidth_hz
    values = {name: ROWS[name].start for name in COMPLIANCE_NAMES}
    values.update(
        shaft_compliance=1.0 / line.shaft_stiffness, shaft_resonance=1.0e3,
        shaft_damping_ratio=0.5e3 * line.shaft_damping / line.shaft_stiffness,
        drive_admittance=1.0 / line.drive_inertia, drive_bandwidth=np.log(1.4 * natural),
        drive_reset=np.log(natural / 1.4), drive_lag=-11.0, coupling_compliance=0.0,
    )  # fmt: skip
    return values


def response(basis, values):
    return compliance(basis.omega, values, False)


@pytest.mark.parametrize("case", ["shaft", "drive", "soft", "fast loop"])
def test_cam_angle_is_the_rigs(case):
    changes = {
        "shaft": {"drive_inertia": np.inf},
        "drive": {"shaft_stiffness": np.inf, "drive_inertia": 0.4, "camshaft_inertia": 1e-6},
        "soft": {"shaft_stiffness": 2500.0, "drive_inertia": 0.15},
        "fast loop": {"control_bandwidth_hz": 12.0, "drive_inertia": 0.2},
    }[case]
    truth = change(bare(np.random.default_rng(2)), driveline=RigTruth().driveline)
    truth = change(truth, **{f"driveline__{name}": value for name, value in changes.items()})
    run = simulate(truth, RPM, n_cycles=12, step=1e-5, run_in=30)
    cycles = as_cycles(run, N, noise=False)
    found = (cycles["true_angle"] - cycles["theta"]).mean(axis=0)
    speed = float(cycles["speed"].mean())
    basis = twist_basis(nominal(run, "torque"), speed, truth.trigger.nominal_angle, 0)
    values = driveline_values(truth)
    shift, rate, _ = angle_shifts(basis, response(basis, values))
    assert np.ptp(found) > 2e-3  # a tenth of a degree
    # a linear drive seen at nominal instead of true angles: the square of the shift is left out
    assert np.max(np.abs(shift[:, 0] - found)) < 0.01 * np.ptp(found)
    assert np.max(np.abs(rate[:, 0] - np.gradient(shift[:, 0], 2 * np.pi / N))) < 1e-3 * np.max(np.abs(rate)) + 1e-5


@pytest.mark.parametrize("damping", [np.sqrt(0.5), 0.55])
def test_reading_is_the_rigs_torque_behind_the_low_pass(damping):
    truth = change(bare(np.random.default_rng(2)), torque_sensor=TorqueSensor(damping=damping, ripple=0.0, noise=0.0))
    run = simulate(truth, RPM, n_cycles=8, step=1e-5)
    cycles = as_cycles(run, N, noise=False)
    omega = np.arange(N // 2 + 1) * float(cycles["speed"].mean())
    # the rig's cut-off is -3 dB for Butterworth alone; its total delay is the declared one
    natural = truth.torque_sensor.cutoff_hz
    a = 1.0 - 2.0 * damping**2
    cutoff = natural * np.sqrt(a + np.sqrt(a * a + 1.0))
    true = nominal(run, "torque")
    stated = filtered(true, sensor_transfer(omega, cutoff, damping, 0.0)[0])
    reading = cycles["torque"].mean(axis=0)
    error = np.sqrt(np.mean((stated - reading) ** 2))
    assert error < 2e-3 * true.max()
    assert error < 0.2 * np.sqrt(np.mean((true - reading) ** 2))


def test_low_pass_has_its_cut_off_and_no_delay_at_low_frequency():
    for damping in (0.6, np.sqrt(0.5), 0.9):
        at_cutoff = sensor_transfer(np.array([2.0 * np.pi * 1000.0]), 1000.0, damping, 0.0)[0]
        assert abs(at_cutoff[0]) == pytest.approx(np.sqrt(0.5), rel=1e-12)
        slow = sensor_transfer(np.array([2.0 * np.pi * 5.0]), 1000.0, damping, 0.0)[0]
        assert abs(np.angle(slow[0])) < 1e-6
        late = sensor_transfer(np.array([2.0 * np.pi * 5.0]), 1000.0, damping, 1e-3)[0]
        assert np.angle(late[0]) == pytest.approx(-2.0 * np.pi * 5.0 * 1e-3, rel=1e-4)


@pytest.mark.parametrize("order", range(STEEP, STEEPEST + 1))
@pytest.mark.parametrize("kind", [BUTTERWORTH, BESSEL])
def test_a_steep_low_pass_is_that_of_scipy_without_its_delay(order, kind):
    design = signal.butter(order, 1.0, analog=True, output="zpk") if kind == BUTTERWORTH else signal.bessel(
        order, 1.0, analog=True, norm="mag", output="zpk")  # fmt: skip
    x = np.linspace(0.0, 4.0, 41)
    expected = signal.freqs_zpk(*design, worN=x)[1]
    slow = signal.freqs_zpk(*design, worN=[1e-4])[1][0]
    found = low_pass(2.0 * np.pi * 400.0 * x, order, 400.0, kind, 0.0)[0]
    assert found == pytest.approx(expected * np.exp(-1j * x * np.angle(slow) / 1e-4), abs=1e-6)


@pytest.mark.parametrize("order", range(STEEP, STEEPEST + 1))
def test_every_steep_low_pass_has_its_cut_off_and_is_stable(order):
    first, line, corner = poles_of(order)
    for damping in np.linspace(LEAST_DAMPING, MOST_DAMPING, 9):
        apart = damping - BUTTERWORTH
        assert np.max(((first + line * apart) * np.polyval(corner, apart)).real) < -0.1
        at_cutoff = low_pass(np.array([2.0 * np.pi * 400.0]), order, 400.0, damping, 0.0)[0]
        assert abs(at_cutoff[0]) == pytest.approx(np.sqrt(0.5), rel=0.01)


def test_shift_is_zero_at_the_trigger_edge():
    run = simulate(bare(np.random.default_rng(2)), RPM, n_cycles=2, step=1e-5)
    edge = np.radians(20.0)
    basis = twist_basis(run.true_cycles("torque", N)[0], 94.0, edge, 0)
    shift = angle_shifts(basis, response(basis, driveline_values(RigTruth())))[0]
    place = round(N * 20 / 360)
    assert angle_grid(N)[place] == pytest.approx(edge)
    np.testing.assert_allclose(shift[place], 0.0, atol=1e-12 * np.abs(shift).max())


def test_a_wheel_leaves_to_the_twist_what_is_above_its_orders():
    data = chain_input()
    turned = 0.004 * np.cos(3.0 * data.theta)
    wheel = replace(data, swing=Swing(turned, turned, 3))
    values = {**start_values(), "trigger_offset": 0.0}
    plain, seen = (cam_motion(one, values, drive_response(one, values)) for one in (data, wheel))
    # up to its third order the wheel says where the cam is at an even angle, above it the twist
    left, alone = (np.fft.rfft(motion.theta - data.theta) / data.theta.size for motion in (seen, plain))
    assert left[1:4] == pytest.approx([0.0, 0.0, 0.002], abs=1e-6)
    assert np.max(np.abs(alone[4:])) > 1e-6
    assert left[4:] == pytest.approx(alone[4:], abs=1e-12)
    rate = np.fft.rfft(seen.rate / data.speed) / data.theta.size
    assert rate[3] == pytest.approx(3j * left[3], rel=1e-9)


def test_a_coupling_half_before_the_transducer_is_that_of_the_equations_of_motion():
    omega = np.array([40.0, 300.0, 1500.0, 4000.0, 9000.0])
    values = {name: ROWS[name].start for name in COMPLIANCE_NAMES}
    values.update(half_inertia=0.8e-3, half_place=0.7, half_damping=0.8, shaft_compliance=120e-6, drive_admittance=3.0)
    total = compliance(omega, values, False)
    passed, _ = shaft_transfer(omega, values, total)
    values_of_drive = {**values, "shaft_compliance": 0.0}
    drive = compliance(omega, values_of_drive, False)[:, 0]
    inertia = 1.0 / (values["shaft_resonance"] ** 2 * values["shaft_compliance"])
    for k, w in enumerate(omega):
        s = 1j * w
        time = 2.0 * values["shaft_damping_ratio"] / values["shaft_resonance"]
        times = np.array([1.0, np.exp(0.8)]) / (0.3 + 0.7 * np.exp(0.8)) * time
        soft = values["shaft_compliance"] / (1.0 + times * s)
        # angles of half and cam, springs to the drive (which yields by itself) and between them, a load of 1 on the cam
        to_drive = 1.0 / (drive[k] + 0.3 * soft[0])
        between = 1.0 / (0.7 * soft[1])
        stiffness = np.array([[to_drive + between, -between], [-between, between]])
        mass = np.diag([values["half_inertia"], inertia])
        half, cam = np.linalg.solve(stiffness + s**2 * mass, [0.0, -1.0])
        felt = -to_drive * half
        assert passed[k] == pytest.approx(felt, rel=1e-9)
        assert -total[k, 0] * felt == pytest.approx(cam, rel=1e-9)

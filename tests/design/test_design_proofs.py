"""Tasks whose answer is known: found within 0.1 %."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.design.front import find_front
from camtorque.design.responses import RESPONSES
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.kinematics import kinematics
from camtorque.progress import silent
from design_cases import shaft, task_of
from scipy.optimize import minimize_scalar

LIFT_MM, RISE_DEG = 8.0, 60.0
RISE = np.deg2rad(RISE_DEG)


def best(task, name):
    """The chosen design of a task with one aim, and the value of a response."""
    front = find_front(task, silent)
    design = front.points[front.chosen].problem.evaluated(front.points[front.chosen].variables)
    return design, RESPONSES[name].value(design)


def lobe(degree, pieces):
    angles = f"rise_deg = {RISE_DEG}\nreturn_deg = {RISE_DEG}\ntop_dwell_deg = 10\nlift_mm = {LIFT_MM}"
    return f'[lift]\nlaw = "bspline"\ndegree = {degree}\npieces = {pieces}\n{angles}\n'


def test_least_peak_velocity_under_a_bound_on_acceleration(tmp_path):
    # accelerate for a fifth of the rise, run on, slow down: h = v (beta - tau) with tau = v / a
    velocity = LIFT_MM / (0.8 * RISE)
    limit = f"acceleration_mm_per_rad2 = {{ most = {velocity / (0.2 * RISE)} }}"
    task = task_of(tmp_path, lift=lobe(2, 10), aims='velocity_mm_per_rad = "least"', limits=limit,
                   more="[answer]\nstarts = 1")  # fmt: skip
    assert best(task, "velocity_mm_per_rad")[1] == pytest.approx(velocity, rel=1e-3)


def test_least_peak_acceleration_is_the_parabola(tmp_path):
    # half the rise with +a, half with -a: h = a (beta / 2)^2
    task = task_of(tmp_path, lift=lobe(2, 10), aims='acceleration_mm_per_rad2 = "least"', more="[answer]\nstarts = 1")
    assert best(task, "acceleration_mm_per_rad2")[1] == pytest.approx(4.0 * LIFT_MM / RISE**2, rel=1e-3)


def test_least_peak_acceleration_under_a_bound_on_jerk(tmp_path):
    # a tenth of the rise to build up the acceleration, four tenths of the way held: h = a (beta/2 - a/j) (beta/2)
    acceleration = LIFT_MM / (0.4 * 0.5 * RISE**2)
    limit = f"jerk_mm_per_rad3 = {{ most = {acceleration / (0.1 * RISE)} }}"
    task = task_of(tmp_path, lift=lobe(3, 10), aims='acceleration_mm_per_rad2 = "least"', limits=limit,
                   more="[answer]\nstarts = 1")  # fmt: skip
    assert best(task, "acceleration_mm_per_rad2")[1] == pytest.approx(acceleration, rel=1e-3)


def test_offset_of_least_pressure_angle(tmp_path):
    task = task_of(tmp_path, free="follower_offset_mm = [-10, 10]", aims='pressure_angle_deg = "least"')
    design, found = best(task, "pressure_angle_deg")
    theta = np.linspace(0.0, 2.5, 20001)
    law: CamLaw = design.lobe.law()

    def angle(offset):
        pump = task.config.pump.__class__(**{**vars(task.config.pump), "follower_offset": offset})
        return float(np.max(np.abs(kinematics(pump, law, theta).pressure_angle)))

    known = minimize_scalar(angle, bounds=(-0.01, 0.01), method="bounded", options={"xatol": 1e-9})
    assert found == pytest.approx(np.rad2deg(known.fun), rel=1e-3)
    assert design.design.values["follower_offset_mm"] == pytest.approx(1e3 * known.x, abs=5e-3)


def test_phase_of_two_pumps_of_least_ripple(tmp_path):
    task = task_of(tmp_path, pump=shaft(tmp_path, 2), free="phase_2_deg = [10, 350]",
                   aims='torque_ripple_nm = "least"', more="[answer]\nstarts = 6")  # fmt: skip
    _, found = best(task, "torque_ripple_nm")
    problem = find_front(task, silent).points[0].problem
    ripple = [RESPONSES["torque_ripple_nm"].value(problem.evaluated(np.array([x]))) for x in np.linspace(0, 1, 681)]
    assert found == pytest.approx(min(ripple), rel=1e-3)
    assert found < 0.9 * max(ripple)


@pytest.mark.parametrize("pumps", [3, 4])
def test_phases_of_equal_pumps_whose_torque_has_one_harmonic(tmp_path, pumps):
    # a torque of one wave over the turn vanishes in the sum of equally spaced pumps: only higher waves are left
    wide = '[lift]\nlaw = "simple_harmonic"\nrise_deg = 179\ntop_dwell_deg = 0.5\nreturn_deg = 179\n'
    dry = "[[load]]\nspeed_rpm = 100\npressure_bar = 0\nspills_mm = 4\n"
    free = "\n".join(f"phase_{k}_deg = [{360 * (k - 1) / pumps - 50}, {360 * (k - 1) / pumps + 50}]" for k in
                     range(2, pumps + 1))  # fmt: skip
    task = task_of(tmp_path, pump=shaft(tmp_path, pumps), lift=wide, free=free, load=dry,
                   aims='torque_ripple_nm = "least"', more="[answer]\nstarts = 2")  # fmt: skip
    _, found = best(task, "torque_ripple_nm")
    front = find_front(task, silent)
    equal = np.array([0.5] * (pumps - 1))
    assert found <= 1.001 * RESPONSES["torque_ripple_nm"].value(front.points[0].problem.evaluated(equal))

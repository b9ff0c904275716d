"""The cam angle inside a revolution, against a shaft whose motion follows from its energy."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from align_truth import TWO_PI, Rig, make, torque_of
from camtorque.align import align
from camtorque.align.budget import angle_correction
from scipy.interpolate import CubicSpline


@dataclass(frozen=True)
class DrivenShaft:
    """J omega^2 / 2 + work of the pump - work of a constant drive torque is constant: omega and t of theta."""

    inertia: float
    rpm: float = 500.0
    tables: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        theta = np.linspace(0.0, TWO_PI, 20001)
        excess = CubicSpline(theta, torque_of(theta))
        drive = excess.integrate(0.0, TWO_PI) / TWO_PI
        work = excess.antiderivative()(theta) - drive * theta
        energy = 0.5 * self.inertia * (self.rpm * TWO_PI / 60.0) ** 2
        speed = np.sqrt(2.0 * (energy - work) / self.inertia)
        time = CubicSpline(theta, 1.0 / speed).antiderivative()(theta)
        self.tables.update(period=time[-1], to_time=CubicSpline(theta, time), to_angle=CubicSpline(time, theta))
        self.tables["swing"] = np.ptp(speed) / speed.mean()

    @property
    def speed(self) -> float:
        return TWO_PI / self.tables["period"]

    def angle(self, t: np.ndarray) -> np.ndarray:
        turns = np.floor(t / self.tables["period"])
        return turns * TWO_PI + self.tables["to_angle"](t - turns * self.tables["period"])

    def time_of(self, angle: np.ndarray) -> np.ndarray:
        turns = np.floor(angle / TWO_PI)
        return turns * self.tables["period"] + self.tables["to_time"](angle - turns * TWO_PI)


def true_angle(shaft: DrivenShaft, theta: np.ndarray, trigger_angle: float) -> np.ndarray:
    """Cam angle at the instant that the nominal alignment calls theta."""
    instant = shaft.time_of(np.array([trigger_angle]))[0] + (theta - trigger_angle) / shaft.speed
    return shaft.angle(instant)


def rms_deg(values: np.ndarray) -> float:
    return float(np.degrees(np.sqrt(np.mean(values**2))))


@pytest.mark.parametrize(("inertia", "ripple_percent"), [(1.46, 1.0), (0.73, 2.0)])
def test_angle_inside_the_revolution_is_rebuilt_from_torque_and_inertia(inertia: float, ripple_percent: float) -> None:
    shaft = DrivenShaft(inertia)
    assert 100.0 * shaft.tables["swing"] == pytest.approx(ripple_percent, rel=0.05)
    cycles = align(make(Rig(shaft=shaft)))
    trigger_angle = np.radians(20.0)
    truth = true_angle(shaft, cycles.theta, trigger_angle)
    correction = angle_correction(cycles.torque.mean(axis=0), cycles.mean_speed, trigger_angle, inertia)
    once_per_revolution, rebuilt = rms_deg(cycles.theta - truth), rms_deg(cycles.theta + correction - truth)
    # The requirement is 0.05 degrees at 1 % ripple (peak to peak here); the error left is second order in the ripple.
    print(f"once per revolution {once_per_revolution:.4f} deg rms, rebuilt {rebuilt:.5f} deg rms")
    assert rebuilt < 0.05 * ripple_percent**2
    assert once_per_revolution > 5.0 * rebuilt


def test_torque_lands_at_its_true_angle_after_the_correction() -> None:
    shaft = DrivenShaft(0.73)
    cycles = align(make(Rig(shaft=shaft)))
    measured = cycles.torque.mean(axis=0)
    correction = angle_correction(measured, cycles.mean_speed, np.radians(20.0), 0.73)
    before = np.max(np.abs(measured - torque_of(cycles.theta)))
    after = np.max(np.abs(measured - torque_of(cycles.theta + correction)))
    # 0.01 degrees on the steepest flank (3 N m per degree).
    assert after < 0.03 < before


def test_correction_is_zero_at_the_trigger_between_grid_points() -> None:
    theta = np.arange(3600) * TWO_PI / 3600
    fine = angle_correction(torque_of(theta), 50.0, 0.35 + 0.3 * TWO_PI / 3600, 0.1)
    assert CubicSpline(theta, fine)(0.35 + 0.3 * TWO_PI / 3600) == pytest.approx(0.0, abs=1e-11)

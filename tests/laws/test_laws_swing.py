"""A cam that swings within a turn: from curves over cam angle to curves over time and back, by closed formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.prepare import at_cam_angles
from camtorque.laws.swing import Swing, swing_of
from camtorque.units import angle_grid
from laws_cases import chain_input

SIZE, ORDER = 0.02, 4
EVEN = angle_grid(1800)
CAM = EVEN + SIZE * np.sin(ORDER * EVEN)
"""Cam angle at even angles."""


def torque_of(cam: np.ndarray) -> np.ndarray:
    """Return a torque that acts over cam angle [N m]."""
    return 55.0 * np.exp(10.0 * (np.cos(cam - 0.7) - 1.0)) - 38.0 * np.exp(8.0 * (np.cos(cam - 2.15) - 1.0))


def swing(n: int = 3600) -> Swing:
    """Return the swing over cam angle, which is the root of the formula over even angle."""
    theta = angle_grid(n)
    even = theta.copy()
    for _ in range(60):
        even = theta - SIZE * np.sin(ORDER * even)
    return Swing(theta - even, theta - even, 20)


def test_a_curve_comes_to_even_angle_and_back():
    there = swing().evened(torque_of(angle_grid(3600)))
    assert there[::2] == pytest.approx(torque_of(CAM), abs=2e-4)
    back = at_cam_angles(chain_input(swing=swing()), there, 3600)
    assert back == pytest.approx(torque_of(angle_grid(3600)), abs=2e-3)
    assert np.max(np.abs(there[::2] - torque_of(EVEN))) > 1.0


def test_the_wheel_tells_the_cam_angle_with_its_rates():
    lead, rate, second = swing().told(1800)
    assert lead == pytest.approx(SIZE * np.sin(ORDER * EVEN), abs=1e-6)
    assert rate == pytest.approx(SIZE * ORDER * np.cos(ORDER * EVEN), abs=1e-5)
    assert second == pytest.approx(-SIZE * ORDER**2 * np.sin(ORDER * EVEN), abs=1e-3)
    lost, *_ = replace(swing(), order=ORDER - 1).told(1800)
    assert np.ptp(lost) < 1e-6


def test_few_teeth_leave_the_cam_to_the_torque():
    """Four to six teeth tell an order at most: a trigger was 2.8 degrees off by their mean, and sure of it."""
    theta = angle_grid(3600)
    for orders, order in ((1, 0), (2, 0), (3, 2), (28, 21)):
        waves = sum(np.cos(k * theta) for k in range(1, orders + 1)) * SIZE
        found = swing_of(waves + 0.01, waves)
        assert found.order == order
        assert (np.max(np.abs(found.told(1800))) > 0.0) == (order > 0)

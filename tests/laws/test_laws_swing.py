"""A cam that swings within a turn: from curves over cam angle to curves over time and back, by closed formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.prepare import at_cam_angles
from camtorque.laws.chain import evaluate
from camtorque.laws.swing import Swing, swing_of
from camtorque.laws.swing_error import swing_error_columns
from camtorque.units import angle_grid
from laws_cases import COEFFICIENTS, chain_input, start_values

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
        found = swing_of(waves + 0.01, waves, 30)
        assert found.order == order
        assert (np.max(np.abs(found.told(1800))) > 0.0) == (order > 0)


def with_errors(*orders: int) -> Swing:
    """Return the swing with two errors of 0.03 degrees for each of some orders, beyond what a wheel tells, too."""
    errors = np.zeros((2 * len(orders), 31), dtype=np.complex128)
    for k, order in enumerate(orders):
        errors[2 * k : 2 * k + 2, order] = np.deg2rad(0.03) * np.array([1.0, 1j])
    return replace(swing(), errors=errors)


def test_what_the_wheel_may_be_off_by_is_told_only_as_far_as_it_tells():
    found, size = replace(with_errors(3, 20, 21), lead=np.zeros(3600), waves=np.zeros(3600)), np.deg2rad(0.03)
    lead, rate, second = found.told_errors(1800)
    for row, order in ((0, 3), (2, 20)):
        np.testing.assert_allclose(lead[row], size * np.cos(order * EVEN), atol=1e-12)
        np.testing.assert_allclose(rate[row], -size * order * np.sin(order * EVEN), atol=1e-11)
        np.testing.assert_allclose(second[row], -size * order**2 * np.cos(order * EVEN), atol=1e-10)
    assert np.max(np.abs(lead[4:])) < 1e-15
    asked = np.array([0.0, 0.0, 0.0, 0.0, 1.0, -2.0])
    np.testing.assert_allclose(found.corrected(asked).told(1800), found.told(1800), atol=1e-9)
    asked[1] = 2.0
    moved = found.corrected(asked).told(1800)[0] - found.told(1800)[0]
    np.testing.assert_allclose(moved, 2.0 * lead[1], atol=2e-5)  # of second order in the errors
    assert found.corrected(np.zeros(6)) is found
    over_cam = with_errors(3).told_errors(1800)[0]
    np.testing.assert_allclose(over_cam[0], size * np.cos(3 * CAM), atol=1e-3 * size)


@pytest.mark.parametrize(("inside", "apart"), [(False, 0.03), (True, 0.03)])
def test_its_torque_is_what_the_chain_does_where_the_cam_is_elsewhere(inside: bool, apart: float):
    """As exact as the corrected waves over even angle are, whatever the chamber answers."""
    still = replace(with_errors(2, 9, 18), lead=np.zeros(3600), waves=np.zeros(3600))
    chain = chain_input(swing=still, uses_chamber=inside)
    coefficients, values = COEFFICIENTS, start_values()

    def torque(errors: np.ndarray) -> np.ndarray:
        output = evaluate(replace(chain, swing=still.corrected(errors)), values, coefficients)
        return output.torque + output.linear @ coefficients

    columns = swing_error_columns(chain, evaluate(chain, values), values, coefficients)
    assert columns.shape == (600, 6)
    for k, unit in enumerate(0.1 * np.eye(6)):
        moved = (torque(unit) - torque(-unit)) / 0.2
        assert np.linalg.norm(columns[:, k] - moved) < apart * np.linalg.norm(moved)
    assert np.max(np.abs(columns)) > 5e-3


def test_behind_one_pulse_nothing_is_off():
    chain = chain_input()
    assert swing_error_columns(chain, evaluate(chain, start_values()), start_values(), np.zeros(17)).shape == (600, 0)

"""Follower on a spring: torque on the cam against a mass that is stepped through time."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.laws.chain import filtered
from camtorque.laws.follower import DAMPING, passed_load
from camtorque.units import TURN, angle_grid
from scipy.integrate import solve_ivp
from scipy.special import expit

N, SPEED, MASS = 3600, 105.0, 0.21
THETA = angle_grid(N)
LIFT = 4e-3
"""Half the lift of a harmonic cam [m]."""


def gas_force(theta):
    """Return a load of 4 kN that rises over ten degrees and falls in half of one [N]."""
    degrees = np.degrees(np.mod(theta, TURN))
    return 4000.0 * expit((degrees - 50.0) / 2.0) * expit((110.0 - degrees) / 0.2)


def slope(theta):
    return LIFT * np.sin(theta)


def stepped(compliance):
    """Return the torque on the cam of a mass on a damped spring, turned until it repeats, (N,) [N m]."""
    stiffness = 1.0 / compliance
    damping = 2.0 * DAMPING * np.sqrt(stiffness * MASS)

    def contact(t, state):
        theta = SPEED * t
        return stiffness * (LIFT * (1.0 - np.cos(theta)) - state[0]) + damping * (slope(theta) * SPEED - state[1])

    def rate(t, state):
        return state[1], (contact(t, state) - gas_force(SPEED * t)) / MASS

    times = (THETA + TURN) / SPEED
    run = solve_ivp(rate, (0.0, times[-1]), (0.0, 0.0), "DOP853", times, rtol=1e-9, atol=1e-12)
    return contact(times, run.y) * slope(THETA)


@pytest.mark.parametrize("compliance", [2e-9, 5e-9, 12e-9])
def test_torque_is_that_of_a_mass_on_a_spring(compliance):
    rigid = (gas_force(THETA) + MASS * LIFT * np.cos(THETA) * SPEED**2) * slope(THETA)
    true = stepped(compliance)
    omega = np.arange(N // 2 + 1) * SPEED
    stated = filtered(rigid, passed_load(omega, MASS, compliance)[0])
    missed = np.sqrt(np.mean((rigid - true) ** 2))
    assert missed > 0.002 * rigid.max()
    # what is left is the lift's slope that changes while the mass rings: 4 degrees a swing
    assert np.sqrt(np.mean((stated - true) ** 2)) < 0.05 * missed


def test_a_rigid_follower_passes_the_load_as_it_is():
    passed, by = passed_load(np.arange(4.0) * 1e4, MASS, 0.0)
    assert np.all(passed == 1.0)
    assert by == pytest.approx(MASS * (np.arange(4.0) * 1e4) ** 2)

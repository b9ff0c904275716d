"""The pump on an elastic shaft as a user would integrate it: fixed steps in time, Gauss collocation in cam angle.

The drive end turns at Omega, theta is the cam's angle, delta = theta - Omega t its lead (negative where it lags)::

    J(theta) omega' + c_2(theta) omega^2 + c_0(theta) + c_1(theta) p(theta) = T,   T = -k delta - c (omega - Omega)

with the four rows of the closed form. In cam angle d delta/d theta = 1 - Omega/omega, d omega/d theta = omega'/omega.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from camtorque.compiled import njit
from camtorque.mechanism.collocation import solve_orbit
from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.periodic import lobe_rows
from camtorque.records import Array
from camtorque.studies.case import SPEED, knotted_law, study_pressure, study_pump
from camtorque.units import TURN

SCHEMES = ("explicit Euler", "symplectic Euler", "Heun", "RK4", "generalized-alpha 0.8", "generalized-alpha 1.0")
"""Fixed-step schemes, in the order of `march`."""


@dataclass(frozen=True)
class Shaft:
    """Stiffness [N m/rad], damping [N m s/rad] and drive speed [rad/s]."""

    stiffness: float = 4000.0
    damping: float = 0.5
    speed: float = SPEED


def load_rows(theta: Array) -> Array:
    """Return load at rest with pressure [N m], factor of omega^2 and inertia J, (3, n)."""
    return lobe_rows(PumpUnit(study_pump(), knotted_law()), study_pressure, theta)


TABLE, TURNS = 36000, 5


@njit(cache=True)
def _load(table, theta):  # type: ignore[no-untyped-def]
    """Cubic through four points of the 0.01 degree table: error below 1e-9 of the load."""
    n = table.shape[1]
    x = theta / TURN
    x = (x - np.floor(x)) * n
    i = int(x)
    f = x - i
    g, m, p = 1.0 - f, f + 1.0, 2.0 - f
    wa, wb, wc, wd = -f * g * p / 6.0, m * p * g / 2.0, m * p * f / 2.0, -f * g * m / 6.0
    a, b, c, d = (i - 1) % n, i % n, (i + 1) % n, (i + 2) % n
    rest = wa * table[0, a] + wb * table[0, b] + wc * table[0, c] + wd * table[0, d]
    square = wa * table[1, a] + wb * table[1, b] + wc * table[1, c] + wd * table[1, d]
    inertia = wa * table[2, a] + wb * table[2, b] + wc * table[2, c] + wd * table[2, d]
    return rest, square, inertia


@njit(cache=True)
def acceleration(table, shaft, time, lead, rate):  # type: ignore[no-untyped-def]
    """Second derivative of the lead at a time."""
    stiffness, damping, speed = shaft
    rest, square, inertia = _load(table, speed * time + lead)
    omega = speed + rate
    return (-stiffness * lead - damping * rate - rest - square * omega * omega) / inertia


@njit(cache=True)
def alpha_coefficients(rho):  # type: ignore[no-untyped-def]
    """Return alpha_m, alpha_f, beta, gamma of generalized-alpha (Chung & Hulbert 1993)."""
    mass, force = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 + force - mass
    return mass, force, 0.25 * (gamma + 0.5) ** 2, gamma


@njit(cache=True)
def _alpha_step(table, shaft, time, h, lead, rate, change, auxiliary, rho):  # type: ignore[no-untyped-def]
    """One step of generalized-alpha (Chung & Hulbert 1993; Arnold & Bruls 2007), Newton by the linear stiffness."""
    am, af, beta, gamma = alpha_coefficients(rho)
    new, settled, count = change, False, 0
    while True:
        aux = ((1.0 - af) * new + af * change - am * auxiliary) / (1.0 - am)
        q = lead + h * rate + h * h * ((0.5 - beta) * auxiliary + beta * aux)
        v = rate + h * ((1.0 - gamma) * auxiliary + gamma * aux)
        if settled or count == 40:
            return q, v, new, aux
        _, _, inertia = _load(table, shaft[2] * (time + h) + q)
        residual = new - acceleration(table, shaft, time + h, q, v)
        scale = (1.0 - af) / (1.0 - am)
        slope = 1.0 + (shaft[0] * beta * h * h + shaft[1] * gamma * h) * scale / inertia
        new -= residual / slope
        settled, count = abs(residual) <= 1e-10 * (1.0 + abs(new)), count + 1


@njit(cache=True)
def march(table, shaft, scheme, steps, kept):  # type: ignore[no-untyped-def]
    """Integrate `TURNS` of ``steps`` steps from rest; ``kept`` (steps, 2) gets the last; False when it runs away."""
    h, lead, rate = TURN / shaft[2] / steps, 0.0, 0.0
    change = acceleration(table, shaft, 0.0, lead, rate)
    auxiliary = change
    for n in range(TURNS * steps):
        t, place = n * h, n - (TURNS - 1) * steps
        if place >= 0:
            kept[place, 0], kept[place, 1] = lead, rate
        a = acceleration(table, shaft, t, lead, rate)
        if scheme == 0:
            lead, rate = lead + h * rate, rate + h * a
        elif scheme == 1:
            rate = rate + h * a
            lead = lead + h * rate
        elif scheme == 2:
            q, v = lead + h * rate, rate + h * a
            b = acceleration(table, shaft, t + h, q, v)
            lead, rate = lead + 0.5 * h * (rate + v), rate + 0.5 * h * (a + b)
        elif scheme == 3:
            v2 = rate + 0.5 * h * a
            a2 = acceleration(table, shaft, t + 0.5 * h, lead + 0.5 * h * rate, v2)
            v3 = rate + 0.5 * h * a2
            a3 = acceleration(table, shaft, t + 0.5 * h, lead + 0.5 * h * v2, v3)
            v4 = rate + h * a3
            a4 = acceleration(table, shaft, t + h, lead + h * v3, v4)
            lead, rate = lead + h * (rate + 2 * v2 + 2 * v3 + v4) / 6.0, rate + h * (a + 2 * a2 + 2 * a3 + a4) / 6.0
        else:
            rho = 0.8 if scheme == 4 else 1.0
            lead, rate, change, auxiliary = _alpha_step(table, shaft, t, h, lead, rate, change, auxiliary, rho)
        if not abs(lead) < 10.0 or not abs(rate) < 100.0 * shaft[2]:
            return False
    return True


def march_periodic(table: Array, shaft: Shaft, scheme: str, steps: int) -> tuple[Array, Array, bool]:
    """Return cam angle (steps,), shaft torque (steps,) of the fifth turn from rest, and whether it stayed bounded."""
    kept = np.empty((steps, 2))
    vector = (shaft.stiffness, shaft.damping, shaft.speed)
    bounded = bool(march(table, vector, SCHEMES.index(scheme), steps, kept))
    lead, rate = kept.T
    return np.arange(steps) * (TURN / steps) + lead, -shaft.stiffness * lead - shaft.damping * rate, bounded


def collocation(shaft: Shaft, elements: int, stages: int) -> tuple[Array, Array, bool]:
    """Return stage angles, shaft torque there and success of the periodic solution by Gauss collocation in cam angle.

    Elements on the pieces of the law when their number is a multiple of 360; Newton on the state at the border of the
    revolution closes the period.
    """
    borders = np.linspace(0.0, TURN, elements + 1)
    orbit = solve_orbit(load_rows, borders, stages, (shaft.stiffness, shaft.damping, shaft.speed))
    return orbit.theta, orbit.torque, orbit.closed


def alpha_accelerations(lift: Array, h: float, turns: int, rho: float, start: tuple[float, float]) -> Array:
    """Return the follower's acceleration over the last turn by generalized-alpha on the cut joint, index 3.

    The joint is kept in position, ``y_(n+1) = Y(theta_(n+1))``, at every step; velocity, auxiliary and true
    acceleration, and with it the multiplier, follow from the recursion (Arnold & Bruls 2007, Section 3).

    Parameters
    ----------
    lift : (n,) Y over one turn of even steps, starting at 0 [m]
    h : step [s]
    start : velocity and acceleration at the first step [m/s, m/s^2]
    """
    mass, force, beta, gamma = alpha_coefficients(rho)
    velocity, change = start
    auxiliary, found = change, np.empty(lift.size)
    for n in range(turns * lift.size):
        found[n % lift.size] = change
        step = lift[(n + 1) % lift.size] - lift[n % lift.size]
        aux = ((step - h * velocity) / h**2 - (0.5 - beta) * auxiliary) / beta
        change = ((1.0 - mass) * aux + mass * auxiliary - force * change) / (1.0 - force)
        velocity += h * ((1.0 - gamma) * auxiliary + gamma * aux)
        auxiliary = aux
    return found


def rhs(table: Array, shaft: Shaft) -> Callable[[float, Array], list[float]]:
    """Return the right-hand side in time for scipy's integrators, state (lead, rate)."""
    vector = (shaft.stiffness, shaft.damping, shaft.speed)
    return lambda t, state: [state[1], acceleration(table, vector, t, state[0], state[1])]

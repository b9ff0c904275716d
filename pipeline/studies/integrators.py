"""The pump on an elastic shaft as a user would integrate it: fixed steps in time, Gauss collocation in cam angle.

The drive end turns at Omega, theta is the cam's angle, delta = theta - Omega t its lead (negative where it lags)::

    J(theta) omega' + c_2(theta) omega^2 + c_0(theta) + c_1(theta) p(theta) = T,   T = -k delta - c (omega - Omega)

with the four rows of the closed form. In cam angle d delta/d theta = 1 - Omega/omega, d omega/d theta = omega'/omega.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from pipeline.mechanism import closed_form_tables
from pipeline.records import Array
from pipeline.studies.case import SPEED, knotted_law, study_pressure, study_pump

TURN = 2.0 * np.pi
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
    table = closed_form_tables(study_pump(), knotted_law(), theta).outputs["torque"]
    return np.stack([table[0] + table[1] * study_pressure(theta), table[2], table[3]])


TABLE = 36000


@njit(cache=True)
def _load(table, theta):  # type: ignore[no-untyped-def]
    """Cubic through four points of the 0.01 degree table: error below 1e-9 of the load."""
    n = table.shape[1]
    x = theta / 6.283185307179586
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
def _alpha_step(table, shaft, time, h, lead, rate, change, auxiliary, rho):  # type: ignore[no-untyped-def]
    """One step of generalized-alpha (Chung & Hulbert 1993; Arnold & Bruls 2007), Newton by the linear stiffness."""
    am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 + af - am
    beta = 0.25 * (gamma + 0.5) ** 2
    new = change
    for _ in range(40):
        aux = ((1.0 - af) * new + af * change - am * auxiliary) / (1.0 - am)
        q = lead + h * rate + h * h * ((0.5 - beta) * auxiliary + beta * aux)
        v = rate + h * ((1.0 - gamma) * auxiliary + gamma * aux)
        _, _, inertia = _load(table, shaft[2] * (time + h) + q)
        residual = new - acceleration(table, shaft, time + h, q, v)
        scale = (1.0 - af) / (1.0 - am)
        slope = 1.0 + (shaft[0] * beta * h * h + shaft[1] * gamma * h) * scale / inertia
        new -= residual / slope
        if abs(residual) <= 1e-10 * (1.0 + abs(new)):
            break
    aux = ((1.0 - af) * new + af * change - am * auxiliary) / (1.0 - am)
    q = lead + h * rate + h * h * ((0.5 - beta) * auxiliary + beta * aux)
    v = rate + h * ((1.0 - gamma) * auxiliary + gamma * aux)
    return q, v, new, aux


@njit(cache=True)
def march(table, shaft, scheme, steps, turns, lead, rate, kept):  # type: ignore[no-untyped-def]
    """Integrate turns of ``steps`` steps; ``kept`` (steps, 2) gets the last; False when it runs away."""
    h = 6.283185307179586 / shaft[2] / steps
    change = acceleration(table, shaft, 0.0, lead, rate)
    auxiliary = change
    limit = 10.0
    for n in range(turns * steps):
        t = n * h
        if n >= (turns - 1) * steps:
            kept[n - (turns - 1) * steps, 0], kept[n - (turns - 1) * steps, 1] = lead, rate
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
        if not abs(lead) < limit or not abs(rate) < 100.0 * shaft[2]:
            return False
    return True


def march_periodic(table: Array, shaft: Shaft, scheme: str, steps: int, turns: int = 5) -> tuple[Array, Array, bool]:
    """Return cam angle (steps,), shaft torque (steps,) of the last turn from rest, and whether it stayed bounded."""
    kept = np.empty((steps, 2))
    vector = (shaft.stiffness, shaft.damping, shaft.speed)
    bounded = bool(march(table, vector, SCHEMES.index(scheme), steps, turns, 0.0, 0.0, kept))
    lead, rate = kept.T
    return np.arange(steps) * (TURN / steps) + lead, -shaft.stiffness * lead - shaft.damping * rate, bounded


def gauss(stages: int) -> tuple[Array, Array, Array]:
    """Return nodes (s,), weights (s,) and matrix (s, s) of Gauss collocation on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(stages)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    powers = np.vander(nodes, stages, increasing=True)
    integrals = powers * nodes[:, None] / np.arange(1, stages + 1)
    return nodes, weights, integrals @ np.linalg.inv(powers)


@njit(cache=True)
def _sweep(rows, widths, weights, matrix, shaft, lead, rate, stage_torque, transition, transition_end):  # type: ignore[no-untyped-def]
    """Solve the elements one after the other from (lead, rate); fills the torque at stages and d(end)/d(start)."""
    stiffness, damping, speed = shaft
    n_elements, s = widths.size, weights.size
    u = np.array([lead, rate])
    transition[:] = np.eye(2)
    z = np.zeros((s, 2))
    f = np.zeros((s, 2))
    jac = np.zeros((s, 2, 2))
    big = np.zeros((2 * s, 2 * s))
    right = np.zeros((2 * s, 1))
    for e in range(n_elements):
        h = widths[e]
        for j in range(s):
            z[j, 0], z[j, 1] = u[0], u[1]
        for _ in range(30):
            for j in range(s):
                omega = speed + z[j, 1]
                if omega < 1e-3 * speed:
                    return False
                rest, square, inertia = rows[0, e * s + j], rows[1, e * s + j], rows[2, e * s + j]
                push = -stiffness * z[j, 0] - damping * z[j, 1] - rest
                f[j, 0] = 1.0 - speed / omega
                f[j, 1] = (push / omega - square * omega) / inertia
                jac[j, 0, 0], jac[j, 0, 1] = 0.0, speed / (omega * omega)
                jac[j, 1, 0] = -stiffness / omega / inertia
                jac[j, 1, 1] = (-damping / omega - push / (omega * omega) - square) / inertia
            size = 0.0
            for i in range(s):
                for a in range(2):
                    value = z[i, a] - u[a]
                    for j in range(s):
                        value -= h * matrix[i, j] * f[j, a]
                        for b in range(2):
                            big[2 * i + a, 2 * j + b] = -h * matrix[i, j] * jac[j, a, b]
                    big[2 * i + a, 2 * i + a] += 1.0
                    right[2 * i + a, 0] = value
                    size = max(size, abs(value) * (stiffness if a == 0 else damping + 1e-3))
            step = np.linalg.solve(big, right)
            for i in range(s):
                for a in range(2):
                    z[i, a] -= step[2 * i + a, 0]
            if size < 1e-11:
                break
        both = np.zeros((2 * s, 2))
        for i in range(s):
            both[2 * i, 0], both[2 * i + 1, 1] = 1.0, 1.0
        tangent = np.linalg.solve(big, both)
        local = np.eye(2)
        for j in range(s):
            stage_torque[e * s + j] = -stiffness * z[j, 0] - damping * z[j, 1]
            u = u + h * weights[j] * f[j]
            local = local + h * weights[j] * (jac[j] @ np.ascontiguousarray(tangent[2 * j : 2 * j + 2]))
        transition[:] = local @ transition
    transition_end[0], transition_end[1] = u[0], u[1]
    return True


def collocation(shaft: Shaft, elements: int, stages: int, offset: float = 0.0) -> tuple[Array, Array, bool]:
    """Return stage angles, shaft torque there and success of the periodic solution by Gauss collocation in cam angle.

    Elements on the pieces of the law when their number is a multiple of 360 and ``offset`` is 0; Newton on the state
    at the border of the revolution closes the period.
    """
    nodes, weights, matrix = gauss(stages)
    borders = np.linspace(0.0, TURN, elements + 1) + offset
    theta = (borders[:-1, None] + nodes * np.diff(borders)[:, None]).ravel()
    rows = load_rows(theta)
    return _closed_orbit(rows, np.diff(borders), (weights, matrix), shaft, theta)


def _closed_orbit(
    rows: Array, widths: Array, rule: tuple[Array, Array], shaft: Shaft, theta: Array
) -> tuple[Array, Array, bool]:
    vector, start = (shaft.stiffness, shaft.damping, shaft.speed), np.zeros(2)
    torque, transition, end = np.empty(theta.size), np.empty((2, 2)), np.empty(2)
    for _ in range(20):
        if not _sweep(rows, widths, *rule, vector, start[0], start[1], torque, transition, end):
            return theta, torque, False
        gap = end - start
        start = start + np.linalg.solve(np.eye(2) - transition, gap)
        if abs(gap[0]) * shaft.stiffness + abs(gap[1]) * shaft.damping < 1e-10:
            return theta, torque, True
    return theta, torque, False


def rhs(table: Array, shaft: Shaft) -> Callable[[float, Array], list[float]]:
    """Return the right-hand side in time for scipy's integrators, state (lead, rate)."""
    vector = (shaft.stiffness, shaft.damping, shaft.speed)
    return lambda t, state: [state[1], acceleration(table, vector, t, state[0], state[1])]

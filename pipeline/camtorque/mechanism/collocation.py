"""Periodic motion of one lobe behind an elastic shaft by Gauss collocation in cam angle.

The drive end turns at Omega, delta is the cam's lead over it::

    J(theta) omega' + c(theta) omega^2 + tau(theta) = T,   T = -k delta - d (omega - Omega)

In cam angle d delta/d theta = 1 - Omega/omega and d omega/d theta = omega'/omega. With elements on the knots of the
lift law the solution is smooth inside each, and the order is twice the number of stages (Hairer & Wanner II, Section
IV.5); Newton's method on the state at the border of the revolution closes the period. The cam has to turn forward.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from camtorque.compiled import njit
from camtorque.records import Array

CLOSED = 1.0e-10
"""Torque by which the two ends of the revolution may differ [N m]."""
ROUNDS = 20


@dataclass(frozen=True)
class Orbit:
    """Periodic motion at the stages, cam angle increasing over one revolution.

    Attributes
    ----------
    theta : (n,) cam angle [rad]
    lead, rate : (n,) of the cam over the drive [rad, rad/s]
    acceleration : (n,) of the cam [rad/s^2]
    torque : (n,) in the shaft [N m]
    closed : False where the cam came to a stand or the period did not close
    """

    theta: Array
    lead: Array
    rate: Array
    acceleration: Array
    torque: Array
    closed: bool


def gauss(stages: int) -> tuple[Array, Array, Array]:
    """Return nodes (s,), weights (s,) and matrix (s, s) of Gauss collocation on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(stages)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    powers = np.vander(nodes, stages, increasing=True)
    integrals = powers * nodes[:, None] / np.arange(1, stages + 1)
    return nodes, weights, integrals @ np.linalg.inv(powers)


@njit(cache=True)
def _rates(rows, first, shaft, z, f, jac):  # type: ignore[no-untyped-def]
    """Fill the slope f (s, 2) of the state z at the stages of an element and its derivative; tell whether it turns."""
    stiffness, damping, speed = shaft
    for j in range(len(z)):
        omega = speed + z[j, 1]
        if omega < 1e-3 * speed:
            return False
        rest, square, inertia = rows[0, first + j], rows[1, first + j], rows[2, first + j]
        push = -stiffness * z[j, 0] - damping * z[j, 1] - rest
        f[j, 0] = 1.0 - speed / omega
        f[j, 1] = (push / omega - square * omega) / inertia
        jac[j, 0, 0], jac[j, 0, 1] = 0.0, speed / (omega * omega)
        jac[j, 1, 0] = -stiffness / omega / inertia
        jac[j, 1, 1] = (-damping / omega - push / (omega * omega) - square) / inertia
    return True


@njit(cache=True)
def _equations(u, z, f, jac, steps, shaft, big, right):  # type: ignore[no-untyped-def]
    """Fill the equations of a Newton step of an element from u, ``steps`` (s, s) [rad]; return what is left [N m]."""
    left, s = 0.0, len(z)
    for i in range(s):
        for a in range(2):
            value = z[i, a] - u[a]
            for j in range(s):
                value -= steps[i, j] * f[j, a]
                for b in range(2):
                    big[2 * i + a, 2 * j + b] = -steps[i, j] * jac[j, a, b]
            big[2 * i + a, 2 * i + a] += 1.0
            right[2 * i + a, 0] = value
            left = max(left, abs(value) * (shaft[0] if a == 0 else shaft[1] + 1e-3))
    return left


@njit(cache=True)
def _sweep(rows, widths, weights, matrix, shaft, start, stage_state):  # type: ignore[no-untyped-def]
    """Solve the elements from ``start``, fill the state at the stages; return if it turns, the end, d(end)/d(start)."""
    s = weights.size
    u, transition = start, np.eye(2)
    z, f, jac = np.zeros((s, 2)), np.zeros((s, 2)), np.zeros((s, 2, 2))
    big, right, both = np.zeros((2 * s, 2 * s)), np.zeros((2 * s, 1)), np.zeros((2 * s, 2))
    both[0::2, 0] = 1.0
    both[1::2, 1] = 1.0
    for e in range(widths.size):
        h = widths[e]
        steps = h * matrix
        z[:] = u
        for _ in range(30):
            if not _rates(rows, e * s, shaft, z, f, jac):
                return False, u, transition
            left = _equations(u, z, f, jac, steps, shaft, big, right)
            step = np.linalg.solve(big, right)
            for j in range(s):
                z[j] -= step[2 * j : 2 * j + 2, 0]
            if left < 1e-11:
                break
        tangent = np.linalg.solve(big, both)
        local = np.eye(2)
        for j in range(s):
            stage_state[0, e * s + j], stage_state[1, e * s + j] = z[j, 0], z[j, 1]
            u = u + h * weights[j] * f[j]
            local = local + h * weights[j] * (jac[j] @ np.ascontiguousarray(tangent[2 * j : 2 * j + 2]))
        transition = local @ transition
    return True, u, transition


def solve_orbit(
    load: Callable[[Array], Array], borders: Array, stages: int, shaft: tuple[float, float, float]
) -> Orbit:
    """Return the periodic motion.

    Parameters
    ----------
    load : cam angles (n,) -> (3, n): torque at rest [N m], factor of the square of the speed, inertia [kg m^2]
    borders : of the elements, over one revolution [rad]
    stages : per element
    shaft : stiffness [N m/rad], damping [N m s/rad], speed of the drive [rad/s]
    """
    nodes, weights, matrix = gauss(stages)
    widths = np.diff(borders)
    theta = (borders[:-1, None] + nodes * widths[:, None]).ravel()
    rows = np.ascontiguousarray(load(theta))
    start, state, closed = np.zeros(2), np.zeros((2, theta.size)), False
    for _ in range(ROUNDS):
        turns, end, transition = _sweep(rows, widths, weights, matrix, shaft, start, state)
        if not turns:
            break
        gap = end - start
        if abs(gap[0]) * shaft[0] + abs(gap[1]) * shaft[1] < CLOSED:
            closed = True
            break
        start = start + np.linalg.solve(np.eye(2) - transition, gap)
    lead, rate = state
    torque = -shaft[0] * lead - shaft[1] * rate
    acceleration = (torque - rows[0] - rows[1] * (shaft[2] + rate) ** 2) / rows[2]
    return Orbit(theta, lead, rate, acceleration, torque, closed)

"""Periodic motion of lobes on an elastic shaft by Gauss collocation and Newton's method.

A lobe alone is solved in cam angle. The drive end turns at Omega, delta is the cam's lead over it::

    J(theta) omega' + c(theta) omega^2 + tau(theta) = T,   T = -k delta - d (omega - Omega)

In cam angle d delta/d theta = 1 - Omega/omega and d omega/d theta = omega'/omega. With elements on the knots of the
lift law the solution is smooth inside each, and the order is twice the number of stages (Hairer & Wanner II, Section
IV.5); Newton's method on the state at the border of the revolution closes the period. The cam has to turn forward.

Several lobes are solved in drive angle phi = Omega t. With the lead delta_i of lobe i over the drive end and its rate
v_i::

    delta_i' = v_i / Omega,   v_i' = alpha_i / Omega
    J_i(theta_i) alpha_i + tau_i(theta_i, Omega + v_i) = T_i - T_(i+1)

Newton's method works on all stages at once: each element is condensed to a transition from its start to its end, and
the transitions are closed over the revolution. It needs no damping and does not mind a resonance among the harmonics,
where the steps of `elastic` from load to twist run away.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from camtorque.compiled import njit
from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.torque import ClosedForm, closed_form_tables
from camtorque.records import Array
from camtorque.units import TURN, angle_grid, closed

ALONE_CLOSED, ALONE_ROUNDS = 1.0e-10, 20
"""Torque by which the two ends of the revolution of a lobe alone may differ [N m], and Newton steps at most."""
ELEMENTS, STAGES = 720, 4
ROUNDS = 25
CLOSED = 1.0e-11
"""Newton step over the greatest twist at which the motion is found."""
STEP = 1.0e-6
"""Of the central differences of the tables over cam angle [rad]."""
LONGEST = 0.2
"""Longest step of a twist [rad]: beyond it the tables of a cam are another cam's."""


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
    for _ in range(ALONE_ROUNDS):
        turns, end, transition = _sweep(rows, widths, weights, matrix, shaft, start, state)
        if not turns:
            break
        gap = end - start
        if abs(gap[0]) * shaft[0] + abs(gap[1]) * shaft[1] < ALONE_CLOSED:
            closed = True
            break
        start = start + np.linalg.solve(np.eye(2) - transition, gap)
    lead, rate = state
    torque = -shaft[0] * lead - shaft[1] * rate
    acceleration = (torque - rows[0] - rows[1] * (shaft[2] + rate) ** 2) / rows[2]
    return Orbit(theta, lead, rate, acceleration, torque, closed)


def periodic_curve(values: Array) -> CubicSpline:
    """Return a periodic interpolant of values at `angle_grid`."""
    return CubicSpline(*closed(angle_grid(values.size), values), bc_type="periodic")


@dataclass(frozen=True)
class Shaft:
    """Lobes on one shaft, drive end first.

    Attributes
    ----------
    units : pump of each
    load : (n_pumps, n) pressure on each plunger over the angle of its own shaft piece, at `angle_grid` [Pa]
    speed : of the drive [rad/s]
    stiffness, damping : (n_pumps,) of the shaft piece before each lobe [N m/rad, N m s/rad]
    """

    units: Sequence[PumpUnit]
    load: Array
    speed: float
    stiffness: Array
    damping: Array

    @cached_property
    def curves(self) -> list[CubicSpline]:
        """The pressures between the points of the grid."""
        return [periodic_curve(row) for row in self.load]


def solve_periodic(shaft: Shaft) -> Array | None:
    """Return the twist of every lobe at uniform drive angles, (n_pumps, n).

    None where Newton's method does not settle, or a cam would turn back.
    """
    nodes, weights, matrix = gauss(STAGES)
    width, count = TURN / ELEMENTS, len(shaft.units)
    angle = (width * (np.arange(ELEMENTS)[:, None] + nodes)).ravel()
    state = np.zeros((ELEMENTS, STAGES, 2 * count))
    start = np.zeros((ELEMENTS, 2 * count))
    for _ in range(ROUNDS):
        rate, slope = _motion(shaft, angle, state)
        steps = _newton_step(start, state, rate, slope, (width * matrix, width * weights))
        longest = float(np.max(np.abs(steps[1][..., :count])))
        share = min(1.0, LONGEST / max(longest, 1e-300))
        start, state = start + share * steps[0], state + share * steps[1]
        if not np.all(np.isfinite(state)) or np.min(state[..., count:]) <= -shaft.speed:
            return None
        if longest <= CLOSED * np.max(np.abs(state[..., :count])):
            return _on_grid(start, _motion(shaft, angle, state)[0], nodes, width, shaft.load.shape[1])[:, :count].T
    return None


def _motion(shaft: Shaft, angle: Array, state: Array) -> tuple[Array, Array]:
    """Return the derivative of the state (e, s, 2n) over the drive angle, and its Jacobian (e, s, 2n, 2n)."""
    count, speed = len(shaft.units), shaft.speed
    flat = state.reshape(-1, 2 * count)
    lead, swing = flat[:, :count], flat[:, count:]
    # T_i = k_i (delta_(i-1) - delta_i) + d_i (v_(i-1) - v_i); lobe i gets T_i - T_(i+1)
    coupling = [_chain(values) for values in (shaft.stiffness, shaft.damping)]
    net = lead @ coupling[0].T + swing @ coupling[1].T
    rate, slope = np.empty_like(flat), np.zeros((flat.shape[0], 2 * count, 2 * count))
    rate[:, :count] = swing / speed
    slope[:, :count, count:] = np.eye(count) / speed
    for i, (unit, curve) in enumerate(zip(shaft.units, shaft.curves, strict=True)):
        omega = speed + swing[:, i]
        rest, square, inertia = lobe_rows(unit, curve, angle + lead[:, i])
        above, below = (lobe_rows(unit, curve, angle + lead[:, i] + step) for step in (STEP, -STEP))
        by_angle = (above - below) / (2.0 * STEP)
        alpha = (net[:, i] - rest - square * omega**2) / inertia
        rate[:, count + i] = alpha / speed
        row = slope[:, count + i]
        row[:, :count] = coupling[0][i] / inertia[:, None] / speed
        row[:, count:] = coupling[1][i] / inertia[:, None] / speed
        row[:, i] -= (by_angle[0] + by_angle[1] * omega**2 + alpha * by_angle[2]) / inertia / speed
        row[:, count + i] -= 2.0 * square * omega / inertia / speed
    return rate.reshape(state.shape), slope.reshape(*state.shape, 2 * count)


def _chain(values: Array) -> Array:
    """Return the matrix from leads to the net torque of each lobe."""
    matrix = -np.diag(values + np.append(values[1:], 0.0))
    matrix += np.diag(values[1:], 1) + np.diag(values[1:], -1)
    return matrix


def lobe_tables(unit: PumpUnit, theta: Array) -> ClosedForm:
    """Return the closed form of a lobe at angles of its shaft piece."""
    return closed_form_tables(unit.pump, unit.law, theta - unit.phase, unit.mounting, unit.friction)


def lobe_rows(unit: PumpUnit, curve: CubicSpline, theta: Array) -> Array:
    """Return torque at rest, factor of the square of the speed and inertia of a lobe, (3, m)."""
    table = lobe_tables(unit, theta).outputs["torque"]
    return np.stack([table[0] + table[1] * curve(np.mod(theta, TURN)), table[2], table[3]])


def _newton_step(start: Array, state: Array, rate: Array, slope: Array, rule: tuple[Array, Array]
                 ) -> tuple[Array, Array]:  # fmt: skip
    """Return the steps of element starts (e, m) and stages (e, s, m)."""
    matrix, weights = rule
    elements, stages, size = state.shape
    # (I - h A x J) dz = du - residual
    big = -np.einsum("ij,ejab->eiajb", matrix, slope).reshape(elements, stages * size, stages * size)
    big += np.eye(stages * size)
    missed = state - start[:, None] - np.einsum("ij,eja->eia", matrix, rate)
    right = np.concatenate([np.tile(np.eye(size), (elements, stages, 1)), -missed.reshape(elements, -1, 1)], axis=2)
    solved = np.linalg.solve(big, right).reshape(elements, stages, size, size + 1)
    # to the end of the element: u + h sum b f
    moved = np.einsum("j,ejab,ejbc->eac", weights, slope, solved)
    transition = np.eye(size) + moved[..., :size]
    end = start + np.einsum("j,eja->ea", weights, rate)
    offset = moved[..., size] + end - np.roll(start, -1, axis=0)
    begins = _closed(transition, offset)
    return begins, np.einsum("ejab,eb->eja", solved[..., :size], begins) + solved[..., size]


def _closed(transition: Array, offset: Array) -> Array:
    """Return the periodic solution of x_(e+1) = T_e x_e + c_e, (e, m)."""
    size = offset.shape[1]
    whole, sent = np.eye(size), np.zeros(size)
    for matrix, shift in zip(transition, offset, strict=True):
        whole, sent = matrix @ whole, matrix @ sent + shift
    found = np.empty_like(offset)
    found[0] = np.linalg.solve(np.eye(size) - whole, sent)
    for e in range(1, offset.shape[0]):
        found[e] = transition[e - 1] @ found[e - 1] + offset[e - 1]
    return found


def _on_grid(start: Array, rate: Array, nodes: Array, width: float, size: int) -> Array:
    """Return the state at uniform drive angles from the polynomial of each element, (size, m)."""
    place = np.arange(size) * (ELEMENTS / size)
    element = np.minimum(place.astype(np.int64), ELEMENTS - 1)
    local = place - element
    powers = np.arange(1, nodes.size + 1)
    integrals = local[:, None] ** powers / powers @ np.linalg.inv(np.vander(nodes, increasing=True))
    return start[element] + width * np.einsum("pj,pja->pa", integrals, rate[element])

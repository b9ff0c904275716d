"""Periodic motion of several lobes on an elastic shaft by Gauss collocation in drive angle and Newton's method.

With the lead delta_i of lobe i over the drive end and its rate v_i, over the drive angle phi = Omega t::

    delta_i' = v_i / Omega,   v_i' = alpha_i / Omega
    J_i(theta_i) alpha_i + tau_i(theta_i, Omega + v_i) = T_i - T_(i+1)

Newton's method works on all stages at once: each element is condensed to a transition from its start to its end, and
the transitions are closed over the revolution. It needs no damping and does not mind a resonance among the harmonics,
where the steps of `elastic` from load to twist run away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from camtorque.mechanism.collocation import gauss
from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.torque import ClosedForm, closed_form_tables
from camtorque.records import Array
from camtorque.units import TURN, angle_grid, closed

ELEMENTS, STAGES = 720, 4
ROUNDS = 25
CLOSED = 1.0e-11
"""Newton step over the greatest twist at which the motion is found."""
STEP = 1.0e-6
"""Of the central differences of the tables over cam angle [rad]."""
LONGEST = 0.2
"""Longest step of a twist [rad]: beyond it the tables of a cam are another cam's."""


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
        rate, slope = (part.reshape(ELEMENTS, STAGES, *part.shape[1:]) for part in _motion(shaft, angle, state))
        steps = _newton_step(start, state, rate, slope, (width * matrix, width * weights))
        longest = float(np.max(np.abs(steps[1][..., :count])))
        share = min(1.0, LONGEST / max(longest, 1e-300))
        start, state = start + share * steps[0], state + share * steps[1]
        if not np.all(np.isfinite(state)) or np.min(state[..., count:]) <= -shaft.speed:
            return None
        if longest <= CLOSED * np.max(np.abs(state[..., :count])):
            rate, _ = (part.reshape(ELEMENTS, STAGES, *part.shape[1:]) for part in _motion(shaft, angle, state))
            return _on_grid(start, rate, nodes, width, shaft.load.shape[1])[:, :count].T
    return None


def _motion(shaft: Shaft, angle: Array, state: Array) -> tuple[Array, Array]:
    """Return the derivative of the state over the drive angle (m, 2n), and its Jacobian (m, 2n, 2n)."""
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
    return rate, slope


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

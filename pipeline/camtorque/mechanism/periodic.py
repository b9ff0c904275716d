"""Periodic motion of several lobes on an elastic shaft by Gauss collocation in drive angle and Newton's method.

With the lead delta_i of lobe i over the drive end and its rate v_i, over the drive angle phi = Omega t::

    delta_i' = v_i / Omega,   v_i' = alpha_i / Omega
    J_i(theta_i) alpha_i + tau_i(theta_i, Omega + v_i) = T_i - T_(i+1)

Newton's method works on all stages at once: each element is condensed to a transition from its start to its end, and
the transitions are closed over the revolution. It needs no damping and does not mind a resonance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from camtorque.mechanism.cam import TURN
from camtorque.mechanism.collocation import gauss
from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import Array

ELEMENTS, STAGES = 720, 4
ROUNDS = 60
"""Newton steps at most: 4 to 6 are usual, a cam that nearly stops takes 30."""
CLOSED = 1.0e-11
"""Newton step over the greatest twist at which the motion is found."""
STEP = 1.0e-6
"""Of the central differences of the tables over cam angle [rad]."""
LONGEST = 0.2
"""Longest step of a twist [rad]: beyond it the tables of a cam are another cam's."""
SLOWED = 0.9
"""Largest share of a lobe's speed that one step may take, so that no cam turns back on the way to the solution."""


@dataclass(frozen=True)
class Shaft:
    """Pumps, uniform grid of drive angle, pressures over the angle of each shaft piece, speed of the drive, springs."""

    units: Sequence[PumpUnit]
    theta: Array
    curves: Sequence[CubicSpline]
    speed: float
    stiffness: Array
    damping: Array


def solve_periodic(shaft: Shaft) -> tuple[Array, Array, Array] | None:
    """Return lead [rad], its rate [rad/s] and the acceleration [rad/s^2] of every lobe, each (n_pumps, n_theta).

    None where Newton's method does not settle.
    """
    nodes, weights, matrix = gauss(STAGES)
    width, count = TURN / ELEMENTS, len(shaft.units)
    angle = (width * (np.arange(ELEMENTS)[:, None] + nodes)).ravel()
    lead, rate = np.zeros((2, ELEMENTS, STAGES, count))
    start = np.zeros((ELEMENTS, 2 * count))
    for _ in range(ROUNDS):
        change, slopes = _acceleration(shaft, angle, lead.reshape(-1, count), rate.reshape(-1, count))
        begins, step = _newton_step(
            start, rate, change.reshape(rate.shape), slopes, (width / shaft.speed, matrix, weights)
        )
        turn = begins[:, None, :count] + width / shaft.speed * np.einsum("ij,eja->eia", matrix, step)
        longest, slowing = float(np.max(np.abs(turn))), float(np.max(-step / (shaft.speed + rate)))
        share = min(1.0, LONGEST / max(longest, 1e-300), SLOWED / max(slowing, 1e-300))
        start, lead, rate = start + share * begins, lead + share * turn, rate + share * step
        if not np.all(np.isfinite(rate)):
            return None
        if longest <= CLOSED * np.max(np.abs(lead)):
            change, _ = _acceleration(shaft, angle, lead.reshape(-1, count), rate.reshape(-1, count))
            slope = np.concatenate([rate, change.reshape(rate.shape)], axis=2) / shaft.speed
            found = _on_grid(start, slope, nodes, width, shaft.theta.size)
            lead, rate = found[:, :count], found[:, count:]
            return lead.T, rate.T, _acceleration(shaft, shaft.theta, lead, rate)[0].T
    return None


def _acceleration(shaft: Shaft, angle: Array, lead: Array, rate: Array) -> tuple[Array, tuple[Array, Array]]:
    """Return the acceleration of the lobes (m, n), and its derivatives by lead and by rate, (m, n, n) each."""
    # T_i = k_i (delta_(i-1) - delta_i) + d_i (v_(i-1) - v_i); lobe i gets T_i - T_(i+1)
    coupling = [_chain(values) for values in (shaft.stiffness, shaft.damping)]
    net = lead @ coupling[0].T + rate @ coupling[1].T
    change, by_lead, by_rate = np.empty_like(lead), *np.zeros((2, *lead.shape, lead.shape[1]))
    for i, (unit, curve) in enumerate(zip(shaft.units, shaft.curves, strict=True)):
        omega, theta = shaft.speed + rate[:, i], angle + lead[:, i]
        rest, square, inertia = lobe_rows(unit, curve, theta)
        by_angle = (lobe_rows(unit, curve, theta + STEP) - lobe_rows(unit, curve, theta - STEP)) / (2.0 * STEP)
        change[:, i] = (net[:, i] - rest - square * omega**2) / inertia
        by_lead[:, i] = coupling[0][i] / inertia[:, None]
        by_rate[:, i] = coupling[1][i] / inertia[:, None]
        by_lead[:, i, i] -= (by_angle[0] + by_angle[1] * omega**2 + change[:, i] * by_angle[2]) / inertia
        by_rate[:, i, i] -= 2.0 * square * omega / inertia
    return change, (by_lead, by_rate)


def _chain(values: Array) -> Array:
    """Return the matrix from leads to the net torque of each lobe."""
    matrix = -np.diag(values + np.append(values[1:], 0.0))
    matrix += np.diag(values[1:], 1) + np.diag(values[1:], -1)
    return matrix


def lobe_rows(unit: PumpUnit, curve: CubicSpline, theta: Array) -> Array:
    """Return torque at rest, factor of the square of the speed and inertia of a lobe, (3, m)."""
    table = closed_form_tables(unit.pump, unit.law, theta - unit.phase, unit.mounting, unit.friction).outputs["torque"]
    return np.stack([table[0] + table[1] * curve(np.mod(theta, TURN)), table[2], table[3]])


def _newton_step(
    start: Array, rate: Array, change: Array, slopes: tuple[Array, Array], rule: tuple[float, Array, Array]
) -> tuple[Array, Array]:
    """Return the steps of the element starts (lead, rate) (e, 2n) and of the rates at the stages (e, s, n).

    The leads are sums of the rates, so that the rates alone are unknown: ``dv = dv_0 + h A (G_v dv + G_q dq)`` with
    ``dq = dq_0 + h A dv``; ``rule`` is the time of an element with the matrix and weights of the stages.
    """
    time, matrix, weights = rule
    elements, stages, size = rate.shape
    by_lead, by_rate = (slope.reshape(elements, stages, size, size) for slope in slopes)
    pulled = time * np.einsum("ij,ejab->eiajb", matrix, by_lead)
    big = -time * np.einsum("ij,ejab->eiajb", matrix, by_rate) - time * np.einsum("eiajb,jk->eiakb", pulled, matrix)
    big = big.reshape(elements, stages * size, stages * size) + np.eye(stages * size)
    missed = rate - start[:, None, size:] - time * np.einsum("ij,eja->eia", matrix, change)
    right = np.concatenate(
        [pulled.sum(axis=3), np.broadcast_to(np.eye(size), by_rate.shape), -missed[..., None]], axis=3
    )
    solved = np.linalg.solve(big, right.reshape(elements, stages * size, 2 * size + 1)).reshape(right.shape)
    # to the end of the element: q + h b v, and v + b A^-1 (v - v_0), which is v + h b G
    ends = np.linalg.solve(matrix.T, weights)
    moved = np.concatenate(
        [time * np.einsum("j,ejab->eab", weights, solved), np.einsum("j,ejab->eab", ends, solved)], axis=1
    )
    kept = np.repeat([1.0, 1.0 - ends.sum()], size)
    transition = np.diag(kept) + moved[..., : 2 * size]
    end = np.concatenate([time * weights @ rate, np.einsum("j,eja->ea", ends, rate)], axis=1) + kept * start
    begins = _closed(transition, moved[..., 2 * size] + end - np.roll(start, -1, axis=0))
    return begins, np.einsum("ejab,eb->eja", solved[..., : 2 * size], begins) + solved[..., 2 * size]


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

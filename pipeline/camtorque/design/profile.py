"""Flanks of unit rise over unit angle that a design may take, and the lobe that two of them make.

A flank is sampled on fixed points of its own length, so that a lobe of any angles and lift is linear algebra on tables
made once; where the load has a corner, the lobe is evaluated there as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, PPoly

from camtorque.compiled import njit
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.sections import FLANKS, unit_flank
from camtorque.records import Array, Integers, ReadOnly
from camtorque.units import TURN

SAMPLES = 240
"""Cells of a flank: a smooth peak between two points is missed by (1 / 240)^2 of it, about."""
ORDERS, WINDOWS = 4, 24
NODES = np.linspace(0.0, 1.0, SAMPLES + 1)
BSPLINE = "bspline"
LAWS = (BSPLINE, *FLANKS)
NEWTON_STEPS = 4


@dataclass(frozen=True)
class Family:
    """A family of flanks, by its name in `LAWS`: one fixed kind, or B-splines whose inner coefficients are free.

    ``degree`` and ``pieces`` are those of a B-spline, 0 for a fixed kind.
    """

    name: str
    degree: int = 0
    pieces: int = 0

    @property
    def held(self) -> int:
        """Coefficients at either end that hold the lift and the derivatives that join a dwell without a jump."""
        return 1 + min(2, self.degree - 1)

    @property
    def size(self) -> int:
        """Free coefficients of a flank."""
        return self.pieces + self.degree - 2 * self.held if self.degree else 0

    @cached_property
    def knots(self) -> Array:
        """Knots of the B-spline, its ends repeated."""
        inner = np.linspace(0.0, 1.0, self.pieces + 1)
        # a knot on a node is that node: rounding would put the node into the piece before
        near = NODES[np.rint(inner * SAMPLES).astype(np.int64)]
        inner = np.where(np.abs(inner - near) < 1e-9, near, inner)
        return np.concatenate([np.zeros(self.degree), inner, np.ones(self.degree)])

    @cached_property
    def tables(self) -> Array:
        """Derivatives 0 to 3 at the nodes: (4, n) of a fixed kind, (4, n, coefficients) of a B-spline."""
        if not self.degree:
            unit = unit_flank(self.name)
            return np.stack([unit(NODES, k) for k in range(ORDERS)])
        basis = BSpline(self.knots, np.eye(self.pieces + self.degree), self.degree)
        return np.stack([basis(NODES, k) if k <= self.degree else 0.0 * basis(NODES) for k in range(ORDERS)])

    @cached_property
    def windows(self) -> Integers:
        """First nodes of the parts of a flank of which the greatest value counts each.

        As a peak wanders from one part to the next, both are seen; no part reaches across a knot, where the highest
        derivative jumps.
        """
        knots = np.ceil(np.arange(self.pieces) * SAMPLES / max(self.pieces, 1) - 1e-9).astype(np.int64)
        return np.unique(np.concatenate([np.arange(0, SAMPLES, SAMPLES // WINDOWS), knots]))

    def coefficients(self, free: Array) -> Array:
        """Return all coefficients of a B-spline from the free ones."""
        return np.concatenate([np.zeros(self.held), free, np.ones(self.held)])

    def sampled(self, free: Array) -> Array:
        """Return lift and derivatives 0 to 3 at the nodes, (4, n), of unit rise over unit angle."""
        return self.tables @ self.coefficients(free) if self.degree else self.tables

    def curve(self, free: Array) -> PPoly:
        """Return the flank as a piecewise polynomial."""
        if not self.degree:
            return unit_flank(self.name)
        whole = PPoly.from_spline(BSpline(self.knots, self.coefficients(free), self.degree))
        real = np.diff(whole.x) > 0.0
        return PPoly(whole.c[:, real], np.append(whole.x[:-1][real], 1.0))

    def start(self, kind: str = "") -> Array:
        """Return the free coefficients that come closest to a kind of flank, a modified sine where it is none."""
        if not self.degree:
            return np.empty(0)
        table, held = self.tables[0], self.held
        goal = unit_flank(kind if kind in FLANKS else "modified_sine")(NODES) - table[:, -held:].sum(axis=1)
        free = np.linalg.lstsq(table[:, held:-held], goal, rcond=None)[0]
        return np.clip(np.maximum.accumulate(free), 0.0, 1.0)


@njit(cache=True)
def _cross(table, step, lifts, top, out):  # type: ignore[no-untyped-def]
    """Write lift and derivatives 0 to 3 where a rising flank (4, n) reaches some lifts, and the angle there.

    Taylor's series from the node before: a cell is 1/240 of the flank, the rest of the series is below 1e-8.
    """
    for k in range(lifts.size):
        target = min(max(lifts[k], 0.0), top)
        cell = min(max(np.searchsorted(table[0], target) - 1, 0), table.shape[1] - 2)
        y, first, second, third = table[0, cell], table[1, cell], table[2, cell], table[3, cell]
        x = 0.5 * step
        for _ in range(NEWTON_STEPS):
            value = y + x * (first + x * (second / 2.0 + x * third / 6.0))
            slope = max(first + x * (second + x * third / 2.0), 1e-6)
            x = min(max(x - (value - target) / slope, 0.0), step)
        out[0, k] = y + x * (first + x * (second / 2.0 + x * third / 6.0))
        out[1, k] = first + x * (second + x * third / 2.0)
        out[2, k] = second + x * third
        out[3, k] = third
        out[4, k] = step * cell + x


@dataclass(frozen=True)
class Lobe(ReadOnly):
    """One lobe in the direction of running: rise, dwell, return, rest on the base circle [m, rad].

    ``angles`` are those of rise, upper dwell and return; ``rise`` and ``fall`` the free coefficients of the flanks.
    """

    family: Family
    lift: float
    angles: tuple[float, float, float]
    rise: Array
    fall: Array

    @cached_property
    def flanks(self) -> tuple[Array, Array]:
        """Lift and derivatives 0 to 3 of rise and return at `NODES`, (4, n) each [m/rad^k]."""
        up, down = self.family.sampled(self.rise), self.family.sampled(self.fall)
        powers = np.arange(ORDERS)[:, None]
        fall = -self.lift * down / self.angles[2] ** powers
        fall[0] += self.lift
        return self.lift * up / self.angles[0] ** powers, fall

    @cached_property
    def theta(self) -> Array:
        """Cam angle of the nodes of both flanks, (2 n,) [rad]."""
        rise, dwell, fall = self.angles
        return np.concatenate([rise * NODES, rise + dwell + fall * NODES])

    def crossings(self, lifts: Array) -> tuple[Array, Array]:
        """Return where the rise reaches some lifts: angles (k,) [rad], lift and derivatives there (4, k).

        A lift that is never reached is put at the end of the rise.
        """
        out = np.empty((ORDERS + 1, lifts.size))
        _cross(self.flanks[0], self.angles[0] / SAMPLES, lifts, self.lift, out)
        return out[ORDERS], out[:ORDERS]

    def law(self) -> CamLaw:
        """Return the lift law over one revolution from the start of the rise."""
        rise, dwell, fall = self.angles
        up, down = self.family.curve(self.rise), self.family.curve(self.fall)
        order = up.c.shape[0]
        powers = np.arange(order - 1, -1, -1)[:, None]
        flat = np.zeros((order, 1))
        top, base = flat.copy(), flat
        top[-1] = self.lift
        back = -self.lift * down.c / fall**powers
        back[-1] += self.lift
        blocks = [(self.lift * up.c / rise**powers, rise * up.x[:-1]), (top, np.array([rise]))]
        blocks += [(back, rise + dwell + fall * down.x[:-1]), (base, np.array([rise + dwell + fall]))]
        if dwell <= 0.0:
            del blocks[1]
        knots = np.concatenate([block[1] for block in blocks])
        return CamLaw(np.append(knots, TURN), np.concatenate([block[0] for block in blocks], axis=1))

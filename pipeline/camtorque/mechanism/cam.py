"""The lift law of a cam: a periodic piecewise polynomial over cam angle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from camtorque.compiled import njit
from camtorque.records import MOST_LOBES, Array, Mask, ReadOnly
from camtorque.units import TURN

Real = TypeVar("Real", bound=np.floating)
ROUND = 8.0
"""Errors of a lift table over its step: 29 tables of 1 um and 1 degree leave slopes of 1.3 to 7.3 on base circles."""
REPEATED = 0.995
"""Share of the variance of a cam's lift that has to repeat itself with its lobes: lobes that are 7 % of their stroke
apart count as alike, those of two pumps do not."""


@njit(cache=True, fastmath={"contract", "nsz"})
def _evaluate(knots, coefficients, theta, out):  # type: ignore[no-untyped-def]
    """Write derivatives 0 to 3, as many as ``out`` has rows, of the pieces (m, order) by Horner's rule.

    Angles mostly come in order, so that the piece of the one before is the first guess, and the next one the second.
    """
    n_pieces, order = coefficients.shape
    piece = 0
    for i in range(theta.size):
        angle = theta[i] - np.floor((theta[i] - knots[0]) / TURN) * TURN
        if not knots[piece] <= angle < knots[piece + 1]:
            piece = piece + 1 if piece + 1 < n_pieces else 0
            if not knots[piece] <= angle < knots[piece + 1]:
                piece, above = 0, n_pieces
                while above - piece > 1:
                    middle = (piece + above) // 2
                    if knots[middle] <= angle:
                        piece = middle
                    else:
                        above = middle
        x = angle - knots[piece]
        c = coefficients[piece]
        y, first, second, third = c[0], 0.0, 0.0, 0.0
        for k in range(1, order):
            third = third * x + second
            second = second * x + first
            first = first * x + y
            y = y * x + c[k]
        out[0, i] = y
        if out.shape[0] > 1:
            out[1, i] = first
        if out.shape[0] > 2:
            out[2, i] = 2.0 * second
        if out.shape[0] > 3:
            out[3, i] = 6.0 * third


@dataclass(frozen=True)
class CamLaw(ReadOnly):
    """Lift over cam angle as a periodic piecewise polynomial, in the direction of running.

    Attributes
    ----------
    knots : (m + 1,) breakpoints over exactly one revolution [rad]
    coefficients : (order, m) of each piece in powers of (theta - left knot), highest power first [m/rad^k]
    lift_std : standard uncertainty of the table that it was made from [m], 0 for an analytic law
    table_step : mean step of that table [rad], 0 for an analytic law
    """

    knots: Array
    coefficients: Array
    lift_std: float = 0.0
    table_step: float = 0.0

    def __post_init__(self) -> None:
        if self.knots.ndim != 1 or self.coefficients.shape[1:] != (self.knots.size - 1,):
            raise ValueError(f"cam law: knots {self.knots.shape}, coefficients {self.coefficients.shape} do not belong")
        if not np.all(np.diff(self.knots) > 0.0) or abs(self.knots[-1] - self.knots[0] - TURN) > 1e-9:
            raise ValueError("cam law: knots have to increase over exactly one revolution")
        super().__post_init__()

    def evaluate(self, theta: Array, derivative: int = 0) -> Array:
        """Return derivative 0 to 3 of the lift over cam angle [m/rad^k], at angles of any shape and range [rad]."""
        return self.derivatives(theta, derivative)[derivative]

    def derivatives(self, theta: Array, highest: int = 3) -> Array:
        """Return derivatives 0 to ``highest`` (at most 3), (highest + 1, *theta.shape)."""
        if not 0 <= highest <= 3:
            raise ValueError(f"cam law: derivative {highest}, expected 0 to 3")
        angle = np.asarray(theta, dtype=np.float64)
        angle = angle - np.floor((angle - self.knots[0]) / TURN) * TURN
        piece = np.clip(np.searchsorted(self.knots, angle, "right") - 1, 0, self.knots.size - 2)
        return by_pieces(self.coefficients[:, piece], angle - self.knots[piece], highest)

    def compiled_derivatives(self, theta: Array, highest: int = 3) -> Array:
        """Return the same by compiled code, for callers that ask thousands of times."""
        angle = np.ascontiguousarray(theta, dtype=np.float64)
        if not angle.flags.writeable:
            angle = angle.copy()  # one compiled variant is enough
        out = np.empty((highest + 1, angle.size))
        _evaluate(self.knots, self._by_piece, angle.reshape(-1), out)
        return out.reshape((highest + 1, *angle.shape))

    @cached_property
    def _by_piece(self) -> Array:
        """The coefficients of a piece side by side, as the evaluation reads them, (m, order)."""
        return np.ascontiguousarray(self.coefficients.T)

    def is_round(self, slope: Array) -> Mask:
        """Return where a slope of the law [m/rad] is no more than a table's error makes of a round cam."""
        most = ROUND * self.lift_std / self.table_step if self.table_step else 0.0
        return np.asarray(np.abs(slope) <= most)

    @property
    def lift(self) -> float:
        """Highest lift above the base circle [m]."""
        return float(np.max(self.evaluate(np.linspace(self.knots[0], self.knots[-1], 7201))))

    def continuity_at_knots(self) -> Array:
        """Return the jump of derivatives 0 to 3 at the right end of every piece, (4, m)."""
        width = np.diff(self.knots)
        ends, starts = (by_pieces(self.coefficients, at, 3) for at in (width, 0.0 * width))
        return np.abs(ends - np.roll(starts, -1, axis=1))


def by_pieces(coefficients: NDArray[Real], x: NDArray[Real], highest: int) -> NDArray[Real]:
    """Return derivatives 0 to ``highest`` (k, *x.shape) of polynomials (order, *x.shape) at x, by Horner's rule."""
    out = np.zeros((highest + 1, *x.shape), x.dtype)
    for row in coefficients:
        for k in range(highest, 0, -1):
            out[k] = out[k] * x + k * out[k - 1]
        out[0] = out[0] * x + row
    return out


def lobe_count(lift: Array) -> int:
    """Return how many lobes that are alike a lift at even angles of a revolution has, (n,)."""
    power = np.abs(np.fft.rfft(lift)[1:]) ** 2
    whole = REPEATED * np.sum(power)
    return max((n for n in range(2, MOST_LOBES + 1) if np.sum(power[n - 1 :: n]) >= whole), default=1)


def stroke_count(lift: Array) -> int:
    """Return how many lobes, alike or not, a lift at the angles of a revolution has, (n,): rises beyond its half."""
    high = lift > 0.5 * (np.min(lift) + np.max(lift))
    return max(int(np.count_nonzero(high & ~np.roll(high, 1))), 1)

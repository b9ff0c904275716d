"""At which angle a line pressure looks as others do at their ends of delivery.

Slope and level around the ends of fitted recordings are looked for. The level tells the first fall from that of the
wave which returns. A file with few points is compared at its points alone: between them it knows nothing, and may look
so at several places.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from camtorque.records import Array, ReadOnly

MATCH_WINDOW, MATCH_POINTS = 1.0e-3, 41
"""Time before and after an end of delivery over which the slope of the line pressure is compared [s]; points."""
LEVEL = 2.0
"""Weight of a square difference of level (share of the highest) against one of slope (share of the steepest)."""
FINE_POINTS = 4
"""A file with fewer points within `MATCH_WINDOW` is coarse: it blurs the end of delivery."""
COARSE_WINDOW, COARSE_POINTS = 2.0e-3, 3
"""Time [s], and points of a coarse file if that is more, before and after an end over which its shape is compared."""
FINE_COMPARED = 20.0
"""Independent values among those compared in a recording: a line swings some five times within the window."""
LEAST_SPREAD = np.radians(0.5)
"""Standard deviation that ends of delivery have at least from one run to another, however alike the fitted ones are."""
MOST_TEMPLATES = 2
"""Fitted recordings, the nearest in speed, whose shapes are looked for."""


@dataclass(frozen=True)
class Curve(ReadOnly):
    """Line pressure over cam angle, (n,) [rad], [Pa], and the speed that it was taken at [rad/s].

    Attributes
    ----------
    step : between the points of a file where it is loaded [rad], 0 for a recording
    points : (k,) angles of a file's points [rad], empty for a recording
    std : (n,) standard uncertainty of the pressure between the points [Pa], empty for a recording
    """

    theta: Array
    pressure: Array
    speed: float
    step: float = 0.0
    points: Array = field(default_factory=lambda: np.zeros(0))
    std: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def fine_step(self) -> float:
        """Distance of points up to which they show the end of delivery as a recording does [rad]."""
        return MATCH_WINDOW * self.speed / FINE_POINTS

    @property
    def coarse(self) -> bool:
        """True for a file whose points blur the end of delivery."""
        return self.step > self.fine_step

    @property
    def pause(self) -> float:
        """Time between the points of a file [s], 0 for a recording."""
        return self.step / self.speed

    def at(self, angles: Array) -> Array:
        """Return the pressure at angles as a share of the highest."""
        return np.interp(angles, self.theta, self.pressure, period=2.0 * np.pi) / np.max(self.pressure)


@dataclass(frozen=True)
class KnownEnd:
    """A fitted end of delivery: its angle [rad], the line pressure around it, how it moves with the fit's values.

    ``moves`` : place in the fit -> weight [rad/SI]
    """

    id: str
    angle: float
    curve: Curve
    moves: Mapping[int, float] = field(default_factory=dict)


def shape_around(curve: Curve, angles: Array) -> Array:
    """Return slope (over its greatest size there) and level of the line pressure around angles, (m, 2 MATCH_POINTS)."""
    places = angles[:, None] + np.linspace(-MATCH_WINDOW, MATCH_WINDOW, MATCH_POINTS) * curve.speed
    slope = np.interp(places, curve.theta, np.gradient(curve.pressure, curve.theta), period=2.0 * np.pi)
    return np.hstack([_shares(slope), np.sqrt(LEVEL) * curve.at(places)])


def _shares(slope: Array) -> Array:
    return np.asarray(slope / (np.max(np.abs(slope), axis=1, keepdims=True) + 1e-12))


def misfit(curve: Curve, ends: Sequence[KnownEnd], rising: Array) -> Array:
    """Return how far a line pressure differs from those around known ends if its own were at each angle, (m,)."""
    if curve.coarse:
        return np.asarray(np.sum([_coarse_misfit(curve, end, rising) for end in ends], axis=0))
    shapes = shape_around(curve, rising)
    known = [shape_around(end.curve, np.array([end.angle])) for end in ends]
    return np.asarray(np.sum([np.sum((shapes - one) ** 2, axis=1) for one in known], axis=0))


def _coarse_reach(curve: Curve) -> float:
    return max(COARSE_WINDOW * curve.speed, COARSE_POINTS * curve.step)


def _coarse_misfit(curve: Curve, end: KnownEnd, rising: Array) -> Array:
    reach = _coarse_reach(curve)
    offset = np.mod(curve.points - rising[:, None] + np.pi, 2.0 * np.pi) - np.pi
    near = np.abs(offset) <= reach
    kept = np.flatnonzero(near.any(axis=0))
    offset, near = offset[:, kept], near[:, kept]
    pair = near[:, 1:] & near[:, :-1]
    own = np.broadcast_to(curve.at(curve.points[kept]), offset.shape)
    other = end.curve.at(end.angle + offset * end.curve.speed / curve.speed)
    slopes = _shares(np.where(pair, np.diff(own, axis=1), 0.0)) - _shares(np.where(pair, np.diff(other, axis=1), 0.0))
    level = LEVEL * np.sum(near * (own - other) ** 2, axis=1) / np.maximum(np.sum(near, axis=1), 1)
    return np.asarray(level + np.sum(slopes**2, axis=1) / np.maximum(np.sum(pair, axis=1), 1))


@dataclass(frozen=True)
class Match:
    """Where a line pressure looks as known ones do at their ends [rad], and the variance that its points leave."""

    angle: float
    variance: float


def matched_end(known: Sequence[KnownEnd], curve: Curve, rising: Array) -> Match:
    """Return the angle at which a line pressure looks as known ones do at their ends, and that is likely beside theirs.

    It may look so at several places: each is as probable as the squares of what differs there make it, whose size
    nobody knows beforehand (marginalised, squares to the power of minus half their number), and as the angles of the
    known ends do. Of a recording the most probable place counts, of few points the mean.

    Parameters
    ----------
    rising : (m,) angles among which the end is [rad]
    """
    squares = misfit(curve, nearest_ends(known, curve.speed), rising)
    compared = 2.0 * _coarse_reach(curve) / curve.step if curve.coarse else FINE_COMPARED
    weights = (squares / max(float(np.min(squares)), 1e-12) + 1e-12) ** (-0.5 * compared) * likely(known, rising)
    if not curve.coarse:
        return Match(float(rising[int(np.argmax(weights))]), 0.0)
    angle = float(np.average(rising, weights=weights))
    return Match(angle, float(np.average(np.square(rising - angle), weights=weights)))


def likely(known: Sequence[KnownEnd], angles: Array) -> Array:
    """Return how probable angles (m,) are for one more end beside known ones (Student's distribution, to a factor).

    One end alone tells no spread: every angle is as likely.
    """
    places = np.array([end.angle for end in known])
    n = places.size
    if n < 2:
        return np.ones_like(angles)
    spread = max(float(np.std(places, ddof=1)), LEAST_SPREAD) * np.sqrt(1.0 + 1.0 / n)
    return np.asarray((1.0 + np.square((angles - np.mean(places)) / spread) / (n - 1)) ** (-0.5 * n))


def nearest_ends(known: Sequence[KnownEnd], speed: float) -> list[KnownEnd]:
    """Return the known ends whose shapes are looked for at a speed [rad/s]."""
    return sorted(known, key=lambda end: abs(np.log(end.curve.speed / speed)))[:MOST_TEMPLATES]


def away(ends: Sequence[KnownEnd], speed: float) -> float:
    """Return how far a speed [rad/s] lies from those of the ends that are looked for there, in ln speed."""
    return float(np.mean([np.log(speed / end.curve.speed) for end in nearest_ends(ends, speed)]))

"""The ends of delivery that a fit knows: where it knows them, and where another line pressure looks as theirs do.

A fit trades where an end begins against how sharp it is, since a torque shows neither alone. It knows where the port
has opened by some size: ends that are looked for in line pressures, and what is learnt of them, are those.

Slope and level around the ends of fitted recordings are looked for. The level tells the first fall from that of the
wave which returns. A file with few points is compared at its points alone: between them it knows nothing, and may look
so at several places.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.problem import END_NAMES, SPILL_NAMES
from camtorque.laws.chain import ChainInput
from camtorque.laws.swing import Swing
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
END_OF = {"land": END_NAMES[0], "spill": SPILL_NAMES[0]}
"""Structure -> parameter that says where delivery ends."""
WIDTHS_OF = {"land": END_NAMES[1:], "spill": SPILL_NAMES[1:]}
"""Structure -> parameters that say how sharply it ends, the width of the end first."""
PLACES = 2000
"""Angles among which an end is looked for."""


@dataclass(frozen=True)
class Curve(ReadOnly):
    """Line pressure over cam angle, (n,) [rad], [Pa], and the speed that it was taken at [rad/s].

    Attributes
    ----------
    step : between the points of a file where it is loaded [rad], 0 for a recording
    points : (k,) angles of a file's points [rad], empty for a recording
    std : (n,) standard uncertainty of the pressure between the points [Pa], empty for a recording
    swing : of the cam within a turn where a wheel on it saw that, by which `over_even_angle` brings it to the chain
    """

    theta: Array
    pressure: Array
    speed: float
    step: float = 0.0
    points: Array = field(default_factory=lambda: np.zeros(0))
    std: Array = field(default_factory=lambda: np.zeros(0))
    swing: Swing | None = None

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
class MatchedEnd:
    """Where a line pressure looks as known ones do at their ends [rad], and the variance that its points leave."""

    angle: float
    variance: float


def matched_end(known: Sequence[KnownEnd], curve: Curve, rising: Array) -> MatchedEnd:
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
    weights = (squares / max(float(np.min(squares)), 1e-12) + 1e-12) ** (-0.5 * compared) * end_likelihood(
        known, rising
    )
    if not curve.coarse:
        return MatchedEnd(float(rising[int(np.argmax(weights))]), 0.0)
    angle = float(np.average(rising, weights=weights))
    return MatchedEnd(angle, float(np.average(np.square(rising - angle), weights=weights)))


def end_likelihood(known: Sequence[KnownEnd], angles: Array) -> Array:
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


def ln_speed_from(ends: Sequence[KnownEnd], speed: float) -> float:
    """Return how far a speed [rad/s] lies from those of the ends that are looked for there, in ln speed."""
    return float(np.mean([np.log(speed / end.curve.speed) for end in nearest_ends(ends, speed)]))


@dataclass(frozen=True)
class RisingFlank(ReadOnly):
    """The rising flank on which delivery may end: angles (m,) [rad] and lift there [m]."""

    theta: Array
    lift: Array

    def angle(self, structure: str, place: float) -> float:
        """Return the angle of a place, which a land has as an angle and a spill as a lift [rad]."""
        return place if structure == "land" else float(np.interp(place, self.lift, self.theta))

    def place(self, structure: str, angle: float) -> float:
        """Return the place at an angle [SI]."""
        return angle if structure == "land" else float(np.interp(angle, self.theta, self.lift))

    def per_angle(self, structure: str, angle: float) -> float:
        """Return by how much a place grows with its angle [SI per rad]."""
        if structure == "land":
            return 1.0
        return float(np.interp(angle, self.theta, np.gradient(self.lift, self.theta)))


def flank_of(chain: ChainInput) -> RisingFlank:
    """Return the rising flank of the first lobe of a chain's cam at `PLACES` angles."""
    first = chain.theta[: chain.theta.size // chain.lobes]
    lift = np.asarray(chain.law.evaluate(first, 0))
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    inside = first[(lift > 0.25 * np.max(lift)) & (np.arange(lift.size) <= top)]
    theta = np.linspace(inside[0], inside[-1], PLACES)
    return RisingFlank(theta, np.asarray(chain.law.evaluate(theta, 0)))


@dataclass(frozen=True)
class EndTradeOff:
    """How fits of recordings that end alike trade the place of an end against its width w.

    A land has closed by some size at a constant share of its end's w; the edge of a spill has opened some area at a
    lift of that area over w: ``place - shift(w)`` is known where place and w are not. ``middle`` is the w, or 1 / w, at
    which nothing is shifted: 0, or the mean of the recordings, which are then shifted against each other alone.
    """

    structure: str
    pull: float = 0.0
    middle: float = 0.0

    def along(self, width: float) -> float:
        """Return what the place moves with: the width of a land's end [rad], one over that of an edge [1/m]."""
        return width if self.structure == "land" else 1.0 / width

    def shift(self, width: float) -> float:
        """Return how far the place lies beyond where it is known [SI]."""
        return self.pull * (self.along(width) - self.middle) if self.pull else 0.0

    def slope(self, width: float) -> float:
        """Return how fast that grows with the width."""
        return self.pull * (1.0 if self.structure == "land" else -1.0 / width**2) if self.pull else 0.0


def trade_offs_of(known: KnownFit, structure: str, recordings: Sequence[FittedAt]) -> tuple[EndTradeOff, ...]:
    """Return the trade that the covariance of some recordings' ends shows from one to another, none without widths.

    What the fit trades in all of them alike does not count: it moves no end against another. Whether the line pressure
    falls where a port has opened by that size, or as it begins to, is not known: both are returned.
    """
    owns = [own for item in recordings if WIDTHS_OF[structure][0] in (own := known.own(item.id))]
    n = len(owns)
    if n < 2:
        return (EndTradeOff(structure),)
    one = EndTradeOff(structure, 1.0)
    places = [own[END_OF[structure]] for own in owns] + [own[WIDTHS_OF[structure][0]] for own in owns]
    widths = known.values[places[n:]].tolist()
    scale = np.r_[np.ones(n), [one.slope(width) for width in widths]]
    covariance = known.predictive.among(places) * np.outer(scale, scale)
    apart = np.eye(n) - 1.0 / n
    alone = float(np.sum(apart * covariance[n:, n:]))
    pull = float(np.sum(apart * covariance[:n, n:])) / alone if alone > 0.0 else 0.0
    middle = float(np.mean([one.along(width) for width in widths]))
    return EndTradeOff(structure, pull, middle), EndTradeOff(structure, pull)


def firm_place(known: KnownFit, trade_off: EndTradeOff, recording: str) -> tuple[float, Mapping[int, float]]:
    """Return where a fitted end is known [SI], and how that moves with the fit's values: place of each -> weight."""
    own = known.own(recording)
    place, width = own[END_OF[trade_off.structure]], own.get(WIDTHS_OF[trade_off.structure][0])
    if width is None:
        return float(known.values[place]), {place: 1.0}
    at = float(known.values[width])
    return float(known.values[place]) - trade_off.shift(at), {place: 1.0, width: -trade_off.slope(at)}


def combined(parts: Sequence[tuple[float, Mapping[int, float]]]) -> dict[int, float]:
    """Return the sum of some weights by place, each times a factor."""
    found: dict[int, float] = {}
    for factor, weights in parts:
        for place, weight in weights.items():
            found[place] = found.get(place, 0.0) + factor * weight
    return found


def variance_of(known: KnownFit, weights: Mapping[int, float]) -> float:
    """Return the variance that a fit leaves of a weighted sum of its values."""
    factor = np.array(list(weights.values()))
    return float(factor @ known.predictive.among(list(weights)) @ factor)

"""Where a fit knows that a delivery ends: where the port has opened by some size, not where it begins to.

A fit trades where an end begins against how sharp it is, since a torque shows neither alone. Ends that are looked for
in line pressures, and what is learnt of them, are those that it does know.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.problem import END_NAMES, SPILL_NAMES
from camtorque.laws.chain import ChainInput
from camtorque.records import Array, ReadOnly

END_OF = {"land": END_NAMES[0], "spill": SPILL_NAMES[0]}
"""Structure -> parameter that says where delivery ends."""
WIDTHS_OF = {"land": END_NAMES[1:], "spill": SPILL_NAMES[1:]}
"""Structure -> parameters that say how sharply it ends, the width of the end first."""
PLACES = 2000
"""Angles among which an end is looked for."""


@dataclass(frozen=True)
class Flank(ReadOnly):
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


def flank_of(chain: ChainInput) -> Flank:
    """Return the rising flank of a chain's cam at `PLACES` angles."""
    lift = np.asarray(chain.law.evaluate(chain.theta, 0))
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    inside = chain.theta[(lift > 0.25 * np.max(lift)) & (np.arange(lift.size) <= top)]
    theta = np.linspace(inside[0], inside[-1], PLACES)
    return Flank(theta, np.asarray(chain.law.evaluate(theta, 0)))


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

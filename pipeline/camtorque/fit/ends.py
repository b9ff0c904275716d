"""Where a delivery ends that was not fitted: found by the shape of the line pressure, and how well.

Slope and level of the line pressure around the ends of delivery of fitted recordings are looked for in the other line
pressure. The level tells the first fall from that of the wave which returns. How far that misses is learnt on the
fitted recordings themselves, each looked for by the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from camtorque.fit.forecast import FittedAt, KnownFit
from camtorque.laws.chain import ChainInput
from camtorque.records import Array, Estimate, freeze_arrays

MATCH_WINDOW, MATCH_POINTS = 1.0e-3, 41
"""Time before and after an end of delivery over which the slope of the line pressure is compared [s]; points."""
LEAST_STD, UNKNOWN_STD = np.radians(0.06), np.radians(1.0)
"""Standard deviation of an end found by shape: where the fitted recordings never miss, where none can tell."""
LEVEL = 2.0
"""Weight of a square difference of level (share of the highest) against one of slope (share of the steepest)."""
FINE_STEP = np.radians(1.05)
"""Points of a file that are further apart blur the end of delivery; closer ones cost nothing that can be seen."""
MOST_TEMPLATES = 2
"""Fitted recordings, the nearest in speed, whose shapes are looked for."""
END_OF = {"land": "end_of_delivery", "spill": "spill_lift"}
"""Structure -> parameter that says where delivery ends."""
PLACES = 2000
"""Angles among which an end is looked for."""


@dataclass(frozen=True)
class Curve:
    """Line pressure over cam angle, (n,) [rad], [Pa], and the speed that it was taken at [rad/s].

    ``step`` : between the points that it was made from where it is loaded [rad], 0 for a recording
    """

    theta: Array
    pressure: Array
    speed: float
    step: float = 0.0

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True)
class KnownEnd:
    """A fitted end of delivery: angle [rad], and the line pressure around it."""

    id: str
    angle: float
    curve: Curve


def shape_around(curve: Curve, angles: Array) -> Array:
    """Return slope (over its greatest size there) and level of the line pressure around angles, (m, 2 MATCH_POINTS)."""
    places = angles[:, None] + np.linspace(-MATCH_WINDOW, MATCH_WINDOW, MATCH_POINTS) * curve.speed
    slope = np.interp(places, curve.theta, np.gradient(curve.pressure, curve.theta), period=2.0 * np.pi)
    level = np.interp(places, curve.theta, curve.pressure, period=2.0 * np.pi) / np.max(curve.pressure)
    return np.hstack([slope / (np.max(np.abs(slope), axis=1, keepdims=True) + 1e-12), np.sqrt(LEVEL) * level])


def matched_end(known: Sequence[KnownEnd], curve: Curve, rising: Array) -> float:
    """Return the angle at which a line pressure looks as known ones do at their ends [rad].

    Parameters
    ----------
    rising : (m,) angles among which the end is [rad]
    """
    near = sorted(known, key=lambda end: abs(np.log(end.curve.speed / curve.speed)))[:MOST_TEMPLATES]
    found = shape_around(curve, rising)
    errors = [np.sum((found - shape_around(end.curve, np.array([end.angle]))) ** 2, axis=1) for end in near]
    return float(rising[int(np.argmin(np.sum(errors, axis=0)))])


def rising_angles(chain: ChainInput) -> Array:
    """Return the angles of the rising flank at which a delivery may end, (PLACES,) [rad]."""
    lift = np.asarray(chain.law.evaluate(chain.theta, 0))
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    inside = chain.theta[(lift > 0.25 * np.max(lift)) & (np.arange(lift.size) <= top)]
    return np.linspace(inside[0], inside[-1], PLACES)


def ends_for(
    known: KnownFit, source: FittedAt, templates: Mapping[str, Curve], chain: ChainInput, curve: Curve
) -> dict[str, Estimate]:
    """Return where delivery ends under another line pressure, with its standard error [SI].

    Parameters
    ----------
    source : recording whose structure is that of the run
    templates : line pressure of every fitted recording, by name
    """
    if source.structure not in END_OF:
        return {}
    rising = rising_angles(chain)
    lift = np.asarray(chain.law.evaluate(rising, 0))
    alike = [item for item in known.recordings if item.structure == source.structure and item.id in templates]
    ends = [KnownEnd(item.id, _end_angle(known, item, rising, lift), templates[item.id]) for item in alike]
    place = matched_end(ends, curve, rising)
    coarse = curve.step if curve.step > FINE_STEP else 0.0
    std = float(np.hypot(np.sqrt(end_variance(known, source.structure, ends, rising, lift)), coarse / np.sqrt(12.0)))
    if source.structure == "land":
        return {"end_of_delivery": Estimate(place, std)}
    slope = float(np.interp(place, rising, np.gradient(lift, rising)))
    return {"spill_lift": Estimate(float(np.interp(place, rising, lift)), std * slope)}


def end_variance(known: KnownFit, structure: str, ends: Sequence[KnownEnd], rising: Array, lift: Array) -> float:
    """Return the variance of ends found by shape about fitted ones, less what the fit itself leaves open [rad^2]."""
    beyond = []
    for end in ends:
        others = [other for other in ends if other is not end]
        if others:
            near = min(others, key=lambda other: abs(np.log(other.curve.speed / end.curve.speed)))
            miss = matched_end(others, end.curve, rising) - end.angle
            per = 1.0 if structure == "land" else float(np.interp(end.angle, rising, np.gradient(lift, rising)))
            beyond.append(miss**2 - _difference_variance(known, END_OF[structure], (end.id, near.id)) / per**2)
    return max(float(np.mean(beyond)), float(LEAST_STD) ** 2) if beyond else float(UNKNOWN_STD) ** 2


def _difference_variance(known: KnownFit, name: str, recordings: tuple[str, str]) -> float:
    """Return the variance of the difference of two fitted ends [SI^2]."""
    i, j = (known.own(recording)[name] for recording in recordings)
    cov = known.covariance
    return float(cov[i, i] + cov[j, j] - 2.0 * cov[i, j])


def _end_angle(known: KnownFit, item: FittedAt, rising: Array, lift: Array) -> float:
    value = float(known.values[known.own(item.id)[END_OF[item.structure]]])
    return value if item.structure == "land" else float(np.interp(value, lift, rising))

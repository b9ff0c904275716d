"""Where a delivery ends that was not fitted: found by the shape of the line pressure, and how well.

The slope of the line pressure around the end of delivery of a fitted recording is looked for in the other line
pressure. How far that misses is learnt on the fitted recordings themselves, each looked for by the nearest other one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from camtorque.fit.forecast import FittedAt, KnownFit
from camtorque.laws.chain import ChainInput
from camtorque.records import Array, Estimate, freeze_arrays

MATCH_WINDOW, MATCH_POINTS = 1.0e-3, 41
"""Time before and after an end of delivery over which the slope of the line pressure is compared [s]; points."""
LEAST_STD, UNKNOWN_STD = np.radians(0.06), np.radians(1.0)
"""Standard deviation of an end found by shape: where the fitted recordings never miss, where none can tell."""
END_OF = {"land": "end_of_delivery", "spill": "spill_lift"}
"""Structure -> parameter that says where delivery ends."""
PLACES = 2000
"""Angles among which an end is looked for."""


@dataclass(frozen=True)
class Curve:
    """Line pressure over cam angle, (n,) [rad], [Pa], and the speed that it was taken at [rad/s]."""

    theta: Array
    pressure: Array
    speed: float

    def __post_init__(self) -> None:
        freeze_arrays(self)


def slopes_around(curve: Curve, angles: Array) -> Array:
    """Return the slope of the line pressure around angles (m,), over its greatest size there, (m, MATCH_POINTS)."""
    times = np.linspace(-MATCH_WINDOW, MATCH_WINDOW, MATCH_POINTS)
    slope = np.gradient(curve.pressure, curve.theta)
    found = np.interp(angles[:, None] + times * curve.speed, curve.theta, slope, period=2.0 * np.pi)
    return np.asarray(found / (np.max(np.abs(found), axis=1, keepdims=True) + 1e-12))


def matched_end(template: Curve, angle: float, curve: Curve, rising: Array) -> float:
    """Return the angle at which a line pressure looks as another one does around an end of delivery [rad].

    Parameters
    ----------
    template, angle : line pressure whose end is known
    curve : the other one
    rising : (m,) angles among which the end is [rad]
    """
    wanted = slopes_around(template, np.array([angle]))
    errors = np.sum((slopes_around(curve, rising) - wanted) ** 2, axis=1)
    return float(rising[int(np.argmin(errors))])


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
    source : recording by whose shape it is looked for
    templates : line pressure of every fitted recording, by name
    """
    rising = rising_angles(chain)
    lift = np.asarray(chain.law.evaluate(rising, 0))
    if source.structure not in END_OF:
        return {}
    found = matched_end(templates[source.id], _end_angle(known, source, rising, lift), curve, rising)
    std = shape_std(known, source.structure, templates, rising, lift)
    if source.structure == "land":
        return {"end_of_delivery": Estimate(found, std)}
    slope = float(np.interp(found, rising, np.gradient(lift, rising)))
    return {"spill_lift": Estimate(float(np.interp(found, rising, lift)), std * slope)}


def shape_std(known: KnownFit, structure: str, templates: Mapping[str, Curve], rising: Array, lift: Array) -> float:
    """Return how far ends found by shape lie from the fitted ones beyond what the fit itself leaves open [rad]."""
    alike = [item for item in known.recordings if item.structure == structure and item.id in templates]
    beyond = []
    for item in alike:
        others = [other for other in alike if other is not item]
        if others:
            near = min(others, key=lambda other: abs(np.log(other.speed / item.speed)))
            end = _end_angle(known, item, rising, lift)
            miss = (
                matched_end(templates[near.id], _end_angle(known, near, rising, lift), templates[item.id], rising) - end
            )
            per = 1.0 if structure == "land" else float(np.interp(end, rising, np.gradient(lift, rising)))
            beyond.append(miss**2 - _difference_variance(known, item, near) / per**2)
    if not beyond:
        return float(UNKNOWN_STD)
    return float(np.sqrt(max(float(np.mean(beyond)), float(LEAST_STD) ** 2)))


def _difference_variance(known: KnownFit, one: FittedAt, two: FittedAt) -> float:
    """Return the variance of the difference of two fitted ends [SI^2]."""
    name = END_OF[one.structure]
    i, j = known.own(one.id)[name], known.own(two.id)[name]
    cov = known.covariance
    return float(cov[i, i] + cov[j, j] - 2.0 * cov[i, j])


def _end_angle(known: KnownFit, item: FittedAt, rising: Array, lift: Array) -> float:
    places = known.own(item.id)
    if item.structure == "land":
        return float(known.values[places["end_of_delivery"]])
    return float(np.interp(known.values[places["spill_lift"]], lift, rising))

"""Values drawn about a fit by its covariance, and the one of them that stands for all where the model steps.

Beside a valve near chattering the torque of a run that was not made is a matter of the last digit of the values, and
the best ones may lie on the rare side of a step: what is typical is the drawn run nearest to the median of all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from camtorque.fit.known_fit import KnownFit
from camtorque.laws import ROWS
from camtorque.records import Array, Estimate, ReadOnly

FRACTIONS = (0.2, 1.0)
"""Draws are such shares of the covariance's standard deviations away; their scatter is scaled up again, and the smaller
one counts: small draws make too much of a step of the model, large ones of the bounds."""
STEP_RATIO, RARE_RATIO = 2.5, 0.7
"""Scatter of small draws, scaled up, over that of whole ones: 0.1 to 1.4 in 33 left-out runs, 4 to 5 where steps are
all; less is enough where the best values lie on the rare side of a step."""


@dataclass(frozen=True)
class Load(ReadOnly):
    """What is known of the load of a run that was not made, beside its line pressure.

    Attributes
    ----------
    ends : own parameters that are known otherwise, such as the end of delivery, with how well [SI]
    pressure_std : (n,) standard uncertainty of the line pressure on the chain's grid [Pa], empty for none
    means : such parameters that are weighted means of fitted ones -> place of each in the fit -> weight; what the fit
        leaves open of the mean is in its covariance, the standard error of ``ends`` is what comes on top
    pulls : end -> width that moves it, and by how much per unit of the width's own error [SI]
    """

    ends: Mapping[str, Estimate]
    pressure_std: Array = field(default_factory=lambda: np.zeros(0))
    means: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    pulls: Mapping[str, tuple[str, float]] = field(default_factory=dict)


def draws(
    known: KnownFit, places: Mapping[str, int], mean: Mapping[str, float], load: Load, fraction: float, count: int
) -> list[dict[str, float]]:
    """Return drawn values within the bounds of the rows, ``count`` of them.

    Parameters
    ----------
    places : parameter -> its place in the fit; mean : parameter -> what it is drawn about [SI]
    fraction : of the covariance's standard deviations
    """
    parts = [load.means.get(name, {place: 1.0}) for name, place in places.items()]
    index = sorted({place for part in parts for place in part})
    mixing = np.array([[part.get(place, 0.0) for place in index] for part in parts])
    block = mixing @ known.predictive.among(index) @ mixing.T
    scale = np.sqrt(np.maximum(np.diag(block), 1e-300))
    values, vectors = np.linalg.eigh(block / np.outer(scale, scale))
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) * scale[:, None]
    every = np.random.default_rng(0).standard_normal((count, len(parts) + len(load.ends)))
    normal, found = np.split(every, [len(parts)], axis=1)
    result = []
    for k, step in enumerate(fraction * normal @ root.T):
        item = {name: mean[name] + float(d) for name, d in zip(places, step, strict=True)}
        item["torque_zero"] = 0.0
        away = {name: fraction * end.stderr * one for (name, end), one in zip(load.ends.items(), found[k], strict=True)}
        for name, error in away.items():
            other, pull = load.pulls.get(name, ("", 0.0))
            item[name] = item.get(name, mean[name]) + float(error + pull * away.get(other, 0.0))
        result.append({name: float(np.clip(v, *_room(name, mean[name]))) for name, v in item.items()})
    return result


def _room(name: str, value: float) -> tuple[float, float]:
    """Return the bounds of what is drawn about a value [SI].

    One beyond the bounds of literature was fitted within the wider ones of its own rig, and is known by its covariance.
    """
    row, beyond = ROWS[name], 0.5 * abs(value)
    return (
        row.lower if value >= row.lower else value - beyond,
        row.upper if value <= row.upper else value + beyond,
    )


def steps(small: Array, whole: Array) -> bool:
    """Return whether the model steps within what a fit leaves open.

    Small draws scatter more than whole ones then. On the rare side of a step the best values are farther from the
    median of the draws than most draws.

    Parameters
    ----------
    small, whole : how far draws move the torque, by both of `FRACTIONS`, scaled up by them, (m, n) [N m]
    """
    median = np.median(whole, axis=0)
    rare = np.linalg.norm(median) > np.median(np.linalg.norm(whole - median, axis=1))
    return bool(np.linalg.norm(small) >= (RARE_RATIO if rare else STEP_RATIO) * np.linalg.norm(whole))


def middle(moved: Array) -> int:
    """Return which of some drawn torques, (m, n), is nearest to their median."""
    return int(np.argmin(np.sum(np.abs(moved - np.median(moved, axis=0)), axis=1)))

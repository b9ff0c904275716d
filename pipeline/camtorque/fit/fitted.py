"""The parameters of a fit: values, uncertainty, and the interval where a part may be of either of two kinds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import cast

import numpy as np

from camtorque.fit.kinds import KINDS, PIN
from camtorque.fit.problem import Problem
from camtorque.fit.solver import Minimum
from camtorque.fit.uncertainty import Covariance, confidence
from camtorque.laws.rows import ParameterRow
from camtorque.records import Array
from camtorque.units import COVERAGE

TAIL = NormalDist().cdf(-COVERAGE)
"""Probability beyond either end of a 95 % interval."""
HALVINGS = 40


@dataclass(frozen=True)
class FittedParameters:
    """Values of the parameters that act in a recording, and how sure they are.

    ``deviation`` is how far the parameters lie from what is stated, within their bounds (`deviation_within`), (k, k)
    [SI^2]; ``covariance`` that of the Gaussian that knows of no bounds.
    ``shifts`` are further deviations by source, (m, k) each [SI]: one standard deviation in each of m directions.
    ``other_pin`` is how probable a pin of the other kind is, 0 where nothing tells.
    """

    problem: Problem
    solution: Minimum
    covariance: Covariance
    deviation: Array
    shifts: Mapping[str, Array]
    other_pin: float

    @property
    def std(self) -> Array:
        """Total standard uncertainty, (k,) [SI]."""
        return np.sqrt(self.statistical_std**2 + shift_variance(self.shifts, self.problem.size))

    @property
    def statistical_std(self) -> Array:
        """The part of it that the deviation within the bounds is, (k,) [SI]."""
        return np.sqrt(np.diag(self.deviation))

    @property
    def unbounded_std(self) -> Array:
        """Total standard uncertainty without the bounds, (k,) [SI]: what the data tell, which bounds do not."""
        return np.sqrt(self.covariance.std**2 + shift_variance(self.shifts, self.problem.size))

    def interval(self, k: int) -> tuple[float, float]:
        """Return the 95 % interval of a parameter [SI]."""
        row, value = self.problem.parameters[k].row, float(self.solution.z[k])
        low, high = confidence(value, float(self.std[k]), row.lower, row.upper)
        if row.name != KINDS[PIN].parameter or not self.other_pin:
            return low, high
        shift = float(self.shifts[PIN][0, k])
        own = math.sqrt(max(float(self.std[k]) ** 2 - shift**2, 0.0))
        return either_kind(row, (value, own), value + shift / math.sqrt(self.other_pin), self.other_pin, (low, high))


def shift_variance(shifts: Mapping[str, Array], size: int) -> Array:
    """Return the variance that signed deviations (m, k) of all sources add to each of k parameters [SI^2]."""
    return sum((np.sum(rows**2, axis=0) for rows in shifts.values()), np.zeros(size))


def either_kind(
    row: ParameterRow, kept: tuple[float, float], other: float, probability: float, interval: tuple[float, float]
) -> tuple[float, float]:
    """Return a 95 % interval that reaches as far to the side of a part's other kind as both together do.

    One Gaussian of the variance of both ends halfway: where needles were likelier at seven to one, pins of bushes lay
    beyond it.

    Parameters
    ----------
    kept, other : value and standard uncertainty of the kind that is kept; value of the other one [SI]
    probability : of the other kind
    interval : by the variance of both [SI]
    """
    own = NormalDist(kept[0], max(kept[1], 1e-3 * abs(other - kept[0])) or 1.0)
    turned = KINDS[PIN].turned(row)
    assert turned is not None  # a kind that is kept is one of the two
    beside = NormalDist(other, max(cast(tuple[float, float], turned["prior"])[1], own.stdev))
    up = other > kept[0]

    def beyond(x: float) -> float:
        below = (1.0 - probability) * own.cdf(x) + probability * beside.cdf(x)
        return 1.0 - below if up else below

    inner, outer = kept[0], row.upper if up else min(row.lower, 0.0)
    if beyond(outer) >= TAIL:
        return (interval[0], outer) if up else (outer, interval[1])
    for _ in range(HALVINGS):
        middle = 0.5 * (inner + outer)
        inner, outer = (middle, outer) if beyond(middle) > TAIL else (inner, middle)
    return (interval[0], outer) if up else (outer, interval[1])

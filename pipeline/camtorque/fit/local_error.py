"""Where laws are missing the residual weighs less there, not everywhere.

Weights hold one error of the laws, a share of the torque. A fit that leaves more than that leaves it somewhere: where a
valve chatters, where the chamber fills. One factor on the whole residual makes intervals wide and leaves the values
where those places have pulled them. So the minimum is sought once more with each bin's variance multiplied by the mean
square of the residual about it, in units of its weights and at least 1, until both agree: iteratively reweighted least
squares with a local scale (Holland & Welsch, Commun. Stat. A 6 (1977)). What was explained has to stay so: else lower
powers of that factor are tried, and then none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from camtorque.fit.minima import Candidate, Halves, at_minimum
from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.residual import explains, mean_square_about
from camtorque.fit.uncertainty import covariance
from camtorque.process.second_process import in_two
from camtorque.records import Array

LOCAL_FROM = 1.5
"""Inflation of the residual's variance from which it is looked for where it lies: less is luck of 20 values."""
REACH = 9.0 / 360.0
"""Part of a revolution to either side that tells the residual at a bin: 18 degrees, three independent values."""
ROUNDS = 4
POWERS = (1.0, 0.7, 0.5, 0.35)
"""Powers of the factor on a bin's standard deviation that are tried in turn."""
ROOM = 1.1
"""How much larger the residual may be where it is not taken over bins, and in the half of the cycles that is kept."""


def local_factor(residual: Array) -> Array:
    """Return by how much more than its weights a weighted residual (n,) has about each bin, (n,), at least 1."""
    square = mean_square_about(residual, round(REACH * residual.size)) * residual.size / INDEPENDENT
    return np.asarray(np.sqrt(np.maximum(square, 1.0)))


def weighed_locally(minima: Sequence[Candidate], halves: Halves, odd_even: float) -> list[Candidate]:
    """Return minima, the best one first, with weights that hold what this leaves, each sought again with them.

    They are returned as they are where the best one leaves no more than its weights allow, and where a recording that
    it explains would not stay explained.

    Parameters
    ----------
    odd_even : rms of odd against even cycles [N m]
    """
    best = minima[0]
    if covariance(best.problem, best.solution).inflation < LOCAL_FROM:
        return list(minima)
    explained = explains(best.data, best.solution, odd_even)
    for power in POWERS:
        found = _settled(best, halves, power)
        if found and (explains(found.data, found.solution, odd_even, ROOM) or not explained):
            others = in_two(partial(_sought, halves, found.data.weight), minima[1:])
            return sorted([found, *(other for other in others if other)], key=lambda item: item.value)
    return list(minima)


def _settled(best: Candidate, halves: Halves, power: float) -> Candidate | None:
    """Return a minimum whose weights hold what it leaves, None where a descent overflows on the way."""
    careful, found = best.data.weight, best
    for _ in range(ROUNDS):
        solution = found.solution
        left = solution.left * (careful / found.data.weight)
        again = _sought(halves, careful / local_factor(left) ** power, found)
        if again is None:
            return None
        found = again
    return found


def _sought(halves: Halves, weight: Array, item: Candidate) -> Candidate | None:
    return halves.minimum(at_minimum, replace(item.data, weight=weight))

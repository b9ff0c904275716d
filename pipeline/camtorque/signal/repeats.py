"""After how many revolutions a signal repeats: more than one where the pulses come from a faster shaft than the cam."""

from __future__ import annotations

import numpy as np

from camtorque.records import Array
from camtorque.signal.threshold import Count, Threshold

MOST_REVOLUTIONS = Count(8, "1", "convention", "Gears between a motor or crank and a pump are lower.")
UNLIKE = Threshold(
    0.1, "1", "simulated rigs",
    "Mean square difference of neighbouring revolutions, relative to that of two chance ones, above which they are "
    "not of one kind; cycles of sound pumps lie below 0.001."
)  # fmt: skip
ALIKE = Threshold(
    0.1, "1", "simulated rigs",
    "Part of that difference below which revolutions some turns apart are of one kind again."
)  # fmt: skip
LEAST_REPEATS = 2
"""Pairs of like revolutions that are needed."""
STRAY_PERCENT = (2.0, 98.0)
"""Percentiles of all samples beyond which a few are strays; what a pump does lasts longer."""


def repeats_every(rows: Array) -> int:
    """Return the number of revolutions after which a signal repeats, 1 where each is like the next or none is.

    Parameters
    ----------
    rows : (n_revolutions, n_points) the signal of successive revolutions; nan where there is none
    """
    rows = rows[:, np.isfinite(rows).any(axis=0)]
    whole = np.asarray(np.isfinite(rows).all(axis=1))
    if whole.sum() < 2 + LEAST_REPEATS or not rows.size:
        return 1
    rows = np.clip(rows, *np.percentile(rows[whole], STRAY_PERCENT))
    chance = 2.0 * float(np.mean(np.var(rows[whole], axis=1) + np.var(rows[whole].mean(axis=1))))

    def difference(apart: int) -> float:
        pairs = whole[apart:] & whole[:-apart]
        squares = np.mean((rows[apart:] - rows[:-apart])[pairs] ** 2, axis=1)
        return float(np.median(squares)) if squares.size >= LEAST_REPEATS else np.inf

    neighbours = difference(1)
    if not np.isfinite(neighbours) or neighbours < UNLIKE * chance:
        return 1
    apart = (n for n in range(2, MOST_REVOLUTIONS + 1) if difference(n) < ALIKE * neighbours)
    return next(apart, 1)

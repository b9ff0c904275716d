"""Single wrong points of a lift table: a slip of the pen, a burr under the stylus."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from camtorque.records import CamTable
from camtorque.units import DEGREE

ORDER = 6
"""Order of the differences, in which a smooth lift vanishes and one wrong point leaves a row of binomials."""
FINEST = 1.0e-7
"""An exact table is taken to be good to this [m]."""
LEAST = 10.0
"""A point counts when it is off by more than this many standard deviations of the rounding."""
LIKENESS = 0.95
"""Share of the local sixth differences that one wrong point has to explain; steep ends of flanks explain less."""


def outlying_points(table: CamTable) -> NDArray[np.int64]:
    """Return the indices of points that stick out of their neighbours, none for a table of uneven steps.

    Notes
    -----
    Around a point off by d, the differences of order 6 are ``d (1, -6, 15, -20, 15, -6, 1)``: d by least squares, and
    the share of the differences that it explains.
    """
    if table.theta.size < 4 * ORDER or np.ptp(np.diff(table.theta)) > 1e-3 * np.mean(np.diff(table.theta)):
        return np.empty(0, dtype=np.int64)
    pattern = np.array([(-1.0) ** k * math.comb(ORDER, k) for k in range(ORDER + 1)])
    half = ORDER // 2
    differences = sum(c * np.roll(table.lift, half - k) for k, c in enumerate(pattern))
    window = np.stack([np.roll(differences, half - k) for k in range(ORDER + 1)])
    size = pattern @ window / (pattern @ pattern)
    energy = np.sum(window**2, axis=0)
    explained = size**2 * (pattern @ pattern) / np.where(energy > 0.0, energy, 1.0)
    spread = max(table.resolution / np.sqrt(12.0), FINEST, 1.4826 * float(np.median(np.abs(size))))
    return np.flatnonzero((np.abs(size) > LEAST * spread) & (explained > LIKENESS))


def outliers_text(table: CamTable) -> tuple[str, str]:
    """Return which points of a lift table stick out, and where; empty where none does."""
    found = outlying_points(table)
    if not found.size:
        return "", ""
    where = ", ".join(f"{angle / DEGREE:g}" for angle in table.theta[found[:5]]) + " deg"
    return f"{found.size} point(s) of the lift table stick out of their neighbours, at {where}", where

"""Sub-sample time of an edge from the samples around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from pipeline.records import Array

POOLED_EDGES = 9
"""Plateaus are the running median over this many neighbouring edges: it follows slow drift."""


@dataclass(frozen=True)
class EdgeTimes:
    """Edges of one polarity found in one block.

    Attributes
    ----------
    position : (n,) sample index of the half-height crossing, with its fraction
    height : (n,) plateau to plateau [V]
    slope : (n,) [V per sample] at half height
    noise : (n,) standard deviation of the voltage on the plateaus [V]
    """

    position: Array
    height: Array
    slope: Array
    noise: Array


def refine_edges(windows: Array, before: NDArray[np.int64]) -> EdgeTimes:
    """Return half-height crossings of rising edges.

    Parameters
    ----------
    windows : (n, 2 k) samples around each edge, the edge between columns k - 1 and k [V]
    before : (n,) sample index of column k - 1

    Notes
    -----
    The first and last quarter of a window are plateau; linear interpolation between the two samples that straddle half
    height is exact on a linear flank and within dt^2 / (8 D) of a flank of duration D shorter than a sample.
    """
    n, width = windows.shape
    half, quarter = width // 2, max(1, width // 4)
    low, high = np.median(windows[:, :quarter], axis=1), np.median(windows[:, -quarter:], axis=1)
    noise = 0.5 * (np.std(windows[:, :quarter], axis=1) + np.std(windows[:, -quarter:], axis=1))
    pooled = min(POOLED_EDGES, n)
    low, high = median_filter(low, pooled, mode="nearest"), median_filter(high, pooled, mode="nearest")
    column = _crossing_column(windows, 0.5 * (low + high), half)
    rows = np.arange(n)
    left, right = windows[rows, column], windows[rows, column + 1]
    slope = right - left
    fraction = np.clip((0.5 * (low + high) - left) / np.where(slope > 0.0, slope, np.inf), 0.0, 1.0)
    return EdgeTimes(before - (half - 1) + column + fraction, high - low, slope, noise)


def _crossing_column(windows: Array, level: Array, half: int) -> NDArray[np.int64]:
    """Column before the crossing of ``level`` that is nearest to the middle."""
    crosses = (windows[:, :-1] < level[:, None]) & (windows[:, 1:] >= level[:, None])
    distance = np.abs(np.arange(windows.shape[1] - 1) - (half - 1))
    return np.argmin(np.where(crosses, distance, windows.shape[1]), axis=1)

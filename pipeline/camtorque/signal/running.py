"""Running medians and maxima over short windows, which shrink at the two ends."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from camtorque.records import Array


def running_median(values: Array, size: int) -> Array:
    """Return the median of ``size`` neighbours (odd) around each value; at the ends, of those that are there.

    A window that shrinks counts each value once: a first value that is odd does not become its own majority.
    """
    out, half, n = np.empty(values.size), size // 2, values.size
    if n >= size:
        out[half : n - half] = np.sort(sliding_window_view(values, size), axis=1)[:, half]
    for i in (*range(min(half, n)), *range(max(n - half, min(half, n)), n)):
        out[i] = np.median(values[max(0, i - half) : i + half + 1])
    return out


def running_maximum(values: Array, size: int) -> Array:
    """Return the largest of ``size`` neighbours (odd) around each value."""
    half = size // 2
    padded = np.pad(values, half, mode="edge")
    return np.max(sliding_window_view(padded, 2 * half + 1), axis=1)

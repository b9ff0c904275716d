"""Running medians and maxima over short windows, which shrink at the two ends."""

from __future__ import annotations

import numba
import numpy as np

from camtorque.records import Array


@numba.njit(cache=True, nogil=True)
def running_median(values: Array, size: int) -> Array:
    """Return the median of ``size`` neighbours (odd) around each value; at the ends, of those that are there.

    A window that shrinks counts each value once: a first value that is odd does not become its own majority.
    """
    out = np.empty(values.size)
    half, room = size // 2, np.empty(size)
    for i in range(values.size):
        count = 0
        for j in range(max(0, i - half), min(values.size, i + half + 1)):
            k = count
            while k > 0 and room[k - 1] > values[j]:
                room[k] = room[k - 1]
                k -= 1
            room[k] = values[j]
            count += 1
        out[i] = room[count // 2] if count % 2 else 0.5 * (room[count // 2 - 1] + room[count // 2])
    return out


def running_maximum(values: Array, size: int) -> Array:
    """Return the largest of ``size`` neighbours (odd) around each value."""
    half = size // 2
    padded = np.pad(values, half, mode="edge")
    return np.max(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)

"""Time samples -> uniform cam-angle grid, reading each sample once.

Anti-alias rule. Where samples lie finer than the grid (more than one sample per grid step) a grid value is the mean of
the linear interpolant over its grid step: the spectrum is multiplied by sinc(order / n_theta), 0.998 at order 130 of
3600. Where they lie coarser, nothing can alias and the value is a cubic through the four nearest samples.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from pipeline.records import Array

LINEAR, CUBIC, AVERAGE = 0, 1, 2
RULES = {"linear": LINEAR, "cubic": CUBIC, "average": AVERAGE}


@numba.njit(cache=True, nogil=True)
def hermite_slopes(angle: Array, time: Array, bad: NDArray[np.bool_], smooth: bool) -> tuple[Array, Array]:
    """Slopes dt/dtheta at the left and right end of each interval between pulses.

    Smooth: the slope at a pulse is the harmonic mean of the neighbouring ones, which keeps time monotone
    (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5, 1984); constant: the chord. A bad interval (gap, clock jump)
    tells nothing about its neighbours.
    """
    n = angle.size - 1
    chord = np.empty(n)
    for i in range(n):
        chord[i] = (time[i + 1] - time[i]) / (angle[i + 1] - angle[i])
    left, right = chord.copy(), chord.copy()
    if smooth:
        for i in range(1, n):
            if bad[i - 1] or bad[i]:
                continue
            h0, h1 = angle[i] - angle[i - 1], angle[i + 1] - angle[i]
            w0, w1 = 2.0 * h1 + h0, h1 + 2.0 * h0
            slope = (w0 + w1) / (w0 / chord[i - 1] + w1 / chord[i])
            right[i - 1], left[i] = slope, slope
    return left, right


@numba.njit(cache=True, nogil=True)
def cycle_times(angle: Array, time: Array, left: Array, right: Array, start: float, step: float, out: Array) -> None:
    """Fill ``out`` with the times of the angles ``start + k step``; straight lines beyond the first and last pulse."""
    last = angle.size - 2
    i = min(max(int(np.searchsorted(angle, start)) - 1, 0), last)
    for k in range(out.size):
        theta = start + k * step
        while i < last and theta > angle[i + 1]:
            i += 1
        h = angle[i + 1] - angle[i]
        u = (theta - angle[i]) / h
        if u <= 0.0:
            out[k] = time[i] + left[i] * (theta - angle[i])
        elif u >= 1.0:
            out[k] = time[i + 1] + right[i] * (theta - angle[i + 1])
        else:
            v = 1.0 - u
            out[k] = (
                (1.0 + 2.0 * u) * v * v * time[i]
                + u * v * v * h * left[i]
                + u * u * (3.0 - 2.0 * u) * time[i + 1]
                - u * u * v * h * right[i]
            )


@numba.njit(cache=True, nogil=True)
def resample_row(volts: Array, position: Array, rule: int, gain: float, zero: float, out: Array) -> None:
    """Fill one cycle: ``position`` (n + 2,) are sample positions of the grid, one step more at either end."""
    for k in range(out.size):
        x = position[k + 1]
        if rule == 2:
            value = _mean_between(volts, 0.5 * (position[k] + x), 0.5 * (x + position[k + 2]))
        else:
            i = int(x)
            f = x - i
            if rule == 1 and 1 <= i < volts.size - 2:
                value = _cubic(volts[i - 1], volts[i], volts[i + 1], volts[i + 2], f)
            else:
                i = min(i, volts.size - 2)
                f = x - i
                value = volts[i] + f * (volts[i + 1] - volts[i])
        out[k] = gain * (value - zero)


@numba.njit(cache=True, nogil=True, inline="always")
def _cubic(a: float, b: float, c: float, d: float, f: float) -> float:
    """Lagrange cubic through samples at -1, 0, 1, 2."""
    g, m, p = 1.0 - f, f + 1.0, 2.0 - f
    return f * g * (-p * a - m * d) / 6.0 + m * p * (g * b + f * c) / 2.0


@numba.njit(cache=True, nogil=True)
def _mean_between(volts: Array, begin: float, end: float) -> float:
    """Mean of the linear interpolant between two sample positions."""
    i, j = int(begin), int(end)
    j = min(j, volts.size - 2)
    total = _integral_to(volts, j, end - j) - _integral_to(volts, i, begin - i)
    for k in range(i, j):
        total += 0.5 * (volts[k] + volts[k + 1])
    return total / (end - begin)


@numba.njit(cache=True, nogil=True, inline="always")
def _integral_to(volts: Array, i: int, f: float) -> float:
    return f * volts[i] + 0.5 * f * f * (volts[i + 1] - volts[i])


def choose_rule(interpolation: str, samples_per_step: float) -> int:
    """Return the rule of the module text for a channel."""
    if interpolation == "auto":
        return AVERAGE if samples_per_step > 1.0 else CUBIC
    return RULES[interpolation]


def empty_rows(n_rows: int, n_theta: int, path: str | None) -> NDArray[np.float64]:
    """Return room for aligned cycles, in memory or on disk."""
    if path is None or not n_rows:
        return np.empty((n_rows, n_theta))
    return np.lib.format.open_memmap(path, mode="w+", dtype=np.float64, shape=(n_rows, n_theta))

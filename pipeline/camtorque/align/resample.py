"""Time samples -> uniform cam-angle grid, reading each sample once.

Anti-alias rule. Where samples lie finer than the grid (more than one sample per grid step) a grid value is the mean of
the linear interpolant over its grid step: the spectrum is multiplied by sinc(order / n_theta), 0.998 at order 130 of
3600. Where they lie coarser, nothing can alias and the value is a cubic through the four nearest samples.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from camtorque.records import Array
from camtorque.signal.damage import damage_of

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
def interval_polynomials(angle: Array, time: Array, left: Array, right: Array) -> Array:
    """Return (n - 1, 4) coefficients of the time in powers of the angle since the interval's first pulse."""
    coefficients = np.empty((angle.size - 1, 4))
    for i in range(angle.size - 1):
        h = angle[i + 1] - angle[i]
        chord = (time[i + 1] - time[i]) / h
        coefficients[i, 0] = time[i]
        coefficients[i, 1] = left[i]
        coefficients[i, 2] = (3.0 * chord - 2.0 * left[i] - right[i]) / h
        coefficients[i, 3] = (left[i] + right[i] - 2.0 * chord) / (h * h)
    return coefficients


@numba.njit(cache=True, nogil=True)
def fill_times(angle: Array, polynomials: Array, start: float, step: float, out: Array) -> None:
    """Fill ``out`` with the times of the angles ``start + k step``; straight lines beyond the first and last pulse."""
    last = angle.size - 2
    k = _fill_until(angle[0], start, step, 0, angle[0], polynomials[0, 0], polynomials[0, 1], 0.0, 0.0, out)
    i = min(max(int(np.searchsorted(angle, start)) - 1, 0), last)
    while k < out.size and i <= last:
        a, b, c, d = polynomials[i, 0], polynomials[i, 1], polynomials[i, 2], polynomials[i, 3]
        k = _fill_until(angle[i + 1], start, step, k, angle[i], a, b, c, d, out)
        i += 1
    if k < out.size:
        a, b, c, d = polynomials[last, 0], polynomials[last, 1], polynomials[last, 2], polynomials[last, 3]
        h = angle[last + 1] - angle[last]
        end, slope = a + h * (b + h * (c + h * d)), b + h * (2.0 * c + h * 3.0 * d)
        _fill_until(np.inf, start, step, k, angle[last + 1], end, slope, 0.0, 0.0, out)


@numba.njit(cache=True, nogil=True)
def _fill_until(border, start, step, k, origin, a, b, c, d, out):  # type: ignore[no-untyped-def]
    """Fill a stretch with one polynomial up to an angle; return where it ends. No branch inside the loop."""
    end = out.size
    if border < start + end * step:
        end = min(end, max(k, int(np.ceil((border - start) / step))))
    for m in range(k, end):
        u = start + m * step - origin
        out[m] = a + u * (b + u * (c + u * d))
    return end


@numba.njit(cache=True, nogil=True)
def align_block(volts, rate, shift, cycles, angle, polynomials, rule, gain, zero, limits, rows, damage, extremes):  # type: ignore[no-untyped-def]
    """Resample consecutive cycles from one block of samples, and count their damage by the rules of `signal.damage`.

    Sample position = rate x time + shift (one shift per cycle). ``rows`` (m, n_theta), ``damage`` (m, 5: that of
    `damage_of`, and the samples in all) and ``extremes`` (m, 2: smallest, largest value) are filled.
    """
    n_theta = rows.shape[1]
    step = 2.0 * np.pi / n_theta
    position = np.empty(n_theta + 2)
    for m in range(cycles.size):
        fill_times(angle, polynomials, cycles[m] * 2.0 * np.pi - step, step, position)
        for k in range(position.size):
            position[k] = max(0.0, min(rate * position[k] + shift[m], volts.size - 1.000001))
        row = rows[m]
        if rule == AVERAGE:
            _average_row(volts, position, row)
        else:
            _interpolate_row(volts, position, rule, row)
        smallest, largest = np.inf, -np.inf
        for k in range(n_theta):
            value = gain * (row[k] - zero)
            row[k] = value
            smallest = min(smallest, value)
            largest = max(largest, value)
        extremes[m, 0], extremes[m, 1] = smallest, largest
        inside = volts[int(position[1]) : int(position[-1]) + 1]
        damage[m, 0], damage[m, 1], damage[m, 2], damage[m, 3] = damage_of(inside, limits[0], limits[1])
        damage[m, 4] = inside.size


@numba.njit(cache=True, nogil=True)
def _average_row(volts: Array, position: Array, row: Array) -> None:
    """Mean of the linear interpolant over each grid step; the border of two steps is looked up once."""
    border = 0.5 * (position[0] + position[1])
    i = int(border)
    f = border - i
    before = f * volts[i] + 0.5 * f * f * (volts[i + 1] - volts[i])
    for k in range(row.size):
        end = 0.5 * (position[k + 1] + position[k + 2])
        j = int(end)
        total = -before
        if j > i:
            total += 0.5 * (volts[i] + volts[j])
        for m in range(i + 1, j):
            total += volts[m]
        f = end - j
        before = f * volts[j] + 0.5 * f * f * (volts[j + 1] - volts[j])
        row[k] = (total + before) / (end - border) if end > border else volts[j]
        border, i = end, j


@numba.njit(cache=True, nogil=True)
def _interpolate_row(volts: Array, position: Array, rule: int, row: Array) -> None:
    for k in range(row.size):
        x = position[k + 1]
        i = int(x)
        f = x - i
        if rule == CUBIC and 1 <= i < volts.size - 2:
            row[k] = _cubic(volts[i - 1], volts[i], volts[i + 1], volts[i + 2], f)
        else:
            row[k] = volts[i] + f * (volts[i + 1] - volts[i])


@numba.njit(cache=True, nogil=True, inline="always")
def _cubic(a: float, b: float, c: float, d: float, f: float) -> float:
    """Lagrange cubic through samples at -1, 0, 1, 2."""
    g, m, p = 1.0 - f, f + 1.0, 2.0 - f
    return f * g * (-p * a - m * d) / 6.0 + m * p * (g * b + f * c) / 2.0


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

"""The pass of `camtorque.align.resample` over long channels, compiled: same rule, same numbers but for rounding."""

from __future__ import annotations

import numpy as np

from camtorque.align.options import AVERAGE, CUBIC
from camtorque.compiled import njit
from camtorque.records import Array


@njit(cache=True, nogil=True)
def resample_block(volts, rate, shift, cycles, angle, polynomials, rule, rows):  # type: ignore[no-untyped-def]
    """Resample consecutive cycles from one block of samples; see `camtorque.align.resample.resample_block`."""
    n_theta = rows.shape[1]
    step = 2.0 * np.pi / n_theta
    position = np.empty(n_theta + 2)
    for m in range(cycles.size):
        fill_times(angle, polynomials, cycles[m] * 2.0 * np.pi - step, step, position)
        for k in range(position.size):
            position[k] = max(0.0, min(rate * position[k] + shift[m], volts.size - 1.000001))
        if rule == AVERAGE:
            _average_row(volts, position, rows[m])
        else:
            _interpolate_row(volts, position, rule, rows[m])


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _fill_until(border, start, step, k, origin, a, b, c, d, out):  # type: ignore[no-untyped-def]
    """Fill a stretch with one polynomial up to an angle; return where it ends. No branch inside the loop."""
    end = out.size
    if border < start + end * step:
        end = min(end, max(k, int(np.ceil((border - start) / step))))
    for m in range(k, end):
        u = start + m * step - origin
        out[m] = a + u * (b + u * (c + u * d))
    return end


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _interpolate_row(volts: Array, position: Array, rule: int, row: Array) -> None:
    for k in range(row.size):
        x = position[k + 1]
        i = int(x)
        f = x - i
        if rule == CUBIC and 1 <= i < volts.size - 2:
            row[k] = _cubic(volts[i - 1], volts[i], volts[i + 1], volts[i + 2], f)
        else:
            row[k] = volts[i] + f * (volts[i + 1] - volts[i])


@njit(cache=True, nogil=True, inline="always")
def _cubic(a: float, b: float, c: float, d: float, f: float) -> float:
    """Lagrange cubic through samples at -1, 0, 1, 2."""
    g, m, p = 1.0 - f, f + 1.0, 2.0 - f
    return f * g * (-p * a - m * d) / 6.0 + m * p * (g * b + f * c) / 2.0

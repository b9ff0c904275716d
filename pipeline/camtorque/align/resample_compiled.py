"""The pass of `camtorque.align.resample` over long channels, compiled: same rule, same numbers but for rounding."""

from __future__ import annotations

import numpy as np

from camtorque.align.options import AVERAGE, CUBIC
from camtorque.compiled import njit
from camtorque.records import Array

ONE = np.uint64(1)


@njit(cache=True, nogil=True)
def resample_block(volts, rate, shift, cycles, angle, polynomials, rule, law, rows):  # type: ignore[no-untyped-def]
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
        for k in range(n_theta):
            rows[m, k] = (rows[m, k] - law[0]) * law[1]


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
    """Mean of the linear interpolant over each grid step; the border of two steps is looked up once.

    Borders and quotients have loops of their own, which run several at a time.
    """
    border = 0.5 * (position[:-1] + position[1:])
    at = border.astype(np.uint64)  # no index from the end is looked for
    here, f = volts[at[0]], border[0] - at[0]
    before = f * here + 0.5 * f * f * (volts[at[0] + ONE] - here)
    for k in range(row.size):
        last = volts[at[k + 1]]
        total = -before
        if at[k + 1] > at[k]:
            total += 0.5 * (here + last)
        m = at[k] + ONE
        while m < at[k + 1]:
            total += volts[m]
            m += ONE
        f = border[k + 1] - at[k + 1]
        before = f * last + 0.5 * f * f * (volts[at[k + 1] + ONE] - last)
        row[k] = total + before if border[k + 1] > border[k] else last
        here = last
    for k in range(row.size):
        width = border[k + 1] - border[k]
        row[k] /= width if width > 0.0 else 1.0


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

"""Time samples -> uniform cam-angle grid, reading each sample once.

Anti-alias rule. Where samples lie finer than the grid (more than one sample per grid step) a grid value is the mean of
the linear interpolant over its grid step: the spectrum is multiplied by sinc(order / n_theta), 0.998 at order 130 of
3600. Where they lie coarser, nothing can alias and the value is a cubic through the four nearest samples.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from camtorque.align import resample_compiled
from camtorque.align.options import AVERAGE, CUBIC, RULES
from camtorque.records import Array, Mask


def hermite_slopes(angle: Array, time: Array, bad: Mask) -> tuple[Array, Array]:
    """Slopes dt/dtheta at the left and right end of each interval between pulses.

    The slope at a pulse is the harmonic mean of the neighbouring ones, which keeps time monotone (Fritsch and Butland,
    SIAM J. Sci. Stat. Comput. 5, 1984). A bad interval (gap, clock jump) tells nothing about its neighbours.
    """
    h = np.diff(angle)
    chord = np.diff(time) / h
    left, right = chord.copy(), chord.copy()
    before, after = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    slope = (before + after) / (before / chord[:-1] + after / chord[1:])
    fine = ~(bad[:-1] | bad[1:])
    right[:-1][fine], left[1:][fine] = slope[fine], slope[fine]
    return left, right


def interval_polynomials(angle: Array, time: Array, left: Array, right: Array) -> Array:
    """Return (n - 1, 4) coefficients of the time in powers of the angle since the interval's first pulse."""
    h = np.diff(angle)
    chord = np.diff(time) / h
    return np.column_stack(
        [time[:-1], left, (3.0 * chord - 2.0 * left - right) / h, (left + right - 2.0 * chord) / (h * h)]
    )


def times_at(angle: Array, polynomials: Array, wanted: NDArray[np.floating]) -> Array:
    """Return the times of unwrapped angles; straight lines go on beyond the first and last pulse."""
    interval = np.clip(np.searchsorted(angle, wanted, side="right") - 1, 0, angle.size - 2)
    u = wanted - angle[interval]
    inside = np.clip(u, 0.0, np.diff(angle)[interval])
    a, b, c, d = polynomials[interval].T
    time = a + inside * (b + inside * (c + inside * d))
    beyond = u - inside
    if np.any(beyond):
        time += beyond * (b + inside * (2.0 * c + inside * 3.0 * d))
    return time


def resampler(compiled: bool) -> Callable[..., None]:
    """Return `resample_block`, or the same compiled."""
    return resample_compiled.resample_block if compiled else resample_block


def resample_block(volts, rate, shift, cycles, angle, polynomials, rule, law, rows):  # type: ignore[no-untyped-def]
    """Resample consecutive cycles from one block of samples.

    Sample position = rate x time + shift (one shift per cycle). ``rows`` (m, n_theta) is filled; ``law`` are zero and
    gain of the samples.
    """
    n_theta = rows.shape[1]
    grid = (np.arange(-1, cycles.size * n_theta + 1) / n_theta + cycles[0]) * (2.0 * np.pi)
    first = min(max(int(np.searchsorted(angle, grid[0], side="right")) - 1, 0), angle.size - 2)
    last = min(max(int(np.searchsorted(angle, grid[-1])), first + 1), angle.size - 1)
    time = times_at(angle[first : last + 1], polynomials[first:last], grid)
    # each row takes the step before it and the step after it along
    position = rate * sliding_window_view(time, n_theta + 2)[::n_theta] + shift[:, None]
    np.clip(position, 0.0, volts.size - 1.000001, out=position)
    rows[:] = _averages(volts, position) if rule == AVERAGE else _interpolated(volts, position[:, 1:-1], rule)
    zero, gain = law
    rows -= zero
    rows *= gain


def _averages(volts: Array, position: Array) -> Array:
    """Mean of the linear interpolant over each grid step."""
    border = 0.5 * (position[:, :-1] + position[:, 1:])
    at = border.astype(np.int64)
    f, here = border - at, volts[at]
    # integral from the middle of the sample before, but for whole samples, which are summed between two borders
    part = (f + 0.5) * here + 0.5 * f * f * (volts[at + 1] - here)
    whole = np.add.reduceat(volts, at.ravel()).reshape(at.shape)[:, :-1]
    area = np.where(at[:, 1:] > at[:, :-1], whole, 0.0) + part[:, 1:] - part[:, :-1]
    width = np.diff(border, axis=1)
    return np.where(width > 0.0, area / np.where(width > 0.0, width, 1.0), here[:, 1:])


def _interpolated(volts: Array, position: Array, rule: int) -> Array:
    """Return the line through the two samples around each position, or the cubic through four."""
    at = position.astype(np.int64)
    f, b, c = position - at, volts[at], volts[at + 1]
    if rule != CUBIC:
        return b + f * (c - b)
    a, d = volts[np.maximum(at - 1, 0)], volts[np.minimum(at + 2, volts.size - 1)]
    g, m, p = 1.0 - f, f + 1.0, 2.0 - f
    cubic = f * g * (-p * a - m * d) / 6.0 + m * p * (g * b + f * c) / 2.0
    return np.where((at >= 1) & (at < volts.size - 2), cubic, b + f * (c - b))


def choose_rule(interpolation: str, samples_per_step: float) -> int:
    """Return the rule of the module text for a channel."""
    if interpolation == "auto":
        return AVERAGE if samples_per_step > 1.0 else CUBIC
    return RULES[interpolation]

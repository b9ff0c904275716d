"""Half height and hysteresis of a pulse signal, window by window, whatever the speed, drift and fading."""

from __future__ import annotations

import numpy as np

from camtorque.records import Array, Integers
from camtorque.signal import passes_compiled
from camtorque.signal.damage import NO_VOLTAGE, count_missing
from camtorque.signal.running import median, percentile, running_maximum, running_median
from camtorque.signal.threshold import Threshold

HYSTERESIS = Threshold(
    0.25, "1", "convention", "Part of the pulse height above and below half height that a pulse has to pass."
)
FINE_SAMPLES = passes_compiled.WINDOW
"""Windows from which the distance of the pulses is estimated."""
CACHED_WINDOWS = 256
"""Fine windows worked on at a time: their samples stay in the processor's cache."""
LEAST_POOLED = 4
"""Fine windows in a level window, at least."""
WINDOW_PERIODS = 1.5
"""Length of a level window in usual distances of pulses: one whole pulse lies inside."""
USUAL_DISTANCE = 95.0
"""Percentile of the distances that counts as usual: the gap of a wheel belongs to it, one long standstill does not."""
LEAST_STARTS = 5
"""Pulses (one across the border of two fine windows counts twice) from which on their distance is taken."""
POOLED_WINDOWS = 5
"""A level follows the running median over this many windows: one disturbed window does not move it."""
NEIGHBOUR_WINDOWS = 9
"""Windows among which the highest pulse sets what counts as a pulse."""
NOISE_HEIGHTS = Threshold(
    12.0, "1", "statistics",
    "Pulses are higher than this many standard deviations of the noise, whose extremes span eight."
)  # fmt: skip
NOISE_PAIRS = 4096
"""Pairs of neighbouring samples of a block that the noise is taken from, at most."""


def looked_at(volts: Array, compiled: bool) -> tuple[Array, int, tuple[Array, Array]]:
    """Return the samples of a block, how many of them are no voltages (nan), and the extremes of its fine windows."""
    if compiled and volts.size > FINE_SAMPLES:
        samples, extremes = np.require(volts, np.float64, ["C", "W"]), np.empty((2, volts.size // FINE_SAMPLES))
        if not passes_compiled.plateaus(samples, float(NO_VOLTAGE), *extremes):
            return samples, 0, (extremes[0], extremes[1])
    volts, missing = without_missing(volts)
    return volts, missing, _fine_extremes(volts)


def level_windows(volts: Array, extremes: tuple[Array, Array], least: float) -> tuple[int, Array, Array]:
    """Return samples per window, half height and hysteresis of each window of a block [V].

    ``extremes`` are those of its fine windows. Pulses are higher than the noise and than ``least`` [V]. A window
    without one takes the level of its neighbours; without any pulse there is no level (nan).
    """
    least_height = max(least, NOISE_HEIGHTS * noise_of(volts))
    low, high = extremes
    pooled = _pooled_windows(low, high, least_height)
    starts = np.arange(0, max(1, low.size - pooled + 1), pooled)
    low, high = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
    level, margin = _levels(low, high, least_height)
    return pooled * FINE_SAMPLES, level, margin


def without_missing(volts: Array) -> tuple[Array, int]:
    """Return the samples with nan for those that are no voltages, and how many those are."""
    missing = count_missing(volts)
    return (np.where(np.abs(volts) < NO_VOLTAGE, volts, np.nan), missing) if missing else (volts, 0)


def noise_of(volts: Array) -> float:
    """Return the robust noise of the plateaus from the differences of neighbouring samples [V]."""
    stride = 2 * max(1, volts.size // (2 * NOISE_PAIRS))
    n = volts.size // stride
    differences = np.abs(volts[1 : n * stride : stride] - volts[: n * stride : stride])
    finite = differences[np.isfinite(differences)]
    return 1.4826 / np.sqrt(2.0) * median(finite) if finite.size else 0.0


def _pooled_windows(low: Array, high: Array, least_height: float) -> int:
    """Return how many fine windows make a level window, from the distances of the pulses themselves."""
    height = float(high.max() - low.min())
    if not height > least_height:
        return int(low.size)
    middle = 0.5 * (low.min() + high.max())
    starts = _rises(low, high, middle - HYSTERESIS * height, middle + HYSTERESIS * height)
    if starts.size < LEAST_STARTS:
        return int(low.size)
    distance = percentile(np.diff(starts), USUAL_DISTANCE)
    return int(np.clip(np.ceil(WINDOW_PERIODS * distance), LEAST_POOLED, low.size))


def _rises(low: Array, high: Array, lower: float, upper: float) -> Integers:
    """Return the fine windows in which the signal rises over the hysteresis; one that holds both levels does."""
    up, down = high > upper, (low < lower) & (high < upper)
    last = np.maximum.accumulate(np.where(up | down, np.arange(low.size), -1))
    before = np.r_[-1, last[:-1]]
    was_up = (before >= 0) & up[before]
    return np.flatnonzero(up & (~was_up | (low < lower)))


def _levels(low: Array, high: Array, least_height: float) -> tuple[Array, Array]:
    low, high = running_median(low, POOLED_WINDOWS), running_median(high, POOLED_WINDOWS)
    height = high - low
    sound = np.flatnonzero((height >= 0.5 * running_maximum(height, NEIGHBOUR_WINDOWS)) & (height > least_height))
    if not sound.size:
        return np.full(height.size, np.nan), np.zeros(height.size)
    windows = np.arange(height.size)
    level = np.interp(windows, sound, 0.5 * (low + high)[sound])
    return level, HYSTERESIS * np.interp(windows, sound, height[sound])


def _fine_extremes(volts: Array) -> tuple[Array, Array]:
    """Return smallest and largest value of each fine window, spikes of one sample left out."""
    n_windows = max(1, volts.size // FINE_SAMPLES)
    low, high = np.zeros(n_windows), np.zeros(n_windows)
    if volts.size < 2:
        return low, high
    whole = volts[: (n_windows - 1) * FINE_SAMPLES].reshape(-1, FINE_SAMPLES)
    for begin in range(0, n_windows - 1, CACHED_WINDOWS):
        part = slice(begin, min(begin + CACHED_WINDOWS, n_windows - 1))
        low[part], high[part] = _plateaus(whole[part])
    low[-1:], high[-1:] = _plateaus(volts[None, (n_windows - 1) * FINE_SAMPLES :])
    unknown = np.isnan(low)
    if unknown.any():  # without any voltage the window before goes on
        last = np.maximum.accumulate(np.where(unknown, -1, np.arange(n_windows)))
        low, high = np.where(last >= 0, low[last], 0.0), np.where(last >= 0, high[last], 0.0)
    return low, high


def _plateaus(windows: Array) -> tuple[Array, Array]:
    """Return the extremes of each row, nan where it holds no voltage.

    The lower (higher) of two neighbours counts: a spike of one sample is no plateau.
    """
    volts, lower, higher = windows.ravel(), np.empty(windows.shape), np.empty(windows.shape)
    np.minimum(volts[1:], volts[:-1], out=lower.ravel()[:-1])
    np.maximum(volts[1:], volts[:-1], out=higher.ravel()[:-1])
    lower[:, -1], higher[:, -1] = -np.inf, np.inf  # pairs across two windows
    # twice as fast as extremes along an axis: rows are short
    rows = np.arange(0, volts.size, windows.shape[1])
    low, high = np.minimum.reduceat(higher.ravel(), rows), np.maximum.reduceat(lower.ravel(), rows)
    some = np.isnan(low)
    if some.any():
        low[some] = np.fmin.reduce(higher[some, :-1], axis=1)
        high[some] = np.fmax.reduce(lower[some, :-1], axis=1)
    return low, high

"""Half height and hysteresis of a pulse signal, window by window, whatever the speed, drift and fading."""

from __future__ import annotations

import numba
import numpy as np

from camtorque.records import Array
from camtorque.signal.damage import NO_VOLTAGE
from camtorque.signal.running import running_maximum, running_median
from camtorque.signal.threshold import Threshold

HYSTERESIS = Threshold(
    0.25, "1", "convention",
    "Part of the pulse height above and below half height that a pulse has to pass."
)  # fmt: skip
FINE_SAMPLES = 64
"""Windows from which the distance of the pulses is estimated."""
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


def level_windows(volts: Array, least: float = 0.0) -> tuple[int, Array, Array]:
    """Return samples per window, half height and hysteresis of each window of a block [V].

    Pulses are higher than the noise and than ``least`` [V]. A window without one takes the level of its neighbours;
    without any pulse there is no level (nan).
    """
    least_height = max(least, NOISE_HEIGHTS * noise_of(volts))
    low, high = _fine_extremes(volts)
    pooled = _pooled_windows(low, high, least_height)
    starts = np.arange(0, max(1, low.size - pooled + 1), pooled)
    low, high = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
    level, margin = _levels(low, high, least_height)
    return pooled * FINE_SAMPLES, level, margin


def without_missing(volts: Array) -> tuple[Array, int]:
    """Return the samples with nan for those that are no voltages, and how many those are."""
    missing = _count_missing(volts)
    return (np.where(np.abs(volts) < NO_VOLTAGE, volts, np.nan), missing) if missing else (volts, 0)


def noise_of(volts: Array) -> float:
    """Return the robust noise of the plateaus from the differences of neighbouring samples [V]."""
    stride = 2 * max(1, volts.size // (2 * NOISE_PAIRS))
    n = volts.size // stride
    differences = np.abs(volts[1 : n * stride : stride] - volts[: n * stride : stride])
    finite = differences[np.isfinite(differences)]
    return 1.4826 / np.sqrt(2.0) * float(np.median(finite)) if finite.size else 0.0


def _pooled_windows(low: Array, high: Array, least_height: float) -> int:
    """Return how many fine windows make a level window, from the distances of the pulses themselves."""
    height = float(high.max() - low.min())
    if not height > least_height:
        return int(low.size)
    middle = 0.5 * (low.min() + high.max())
    starts = _rises(low, high, middle - HYSTERESIS * height, middle + HYSTERESIS * height)
    if starts.size < LEAST_STARTS:
        return int(low.size)
    distance = float(np.percentile(np.diff(starts), USUAL_DISTANCE))
    return int(np.clip(np.ceil(WINDOW_PERIODS * distance), LEAST_POOLED, low.size))


@numba.njit(cache=True, nogil=True)
def _rises(low: Array, high: Array, lower: float, upper: float) -> Array:
    """Return the fine windows in which the signal rises over the hysteresis; one that holds both levels does."""
    out, count, state = np.empty(low.size), 0, 0
    for w in range(low.size):
        if high[w] > upper and (state == 0 or low[w] < lower):
            out[count] = w
            count, state = count + 1, 1
        if low[w] < lower and high[w] < upper:
            state = 0
    return out[:count]


def _levels(low: Array, high: Array, least_height: float) -> tuple[Array, Array]:
    low, high = running_median(low, POOLED_WINDOWS), running_median(high, POOLED_WINDOWS)
    height = high - low
    sound = np.flatnonzero((height >= 0.5 * running_maximum(height, NEIGHBOUR_WINDOWS)) & (height > least_height))
    if not sound.size:
        return np.full(height.size, np.nan), np.zeros(height.size)
    windows = np.arange(height.size)
    level = np.interp(windows, sound, 0.5 * (low + high)[sound])
    return level, HYSTERESIS * np.interp(windows, sound, height[sound])


@numba.njit(cache=True, nogil=True)
def _fine_extremes(volts: Array) -> tuple[Array, Array]:
    """Return smallest and largest value of each fine window, spikes of one sample left out."""
    n_windows = max(1, volts.size // FINE_SAMPLES)
    low, high = np.empty(n_windows), np.empty(n_windows)
    for w in range(n_windows):
        stop = volts.size if w == n_windows - 1 else (w + 1) * FINE_SAMPLES
        smallest, largest = np.inf, -np.inf
        for i in range(w * FINE_SAMPLES + 1, stop):
            # The lower (higher) of two neighbours: a spike of one sample is no plateau.
            lower, higher = min(volts[i - 1], volts[i]), max(volts[i - 1], volts[i])
            smallest = higher if higher < smallest else smallest
            largest = lower if lower > largest else largest
        # Without any voltage the window before goes on.
        known = largest >= smallest
        low[w] = smallest if known else (low[w - 1] if w else 0.0)
        high[w] = largest if known else (high[w - 1] if w else 0.0)
    return low, high


@numba.njit(cache=True, nogil=True)
def _count_missing(volts: Array) -> int:
    count = 0
    for value in volts:
        count += not (-NO_VOLTAGE < value < NO_VOLTAGE)
    return count

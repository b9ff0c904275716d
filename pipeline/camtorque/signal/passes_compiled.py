"""Passes over the samples of long channels, compiled: what they find is the same bit for bit as in plain numpy."""

from __future__ import annotations

import numpy as np

from camtorque.compiled import njit
from camtorque.records import Array

WINDOW, LANES = 64, 16
"""Samples of a window of `plateaus`; pairs that are compared at a time."""


@njit(cache=True, nogil=True)
def plateaus(volts: Array, no_voltage: float, low: Array, high: Array) -> int:
    """Fill in the extremes of each window, see `signal.levels`; return how many samples are no voltages.

    Where there are any, the extremes mean nothing: they are taken as if every sample was a number. The last window
    holds all samples that remain.
    """
    missing, last, lower, higher = 0, low.size - 1, np.empty(LANES), np.empty(LANES)
    for i in range(volts.size - last * WINDOW):
        missing += not abs(volts[last * WINDOW + i]) < no_voltage
    for k in range(last):
        window = volts[k * WINDOW : (k + 1) * WINDOW]
        for i in range(WINDOW):
            missing += not abs(window[i]) < no_voltage
        low[k], high[k] = _extremes_of_window(window, lower, higher)
    low[last], high[last] = _extremes(volts[last * WINDOW :])
    return missing


@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def _extremes_of_window(window: Array, lower: Array, higher: Array) -> tuple[float, float]:
    """Return what `_extremes` does, of a window as long as they are all: four pairs in each lane, one of them twice."""
    for i in range(LANES):
        a, b, c, d = window[i], window[i + 16], window[i + 32], window[i + 47]
        e, f, g, h = window[i + 1], window[i + 17], window[i + 33], window[i + 48]
        lower[i] = min(min(max(a, e), max(b, f)), min(max(c, g), max(d, h)))
        higher[i] = max(max(min(a, e), min(b, f)), max(min(c, g), min(d, h)))
    for half in (8, 4, 2, 1):
        for i in range(half):
            lower[i] = min(lower[i], lower[i + half])
            higher[i] = max(higher[i], higher[i + half])
    return lower[0], higher[0]


@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def _extremes(window: Array) -> tuple[float, float]:
    """Return the lowest higher one and the highest lower one of two neighbours."""
    low, high = np.inf, -np.inf
    for i in range(window.size - 1):
        low = min(low, max(window[i], window[i + 1]))
        high = max(high, min(window[i], window[i + 1]))
    return low, high


PART = 64
"""Samples that are counted first: where all or none of them lie beyond a band, none is looked at by itself."""


@njit(cache=True, nogil=True)
def transitions(  # type: ignore[no-untyped-def]
    volts, inside, bands
):
    """Return where the signal comes to lie beyond a band, and whether above it; see `signal.edges`."""
    begin, stop = inside
    window, lower, upper = bands
    places, rising, count = np.empty(stop - begin, dtype=np.int64), np.empty(stop - begin, dtype=np.bool_), 0
    above = below = False
    for k in range(lower.size):
        end = stop if k == lower.size - 1 else min((k + 1) * window, stop)
        for first in range(max(begin, k * window), end, PART):
            last = min(first + PART, end)
            n_above, n_below = _counts(volts[first:last], lower[k], upper[k])
            if n_above in (0, last - first) and n_below in (0, last - first):
                if (n_above and not above) or (n_below and not below):
                    places[count], rising[count] = first, n_above > 0
                    count += 1
                above, below = n_above > 0, n_below > 0
                continue
            for i in range(first, last):
                now_above, now_below = volts[i] > upper[k], volts[i] < lower[k]
                if (now_above and not above) or (now_below and not below):
                    places[count], rising[count] = i, now_above
                    count += 1
                above, below = now_above, now_below
    return places[:count].copy(), rising[:count].copy()


@njit(cache=True, nogil=True)
def _counts(volts: Array, lower: float, upper: float) -> tuple[int, int]:
    """Return how many samples lie above and how many below a band."""
    above = below = 0
    for i in range(volts.size):
        above += volts[i] > upper
        below += volts[i] < lower
    return above, below


@njit(cache=True, nogil=True)
def damage_counts(  # type: ignore[no-untyped-def]
    volts, ends, limits, no_voltage, counts
):
    """Fill in what is counted of each stretch of samples, the last of its ``ends`` (2, m) included.

    ``counts`` (m, 5): samples at or beyond the limits, samples that are no voltages, samples that equal the one before,
    samples that equal the two before, samples in all.
    """
    for k in range(counts.shape[0]):
        inside = volts[ends[0, k] : ends[1, k] + 1]
        counts[k, 0], counts[k, 1] = _beyond(inside, limits[0], limits[1], no_voltage)
        counts[k, 2], counts[k, 3] = _repeated(inside)
        counts[k, 4] = inside.size


@njit(cache=True, nogil=True)
def _beyond(volts: Array, lowest: float, highest: float, no_voltage: float) -> tuple[int, int]:
    """Return how many samples lie at or beyond the limits, and how many are no voltages."""
    clipped = voltages = 0
    for i in range(volts.size):
        clipped += (volts[i] <= lowest) | (volts[i] >= highest)
        voltages += abs(volts[i]) < no_voltage
    return clipped, volts.size - voltages


@njit(cache=True, nogil=True)
def _repeated(volts: Array) -> tuple[int, int]:
    """Return how many samples equal the one before, and how many the two before."""
    pairs = threes = 0
    here, before, first = volts[2:], volts[1:-1], volts[:-2]
    for i in range(first.size):
        pairs += before[i] == first[i]
        threes += (before[i] == first[i]) & (here[i] == before[i])
    if volts.size > 1:
        pairs += volts[-1] == volts[-2]
    return pairs, threes


BENT, REACH = 1024, 3
"""Samples whose bends are worked on at a time (they stay in the innermost cache), and those on either side of one that
it is compared with."""
LOOSELY = 1.0 + 1e-6
"""So much beyond a limit nothing lies within it by rounding."""


@njit(cache=True, nogil=True)
def may_be_isolated(volts: Array, times_median: float, times_beside: float, apart: float) -> bool:
    """Tell whether a block may hold isolated samples: `signal.damage` looks closer then, and most blocks hold none.

    The largest bend of that shape is no more than ``times_median`` the median where half of all reach that part of it.
    """
    largest, bends = 0.0, np.empty(BENT + 2 * REACH)
    for first in range(1, volts.size - 1 - 2 * REACH, BENT):
        part = bends[: min(bends.size, volts.size - 1 - first)]
        _fill_bends(volts[first - 1 : first + 1 + part.size], part)
        largest = _largest_lone(part, LOOSELY / times_beside, LOOSELY * apart, largest)
    return largest > 0.0 and not _reached_by_half(volts, LOOSELY * largest / times_median)


@njit(cache=True, nogil=True)
def _fill_bends(volts: Array, bends: Array) -> None:
    """Fill in by how much each sample but the first and the last is off the middle of its neighbours."""
    before, here, after = volts[:-2], volts[1:-1], volts[2:]
    for i in range(bends.size):
        bends[i] = here[i] - 0.5 * (before[i] + after[i])


@njit(cache=True, nogil=True)
def _largest_lone(bends, share, apart, largest):  # type: ignore[no-untyped-def]
    """Return the largest bend between two of half its size, beyond which none reaches ``share`` of it.

    ``largest`` is that so far, 0 for none; few parts of a block hold a larger one.
    """
    a, b, c, here, d, e, f = bends[:-6], bends[1:-5], bends[2:-4], bends[3:-3], bends[4:-2], bends[5:-1], bends[6:]
    count = 0
    for i in range(here.size):  # no branch: several at a time
        count += _is_lone(a[i], b[i], c[i], here[i], d[i], e[i], f[i], share, apart) & (abs(here[i]) > largest)
    for i in range(here.size if count else 0):
        if _is_lone(a[i], b[i], c[i], here[i], d[i], e[i], f[i], share, apart):
            largest = max(largest, abs(here[i]))
    return largest


@njit(cache=True, nogil=True)
def _is_lone(a, b, c, here, d, e, f, share, apart):  # type: ignore[no-untyped-def]
    half, close, low = 0.5 * here, apart * abs(here), share * abs(here)
    alike = (abs(c + half) < close) & (abs(d + half) < close)
    return alike & (abs(a) < low) & (abs(b) < low) & (abs(e) < low) & (abs(f) < low)


@njit(cache=True, nogil=True)
def _reached_by_half(volts: Array, limit: float) -> bool:
    """Tell whether at least half of the bends of a block, nil at its ends, reach a limit."""
    below, reached = 2, 0
    before, here, after = volts[:-2], volts[1:-1], volts[2:]
    for i in range(here.size):
        size = abs(here[i] - 0.5 * (before[i] + after[i]))
        below += size < limit
        reached += size >= limit
    return below < reached - 1

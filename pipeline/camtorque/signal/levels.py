"""Half height and hysteresis of a pulse signal, window by window, and from that the sub-sample time of its edges.

Neither speed nor drift nor fading matters.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from camtorque.records import Array, Integers, Mask
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
FLANK_STEP = Threshold(
    0.5, "1", "simulated rigs", "Share of the largest difference of neighbouring samples beyond which one is a flank's."
)
NOT_NOISE = Threshold(
    7.0, "1", "statistics",
    "Largest difference of neighbouring samples over the noise from which on flanks are among them: of 4096 of noise "
    "alone it is 6."
)  # fmt: skip
POOLED_EDGES = 9
"""Plateaus are the running median over this many neighbouring edges: it follows slow drift."""
FLANK = (0.05, 0.95)
"""Heights between which a sample counts as lying on the flank."""
SHORT_FLANK = Threshold(
    3.0, "samples", "statistics",
    "A flank of fewer samples is fitted as a ramp; on a longer one linear interpolation is as good."
)  # fmt: skip
LEAST_PAIRS = 5
LEAST_FOR_DENSITY = 30
SAME_DURATION = Threshold(
    0.1, "1", "simulated rigs",
    "Relative spread of the flank's duration over the edges beyond which it is no property of the sensor."
)  # fmt: skip
STEEPEST = 1.0e-3
"""Duration of the flank of a logic-level log, which has no sample on any [samples]."""
RECTANGULAR = 1.0 / np.sqrt(12.0)
"""Standard deviation of an edge that lies anywhere between two samples [samples]."""


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
    """Return the robust noise of the plateaus from the differences of neighbouring samples [V].

    Those beyond half of the largest are flanks: of an encoder with nine samples a line they are as many as the others.
    """
    stride = 2 * max(1, volts.size // (2 * NOISE_PAIRS))
    n = volts.size // stride
    differences = np.abs(volts[1 : n * stride : stride] - volts[: n * stride : stride])
    finite = differences[np.isfinite(differences)]
    largest = float(np.max(finite, initial=0.0))
    small = finite[finite <= FLANK_STEP * largest]
    noise = _spread(small)
    # the largest differences of noise alone are no flanks: without them it would be a tenth smaller than it is
    return noise if largest >= NOT_NOISE * noise else _spread(finite)


def _spread(differences: Array) -> float:
    """Return the noise behind differences of neighbouring samples [V], 0 without any."""
    return 1.4826 / np.sqrt(2.0) * median(differences) if differences.size else 0.0


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


@dataclass(frozen=True)
class EdgeSamples:
    """Edges of one polarity, as few samples as their times need; flanks turned so that all rise.

    Attributes
    ----------
    before : (n,) sample index before the half-height crossing
    near : (n, 4) the two samples on either side of the crossing, as parts of the height
    height : (n,) plateau to plateau [V]
    noise : (n,) standard deviation of the voltage on the plateaus [V]
    own_height : (n,) the same height from this edge alone [V]
    """

    before: Integers
    near: Array
    height: Array
    noise: Array
    own_height: Array


def edge_samples(windows: Array, before: Integers) -> EdgeSamples:
    """Normalise rising edges by the plateaus on their two sides, the first and last quarter of their ``windows``.

    These are (n, 2 k) samples around each edge [V], the edge between columns k - 1 and k; ``before`` (n,) is the sample
    index of column k - 1.
    """
    n, width = windows.shape
    if not n:
        return EdgeSamples(before, np.empty((0, 4)), np.empty(0), np.empty(0), np.empty(0))
    half, quarter = width // 2, max(1, width // 4)
    low, high = np.median(windows[:, :quarter], axis=1), np.median(windows[:, -quarter:], axis=1)
    noise = 0.5 * (np.std(windows[:, :quarter], axis=1) + np.std(windows[:, -quarter:], axis=1))
    own = high - low
    low, high = running_median(low, POOLED_EDGES), running_median(high, POOLED_EDGES)
    height = high - low
    part = (windows - low[:, None]) / np.where(height > 0.0, height, 1.0)[:, None]
    # the crossing of half height that is nearest to the middle, and two samples on either side of it
    crosses = (part[:, :-1] < 0.5) & (part[:, 1:] >= 0.5)
    column = np.argmin(np.where(crosses, np.abs(np.arange(width - 1) - (half - 1)), width), axis=1)
    near = part[np.arange(n)[:, None], np.clip(column[:, None] + np.arange(-1, 3), 0, width - 1)]
    return EdgeSamples(before - (half - 1) + column, near, height, noise, own)


def joined(parts: list[EdgeSamples]) -> EdgeSamples:
    """Return the edges of all blocks."""
    return EdgeSamples(*(np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(EdgeSamples)))


@dataclass(frozen=True)
class Crossings:
    """Half-height crossings (n,) [samples], with their fraction; slope of the flank [heights per sample].

    ``blur`` is the standard error from the samples being too few to see the flank [samples].
    """

    position: Array
    slope: float
    blur: float


def crossings(edges: EdgeSamples) -> Crossings:
    """Return the half-height crossings of the edges.

    Linear interpolation between the two samples that straddle half height is exact while both lie on a straight flank;
    where the flank is so short that one of them lies on a plateau it is wrong by up to 1 / (8 D) samples, and the
    crossing is found from the flank's duration D instead. An edge without any sample on its flank lies anywhere within
    the 1 - D samples that are left. A logic-level log has no samples on any flank: its edges are known to one sample.
    """
    slope = np.maximum(edges.near[:, 2] - edges.near[:, 1], 1e-9)
    linear = np.clip((0.5 - edges.near[:, 1]) / slope, 0.0, 1.0)
    duration, duration_std = _flank_duration(edges.near)
    unseen = float(np.mean(~_on_flank(edges.near).any(axis=1)))
    if duration < SHORT_FLANK:
        # a sample at height h puts the crossing h - 1/2 durations away: rms 1 / sqrt(12) over a flank
        blur = RECTANGULAR * np.hypot(np.sqrt(unseen) * max(0.0, 1.0 - duration), duration_std)
        return Crossings(edges.before + _ramp_crossing(edges.near, linear, duration), 1.0 / duration, float(blur))
    usual = float(np.median(slope))
    line_error = usual / 8.0 if usual > 1.0 / SHORT_FLANK else 0.0
    # too few edges to tell the duration: those that show no sample on their flank lie anywhere between two
    return Crossings(edges.before + linear, usual, max(line_error, RECTANGULAR * np.sqrt(unseen)))


def _on_flank(near: Array) -> Mask:
    return (near > FLANK[0]) & (near < FLANK[1])


def _flank_duration(near: Array) -> tuple[float, float]:
    """Return the duration of the whole flank and its standard error in samples, inf where it is not known or not short.

    Two samples of one edge on the flank give its slope; where the flank is shorter than a sample, the part of the edges
    that show a sample on it gives its duration, because edges fall anywhere between the samples.
    """
    flank = _on_flank(near)
    both = flank[:, 1] & flank[:, 2]
    span = FLANK[1] - FLANK[0]
    if both.sum() >= LEAST_PAIRS:
        durations = 1.0 / (near[both, 2] - near[both, 1])
        usual = float(np.median(durations))
        spread = 1.4826 * float(np.median(np.abs(durations - usual)))
        return (usual, spread / np.sqrt(both.sum())) if spread < SAME_DURATION * usual else (np.inf, 0.0)
    shown = flank.sum(axis=1)
    density = float(shown.mean()) / span if shown.size else np.inf
    if near.shape[0] < LEAST_FOR_DENSITY or density >= 1.6:
        return np.inf, 0.0
    return max(density, STEEPEST), float(np.std(shown)) / np.sqrt(shown.size) / span


def _ramp_crossing(near: Array, linear: Array, duration: float) -> Array:
    """Mean over the samples on the flank of where each puts half height; linear where there is none."""
    flank = _on_flank(near)
    places = np.arange(-1, 3) - duration * (near - 0.5)
    count = flank.sum(axis=1)
    mean = np.where(flank, places, 0.0).sum(axis=1) / np.maximum(count, 1)
    return np.where(count > 0, mean, linear)

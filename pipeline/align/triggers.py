"""Trigger voltage -> edge times on the logger's clock, read in blocks so that memory does not grow with length.

The level is half the height between the plateaus on the two sides of each edge, never the declared ``level_V``
(which is the height of the pulse). A hysteresis of a quarter of the height on either side keeps noise from
counting twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from pipeline.align.edge_time import EdgeTimes, refine_edges
from pipeline.config import TriggerSpec
from pipeline.records import Array, Channel, Finding, Refusal

HYSTERESIS = 0.25
"""Part of the pulse height above and below half height that a pulse has to pass."""
WINDOW_REVOLUTIONS = 1.5
"""Length of a level window: at least one whole pulse at nominal speed lies inside."""
POOLED_WINDOWS = 5
"""A level follows the running median over this many windows: one disturbed window does not move it."""
LONGEST_HALF_WINDOW = 64
"""Return the samples on either side of an edge that are looked at, at most."""
REST_HIGH = 0.65
"""A signal that is high for longer than this rests high: its pulses point down."""
MIN_HEIGHT_TO_NOISE = 8.0
"""Pulses lower than this many standard deviations of the plateaus are no pulses."""


@dataclass(frozen=True)
class Edges:
    """Edges of one trigger channel in time order.

    Attributes
    ----------
    time : (n,) half-height crossing on the logger's clock, switching delay not taken off [s]
    width : time that a pulse lasts, median [s]
    height : median height of the pulses [V]
    noise : standard error of one edge time, from the noise of the plateaus and the slope of the edge [s]
    high_fraction : part of the time that the signal is high
    edge : the voltage edge that was taken
    n_nan : samples that are no numbers
    """

    time: Array
    width: float
    height: float
    noise: float
    high_fraction: float
    edge: str
    n_nan: int
    findings: tuple[Finding, ...]


@dataclass
class _Scan:
    """State that a scan carries from block to block."""

    state: int = -1
    crossing: int = 0
    n_high: int = 0


def find_edges(channel: Channel, spec: TriggerSpec, nominal_speed: float, block_samples: int = 1 << 20) -> Edges:
    """Return the declared edge of every pulse of a trigger channel.

    Parameters
    ----------
    channel : trigger voltage
    spec : declared edge and number of pulses
    nominal_speed : sets the length of the level windows [rad/s]
    block_samples : samples read at a time

    Raises
    ------
    Refusal
        No pulses in the channel.
    """
    window = max(16, round(WINDOW_REVOLUTIONS * 2.0 * np.pi / nominal_speed * channel.sample_rate))
    block = max(block_samples, POOLED_WINDOWS * window)
    scan, rising, falling, n_nan = _Scan(), [], [], 0
    for start in range(0, channel.n_samples, block):
        first = max(0, start - LONGEST_HALF_WINDOW)
        last = min(channel.n_samples, start + block + LONGEST_HALF_WINDOW)
        volts = channel.read_volts(first, last)
        stop = min(start + block, channel.n_samples) - first
        crossings = _scan_block(volts, start - first, stop, window, scan, first)
        up, down = crossings[crossings > 0] - 1, -crossings[crossings < 0] - 1
        half = _half_window(np.abs(crossings))
        rising.append(_refine(volts, first, up, half, 1.0))
        falling.append(_refine(volts, first, down, half, -1.0))
        n_nan += _count_nan(volts[start - first : stop])
    return _edges(channel, spec, _joined(rising), _joined(falling), scan.n_high / max(1, channel.n_samples), n_nan)


def _scan_block(volts: Array, begin: int, stop: int, window: int, scan: _Scan, first: int) -> NDArray[np.int64]:
    low, high = _window_extremes(volts, window)
    low, high = (median_filter(extreme, POOLED_WINDOWS, mode="nearest") for extreme in (low, high))
    height = high - low
    # A window without a pulse (standstill, gap) has only noise for a height: it takes the level of the block.
    flat = height < 0.5 * np.max(height)
    low[flat], high[flat] = np.median(low[~flat]), np.median(high[~flat])
    level, margin = 0.5 * (low + high), HYSTERESIS * (high - low)
    crossings = np.empty(max(64, (stop - begin) // 4), dtype=np.int64)
    count, scan.state, scan.crossing, n_high = _transitions(
        volts, begin, stop, first, window, level - margin, level, level + margin, scan.state, scan.crossing, crossings
    )
    scan.n_high += n_high
    return crossings[:count]


@numba.njit(cache=True, nogil=True)
def _window_extremes(volts: Array, window: int) -> tuple[Array, Array]:
    n_windows = max(1, volts.size // window)
    low, high = np.empty(n_windows), np.empty(n_windows)
    for w in range(n_windows):
        stop = volts.size if w == n_windows - 1 else (w + 1) * window
        smallest, largest = np.inf, -np.inf
        for i in range(w * window, stop):
            value = volts[i]
            smallest = value if value < smallest else smallest
            largest = value if value > largest else largest
        low[w], high[w] = (smallest, largest) if largest >= smallest else (0.0, 0.0)
    return low, high


@numba.njit(cache=True, nogil=True)
def _count_nan(volts: Array) -> int:
    count = 0
    for value in volts:
        count += value != value
    return count


@numba.njit(cache=True, nogil=True)
def _transitions(volts, begin, stop, first, window, lower, level, upper, state, crossing, out):  # type: ignore[no-untyped-def]
    """Write the sample before each level crossing, plus one, positive when rising; return count and state.

    A crossing counts when the hysteresis level on the far side is reached; its place is the last crossing before.
    Samples that are no numbers leave the state as it is.
    """
    count, n_high, last = 0, 0, level.size - 1
    for i in range(begin, stop):
        w = min(i // window, last)
        value = volts[i]
        if state == 1:
            n_high += 1
            if i > 0 and value < level[w] <= volts[i - 1]:
                crossing = first + i
            if value < lower[w]:
                out[count] = -crossing
                count, state = count + 1, 0
        elif state == 0:
            if i > 0 and value >= level[w] > volts[i - 1]:
                crossing = first + i
            if value > upper[w]:
                out[count] = crossing
                count, state = count + 1, 1
        elif value > upper[w]:
            state = 1
        elif value < lower[w]:
            state = 0
    return count, state, crossing, n_high


def _half_window(crossings: NDArray[np.int64]) -> int:
    """Return the samples on either side of an edge that belong to no other edge."""
    if crossings.size < 2:
        return 8
    gap = int(np.percentile(np.diff(crossings), 10))
    return int(np.clip(gap // 2, 2, LONGEST_HALF_WINDOW))


def _refine(volts: Array, first: int, before: NDArray[np.int64], half: int, sign: float) -> EdgeTimes:
    columns = before[:, None] - first + np.arange(-half + 1, half + 1)[None, :]
    windows = volts[np.clip(columns, 0, volts.size - 1)] if before.size else np.empty((0, 2 * half))
    if not before.size:
        empty = np.empty(0)
        return EdgeTimes(empty, empty, empty, empty)
    return refine_edges(sign * windows, before)


def _joined(parts: list[EdgeTimes]) -> EdgeTimes:
    names = ("position", "height", "slope", "noise")
    return EdgeTimes(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _edges(
    channel: Channel, spec: TriggerSpec, rising: EdgeTimes, falling: EdgeTimes, high: float, n_nan: int
) -> Edges:
    where = f"{channel.path.name}, channel {channel.name!r}"
    inverted = high > REST_HIGH and spec.edge == "rising"
    edge = "falling" if inverted else spec.edge
    taken, other = (falling, rising) if edge == "falling" else (rising, falling)
    height, noise = _median(taken.height), _median(taken.noise)
    if taken.position.size < 2 or height < MIN_HEIGHT_TO_NOISE * noise:
        raise Refusal(
            f"{where}: found {taken.position.size} trigger pulses of {height:.3g} V over noise of {noise:.2g} V, "
            "expected at "
            "least two; check that the channel is the trigger and that the sensor saw the tooth"
        )
    time = channel.start_time + taken.position / channel.sample_rate
    width = _pulse_width(taken.position, other.position) / channel.sample_rate
    findings = []
    if inverted:
        findings.append(
            Finding(
                "trigger_inverted",
                "warning",
                f"the trigger rests high ({100 * high:.0f} % of the time) and its pulses point down, against the "
                "sheet's "
                f"edge 'rising': the leading (falling) edge is taken; the other edge lies {1e3 * width:.3g} ms later",
                where,
            )
        )
    if n_nan:
        findings.append(
            Finding("trigger_drop_out", "warning", f"{n_nan} trigger samples are missing (not a number)", where)
        )
    slope = _median(taken.slope) * channel.sample_rate
    return Edges(time, width, height, noise / slope, high, edge, n_nan, tuple(findings))


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else 0.0


def _pulse_width(taken: Array, other: Array) -> float:
    """Median samples from a taken edge to the opposite one that follows."""
    following = np.searchsorted(other, taken)
    inside = following < other.size
    return _median(other[following[inside]] - taken[inside])

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
from scipy.ndimage import maximum_filter, median_filter

from camtorque.align.damage import NO_VOLTAGE
from camtorque.align.edge_time import EdgeSamples, crossings, edge_samples, joined
from camtorque.align.logger_time import sample_times
from camtorque.config import TriggerSpec
from camtorque.records import Array, Channel, Finding, Refusal

HYSTERESIS = 0.25
"""Part of the pulse height above and below half height that a pulse has to pass."""
WINDOW_REVOLUTIONS = 1.5
"""Length of a level window: at least one whole pulse at nominal speed lies inside."""
POOLED_WINDOWS = 5
"""A level follows the running median over this many windows: one disturbed window does not move it."""
NEIGHBOUR_WINDOWS = 9
"""Windows among which the highest pulse sets what counts as a pulse."""
NOISE_HEIGHTS = 12.0
"""Pulses are higher than this many standard deviations of the noise, whose extremes span eight."""
LONGEST_HALF_WINDOW = 64
"""Return the samples on either side of an edge that are looked at, at most."""
REST_HIGH = 0.65
"""A signal that is high for longer than this part of a usual period rests high: its pulses point down."""
BUNDLE = 4096
"""Edges worked off at once."""
NOISE_PAIRS = 4096
"""Pairs of neighbouring samples of a block that the noise is taken from, at most."""
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
    noise : standard error of one edge time: noise of the plateaus over the slope of the flank, and too few samples [s]
    high_fraction : part of a usual period that the signal is high: a shaft that stands still does not count
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
    block = max(2 * block_samples, POOLED_WINDOWS * window)
    scan, rising, falling, n_missing = _Scan(), _Collector(1.0), _Collector(-1.0), 0
    for start in range(0, channel.n_samples, block):
        first = max(0, start - LONGEST_HALF_WINDOW)
        last = min(channel.n_samples, start + block + LONGEST_HALF_WINDOW)
        volts = channel.read_volts(first, last)
        stop = min(start + block, channel.n_samples) - first
        missing = _count_missing(volts[start - first : stop])
        if missing:
            volts = np.where(np.abs(volts) < NO_VOLTAGE, volts, np.nan)
        n_missing += missing
        places = _scan_block(volts, start - first, stop, window, scan, first)
        up, down = places[places > 0] - 1, -places[places < 0] - 1
        half = _half_window(np.abs(places))
        rising.add(volts, first, up, half)
        falling.add(volts, first, down, half)
    return _edges(channel, spec, rising.edges(), falling.edges(), n_missing)


def _scan_block(volts: Array, begin: int, stop: int, window: int, scan: _Scan, first: int) -> NDArray[np.int64]:
    level, margin = _levels(*_window_extremes(volts, window), NOISE_HEIGHTS * _noise(volts))
    places = np.empty(max(1, stop - begin), dtype=np.int64)
    count, scan.state = _transitions(
        volts, begin, stop, first, window, level - margin, level, level + margin, scan.state, places
    )
    return places[:count]


def _noise(volts: Array) -> float:
    """Robust noise of the plateaus from the differences of neighbouring samples [V]."""
    stride = 2 * max(1, volts.size // (2 * NOISE_PAIRS))
    n = volts.size // stride
    differences = np.abs(volts[1 : n * stride : stride] - volts[: n * stride : stride])
    finite = differences[np.isfinite(differences)]
    return 1.4826 / np.sqrt(2.0) * float(np.median(finite)) if finite.size else 0.0


def _levels(low: Array, high: Array, least_height: float) -> tuple[Array, Array]:
    """Return half height and hysteresis of each window; a window without a pulse takes those of its neighbours.

    A window at standstill or in a gap has only noise for a height. Without any pulse the level is out of reach.
    """
    low, high = (median_filter(extreme, POOLED_WINDOWS, mode="nearest") for extreme in (low, high))
    height = high - low
    sound = np.flatnonzero((height >= 0.5 * maximum_filter(height, NEIGHBOUR_WINDOWS)) & (height > least_height))
    if not sound.size:
        return np.full(height.size, np.inf), np.zeros(height.size)
    windows = np.arange(height.size)
    level = np.interp(windows, sound, 0.5 * (low + high)[sound])
    return level, HYSTERESIS * np.interp(windows, sound, height[sound])


@numba.njit(cache=True, nogil=True)
def _window_extremes(volts: Array, window: int) -> tuple[Array, Array]:
    n_windows = max(1, volts.size // window)
    low, high = np.empty(n_windows), np.empty(n_windows)
    for w in range(n_windows):
        stop = volts.size if w == n_windows - 1 else (w + 1) * window
        smallest, largest = np.inf, -np.inf
        for i in range(w * window + 1, stop):
            # The lower (higher) of two neighbours: a spike of one sample is no plateau.
            lower, higher = min(volts[i - 1], volts[i]), max(volts[i - 1], volts[i])
            smallest = higher if higher < smallest else smallest
            largest = lower if lower > largest else largest
        low[w], high[w] = (smallest, largest) if largest >= smallest else (0.0, 0.0)
    return low, high


@numba.njit(cache=True, nogil=True)
def _count_missing(volts: Array) -> int:
    count = 0
    for value in volts:
        count += not (-NO_VOLTAGE < value < NO_VOLTAGE)
    return count


@numba.njit(cache=True, nogil=True)
def _transitions(volts, begin, stop, first, window, lower, level, upper, state, out):  # type: ignore[no-untyped-def]
    """Write the sample before each level crossing, plus one, positive when rising; return count and state.

    A crossing counts when the hysteresis level on the far side is reached; its place is the last crossing before.
    Samples that are no numbers leave the state as it is.
    """
    count, last = 0, level.size - 1
    i = begin
    while i < stop:
        w = min(i // window, last)
        end = stop if w == last else min(stop, (w + 1) * window)
        if state == 1:
            while i < end and not volts[i] < lower[w]:
                i += 1
            if i < end:
                out[count] = -(first + _crossing_before(volts, i, level[w], False))
                count, state = count + 1, 0
        elif state == 0:
            while i < end and not volts[i] > upper[w]:
                i += 1
            if i < end:
                out[count] = first + _crossing_before(volts, i, level[w], True)
                count, state = count + 1, 1
        else:
            while i < end and lower[w] <= volts[i] <= upper[w]:
                i += 1
            if i < end and volts[i] == volts[i]:
                state = 1 if volts[i] > upper[w] else 0
            else:
                i += 1
    return count, state


@numba.njit(cache=True, nogil=True)
def _crossing_before(volts: Array, i: int, level: float, rising: bool) -> int:
    """Return the first sample at or beyond the level, going back from one that is."""
    while i > 1 and ((volts[i - 1] >= level) if rising else (volts[i - 1] < level)):
        i -= 1
    return i


def _half_window(crossings: NDArray[np.int64]) -> int:
    """Return the samples on either side of an edge that belong to no other edge."""
    if crossings.size < 2:
        return 8
    gap = int(np.percentile(np.diff(crossings), 10))
    return int(np.clip(gap // 2, 2, LONGEST_HALF_WINDOW))


class _Collector:
    """Gathers the samples around edges over blocks; edges are worked off in bundles, so that memory stays bounded."""

    def __init__(self, sign: float) -> None:
        self.sign = sign
        self.waiting: list[tuple[Array, NDArray[np.int64]]] = []
        self.done: list[EdgeSamples] = []

    def add(self, volts: Array, first: int, before: NDArray[np.int64], half: int) -> None:
        columns = before[:, None] - first + np.arange(-half + 1, half + 1)[None, :]
        self.waiting.append((self.sign * volts[np.clip(columns, 0, volts.size - 1)], before))
        if sum(windows.shape[0] for windows, _ in self.waiting) > BUNDLE:
            self._work_off()

    def edges(self) -> EdgeSamples:
        self._work_off()
        return joined(self.done)

    def _work_off(self) -> None:
        half = min((windows.shape[1] // 2 for windows, before in self.waiting if before.size), default=1)
        middle = [windows[:, windows.shape[1] // 2 - half :][:, : 2 * half] for windows, _ in self.waiting]
        before = np.concatenate([before for _, before in self.waiting]) if self.waiting else np.empty(0, dtype=np.int64)
        self.done.append(
            edge_samples(np.concatenate([m for m in middle if m.size]) if before.size else np.empty((0, 2)), before)
        )
        self.waiting = []


def _edges(channel: Channel, spec: TriggerSpec, rising: EdgeSamples, falling: EdgeSamples, n_nan: int) -> Edges:
    where = f"{channel.path.name}, channel {channel.name!r}"
    high = _high_fraction(rising.before, falling.before)
    inverted = high > REST_HIGH and spec.edge == "rising"
    edge = "falling" if inverted else spec.edge
    taken, other = (falling, rising) if edge == "falling" else (rising, falling)
    height, noise = _median(taken.height), _median(taken.noise)
    if taken.before.size < 2 or not height > MIN_HEIGHT_TO_NOISE * noise:
        raise _no_pulses(channel, where, taken.before.size, height)
    crossing = crossings(taken)
    time = sample_times(channel, crossing.position)
    width = _pulse_width(crossing.position, other.before) / channel.sample_rate
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
    edge_noise = float(np.hypot(noise / (height * crossing.slope), crossing.blur)) / channel.sample_rate
    return Edges(time, width, height, edge_noise, high, edge, n_nan, tuple(findings))


def _no_pulses(channel: Channel, where: str, count: int, height: float) -> Refusal:
    """Return the refusal of a channel without pulses; it says what the channel holds instead."""
    volts = channel.read_volts(0, min(channel.n_samples, 1 << 20))
    volts = volts[np.abs(volts) < NO_VOLTAGE]
    if volts.size < 2:
        return Refusal(
            f"{where}: found 0 trigger pulses in {channel.n_samples} samples ({volts.size} of them voltages), expected "
            "at least two revolutions; the file is empty or cut off: record or export it again"
        )
    found = f"of {height:.3g} V" if count else "at all"
    return Refusal(
        f"{where}: found {count} trigger pulses {found} in {channel.duration:.3g} s of a signal from "
        f"{np.min(volts):.3g} to {np.max(volts):.3g} V with a noise of {_noise(volts):.2g} V, expected at least two "
        f"pulses that stand {NOISE_HEIGHTS:.0f} times above the noise; check that the channel is the trigger, that "
        "the sensor saw the tooth and that the recording is longer than two revolutions"
    )


def _high_fraction(rising: NDArray[np.int64], falling: NDArray[np.int64]) -> float:
    if rising.size < 2 or not falling.size:
        return 0.0
    return _pulse_width(rising.astype(np.float64), falling) / _median(np.diff(rising))


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else 0.0


def _pulse_width(taken: Array, other: NDArray[np.int64]) -> float:
    """Median samples from a taken edge to the opposite one that follows."""
    following = np.searchsorted(other, taken)
    inside = following < other.size
    return _median(other[following[inside]] - taken[inside])

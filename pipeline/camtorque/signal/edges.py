"""Voltage of a digital or Hall pick-up -> edge times on the logger's clock, read in blocks: memory does not grow.

The level is half the height between the plateaus on the two sides of each edge, never the declared ``level_V``
(which is the height of the pulse). A hysteresis of a quarter of the height on either side keeps noise from
counting twice. Nothing about the speed is assumed: the length of the level windows follows the pulses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.compiled import compiled_pays
from camtorque.records import Array, Channel, Finding, Integers, Mask, Refusal
from camtorque.signal import passes_compiled
from camtorque.signal.damage import NO_VOLTAGE
from camtorque.signal.levels import (
    NOISE_HEIGHTS,
    EdgeSamples,
    crossings,
    edge_samples,
    joined,
    level_windows,
    looked_at,
    noise_of,
)
from camtorque.signal.logger_time import sample_times
from camtorque.signal.running import percentile
from camtorque.signal.threshold import Threshold
from camtorque.units import counted

BLOCK = 1 << 19
"""Samples looked at at a time: they and what is found in them fit into the processor's cache."""
LONGEST_HALF_WINDOW = 64
"""Samples on either side of an edge that are looked at, at most."""
REST_HIGH = Threshold(
    0.65, "1", "convention",
    "A signal that is high for longer than this part of a usual period rests high: its pulses point down."
)  # fmt: skip
LONGEST_USUAL = Threshold(
    3.0, "1", "convention",
    "In a period of so many times what three quarters do not exceed the shaft stands still: it is no usual one."
)  # fmt: skip
BUNDLE = 4096
"""Edges worked off at once."""
MIN_HEIGHT_TO_NOISE = Threshold(
    8.0, "1", "statistics", "Pulses lower than this many standard deviations of the plateaus are no pulses."
)
COIL_SYMMETRY = Threshold(
    0.1, "1", "convention",
    "A signal without pulses whose median lies within this part of its swing from the middle may be a coil's: "
    "the refusal says so."
)  # fmt: skip
LEAST_HEIGHT = Threshold(
    0.3, "1", "simulated rigs",
    "Pulses lower than this part of the highest are hum of a stretch without pulses: the log is then read again."
)  # fmt: skip
BOUNCE_PERIODS = Threshold(
    0.1, "periods", "physics",
    "An edge that follows the one before within this part of a period is a bounce: no shaft speeds up tenfold."
)  # fmt: skip
HIGHEST = 3
"""The third highest pulse counts as the highest: two may be disturbances."""


@dataclass(frozen=True)
class Edges:
    """Edges of one trigger channel in time order.

    Attributes
    ----------
    time : (n,) half-height crossing on the logger's clock, switching delay not taken off [s]
    width : time that a pulse lasts, median [s]
    height : median height of the pulses [V]
    noise : standard error of one edge time: noise of the plateaus over the slope of the flank, and too few samples [s]
    edge : the voltage edge that was taken
    opposite : (m,) sample times of the other edges, to one sample [s]
    """

    time: Array
    width: float
    height: float
    noise: float
    edge: str
    opposite: Array
    findings: tuple[Finding, ...] = ()


def find_edges(channel: Channel, declared: str) -> Edges:
    """Return the declared edge of every pulse of a channel; the leading one where a ``rising`` one rests high.

    Raises
    ------
    Refusal : no pulses in the channel
    """
    rising, falling, n_missing = _scanned(channel, 0.0)
    heights = np.sort(np.r_[rising.own_height, falling.own_height])
    if heights.size > HIGHEST:
        least = LEAST_HEIGHT * float(heights[-HIGHEST])
        if heights[0] < least:
            rising, falling, n_missing = _scanned(channel, least)
    high = _high_fraction(rising.before, falling.before)
    inverted = high > REST_HIGH and declared == "rising"
    edge = "falling" if inverted else declared
    taken, other = (falling, rising) if edge == "falling" else (rising, falling)
    height, noise = _median(taken.height), _median(taken.noise)
    if taken.before.size < 2 or not height > MIN_HEIGHT_TO_NOISE * noise:
        raise _no_pulses(channel, taken.before.size, height)
    crossing = crossings(taken)
    width = _pulse_width(crossing.position, other.before) / channel.sample_rate
    findings = missing_finding(n_missing, channel.where)
    if inverted:
        text = (
            f"the trigger rests high ({100 * high:.0f} % of the time) and its pulses point down, against the sheet's "
            f"edge 'rising': the leading (falling) edge is taken; the other edge lies {1e3 * width:.3g} ms later"
        )
        findings = (Finding("trigger_inverted", "warning", text, channel.where), *findings)
    edge_noise = float(np.hypot(noise / (height * crossing.slope), crossing.blur)) / channel.sample_rate
    time, opposite = sample_times(channel, crossing.position), sample_times(channel, other.before.astype(np.float64))
    return Edges(time, width, height, edge_noise, edge, opposite, findings)


def _scanned(channel: Channel, least: float) -> tuple[EdgeSamples, EdgeSamples, int]:
    """Return rising and falling edges of pulses higher than ``least``, and the samples that are missing."""
    compiled = compiled_pays(channel.n_samples)
    transitions = passes_compiled.transitions if compiled else _transitions
    up, down, n_missing, was_high = _Collector(1.0), _Collector(-1.0), 0, -1
    for start in range(0, channel.n_samples, BLOCK):
        first = max(0, start - LONGEST_HALF_WINDOW)
        last = min(channel.n_samples, start + BLOCK + LONGEST_HALF_WINDOW)
        volts, missing, extremes = looked_at(channel.read_volts(first, last), compiled)
        n_missing += missing
        inside = start - first, min(start + BLOCK, channel.n_samples) - first
        window, level, margin = level_windows(volts, extremes, least)
        events, high = transitions(volts, inside, (window, level - margin, level + margin))
        before = np.r_[was_high, high[:-1]]
        was_high = int(high[-1]) if high.size else was_high
        changed = (high != before) & (before >= 0)
        events, rising = events[changed], high[changed]
        at = _crossings_before(volts, events, level[np.minimum(events // window, level.size - 1)], rising)
        half = _half_window(at)
        up.add(volts, first, first + at[rising] - 1, half)
        down.add(volts, first, first + at[~rising] - 1, half)
    return up.edges(), down.edges(), n_missing


def _transitions(volts: Array, inside: tuple[int, int], bands: tuple[int, Array, Array]) -> tuple[Integers, Mask]:
    """Return the samples at which the signal comes to lie beyond a band, in order, and whether above it.

    ``bands`` are samples per window, lower and upper border of each window. Samples that are no numbers and windows
    without a level lie nowhere.
    """
    begin, stop = inside
    window, lower, upper = bands
    entered = [_entries(_beyond(np.greater, volts, window, upper)[begin:stop])]
    entered.append(_entries(_beyond(np.less, volts, window, lower)[begin:stop]))
    places = begin + np.concatenate(entered)
    order = np.argsort(places, kind="stable")
    return places[order], order < entered[0].size


def _beyond(compare: np.ufunc, volts: Array, window: int, border: Array) -> Mask:
    """Compare each sample with the border of its window; the last window holds all that remain."""
    last = (border.size - 1) * window
    out = np.empty(volts.size, dtype=bool)
    compare(volts[:last].reshape(-1, window), border[:-1, None], out=out[:last].reshape(-1, window))
    compare(volts[last:], border[-1], out=out[last:])
    return out


def _entries(flags: Mask) -> Integers:
    """Return the flagged places that follow an unflagged one, or none."""
    entries = np.flatnonzero(flags[1:] > flags[:-1]) + 1
    return np.r_[0, entries] if flags[:1].any() else entries


def _crossings_before(volts: Array, at: Integers, level: Array, rising: Mask) -> Integers:
    """Return the first samples at or beyond the levels, going back from ones that are."""
    at, moving = at.copy(), np.arange(at.size)
    while moving.size:
        previous = volts[at[moving] - 1]
        on = np.where(rising[moving], previous >= level[moving], previous < level[moving]) & (at[moving] > 1)
        moving = moving[on]
        at[moving] -= 1
    return at


def _half_window(crossings: Integers) -> int:
    """Return the samples on either side of an edge that belong to no other edge."""
    if crossings.size < 2:
        return 8
    gap = int(percentile(np.diff(crossings), 10.0))
    return int(np.clip(gap // 2, 2, LONGEST_HALF_WINDOW))


class _Collector:
    """Gathers the samples around edges over blocks; edges are worked off in bundles, so that memory stays bounded."""

    def __init__(self, sign: float) -> None:
        self.sign = sign
        self.waiting: list[tuple[Array, Integers]] = []
        self.done: list[EdgeSamples] = []

    def add(self, volts: Array, first: int, before: Integers, half: int) -> None:
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


def missing_finding(n_missing: int, where: str) -> tuple[Finding, ...]:
    """Return the finding of samples that are no numbers."""
    if not n_missing:
        return ()
    text = f"{counted(n_missing, 'sample is', 'samples are')} missing (not a number)"
    return (Finding("trigger_drop_out", "warning", text, where),)


def _no_pulses(channel: Channel, count: int, height: float) -> Refusal:
    """Return the refusal of a channel without pulses; it says what the channel holds instead."""
    volts = channel.read_volts(0, min(channel.n_samples, 1 << 20))
    volts = volts[np.abs(volts) < NO_VOLTAGE]
    if volts.size < 2:
        return Refusal(
            f"{channel.where}: found 0 trigger pulses in {channel.n_samples} samples ({volts.size} of them voltages), "
            "expected at least two revolutions; the file is empty or cut off: record or export it again"
        )
    pulses, found = counted(count, "trigger pulse", "trigger pulses"), f"of {height:.3g} V" if count else "at all"
    middle, swing = float(np.median(volts)), float(np.ptp(volts))
    waves = count > 1 and abs(middle - 0.5 * (np.max(volts) + np.min(volts))) < COIL_SYMMETRY * swing
    coil = '; it swings alike to both sides: a coil is declared as sensor = "inductive" in [trigger]' if waves else ""
    return Refusal(
        f"{channel.where}: found {pulses} {found} in {channel.duration:.3g} s of a signal from "
        f"{np.min(volts):.3g} to {np.max(volts):.3g} V with a noise of {noise_of(volts):.2g} V, expected at least two "
        f"pulses that stand {NOISE_HEIGHTS:.0f} times above the noise; check that the channel is the trigger, that "
        f"the sensor saw the tooth and that the recording is longer than two revolutions{coil}"
    )


def without_bounces(time: Array) -> tuple[Array, int]:
    """Return edge times [s] with the first edge of a burst alone, and how many were left out.

    The contact closes first and bounces afterwards.
    """
    if time.size < 3:
        return time, 0
    gaps = np.diff(time)
    shortest = BOUNCE_PERIODS * np.median(gaps[gaps >= 0.5 * np.percentile(gaps, 75)])
    if gaps.min() >= shortest:
        return time, 0
    keep = np.ones(time.size, dtype=bool)
    last = time[0]
    for i in range(1, time.size):
        if time[i] - last < shortest:
            keep[i] = False
        else:
            last = time[i]
    return time[keep], int(np.sum(~keep))


def _high_fraction(rising: Integers, falling: Integers) -> float:
    """Return the part of the usual periods that the signal is high: a shaft that stands still does not count."""
    periods = np.diff(rising)
    after = np.searchsorted(falling, rising[:-1])
    if not periods.size or after[-1] >= falling.size:
        return 0.0
    usual = periods <= LONGEST_USUAL * np.percentile(periods, 75.0)
    return float(np.sum((falling[after] - rising[:-1])[usual]) / np.sum(periods[usual]))


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else 0.0


def _pulse_width(taken: Array, other: Integers) -> float:
    """Median samples from a taken edge to the opposite one that follows."""
    following = np.searchsorted(other, taken)
    inside = following < other.size
    return _median(other[following[inside]] - taken[inside])

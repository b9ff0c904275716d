"""One look at all samples of a channel: range, missing, clipped, constant and isolated samples, pulses.

Done in blocks, so that a recording larger than memory can be checked. No model and no cam angle is used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from camtorque.records import Array, Channel

BLOCK = 1_000_000
OVERLAP = 4
CLIP_RUN = 5
"""So many equal samples in a row at the extreme of a channel are a flat top: noise of a logger does not repeat so."""
SPIKE_TIMES_MEDIAN, SPIKE_TIMES_BESIDE = 10.0, 4.0
"""An isolated sample stands out by this many times the usual bend, and by this many times the bends beside it."""
LEAST_SWING_VOLTS = 1.0e-9


@dataclass(frozen=True)
class Scan:
    """What the samples of one channel show; voltages [V].

    Attributes
    ----------
    missing, longest_missing : samples that are not numbers, and the longest run of them
    clipped_low, clipped_high : samples in flat runs at the lowest and highest value
    isolated : samples that stand out from both neighbours as no signal does (flipped bits, glitches)
    """

    n_samples: int
    low: float
    high: float
    missing: int
    longest_missing: int
    clipped_low: int
    clipped_high: int
    isolated: int
    first_isolated: int

    @property
    def is_constant(self) -> bool:
        """Tell whether the channel never changes."""
        return not self.high - self.low > LEAST_SWING_VOLTS


def _blocks(channel: Channel, overlap: int = 0) -> Iterator[tuple[int, Array]]:
    for start in range(0, channel.n_samples, BLOCK):
        low = max(start - overlap, 0)
        yield low, channel.read_volts(low, min(start + BLOCK + overlap, channel.n_samples))


def scan_channel(channel: Channel) -> Scan:
    """Scan a channel twice: for its extremes, then for what happens there and in between."""
    low, high, missing, longest, carried = np.inf, -np.inf, 0, 0, 0
    for _, volts in _blocks(channel):
        bad = ~np.isfinite(volts)
        missing += int(bad.sum())
        run, carried = _longest_run(bad, carried)
        longest = max(longest, run)
        if not bad.all():
            low, high = min(low, float(np.min(volts[~bad]))), max(high, float(np.max(volts[~bad])))
    clipped = np.zeros(2, dtype=int)
    isolated, first = 0, -1
    for start, volts in _blocks(channel):
        clipped += (_flat_run_samples(volts == low), _flat_run_samples(volts == high))
        places = isolated_samples(volts)
        if places.size and first < 0:
            first = start + int(places[0])
        isolated += places.size
    low, high = (low, high) if np.isfinite(low) else (np.nan, np.nan)
    return Scan(channel.n_samples, low, high, missing, longest, int(clipped[0]), int(clipped[1]), isolated, first)


def _runs(flags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return edges[::2], edges[1::2]


def _longest_run(flags: np.ndarray, carried: int) -> tuple[int, int]:
    """Return the longest run, one carried over from the block before included, and the run that goes on."""
    starts, stops = _runs(flags)
    if not starts.size:
        return carried, 0
    lengths = stops - starts
    lengths[0] += carried if starts[0] == 0 else 0
    return max(int(lengths.max()), carried), int(lengths[-1]) if stops[-1] == flags.size else 0


def _flat_run_samples(flags: np.ndarray) -> int:
    starts, stops = _runs(flags)
    lengths = stops - starts
    return int(lengths[lengths >= CLIP_RUN].sum())


def isolated_samples(volts: Array) -> np.ndarray:
    """Return indices of samples that stand out from both neighbours while these agree with each other.

    With the bend d_i = x_i - (x_(i-1) + x_(i+1))/2, one wrong sample gives d_i = s and d_(i+-1) = -s/2; an edge gives
    two equal bends of opposite sign, and noise stays near its median.
    """
    if volts.size < 2 * OVERLAP + 1:
        return np.empty(0, dtype=int)
    bend = np.zeros(volts.size)
    bend[1:-1] = volts[1:-1] - 0.5 * (volts[:-2] + volts[2:])
    size = np.abs(bend)
    usual = np.nanmedian(size)
    candidates = np.flatnonzero(size > max(SPIKE_TIMES_MEDIAN * usual, LEAST_SWING_VOLTS))
    candidates = candidates[(candidates >= OVERLAP) & (candidates < volts.size - OVERLAP)]
    here = bend[candidates]
    sides = [bend[candidates + step] / here for step in (-1, 1)]
    alone = np.all([np.abs(side + 0.5) < 0.1 for side in sides], axis=0)
    beside = np.max([size[candidates + step] for step in (-3, -2, 2, 3)], axis=0)
    return candidates[alone & (np.abs(here) > SPIKE_TIMES_BESIDE * beside)]


def pulse_times(channel: Channel, edge: str, low: float, high: float) -> Array:
    """Return coarse times [s] of the edges by a threshold at half height with a hysteresis of a quarter."""
    middle, band = 0.5 * (low + high), 0.125 * (high - low)
    sign = 1.0 if edge == "rising" else -1.0
    times: list[Array] = []
    state = 0
    for start, volts in _blocks(channel):
        level = sign * (volts - middle)
        marks = np.where(level > band, 1, np.where(level < -band, -1, 0))
        at = np.flatnonzero(marks)
        kinds = marks[at]
        before = np.concatenate(([state], kinds[:-1]))
        times.append((start + at[(kinds == 1) & (before == -1)]) / channel.sample_rate)
        state = int(kinds[-1]) if kinds.size else state
    return np.concatenate(times)

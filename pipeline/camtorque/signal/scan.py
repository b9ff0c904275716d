"""One look at all samples of a channel: range, missing, clipped, constant and isolated samples.

Done in blocks, so that a recording larger than memory can be checked. No model and no cam angle is used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from camtorque.records import Array, Channel
from camtorque.signal.damage import NO_VOLTAGE, clipped_samples, clips_below, converter_step, missing_samples
from camtorque.signal.running import median
from camtorque.signal.threshold import Threshold

BLOCK = 1_000_000
OVERLAP = 4
SPIKE_TIMES_MEDIAN = Threshold(10.0, "1", "statistics", "An isolated sample bends by this many times the usual bend.")
SPIKE_TIMES_BESIDE = Threshold(4.0, "1", "convention", "And by this many times the bends beside it.")
SPIKE_STEPS = Threshold(
    5.0, "steps", "convention",
    "And by this many steps of the converter: a coarse one bends by a step now and then, and usually not at all."
)  # fmt: skip
LEAST_SWING_VOLTS = 1.0e-9


@dataclass(frozen=True)
class Scan:
    """What the samples of one channel show; voltages [V].

    Attributes
    ----------
    missing, longest_missing : samples that are no voltages, and the longest run of them
    clipped_low, clipped_high : samples in clipped runs at the lowest and highest value, see `signal.damage`
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
        count, run, carried = missing_samples(np.ascontiguousarray(volts), carried)
        missing, longest = missing + count, max(longest, run)
        known = volts[np.abs(volts) < NO_VOLTAGE] if count else volts
        if known.size:
            low, high = min(low, float(np.min(known))), max(high, float(np.max(known)))
    clipped, two_sided = np.zeros(2, dtype=int), clips_below(channel.calibration)
    isolated, first = 0, -1
    for start, volts in _blocks(channel):
        clipped += (clipped_samples(volts, low) if two_sided else 0, clipped_samples(volts, high))
        places = isolated_samples(volts)
        if places.size and first < 0:
            first = start + int(places[0])
        isolated += places.size
    low, high = (low, high) if np.isfinite(low) else (np.nan, np.nan)
    return Scan(channel.n_samples, low, high, missing, longest, int(clipped[0]), int(clipped[1]), isolated, first)


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
    usual = float(np.nanmedian(size)) if np.isnan(np.min(size)) else median(size)
    least = max(SPIKE_TIMES_MEDIAN * usual, SPIKE_STEPS * converter_step(volts), LEAST_SWING_VOLTS)
    candidates = np.flatnonzero(size > least)
    candidates = candidates[(candidates >= OVERLAP) & (candidates < volts.size - OVERLAP)]
    here = bend[candidates]
    sides = [bend[candidates + step] / here for step in (-1, 1)]
    alone = np.all([np.abs(side + 0.5) < 0.1 for side in sides], axis=0)
    beside = np.max([size[candidates + step] for step in (-3, -2, 2, 3)], axis=0)
    return candidates[alone & (np.abs(here) > SPIKE_TIMES_BESIDE * beside)]

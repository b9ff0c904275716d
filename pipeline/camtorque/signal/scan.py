"""One look at all samples of a channel: range, missing, clipped, constant and isolated samples.

Done in blocks, so that a recording larger than memory can be checked. No model and no cam angle is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.compiled import compiled_pays
from camtorque.records import Array, Channel, Integers
from camtorque.signal import passes_compiled
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
SPIKE_SHAPE = Threshold(
    0.1, "1", "convention", "The two samples beside it bend by minus half of that, but for this part of it."
)
LEAST_SWING_VOLTS = 1.0e-9
LISTED = 300


@dataclass(frozen=True)
class Scan:
    """What the samples of one channel show; voltages [V].

    Attributes
    ----------
    missing, longest_missing : samples that are no voltages, and the longest run of them
    clipped_low, clipped_high : samples in clipped runs at the lowest and highest value, see `signal.damage`
    isolated, isolated_at : samples that stand out from both neighbours as no signal does (flipped bits, glitches), and
        the places of up to `LISTED`, spread over the log
    """

    n_samples: int
    low: float
    high: float
    missing: int
    longest_missing: int
    clipped_low: int
    clipped_high: int
    isolated: int
    isolated_at: tuple[int, ...]

    @property
    def is_constant(self) -> bool:
        """Tell whether the channel never changes."""
        return not self.high - self.low > LEAST_SWING_VOLTS


def scan_channel(channel: Channel) -> Scan:
    """Look at every sample of a channel; it is read once, from front to back."""
    two_sided, compiled = clips_below(channel.calibration), compiled_pays(channel.n_samples)
    missing, longest, carried, isolated = 0, 0, 0, np.empty(0, dtype=np.int64)
    lows, highs = [(np.inf, 0)], [(-np.inf, 0)]
    for begin in range(0, channel.n_samples, BLOCK):
        first = max(begin - OVERLAP, 0)
        volts = np.ascontiguousarray(channel.read_volts(first, min(begin + BLOCK + OVERLAP, channel.n_samples)))
        isolated = np.r_[isolated, first + isolated_samples(volts, compiled)]
        own = volts[begin - first :][:BLOCK]
        low, high, is_whole = _ends(own)
        count, run, carried = (0, 0, 0) if is_whole else missing_samples(own, carried)
        missing, longest = missing + count, max(longest, run)
        lows.append((low, clipped_samples(own, low) if two_sided else 0))
        highs.append((high, clipped_samples(own, high)))
    low, high = min(lows)[0], max(highs)[0]
    # a block whose own extreme is not the channel's has no sample there
    clipped = [sum(n for end, n in ends if end == extreme) for ends, extreme in ((lows, low), (highs, high))]
    low, high = (low, high) if np.isfinite(low) else (np.nan, np.nan)
    spread = np.linspace(0, isolated.size - 1, min(isolated.size, LISTED)).astype(np.int64)
    found = isolated.size, tuple(isolated[spread].tolist())
    return Scan(channel.n_samples, low, high, missing, longest, clipped[0], clipped[1], *found)


def _ends(volts: Array) -> tuple[float, float, bool]:
    """Return the extremes of the samples that are voltages, infinite where none is, and whether all are."""
    low, high = float(np.min(volts)), float(np.max(volts))
    if -NO_VOLTAGE < low <= high < NO_VOLTAGE:
        return low, high, True
    known = volts[np.abs(volts) < NO_VOLTAGE]
    return float(np.min(known, initial=np.inf)), float(np.max(known, initial=-np.inf)), False


def isolated_samples(volts: Array, compiled: bool) -> Integers:
    """Return indices of samples that stand out from both neighbours while these agree with each other.

    With the bend d_i = x_i - (x_(i-1) + x_(i+1))/2, one wrong sample gives d_i = s and d_(i+-1) = -s/2; an edge gives
    two equal bends of opposite sign, and noise stays near its median.
    """
    beside, shape = float(SPIKE_TIMES_BESIDE), float(SPIKE_SHAPE)
    if volts.size < 2 * OVERLAP + 1:
        return np.empty(0, dtype=np.int64)
    if compiled and not passes_compiled.may_be_isolated(volts, float(SPIKE_TIMES_MEDIAN), beside, shape):
        return np.empty(0, dtype=np.int64)
    bend = np.zeros(volts.size)
    bend[1:-1] = volts[1:-1] - 0.5 * (volts[:-2] + volts[2:])
    size = np.abs(bend)
    usual = float(np.nanmedian(size)) if np.isnan(np.min(size)) else median(size)
    places = np.flatnonzero(size > max(SPIKE_TIMES_MEDIAN * usual, LEAST_SWING_VOLTS))
    places = places[(places >= OVERLAP) & (places < volts.size - OVERLAP)]
    alone = [np.abs(bend[places + step] / bend[places] + 0.5) < shape for step in (-1, 1)]
    beyond = np.max([size[places + step] for step in (-3, -2, 2, 3)], axis=0)
    places = places[alone[0] & alone[1] & (size[places] > beside * beyond)]
    # what a step of the converter is takes longer to find than all else
    return places[size[places] > SPIKE_STEPS * converter_step(volts)] if places.size else places

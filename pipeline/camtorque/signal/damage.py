"""What is wrong with raw samples: missing, clipped, isolated, standing still; one rule each, for `check` and `align`.

A clipped top is a run of equal samples at the end of the range from which the signal falls steeply on both sides. No
model and no cam angle is used; what `check` looks for is looked for in blocks of a channel, which may be larger than
memory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.compiled import compiled_pays
from camtorque.records import Array, Channel, Integers, Mask, SensorCalibration
from camtorque.signal import passes_compiled
from camtorque.signal.running import median, percentile
from camtorque.signal.threshold import Count, Threshold

FLAT_RUN = Count(
    6, "samples", "statistics",
    "Equal samples in a row at the end of a cycle's range that may be a clipped top: noise leaves two or three."
)  # fmt: skip
STEPS_BESIDE_FLAT = Threshold(
    30.0, "steps", "simulated rigs",
    "A clipped top falls by more than this many steps of the converter within its own length on either "
    "side; a smooth peak that is flat only for want of resolution falls by eight."
)  # fmt: skip


ZERO_ABOVE = Threshold(
    0.1, "1", "convention",
    "A sensor whose zero lies this part of its output above the lower end goes below it: a torque of 0 to 10 V does."
)  # fmt: skip
NO_VOLTAGE = Threshold(
    1.0e10, "unit of the file", "physics",
    "No logger delivers a larger number in any unit (1000 bar are 1e8 Pa): nan, infinite and absurd ones are missing."
)  # fmt: skip


def damage_of(volts: Array, lowest: float, highest: float) -> tuple[int, int, int, int]:
    """Count the samples of a cycle that are at or beyond the output range, those that are no numbers or absurd ones.

    Then come the longest run of equal samples and the length of the longest clipped top (and bottom, where ``lowest``
    is finite). What the extremes rule out is not looked for, nor are runs without equal neighbours.
    """
    if not volts.size:
        return 0, 0, 1, 0
    low, high, clipped = np.min(volts), np.max(volts), 0
    missing = 0 if low > -NO_VOLTAGE and high < NO_VOLTAGE else count_missing(volts)
    if not (lowest < low and high < highest):
        clipped = int(np.count_nonzero((volts <= lowest) | (volts >= highest)))
    if np.count_nonzero(volts[1:] == volts[:-1]) < 2:
        return clipped, missing, 1, 0
    return clipped, missing, *_runs(volts, bool(np.isfinite(lowest)))


def damage_of_each(volts: Array, ends: Array, limits: tuple[float, float], compiled: bool) -> Integers:
    """Return (m, 5) `damage_of` of each stretch and its samples in all; ``ends`` (2, m) are sample positions."""
    ends = np.clip(ends, 0.0, volts.size - 1.0).astype(np.int64)
    if not compiled:
        pieces = [volts[low : high + 1] for low, high in ends.T]
        return np.array([(*damage_of(inside, *limits), inside.size) for inside in pieces], dtype=np.int64)
    counts = np.empty((ends.shape[1], 5), dtype=np.int64)
    passes_compiled.damage_counts(volts, ends, limits, float(NO_VOLTAGE), counts)
    pairs, threes = counts[:, 2].copy(), counts[:, 3].copy()
    counts[:, 2], counts[:, 3] = np.where(pairs < 2, 1, 2), 0
    for k in np.flatnonzero(threes):
        counts[k, 2:4] = _runs(volts[ends[0, k] : ends[1, k] + 1], bool(np.isfinite(limits[0])))
    return counts


def count_missing(volts: Array) -> int:
    """Count the samples that are no voltages."""
    if volts.size and np.min(volts) > -NO_VOLTAGE and np.max(volts) < NO_VOLTAGE:
        return 0  # the extremes of a block are found several times as fast
    return int(volts.size - np.count_nonzero(np.abs(volts) < NO_VOLTAGE))


def _runs(volts: Array, two_sided: bool) -> tuple[int, int]:
    """Return the longest run of equal samples and the longest one at a clipped end."""
    starts = np.flatnonzero(np.r_[True, volts[1:] != volts[:-1]])
    lengths, values = np.diff(np.r_[starts, volts.size]), volts[starts]
    flat = 0
    for extreme in (np.nanmax(values), np.nanmin(values))[: 2 if two_sided else 1]:
        at = np.flatnonzero(values == extreme)
        if at.size:
            longest = at[[np.argmax(lengths[at])]]
            run = lengths[longest]
            flat = max(flat, int(run[0]) if _are_clipped(volts, run, starts[longest] + run - 1)[0] else 0)
    return int(lengths.max()), flat


def _are_clipped(volts: Array, runs: Integers, ends: Integers) -> Mask:
    """Tell which runs of equal samples, by length and last sample, are clipped tops or bottoms."""
    long = (runs >= FLAT_RUN) & (ends >= runs) & (ends + 1 < volts.size)
    if not long.any():
        return long
    with np.errstate(invalid="ignore", over="ignore"):  # samples that are no voltages are told as missing
        change = np.abs(np.diff(volts))
        step = np.min(change, where=change > 0.0, initial=np.inf)
        falls = [_least_fall(volts, run, end) for run, end in zip(runs[long], ends[long], strict=True)]
    long[long] = np.array(falls) > STEPS_BESIDE_FLAT * step
    return long


def _least_fall(volts: Array, run: int, end: int) -> float:
    """Return by how much the signal leaves a flat run within its length, on the side where it leaves it less.

    A delivery that begins soon after the cycle may stand at the top for longer than the cycle lasted before.
    """
    before, after = volts[max(end - 2 * run + 1, 0) : end - run + 1], volts[end + 1 : end + run + 1]
    return float(min(np.fmax.reduce(np.abs(volts[end] - side)) for side in (before, after)))


def clips_below(calibration: SensorCalibration | None) -> bool:
    """Tell whether the lower end of a sensor's output clips: one whose zero lies there rests there."""
    if calibration is None or calibration.output_min_volts < 0.0:
        return calibration is not None
    span = calibration.output_max_volts - calibration.output_min_volts
    return calibration.zero_volts - calibration.output_min_volts > ZERO_ABOVE * span


def clipped_samples(volts: Array, extreme: float) -> int:
    """Count the samples in clipped runs at one extreme of a channel."""
    there = volts == extreme
    if np.count_nonzero(there) < FLAT_RUN:
        return 0
    starts, ends = _stretches(there)
    return int(np.sum((ends - starts)[_are_clipped(volts, ends - starts, ends - 1)]))


def missing_samples(volts: Array, carried: int) -> tuple[int, int, int]:
    """Count the samples that are no voltages (there are some), their longest run and the one that goes on at the end.

    A run of ``carried`` samples went on before the first.
    """
    starts, ends = _stretches(~(np.abs(volts) < NO_VOLTAGE))
    runs = ends - starts
    count = int(runs.sum())
    runs[0] += carried if starts[0] == 0 else 0
    return count, int(runs.max()), int(runs[-1]) if ends[-1] == volts.size else 0


def _stretches(flags: Mask) -> tuple[Integers, Integers]:
    """Return where runs of flagged samples begin, and one past where they end."""
    change = np.diff(np.r_[False, flags, False].view(np.int8))
    return np.flatnonzero(change == 1), np.flatnonzero(change == -1)


def converter_step(volts: Array) -> float:
    """Return the step of the converter as far as neighbouring samples show it: a low percentile of their changes."""
    change = np.abs(np.diff(volts))
    change = change[(change > 0.0) & (change < NO_VOLTAGE)]
    return percentile(change, 5.0) if change.size else 0.0


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
    clipped_low, clipped_high : samples in clipped runs at the lowest and highest value
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

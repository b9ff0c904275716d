"""A recorded angle (counted or analogue, wrapped or not) -> pulses at whole steps of it.

The time of a step is where a straight line through the changes of the counter around it passes: a counter that
rises by one count now and then, one that rises by many counts a sample and an analogue angle are read alike.
"""

from __future__ import annotations

import numpy as np

from camtorque.align.pulses import PulseTrain, TriggerTrain
from camtorque.records import Array, Channel, Finding, Integers, Refusal
from camtorque.signal.damage import NO_VOLTAGE
from camtorque.signal.edges import Edges, missing_finding
from camtorque.signal.logger_time import sample_times
from camtorque.signal.threshold import Count, Threshold
from camtorque.units import DEGREE, TURN, counted

MOST_SAMPLES = 8_000_000
"""Of a longer log every n-th sample is read: an angle needs some per degree."""
LEVEL_SAMPLES = 20_000
"""Samples whose levels tell the quantum of the angle."""
MOST_STEPS = 120
"""Steps per turn: three degrees see the speed of any shaft."""
LEAST_STEPS = 4
COUNT_SHIFT = Threshold(
    0.25, "counts", "physics",
    "A counter of edges rounds down, half a count late in the mean, a resolver rounds to the nearest, and nothing "
    "tells which: with this shift either is a quarter of a count off, and 1 / sqrt(12) is stated."
)  # fmt: skip
FINEST = Threshold(
    5.0e-6, "rad", "physics",
    "Levels nearer to each other are one but for the rounding of the file: no counter has a million lines."
)  # fmt: skip
NEVER_TWICE = Threshold(
    0.99, "1", "physics",
    "Share of samples with a value of their own, one step from the next, beyond which steps are those of the samples."
)  # fmt: skip
WHOLE = Threshold(
    0.1, "1", "statistics",
    "Steps between the levels of a counter are whole counts but for this part; those of an analogue angle are "
    "off by a quarter in the median."
)  # fmt: skip
FEWEST_COUNTED = Count(
    65536, "counts", "convention", "A counter of edges has 16 bits or more, the disc of an absolute encoder fewer."
)
LINES = 4096
"""Steps worked on at a time."""
CHANGES_PER_STEP = 4.0
"""Changes of the counter that a line runs through, at least."""
BACKWARDS = Threshold(
    0.2, "1", "convention",
    "Part of the changes that may run against the others: noise of an analogue angle, not a shaft that swings."
)  # fmt: skip

NOT_WHOLE = Threshold(
    0.15, "turns", "convention",
    "So far from whole turns an angle does not start again for a gain that is off: it is in another unit."
)  # fmt: skip


def counter_train(channel: Channel, revolutions_per_cycle: int) -> TriggerTrain:
    """Return pulses at whole steps of a recorded angle [rad]; step zero is where it is zero.

    Raises
    ------
    Refusal : the angle does not turn, or swings to and fro
    """
    quantum = _quantum(channel)
    time, angle, findings, shared = _changes(channel, quantum)
    back = float(np.mean(np.diff(angle) < 0.0))
    turned = back > 0.5
    if turned:
        angle, back = -angle, float(np.mean(np.diff(angle) > 0.0))
    turns = (angle[-1] - angle[0]) / TURN
    if not turns > 2.0 or back > BACKWARDS:
        raise Refusal(
            f"{channel.where}: the angle runs over {turns:.2g} turns and {100.0 * back:.0f} % of its changes go back, "
            "expected at least two turns in one direction; check the channel and its unit"
        )
    n = int(np.clip(time.size / turns / CHANGES_PER_STEP, LEAST_STEPS, MOST_STEPS))
    pitch = TURN / n
    steps = np.arange(np.ceil(angle[0] / pitch) + 1.0, np.floor(angle[-1] / pitch))
    coarse = np.interp(steps * pitch, np.maximum.accumulate(angle), time)
    at, noise = _line_times(time, angle, steps * pitch, coarse, pitch)
    # a line through few levels may miss none of them, so its residual is no measure of them
    per_second = (angle[-1] - angle[0]) / (time[-1] - time[0])
    noise = max(noise * np.sqrt(1.0 + shared), quantum / np.sqrt(12.0) / per_second)
    none = np.zeros(at.size, dtype=bool)
    train = PulseTrain(
        at, steps.astype(np.int64), none, none.copy(), 0.0, {}, offset_std=quantum / np.sqrt(12.0) / pitch,
        phase_open=revolutions_per_cycle > 1,
    )  # fmt: skip
    if turned:
        text = "the recorded angle decreases: it is read in the direction of running"
        findings = (*findings, Finding("angle_turned", "info", text, channel.where))
    edges = Edges(at, 0.0, float(np.ptp(angle)), noise, "", np.empty(0))
    return TriggerTrain(channel, edges, train, n * revolutions_per_cycle, findings)


def _changes(channel: Channel, quantum: float) -> tuple[Array, Array, tuple[Finding, ...], float]:
    """Return time and unwrapped angle in the middle between samples that differ, and what is odd about the samples.

    Last comes the share of the middles that have a sample in common with the next one: their errors are not
    independent.
    """
    every = max(1, channel.n_samples // MOST_SAMPLES)
    blocks = range(0, channel.n_samples, every << 20)
    raw = np.concatenate([channel.read(a, min(a + (every << 20), channel.n_samples))[::every] for a in blocks])
    position = np.arange(raw.size, dtype=np.float64) * every
    known = np.abs(raw) < NO_VOLTAGE
    raw, position = raw[known], position[known]
    if raw.size < 3 or not np.ptp(raw) > 0.0:
        raise Refusal(
            f"{channel.where}: the angle does not change, expected one that turns; check the encoder and its channel"
        )
    angle, overflow = _unwrapped(raw, quantum, channel.where)
    findings = (*missing_finding(int(np.sum(~known)), channel.where), *_overflow_finding(overflow, quantum, channel))
    angle += COUNT_SHIFT * quantum
    moved = np.flatnonzero(np.diff(angle) != 0.0)
    middle = 0.5 * (position[moved] + position[moved + 1])
    shared = float(np.mean(np.diff(moved) == 1)) if moved.size > 1 else 0.0
    return sample_times(channel, middle), 0.5 * (angle[moved] + angle[moved + 1]), findings, shared


def _overflow_finding(overflow: float, quantum: float, channel: Channel) -> tuple[Finding, ...]:
    if not overflow:
        return ()
    text = (
        f"the counter starts again after {overflow / quantum:.0f} counts, {overflow / TURN:.4g} turns, and is taken "
        "not to have done so before the log began: its zero is at nominal_angle_deg only then"
    )
    return (Finding("counter_overflows", "warning", text, channel.where),)


def _quantum(channel: Channel) -> float:
    """Return the step between neighbouring levels of a counter [rad], 0 where the angle has no levels."""
    raw = channel.read(0, min(channel.n_samples, LEVEL_SAMPLES))
    steps = np.diff(np.unique(raw[np.abs(raw) < NO_VOLTAGE]))
    steps = steps[steps > FINEST]
    if not steps.size:
        return 0.0
    # a shaft that turns by two or three counts a sample shows no single one
    apart = np.diff(np.unique(steps))
    quantum = float(min(steps.min(), np.min(apart, where=apart > FINEST, initial=np.inf)))
    # an even ramp of full precision has a new value at every sample, one step on: no shaft keeps to its counts so
    if steps.size > NEVER_TWICE * raw.size and np.max(steps) < 1.5 * quantum:
        return 0.0
    return quantum if np.median(np.abs(steps / quantum - np.rint(steps / quantum))) < WHOLE else 0.0


def _unwrapped(raw: Array, quantum: float, where: str) -> tuple[Array, float]:
    """Return an angle without the jumps of a counter that starts again, and after how much it overflows [rad].

    That is 0 where it starts again after whole turns.

    Raises
    ------
    Refusal : it starts again after neither
    """
    step, reach = np.diff(raw), float(np.ptp(raw))
    wraps = np.where(np.abs(step) > 0.5 * reach, -np.sign(step), 0.0)
    if not wraps.any() or np.mean(wraps != 0.0) > 0.1:
        return np.unwrap(raw), 0.0
    whole, overflow = TURN * max(1.0, np.round(reach / TURN)), 0.0
    # neither end of the range need be sampled: it is longer than what is seen by a step at most
    longest = float(np.max(np.abs(step[wraps == 0.0]))) + quantum
    bits = quantum * 2.0 ** np.round(np.log2(reach / quantum + 1.0)) if quantum else 0.0
    if abs(whole - reach) > longest and 0.0 < bits - reach <= longest:
        whole = overflow = float(bits)
        _refuse_counts_as_degrees(quantum, round(bits / quantum), where)
    if abs(whole - reach) > max(longest, NOT_WHOLE * TURN):
        turns = f"{reach / TURN:.3g}" if reach < 100.0 * TURN else f"{reach / TURN:.1f}"
        other = _in_other_unit(reach, longest) or ", and whether it was set to zero while it turned"
        raise Refusal(
            f"{where}: the angle starts again after {turns} turns, expected whole ones; check its unit{other}"
        )
    return raw + whole * np.r_[0.0, np.cumsum(wraps)], overflow


def _refuse_counts_as_degrees(quantum: float, counts: int, where: str) -> None:
    """Refuse counts of an absolute encoder that are taken for degrees: no counter of so few bits counts those."""
    if counts < FEWEST_COUNTED and abs(quantum - DEGREE) < FINEST:
        raise Refusal(
            f"{where}: the angle starts again after {counts} whole degrees, {counts / 360.0:.4g} turns, expected whole "
            f'turns; where these are the counts of an encoder of {counts} a turn, write unit = "rev/{counts}"'
        )


def _in_other_unit(reach: float, longest: float) -> str:
    """Return after how many turns of the other unit an angle starts again, nothing where these are none."""
    for factor, unit in ((DEGREE, "rad"), (1.0 / DEGREE, "deg")):
        for turns in (1, 2):
            if abs(turns * TURN - reach / factor) <= longest / factor:
                return f": in {unit} it is {counted(turns, 'turn', 'turns')}"
    return ""


def _line_times(time: Array, angle: Array, wanted: Array, coarse: Array, pitch: float) -> tuple[Array, float]:
    """Return when each wanted angle is passed, and the standard error of one such time."""
    begin = np.searchsorted(time, np.interp(wanted - 0.5 * pitch, wanted, coarse, left=coarse[0]))
    end = np.searchsorted(time, np.interp(wanted + 0.5 * pitch, wanted, coarse, right=coarse[-1]))
    at, error = coarse.copy(), np.zeros(wanted.size)
    for first in range(0, wanted.size, LINES):
        part = slice(first, first + LINES)
        at[part], error[part] = _fit_lines(time, angle, (wanted[part], coarse[part]), (begin[part], end[part]))
    return at, float(np.median(error))


def _fit_lines(
    time: Array, angle: Array, about: tuple[Array, Array], ends: tuple[Integers, Integers]
) -> tuple[Array, Array]:
    """Fit time over angle between the ends of each line; too few points leave the coarse time.

    ``about`` are the wanted angles and their coarse times: sums of small differences stay exact.
    """
    (wanted, coarse), (begin, end) = about, ends
    n = np.maximum(end - begin, 0)
    which = np.repeat(np.arange(n.size), n)
    point = np.arange(which.size) + np.repeat(begin - np.cumsum(n) + n, n)

    def sums(values: Array) -> Array:
        return np.bincount(which, values, minlength=n.size).astype(np.float64)

    a, t = angle[point] - wanted[which], time[point] - coarse[which]
    count = np.maximum(n, 1)
    mean_a, mean_t = sums(a) / count, sums(t) / count
    a, t = a - mean_a[which], t - mean_t[which]
    spread = sums(a * a)
    known = (n >= 3) & (spread > 0.0)
    divisor = np.where(known, spread, 1.0)
    slope = sums(a * t) / divisor
    rest = sums((t - slope[which] * a) ** 2) / np.maximum(n - 2, 1)
    error = np.sqrt(rest * (1.0 / count + mean_a**2 / divisor))
    return np.where(known, coarse + mean_t - slope * mean_a, coarse), np.where(known, error, 0.0)

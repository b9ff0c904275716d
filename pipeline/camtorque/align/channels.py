"""Which channels are aligned; each read once, from front to back in blocks of whole cycles, onto the angle grid."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from camtorque.align.angle import CamAngle
from camtorque.align.clocks import Clock
from camtorque.align.options import AlignOptions
from camtorque.align.resample import choose_rule, resampler
from camtorque.align.sources import ANGLE_CHANNELS
from camtorque.compiled import compiled_pays
from camtorque.records import Array, Channel, Finding, Integers, Mask, Recording, Refusal
from camtorque.signal.damage import clips_below, damage_of_each
from camtorque.signal.logger_time import sample_positions
from camtorque.signal.threshold import Threshold
from camtorque.stacks import empty_stack, give_back
from camtorque.units import TURN

CUT_BY = ("torque", "pressure")
"""Quantities whose damage costs a cycle."""
BLOCK = 1 << 18
"""Samples resampled at a time: they and their rows fit into the processor's cache."""
BEYOND_END = Threshold(
    0.005, "1", "convention",
    "Share of the stated output range by which values that stand at its end do not pass it; a round top that passes it "
    "is not clipped there: amplifiers of 10 V go on to 10.5 to 12 V."
)  # fmt: skip
MARGIN = 3
"""Samples beyond the ends of a cycle that interpolation and bin borders may touch."""


@dataclass(frozen=True)
class Measured:
    """Channels by quantity: ``main`` are torque and pressure, ``other`` all that remain but those of the angle."""

    main: Mapping[str, Channel]
    other: Mapping[str, Channel]

    @property
    def reference(self) -> str:
        """Logger whose clock is the time: that of the torque, else of the pressure, else of the first channel."""
        return next(iter((*self.main.values(), *self.other.values()))).logger


def measured(recording: Recording) -> Measured:
    """Return the channels to be aligned.

    Raises
    ------
    Refusal : there is none, or two of one quantity
    """
    found: dict[str, Channel] = {}
    for channel in recording.channels:
        if channel.quantity in ANGLE_CHANNELS:
            continue
        if channel.quantity in found:
            count = len(recording.of(channel.quantity))
            raise Refusal(
                f"{recording.config.id}: found {count} {channel.quantity} channels, expected one; keep one "
                "[[channels]] entry"
            )
        found[channel.quantity] = channel
    if not found:
        raise Refusal(
            f"{recording.config.id}: found nothing but channels of the angle, expected one that measures something; "
            'add a [[channels]] entry, such as quantity = "torque"'
        )
    main = {quantity: found[quantity] for quantity in CUT_BY if quantity in found}
    return Measured(main, {quantity: channel for quantity, channel in found.items() if quantity not in main})


@dataclass(frozen=True)
class ChannelDamage:
    """Per cycle, on the raw samples (see `signal.damage.damage_of`), and the samples in all.

    ``flat_run`` is the length of the longest clipped top (or bottom of a torque), 0 where there is none.
    """

    clipped: Integers
    missing: Integers
    longest_run: Integers
    flat_run: Integers
    n_samples: Integers


@dataclass(frozen=True)
class AlignedChannel:
    """One channel on the grid, before the cuts.

    Attributes
    ----------
    rows : (n_candidates, n_theta) SI; nan for incomplete cycles
    extremes : (n_candidates, 2) smallest and largest value of each row
    samples_per_step : samples in one grid step
    rule : see `camtorque.align.resample`
    """

    channel: Channel
    rows: Array
    extremes: Array
    damage: ChannelDamage
    samples_per_step: float
    rule: int


def positions(channel: Channel, clock: Clock, times: Array) -> Array:
    """Return the sample positions at which a channel shows what happened at the given reference times."""
    delay = channel.calibration.delay if channel.calibration else 0.0
    return sample_positions(channel, clock.from_reference(times + delay))


@dataclass(frozen=True)
class Turns:
    """The turns of the cam that the pulses cover, one clock for all channels, and how these are put on the grid."""

    angle: CamAngle
    clocks: Mapping[str, Clock]
    options: AlignOptions

    @cached_property
    def cycles(self) -> Integers:
        """Their numbers, (n,)."""
        return self.angle.candidate_cycles()

    @cached_property
    def times(self) -> tuple[Array, Array, Array]:
        """Begin, middle and end of each, (n,) [s]."""
        begin, middle, end = (self.angle.time_at((self.cycles + part) * TURN) for part in (0.0, 0.5, 1.0))
        return begin, middle, end

    def covered(self, channels: Iterable[Channel]) -> Mask:
        """Tell which of them every channel covers from theta = 0 to one revolution later."""
        begin, _, end = self.times
        complete = np.ones(self.cycles.size, dtype=bool)
        for channel in channels:
            clock = self.clocks[channel.logger]
            complete &= positions(channel, clock, begin) >= 1.0
            complete &= positions(channel, clock, end) <= channel.n_samples - 2.0
        return complete


def align_channels(channels: Mapping[str, Channel], turns: Turns, complete: Mask) -> dict[str, AlignedChannel]:
    """Resample the complete turns of some channels side by side; files are read by one thread at a time."""
    reading = threading.Lock()
    with ThreadPoolExecutor(max_workers=2) as pool:
        jobs = {
            quantity: pool.submit(_align_channel, channel, turns, complete, reading)
            for quantity, channel in channels.items()
        }
        return {quantity: job.result() for quantity, job in jobs.items()}


def align_others(
    channels: Mapping[str, Channel], turns: Turns
) -> tuple[dict[str, AlignedChannel], tuple[Finding, ...]]:
    """Return the other channels on the grid, nan in cycles that they do not cover, and findings about those."""
    aligned: dict[str, AlignedChannel] = {}
    findings = []
    for quantity, channel in channels.items():
        if channel.logger not in turns.clocks:
            text = (
                f"the {quantity} is left out: its logger {channel.logger!r} has its own clock and shares no trigger, "
                "torque or pressure with the others"
            )
            findings.append(Finding("channel_untied", "warning", text, channel.where))
            continue
        there = turns.covered([channel])
        if not there.any():
            text = f"the {quantity} is left out: it covers none of {there.size} cycles"
            findings.append(Finding("channel_not_covering", "warning", text, channel.where))
            continue
        aligned |= align_channels({quantity: channel}, turns, there)
    return aligned, tuple(findings)


def _align_channel(channel: Channel, turns: Turns, complete: Mask, reading: threading.Lock) -> AlignedChannel:
    angle, cycles, options, clock = turns.angle, turns.cycles, turns.options, turns.clocks[channel.logger]
    rows = empty_stack(cycles.size, options.n_theta)
    damage, extremes = np.zeros((cycles.size, 5), dtype=np.int64), np.full((cycles.size, 2), np.nan)
    rows[~complete] = np.nan
    begin, middle, end = turns.times
    samples_per_step = float(np.median(end - begin)) * channel.sample_rate / options.n_theta
    rule, compiled = choose_rule(options.interpolation, samples_per_step), compiled_pays(channel.n_samples)
    resample_block = resampler(compiled)
    law, limits = _law(channel)
    first = np.maximum(0, positions(channel, clock, begin).astype(np.int64) - MARGIN - int(samples_per_step))
    stop = np.minimum(
        channel.n_samples, positions(channel, clock, end).astype(np.int64) + MARGIN + int(samples_per_step)
    )
    rate = (1.0 + 1e-6 * clock.fit.skew_ppm) * channel.sample_rate
    shift = positions(channel, clock, middle) - rate * middle
    for group in _groups(first, stop, complete, cycles):
        with reading:
            volts = np.require(channel.source.read(first[group][0], stop[group][-1]), np.float64, ["C", "W"])
        place = shift[group] - first[group][0]
        with np.errstate(over="ignore", invalid="ignore"):  # samples that are no voltages are counted below
            resample_block(volts, rate, place, cycles[group], angle.angle, angle.polynomials, rule, law, rows[group])
        extremes[group] = np.column_stack([np.min(rows[group], axis=1), np.max(rows[group], axis=1)])
        damage[group] = damage_of_each(volts, rate * np.array([begin[group], end[group]]) + place, limits, compiled)
        give_back(rows)
    if complete.any() and _goes_on(np.median(extremes[complete], axis=0), law, limits):
        damage[:, 0] = 0
    return AlignedChannel(channel, rows, extremes, ChannelDamage(*damage.T), samples_per_step, rule)


def _law(channel: Channel) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return zero and gain, and output range on the raw samples of the file."""
    calibration = channel.calibration
    if calibration is None:
        return (0.0, channel.scale), (-np.inf, np.inf)
    low, high = -np.inf, np.inf
    if calibration.saturates:
        low = calibration.output_min_volts / channel.scale if clips_below(calibration) else low
        high = calibration.output_max_volts / channel.scale
    return (calibration.zero_volts / channel.scale, channel.sign * channel.scale * calibration.gain), (low, high)


def _goes_on(extremes: Array, law: tuple[float, float], limits: tuple[float, float]) -> bool:
    """Tell whether a usual cycle passes an end of the output range clearly: the amplifier ends elsewhere.

    ``extremes`` : (2,) lowest and highest value of the cycle in SI
    """
    zero, gain = law
    low, high = np.sort(extremes / gain + zero)
    lowest, highest = limits
    return bool(low < lowest - BEYOND_END * abs(lowest) or high > highest + BEYOND_END * abs(highest))


def _groups(first: Integers, stop: Integers, complete: Mask, cycles: Integers) -> Iterator[slice]:
    """Yield runs of complete consecutive cycles that fit into a block; one that is longer is a run by itself."""
    follows = complete[1:] & (np.diff(cycles) == 1)
    k = 0
    while k < complete.size:
        if not complete[k]:
            k += 1
            continue
        last = k
        while last < follows.size and follows[last] and stop[last + 1] - first[k] <= BLOCK:
            last += 1
        yield slice(k, last + 1)
        k = last + 1

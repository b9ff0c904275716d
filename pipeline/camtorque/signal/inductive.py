"""Voltage of an inductive pick-up -> zero crossings at the middle of each tooth; the one finder of any pulses.

A coil gives the rate of change of the flux: a wave per tooth whose height grows with the speed, and a larger one beside
a gap of the wheel. So a wave counts by comparison with its neighbours, not by a level: its two halves have to reach a
third of what is usual among the waves beside it. The time is where the flank between the halves passes zero, from a
straight line through the samples in the middle of the flank.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from camtorque.records import Array, Channel, Finding, Integers, Refusal
from camtorque.signal.damage import NO_VOLTAGE
from camtorque.signal.edges import Edges, find_edges, missing_finding
from camtorque.signal.levels import without_missing
from camtorque.signal.logger_time import sample_times
from camtorque.signal.threshold import Threshold

REAL_WAVE = Threshold(
    1.0 / 3.0, "1", "simulated rigs", "Part of the usual height beside it that both halves of a tooth's wave reach."
)
NEIGHBOURS = 16
"""Half waves on either side among which the usual height is looked for."""
USUAL_PERCENTILE = 75.0
"""The gap makes one or two high waves a revolution, noise many low ones: the usual one lies high, but not highest."""
FAINT = Threshold(
    0.01, "1", "physics",
    "Half waves lower than this part of the highest ones are noise of a shaft at rest: speeds of 1 to 100 in one log."
)  # fmt: skip
NOISE_HEIGHTS = Threshold(
    5.0, "1", "statistics", "Half waves are higher than this many standard deviations of the noise."
)
HUM_BELOW = Threshold(
    3.0, "1", "physics",
    "Lowest half wave of a tooth over the highest of a hum between single teeth; the wave beside a gap of one to three "
    "teeth is 1.5 to 2.3 times as high as the others."
)  # fmt: skip
AROUND = Threshold(
    3.0, "1", "physics",
    "The two half waves of a single tooth are this much nearer to each other than to those of the next one."
)  # fmt: skip
LEAST_TEETH = 4
"""Half waves of teeth that a hum is told from."""
TURNED = {"rising": "falling", "falling": "rising"}
MIDDLE_OF_FLANK = 0.4
"""Part of the lower half wave up to which a flank is straight."""
MOST_FLANK = 24
"""Samples on either side of a crossing that the line uses, at most."""
BLOCK = 1 << 18
"""Samples looked at at a time."""
ROWS = 1 << 14
"""Waves worked on at a time."""
LEAST_FOR_NOISE = 5
"""Samples in a line from which its residual says what the noise is."""


@dataclass(frozen=True)
class Waves:
    """Half waves between crossings of zero: ``begin`` is the sample at which one starts, ``height`` is signed [V]."""

    begin: Integers
    height: Array


def find_crossings(channel: Channel, declared: str) -> Edges:
    """Return the zero crossings of the teeth: from plus to minus for ``falling``, from minus to plus for ``rising``.

    Raises
    ------
    Refusal : no waves in the channel
    """
    sign = -1.0 if declared == "falling" else 1.0
    level, noise = _level_and_noise(channel)
    waves, n_missing = _all_waves(channel, sign, level)
    waves = _merged(waves, np.full(waves.height.size, _floor(waves, NOISE_HEIGHTS * noise)))
    waves = _merged(waves, np.full(waves.height.size, _hum(waves)))
    waves = _merged(waves, REAL_WAVE * _running_percentile(np.abs(waves.height), NEIGHBOURS, USUAL_PERCENTILE))
    ends = np.flatnonzero((waves.height[:-1] < 0.0) & (waves.height[1:] > 0.0)) + 1
    if ends.size < 2:
        raise Refusal(
            f"{channel.where}: found {ends.size} teeth in {channel.duration:.3g} s of an inductive pick-up with a "
            f"noise of {noise:.2g} V, expected at least two revolutions; check that the channel is the pick-up and "
            "that the shaft turned"
        )
    low = np.minimum(-waves.height[ends - 1], waves.height[ends])
    position, variance = _positions(channel, waves.begin[ends], low, sign, level, noise)
    time = sample_times(channel, position)
    other = np.flatnonzero((waves.height[:-1] > 0.0) & (waves.height[1:] < 0.0)) + 1
    height = float(np.median(waves.height[ends] - waves.height[ends - 1]))
    opposite = sample_times(channel, waves.begin[other].astype(np.float64))
    width = 0.5 * float(np.median(np.diff(time)))
    edge_noise = float(np.sqrt(np.median(variance))) / channel.sample_rate
    return Edges(time, width, height, edge_noise, declared, opposite, missing_finding(n_missing, channel.where))


def _level_and_noise(channel: Channel) -> tuple[float, float]:
    """Return the rest level (the mean of a derivative is zero) and the noise from third differences [V]."""
    pieces = np.linspace(0, max(0, channel.n_samples - 4096), 64).astype(int)
    parts = [channel.read_volts(first, min(first + 4096, channel.n_samples)) for first in np.unique(pieces)]
    parts = [known for known in (part[np.abs(part) < NO_VOLTAGE] for part in parts) if known.size]
    third = [float(np.median(np.abs(np.diff(part, 3)))) for part in parts if part.size > 8]
    # the quietest tenth: third differences of a wave that is sampled coarsely are no noise
    noise = 1.4826 / np.sqrt(20.0) * float(np.percentile(third, 10)) if third else 0.0
    return float(np.mean(np.concatenate(parts))) if parts else 0.0, noise


def _all_waves(channel: Channel, sign: float, level: float) -> tuple[Waves, int]:
    """Return every half wave of the channel, however low, and the samples that are missing."""
    begins, heights, n_missing = [], [], 0
    state = np.zeros(3)
    for start in range(0, channel.n_samples, BLOCK):
        volts, missing = without_missing(channel.read_volts(start, min(start + BLOCK, channel.n_samples)))
        n_missing += missing
        begin, height = _half_waves(sign * (volts - level), start, state)
        begins.append(begin)
        heights.append(height)
    last = np.array([state[0]]), np.array([state[1]])
    return Waves(np.concatenate([*begins, last[0].astype(np.int64)]), np.concatenate([*heights, last[1]])), n_missing


def _half_waves(values: Array, first: int, state: Array) -> tuple[Integers, Array]:
    """Split a block at its zero crossings; ``state`` carries begin and height of the half wave that goes on."""
    known = np.flatnonzero(np.abs(values) > 0.0)
    signed = np.r_[state[1], values[known]]
    begins = np.r_[0, np.flatnonzero(signed[1:] * signed[:-1] < 0.0) + 1]
    begin = np.r_[int(state[0]), first + known][begins]
    sign = np.sign(signed[begins])
    if state[1] == 0.0 and known.size:  # no wave went before
        sign[0] = np.sign(signed[1])
    height = sign * np.maximum.reduceat(np.abs(signed), begins)
    state[0], state[1] = begin[-1], height[-1]
    return begin[:-1], height[:-1]


def _floor(waves: Waves, least: float) -> float:
    """Return the height below which a half wave is noise, whatever is beside it [V]."""
    size = np.abs(waves.height)
    high = size[size > least]
    return max(least, FAINT * float(np.percentile(high, 99.0))) if high.size else np.inf


def _hum(waves: Waves) -> float:
    """Return the height up to which half waves are those of a hum between single teeth, 0 where there is none [V].

    Of few teeth a turn most waves are the hum's, and no tooth stands among what is usual beside it. Teeth of a log of
    two speeds have two heights as well, but one after the other.
    """
    size = np.sort(np.abs(waves.height))[::-1]
    gaps = np.flatnonzero(size[:-1] > HUM_BELOW * size[1:])
    gaps = gaps[gaps >= LEAST_TEETH - 1]
    if not gaps.size:
        return 0.0
    least = float(np.sqrt(size[gaps[0]] * size[gaps[0] + 1]))
    teeth = np.abs(waves.height) > least
    between = np.count_nonzero(teeth[1:] > teeth[:-1])
    return least if between >= np.count_nonzero(teeth) / LEAST_TEETH else 0.0


def _running_percentile(values: Array, half: int, percentile: float) -> Array:
    """Return a percentile of the neighbours of each value, without interpolation; windows shrink at the ends."""
    out, width = np.zeros(values.size), 2 * half + 1
    for begin in range(half, values.size - half, ROWS):
        windows = sliding_window_view(values[begin - half : begin + ROWS + half], width)
        out[begin : begin + windows.shape[0]] = _ranked(windows, percentile)
    for i in (*range(min(half, values.size)), *range(max(values.size - half, min(half, values.size)), values.size)):
        out[i] = _ranked(values[None, max(0, i - half) : i + half + 1], percentile)[0]
    return out


def _ranked(windows: Array, percentile: float) -> Array:
    rank = int((windows.shape[1] - 1) * percentile / 100.0)
    return np.partition(windows, rank, axis=1)[:, rank]


def _merged(waves: Waves, least: Array) -> Waves:
    """Leave out the half waves that are too low, and join what lies on the two sides of one."""
    real = np.flatnonzero(np.abs(waves.height) > least)
    if not real.size:
        return Waves(waves.begin[:0], waves.height[:0])
    height, begin = waves.height[real], waves.begin[real]
    same = np.r_[False, np.sign(height[1:]) == np.sign(height[:-1])]
    # the first of equal signs begins the half wave, the highest gives its height
    starts = np.flatnonzero(~same)
    return Waves(begin[starts], np.sign(height[starts]) * np.maximum.reduceat(np.abs(height), starts))


def _positions(
    channel: Channel, after: Integers, low: Array, sign: float, level: float, noise: float
) -> tuple[Array, Array]:
    """Return the crossings [samples] and the variance of each."""
    position, variance = np.empty(after.size), np.empty(after.size)
    for start in range(0, after.size, ROWS):
        part = slice(start, min(start + ROWS, after.size))
        first = max(0, int(after[part][0]) - MOST_FLANK)
        stop = min(channel.n_samples, int(after[part][-1]) + MOST_FLANK + 1)
        values = sign * (channel.read_volts(first, stop) - level)
        found = _crossings(values, after[part] - first, MIDDLE_OF_FLANK * low[part], noise)
        position[part], variance[part] = found[0] + first, found[1]
    return position, variance


def _crossings(values: Array, after: Integers, limit: Array, noise: float) -> tuple[Array, Array]:
    """Return where a line through the middle of each flank passes zero, and its variance [samples^2]."""
    at = np.clip(after, 1, values.size - 1)
    # as many samples on either side: a flank that bends turns the line about its middle
    reach = np.minimum(_reach(values, at - 1, limit, -1), _reach(values, at, limit, 1))
    place = np.arange(-MOST_FLANK - 1, MOST_FLANK + 1) + 0.5
    used = np.abs(place) < reach[:, None]
    n = 2.0 * reach
    samples = np.where(used, values[np.clip(at[:, None] + (place - 0.5).astype(np.int64), 0, values.size - 1)], 0.0)
    spread = np.sum(used * place**2, axis=1)
    mean, slope = np.sum(samples, axis=1) / n, samples @ place / spread
    rest = np.sum(np.where(used, samples - mean[:, None] - slope[:, None] * place, 0.0) ** 2, axis=1)
    shift = np.where(slope > 0.0, -mean / np.where(slope > 0.0, slope, 1.0), 0.0)
    position = at - 0.5 + np.clip(shift, -0.5 * n, 0.5 * n)
    scatter = np.where(n >= LEAST_FOR_NOISE, rest / np.maximum(n - 2.0, 1.0), noise * noise)
    return position, scatter / np.maximum(slope, 1e-30) ** 2 * (1.0 / n + shift**2 / spread)


def _reach(values: Array, start: Integers, limit: Array, way: int) -> Integers:
    """Return how many samples of a flank lie from ``start`` on one way, ``start`` included."""
    reach, moving = np.ones(start.size, dtype=np.int64), np.arange(start.size)
    while moving.size:
        next_one = start[moving] + way * reach[moving]
        there = (next_one >= 0) & (next_one < values.size) & (reach[moving] <= MOST_FLANK - (way < 0))
        inside = np.abs(values[np.clip(next_one, 0, values.size - 1)]) < limit[moving]
        moving = moving[there & inside]
        reach[moving] += 1
    return reach


def _of_single_teeth(channel: Channel, declared: str) -> Edges:
    """Return the crossings at the teeth of a coil; of single teeth the others lie where no tooth passes."""
    edges = find_crossings(channel, declared)
    after = np.searchsorted(edges.opposite, edges.time)
    inner = (after > 0) & (after < edges.opposite.size)
    begun, ended = edges.opposite[after[inner] - 1], edges.opposite[after[inner]]
    before, behind = edges.time[inner] - begun, ended - edges.time[inner]
    if not inner.any() or np.median(before) <= AROUND * np.median(behind):
        return edges
    turned = find_crossings(channel, TURNED[declared])
    text = (
        f"the inductive pick-up crosses zero {turned.edge} at the teeth and {declared}, as declared, only between "
        "them: its wires are exchanged, or edge in [trigger] is wrong; the crossings at the teeth are taken"
    )
    return replace(turned, findings=(*turned.findings, Finding("trigger_inverted", "warning", text, channel.where)))


def find_pulses(channel: Channel, sensor: str, edge: str) -> Edges:
    """Return the declared edge of every pulse of a pick-up, for `check` and for `align`; ``sensor`` as in [trigger].

    Raises
    ------
    Refusal : no pulses in the channel
    """
    return _of_single_teeth(channel, edge) if sensor == "inductive" else find_edges(channel, edge)

"""Voltage of an inductive pick-up -> zero crossings at the middle of each tooth, whatever the speed.

A coil gives the rate of change of the flux: a wave per tooth whose height grows with the speed, and a larger one beside
a gap of the wheel. So a wave counts by comparison with its neighbours, not by a level: its two halves have to reach a
third of what is usual among the waves beside it. The time is where the flank between the halves passes zero, from a
straight line through the samples in the middle of the flank.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from camtorque.records import Array, Channel, Refusal
from camtorque.signal.damage import NO_VOLTAGE
from camtorque.signal.edges import Edges, missing_finding
from camtorque.signal.levels import without_missing
from camtorque.signal.logger_time import sample_times
from camtorque.signal.threshold import Threshold

REAL_WAVE = Threshold(
    1.0 / 3.0, "1", "simulated rigs",
    "Part of the usual height beside it that both halves of a tooth's wave reach."
)  # fmt: skip
NEIGHBOURS = 16
"""Half waves on either side among which the usual height is looked for."""
USUAL_PERCENTILE = 75.0
"""The gap makes one or two high waves a revolution, noise many low ones: the usual one lies high, but not highest."""
FAINT = Threshold(
    0.01, "1", "physics",
    "Half waves lower than this part of the highest ones are noise of a shaft at rest: speeds of 1 to 100 "
    "in one log."
)  # fmt: skip
NOISE_HEIGHTS = Threshold(
    5.0, "1", "statistics",
    "Half waves are higher than this many standard deviations of the noise."
)  # fmt: skip
MIDDLE_OF_FLANK = 0.4
"""Part of the lower half wave up to which a flank is straight."""
MOST_FLANK = 24
"""Samples on either side of a crossing that the line uses, at most."""
LEAST_FOR_NOISE = 5
"""Samples in a line from which its residual says what the noise is."""


@dataclass(frozen=True)
class Waves:
    """Half waves between crossings of zero: ``begin`` is the sample at which one starts, ``height`` is signed [V]."""

    begin: NDArray[np.int64]
    height: Array


def find_crossings(channel: Channel, declared: str, block_samples: int = 1 << 20) -> Edges:
    """Return the zero crossings of the teeth: from plus to minus for ``falling``, from minus to plus for ``rising``.

    Raises
    ------
    Refusal
        No waves in the channel.
    """
    sign = -1.0 if declared == "falling" else 1.0
    level, noise = _level_and_noise(channel)
    waves, n_missing = _all_waves(channel, sign, level, block_samples)
    waves = _merged(waves, np.full(waves.height.size, _floor(waves, NOISE_HEIGHTS * noise)))
    waves = _merged(waves, REAL_WAVE * _running_percentile(np.abs(waves.height), NEIGHBOURS, USUAL_PERCENTILE))
    ends = np.flatnonzero((waves.height[:-1] < 0.0) & (waves.height[1:] > 0.0)) + 1
    where = f"{channel.path.name}, channel {channel.name!r}"
    if ends.size < 2:
        raise Refusal(
            f"{where}: found {ends.size} teeth in {channel.duration:.3g} s of an inductive pick-up with a noise of "
            f"{noise:.2g} V, expected at least two revolutions; check that the channel is the pick-up and that the "
            "shaft turned"
        )
    low = np.minimum(-waves.height[ends - 1], waves.height[ends])
    position, variance = _positions(channel, waves.begin[ends], low, sign, level, noise)
    time = sample_times(channel, position)
    other = np.flatnonzero((waves.height[:-1] > 0.0) & (waves.height[1:] < 0.0)) + 1
    height = float(np.median(waves.height[ends] - waves.height[ends - 1]))
    opposite = sample_times(channel, waves.begin[other].astype(np.float64))
    width = 0.5 * float(np.median(np.diff(time)))
    edge_noise = float(np.sqrt(np.median(variance))) / channel.sample_rate
    return Edges(time, width, height, edge_noise, 0.5, declared, n_missing, opposite, missing_finding(n_missing, where))


def _level_and_noise(channel: Channel) -> tuple[float, float]:
    """Return the rest level (the mean of a derivative is zero) and the noise from third differences [V]."""
    pieces = np.linspace(0, max(0, channel.n_samples - 4096), 64).astype(int)
    parts = [channel.read_volts(first, min(first + 4096, channel.n_samples)) for first in np.unique(pieces)]
    parts = [part[np.abs(part) < NO_VOLTAGE] for part in parts]
    third = [float(np.median(np.abs(np.diff(part, 3)))) for part in parts if part.size > 8]
    # the quietest tenth: third differences of a wave that is sampled coarsely are no noise
    noise = 1.4826 / np.sqrt(20.0) * float(np.percentile(third, 10)) if third else 0.0
    return float(np.mean(np.concatenate(parts))) if parts else 0.0, noise


def _all_waves(channel: Channel, sign: float, level: float, block: int) -> tuple[Waves, int]:
    """Return every half wave of the channel, however low, and the samples that are missing."""
    begins, heights, n_missing = [], [], 0
    state = np.zeros(3)
    for start in range(0, channel.n_samples, block):
        volts, missing = without_missing(channel.read_volts(start, min(start + block, channel.n_samples)))
        n_missing += missing
        begin, height = _half_waves(sign * (volts - level), start, state)
        begins.append(begin)
        heights.append(height)
    last = np.array([state[0]]), np.array([state[1]])
    return Waves(np.concatenate([*begins, last[0].astype(np.int64)]), np.concatenate([*heights, last[1]])), n_missing


@numba.njit(cache=True, nogil=True)
def _half_waves(values: Array, first: int, state: Array) -> tuple[NDArray[np.int64], Array]:
    """Split a block at its zero crossings; ``state`` carries begin and height of the half wave that goes on."""
    begin, height = np.empty(values.size + 1, dtype=np.int64), np.empty(values.size + 1)
    count = 0
    for i in range(values.size):
        value = values[i]
        if not (value > 0.0 or value < 0.0):
            continue
        if value * state[1] < 0.0:
            begin[count], height[count] = int(state[0]), state[1]
            count += 1
            state[0], state[1] = first + i, value
        elif abs(value) > abs(state[1]):
            state[1] = value
    return begin[:count], height[:count]


def _floor(waves: Waves, least: float) -> float:
    """Return the height below which a half wave is noise, whatever is beside it [V]."""
    size = np.abs(waves.height)
    high = size[size > least]
    return max(least, FAINT * float(np.percentile(high, 99.0))) if high.size else np.inf


@numba.njit(cache=True, nogil=True)
def _running_percentile(values: Array, half: int, percentile: float) -> Array:
    out = np.zeros(values.size)
    for i in range(values.size):
        room = np.sort(values[max(0, i - half) : min(values.size, i + half + 1)])
        out[i] = room[int((room.size - 1) * percentile / 100.0)]
    return out


def _merged(waves: Waves, least: Array) -> Waves:
    """Leave out the half waves that are too low, and join what lies on the two sides of one."""
    real = np.flatnonzero(np.abs(waves.height) > least)
    height, begin = waves.height[real], waves.begin[real]
    same = np.r_[False, np.sign(height[1:]) == np.sign(height[:-1])]
    # the first of equal signs begins the half wave, the highest gives its height
    group = np.cumsum(~same) - 1
    if not group.size:
        return Waves(begin, height)
    starts = np.flatnonzero(~same)
    return Waves(begin[starts], np.sign(height[starts]) * np.maximum.reduceat(np.abs(height), starts))


def _positions(
    channel: Channel, after: NDArray[np.int64], low: Array, sign: float, level: float, noise: float
) -> tuple[Array, Array]:
    """Return the crossings [samples] and the variance of each."""
    position, variance = np.empty(after.size), np.empty(after.size)
    for start in range(0, after.size, 1 << 14):
        part = slice(start, min(start + (1 << 14), after.size))
        first = max(0, int(after[part][0]) - MOST_FLANK)
        stop = min(channel.n_samples, int(after[part][-1]) + MOST_FLANK + 1)
        values = sign * (channel.read_volts(first, stop) - level)
        _crossings(values, after[part] - first, MIDDLE_OF_FLANK * low[part], noise, position[part], variance[part])
        position[part] += first
    return position, variance


@numba.njit(cache=True, nogil=True)
def _crossings(
    values: Array, after: NDArray[np.int64], limit: Array, noise: float, position: Array, variance: Array
) -> None:
    """Fill in where a line through the middle of each flank passes zero, and its variance [samples^2]."""
    for k in range(after.size):
        i = min(max(after[k], 1), values.size - 1)
        left, right = i - 1, i
        while left > 0 and i - left < MOST_FLANK and abs(values[left - 1]) < limit[k]:
            left -= 1
        while right < values.size - 1 and right - i < MOST_FLANK and abs(values[right + 1]) < limit[k]:
            right += 1
        # as many samples on either side: a flank that bends turns the line about its middle
        reach = min(i - left, right - i + 1)
        left, right = i - reach, i + reach - 1
        n = right - left + 1
        middle, mean = 0.5 * (left + right), np.mean(values[left : right + 1])
        slope, spread = 0.0, 0.0
        for j in range(left, right + 1):
            slope += (j - middle) * values[j]
            spread += (j - middle) ** 2
        slope /= spread
        rest = 0.0
        for j in range(left, right + 1):
            rest += (values[j] - mean - slope * (j - middle)) ** 2
        shift = -mean / slope if slope > 0.0 else i - 0.5 - middle
        position[k] = middle + min(max(shift, -0.5 * n), 0.5 * n)
        scatter = rest / (n - 2) if n >= LEAST_FOR_NOISE else noise * noise
        variance[k] = scatter / max(slope, 1e-30) ** 2 * (1.0 / n + shift * shift / spread)

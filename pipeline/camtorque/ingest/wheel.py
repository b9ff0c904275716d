"""What the pulses of a trigger show, for `camtorque new`: teeth, mark, speed, and whether the shaft is the cam's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from camtorque.ingest.raw import ArraySource, FileChannel
from camtorque.records import Array, Channel, Refusal
from camtorque.signal.inductive import find_pulses
from camtorque.signal.marks import pitches_of, repeats_every, two_marks
from camtorque.units import TURN

LOOKED_AT = 400_000
"""Samples looked at of each channel."""
LEAST_PULSES = 4
LONG_PERIOD, SHORT_PERIOD, ONE_PERIOD = 1.5, 0.85, 1.3
"""A period longer than its neighbours by this factor is a gap of the wheel; two short ones that add up to one hold
an extra tooth."""
BESIDE = 2
"""Periods on either side that one is compared with."""
POINTS = 48
"""Points of a revolution at which torque or pressure is compared with the next one's."""

BY_INDEX = "the index"


@dataclass(frozen=True)
class Wheel:
    """What the pulses show.

    ``speed`` of the cam [1/s]; teeth a revolution with the missing ones, missing ones, an extra one; revolutions of
    the wheel per turn of the cam, and what showed them ("" for nothing).
    """

    speed: float
    pulses_per_rev: int = 1
    missing_teeth: int = 0
    double_tooth: bool = False
    revolutions_per_cycle: int = 1
    known_from: str = ""


def pulse_times(channel: FileChannel, sensor: str = "digital") -> Array:
    """Return when the pulses of a channel come [s after its first sample], none where there are too few."""
    if channel.sample_rate is None:
        return np.empty(0)
    values = channel.source.read(0, min(channel.n_samples, LOOKED_AT)).astype(np.float64)
    source = ArraySource(values)
    trigger = Channel("trigger", "", source, 0.0, channel.sample_rate, None, Path(channel.name), channel.name)
    try:
        return np.asarray(find_pulses(trigger, sensor, "falling" if sensor == "inductive" else "rising").time)
    except Refusal:
        return np.empty(0)


def wheel_of(
    channel: FileChannel, sensor: str = "digital", index: FileChannel | None = None, load: FileChannel | None = None
) -> Wheel | None:
    """Return what the pulses show, None where there are too few.

    A gap, an extra tooth or two teeth at unequal distances tell the wheel, else an index does, else it is one pulse a
    turn.

    Parameters
    ----------
    index : one pulse per turn of the cam, of the same log
    load : torque or pressure of the same log, which repeats with the cam
    """
    times = pulse_times(channel, sensor)
    if times.size < LEAST_PULSES:
        return None
    wheel, turns = _teeth(times)
    marks = pulse_times(index) if index is not None else np.empty(0)
    if marks.size >= LEAST_PULSES:
        return _by_index(wheel, times, marks)
    every = repeats_every(_revolutions(load, turns)) if load is not None and load.sample_rate else 1
    if every == 1:
        return wheel
    why = "torque or pressure repeat after so many"
    return replace(wheel, speed=wheel.speed / every, revolutions_per_cycle=every, known_from=why)


def _teeth(times: Array) -> tuple[Wheel, Array]:
    """Return the wheel that its pulses show, one revolution of it, and when its revolutions begin [s]."""
    periods = np.diff(times)
    if share := two_marks(times):
        turns = times[1 + int(np.argmax(periods[:2])) :: 2]
        pitches = pitches_of(share)
        return (Wheel(_rate(turns), pitches, pitches - 2) if pitches else Wheel(_rate(turns))), turns
    padded = np.pad(periods, BESIDE, mode="edge")
    beside = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * BESIDE + 1), axis=1)
    ratio = periods / beside
    gaps = np.flatnonzero(ratio > LONG_PERIOD)
    if _regular(gaps):
        missing = round(float(np.median(ratio[gaps]))) - 1
        turns = times[gaps + 1]
        return Wheel(_rate(turns), int(np.diff(gaps)[0]) + missing, missing), turns
    short = ratio < SHORT_PERIOD
    extra = 1 + np.flatnonzero(short[:-1] & short[1:] & (ratio[:-1] + ratio[1:] < ONE_PERIOD))
    if _regular(extra):
        turns = times[extra + 1]
        return Wheel(_rate(turns), int(np.diff(extra)[0]) - 1, 0, True), turns
    return Wheel(1.0 / float(np.median(periods))), times


def _regular(marks: np.ndarray) -> bool:
    apart = np.diff(marks)
    return apart.size >= 2 and int(apart.min()) == int(apart.max()) >= LEAST_PULSES


def _rate(times: Array) -> float:
    return float((times.size - 1) / (times[-1] - times[0]))


def _by_index(wheel: Wheel, times: Array, marks: Array) -> Wheel:
    """Return the wheel with what an index tells: its teeth where it has no mark, else its turns per turn of the cam."""
    counts = np.diff(np.searchsorted(times, marks))
    count, speed = int(np.median(counts)), _rate(marks)
    if wheel.missing_teeth or wheel.double_tooth:
        shown = wheel.pulses_per_rev - wheel.missing_teeth + int(wheel.double_tooth)
        turns = max(1, round(count / shown))
        return replace(wheel, speed=speed, revolutions_per_cycle=turns, known_from=BY_INDEX)
    return Wheel(speed, max(count, 1), known_from=BY_INDEX)


def _revolutions(load: FileChannel, turns: Array) -> Array:
    """Return torque or pressure between successive beginnings of revolutions, (n, POINTS)."""
    assert load.sample_rate is not None  # asked by the caller
    values = load.source.read(0, min(load.n_samples, LOOKED_AT))
    share = np.arange(POINTS) / POINTS
    at = turns[:-1, None] + np.diff(turns)[:, None] * share
    stamps = np.arange(values.size) / load.sample_rate
    return np.where(at <= stamps[-1], np.interp(at, stamps, values), np.nan)


def angle_wheel(channel: FileChannel, factor: float) -> Wheel | None:
    """Return speed and turns of a recorded angle; ``factor`` makes radians of it. None where it does not turn."""
    if channel.sample_rate is None:
        return None
    angle = channel.source.read(0, min(channel.n_samples, LOOKED_AT)) * factor
    angle = angle[np.isfinite(angle)]
    step, reach = np.diff(angle), float(np.ptp(angle))
    wraps = np.abs(step) > 0.5 * reach
    turned = float(np.abs(np.sum(step[~wraps]))) / TURN
    if turned < 2.0:
        return None
    every = max(1, round(reach / TURN)) if wraps.any() else 1
    seconds = np.sum(~wraps) / channel.sample_rate
    known_from = "the angle that starts again after so many turns" if every > 1 else ""
    return Wheel(float(turned / seconds / every), 0, revolutions_per_cycle=every, known_from=known_from)

"""Channels that tell the angle -> pulses: tooth wheel, encoder with index, angle counter; one per logger.

`SOURCES` is the registry: quantity -> function that returns the pulses of such a channel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from camtorque.align.counter import counter_train
from camtorque.align.pulses import PulseTrain, TriggerTrain
from camtorque.align.teeth import broken_before, mark_misfit, number_counts, number_teeth
from camtorque.config import TriggerSpec
from camtorque.records import Array, Channel, Finding, Integers, Recording, Refusal
from camtorque.signal.edges import Edges, find_edges
from camtorque.signal.inductive import TURNED, find_crossings, find_pulses
from camtorque.signal.threshold import Threshold
from camtorque.units import RPM, TURN

CLEARLY = Threshold(
    0.5, "1", "simulated rigs",
    "The crossings of the other polarity have to fit the gap this much better: the gap bends the waves beside it."
)  # fmt: skip
SINGLE = Threshold(
    0.1, "1", "convention",
    "Pulses in a turn of the nominal speed are one within this share: nominal speeds are kept to a few percent."
)  # fmt: skip
MOST_PULSES = 120
"""Pulses per turn of the cam that are kept of a fine encoder: one in three degrees sees every speed of a shaft."""


def trigger_trains(recording: Recording) -> dict[str, TriggerTrain]:
    """Return the pulses of each logger that recorded the angle, the switching delay taken off.

    Raises
    ------
    Refusal : no channel tells the angle; no pulses; no mark
    """
    trains: dict[str, TriggerTrain] = {}
    for quantity, source in SOURCES.items():
        for channel in recording.of(quantity):
            if channel.logger not in trains:
                found = source(recording, channel)
                time = found.train.time - recording.config.trigger.switching_delay
                trains[channel.logger] = replace(found, train=replace(found.train, time=time))
    if not trains:
        raise Refusal(
            f"{recording.config.id}: no channel tells the angle, expected one of {', '.join(SOURCES)}; add a "
            '[[channels]] entry, such as quantity = "trigger"'
        )
    return {
        logger: replace(found, findings=(*found.findings, *_passed_over(recording, found.channel)))
        for logger, found in trains.items()
    }


def _passed_over(recording: Recording, used: Channel) -> tuple[Finding, ...]:
    """Return a warning where other channels of a logger tell the angle, too: one alone is used."""
    others = [
        f"{channel.name!r} ({quantity})"
        for quantity in SOURCES
        for channel in recording.of(quantity)
        if channel is not used and channel.logger == used.logger
    ]
    if not others:
        return ()
    beside = ', or quantity = "index" under one pulse per turn beside an encoder' if used.quantity == "trigger" else ""
    text = (
        f"the cam angle is taken from {used.name!r} ({used.quantity}), to which nominal_angle_deg refers; "
        f"{', '.join(others)} on the same logger could give it too and {'are' if len(others) > 1 else 'is'} not used: "
        f"write used = false under any that does not count{beside}"
    )
    return (Finding("angle_told_twice", "warning", text, used.where),)


def _wheel(recording: Recording, channel: Channel) -> TriggerTrain:
    """Return the pulses of a trigger or tooth wheel."""
    spec = recording.config.trigger
    index = _index(recording, channel)
    if spec.sensor == "inductive" and spec.missing_teeth:
        edges, train = _coil_with_gap(channel, spec, index)
    else:
        edges = find_pulses(channel, spec.sensor, spec.edge)
        _refuse_single_pulse(edges.time, recording, channel.where)
        train = number_teeth(edges.time, spec, channel.where, index)
    return TriggerTrain(channel, edges, train, spec.pulses_per_cycle)


def _refuse_single_pulse(time: Array, recording: Recording, where: str) -> None:
    """Refuse a wheel of several teeth without a mark where one pulse comes in a turn of the nominal speed."""
    spec = recording.config.trigger
    nominal = recording.config.nominal_speed * spec.revolutions_per_cycle
    if spec.pulses_per_rev == 1 or spec.missing_teeth or spec.double_tooth or time.size < 3:
        return
    if abs(TURN / (float(np.median(np.diff(time))) * nominal) - 1.0) < SINGLE:
        raise Refusal(
            f"{where}: found one pulse in a turn of the nominal {nominal / RPM:g} rpm, expected {spec.pulses_per_rev} "
            "as pulses_per_rev in [trigger] says; write pulses_per_rev = 1, or correct nominal_speed_rpm"
        )


def _coil_with_gap(channel: Channel, spec: TriggerSpec, index: Array | None) -> tuple[Edges, PulseTrain]:
    """Return the crossings at the teeth of a coil; those between the teeth show the gap in the wrong place."""
    trials: dict[str, tuple[float, Edges, PulseTrain]] = {}
    refusals = []
    for edge in (spec.edge, TURNED[spec.edge]):
        edges = find_crossings(channel, edge)
        try:
            train = number_teeth(edges.time, spec, channel.where, index)
        except Refusal as found:
            refusals.append(found)
        else:
            trials[edge] = (mark_misfit(train, spec) / (1.0 if edge == spec.edge else CLEARLY), edges, train)
    if not trials:
        raise refusals[0]
    best = min(trials, key=lambda edge: trials[edge][0])
    _, edges, train = trials[best]
    if best == spec.edge:
        return edges, train
    text = (
        f"the {best} crossings of the inductive pick-up show the gap of the wheel as it is, the {spec.edge} ones do "
        "not: its wires are exchanged, these are taken"
    )
    return replace(
        edges, findings=(*edges.findings, Finding("trigger_inverted", "warning", text, channel.where))
    ), train


def _encoder(recording: Recording, channel: Channel) -> TriggerTrain:
    """Return the pulses of track A of an encoder; track B tells which of them went back."""
    spec = recording.config.trigger
    edges, index = find_edges(channel, spec.edge), _index(recording, channel)
    findings: tuple[Finding, ...] = ()
    track_b = [other for other in recording.of("encoder_b") if other.logger == channel.logger]
    if track_b:
        time, findings = _forward_only(edges, find_edges(track_b[0], "rising"), channel.where)
        train = number_counts(time, spec, channel.where, index)
    else:
        train = number_teeth(edges.time, spec, channel.where, index)
    every = max(1, -(-spec.pulses_per_cycle // MOST_PULSES))
    while spec.pulses_per_cycle % every:
        every += 1
    return TriggerTrain(channel, edges, thinned(train, every), spec.pulses_per_cycle // every, findings)


def _forward_only(a: Edges, b: Edges, where: str) -> tuple[Array, tuple[Finding, ...]]:
    """Return the pulses of track A at which the shaft came further than before.

    One edge of the disc is passed forward as a rising and back as a falling edge, so both are counted.
    """
    rising, falling = _level_of(b, a.time), -_level_of(b, a.opposite)
    onward = 1 if rising.sum() + falling.sum() >= 0 else -1
    passed, back = a.time[rising == onward], a.opposite[falling == -onward]
    if not back.size:
        return a.time, ()
    times, ways = np.r_[passed, back], np.r_[np.ones(passed.size), -np.ones(back.size)]
    order = np.argsort(times, kind="stable")
    place = np.cumsum(ways[order])
    ahead = place > np.r_[0, np.maximum.accumulate(place)[:-1]]
    text = f"the shaft went back by {back.size} of {passed.size} pulses of the encoder; where it came further is used"
    return times[order][ahead], (Finding("encoder_reversed", "info", text, where),)


def _level_of(b: Edges, time: Array) -> Integers:
    """Return 1 where track B is high at the given times, else -1."""
    rise = np.r_[-np.inf, b.time][np.searchsorted(b.time, time)]
    fall = np.r_[-np.inf, b.opposite][np.searchsorted(b.opposite, time)]
    return np.where(rise > fall, 1, -1)


def thinned(train: PulseTrain, every: int) -> PulseTrain:
    """Return every n-th pulse, the one of step zero among them; clocks jump between what is kept where they did."""
    if every == 1:
        return train
    kept = train.step % every == 0
    return replace(
        train, time=train.time[kept], step=train.step[kept] // every, repaired=train.repaired[kept],
        broken=broken_before(train.broken, kept), offset=train.offset / every, offset_std=train.offset_std / every,
        jumped=None if train.jumped is None else broken_before(train.jumped, kept),
    )  # fmt: skip


def _index(recording: Recording, channel: Channel) -> Array | None:
    """Return the edge times of the index channel that shares a channel's clock.

    The declared edge holds for it too; beside a coil, whose edge is the way of its crossing, the leading one counts.
    """
    spec = recording.config.trigger
    edge = "rising" if spec.sensor == "inductive" else spec.edge
    for index in recording.of("index"):
        if recording.config.share_clock(index.logger, channel.logger):
            return find_edges(index, edge).time
    return None


SOURCES: dict[str, Callable[[Recording, Channel], TriggerTrain]] = {
    "trigger": _wheel,
    "encoder_a": _encoder,
    "angle": lambda recording, channel: counter_train(channel, recording.config.trigger.revolutions_per_cycle),
}
"""Quantity of a channel that tells the angle -> its pulses; the first that a logger has is used."""
ANGLE_CHANNELS = (*SOURCES, "encoder_b", "index")
"""Quantities that tell the angle and nothing else."""

"""Trigger channels and clocks of a recording -> one pulse train on the clock of the torque's logger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from camtorque.align.angle import cam_angle
from camtorque.align.clocks import Clock, against, fit_clock, same_clock
from camtorque.align.jumps import mark_jumps
from camtorque.align.options import AlignOptions
from camtorque.align.physics_clock import Pair, physics_clock
from camtorque.align.pulses import PulseTrain, number_teeth, shifted, train_findings
from camtorque.records import Array, Channel, Finding, Recording, Refusal
from camtorque.signal.edges import Edges, find_edges


@dataclass(frozen=True)
class TriggerTrain:
    """Pulses of one trigger channel on its own logger's clock, the switching delay taken off."""

    channel: Channel
    edges: Edges
    train: PulseTrain

    @property
    def where(self) -> str:
        """File and channel."""
        return f"{self.channel.path.name}, channel {self.channel.name!r}"


@dataclass(frozen=True)
class TimeBase:
    """One time for all loggers.

    Attributes
    ----------
    reference : the logger whose clock is the time
    clocks : logger -> its clock
    train : pulses on the reference clock
    triggers : logger -> pulses on its own clock
    edge_noise : standard error of one pulse time [s]
    """

    reference: str
    clocks: Mapping[str, Clock]
    train: PulseTrain
    triggers: Mapping[str, TriggerTrain]
    edge_noise: float
    findings: tuple[Finding, ...]


def time_base(recording: Recording, reference: str, options: AlignOptions) -> TimeBase:
    """Find the pulses of every trigger channel and put all loggers on the clock of ``reference``.

    Raises
    ------
    Refusal
        A trigger without pulses, or a logger with its own clock and nothing to tie it to the others.
    """
    triggers = _trigger_trains(recording, options)
    main = _main_trigger(recording, triggers, reference)
    clocks = _clocks(recording, triggers, main, options)
    train, noise = _fused(recording, triggers, main, clocks)
    findings = [
        finding for t in triggers.values() for finding in (*t.edges.findings, *train_findings(t.train, t.where))
    ]
    findings += [finding for clock in clocks.values() for finding in clock.findings]
    train = replace(train, time=clocks[reference].from_reference(train.time))
    clocks = _referred(clocks, reference)
    train, jump_findings = mark_jumps(train, clocks, recording, noise)
    return TimeBase(reference, clocks, train, triggers, noise, (*findings, *jump_findings))


def _referred(clocks: Mapping[str, Clock], reference: str) -> dict[str, Clock]:
    """Return the clocks against that of the reference."""
    origin = clocks[reference]
    if origin.fit.method in ("reference", "common time base"):
        return {**clocks, reference: same_clock(reference, "reference")}
    referred = {logger: against(clock, origin) for logger, clock in clocks.items()}
    named = {
        logger: replace(clock, fit=replace(clock.fit, method=origin.fit.method))
        for logger, clock in referred.items()
        if clock.fit.method in ("reference", "common time base")
    }
    return {**referred, **named, reference: same_clock(reference, "reference")}


def _trigger_trains(recording: Recording, options: AlignOptions) -> dict[str, TriggerTrain]:
    config = recording.config
    trains = {}
    for channel in recording.of("trigger"):
        edges = find_edges(channel, config.trigger.edge, options.block_samples)
        where = f"{channel.path.name}, channel {channel.name!r}"
        train = number_teeth(edges.time, edges.width, config.trigger, where)
        trains[channel.logger] = TriggerTrain(channel, edges, shifted(train, config.trigger.switching_delay))
    return trains


def _independent(recording: Recording, logger: str) -> bool:
    return any(spec.id == logger and spec.clock == "independent" for spec in recording.config.loggers)


def _same_base(recording: Recording, one: str, other: str) -> bool:
    return one == other or not (_independent(recording, one) or _independent(recording, other))


def _main_trigger(recording: Recording, triggers: Mapping[str, TriggerTrain], reference: str) -> TriggerTrain:
    """Return a trigger on the reference's time base, else any."""
    on_base = [trigger for logger, trigger in triggers.items() if _same_base(recording, logger, reference)]
    return on_base[0] if on_base else next(iter(triggers.values()))


def _clocks(
    recording: Recording, triggers: Mapping[str, TriggerTrain], main: TriggerTrain, options: AlignOptions
) -> dict[str, Clock]:
    """Return the clock of every logger against that of the main trigger's."""
    base = main.channel.logger
    clocks = {base: same_clock(base, "reference")}
    per_rev = recording.config.trigger.pulses_per_rev
    for channel in recording.channels:
        logger = channel.logger
        if logger in clocks:
            continue
        if _same_base(recording, logger, base):
            clocks[logger] = same_clock(logger, "common time base")
        elif logger in triggers:
            own = revolution_times(triggers[logger].train, per_rev)
            clocks[logger] = fit_clock(logger, revolution_times(main.train, per_rev), own, channel.path.name)
        else:
            clocks[logger] = _clock_by_physics(recording, main, channel, options)
    return clocks


def _clock_by_physics(recording: Recording, main: TriggerTrain, own: Channel, options: AlignOptions) -> Clock:
    """Tie a logger without a trigger to the main trigger's by torque and pressure, where each has one of them."""
    base = main.channel.logger
    pair = {quantity: recording.of(quantity)[0] for quantity in ("torque", "pressure") if recording.of(quantity)}
    known = [channel for channel in pair.values() if channel is not own and _same_base(recording, channel.logger, base)]
    if own not in pair.values() or not known:
        raise Refusal(
            f"{recording.config.id}: logger {own.logger!r} has its own clock, recorded no trigger and shares neither "
            "torque nor "
            f"pressure with logger {base!r}, expected one of them; record the trigger on every logger with its own "
            "clock"
        )
    angle = cam_angle(main.train, recording.config.trigger, options.speed_law)
    return physics_clock(Pair(pair, own.quantity, recording.cam_table, angle))


def revolution_times(train: PulseTrain, pulses_per_rev: int) -> Array:
    """Return the times of the pulses at the nominal angle, one per revolution, nan where none was seen."""
    first = -(-int(train.step[0]) // pulses_per_rev)
    last = int(train.step[-1]) // pulses_per_rev
    times = np.full(last - first + 1, np.nan)
    whole = (train.step % pulses_per_rev == 0) & ~train.repaired
    times[train.step[whole] // pulses_per_rev - first] = train.time[whole]
    return times


def _fused(
    recording: Recording, triggers: Mapping[str, TriggerTrain], main: TriggerTrain, clocks: Mapping[str, Clock]
) -> tuple[PulseTrain, float]:
    """Average the pulses that several loggers recorded, weighted by their edge noise; one fills the other's gaps.

    Only a plain trigger is fused: a wheel already has more pulses than the angle needs.
    """
    train, noise = main.train, main.edges.noise
    if recording.config.trigger.pulses_per_rev > 1:
        return train, noise
    for logger, other in triggers.items():
        if other is main or logger not in clocks:
            continue
        time = clocks[logger].to_reference(other.train.time)
        nearest = np.clip(np.searchsorted(time, train.time), 1, time.size - 1)
        nearest -= np.abs(time[nearest - 1] - train.time) < np.abs(time[nearest] - train.time)
        same = (np.abs(time[nearest] - train.time) < 0.01 * np.median(np.diff(train.time))) & ~other.train.repaired[
            nearest
        ]
        weight = np.where(train.repaired, 1.0, noise**2 / (noise**2 + other.edges.noise**2))
        fused = np.where(same, (1.0 - weight) * train.time + weight * time[nearest], train.time)
        train = replace(train, time=fused, repaired=train.repaired & ~same)
        noise = 1.0 / np.hypot(1.0 / noise, 1.0 / other.edges.noise)
    return train, float(noise)

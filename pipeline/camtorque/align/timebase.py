"""Trigger channels and clocks of a recording -> one pulse train on the clock of the torque's logger; what it lacks.

Where a wheel turns several times per cycle and no index tells which turn is which, torque and pressure may: the torque
of a pump follows line pressure times lift velocity, and the pressure rises with the lift. So each possible turn is
tried on the mean cycle; the one that fits is taken, and a finding says where none fits clearly better. The trigger may
fall silent while the pump goes on, or wake up after it has begun: turns that no pulse shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from camtorque.align.angle import cam_angle
from camtorque.align.channels import Measured, Turns, align_channels, positions
from camtorque.align.clocks import Clock, against, fit_clock, mark_jumps, same_clock
from camtorque.align.options import AlignOptions
from camtorque.align.physics_clock import Pair, physics_clock
from camtorque.align.places import LEAST_PULSES, Places, passages, teeth_shown, tooth_places
from camtorque.align.polarity import INVERTED_CORRELATION, correlation, lift_velocity
from camtorque.align.pulses import PulseTrain, TriggerTrain, train_findings
from camtorque.align.sources import thinned, trigger_trains
from camtorque.records import Array, CamTable, Channel, Finding, Recording, Refusal
from camtorque.signal.logger_time import end_time
from camtorque.signal.threshold import Count, Threshold
from camtorque.units import TURN

PHYSICAL = ("torque", "pressure")
"""Quantities that tie a logger without a trigger to the others."""
NOISELESS = 1.0e-9
"""Standard error that an edge has at least when it is weighed against another one [s]: made signals have none."""
STILL_TURNING = Threshold(
    0.5, "1", "physics",
    "A channel that swings by this share of what it does between the pulses shows that the pump turns."
)  # fmt: skip
SILENT_TURNS = Count(
    2, "turns", "convention", "Turns in a row without a pulse: a shaft that runs out may make one more stroke."
)
LATE = Threshold(0.05, "turns", "convention", "By this much a pulse may be late: a shaft slows down a little first.")
COARSE = 720
CLEARER = Threshold(0.2, "1", "simulated rigs", "Correlation by which the best turn has to beat the next.")


@dataclass(frozen=True)
class TimeBase:
    """One time for all loggers.

    Attributes
    ----------
    clocks : logger -> its clock
    train : pulses on the reference clock
    triggers : logger -> pulses on its own clock
    pulses_per_cycle : steps of ``train`` per turn of the cam
    edge_noise : standard error of one pulse time [s]
    places : what the turns of the cam have in common, None where too few pulses show it
    passed : when the other one or two of so few teeth pass, `camtorque.records.PASSED`
    """

    clocks: Mapping[str, Clock]
    train: PulseTrain
    triggers: Mapping[str, TriggerTrain]
    pulses_per_cycle: int
    edge_noise: float
    places: Places | None
    findings: tuple[Finding, ...]
    passed: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def index_std(self) -> float:
        """Standard deviation of the cam angle of the index pulse (or of a counter's zero) among the teeth [rad]."""
        spread = self.train.offset_std * TURN / self.pulses_per_cycle
        if not self.train.by_index or self.places is None:
            return spread
        return float(np.hypot(spread, self.places.at(self.train.offset)[1]))


def time_base(recording: Recording, reference: str) -> TimeBase:
    """Find the pulses of every trigger channel and put all loggers on the clock of ``reference``.

    Raises
    ------
    Refusal : a trigger without pulses, or a logger with its own clock and nothing to tie it to the others
    """
    triggers = trigger_trains(recording)
    on_base = [trigger for logger, trigger in triggers.items() if recording.config.share_clock(logger, reference)]
    main = next(iter((*on_base, *triggers.values())))
    clocks = _clocks(recording, triggers, main)
    train, noise = _fused(triggers, main, clocks)
    findings = [
        finding
        for t in triggers.values()
        for finding in (*t.edges.findings, *t.findings, *train_findings(t.train, t.channel.where))
    ]
    findings += [finding for clock in clocks.values() for finding in clock.findings]
    train = replace(train, time=clocks[reference].from_reference(train.time))
    clocks = _referred(clocks, reference)
    n = main.pulses_per_cycle
    train, jump_findings = mark_jumps(train, clocks, recording, noise, n)
    places = tooth_places(train, recording.config.trigger, n)
    if places is not None:
        # the pulses of a wheel show themselves how well they repeat
        noise = min(noise, places.scatter * float(np.median(np.diff(train.time) / np.diff(train.step))) * n / TURN)
    return TimeBase(clocks, train, triggers, n, noise, places, (*findings, *jump_findings))


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


def _clocks(recording: Recording, triggers: Mapping[str, TriggerTrain], main: TriggerTrain) -> dict[str, Clock]:
    """Return the clock of every logger against that of the main trigger's; one that nothing ties is left out."""
    base = main.channel.logger
    clocks = {base: same_clock(base, "reference")}
    for channel in recording.channels:
        logger = channel.logger
        if logger in clocks:
            continue
        if recording.config.share_clock(logger, base):
            clocks[logger] = same_clock(logger, "common time base")
        elif logger in triggers:
            own = triggers[logger]
            times = [revolution_times(t.train, t.pulses_per_cycle) for t in (main, own)]
            noise = float(np.hypot(main.edges.noise, own.edges.noise))
            clocks[logger] = fit_clock(logger, times[0], times[1], channel.path.name, noise)
        elif channel.quantity in PHYSICAL:
            clocks[logger] = _clock_by_physics(recording, main, channel)
    return clocks


def _clock_by_physics(recording: Recording, main: TriggerTrain, own: Channel) -> Clock:
    """Tie a logger without a trigger to the main trigger's by torque and pressure, where each has one of them."""
    base = main.channel.logger
    pair = {quantity: recording.of(quantity)[0] for quantity in PHYSICAL if recording.of(quantity)}
    known = [
        channel
        for channel in pair.values()
        if channel is not own and recording.config.share_clock(channel.logger, base)
    ]
    if own not in pair.values() or not known:
        raise Refusal(
            f"{recording.config.id}: logger {own.logger!r} has its own clock, recorded no trigger and shares neither "
            f"torque nor pressure with logger {base!r}, expected one of them; record the trigger on every logger with "
            "its own clock"
        )
    angle = cam_angle(main.train, recording.config.trigger, main.pulses_per_cycle)
    return physics_clock(Pair(pair, own.quantity, recording.cam_table, angle))


def revolution_times(train: PulseTrain, n: int) -> Array:
    """Return the times of the pulses at the nominal angle, one per turn of the cam, nan where none was seen."""
    first = -(-int(train.step[0]) // n)
    last = int(train.step[-1]) // n
    times = np.full(last - first + 1, np.nan)
    whole = (train.step % n == 0) & ~train.repaired
    times[train.step[whole] // n - first] = train.time[whole]
    return times


def _fused(
    triggers: Mapping[str, TriggerTrain], main: TriggerTrain, clocks: Mapping[str, Clock]
) -> tuple[PulseTrain, float]:
    """Average the pulses that several loggers recorded, weighted by their edge noise; one fills the other's gaps.

    Only a plain trigger is fused: a wheel already has more pulses than the angle needs.
    """
    train, noise = main.train, main.edges.noise
    if main.pulses_per_cycle > 1:
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
        noise, noise_there = max(noise, NOISELESS), max(other.edges.noise, NOISELESS)
        weight = np.where(train.repaired, 1.0, noise**2 / (noise**2 + noise_there**2))
        fused = np.where(same, (1.0 - weight) * train.time + weight * time[nearest], train.time)
        train = replace(train, time=fused, repaired=train.repaired & ~same)
        noise = 1.0 / np.hypot(1.0 / noise, 1.0 / noise_there)
    return train, float(noise)


def silence_findings(base: TimeBase, channels: Mapping[str, Channel]) -> tuple[Finding, ...]:
    """Return what is lost before the first or after the last pulse although the pump turned there.

    Parameters
    ----------
    channels : those that follow the cam; the pressure tells, else the torque
    """
    channel, train, n = channels.get("pressure") or channels.get("torque"), base.train, base.pulses_per_cycle
    if channel is None or train.time.size <= 2 * n:
        return ()
    clock = base.clocks[channel.logger]
    spans = [_span(trigger.channel, base.clocks[logger]) for logger, trigger in base.triggers.items()]
    spans += [_span(one, base.clocks[one.logger]) for one in channels.values()]
    own = _span(channel, clock)
    logged = max(span[0] for span in spans), min(span[1] for span in spans)  # no turn is used that a log lacks
    where = next(iter(base.triggers.values())).channel.where
    found = []
    for name, times, end in (("begin", train.time, logged[0]), ("end", train.time[::-1], logged[1])):
        edge, turn, before = times[0], float(times[0] - times[n]), float(times[n] - times[2 * n])
        turn *= max(turn / before, 1.0)  # of a shaft that coasts down or runs up the next one is longer still
        lost = (end - edge) / turn
        if lost > SILENT_TURNS + 1.0 + LATE and _turns(channel, clock, float(edge), turn):
            text = (
                f"the pulses {name} at {edge - own[0]:.2f} s of {own[1] - own[0]:.2f} s, but the {channel.quantity} "
                f"swings {'before' if name == 'begin' else 'on'}: about {lost:.0f} turns are not used; did the sensor "
                "of the pulses or its cable fail there?"
            )
            found.append(Finding("trigger_silent", "warning", text, where))
    return tuple(found)


def _span(channel: Channel, clock: Clock) -> tuple[float, float]:
    """Return begin and end of a channel on the clock of the reference [s]."""
    begin, end = clock.to_reference(np.array([channel.start_time, end_time(channel)]))
    return float(begin), float(end)


def _turns(channel: Channel, clock: Clock, edge: float, turn: float) -> bool:
    """Return whether a channel swings beyond a pulse, ``turn`` [s] away from the others, as it does before it."""

    def swing(start: float) -> float:
        ends = np.sort(positions(channel, clock, np.array([edge + start * turn, edge + (start + 1.0) * turn])))
        first, last = np.clip(ends, 0, channel.n_samples).astype(np.int64)
        values = channel.read(int(first), int(last))
        values = values[np.isfinite(values)]
        return float(np.ptp(values)) if values.size else 0.0

    usual = swing(-1.0)
    return usual > 0.0 and all(swing(1.0 + LATE + k) > STILL_TURNING * usual for k in range(SILENT_TURNS))


def settled_phase(recording: Recording, base: TimeBase, channels: Measured) -> TimeBase:
    """Return the time base with the pulses numbered from the right turn of the wheel, and a finding."""
    spec = recording.config.trigger
    turns = spec.revolutions_per_cycle
    if not base.train.phase_open:
        return base
    scores = np.zeros(turns)
    if recording.lift_table is not None and "pressure" in channels.main:
        scores = _scores(_means(recording, base, channels), recording.cam_table, turns)
    order = np.argsort(scores)[::-1]
    best = int(order[0])
    clear = scores[best] > scores[order[1]] + CLEARER
    found = ", ".join(f"{score:.2f}" for score in scores)
    text = (
        f"the wheel turns {turns} times per turn of the cam and no index channel tells which is which: "
        + (f"torque and pressure do (correlations {found})" if clear else f"turn {best + 1} is assumed ({found})")
        + ("" if clear else '; add a channel with quantity = "index", one pulse per turn of the cam')
    )
    finding = Finding("cycle_phase_by_lift" if clear else "cycle_phase_open", "info" if clear else "warning", text)
    step = base.train.step - best * (base.pulses_per_cycle // turns)
    return replace(base, train=replace(base.train, step=step), findings=(*base.findings, finding))


def by_few_teeth(base: TimeBase, where: str) -> TimeBase:
    """Return the time base with one pulse a turn where a wheel has too few for the speed within it, and a finding.

    Two teeth bend the cam angle by what little they see of the swing of the shaft, which a fit rebuilds in full from
    the torque: it would be corrected twice.
    """
    n = base.pulses_per_cycle
    if n == 1 or base.places is not None or (shown := teeth_shown(base.train, n)) >= LEAST_PULSES:
        return base
    text = (
        f"{shown} pulses per turn of the cam do not show how the speed varies within it, {int(LEAST_PULSES)} or more "
        "do: the cam angle is that of the one at nominal_angle_deg, at even speed in between; the times of the "
        "others show a fit how far the shaft swings"
    )
    finding = Finding("few_teeth", "info", text, where)
    return replace(
        base, train=thinned(base.train, n), pulses_per_cycle=1, places=None, findings=(*base.findings, finding),
        passed=passages(base.train, n),
    )  # fmt: skip


def _means(recording: Recording, base: TimeBase, channels: Measured) -> dict[str, Array]:
    """Return the median cycle of torque and pressure on a coarse grid."""
    angle = cam_angle(base.train, recording.config.trigger, base.pulses_per_cycle, base.places)
    turns = Turns(angle, base.clocks, AlignOptions(n_theta=COARSE))
    complete = turns.covered(channels.main.values())
    if not complete.any():
        return {}
    aligned = align_channels(channels.main, turns, complete)
    whole = np.all([np.isfinite(item.rows).all(axis=1) for item in aligned.values()], axis=0)
    if not whole.any():
        return {}
    return {quantity: np.median(item.rows[whole], axis=0) for quantity, item in aligned.items()}


def _scores(means: dict[str, Array], table: CamTable, turns: int) -> Array:
    """Return how well the mean cycle follows the lift, for each turn that it may begin with, (turns,).

    A torque that is against the lift where the pressure rises with it is inverted: it is turned later on.
    """
    if "pressure" not in means:
        return np.zeros(turns)
    velocity, line = lift_velocity(table, COARSE), np.maximum(means["pressure"], 0.0)
    # the table read from another turn: what is at theta then was at theta + turn
    read = [np.roll(velocity, turn * COARSE // turns) for turn in range(turns)]
    rises = np.array([correlation(line, np.maximum(slope, 0.0)) for slope in read])
    if "torque" not in means:
        return rises
    drives = np.array([correlation(means["torque"], line * slope) for slope in read])
    likely = np.argsort(rises)[::-1]
    told = rises[likely[0]] > rises[likely[1]] + CLEARER
    return -drives if told and drives[likely[0]] < INVERTED_CORRELATION else drives

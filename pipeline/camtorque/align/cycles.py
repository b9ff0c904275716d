"""Recording -> cycles on one cam-angle grid, with nominal alignment.

Nominal means: declared delays taken off, trigger edge at its nominal angle, clocks from the pulses. Whatever is fitted
(trigger angle, twist, delay error) enters once, on the model side. A cycle runs from the zero of the lift table to one
revolution later; its number is that of the pulse inside it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from camtorque.align.angle import CamAngle, cam_angle
from camtorque.align.budget import angle_error_budget, ripple_text, wandered
from camtorque.align.channels import CUT_BY, AlignedChannel, Turns, align_channels, align_others, measured
from camtorque.align.clocks import EDGE_NOISES
from camtorque.align.drift import beyond_steps, changed_load, drift_findings, level_drifts, size_findings
from camtorque.align.flanks import check_flanks
from camtorque.align.hum import hum_findings, idle_points
from camtorque.align.lags import settle_lags
from camtorque.align.options import AlignOptions
from camtorque.align.polarity import check_quantities
from camtorque.align.quality import (
    CycleTable,
    apply_cuts,
    changed_running,
    flat_top_findings,
    no_mean_findings,
    refuse_jitter,
    several_speeds,
)
from camtorque.align.summary import alignment_details
from camtorque.align.timebase import TimeBase, by_few_teeth, settled_phase, silence_findings, time_base
from camtorque.records import (
    DEVIATION,
    DEVIATION_ERRORS,
    LEAD,
    PASSED,
    TEETH,
    Array,
    CamCycles,
    CutFlowRow,
    Estimate,
    Finding,
    Integers,
    Mask,
    Recording,
    Refusal,
)
from camtorque.signal.logger_time import end_time
from camtorque.signal.threshold import Count, Threshold
from camtorque.stacks import mean_of
from camtorque.units import RPM, TURN, angle_grid, zone_hint

SLOWEST = Threshold(4.0, "rpm", "convention", "A cam that turns slower is refused: edges are found from 5 rpm on.")
FASTEST = Threshold(25_000.0, "rpm", "convention", "A cam that turns faster is refused: edges are found to 20 000 rpm.")
MOST_OFF = Threshold(
    300.0, "1", "convention",
    "Factor between told and nominal speed from which it is refused: below kHz for Hz, above minutes for seconds.",
)  # fmt: skip
MISSING_SAMPLES = ("csv_rows_damaged", "csv_cells_damaged", "csv_overrange")
"""Findings of reading that tell why samples are missing."""
LEAD_CYCLES = Count(
    64, "cycles", "convention", "Cycles, spread over the recording, whose angle between pulses says how the cam leads."
)
LEAST_USED = Threshold(
    0.5, "1", "convention", "Share of the complete cycles below which the use of so few is reported."
)


def align(recording: Recording, options: AlignOptions | None = None) -> CamCycles:
    """Return the cycles of a recording on one cam-angle grid.

    Raises
    ------
    Refusal : nothing to align, no pulses, no whole turn, no complete cycle, swapped torque and pressure
    """
    options = options or AlignOptions()
    channels = measured(recording)
    base = settled_phase(recording, time_base(recording, channels.reference), channels)
    base = by_few_teeth(base, recording.config.id)
    angle = cam_angle(base.train, recording.config.trigger, base.pulses_per_cycle, base.places)
    turns = Turns(angle, base.clocks, options)
    if not turns.cycles.size:
        raise _no_turn(recording, base)
    complete = turns.covered((channels.main or channels.other).values())
    aligned = align_channels(channels.main, turns, complete)
    table = _table(turns, complete, aligned, base)
    _refuse_speed(recording, float(np.median(table.speed)) / RPM)
    rows = {quantity: item.rows for quantity, item in aligned.items()}
    typical, checked = check_quantities(rows, table.undamaged, recording, base.train.time)
    findings = (*checked, *check_flanks(typical, recording, float(np.median(table.speed))))
    begins = turns.times[0]
    lags = settle_lags(table, begins, base.edge_noise)
    table = replace(table, slipped=lags.slipped)
    used, cut_flow = apply_cuts(table)
    running = (*lags.findings, *changed_running(table, begins), *several_speeds(table))
    refuse_jitter(table, recording.config.id)
    if not used.any():
        raise _none_used(recording, int(complete.sum()), cut_flow)
    others, untied = align_others(channels.other, turns)
    silent = silence_findings(base, channels.main)
    base = replace(base, findings=(*base.findings, *silent, *findings, *running, *untied))
    found = _cam_cycles(recording, table, used, cut_flow, {**aligned, **others}, base, angle, lags.wander)
    taken_off = _taken_off(found, "pressure" in channels.main)
    return _at_rest(recording, replace(found, findings=(*found.findings, *_rare(found), *taken_off)))


def _taken_off(found: CamCycles, has_pressure: bool) -> tuple[Finding, ...]:
    """Tell tops and a mean that were taken off the cycles before the logger."""
    torque = found.torque
    of_torque = () if torque is None else (
        *no_mean_findings(found.mean_torque), *flat_top_findings(torque, found.mean_torque, "torque"),
    )  # fmt: skip
    return (*of_torque, *(flat_top_findings(found.pressure, found.mean_pressure, "pressure") if has_pressure else ()))


def _no_turn(recording: Recording, base: TimeBase) -> Refusal:
    turned = (base.train.step[-1] - base.train.step[0]) / base.pulses_per_cycle
    return Refusal(
        f"{recording.config.id}: the pulses cover {turned:.2g} turns of the cam without a whole one from the zero of "
        "the lift table on, expected at least one; record longer, or check pulses_per_rev and revolutions_per_cycle in "
        "[trigger]"
    )


def _refuse_speed(recording: Recording, told: float) -> None:
    """Refuse a cam speed [rpm] that no bench runs at, or some powers of ten off: most likely a sample rate is."""
    nominal = recording.config.nominal_speed / RPM
    off = max(nominal / told, told / nominal)
    if SLOWEST <= told <= FASTEST and off < MOST_OFF:
        return
    times = f", {off:.0f} times {'that' if told < nominal else 'less'}" if off > 2.0 else ""
    raise Refusal(
        f"{recording.config.id}: the channels give a cam speed of {told:.4g} rpm, the nominal speed is {nominal:.4g} "
        f"rpm{times}; expected {SLOWEST:g} to {FASTEST:g} rpm, off by less than a factor of {MOST_OFF:g}; correct the "
        "sample rate (Hz, not kHz), pulses_per_rev or the nominal speed"
    )


def _none_used(recording: Recording, n_complete: int, cut_flow: tuple[CutFlowRow, ...]) -> Refusal:
    if not n_complete and (apart := _share_no_time(recording)):
        return Refusal(f"{recording.config.id}: {apart}")
    failed = sorted((row for row in cut_flow if row.cycles_single), key=lambda row: -row.cycles_single)
    counts = ", ".join(f"{row.reason!r} ({row.cycles_single}: {row.text})" for row in failed)
    lost = "".join(f"; {row.where}: {row.text}" for row in recording.findings if row.code in MISSING_SAMPLES)
    return Refusal(
        f"{recording.config.id}: none of {n_complete} complete cycles can be used, expected at least one; most fail "
        f"{counts}{lost}; put that right at the rig or in the export of the log, and record or export it again"
    )


def _share_no_time(recording: Recording) -> str:
    """Name two logs on one clock of which one ends before the other begins, "" where there are none."""
    channels = [channel for channel in recording.channels if channel.logger not in recording.config.own_clocks]
    if not channels:
        return ""
    late = max(channels, key=lambda channel: channel.start_time)
    early = min(channels, key=end_time)
    if end_time(early) > late.start_time:
        return ""
    covered_by = ", ".join(f"{c.path.name} from {c.start_time:.9g} to {end_time(c):.9g} s" for c in (early, late))
    return (
        f"found logs that share no time ({covered_by}), expected those of one run on one clock; let their times count "
        'from one moment (start_time_s where a file has none), or write clock = "independent" under [[loggers]]'
        f"{zone_hint(late.start_time - early.start_time)}"
    )


def _rare(found: CamCycles) -> tuple[Finding, ...]:
    """Tell a recording of which most cycles are rejected, and what for."""
    worst = max(found.cut_flow, key=lambda row: row.cycles_single)
    used = found.index.size
    if used >= LEAST_USED * found.cycles_found:
        return ()
    # cycles that reach no end of a range are those of the lowest load, at any scatter of it
    code, then = "few_cycles_used", "do the used ones represent the intended running?"
    if worst.reason.endswith("_clipped"):
        code, then = "low_cycles_used", "the used ones are those of the lowest peaks; record within the range"
    text = (
        f"only {used} of {found.cycles_found} complete cycles are used, most others fail {worst.reason!r} "
        f"({worst.cycles_single}: {worst.text}): {then}"
    )
    return (Finding(code, "warning", text, "cut-flow"),)


def _at_rest(recording: Recording, found: CamCycles) -> CamCycles:
    """Add what the base circle tells of hum on the torque, and of levels that drift."""
    table = recording.lift_table
    if table is None:
        return found
    lift = table.at(found.theta)
    rows = {} if found.torque is None else {"torque": (found.torque, found.mean_torque)}
    rows |= {"pressure": (found.pressure, found.mean_pressure)} if found.pressure.size else {}
    drifts = level_drifts(idle_points(found.theta, lift), rows, found.index)
    drifts = beyond_steps(drifts, {quantity: recording.of(quantity)[0] for quantity in drifts})
    told = drift_findings(drifts, {quantity: float(np.max(mean)) for quantity, (_, mean) in rows.items()})
    if len(rows) == 2:
        told = (*told, *size_findings(rows["torque"], rows["pressure"], found.index))
    if found.torque is not None:
        told = (*told, *changed_load(rows["torque"]))
        told = (*hum_findings(found.theta, found.torque, found.mean_torque, found.speed, found.index, lift), *told)
    return replace(found, findings=(*found.findings, *told), level_drifts=drifts)


def _table(turns: Turns, complete: Mask, aligned: dict[str, AlignedChannel], base: TimeBase) -> CycleTable:
    angle, cycles, options, train = turns.angle, turns.cycles, turns.options, base.train
    period = turns.times[2] - turns.times[0]
    jump = angle.touched(cycles, train.jumps)
    unproven = angle.touched(cycles, train.broken)
    if 360.0 / base.pulses_per_cycle * train.repair_error > options.repaired_angle_deg:
        unproven |= angle.touched(cycles, train.repaired, pulses_before=1)
    return CycleTable(
        index=cycles,
        speed=TURN / period,
        speed_change=_speed_change(period, jump | unproven),
        complete=complete,
        unproven=unproven,
        clock_jump=jump,
        slipped=np.zeros(cycles.size, dtype=bool),
        aligned=aligned,
        options=options,
        edge_change=EDGE_NOISES * base.edge_noise / float(np.median(period)),
    )


def _speed_change(period: Array, unknown: Mask) -> Array:
    """Return the largest relative change of the period from a cycle to its neighbours, where both are known."""
    relative = np.abs(np.diff(period)) / np.minimum(period[1:], period[:-1])
    relative[unknown[1:] | unknown[:-1]] = 0.0
    return np.maximum(np.r_[0.0, relative], np.r_[relative, 0.0])


def _cam_cycles(
    recording: Recording,
    table: CycleTable,
    used: Mask,
    cut_flow: tuple[CutFlowRow, ...],
    aligned: Mapping[str, AlignedChannel],
    base: TimeBase,
    angle: CamAngle,
    wander: Mapping[str, float],
) -> CamCycles:
    chosen, n_theta, spec = np.flatnonzero(used), table.options.n_theta, recording.config.trigger
    rows = {quantity: _compacted(item.rows, chosen) for quantity, item in aligned.items()}
    torque, speed = rows.get("torque"), table.speed[chosen]
    mean_torque, mean_speed = None if torque is None else mean_of(torque), float(np.mean(speed))
    delay = aligned["torque"].channel.calibration if torque is not None else None
    theta = angle_grid(n_theta)
    ripple = Finding("ripple_unseen", "info", ripple_text(spec, mean_torque, mean_speed), recording.config.id)
    unseen = (ripple,) if base.pulses_per_cycle == 1 else ()
    speed_change = float(np.sqrt(np.mean(table.speed_change[chosen] ** 2)))
    channels = {quantity: item.channel for quantity, item in aligned.items()}
    return CamCycles(
        theta=theta, torque=torque, pressure=rows.get("pressure", np.empty((0, n_theta))),
        channels={quantity: values for quantity, values in rows.items() if quantity not in CUT_BY},
        speed=speed, index=table.index[chosen], held_out=np.arange(chosen.size) % 2 == 1,
        cycles_found=int(table.complete.sum()), duration=max(channel.duration for channel in recording.channels),
        speed_ripple_percent=float(100.0 * np.std(speed) / np.mean(speed)), cut_flow=cut_flow,
        clocks=tuple(clock.fit for clock in base.clocks.values()),
        angle_errors=(
            *angle_error_budget(spec, channels, base, mean_speed, speed_change, mean_torque), *wandered(wander),
        ),
        trigger_jitter_s=base.edge_noise, findings=(*table.options.notes, *base.findings, *unseen),
        torque_delay=Estimate(delay.delay, delay.delay_std, delay.delay) if delay else Estimate(0.0, 0.0),
        details={**alignment_details(base, aligned), **_swing(base, angle, theta, table.index[chosen])},
        pulses={logger: trigger.edges.time for logger, trigger in base.triggers.items()},
    )  # fmt: skip


def _swing(base: TimeBase, angle: CamAngle, theta: Array, cycles: Integers) -> dict[str, Any]:
    """Return how far the cam is ahead of even running over the grid, or at teeth, where several pulses show it [rad].

    The lead is that of the interpolated angle itself, in the mean of some cycles, since the pulse at the nominal angle;
    the deviation is waves of low order.
    """
    if angle.places is None:
        return {PASSED: base.passed} if base.passed.size else {}
    deviation, std = angle.places.deviation(theta - angle.zero_step_angle)
    some = cycles[np.linspace(0, cycles.size - 1, min(cycles.size, LEAD_CYCLES)).astype(np.int64)]
    borders = np.append(theta, [TURN, angle.pulse_angle % TURN])
    turns = angle.time_at(np.add.outer(some * TURN, borders).ravel()).reshape(some.size, -1)
    begin, end, pulse = turns[:, :1], turns[:, -2:-1], turns[:, -1:]
    even = np.mean((turns[:, :-2] - pulse) / (end - begin), axis=0) * TURN + angle.nominal % TURN
    return {
        DEVIATION: deviation, f"{DEVIATION}_std": std, LEAD: np.remainder(theta - even + np.pi, TURN) - np.pi,
        DEVIATION_ERRORS: angle.places.errors(angle.zero_step_angle), TEETH: angle.places.passed,
    }  # fmt: skip


def _compacted(rows: Array, chosen: Integers) -> Array:
    """Return the used rows without a second copy of a long recording: a stretch of it, or moved to the front."""
    if chosen[-1] - chosen[0] + 1 == chosen.size:
        return rows[chosen[0] : chosen[-1] + 1]
    for place, k in enumerate(chosen):
        if place != k:
            rows[place] = rows[k]
    return rows[: chosen.size]

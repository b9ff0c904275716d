"""`camtorque check`: what a recording holds, what is wrong with it (all of it), and which cycles the alignment uses."""

from __future__ import annotations

import argparse
from dataclasses import asdict

import numpy as np

from camtorque.align import align
from camtorque.commands import FAULTS, REFUSED, Outcome, Tell
from camtorque.commands.texts import finding_lines
from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.config.tables import Refusals
from camtorque.ingest import RecordingSummary, read_recording, summarise
from camtorque.ingest.check import angle_speed_findings
from camtorque.jsonable import jsonable
from camtorque.records import CamCycles, Finding, Recording, Refusal
from camtorque.rehearsal import rehearse
from camtorque.units import RPM, counted

LOUDEST = ("error", "warning", "info")
"""Severities in the order of the list: what has to be mended is not to stand between long notes."""
SCHEMA = "camtorque.check/1"
RUN_REFUSED = "run_refused"
LEAST_CYCLES = 4
"""Two to fit, two to score; a test holds it to the fit's own."""


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Sum up one recording and align it; status 2 where `align` refuses, 1 where a finding is an error."""
    try:
        recording = read_recording(arguments.recording)
    except Refusals as refusals:
        if len(refusals.problems) == 1:
            raise
        text = "\n".join([f"{len(refusals.problems)} things have to be put right:", *refusals.problems])
        return Outcome(text, {"schema": SCHEMA, "refused": list(refusals.problems)}, REFUSED)
    tell("aligning to the cam angle")
    cycles, refusal = _aligned(recording)
    summary = summarise(recording, cycles.pulses if cycles else {})
    lacks = missing_for_run(recording, cycles) if cycles else []
    rows = summary.findings
    if cycles:
        rows = (*rows, *cycles.findings, *angle_speed_findings(recording, cycles.mean_speed))
    if cycles and not lacks:
        tell("trying what a run does before its fit")
        rows = (*rows, *_rehearsed(recording, cycles))
        lacks = [row.text for row in rows if row.code == RUN_REFUSED]
    findings = [asdict(row) for row in rows]
    loudest = sorted(findings, key=lambda row: LOUDEST.index(row["severity"]))
    found = "\n".join(finding_lines(loudest)) or "  nothing wrong was found"
    doc = {
        "schema": SCHEMA,
        **asdict(summary),
        "findings": findings,
        "cut_flow": [asdict(row) for row in cycles.cut_flow] if cycles else [],
        "usable": ["align"] * (cycles is not None) + ["run"] * (cycles is not None and not lacks),
        "refused": [refusal] if refusal else [],
    }
    status = FAULTS if any(row["severity"] == "error" for row in findings) else 0
    end = cut_flow_lines(cycles, lacks) if cycles else [f"refused   {refusal}"]
    text = "\n".join([_head(summary, cycles), found, *end])
    return Outcome(text, jsonable(doc), REFUSED if refusal else status)


def _aligned(recording: Recording) -> tuple[CamCycles | None, str]:
    try:
        return align(recording), ""
    except Refusal as refusal:
        return None, str(refusal)


def _rehearsed(recording: Recording, cycles: CamCycles) -> tuple[Finding, ...]:
    try:
        return rehearse(recording, cycles)
    except Refusal as refusal:
        return (Finding(RUN_REFUSED, "error", str(refusal), recording.config.path.name),)


def missing_for_run(recording: Recording, cycles: CamCycles) -> list[str]:
    """Return what `run` would refuse this recording for although it can be aligned."""
    missing = {
        "torque is missing": cycles.torque is None,
        "pressure is missing": not recording.of("pressure"),
        "[pump] with its lift table is missing": recording.lift_table is None,
        f"{counted(cycles.index.size, 'used cycle', 'used cycles')}, at least {LEAST_CYCLES} are needed": (
            cycles.index.size < LEAST_CYCLES or bool(cycles.held_out.all()) or not cycles.held_out.any()
        ),
    }
    return [what for what, lacks in missing.items() if lacks]


def cut_flow_lines(cycles: CamCycles, lacks: list[str]) -> list[str]:
    """Return the cut-flow as a table and what the recording can be used for; ``lacks`` is what `run` misses."""
    lines = [f"{cycles.index.size} of {cycles.cycles_found} cycles used"]
    for row in (row for row in cycles.cut_flow if row.cycles_single):
        lines.append(f"  {row.reason:24}{row.cycles_single:>6} fail {row.cycles_left:>6} left   {row.text}")
    return [*lines, f"enough for: align; run refuses it: {'; '.join(lacks)}" if lacks else "enough for: align, run"]


def _head(summary: RecordingSummary, cycles: CamCycles | None) -> str:
    speed = summary.speed_rpm if cycles is None else float(np.mean(cycles.speed)) / RPM
    by_pulses = f"{speed:.1f} rpm by its pulses" if np.isfinite(speed) else "no speed by its pulses"
    lines = [f"{summary.id}  ({summary.file_format or 'format by content'}), {by_pulses}"]
    for row in summary.channels:
        quantity = CHANNEL_QUANTITIES[row.quantity]
        low, high = (quantity.shown_factor * value + quantity.shown_offset for value in (row.low, row.high))
        values = f"{low:9.4g} to {high:9.4g} {quantity.shown_unit:4}" if low <= high else f"{'no number':27}"
        lines.append(
            f"  {row.quantity:9}{row.n_samples:>9} samples at {row.sample_rate:>9.6g} Hz, {row.duration:7.2f} s, "
            f"{values} {row.file} [{row.logger}]"
        )
    return "\n".join(lines)

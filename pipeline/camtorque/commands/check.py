"""`camtorque check`: what a recording holds and what is wrong with it."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from camtorque.commands.outcome import Outcome, Tell
from camtorque.commands.texts import finding_lines
from camtorque.ingest import RecordingSummary, summarise_recording
from camtorque.plain import plain
from camtorque.units import BAR

SHOWN = {"torque": ("N m", 1.0), "pressure": ("bar", 1.0 / BAR)}
ERRORS = 1


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Sum up one recording without a model."""
    summary = summarise_recording(arguments.recording)
    findings = [asdict(row) for row in summary.findings]
    found = "\n".join(finding_lines(findings)) or "  nothing wrong was found"
    doc = plain({"schema": "camtorque.check/1", **asdict(summary)})
    status = ERRORS if any(row["severity"] == "error" for row in findings) else 0
    return Outcome(f"{_head(summary)}\n{found}", doc, status)


def _head(summary: RecordingSummary) -> str:
    lines = [f"{summary.id}  ({summary.file_format}), {summary.speed_rpm:.1f} rpm by its pulses"]
    for row in summary.channels:
        unit, factor = SHOWN.get(row.quantity, ("V", 1.0))
        lines.append(
            f"  {row.quantity:9}{row.n_samples:>9} samples at {row.sample_rate:>9.6g} Hz, {row.duration:7.2f} s, "
            f"{factor * row.low:9.4g} to {factor * row.high:9.4g} {unit:4} {row.file} [{row.logger}]"
        )
    return "\n".join(lines)

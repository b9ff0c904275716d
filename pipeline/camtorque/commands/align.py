"""`camtorque align`: logs to cam angle without a model; loads neither the mechanics nor the fit."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from camtorque.align import AlignOptions, align
from camtorque.commands import Outcome, Tell
from camtorque.commands.texts import loud_findings
from camtorque.ingest import read_recording
from camtorque.ingest.check import speed_findings
from camtorque.jsonable import now
from camtorque.report.alignment import write_alignment
from camtorque.report.folder import output_folder


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write the aligned cycles of one recording."""
    options = None if arguments.n_theta is None else AlignOptions(n_theta=arguments.n_theta)
    doc = align_recording(arguments.recording, arguments.out, options, tell)
    head = f"{doc['name']}  {doc['cycles_used']} of {doc['cycles_found']} cycles used, {doc['speed_rpm']:.1f} rpm"
    page = arguments.out / "align.html"
    return Outcome("\n".join([head, *loud_findings(doc["findings"]), str(page)]), {**doc, "report": str(page)})


def align_recording(path: Path, out: Path, options: AlignOptions | None, tell: Tell) -> dict[str, Any]:
    """Write the aligned cycles of a recording and return the content of align.json.

    Raises
    ------
    Refusal : the recording cannot be aligned, or ``out`` holds something else
    """
    with output_folder(out, "align.json") as folder:
        tell(f"reading {path}")
        recording = read_recording(path)
        tell("aligning to the cam angle")
        cycles = align(recording, options)
        told = speed_findings(cycles.mean_speed, recording.config, "recording.toml")
        return write_alignment(recording, replace(cycles, findings=(*cycles.findings, *told)), now(), folder)

"""`camtorque align`: logs to cam angle without a model; loads neither the mechanics nor the fit."""

from __future__ import annotations

import argparse
from dataclasses import replace

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
    with output_folder(arguments.out, "align.json") as folder:
        tell(f"reading {arguments.recording}")
        recording = read_recording(arguments.recording)
        tell("aligning to the cam angle")
        cycles = align(recording, options)
        told = speed_findings(cycles.mean_speed, recording.config, "recording.toml")
        doc = write_alignment(recording, replace(cycles, findings=(*cycles.findings, *told)), now(), folder)
    head = f"{doc['name']}  {doc['cycles_used']} of {doc['cycles_found']} cycles used, {doc['speed_rpm']:.1f} rpm"
    page = arguments.out / "align.html"
    return Outcome("\n".join([head, *loud_findings(doc["findings"]), str(page)]), {**doc, "report": str(page)})

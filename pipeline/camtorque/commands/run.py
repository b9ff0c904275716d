"""`camtorque run`: one recording to its report."""

from __future__ import annotations

import argparse
from pathlib import Path

from camtorque.commands.options import run_options
from camtorque.commands.outcome import Outcome, Tell
from camtorque.commands.texts import run_table
from camtorque.run import run_recording


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write the report of one recording."""
    out = arguments.out or default_out(arguments.recording)
    doc = run_recording(arguments.recording, out, run_options(arguments, tell), tell)
    page = out / "report.html"
    return Outcome(f"{run_table(doc)}\n\n{page}", {**doc, "report": str(page)})


def default_out(recording: Path) -> Path:
    """Return ``reports/NAME``; NAME is the folder that holds recording.toml."""
    folder = recording.resolve()
    return Path("reports") / (folder.parent if recording.suffix == ".toml" else folder).name

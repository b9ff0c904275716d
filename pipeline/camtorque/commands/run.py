"""`camtorque run`: one recording to its report."""

from __future__ import annotations

import argparse
from pathlib import Path

from camtorque.commands import OUTSIDE, Outcome, Tell
from camtorque.commands.options import run_options
from camtorque.commands.texts import limit_lines, run_table
from camtorque.hashes import real_path
from camtorque.limits import PASS
from camtorque.process.second_process import second_process
from camtorque.report.folder import seal
from camtorque.report.write import write_pdf
from camtorque.run import run_recording


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write the report of one recording."""
    out = arguments.out or default_out(arguments.recording)
    with second_process():
        doc = run_recording(arguments.recording, out, run_options(arguments, tell), tell)
    page = out / "report.html"
    if arguments.pdf:
        tell("printing the page")
        write_pdf(page)
        seal(out, out.name)
    judged = doc.get("limits")
    judged_lines = "" if judged is None else "\n" + "\n".join(limit_lines(judged["rows"]))
    status = 0 if judged is None or judged["verdict"] == PASS else OUTSIDE
    return Outcome(f"{run_table(doc)}{judged_lines}\n\n{page}", {**doc, "report": str(page)}, status)


def default_out(recording: Path) -> Path:
    """Return ``reports/NAME``; NAME is the folder that holds recording.toml."""
    folder = real_path(recording)
    return Path("reports") / (folder.parent if recording.suffix == ".toml" else folder).name

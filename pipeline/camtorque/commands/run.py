"""`camtorque run`: one recording to its report; and the options of a run, which a campaign has, too."""

from __future__ import annotations

import argparse
from pathlib import Path

from camtorque.align import AlignOptions
from camtorque.commands import OUTSIDE, Outcome, Tell
from camtorque.commands.arguments import LEAST_GRID
from camtorque.commands.texts import limit_lines, run_table
from camtorque.config.schemas import RECORDING_FILE
from camtorque.grid_choice import grid_note
from camtorque.hashes import real_path
from camtorque.limits import PASS, read_limits
from camtorque.process.second_process import second_process
from camtorque.records import Refusal, require
from camtorque.report.folder import document_of, seal
from camtorque.report.write import write_pdf
from camtorque.results import NAME
from camtorque.run import RunOptions, run_recording


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write the report of one recording."""
    out = arguments.out
    if out is None:
        out = default_out(arguments.recording)
        refuse_report_of_another(out, arguments.recording)
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


def refuse_report_of_another(out: Path, recording: Path) -> None:
    """Refuse to replace the report of a recording whose folder has the same name elsewhere.

    Raises
    ------
    Refusal : the report there names another recording.toml that is still there
    """
    sheet = recording if recording.suffix == ".toml" else recording / RECORDING_FILE
    for row in document_of(out / NAME).get("inputs", ()):
        earlier = Path(row["path"])
        if earlier.name == RECORDING_FILE and earlier.is_file() and real_path(earlier) != real_path(sheet):
            raise Refusal(
                f"{out}: found the report of {earlier.parent}, expected none or one of {sheet.parent}; keep both with "
                f"--out, such as --out {out.with_name(f'{real_path(sheet).parent.parent.name}_{out.name}')}"
            )


def run_options(arguments: argparse.Namespace, tell: Tell) -> RunOptions:
    """Return the options of `run` and `campaign`.

    Raises
    ------
    Refusal : a grid and a tolerance together; an optional package that a choice needs is missing; a limit of a
        parameter that there is not
    """
    if getattr(arguments, "pdf", False):
        require(("weasyprint",), "--pdf", "pdf")
    given = getattr(arguments, "limits", None)
    limits = () if given is None else read_limits(given)
    return RunOptions(_align(arguments, tell), limits=limits)


def _align(arguments: argparse.Namespace, tell: Tell) -> AlignOptions:
    if arguments.tolerance is None:
        return AlignOptions() if arguments.n_theta is None else AlignOptions(n_theta=arguments.n_theta)
    if arguments.n_theta is not None:
        raise Refusal("--tolerance, --n-theta: found both, expected one of them; the tolerance chooses the grid")
    n_theta, note = grid_note(arguments.tolerance, LEAST_GRID)
    tell(note.text)
    return AlignOptions(n_theta=n_theta, notes=(note,))

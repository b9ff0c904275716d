"""The commands: one module each, imported when it is asked for, and the table of all of them.

arguments     every option with its bounds; imports nothing heavy, so that `--help` is instant
texts         tables for a terminal
run, ...      ``execute(arguments, tell) -> Outcome``, one module per command
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from camtorque.progress import Progress

COMMANDS: dict[str, str] = {
    "new": "look into logs and write a first recording.toml",
    "check": "what a recording holds and what is wrong with it",
    "align": "logs to cam angle without a model (torque not needed)",
    "run": "one recording: align, model, fit, report",
    "campaign": "every recording below a folder, then one joint fit",
    "fit": "one recording fitted with your own bounds and ties, by lmfit",
    "compare": "two recordings of one pump, before and after: what changed",
    "plan": "the cheapest next recordings for one number",
    "watch": "check each block of a test while it runs",
    "limits": "reports held against bands: pass or fail",
    "export": "tables of a report for other programs; trends",
    "verify": "check that the files of an output are unchanged",
    "predict": "torque and forces of a pump from its sheet, or of a run not made, from a fit",
    "design": "a better cam for a pump: Pareto front, lift table",
    "study": "speed charted against accuracy; stability where methods fail",
    "completion": "tab completion for a shell",
}
"""Every command in the order of the help, with its help; what does it is the module of its name."""

FAULTS, REFUSED, OUTSIDE = 1, 2, 3
"""Exit status where findings are errors, files changed or single recordings are refused; where all is refused; where a
value lies outside its limits."""
Tell = Progress


@dataclass(frozen=True)
class Outcome:
    """What a command found.

    Attributes
    ----------
    text : for a person at a terminal
    document : the same for a program (`--json`); empty where the command has none
    status : exit status
    stream : text and document of things that are printed as they happen, before ``text``
    notes : lines for standard error, beside a text that scripts read
    """

    text: str
    document: Mapping[str, Any]
    status: int = 0
    stream: Iterable[tuple[str, Mapping[str, Any]]] = ()
    notes: Sequence[str] = ()

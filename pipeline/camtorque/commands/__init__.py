"""The commands: one module each, imported when it is asked for, and the table of all of them.

arguments     every option with its bounds; imports nothing heavy, so that `--help` is instant
texts         tables for a terminal
run, ...      ``execute(arguments, tell) -> Outcome``, one module per command
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from camtorque.progress import Progress


@dataclass(frozen=True)
class Command:
    """One command: its help; ``json``: True where it has a document. Its options: `camtorque.commands.arguments`."""

    help: str
    json: bool = True


COMMANDS: dict[str, Command] = {
    "new": Command("look into logs and write a first recording.toml"),
    "check": Command("what a recording holds and what is wrong with it"),
    "align": Command("logs to cam angle without a model (torque not needed)"),
    "run": Command("one recording: align, model, fit, report"),
    "campaign": Command("every recording below a folder, then one joint fit"),
    "fit": Command("one recording fitted with your own bounds and ties, by lmfit"),
    "compare": Command("two recordings of one pump, before and after: what changed"),
    "plan": Command("the cheapest next recordings for one number"),
    "watch": Command("a look at each block of a test while it runs"),
    "limits": Command("reports held against bands: pass or fail"),
    "export": Command("tables of a report for other programs; trends"),
    "verify": Command("whether the files of an output are as they were written"),
    "predict": Command("torque and forces of a pump from its sheet, or of a run not made, from a fit"),
    "design": Command("a better cam for a pump: Pareto front, lift table"),
    "study": Command("speed charted against accuracy; stability where methods fail", False),
    "completion": Command("lines that teach a shell to complete commands", False),
}
"""Every command in the order of the help; what does it is the module of its name."""

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
    """

    text: str
    document: Mapping[str, Any]
    status: int = 0
    stream: Iterable[tuple[str, Mapping[str, Any]]] = ()

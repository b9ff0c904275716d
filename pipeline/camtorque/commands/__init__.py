"""The commands: one module each, imported when it is asked for, and the table of all of them.

arguments     every option with its bounds; imports nothing heavy, so that `--help` is instant
texts         tables for a terminal
run, ...      ``execute(arguments, tell) -> Outcome``, one module per command
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from camtorque.commands import arguments as takes
from camtorque.progress import Progress


@dataclass(frozen=True)
class Command:
    """One command: its help, its arguments; ``json``: True where it has a document."""

    help: str
    arguments: Callable[[argparse.ArgumentParser], None]
    json: bool = True


COMMANDS: dict[str, Command] = {
    "new": Command("look into logs and write a first recording.toml", takes.new),
    "check": Command("what a recording holds and what is wrong with it", takes.check),
    "align": Command("logs to cam angle without a model (torque not needed)", takes.align),
    "run": Command("one recording: align, model, fit, report", takes.run),
    "campaign": Command("every recording below a folder, then one joint fit", takes.campaign),
    "fit": Command("one recording fitted with your own bounds and ties, by lmfit", takes.fit),
    "compare": Command("two recordings of one pump, before and after: what changed", takes.compare),
    "plan": Command("the cheapest next recordings for one number", takes.plan),
    "watch": Command("a look at each block of a test while it runs", takes.watch),
    "limits": Command("reports held against bands: pass or fail", takes.limits),
    "export": Command("tables of a report for other programs; trends", takes.export),
    "verify": Command("whether the files of an output are as they were written", takes.verify),
    "predict": Command("torque and forces of a pump from its sheet", takes.predict),
    "design": Command("a better cam for a pump: Pareto front, lift table", takes.design),
    "study": Command("speed charted against accuracy; stability where methods fail", takes.study, False),
    "completion": Command("lines that teach a shell to complete commands", takes.completion, False),
}
"""Every command in the order of the help; what does it is the module of its name."""


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

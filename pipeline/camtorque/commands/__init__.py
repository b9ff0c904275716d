"""What each command does: one module per command, imported when it is asked for, and the table of them all.

arguments     every option with its bounds; imports nothing heavy, so that `--help` is instant
outcome       `Outcome`: what a command hands to the command line, which prints it as text or as JSON
texts         tables for a terminal
run, ...      ``execute(arguments, tell) -> Outcome``, one module per command
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

from camtorque.commands import arguments as takes


@dataclass(frozen=True)
class Command:
    """One command: the module that does it, its help, its arguments; ``json``: True where it has a document."""

    module: str
    help: str
    arguments: Callable[[argparse.ArgumentParser], None]
    json: bool = True


COMMANDS: dict[str, Command] = {
    "new": Command("camtorque.commands.new", "look into logs and write a first recording.toml", takes.new),
    "check": Command("camtorque.commands.check", "what a recording holds and what is wrong with it", takes.check),
    "align": Command("camtorque.commands.align", "logs to cam angle without a model (torque not needed)", takes.align),
    "run": Command("camtorque.commands.run", "one recording: align, model, fit, report", takes.run),
    "campaign": Command(
        "camtorque.commands.campaign", "every recording below a folder, then one joint fit", takes.campaign
    ),
    "fit": Command("camtorque.commands.fit", "one recording fitted with your own bounds and ties, by lmfit", takes.fit),
    "compare": Command(
        "camtorque.commands.compare", "two recordings of one pump, before and after: what changed", takes.compare
    ),
    "plan": Command("camtorque.commands.plan", "the cheapest next recordings for one number", takes.plan),
    "watch": Command("camtorque.commands.watch", "a look at each block of a test while it runs", takes.watch),
    "limits": Command("camtorque.commands.limits", "reports held against bands: pass or fail", takes.limits),
    "export": Command("camtorque.commands.export", "tables of a report for other programs; trends", takes.export),
    "verify": Command(
        "camtorque.commands.verify", "whether the files of an output are as they were written", takes.verify
    ),
    "predict": Command("camtorque.commands.predict", "torque and forces of a pump from its sheet", takes.predict),
    "design": Command("camtorque.commands.design", "a better cam for a pump: Pareto front, lift table", takes.design),
    "study": Command(
        "camtorque.commands.study", "speed charted against accuracy; stability where methods fail", takes.study, False
    ),
    "completion": Command(
        "camtorque.commands.completion", "lines that teach a shell to complete commands", takes.completion, False
    ),
}
"""Every command in the order of the help."""

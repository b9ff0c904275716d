"""Arguments of the fit -> options of a run; whatever would fail after minutes is refused first."""

from __future__ import annotations

import argparse

from camtorque.align import AlignOptions
from camtorque.commands import Tell
from camtorque.commands.arguments import LEAST_GRID
from camtorque.grid_choice import grid_note
from camtorque.laws import STATED_NAMES
from camtorque.limits import read_limits, refuse_unknown_parameters
from camtorque.records import Refusal, require
from camtorque.run import RunOptions


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
    refuse_unknown_parameters(limits, STATED_NAMES)
    return RunOptions(_align(arguments, tell), limits=limits)


def _align(arguments: argparse.Namespace, tell: Tell) -> AlignOptions:
    if arguments.tolerance is None:
        return AlignOptions() if arguments.n_theta is None else AlignOptions(n_theta=arguments.n_theta)
    if arguments.n_theta is not None:
        raise Refusal("--tolerance, --n-theta: found both, expected one of them; the tolerance chooses the grid")
    n_theta, note = grid_note(arguments.tolerance, LEAST_GRID)
    tell(note.text)
    return AlignOptions(n_theta=n_theta, notes=(note,))

"""`camtorque study`: the charts and maps of the studies made again."""

from __future__ import annotations

import argparse

from camtorque.commands.options import require
from camtorque.commands.outcome import Outcome, Tell
from camtorque.report import check_writable
from camtorque.studies import run_speed_accuracy, run_stability

STUDIES = {"speed-accuracy": run_speed_accuracy, "stability": run_stability}
EXTRAS = {"speed-accuracy": (("emcee", "corner"), "posterior")}
"""Study -> optional packages that it needs, and the extra that brings them."""


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Make one study again."""
    if arguments.name in EXTRAS:
        packages, extra = EXTRAS[arguments.name]
        require(packages, f"study {arguments.name}", extra)
    check_writable(arguments.out)
    paths = STUDIES[arguments.name](arguments.out, arguments.quick)
    return Outcome("\n".join(str(path) for path in paths), {})

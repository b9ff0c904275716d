"""`camtorque study`: the charts and maps of the studies made again."""

from __future__ import annotations

import argparse

from camtorque.commands import Outcome, Tell
from camtorque.report.folder import check_writable
from camtorque.studies.study import run_study


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Make one study again."""
    check_writable(arguments.out)
    paths = run_study(arguments.name, arguments.out, arguments.quick, progress=tell)
    return Outcome("\n".join(str(path) for path in paths), {})

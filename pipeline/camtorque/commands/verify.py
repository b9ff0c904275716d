"""`camtorque verify`: whether the files of an output are as they were written."""

from __future__ import annotations

import argparse

from camtorque.commands import FAULTS, Outcome, Tell
from camtorque.report.files import verify


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Compare every file with its checksum."""
    tell(f"reading {arguments.folder}")
    compared, faults = verify(arguments.folder)
    lines = [f"{kind:11} {path}" for path, kind in faults.items()]
    lines.append(f"{arguments.folder}: {compared} files compared, {len(faults)} not as they were written")
    rows = [{"path": path, "kind": kind} for path, kind in faults.items()]
    document = {"schema": "camtorque.verify/1", "folder": str(arguments.folder), "compared": compared, "faults": rows}
    return Outcome("\n".join(lines), document, FAULTS if faults else 0)

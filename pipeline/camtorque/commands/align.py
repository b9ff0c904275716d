"""`camtorque align`: logs to cam angle without a model."""

from __future__ import annotations

import argparse

from camtorque.align import AlignOptions
from camtorque.commands.outcome import Outcome, Tell
from camtorque.commands.texts import loud_findings
from camtorque.run import align_recording


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write the aligned cycles of one recording."""
    options = None if arguments.n_theta is None else AlignOptions(n_theta=arguments.n_theta)
    doc = align_recording(arguments.recording, arguments.out, options, tell)
    head = f"{doc['name']}  {doc['cycles_used']} of {doc['cycles_found']} cycles used, {doc['speed_rpm']:.1f} rpm"
    page = arguments.out / "align.html"
    return Outcome("\n".join([head, *loud_findings(doc["findings"]), str(page)]), {**doc, "report": str(page)})

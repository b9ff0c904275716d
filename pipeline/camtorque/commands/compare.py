"""`camtorque compare`: two recordings of one pump, before and after."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from camtorque.commands import Outcome, Tell
from camtorque.commands.texts import loud_findings
from camtorque.compare import compare
from camtorque.process.second_process import second_process
from camtorque.report.compare_page import compare_cautions, compare_events, compare_rows, left_out, sensor_caution


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Write the comparison of two recordings."""
    with second_process():
        doc = compare(arguments.before, arguments.after, arguments.out, progress=tell)
    page = arguments.out / "compare.html"
    return Outcome(f"{compare_table(doc)}\n\n{page}", {**doc, "report": str(page)})


def compare_table(doc: Mapping[str, Any]) -> str:
    """Return the content of compare.json as a compact table: what changed first, what is only unknown left out."""
    before, after = doc["before"], doc["after"]
    speeds = [", ".join(f"{speed:.1f}" for speed in side["speeds_rpm"]) for side in (before, after)]
    lines = [
        f"{before['name']} ({speeds[0]} rpm) against {after['name']} ({speeds[1]} rpm): {doc['verdict']}",
        *filter(None, [sensor_caution(doc)]),
        *(f"  {probability:>6}  {event}" for event, probability in compare_events(doc)),
        *(f"warning   {text}" for text in compare_cautions(doc)),
        "",
        "before and after share a scale that may be off; only the difference is told:",
        f"{'':22}{'before':>9}{'after':>9}{'difference':>13}{'':6}{'would be seen':>13}",
    ]
    rows = compare_rows({**doc["parameters"], **doc["losses"]})
    for verdict in ("changed", "not changed"):
        found = [row for row in rows if row["verdict"] == verdict]
        lines += [f"{verdict}:"] * bool(found)
        lines += [
            f"{row['name']:21} {row['before']:>8} {row['after']:>8} {row['difference']:>8} "
            f"{row['sign'] + ' ' + row['error']:<8} {row['smallest']:>8}   {row['unit']}".rstrip()
            for row in found
        ]
    unknown = [row["name"] for row in rows if row["verdict"] == "cannot tell"]
    lines += [f"cannot tell: {', '.join(unknown)}"] * bool(unknown)
    odd = [{**row, "text": f"{row['recording']}: {row['text']}"} for row in doc.get("findings", ())]
    return "\n".join([*lines, *left_out(doc), *loud_findings(odd)])

"""`camtorque limits`: any number of reports held against bands."""

from __future__ import annotations

import argparse

from camtorque.commands import OUTSIDE, Outcome, Tell
from camtorque.commands.texts import limit_lines
from camtorque.laws import STATED_NAMES
from camtorque.limits import CANNOT_TELL, PASS, judge, limits_document, overall, read_limits, refuse_unknown
from camtorque.results import read_results, refused_below


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Judge every report by every limit; exit status 3 unless all pass."""
    limits, documents = read_limits(arguments.file), read_results(arguments.results)
    refuse_unknown(tuple(documents.values()), limits, STATED_NAMES)
    judged = {name: judge(document, limits) for name, document in documents.items()}
    refused = refused_below(arguments.results)
    verdict = overall([row for rows in judged.values() for row in rows])
    verdict = CANNOT_TELL if verdict == PASS and refused else verdict
    results = [
        {"name": documents[folder]["recording"]["name"], "report": folder, "refused": None, **limits_document(rows)}
        for folder, rows in judged.items()
    ]
    # a gate that passes because what it was to judge is not there is none
    results += [
        {"name": name, "report": None, "refused": error, "verdict": CANNOT_TELL, "rows": []} for name, error in refused
    ]
    # folders of a campaign are named by hashes: their order says nothing
    results.sort(key=lambda result: str(result["name"]))
    lines = []
    for result in results:
        lines += [
            f"{result['name']}  {result['verdict']}  [{result['report'] or 'refused: ' + result['refused']}]",
            *("  " + line for line in limit_lines(result["rows"])),
        ]
    doc = {"schema": "camtorque.limits/1", "limits": str(arguments.file), "verdict": verdict, "results": results}
    return Outcome("\n".join([*lines, "", verdict]), doc, 0 if verdict == PASS else OUTSIDE)

"""`camtorque plan`: the cheapest next recordings for one number."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from camtorque.commands import Outcome, Tell
from camtorque.commands.texts import fit_name
from camtorque.fit.planning import MOST_RUNS
from camtorque.jsonable import jsonable
from camtorque.plan import plan_runs
from camtorque.report.folder import check_output, output_folder
from camtorque.report.numbers import plus_minus, rounded_to_error, unit_text
from camtorque.report.plan_page import run_text, target_text, write_plan


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Tell which recordings to make next; write a page where a folder is given."""
    if arguments.out is not None:
        check_output(arguments.out, "plan.json")
    tell("weighing runs that could be made")
    doc = jsonable(
        plan_runs(
            arguments.fit, arguments.target, tooth=not arguments.no_tooth, speeds_rpm=sorted(set(arguments.speed))
        )
    )
    lines = [plan_table(doc)]
    if arguments.out is not None:
        with output_folder(arguments.out, "plan.json") as folder:
            write_plan(doc, f"What to record next for {fit_name(arguments.fit, doc['recordings'])}", folder)
        lines.append(str(arguments.out / "plan.html"))
    return Outcome("\n".join(lines), doc)


def plan_table(doc: Mapping[str, Any]) -> str:
    """Return the plan as a compact table."""
    unit = unit_text(doc["unit"])
    lines = [
        f"{target_text(doc)}  {rounded_to_error(doc['value'], doc['stderr_now'])} ± {plus_minus(doc['stderr_now'])} "
        f"{unit}, wanted ± {plus_minus(doc['stderr_wanted'])} {unit}"
    ]
    for number, run in enumerate(doc["runs"], 1):
        after = f"then ± {plus_minus(run['stderr_after'])} {unit}"
        lines.append(f"{number}. {run_text(run)}: {after} ({run['minutes']:.0f} min)")
    if doc["reached"]:
        end = (
            "nothing to record: it is known well enough" if not doc["runs"] else f"reached in {doc['minutes']:.0f} min"
        )
    elif len(doc["runs"]) == MOST_RUNS:
        end = f"NOT reached by {MOST_RUNS} runs ({doc['minutes']:.0f} min): a better sheet or sensor would do more"
    else:
        end = "NOT reached: no further run on offer narrows it; a better sheet or sensor is needed"
    return "\n".join([*lines, end])

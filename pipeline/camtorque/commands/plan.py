"""`camtorque plan`: the cheapest next recordings for one number."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from camtorque.commands.outcome import Outcome, Tell
from camtorque.fit.planning import MOST_RUNS
from camtorque.plan import plan_runs
from camtorque.report.numbers import near, plus_minus, unit_text


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Tell which recordings to make next."""
    tell("weighing runs that could be made")
    doc = plan_runs(arguments.fit, arguments.target, tooth=not arguments.no_tooth)
    return Outcome(plan_table(doc), doc)


def plan_table(doc: Mapping[str, Any]) -> str:
    """Return the plan as a compact table."""
    unit = unit_text(doc["unit"])
    lines = [
        f"{doc['target'].replace('_', ' ')}  {near(doc['value'], doc['stderr_now'])} ± {plus_minus(doc['stderr_now'])} "
        f"{unit}, wanted ± {plus_minus(doc['stderr_wanted'])} {unit}"
    ]
    for number, run in enumerate(doc["runs"], 1):
        tooth = ", a second tooth on the wheel" if run["second_tooth"] else ""
        lines.append(
            f"{number}. {run['speed_rpm']:.0f} rpm, load of {run['load_of']}, {run['duration_s']:.0f} s{tooth}: "
            f"then ± {plus_minus(run['stderr_after'])} {unit} ({run['minutes']:.0f} min)"
        )
    if doc["reached"]:
        end = (
            "nothing to record: it is known well enough" if not doc["runs"] else f"reached in {doc['minutes']:.0f} min"
        )
    elif len(doc["runs"]) == MOST_RUNS:
        end = f"NOT reached by {MOST_RUNS} runs ({doc['minutes']:.0f} min): a better sheet or sensor would do more"
    else:
        end = "NOT reached: no further run on offer narrows it; a better sheet or sensor is needed"
    return "\n".join([*lines, end])

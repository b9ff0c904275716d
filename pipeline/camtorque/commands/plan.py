"""`camtorque plan`: the cheapest next recordings for one number."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from camtorque.commands.outcome import Outcome, Tell
from camtorque.plan import plan_runs


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Tell which recordings to make next."""
    tell("weighing runs that could be made")
    doc = plan_runs(arguments.fit, arguments.target)
    return Outcome(plan_table(doc), doc)


def plan_table(doc: Mapping[str, Any]) -> str:
    """Return the plan as a compact table."""
    unit = doc["unit"]
    lines = [
        f"{doc['target'].replace('_', ' ')}  {doc['value']:.4g} ± {doc['stderr_now']:.2g} {unit}, wanted "
        f"± {doc['stderr_wanted']:.2g} {unit}"
    ]
    for number, run in enumerate(doc["runs"], 1):
        tooth = ", a second tooth on the wheel" if run["second_tooth"] else ""
        lines.append(
            f"{number}. {run['speed_rpm']:.0f} rpm, load of {run['load_of']}, {run['duration_s']:.0f} s{tooth}: "
            f"then ± {run['stderr_after']:.2g} {unit} ({run['minutes']:.0f} min)"
        )
    if doc["reached"]:
        end = (
            "nothing to record: it is known well enough" if not doc["runs"] else f"reached in {doc['minutes']:.0f} min"
        )
    else:
        end = "NOT reached: no further run on offer narrows it; a better sheet or sensor is needed"
    return "\n".join([*lines, end])

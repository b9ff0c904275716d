"""`camtorque fit`: one recording fitted by lmfit with a user's own bounds, ties and fixed values."""

from __future__ import annotations

import argparse
import re
from typing import Any

import lmfit

from camtorque.commands import Outcome, Tell
from camtorque.jsonable import jsonable
from camtorque.lmfit_fit import changed, own_fit, read_changes
from camtorque.lmfit_minimizer import Intervals
from camtorque.process.second_process import second_process
from camtorque.records import Refusal
from camtorque.units import did_you_mean

PERCENT = re.compile(r" \(([\d.]+|inf|nan)%\)")


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Fit and tell what lmfit tells."""
    changes = {} if arguments.parameters is None else read_changes(arguments.parameters)
    tell(f"looking for the best minimum of {arguments.recording}")
    with second_process():
        own = own_fit(arguments.recording)
    parameters = changed(own.parameters(), changes)
    _refuse_unknown(arguments.intervals, parameters)
    tell("fitting by lmfit")
    minimizer = own.minimizer(parameters)
    found = Intervals(minimizer.minimize(), {}, ())
    if arguments.intervals:
        tell("seeking the intervals")
        found = minimizer.intervals(found.result, arguments.intervals)
    lines = [plain_percent(lmfit.fit_report(found.result, show_correl=False))]
    if found.rows:
        lines += ["", lmfit.ci_report(found.rows), *(f"note: {note}" for note in found.notes)]
    return Outcome("\n".join(lines), jsonable(_document(found)))


def plain_percent(report: str) -> str:
    """Return a report of lmfit without errors of more than a value in percent of it: beside nothing all are large."""
    return PERCENT.sub(lambda found: found[0] if float(found[1]) <= 100.0 else "", report)


def _refuse_unknown(names: list[str], parameters: lmfit.Parameters) -> None:
    for name in names:
        if name not in parameters or not parameters[name].vary:
            free = [other for other in parameters if parameters[other].vary]
            raise Refusal(
                f"--intervals: {name!r} is not a varying parameter of this fit{did_you_mean(name, free)}; there are "
                f"{', '.join(free)}"
            )


def _document(found: Intervals) -> dict[str, Any]:
    result = found.result
    rows = {
        name: {"value": item.value, "stderr": item.stderr, "unit": item.user_data, "min": item.min, "max": item.max,
               "vary": item.vary, "expr": item.expr}
        for name, item in result.params.items()
    }  # fmt: skip
    summary = {"chi_square": result.chisqr, "evaluations": result.nfev, "message": result.message}
    told = {"intervals": found.rows, "notes": found.notes}
    return {"schema": "camtorque.own_fit/1", **summary, "parameters": rows, **told}

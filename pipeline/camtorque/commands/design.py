"""`camtorque design`: a better cam for a pump, from a design file."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from camtorque.commands import Outcome, Tell
from camtorque.commands.texts import finding_lines
from camtorque.design import Answer, answer_document, design_page, read_task, solve_task, write_chosen
from camtorque.design.answer import TABLE, fitted_cells, label_of, law_name
from camtorque.design.responses import RESPONSES
from camtorque.design_from import as_fitted, fitted_pump, read_known
from camtorque.finished_fit import FinishedFit
from camtorque.hashes import input_file
from camtorque.jsonable import jsonable
from camtorque.process.second_process import second_process
from camtorque.report.files import inputs_document, write_json, write_page
from camtorque.report.fit_file import NAME
from camtorque.report.folder import check_output, output_folder


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Find the front of a design task and write the chosen cam."""
    check_output(arguments.out, "design.json")
    known = None if arguments.fit is None else read_known(arguments.fit)
    task = read_task(arguments.task, None if known is None else fitted_pump(known))
    with second_process():
        answer = solve_task(task, tell)
    with output_folder(arguments.out, "design.json") as folder:
        document = jsonable(_written(answer, known, folder))
    fitted = fitted_lines(document["as_fitted"])
    odd = finding_lines([asdict(row) for row in task.findings])
    return Outcome("\n".join([*odd, *_table(answer), *fitted, str(arguments.out / "design.html")]), document)


def _written(answer: Answer, known: FinishedFit | None, folder: Path) -> dict[str, Any]:
    """Write everything into an open folder and return the document."""
    read_back = write_chosen(answer.chosen.evaluated, folder)
    fitted = [] if known is None else as_fitted(known, answer, folder / TABLE)
    document = answer_document(answer, read_back, fitted)
    fit = () if known is None else (input_file(known.folder / NAME),)
    document["inputs"] = inputs_document((*answer.task.inputs, *fit))
    write_page(folder / "design.html", design_page(answer, read_back, fitted))
    write_json(folder / "design.json", document)
    return document


def fitted_lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what the fitted model makes of the chosen cam, beside the fitted pump's own."""
    lines = []
    for row in rows:
        lines.append(f"{row['load']}: by the fitted model (± 95 %){'fitted pump':>20}{'design':>22}")
        for name, before, after in fitted_cells(row):
            lines.append(f"  {name:42}{before:>20}{after:>22}")
    return lines


def _table(answer: Answer) -> list[str]:
    """Return the chosen design against the first guess, and the most expensive limits."""
    problem, chosen = answer.chosen.problem, answer.chosen
    lines = [f"design {answer.front.chosen + 1} of {len(answer.front.points)}, {law_name(chosen.design.family.name)}"]
    lines.append(f"{'':44}{'first guess':>14}{'design':>14}")
    for name in problem.names:
        values = (RESPONSES[name].value(problem.first_guess), chosen.responses[name])
        lines.append(f"{label_of(name):44}" + "".join(f"{value:14.4g}" for value in values))
    for variable in problem.task.variables:
        lines.append(f"{label_of(variable.name):44}{variable.start:14.4g}{chosen.design.values[variable.name]:14.4g}")
    for price in answer.prices[:5]:
        costs = "; ".join(f"{label_of(name)} {value:+.3g}" for name, value in price.per_aim.items())
        lines.append(f"per {price.unit or 'unit'} by which {price.what} is loosened: {costs}")
    return lines

"""Everything of one run into a folder, and its page as PDF (WeasyPrint, extra `pdf`)."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Any

from camtorque.records import Refusal
from camtorque.report.bundle import RunResult
from camtorque.report.cycles_file import result_variables, write_cycles
from camtorque.report.document import result_document
from camtorque.report.drawings import drawing_of, write_figures
from camtorque.report.figures import FIGURES
from camtorque.report.files import atomic_file, write_json, write_page
from camtorque.report.fit_file import NAME as FIT_NAME
from camtorque.report.fit_file import run_fit_document
from camtorque.report.page import run_page
from camtorque.report.phases import phases


def write_run(result: RunResult, folder: Path) -> dict[str, Any]:
    """Write cycles.h5, figures/, report.html and result.json; return the last, with the time spent here."""
    start = time.perf_counter()
    write_cycles(folder / "cycles.h5", result.recording, result.cycles, result_variables(result))
    drawings = [
        drawing_of(name, chart, spec.title, spec.caption, spec.section, spec.wide)
        for name, spec in FIGURES.items()
        if (chart := spec.draw(result)) is not None
    ]
    write_figures(drawings, folder / "figures", lambda name: FIGURES[name].png)
    doc = result_document(result)
    correlation = (result.fitted.correlation_names, result.fitted.correlation)
    strokes = phases(result.rigid.theta, result.rigid.lift)
    page = run_page(doc, drawings, result.recording.config.text, strokes, correlation)
    write_page(folder / "report.html", page)
    spent = time.perf_counter() - start
    timing = {**result.timing, "report": spent, "total": sum(result.timing.values()) + spent}
    doc["timing_s"] = timing
    write_json(folder / FIT_NAME, run_fit_document(result))
    write_json(folder / "result.json", doc)
    return doc


def write_pdf(page: Path) -> Path:
    """Write a page of this room beside itself as PDF and return its path.

    Raises
    ------
    Refusal : WeasyPrint is not installed, or lacks a library of the system
    """
    try:
        from weasyprint import HTML
    except (ImportError, OSError) as error:
        raise Refusal(
            f"--pdf: WeasyPrint cannot be used ({error}), expected the extra 'pdf'; pip install 'camtorque[pdf]'"
        ) from error
    logging.getLogger("weasyprint").setLevel(logging.ERROR)  # it warns of every rule for screens
    target = page.with_suffix(".pdf")
    with atomic_file(target) as partial:
        HTML(string=page.read_text(encoding="utf-8"), base_url=None).write_pdf(partial)
    return target

"""Everything of one run, one alignment, one prediction into a folder."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from markupsafe import Markup

from camtorque.align import alignment_summary
from camtorque.mechanism.predict import Prediction, prediction_document
from camtorque.plain import plain
from camtorque.records import CamCycles, Recording
from camtorque.report.bundle import RunResult
from camtorque.report.chart import Chart
from camtorque.report.cycles_file import write_aligned, write_cycles
from camtorque.report.document import (
    findings_document,
    inputs_document,
    result_document,
    write_json,
)
from camtorque.report.figures import FIGURES, FigureSpec, png_of, svg_of
from camtorque.report.folder import output_folder
from camtorque.report.overview_figures import aligned_cycles
from camtorque.report.page import ESCAPED, Drawing, align_page, run_page
from camtorque.report.phases import phases
from camtorque.report.predict_page import prediction_page
from camtorque.version import __version__


def write_run(result: RunResult, folder: Path) -> dict[str, Any]:
    """Write cycles.h5, figures/, report.html and result.json; return the content of the last.

    Parameters
    ----------
    result : one finished run; the time spent here is added to its ``timing``
    folder : an existing folder
    """
    start = time.perf_counter()
    write_cycles(folder / "cycles.h5", result)
    charts = {name: (spec, spec.draw(result)) for name, spec in FIGURES.items()}
    drawings = [drawn(name, spec, chart) for name, (spec, chart) in charts.items() if chart is not None]
    write_figures(drawings, folder / "figures", lambda name: FIGURES[name].png)
    doc = result_document(result)
    correlation = (result.fitted.correlation_names, result.fitted.correlation)
    strokes = phases(result.rigid.theta, result.rigid.lift)
    page = run_page(doc, drawings, result.recording.config.text, strokes, correlation)
    (folder / "report.html").write_text(page, encoding="utf-8", errors=ESCAPED)
    spent = time.perf_counter() - start
    timing = {**result.timing, "report": spent, "total": sum(result.timing.values()) + spent}
    doc["timing_s"] = plain(timing)
    write_json(folder / "result.json", doc)
    return doc


def drawn(name: str, spec: FigureSpec, chart: Chart) -> Drawing:
    """Return a chart as a figure of a page."""
    svg = Markup(svg_of(chart, f"{spec.title}. {spec.caption}"))
    return Drawing(name, spec.title, spec.caption, spec.section, spec.wide, chart, svg)


def write_figures(drawings: list[Drawing], folder: Path, wants_png: Callable[[str], bool]) -> None:
    """Write every figure as SVG, the main ones as PNG too."""
    folder.mkdir(exist_ok=True)
    for item in drawings:
        (folder / f"{item.name}.svg").write_text(item.svg, encoding="utf-8")
        if wants_png(item.name):
            (folder / f"{item.name}.png").write_bytes(png_of(item.svg))


ALIGNED = FigureSpec(
    "One revolution", "Mean over the used cycles and their scatter.", lambda result: None, "curves", True
)


def write_alignment(recording: Recording, cycles: CamCycles, created: str, folder: Path) -> dict[str, Any]:
    """Write aligned.h5, align.html and align.json; return the content of the last."""
    write_aligned(folder / "aligned.h5", recording, cycles)
    summary = alignment_summary(cycles)
    findings = findings_document(dict.fromkeys((*recording.findings, *cycles.findings)))
    doc = plain({
        "schema": "camtorque.align/1", "version": __version__, "created": created, "name": recording.config.id,
        "inputs": inputs_document(recording), **summary, "findings": findings,
    })  # fmt: skip
    drawings = [drawn("aligned_cycles", ALIGNED, aligned_cycles(cycles))]
    write_figures(drawings, folder / "figures", lambda name: True)
    (folder / "align.html").write_text(
        align_page(doc, drawings, recording.config.text), encoding="utf-8", errors=ESCAPED
    )
    write_json(folder / "align.json", doc)
    return doc


def write_prediction(prediction: Prediction, title: str, target: Path) -> None:
    """Write predict.json and predict.html of a pump; ``target`` appears whole or not at all."""
    with output_folder(target) as folder:
        (folder / "predict.html").write_text(prediction_page(prediction, title), encoding="utf-8", errors=ESCAPED)
        write_json(folder / "predict.json", plain(prediction_document(prediction)))

"""Everything of one run, one alignment, one campaign into a folder."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from camtorque.align import alignment_summary
from camtorque.mechanism.predict import Prediction, prediction_document
from camtorque.plain import plain
from camtorque.records import CamCycles, Recording
from camtorque.report.bundle import CampaignResult, RunResult
from camtorque.report.campaign_figures import CAMPAIGN_FIGURES, campaign_drawing, can_draw
from camtorque.report.cycles_file import write_aligned, write_cycles
from camtorque.report.document import inputs_document, parameters_document, result_document, write_json
from camtorque.report.figures import FIGURES, drawn_svg
from camtorque.report.folder import output_folder
from camtorque.report.overview_figures import aligned_cycles
from camtorque.report.page import align_page, campaign_page, run_page
from camtorque.report.posterior_figures import write_posterior
from camtorque.report.predict_page import prediction_page
from camtorque.report.style import svg_text
from camtorque.version import __version__

DPI = 150
ESCAPED = "backslashreplace"
"""A path may hold bytes that are no text; pages show them escaped."""


def write_run(result: RunResult, folder: Path) -> dict[str, Any]:
    """Write cycles.h5, figures/, report.html and result.json; return the content of the last.

    Parameters
    ----------
    result : one finished run; the time spent here is added to its ``timing``
    folder : an existing folder
    """
    start = time.perf_counter()
    write_cycles(folder / "cycles.h5", result)
    drawings = [_drawing(name, result, folder / "figures") for name in FIGURES]
    posterior = result.fitted.details.get("posterior")
    if posterior is not None:
        write_posterior(posterior, folder)
    doc = result_document(result)
    page = run_page(doc, result.fitted.ladder, drawings, result.recording.config.text)
    (folder / "report.html").write_text(page, encoding="utf-8", errors=ESCAPED)
    spent = time.perf_counter() - start
    timing = {**result.timing, "report": spent, "total": sum(result.timing.values()) + spent}
    doc = result_document(replace(result, timing=timing))
    write_json(folder / "result.json", doc)
    return doc


def _drawing(name: str, result: RunResult, folder: Path) -> dict[str, Any]:
    figure, svg = drawn_svg(name, result)
    _save(figure, svg, folder, name)
    spec = FIGURES[name]
    return {"name": name, "title": spec.title, "caption": spec.caption, "section": spec.section, "wide": spec.wide,
            "svg": svg}  # fmt: skip


def _save(figure: Figure, svg: str, folder: Path, name: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.svg").write_text(svg, encoding="utf-8", errors=ESCAPED)
    # the SVG laid the figure out already; doing so again costs as much as drawing it
    figure.set_layout_engine("none")
    figure.savefig(folder / f"{name}.png", dpi=DPI, metadata={"Software": None})


def write_alignment(recording: Recording, cycles: CamCycles, created: str, folder: Path) -> dict[str, Any]:
    """Write aligned.h5, align.html and align.json; return the content of the last."""
    write_aligned(folder / "aligned.h5", recording, cycles)
    summary = alignment_summary(cycles)
    findings = [asdict(row) for row in dict.fromkeys((*recording.findings, *cycles.findings))]
    doc = plain({
        "schema": "camtorque.align/1", "version": __version__, "created": created, "name": recording.config.id,
        "inputs": inputs_document(recording), **summary, "findings": findings,
    })  # fmt: skip
    figure = aligned_cycles(cycles)
    svg = svg_text(figure, "aligned_cycles")
    _save(figure, svg, folder / "figures", "aligned_cycles")
    drawing = {"title": "One revolution", "caption": "Mean over the used cycles and their scatter.", "svg": svg}
    (folder / "align.html").write_text(
        align_page(doc, [drawing], recording.config.text), encoding="utf-8", errors=ESCAPED
    )
    write_json(folder / "align.json", doc)
    return doc


def write_campaign(result: CampaignResult, folder: Path) -> dict[str, Any]:
    """Write campaign.html and campaign.json; return the content of the latter."""
    doc = campaign_document(result)
    thumbnails = {entry.name: entry.thumbnail for entry in result.entries if entry.status == "ok"}
    (folder / "campaign.html").write_text(
        campaign_page(doc, thumbnails, _campaign_drawings(result, folder / "figures")), encoding="utf-8"
    )
    write_json(folder / "campaign.json", doc)
    return doc


def _campaign_drawings(result: CampaignResult, folder: Path) -> list[dict[str, Any]]:
    rows = []
    for name, (section, title, caption, _) in CAMPAIGN_FIGURES.items():
        if result.joint is None or not can_draw(name, result.joint):
            continue
        figure = campaign_drawing(name, result.joint)
        svg = svg_text(figure, name)
        _save(figure, svg, folder, name)
        rows.append({"section": section, "title": title, "caption": caption, "svg": svg})
    return rows


def write_prediction(prediction: Prediction, title: str, target: Path) -> None:
    """Write predict.json and predict.html of a pump; ``target`` appears whole or not at all."""
    with output_folder(target) as folder:
        (folder / "predict.html").write_text(prediction_page(prediction, title), encoding="utf-8", errors=ESCAPED)
        write_json(folder / "predict.json", plain(prediction_document(prediction)))


def campaign_document(result: CampaignResult) -> dict[str, Any]:
    """Return the content of campaign.json."""
    joint = result.joint
    return plain({
        "schema": "camtorque.campaign/1", "version": __version__, "created": result.created,
        "n_refused": sum(entry.status != "ok" for entry in result.entries),
        "recordings": [_entry(result, k) for k in range(len(result.entries))],
        "effects": joint.effects if joint else [],
        "shared_parameters": parameters_document(joint.shared_parameters) if joint else {},
        "held_out": [asdict(row) for row in joint.held_out] if joint else [],
        "ladder": [asdict(row) for row in joint.ladder] if joint else [],
        "drifts": [asdict(row) for row in joint.drifts] if joint else [],
        "left_aside": joint.left_aside if joint else [],
        "findings": [asdict(row) for row in (*result.findings, *(joint.findings if joint else ()))],
        "timing_s": result.timing,
    })  # fmt: skip


def _entry(result: CampaignResult, number: int) -> Mapping[str, Any]:
    entry, joint = result.entries[number], result.joint
    row: dict[str, Any] = {"name": entry.name, "id": entry.id or None, "status": entry.status,
                           "error": entry.error or None, "speed_rpm": None, "metrics": None, "metrics_joint": None,
                           **entry.summary}  # fmt: skip
    if joint is not None and entry.status == "ok" and entry.id in joint.names:
        fitted = joint.fitted[joint.names.index(entry.id)]
        row["metrics_joint"] = {name: asdict(value) for name, value in fitted.metrics.items()}
    return row

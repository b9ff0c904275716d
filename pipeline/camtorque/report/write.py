"""Everything of one run into a folder: every figure in the order of the page, and the page as PDF (extra `pdf`)."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from camtorque.records import Refusal
from camtorque.report import curve_figures, fit_figures
from camtorque.report.bundle import RunResult
from camtorque.report.chart import Chart, phases
from camtorque.report.cycles_file import result_variables, write_cycles
from camtorque.report.document import result_document
from camtorque.report.files import atomic_file, write_json, write_page
from camtorque.report.fit_file import NAME as FIT_NAME
from camtorque.report.fit_file import run_fit_document
from camtorque.report.page import drawing_of, run_page, write_figures


@dataclass(frozen=True)
class FigureSpec:
    """One figure of a run: a `Drawing` but for what ``draw`` shows, None where the run has nothing to show."""

    title: str
    caption: str
    draw: Callable[[RunResult], Chart | None]
    section: str
    wide: bool = False
    png: bool = False


PRESSURE = "pressure"
FIGURES: dict[str, FigureSpec] = {
    "torque_full": FigureSpec(
        "Torque over one revolution",
        "Where the dashed rigid model leaves the measured mean, something is missing in it; the fitted model should "
        "lie on the measured mean. Below: what the fit leaves over, on cycles that were not fitted.",
        curve_figures.full_cycle, "curves", True, True,
    ),
    PRESSURE: FigureSpec(
        "Line pressure and chamber pressure", "The sensor sits behind the delivery valve: the chamber pressure, which "
        "loads the plunger, is rebuilt from the torque and the laws of the chamber. Where none is shown, the "
        "measured pressure loads the plunger.",
        curve_figures.pressures, "curves", True, True,
    ),
    "lift": FigureSpec("Lift", "The strokes are those of the lift.", curve_figures.lift, "curves", True),
    "torque_forward": FigureSpec(
        "Forward stroke", "The lift rises; the pump is loaded.", partial(curve_figures.stroke, which=0), "strokes",
    ),
    "torque_return": FigureSpec(
        "Return stroke", "The lift falls; what is still compressed drives the cam.", 
        partial(curve_figures.stroke, which=1), "strokes",
    ),
    "gap": FigureSpec(
        "What closes the gap", "Measured − rigid torque, by cause. Left: mean over the loaded part of the forward "
        "stroke. Right: where the measured torque is least on the return stroke. Lines: two standard uncertainties.",
        fit_figures.gap, "causes",
        png=True,
    ),
    "losses": FigureSpec(
        "Work per revolution", "Each cause integrated on its own over the true cam angle. Lines: two standard "
        "uncertainties.", fit_figures.losses, "causes",
    ),
    "torque_by_cause": FigureSpec(
        "Torque by cause", "Each law on its own, as the transducer sees it; together they add up to the fitted model. "
        "Each panel has its own scale.", curve_figures.by_cause, "causes", True,
    ),
    "evidence": FigureSpec(
        "Which losses the data need", "Left: evidence for the loss against its absence (2 ln of the Bayes factor; bars "
        f"end at {fit_figures.EVIDENCE_SHOWN:g}); to the left of zero the data do better without. Right: how much the "
        "loss moves the mean cycle.",
        fit_figures.evidence, "evidence", True, True,
    ),
    "motion": FigureSpec(
        "Velocity and acceleration of the follower", "At the mean speed.", curve_figures.motion, "inside",
    ),
    "contact": FigureSpec(
        "Contact of cam and roller", "Normal force and the largest Hertz pressure.", curve_figures.contact, "inside",
    ),
    "reactions": FigureSpec("Bearing and guide reactions", "Of the fitted model.", curve_figures.reactions, "inside"),
    "cam_angle": FigureSpec(
        "Cam angle", "How far the cam is from where the trigger and a constant speed put it.", curve_figures.cam_angle,
        "alignment",
    ),
    "cycles": FigureSpec(
        "Used cycles", "A trend or a step here means that the run was not steady.", curve_figures.cycles, "alignment",
    ),
    "priors": FigureSpec(
        "Parameters against expectation", "Shaded: within two standard deviations of sheet, certificate or literature. "
        "Grey: no better known than before.", fit_figures.priors, "uncertainty",
    ),
    "budget": FigureSpec(
        "Where the uncertainty comes from",
        "Variance of each parameter that the data say something about, by source. The name of a parameter means "
        "what was known of it before: sheet, certificate, literature.", fit_figures.budget, "uncertainty",
        True,
    ),
}  # fmt: skip
"""File name -> figure."""
INSIDE = "Pressure in the chamber", "Its sensor measures what loads the plunger: nothing of it is rebuilt."
"""Title and caption of the pressure where it is measured in the chamber."""


def figures_of(result: RunResult) -> dict[str, FigureSpec]:
    """Return the figures of a run, each called what its sensors make of it."""
    if not result.recording.config.measures_chamber:
        return FIGURES
    title, caption = INSIDE
    return FIGURES | {PRESSURE: replace(FIGURES[PRESSURE], title=title, caption=caption)}


def write_run(result: RunResult, folder: Path) -> dict[str, Any]:
    """Write cycles.h5, figures/, report.html and result.json; return the last, with the time spent here."""
    start = time.perf_counter()
    write_cycles(folder / "cycles.h5", result.recording, result.cycles, result_variables(result))
    drawings = [
        drawing_of(name, chart, spec.title, spec.caption, spec.section, spec.wide, spec.png)
        for name, spec in figures_of(result).items()
        if (chart := spec.draw(result)) is not None
    ]
    write_figures(drawings, folder / "figures")
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

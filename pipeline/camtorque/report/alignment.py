"""The aligned cycles of one recording into a folder; imports no model and no fit, so that it is quick."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from camtorque.align import alignment_summary
from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.jsonable import jsonable
from camtorque.records import CamCycles, Recording
from camtorque.report.chart import CAM_ANGLE, Band, Curves, Line, Panel
from camtorque.report.cycles_file import aligned_variables, write_cycles
from camtorque.report.files import findings_document, inputs_document, write_json, write_page
from camtorque.report.page import drawing_of, render, write_figures
from camtorque.stacks import mean_of, std_of
from camtorque.units import BAR, DEGREE
from camtorque.version import __version__


def write_alignment(recording: Recording, cycles: CamCycles, created: str, folder: Path) -> dict[str, Any]:
    """Write aligned.h5, align.html and align.json; return the content of the last."""
    write_cycles(folder / "aligned.h5", recording, cycles, aligned_variables(cycles))
    summary = alignment_summary(cycles)
    findings = findings_document(dict.fromkeys((*recording.findings, *cycles.findings)))
    doc = jsonable({
        "schema": "camtorque.align/1", "version": __version__, "created": created, "name": recording.config.id,
        "inputs": inputs_document(recording.inputs), **summary, "findings": findings,
    })  # fmt: skip
    caption = "Mean over the used cycles and their scatter."
    place = "chamber" if recording.config.measures_chamber else "line"
    drawings = [drawing_of("aligned_cycles", aligned_cycles(cycles, place), "One revolution", caption)]
    write_figures(drawings, folder / "figures")
    title, text = f"{doc['name']}: aligned", recording.config.text
    write_page(folder / "align.html", render("align.html", drawings, title=title, doc=doc, config_text=text))
    write_json(folder / "align.json", doc)
    return doc


def aligned_cycles(cycles: CamCycles, place: str = "line") -> Curves:
    """Show mean and scatter of torque, pressure (``place`` of its sensor) and other channels over the cam angle."""
    rows = [] if cycles.torque is None else [(cycles.torque, 1.0, 0.0, "drive torque [N m]")]
    rows += [(cycles.pressure, 1.0 / BAR, 0.0, f"{place} pressure [bar]")] if cycles.pressure.size else []
    for quantity, values in cycles.channels.items():
        shown = CHANNEL_QUANTITIES[quantity]
        known = values[np.isfinite(values).all(axis=1)]
        label = f"{quantity.replace('_', ' ')} [{shown.shown_unit}]"
        rows.append((known, shown.shown_factor, shown.shown_offset, label))
    panels = []
    for values, factor, offset, name in rows:
        mean = mean_of(values)
        reach = 2.0 * abs(factor) * std_of(values, mean)
        mean = factor * mean + offset
        band = Band("single cycles, ±2 standard deviations", mean - reach, mean + reach)
        panels.append(Panel(name, (Line("mean", mean, "measured"),), (band,), 200.0))
    return Curves(cycles.theta / DEGREE, CAM_ANGLE, tuple(panels))

"""What the page of a campaign shows of its recordings: curves and numbers read from the reports, and their figures."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from sys import intern
from typing import Any
from urllib.parse import quote

import h5py
import numpy as np
from markupsafe import Markup

from camtorque.fit.drift import Drift
from camtorque.fit.joint import CampaignFit
from camtorque.records import UNTOLD, Array, ReadOnly
from camtorque.report.answer import NOT_LOSSES
from camtorque.report.bundle import THUMBNAIL, CampaignEntry
from camtorque.report.chart import CAM_ANGLE, NARROW, RAMP, WIDE, Curves, Line, Marks, Panel, RowPanel, Rows
from camtorque.report.fit_figures import CONSERVED, shares
from camtorque.report.numbers import unit_text, words
from camtorque.report.payload import as_data
from camtorque.units import DEGREE

POINTS = 360
MANY = 200
"""Recordings from which on curves have half the points, and no pictures: a thousand of them have to fit into a page."""
FEWEST = 2
"""Recordings that must tell a quantity before it is offered."""


@dataclass(frozen=True)
class Column(ReadOnly):
    """One number of every recording: ``values`` and ``stderr`` (n,), NaN where a recording does not tell."""

    label: str
    unit: str
    values: Array
    stderr: Array

    @property
    def title(self) -> str:
        """Name with unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


@dataclass(frozen=True)
class CampaignView(ReadOnly):
    """The used recordings side by side.

    Attributes
    ----------
    names, links, thumbnails : (n,) what they are called, where their pages are, SVG of their torques
    conditions : speed, load, temperature, where the recordings tell them
    quantities : what was found
    theta : (m,) cam angle [rad]
    torque, residual : (n, m) measured mean torque and measured - fitted [N m]; NaN where a file is missing
    budget : outcome -> source -> mean share of the variance [%]
    """

    names: tuple[str, ...]
    links: tuple[str, ...]
    thumbnails: tuple[str, ...]
    conditions: tuple[Column, ...]
    quantities: tuple[Column, ...]
    theta: Array
    torque: Array
    residual: Array
    budget: Mapping[str, Mapping[str, float]]


CONDITIONS = (
    ("speed", "rpm", ("recording", "speed_rpm")),
    ("peak line pressure", "bar", ("recording", "line_pressure_peak_bar")),
    ("fuel temperature", "°C", ("recording", "fuel_temperature_c")),
)
NUMBERS = (
    ("peak torque, measured", "N m", ("recording", "peak_torque_nm")),
    ("forward gap, rigid model", "%", ("metrics", "rigid", "forward_gap_percent")),
    ("return minimum, measured", "N m", ("metrics", "rigid", "return_min_measured_nm")),
    ("residual, rigid model", "% of peak", ("metrics", "rigid", "rms_percent_of_peak")),
    ("residual, fitted model", "% of peak", ("metrics", "fitted_held_out_cycles", "rms_percent_of_peak")),
    ("chamber peak", "bar", ("chamber", "peak_bar")),
    ("trigger angle", "deg", ("alignment", "trigger_angle_deg")),
    ("Hertz pressure, largest", "GPa", ("forces", "hertz_max_gpa")),
    ("work per revolution", "J", ("losses", "input")),
)
"""Label, unit, path in result.json; a path to an estimate brings its standard error."""
SECTIONS = tuple(dict.fromkeys(path[0] for *_, path in (*CONDITIONS, *NUMBERS)))
PARAMETER_KEYS = ("value", "stderr", "unit", "source", "knowledge")
"""What is kept of a result.json."""


def campaign_view(entries: Sequence[CampaignEntry], reports: Path) -> CampaignView:
    """Return the used recordings of a campaign, whose reports stand below ``reports``."""
    used = [entry for entry in entries if entry.status == "ok"]
    places = [entry.folder or entry.name for entry in used]
    found = [_document(reports / place / "result.json") for place in places]
    points = POINTS if len(used) <= MANY else POINTS // 2
    curves = np.array([_curves(reports / place / "cycles.h5", points) for place in places])
    curves = curves.reshape(len(used), 2, points)
    conditions = [_column(label, unit, path, found) for label, unit, path in CONDITIONS]
    quantities = [_column(label, unit, path, found) for label, unit, path in NUMBERS]
    return CampaignView(
        tuple(entry.name for entry in used), tuple(f"{quote(place)}/report.html" for place in places),
        tuple(_thumbnail(reports / place) if len(entries) <= MANY else "" for place in places),
        _shared_by_enough(conditions), _shared_by_enough([*quantities, *trends_of_losses(found), *_parameters(found)]),
        np.arange(points) * 2.0 * np.pi / points, curves[:, 0], curves[:, 1], _budget(found),
    )  # fmt: skip


def _document(path: Path) -> Mapping[str, Any]:
    """Return what a page needs of a result.json: a thousand whole ones would fill the memory."""
    if not path.is_file():
        return {}
    doc = json.loads(path.read_text(encoding="utf-8"))
    rows = doc.get("parameters", {})
    return {
        **{key: doc[key] for key in ("explained", *SECTIONS) if key in doc},
        "parameters": {
            intern(name): {key: intern(v) if isinstance(v := row.get(key), str) else v for key in PARAMETER_KEYS}
            for name, row in rows.items()
        },
        "uncertainty": {"budget": doc.get("uncertainty", {}).get("budget", {})},
    }


def _thumbnail(report: Path) -> str:
    path = report / THUMBNAIL
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _curves(path: Path, points: int) -> Array:
    """Return measured torque and residual at evenly spread angles, (2, points) [N m]."""
    if not path.is_file():
        return np.full((2, points), np.nan)
    with h5py.File(path) as file:
        torque, fitted = file["mean/torque"][:], file["model/fitted"][:]
    places, own = np.arange(points) / points, np.arange(torque.size) / torque.size
    return np.array([np.interp(places, own, curve, period=1.0) for curve in (torque, torque - fitted)])


def _value(document: Mapping[str, Any], path: Sequence[str]) -> tuple[float, float]:
    """Return a number with its standard error, NaN where there is none or the model explains nothing."""
    value: Any = document
    for key in path:
        value = value.get(key) if isinstance(value, Mapping) else None
    pair = (value.get("value"), value.get("stderr")) if isinstance(value, Mapping) else (value, None)
    number, error = (np.nan if item is None else float(item) for item in pair)
    return number, error if document.get("explained", True) else np.nan


def _column(label: str, unit: str, path: Sequence[str], documents: Sequence[Mapping[str, Any]]) -> Column:
    pairs = np.array([_value(document, path) for document in documents]).reshape(-1, 2)
    return Column(label, unit, pairs[:, 0], pairs[:, 1])


def _shared_by_enough(columns: Sequence[Column]) -> tuple[Column, ...]:
    return tuple(column for column in columns if np.count_nonzero(np.isfinite(column.values)) >= FEWEST)


def trends_of_losses(documents: Sequence[Mapping[str, Any]]) -> list[Column]:
    """Return the work by cause; what gives back over a revolution what it takes is no trend."""
    names = dict.fromkeys(
        name
        for doc in documents
        for name, value in doc.get("losses", {}).items()
        if name not in NOT_LOSSES and abs(value or 0.0) > CONSERVED * abs(doc["losses"]["input"])
    )
    return [_column(f"work: {words(name)}", "J per revolution", ("losses", name), documents) for name in names]


def _parameters(documents: Sequence[Mapping[str, Any]]) -> list[Column]:
    units = {name: row["unit"] for doc in documents for name, row in doc.get("parameters", {}).items()}
    return [
        _column(f"parameter: {words(name)}", unit_text(unit), ("parameters", name), documents)
        for name, unit in units.items()
    ]


def _budget(documents: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Return for each outcome that some recording states the mean share of each source in its variance [%]."""
    found: dict[str, list[dict[str, float]]] = {}
    for doc in (doc for doc in documents if doc.get("explained", True)):
        rows = doc.get("parameters", {})
        source_of = {name: row["source"] for name, row in rows.items()}
        for name, parts in doc.get("uncertainty", {}).get("budget", {}).items():
            if any(parts.values()) and rows.get(name, {}).get("knowledge") not in UNTOLD:
                found.setdefault(name, []).append(shares(parts, source_of))
    return {
        name: {
            source: sum(row.get(source, 0.0) for row in rows) / len(rows)
            for source in dict.fromkeys(source for row in rows for source in row)
        }
        for name, rows in found.items()
    }


def explorer_data(view: CampaignView) -> Markup:
    """Return the numbers of all recordings of a campaign for the script that draws trends and maps.

    Of many recordings the standard errors are left out: their bars would cover each other, and the page has to stay
    small; each recording's report has them.
    """
    few = len(view.names) <= MANY

    def floats(values: Array) -> str:
        return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")

    def column(item: Column) -> dict[str, str | None]:
        has_error = few and np.isfinite(item.stderr).any()
        error = floats(item.stderr) if has_error else None
        return {"label": item.label, "unit": item.unit, "v": floats(item.values), "e": error}

    return as_data({
        "names": list(view.names), "links": list(view.links), "ramp": list(RAMP),
        "conditions": [column(item) for item in view.conditions],
        "quantities": [column(item) for item in view.quantities],
    })  # fmt: skip


MOST_KEYS = 12
"""Recordings beyond which the curves of all are told by their tones alone."""
MOST_ROWS = 40
"""Recordings beyond which predictions are drawn over speed, not as one row each."""


def overlay(view: CampaignView) -> Curves | None:
    """Show measured torque of every recording, from slow (first tone) to fast (last tone); of few the residual too."""
    good = np.flatnonzero(np.isfinite(view.torque).all(axis=1))
    if not good.size:
        return None
    order = good[np.argsort(_speeds(view)[good], kind="stable")]
    labels = _with_speeds(view, order)
    rank = np.arange(order.size) / max(order.size - 1, 1)
    tones = [RAMP[round(share * (len(RAMP) - 1))] for share in rank]
    shown = [("measured torque [N m]", view.torque, 260.0), ("measured − fitted [N m]", view.residual, 130.0)]
    curves = list(zip(order, labels, tones, strict=True))
    panels = tuple(
        Panel(name, tuple(Line(label, values[k], tone, 1.0) for k, label, tone in curves), height=height,
              keys=order.size <= MOST_KEYS)
        for name, values, height in shown[: 1 if order.size > MANY else 2]
    )  # fmt: skip
    links = tuple(view.links[k] for k in order)
    return Curves(view.theta / DEGREE, CAM_ANGLE, panels, links=links)


def _speeds(view: CampaignView) -> np.ndarray:
    found = next((column.values for column in view.conditions if column.label == "speed"), None)
    return np.zeros(len(view.names)) if found is None else np.nan_to_num(found)


def _with_speeds(view: CampaignView, order: np.ndarray) -> list[str]:
    """Return what the curves are called: by their speeds alone where these tell the recordings apart."""
    speeds = [f"{speed:.0f} rpm" for speed in _speeds(view)[order]]
    if len(set(speeds)) == len(speeds):
        return speeds
    return [f"{view.names[k]}, {speed}" for k, speed in zip(order, speeds, strict=True)]


def trend(column: Column, over: Column) -> Curves:
    """Show one number over a condition; each recording is a point."""
    good = np.flatnonzero(np.isfinite(column.values) & np.isfinite(over.values))
    order = good[np.argsort(over.values[good], kind="stable")]
    error = np.nan_to_num(column.stderr[order])
    bars = error if error.any() and order.size <= MANY else None
    line = Line(column.label, column.values[order], "fitted", points=True, error=bars)
    panel = Panel(f"[{column.unit}]" if column.unit else "", (line,), height=110.0, zero=False, keys=False)
    return Curves(over.values[order], over.title, (panel,), full_turn=False, width=NARROW, live=False)


def drift_chart(joint: CampaignFit, drift: Drift) -> Curves:
    """Show one shared parameter, fitted to every recording alone, over speed, with the joint value."""
    shared = {row.name: row for row in joint.shared_parameters}
    order = np.argsort(drift.speeds_rpm)
    speeds = np.array(drift.speeds_rpm)[order]
    error = np.nan_to_num(np.array(drift.stderrs)[order]) if order.size <= MANY else None
    tone = "warn" if drift.significant else "fitted"
    lines = [Line("each alone", np.array(drift.values)[order], tone, points=True, error=error)]
    row = shared.get(drift.name)
    if row is not None and np.isfinite(row.value):
        lines.append(Line("joint", np.full(speeds.size, row.value), "muted", 1.2))
    unit = unit_text(drift.unit)
    panel = Panel(f"[{unit}]" if unit else "", tuple(lines), height=110.0, zero=False)
    return Curves(speeds, "speed [rpm]", (panel,), full_turn=False, width=NARROW, live=False)


def predictions(joint: CampaignFit, speeds: dict[str, float]) -> Rows | Curves:
    """Show the RMS of every recording predicted by the others, beside joint fit and rigid model; many over speed."""
    columns = [
        (name, tone, [fitted.metrics[key].rms_percent_of_peak for fitted in joint.fitted])
        for key, name, tone in (("rigid", "rigid model", "rigid"),
                                ("fitted_held_out_cycles", "joint fit, held-out cycles", "fitted"))
    ]  # fmt: skip
    for mode, tone in (("own_zero_and_end", "c2"), ("blind", "c3")):
        found = {row.name: row.metrics.rms_percent_of_peak for row in joint.held_out if row.mode == mode}
        columns.append(("left out, " + words(mode), tone, [found.get(name, float("nan")) for name in joint.names]))
    if len(joint.names) > MOST_ROWS:
        return _over_speed(columns, np.array([speeds.get(name, np.nan) for name in joint.names]))
    marks = tuple(
        Marks(name, tuple(values), (tone,), "ring" if name.startswith("left out") else "point")
        for name, tone, values in columns
    )
    return Rows(tuple(joint.names), (RowPanel("RMS residual [% of peak torque]", marks, log=True),), WIDE)


def _over_speed(columns: list[tuple[str, str, list[float]]], speeds: np.ndarray) -> Curves:
    order = np.argsort(speeds, kind="stable")
    lines = tuple(Line(name, np.array(values)[order], tone, points=True) for name, tone, values in columns)
    panel = Panel("RMS residual [% of peak]", lines, height=240.0)
    return Curves(speeds[order], "speed [rpm]", (panel,), full_turn=False)

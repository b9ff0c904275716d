"""Figures of a campaign: all recordings over each other, trends over speed, predictions, sources of uncertainty."""

from __future__ import annotations

import numpy as np

from camtorque.fit.drift import Drift
from camtorque.fit.joint import CampaignFit
from camtorque.report.campaign_view import MANY, CampaignView, Column
from camtorque.report.chart import CAM_ANGLE, NARROW, RAMP, WIDE, Curves, Line, Marks, Panel, RowPanel, Rows
from camtorque.report.numbers import unit_text, words
from camtorque.units import DEGREE

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

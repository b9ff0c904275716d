"""Figures of a campaign: shared parameters over speed, predictions of recordings that were left out, the ladder."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from camtorque.fit import CampaignFit, Drift
from camtorque.records import ParameterEstimate
from camtorque.report.style import CYCLE, FITTED, MUTED, RIGID, STYLE

DRIFT_COLUMNS = 4
DRIFT_SIGMA = 2.5
"""A slope beyond so many standard errors is drawn in the colour of a warning, as the fit's finding says it."""


def drifts(joint: CampaignFit) -> Figure:
    """Draw each shared parameter, fitted to every recording alone, over speed, with the joint value as a band."""
    shared = {row.name: row for row in joint.shared_parameters}
    rows = -(-len(joint.drifts) // DRIFT_COLUMNS)
    figure = Figure(figsize=(11.0, 0.5 + 1.75 * rows), layout="constrained")
    axes = figure.subplots(rows, DRIFT_COLUMNS, squeeze=False, sharex=True).ravel()
    for panel, drift in zip(axes, joint.drifts, strict=False):
        _drift(panel, drift, shared.get(drift.name))
    for panel in axes[len(joint.drifts) :]:
        panel.set_visible(False)
    for panel in axes[: len(joint.drifts)][-DRIFT_COLUMNS:]:
        panel.tick_params(labelbottom=True)
        panel.set_xlabel("speed [rpm]", fontsize=8)
    return figure


def _drift(axes: Axes, drift: Drift, joint: ParameterEstimate | None) -> None:
    moves = drift.slope_stderr > 0.0 and abs(drift.slope_per_1000_rpm) > DRIFT_SIGMA * drift.slope_stderr
    if joint is not None and np.isfinite(joint.value):
        axes.axhline(joint.value, color=MUTED, linewidth=0.8)
        if np.isfinite(joint.stderr):
            axes.axhspan(
                joint.value - joint.stderr, joint.value + joint.stderr, color="#eef1f4", zorder=-5, linewidth=0
            )
    axes.errorbar(
        drift.speeds_rpm, drift.values, yerr=np.nan_to_num(drift.stderrs), fmt="o", ms=3.6, elinewidth=1.1,
        color=CYCLE[1] if moves else FITTED,
    )  # fmt: skip
    axes.set_title(f"{drift.name.replace('_', ' ')} [{drift.unit}]", fontsize=8.5)
    axes.tick_params(labelsize=7.5)
    axes.ticklabel_format(axis="y", useOffset=False)


def predictions(joint: CampaignFit) -> Figure:
    """Draw the RMS of every recording predicted by the others, beside the joint fit and the rigid model."""
    place = np.arange(len(joint.names))
    figure = Figure(figsize=(10.0, 1.2 + 0.36 * len(joint.names)), layout="constrained")
    axes = figure.subplots()
    for key, name, (marker, color) in (
        ("rigid", "rigid model", ("s", RIGID)),
        ("fitted_held_out_cycles", "joint fit, held-out cycles", ("o", FITTED)),
    ):
        values = [fitted.metrics[key].rms_percent_of_peak for fitted in joint.fitted]
        axes.plot(values, place, marker, color=color, label=name)
    for mode, color, marker in (("own_zero_and_end", CYCLE[2], "D"), ("blind", CYCLE[3], "^")):
        found = {row.name: row.metrics.rms_percent_of_peak for row in joint.held_out if row.mode == mode}
        values = [found.get(name, float("nan")) for name in joint.names]
        axes.plot(values, place, marker, mfc="none", color=color, label="left out, " + mode.replace("_", " "))
    axes.set_xscale("log")
    axes.set_yticks(place, list(joint.names))
    axes.set_ylim(len(joint.names) - 0.4, -0.6)
    axes.set_xlabel("RMS residual [% of peak torque]")
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    return figure


CAMPAIGN_FIGURES: Mapping[str, tuple[str, str, str, Callable[[CampaignFit], Figure]]] = {
    "predictions": (
        "held_out", "How well a recording is predicted", "Left out: predicted with parameters fitted to the others.",
        predictions,
    ),
    "drifts": (
        "shared", "Shared parameters over speed", "Points: fitted to each recording alone. Line and band: joint value "
        "and its standard uncertainty. Orange: the slope exceeds 2.5 standard errors; a law may be missing.", drifts,
    ),
}  # fmt: skip
"""File name -> section, title, caption, drawing."""


def campaign_drawing(name: str, joint: CampaignFit) -> Figure:
    """Return one figure of a campaign in the common style."""
    with mpl.rc_context(STYLE):
        return CAMPAIGN_FIGURES[name][3](joint)


def can_draw(name: str, joint: CampaignFit) -> bool:
    """Tell whether the joint fit holds what a figure shows: few recordings have no drifts."""
    return bool(joint.drifts if name == "drifts" else joint.held_out)

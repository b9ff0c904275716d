"""Figures of a campaign: shared parameters over speed, predictions of recordings that were left out."""

from __future__ import annotations

import numpy as np

from camtorque.fit import CampaignFit, Drift
from camtorque.report.chart import WIDE, Curves, Line, Marks, Panel, RowPanel, Rows
from camtorque.report.numbers import unit_text, words

DRIFT_SIGMA = 2.5
"""A slope beyond so many standard errors is drawn in the colour of a warning, as the fit's finding says it."""
THIRD = 380.0


def drift_chart(joint: CampaignFit, drift: Drift) -> Curves:
    """Show one shared parameter, fitted to every recording alone, over speed, with the joint value."""
    shared = {row.name: row for row in joint.shared_parameters}
    order = np.argsort(drift.speeds_rpm)
    speeds = np.array(drift.speeds_rpm)[order]
    moves = drift.slope_stderr > 0.0 and abs(drift.slope_per_1000_rpm) > DRIFT_SIGMA * drift.slope_stderr
    lines = [
        Line("each alone", np.array(drift.values)[order], "warn" if moves else "fitted", points=True,
             error=np.nan_to_num(np.array(drift.stderrs)[order]))
    ]  # fmt: skip
    row = shared.get(drift.name)
    if row is not None and np.isfinite(row.value):
        lines.append(Line("joint", np.full(speeds.size, row.value), "muted", 1.2))
    unit = unit_text(drift.unit)
    panel = Panel(f"[{unit}]" if unit else "", tuple(lines), height=110.0, zero=False)
    return Curves(speeds, "speed [rpm]", (panel,), full_turn=False, width=THIRD, live=False)


def drift_title(drift: Drift) -> str:
    """Return the heading of a drift chart."""
    return words(drift.name)


def predictions(joint: CampaignFit) -> Rows:
    """Show the RMS of every recording predicted by the others, beside the joint fit and the rigid model."""
    marks = [
        Marks(name, tuple(fitted.metrics[key].rms_percent_of_peak for fitted in joint.fitted), (tone,), "point")
        for key, name, tone in (("rigid", "rigid model", "rigid"),
                                ("fitted_held_out_cycles", "joint fit, held-out cycles", "fitted"))
    ]  # fmt: skip
    for mode, tone in (("own_zero_and_end", "c2"), ("blind", "c3")):
        found = {row.name: row.metrics.rms_percent_of_peak for row in joint.held_out if row.mode == mode}
        values = tuple(found.get(name, float("nan")) for name in joint.names)
        marks.append(Marks("left out, " + words(mode), values, (tone,), "ring"))
    panel = RowPanel("RMS residual [% of peak torque]", tuple(marks), log=True)
    return Rows(tuple(joint.names), (panel,), WIDE)

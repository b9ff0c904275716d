"""Small pictures: the thumbnail of a recording and the aligned cycles without a model."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from camtorque.records import CamCycles
from camtorque.report.bundle import RunResult
from camtorque.report.style import (
    FITTED,
    MEASURED,
    RIGID,
    STYLE,
    band,
    curve,
    full_turn,
    label_axes,
    new_figure,
    svg_text,
)
from camtorque.report.torque_figures import measured_mean
from camtorque.units import BAR


def thumbnail(result: RunResult) -> str:
    """Return measured, rigid and fitted torque as a small SVG element without axes."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.2, 0.9), layout="constrained")
        axes = figure.subplots()
        theta = result.cycles.theta
        curve(axes, theta[::6], measured_mean(result)[0][::6], "", color=MEASURED, linewidth=1.6)
        curve(axes, theta[::6], result.rigid.torque[::6], "", color=RIGID, linewidth=0.8, linestyle="--")
        curve(axes, theta[::6], result.fitted.torque[::6], "", color=FITTED, linewidth=0.8)
        axes.set_axis_off()
        return svg_text(figure, "thumbnail " + result.recording.config.id)


def aligned_cycles(cycles: CamCycles) -> Figure:
    """Draw mean and scatter of torque (where there is one) and pressure over the cam angle."""
    rows = [] if cycles.torque is None else [(cycles.torque, "drive torque [N m]")]
    rows.append((cycles.pressure / BAR, "line pressure [bar]"))
    with mpl.rc_context(STYLE):
        figure = new_figure(len(rows), 9.6, 2.7 * len(rows))
        for axes, (values, name) in zip(figure.axes, rows, strict=True):
            mean, std = np.mean(values, axis=0), np.std(values, axis=0)
            band(axes, cycles.theta, mean - 2.0 * std, mean + 2.0 * std, "single cycles, ±2 standard deviations")
            curve(axes, cycles.theta, mean, "mean", color=MEASURED)
            label_axes(axes, name)
        full_turn(figure.axes[-1])
    return figure

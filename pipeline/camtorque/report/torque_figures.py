"""Measured against modelled torque: the full cycle, both strokes, and what the torque consists of."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from camtorque.fit.metrics import stroke_masks
from camtorque.records import Array
from camtorque.report.bundle import RunResult
from camtorque.report.style import (
    CYCLE,
    FITTED_OVER,
    LINE_STYLES,
    MEASURED,
    MUTED,
    RESIDUAL,
    RIGID,
    band,
    curve,
    degrees,
    full_turn,
    label_axes,
    new_figure,
)

MARGIN_DEG = 12.0
SMALL_CAUSE = 0.08
"""A cause whose largest torque is below this share of the largest cause is drawn in the lower panel."""


def measured_mean(result: RunResult) -> tuple[Array, Array]:
    """Return mean and standard deviation over cycles of the measured torque, each (n_theta,) [N m]."""
    assert result.cycles.torque is not None
    return np.mean(result.cycles.torque, axis=0), np.std(result.cycles.torque, axis=0, ddof=1)


def full_cycle(result: RunResult) -> Figure:
    """Draw the torque over one revolution with the residual below."""
    figure = new_figure(2, 9.6, 5.4, (3, 1.25))
    upper, lower = figure.axes
    _torques(upper, result)
    _strokes(upper, result)
    label_axes(upper, "drive torque [N m]", loc="upper right")
    _residuals(lower, result)
    full_turn(lower)
    return figure


def forward_stroke(result: RunResult) -> Figure:
    """Draw the forward stroke."""
    return _stroke(result, 0)


def return_stroke(result: RunResult) -> Figure:
    """Draw the return stroke."""
    return _stroke(result, 1)


def _stroke(result: RunResult, which: int) -> Figure:
    rigid = result.rigid
    mask = stroke_masks(rigid.lift, rigid.lift_velocity)[which]
    angle = degrees(rigid.theta)[mask]
    low, high = float(angle.min()) - MARGIN_DEG, float(angle.max()) + MARGIN_DEG
    figure = new_figure(2, 6.4, 4.6, (2.6, 1))
    upper, lower = figure.axes
    _torques(upper, result)
    label_axes(upper, "drive torque [N m]")
    _residuals(lower, result)
    lower.set_xlim(max(low, 0.0), min(high, 360.0))
    lower.set_xlabel("cam angle [deg]")
    _fit_ordinate(upper, result, (degrees(rigid.theta) >= low) & (degrees(rigid.theta) <= high))
    return figure


def _fit_ordinate(axes: Axes, result: RunResult, mask: NDArray[np.bool_]) -> None:
    shown = np.concatenate([curve[mask] for curve in (measured_mean(result)[0], result.rigid.torque)])
    margin = 0.06 * float(np.ptp(shown))
    axes.set_ylim(float(shown.min()) - margin, float(shown.max()) + margin)


def _torques(axes: Axes, result: RunResult) -> None:
    theta, (mean, std) = result.cycles.theta, measured_mean(result)
    axes.axhline(0.0, color=MUTED, linewidth=0.7)
    band(axes, theta, mean - 2.0 * std, mean + 2.0 * std, "single cycles, ±2 standard deviations")
    curve(axes, theta, mean, "measured mean", color=MEASURED, linewidth=3.2)
    curve(axes, theta, result.rigid.torque, "rigid model", color=RIGID, linestyle="--", linewidth=1.4)
    curve(axes, theta, result.fitted.torque, "fitted model", color=FITTED_OVER, linewidth=1.3)


def _residuals(axes: Axes, result: RunResult) -> None:
    """Draw the residual of the fitted model on held-out cycles with the standard error of the mean."""
    theta, cycles = result.cycles.theta, result.cycles
    assert cycles.torque is not None
    held = cycles.torque[cycles.held_out]
    error = np.std(cycles.torque, axis=0, ddof=1) / np.sqrt(max(held.shape[0], 1))
    residual = np.mean(held, axis=0) - result.fitted.torque_held_out
    axes.axhline(0.0, color=MUTED, linewidth=0.7)
    band(axes, theta, -2.0 * error, 2.0 * error, "±2 standard errors of the mean")
    curve(axes, theta, residual, "measured minus fitted, held-out cycles", color=RESIDUAL, linewidth=1.1)
    limit = 1.35 * float(max(np.max(np.abs(residual)), np.max(2.0 * error)))
    axes.set_ylim(-limit, 1.5 * limit)
    label_axes(axes, "residual [N m]", loc="upper right", ncols=2, fontsize=8)


def _strokes(axes: Axes, result: RunResult) -> None:
    rise, fall = stroke_masks(result.rigid.lift, result.rigid.lift_velocity)
    angle = degrees(result.rigid.theta)
    for mask, text in ((rise, "forward stroke"), (fall, "return stroke")):
        low, high = float(angle[mask].min()), float(angle[mask].max())
        axes.axvspan(low, high, color="#f3f5f7", zorder=-5, linewidth=0)
        axes.text(0.5 * (low + high), 1.01, text, transform=axes.get_xaxis_transform(), ha="center", va="bottom",
                  fontsize=8.5, color=MUTED)  # fmt: skip


def by_cause(result: RunResult) -> Figure:
    """Draw the torque by cause: the large ones above, the small ones below on their own scale."""
    causes = {name: values for name, values in result.fitted.by_cause.items() if np.any(values != 0.0)}
    height = {name: float(np.max(np.abs(values))) for name, values in causes.items()}
    largest = max(height.values(), default=1.0)
    groups = [[n for n in causes if height[n] >= SMALL_CAUSE * largest],
              [n for n in causes if height[n] < SMALL_CAUSE * largest]]  # fmt: skip
    panels = [group for group in groups if group]
    figure = new_figure(len(panels), 9.6, 2.9 * len(panels))
    for axes, names, what in zip(figure.axes, panels, ("torque [N m]", "small causes [N m]"), strict=False):
        axes.axhline(0.0, color=MUTED, linewidth=0.7)
        for k, name in enumerate(names):
            style = {"color": CYCLE[k % len(CYCLE)], "linestyle": LINE_STYLES[(k // 3) % len(LINE_STYLES)]}
            curve(axes, result.cycles.theta, causes[name], name.replace("_", " "), **style)
        label_axes(axes, what, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    full_turn(figure.axes[-1])
    return figure

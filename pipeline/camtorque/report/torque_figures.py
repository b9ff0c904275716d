"""Measured against modelled torque: the full cycle, both strokes, and what the torque consists of."""

from __future__ import annotations

import numpy as np

from camtorque.fit.residual import stroke_masks
from camtorque.records import Array
from camtorque.report.bundle import RunResult
from camtorque.report.chart import CAM_ANGLE, CYCLE, HALF, Band, Curves, Line, Panel, Span
from camtorque.report.numbers import words
from camtorque.report.phases import bump_spans, strokes
from camtorque.report.svg import Scale, drawing, padded, polyline
from camtorque.units import DEGREE

MARGIN_DEG = 12.0
SMALL_CAUSE = 0.08
"""A cause whose largest torque is below this share of the largest cause is drawn in the lower panel."""
DASHES = ("", "6 3", "2 3", "8 3 2 3")


def spans(result: RunResult) -> tuple[Span, ...]:
    """Return the strokes, and over them where the residual stands out."""
    return (*strokes(result.rigid.theta, result.rigid.lift), *bump_spans(result.fitted.bumps))


def full_cycle(result: RunResult) -> Curves:
    """Show measured and modelled torque over one revolution and the residual below."""
    angle = result.cycles.theta / DEGREE
    return Curves(angle, CAM_ANGLE, (_torques(result), _residuals(result)), spans=spans(result))


def stroke(result: RunResult, which: int) -> Curves:
    """Show the forward stroke (0) or the return stroke (1)."""
    rigid, angle = result.rigid, result.rigid.theta / DEGREE
    mask = stroke_masks(rigid.lift, rigid.lift_velocity)[which]
    low, high = max(float(angle[mask].min()) - MARGIN_DEG, 0.0), min(float(angle[mask].max()) + MARGIN_DEG, 360.0)
    panels = (_torques(result, 260.0, "torque [N m]"), _residuals(result, 90.0))
    return Curves(angle, CAM_ANGLE, panels, x_range=(low, high), spans=bump_spans(result.fitted.bumps), width=HALF,
                  live=False)  # fmt: skip


def _torques(result: RunResult, height: float = 250.0, ordinate: str = "drive torque [N m]") -> Panel:
    mean, std = result.cycles.mean_torque, result.cycles.torque_std
    lines = (
        Line("measured mean", mean, "measured", 2.6),
        Line("rigid model", result.rigid.torque, "rigid", 1.4, "6 4"),
        Line("fitted model", result.fitted.torque, "over", 1.4),
    )
    return Panel(ordinate, lines, (Band("single cycles, ±2 standard deviations", mean - 2 * std, mean + 2 * std),),
                 height)  # fmt: skip


def _residuals(result: RunResult, height: float = 100.0) -> Panel:
    """Return the residual of the fitted model on held-out cycles with the standard error of the mean."""
    cycles = result.cycles
    residual = cycles.torque_halves[1] - result.fitted.torque_held_out
    error = 2.0 * cycles.torque_std / np.sqrt(max(int(cycles.held_out.sum()), 1))
    limits = padded([residual, error, -error], 0.15)
    largest = max(abs(limits[0]), abs(limits[1]))
    return Panel(
        "residual [N m]", (Line("measured − fitted, held-out cycles", residual, "residual", 1.1),),
        (Band("±2 standard errors of the mean", -error, error),), height, limits=(-largest, largest),
    )  # fmt: skip


def by_cause(result: RunResult) -> Curves:
    """Show the torque by cause: the large ones above, the small ones below on their own scale."""
    causes = {name: values for name, values in result.fitted.by_cause.items() if np.any(values != 0.0)}
    height = {name: float(np.max(np.abs(values))) for name, values in causes.items()}
    largest = max(height.values(), default=1.0)
    groups = [[n for n in causes if height[n] >= SMALL_CAUSE * largest],
              [n for n in causes if height[n] < SMALL_CAUSE * largest]]  # fmt: skip
    panels = tuple(
        Panel(what, tuple(_cause(name, causes[name], k) for k, name in enumerate(names)), height=170.0)
        for names, what in zip(groups, ("torque [N m]", "small causes [N m]"), strict=True)
        if names
    )
    return Curves(result.cycles.theta / DEGREE, CAM_ANGLE, panels, spans=spans(result))


def _cause(name: str, values: Array, place: int) -> Line:
    return Line(words(name), values, CYCLE[place % len(CYCLE)], 1.4, DASHES[(place // 3) % len(DASHES)])


THUMB_WIDTH, THUMB_HEIGHT = 150.0, 50.0


def thumbnail(result: RunResult) -> str:
    """Return measured, rigid and fitted torque as a small SVG element without axes."""
    curves = (result.cycles.mean_torque, result.rigid.torque, result.fitted.torque)
    across = Scale(0.0, 2.0 * np.pi, 1.0, THUMB_WIDTH - 1.0)
    up = Scale(*padded(curves), THUMB_HEIGHT, 0.0)
    styles = (("measured", 1.6, ""), ("rigid", 0.8, "3 2"), ("fitted", 0.8, ""))
    parts = [
        polyline(across.places(result.cycles.theta), up.places(values), tone, width, dash)
        for values, (tone, width, dash) in zip(curves, styles, strict=True)
    ]
    return drawing(THUMB_WIDTH, THUMB_HEIGHT, f"torque of {result.recording.config.id}", parts)

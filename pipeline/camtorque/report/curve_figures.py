"""Figures over cam angle: torque measured and modelled, what happens inside the pump, what the alignment found."""

from __future__ import annotations

import numpy as np

from camtorque.fit.residual import stroke_masks
from camtorque.report.bundle import RunResult
from camtorque.report.chart import CAM_ANGLE, CYCLE, DASHES, HALF, Band, Curves, Line, Panel, Span, bump_spans, strokes
from camtorque.report.numbers import with_sign, words
from camtorque.report.svg import Scale, drawing, padded, polyline
from camtorque.stacks import distance_of, std_of
from camtorque.units import BAR, DEGREE, RPM

MARGIN_DEG = 12.0
SMALL_CAUSE = 0.08
"""A cause whose largest torque is below this share of the largest cause is drawn in the lower panel."""


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

    def line(name: str, place: int) -> Line:
        return Line(words(name), causes[name], CYCLE[place % len(CYCLE)], 1.4, DASHES[(place // 3) % len(DASHES)])

    panels = tuple(
        Panel(what, tuple(line(name, k) for k, name in enumerate(names)), height=170.0)
        for names, what in zip(groups, ("torque [N m]", "small causes [N m]"), strict=True)
        if names
    )
    return Curves(result.cycles.theta / DEGREE, CAM_ANGLE, panels, spans=spans(result))


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


def pressures(result: RunResult) -> Curves:
    """Show line pressure with its scatter and the chamber pressure, rebuilt and where there is a sensor measured."""
    fitted = result.fitted
    mean = result.cycles.mean_pressure / BAR
    std = std_of(result.cycles.pressure, result.cycles.mean_pressure) / BAR
    place = "chamber" if result.recording.config.measures_chamber else "line"
    lines = [Line(f"{place} pressure, measured", mean, "measured", 1.6)]
    bands = [Band(f"{place}, single cycles ±2 standard deviations", mean - 2.0 * std, mean + 2.0 * std)]
    if fitted.chamber_pressure is not None:
        chamber = fitted.chamber_pressure / BAR
        lines.append(Line("chamber pressure, rebuilt", chamber, "fitted", 1.6))
        if fitted.chamber_pressure_std is not None and result.fitted.explained:
            width = 2.0 * fitted.chamber_pressure_std / BAR
            bands.append(Band("chamber, ±2 standard uncertainties", chamber - width, chamber + width, "chamber"))
    inside = result.cycles.mean_cycle("chamber_pressure")
    if inside is not None:
        lines.append(Line("chamber pressure, measured", inside / BAR, "c3", 1.4, "6 3"))
    panel = Panel("gauge pressure [bar]", tuple(lines), tuple(bands), 190.0)
    return Curves(result.cycles.theta / DEGREE, CAM_ANGLE, (panel,), spans=spans(result))


def lift(result: RunResult) -> Curves:
    """Show the lift, which tells the strokes."""
    panel = Panel("lift [mm]", (Line("lift", 1e3 * result.rigid.lift, "c2"),), height=80.0)
    return Curves(result.rigid.theta / DEGREE, CAM_ANGLE, (panel,), spans=spans(result))


def motion(result: RunResult) -> Curves:
    """Show follower velocity and acceleration at the mean speed."""
    rigid, speed = result.rigid, result.cycles.mean_speed
    panels = (
        Panel("velocity [m/s]", (Line("velocity", speed * rigid.lift_velocity, "c2"),), height=120.0),
        Panel("acceleration [m/s²]", (Line("acceleration", speed**2 * rigid.lift_acceleration, "c1"),), height=120.0),
    )
    return Curves(rigid.theta / DEGREE, CAM_ANGLE, panels, width=HALF)


def contact(result: RunResult) -> Curves:
    """Show contact force and Hertz pressure, rigid and fitted."""
    rigid, fitted = result.rigid.forces, result.fitted.forces
    force = (Line("rigid", rigid.contact_normal / 1e3, "rigid", 1.4, "6 4"),
             Line("fitted", fitted.contact_normal / 1e3, "fitted"))  # fmt: skip
    stress = (Line("rigid", np.nan_to_num(rigid.hertz) / 1e9, "rigid", 1.4, "6 4"),
              Line("fitted", np.nan_to_num(fitted.hertz) / 1e9, "fitted"))  # fmt: skip
    panels = (Panel("contact [kN]", force, height=120.0), Panel("Hertz [GPa]", stress, height=120.0))
    return Curves(result.cycles.theta / DEGREE, CAM_ANGLE, panels, width=HALF)


def reactions(result: RunResult) -> Curves:
    """Show bearing and guide reactions of the fitted model."""
    forces = result.fitted.forces
    bearing = (Line("across (X1)", forces.bearing_x / 1e3, "c2"),
               Line("along the follower (Y1)", forces.bearing_y / 1e3, "c0"))  # fmt: skip
    guide = (Line("guide", forces.guide / 1e3, "c3"),)
    panels = (Panel("bearing [kN]", bearing, height=120.0), Panel("guide [kN]", guide, height=110.0))
    return Curves(result.cycles.theta / DEGREE, CAM_ANGLE, panels, width=HALF)


def cam_angle(result: RunResult) -> Curves:
    """Show how far the true cam angle lies from the nominal one: trigger, twist and speed within the revolution."""
    theta, fitted = result.cycles.theta, result.fitted
    nominal = (fitted.trigger_angle.value - fitted.trigger_angle.nominal) / DEGREE
    lines = (
        Line(f"trigger angle alone, {with_sign(nominal)} deg", np.full(theta.size, nominal), "c1", 1.2, "6 4"),
        Line("true − nominal cam angle", (fitted.true_angle - theta) / DEGREE, "fitted"),
    )
    return Curves(theta / DEGREE, CAM_ANGLE, (Panel("angle [deg]", lines, height=170.0),), width=HALF)


def cycles(result: RunResult) -> Curves:
    """Show the speed of the used cycles and how far each lies from the mean cycle."""
    record = result.cycles
    assert record.torque is not None
    distance = distance_of(record.torque, record.mean_torque)
    masks = ((~record.held_out, "fitted", "fitted"), (record.held_out, "held out", "c1"))
    panels = tuple(
        Panel(name, tuple(Line(label, np.where(mask, values, np.nan), tone, points=True)
                          for mask, label, tone in masks), height=100.0, zero=False)
        for name, values in (("speed [rpm]", record.speed / RPM), ("off mean [N m]", distance))
    )  # fmt: skip
    return Curves(record.index.astype(float), "cycle number in the recording", panels, full_turn=False, width=HALF)

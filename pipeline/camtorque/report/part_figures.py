"""What happens inside the pump: pressures, lift, forces, contact stress; and what the alignment found."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from camtorque.report.bundle import RunResult
from camtorque.report.style import CYCLE, FITTED, MEASURED, MUTED, RIGID, band, curve, full_turn, label_axes, new_figure
from camtorque.units import BAR, DEGREE, RPM


def pressures(result: RunResult) -> Figure:
    """Draw line pressure with its scatter and the rebuilt chamber pressure."""
    theta, fitted = result.cycles.theta, result.fitted
    mean, std = np.mean(result.cycles.pressure, axis=0) / BAR, np.std(result.cycles.pressure, axis=0) / BAR
    figure = new_figure(1, 9.6, 3.8)
    axes = figure.axes[0]
    band(axes, theta, mean - 2.0 * std, mean + 2.0 * std, "line, single cycles ±2 standard deviations")
    curve(axes, theta, mean, "line pressure, measured", color=MEASURED)
    if fitted.chamber_pressure is not None:
        chamber = fitted.chamber_pressure / BAR
        if fitted.chamber_pressure_std is not None:
            width = 2.0 * fitted.chamber_pressure_std / BAR
            band(axes, theta, chamber - width, chamber + width, "chamber, ±2 standard uncertainties", "#9cc9e6")
        curve(axes, theta, chamber, "chamber pressure, rebuilt", color=FITTED)
    label_axes(axes, "gauge pressure [bar]", loc="upper right")
    full_turn(axes)
    return figure


def lift(result: RunResult) -> Figure:
    """Draw lift, follower velocity and acceleration at the mean speed."""
    rigid, speed = result.rigid, result.cycles.mean_speed
    figure = new_figure(3, 6.4, 4.8)
    rows = ((1e3 * rigid.lift, "lift [mm]", CYCLE[0]), (speed * rigid.lift_velocity, "velocity [m/s]", CYCLE[2]),
            (speed**2 * rigid.lift_acceleration, "acceleration [m/s²]", CYCLE[1]))  # fmt: skip
    for axes, (values, name, color) in zip(figure.axes, rows, strict=True):
        curve(axes, rigid.theta, values, name, color=color)
        label_axes(axes, name, legend=False)
    full_turn(figure.axes[-1])
    figure.align_ylabels()
    return figure


def contact(result: RunResult) -> Figure:
    """Draw contact force and Hertz pressure, rigid and fitted."""
    theta, rigid, fitted = result.cycles.theta, result.rigid.forces, result.fitted.forces
    figure = new_figure(2, 6.4, 4.8)
    force, stress = figure.axes
    curve(force, theta, rigid.contact_normal / 1e3, "rigid", color=RIGID, linestyle="--")
    curve(force, theta, fitted.contact_normal / 1e3, "fitted", color=FITTED)
    label_axes(force, "contact force [kN]")
    for forces, name, style in ((rigid, "rigid", "--"), (fitted, "fitted", "-")):
        color = RIGID if name == "rigid" else FITTED
        curve(stress, theta, np.nan_to_num(forces.hertz) / 1e9, name, color=color, linestyle=style)
    label_axes(stress, "Hertz pressure [GPa]", legend=False)
    full_turn(stress)
    figure.align_ylabels()
    return figure


def reactions(result: RunResult) -> Figure:
    """Draw bearing and guide reactions of the fitted model."""
    theta, forces = result.cycles.theta, result.fitted.forces
    figure = new_figure(2, 6.4, 4.8)
    bearing, guide = figure.axes
    curve(bearing, theta, forces.bearing_x / 1e3, "across (X1)", color=CYCLE[2])
    curve(bearing, theta, forces.bearing_y / 1e3, "along the follower (Y1)", color=CYCLE[0])
    label_axes(bearing, "bearing [kN]")
    curve(guide, theta, forces.guide / 1e3, "guide force", color=CYCLE[3])
    label_axes(guide, "guide [kN]", legend=False)
    full_turn(guide)
    figure.align_ylabels()
    return figure


def cam_angle(result: RunResult) -> Figure:
    """Draw how far the true cam angle lies from the nominal one: trigger, twist and speed within the revolution."""
    theta = result.cycles.theta
    shift = (result.fitted.true_angle - theta) / DEGREE
    figure = new_figure(1, 6.4, 2.9)
    axes = figure.axes[0]
    axes.axhline(0.0, color=MUTED, linewidth=0.7)
    nominal = (result.fitted.trigger_angle.value - result.fitted.trigger_angle.nominal) / DEGREE
    axes.axhline(
        nominal, color=CYCLE[1], linestyle="--", linewidth=1.1, label=f"trigger angle alone, {nominal:+.2f} deg"
    )
    curve(axes, theta, shift, "true minus nominal cam angle", color=FITTED)
    label_axes(axes, "angle [deg]")
    full_turn(axes)
    return figure


def cycles(result: RunResult) -> Figure:
    """Draw the speed of the used cycles and how far each lies from the mean cycle."""
    record = result.cycles
    assert record.torque is not None
    distance = np.sqrt(np.mean((record.torque - np.mean(record.torque, axis=0)) ** 2, axis=1))
    figure = new_figure(2, 6.4, 3.6)
    speed, scatter = figure.axes
    for mask, name, color in ((~record.held_out, "fitted", FITTED), (record.held_out, "held out", CYCLE[1])):
        speed.plot(record.index[mask], record.speed[mask] / RPM, "o", ms=3.2, color=color, label=name)
        scatter.plot(record.index[mask], distance[mask], "o", ms=3.2, color=color)
    speed.ticklabel_format(axis="y", useOffset=False)
    label_axes(speed, "speed [rpm]", ncols=2)
    label_axes(scatter, "distance from\nthe mean [N m]", legend=False)
    scatter.set_ylim(bottom=0.0)
    scatter.set_xlabel("cycle number in the recording")
    figure.align_ylabels()
    return figure

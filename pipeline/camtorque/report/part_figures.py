"""What happens inside the pump: pressures, lift, forces, contact stress; and what the alignment found."""

from __future__ import annotations

import numpy as np

from camtorque.report.bundle import RunResult
from camtorque.report.chart import CAM_ANGLE, HALF, Band, Curves, Line, Panel
from camtorque.report.measured import measured_chamber
from camtorque.report.numbers import with_sign
from camtorque.report.torque_figures import spans
from camtorque.stacks import distance_of, std_of
from camtorque.units import BAR, DEGREE, RPM


def pressures(result: RunResult) -> Curves:
    """Show line pressure with its scatter and the chamber pressure, rebuilt and where there is a sensor measured."""
    fitted = result.fitted
    mean = result.cycles.mean_pressure / BAR
    std = std_of(result.cycles.pressure, result.cycles.mean_pressure) / BAR
    lines = [Line("line pressure, measured", mean, "measured", 1.6)]
    bands = [Band("line, single cycles ±2 standard deviations", mean - 2.0 * std, mean + 2.0 * std)]
    if fitted.chamber_pressure is not None:
        chamber = fitted.chamber_pressure / BAR
        lines.append(Line("chamber pressure, rebuilt", chamber, "fitted", 1.6))
        if fitted.chamber_pressure_std is not None and result.fitted.explained:
            width = 2.0 * fitted.chamber_pressure_std / BAR
            bands.append(Band("chamber, ±2 standard uncertainties", chamber - width, chamber + width, "chamber"))
    inside = measured_chamber(result)
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

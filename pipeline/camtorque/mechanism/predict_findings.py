"""What the designer of a pump has to know about its table, its pressure curve, its cam and its follower."""

from __future__ import annotations

import numpy as np

from camtorque.config.pump import HERTZ_SEEN, HERTZ_USUAL, PressureCurve
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.friction import jamming_friction
from camtorque.mechanism.kinematics import Kinematics
from camtorque.mechanism.load_check import misplaced_text
from camtorque.mechanism.mounting import Roller
from camtorque.records import Array, Finding, RigidTorque
from camtorque.units import DEGREE, RPM, TURN, closed

WIDEST_GAP, LARGEST_STEP = 20.0 * DEGREE, 0.2
"""Distance of two points of a pressure curve, and change over the swing, beyond which the curve between is a guess."""

LEAST_SWING = 0.3
"""Share of the largest pressure by which one swings that tells its place; what swings less a rail holds."""


def curve_findings(curve: PressureCurve | None) -> tuple[Finding, ...]:
    """Return a warning where a pressure curve jumps between distant points: what lies between is not known."""
    if curve is None or np.ptp(curve.pressure) == 0.0:
        return ()
    gap, change = (np.diff(values) for values in closed(curve.theta, curve.pressure))
    step = np.abs(change) / np.ptp(curve.pressure)
    blind = (gap > WIDEST_GAP) & (step > LARGEST_STEP)
    if not blind.any():
        return ()
    worst = int(np.argmax(np.where(blind, step, 0.0)))
    where = f"{curve.theta[worst] / DEGREE:g} deg"
    text = (
        f"the pressure curve has {curve.theta.size} points and changes by {100.0 * step[worst]:.0f} % of its swing "
        f"within {gap[worst] / DEGREE:.0f} degrees without a point between: a monotone cubic is put there; give more "
        "points"
    )
    return (Finding("pressure_curve_coarse", "warning", text, where),)


def load_findings(theta: Array, pressure: Array, lift: Array) -> tuple[Finding, ...]:
    """Return a warning where the pressure is not one that the plunger makes: curve or lift table are turned."""
    if np.ptp(pressure) <= LEAST_SWING * np.max(pressure):
        return ()
    said = misplaced_text(theta, pressure, lift)
    text = f"the pressure is not one that this plunger makes: {said}; check the zero of the angles of curve and lift"
    return (Finding("pressure_misplaced", "warning", text),) if said else ()


def stress_findings(theta: Array, stress: Array, speeds: Array) -> tuple[Finding, ...]:
    """Return a warning where the largest contact stress, (n_speeds, n_theta) [Pa], is beyond that of rolling steel."""
    known = np.nan_to_num(stress)
    row, column = np.unravel_index(int(np.argmax(known)), known.shape)
    if known[row, column] <= HERTZ_USUAL:
        return ()
    text = (
        f"the contact stress reaches {1e-9 * known[row, column]:.3g} GPa at {speeds[row] / RPM:.0f} rpm, rolling steel "
        f"has {HERTZ_SEEN}; check roller_width_m, roller_radius_m, plunger_diameter_m, youngs_modulus_*_Pa"
    )
    return (Finding("contact_stress_unusual", "warning", text, f"{theta[column] / DEGREE:.1f} deg"),)


def flight_findings(pumps: tuple[RigidTorque, ...], speeds: Array) -> tuple[Finding, ...]:
    """Return a warning for each speed at which the follower flies, with its landing."""
    found = []
    for pump, speed in zip(pumps, speeds, strict=True):
        for row in pump.flights:
            text = (
                f"the follower leaves the cam at {np.mod(row.start, TURN) / DEGREE:.1f} deg and lands at "
                f"{np.mod(row.landing, TURN) / DEGREE:.1f} deg with {row.speed:.2g} m/s, an impulse of "
                f"{row.impulse:.2g} N s that the curves do not show"
            )
            found.append(Finding("contact_lost", "warning", text, f"{speed / RPM:.0f} rpm"))
    return tuple(found)


def shaft_findings(stiffness: float) -> tuple[Finding, ...]:
    """Return which curves do not hold the swing of an elastic shaft [N m/rad]."""
    if np.isinf(stiffness):
        return ()
    text = "forces, Hertz pressure and torque by cause are those of a cam that turns evenly; the shaft's torque swings"
    return (Finding("forces_at_even_speed", "info", text),)


def cam_findings(path: Kinematics, law: CamLaw, roller: Roller, dry: bool) -> tuple[Finding, ...]:
    """Return what the designer has to know."""
    found = []
    if dry:
        found.append(Finding("no_pressure", "warning", "no pressure was given: spring and inertia only"))
    if roller.assumed:
        text = f"roller assumed to be a solid steel disk: {roller.mass:.4g} kg, {roller.inertia:.3g} kg m^2"
        found.append(Finding("roller_assumed", "info", text))
    flanks = (
        (
            "undercut",
            "error",
            "the roller is too large: no cam can drive this lift; take a smaller roller or a larger base circle",
            path.undercut,
        ),
        ("concave_flank", "info", "the cam is hollow on its flank: check the grinding wheel", path.concave),
    )
    for code, severity, text, mask in flanks:
        if np.any(mask):
            found.append(Finding(code, severity, text, f"{np.rad2deg(path.theta[mask][0]):.1f} deg"))
    steepest = int(np.argmax(np.abs(path.tan_pressure_angle)))
    steep = abs(float(path.tan_pressure_angle[steepest]))
    if steep > 1.0:
        limit, _ = jamming_friction(path)
        text = (
            f"the pressure angle reaches {np.degrees(np.arctan(steep)):.1f} degrees: the side force on the guide is "
            f"{steep:.2g} times the force along it; a guide friction of {limit:.2g} jams the follower on its rise"
        )
        found.append(Finding("steep_flank", "warning", text, f"{np.rad2deg(path.theta[steepest]):.1f} deg"))
    if np.max(law.continuity_at_knots()[2]) > 1e-6 * np.max(np.abs(path.acceleration)):
        found.append(Finding("acceleration_jump", "warning", "the acceleration of the lift jumps: shocks at speed"))
    return tuple(found)

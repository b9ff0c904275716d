"""Stability maps of the driveline: stiff and soft shafts, steps over the pump event, constraint drift."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from camtorque.mechanism.kinematics import kinematics
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import Array
from camtorque.studies.case import knotted_law, peak_error, study_pump
from camtorque.studies.driveline import (
    LINEAR,
    PREDICT,
    SCHEMES,
    TABLE,
    Shaft,
    adaptive,
    alpha_accelerations,
    at_angles,
    collocation,
    elastic,
    harmonic,
    load_rows,
    march_periodic,
)
from camtorque.studies.table import Outcome, StabilityMap, cell
from camtorque.units import TURN, angle_grid

CHECK = angle_grid(2003)
GAPS = (1.0e-5, 1.0e-2)
LIMITS = (1.0e-3, 5.0e-2)
"""Error of the torque over its peak up to which a solution works, and up to which it still serves a sketch."""
STEPS = 3600
EXPLICIT = ("explicit Euler", "symplectic Euler", "Heun", "RK4")
"""Schemes whose steps linear theory bounds."""


def _error(found: tuple[Array, ...], reference: Array) -> float:
    if not np.all(np.isfinite(found[1])) or np.any(np.diff(found[0]) <= 0.0):
        return float("inf")
    return peak_error(at_angles(found[0], found[1], check=CHECK), reference)


def _reference(shaft: Shaft) -> Array | None:
    theta, torque, success = collocation(shaft, 720, 6)
    return at_angles(theta, torque, check=CHECK) if success else None


def least_steps(scheme: str, shaft: Shaft) -> int:
    """Return the steps per revolution that linear theory asks for at the least inertia.

    The largest h at which both roots of the amplification of ``J x'' + c x' + k x = 0`` stay within the unit circle.
    """
    inertia = float(np.min(load_rows(angle_grid(720))[2]))
    matrix = np.array([[0.0, 1.0], [-shaft.stiffness / inertia, -shaft.damping / inertia]])
    low, high = 10.0, 1.0e7
    for _ in range(60):
        middle = np.sqrt(low * high)
        stable = _radius(scheme, matrix * (TURN / shaft.speed / middle)) <= 1.0 + 1e-12
        low, high = (low, middle) if stable else (middle, high)
    return round(high)


def _radius(scheme: str, z: Array) -> float:
    """Return the spectral radius of one step with h A = z (the units of the state do not matter to it)."""
    one, square = np.eye(2), z @ z
    if scheme == "symplectic Euler":
        kick = np.array([[1.0, 0.0], [z[1, 0], 1.0 + z[1, 1]]])
        step = np.array([[1.0, z[0, 1]], [0.0, 1.0]]) @ kick
    else:
        step = {
            "explicit Euler": one + z,
            "Heun": one + z + square / 2.0,
            "RK4": one + z + square / 2.0 + square @ z / 6.0 + square @ square / 24.0,
        }[scheme]
    return float(np.max(np.abs(np.linalg.eigvals(step))))


def _march(table: Array, scheme: str, shaft: Shaft, reference: Array | None) -> Outcome:
    theta, torque, bounded = march_periodic(table, shaft, scheme, STEPS)
    if not bounded:
        known = scheme in EXPLICIT and reference is not None
        theory = f"; linear theory asks for {least_steps(scheme, shaft)} steps/rev" if known else ""
        raise ArithmeticError(f"runs away (overflow){theory}")
    if reference is None:
        return 1.0, "cam angle not monotone" if np.any(np.diff(theta) <= 0.0) else ""
    return _error((theta, torque), reference)


def stiffness_map(quick: bool) -> StabilityMap:
    """Return schemes with 3600 steps per revolution and the package's solver over the stiffness of the shaft."""
    table, cells = load_rows(angle_grid(TABLE)), []
    for stiffness in (1e2, 1e4, 1e6) if quick else (3e1, 1e2, 1e3, 1e4, 1e5, 1e6):
        shaft, name = Shaft(stiffness=stiffness), f"k = {stiffness:g} N m/rad"
        reference = _reference(shaft)
        if reference is None:
            name += " (the cam stalls: no periodic orbit with forward motion)"
        for scheme in SCHEMES:
            cells.append(cell(name, scheme, partial(_march, table, scheme, shaft, reference), LIMITS))
        cells.append(cell(name, PREDICT, partial(_package, shaft, reference), LIMITS, default=True))
        stands = "the cam comes to a stand inside the revolution"
        collocated = partial(_solved, partial(collocation, shaft, 360, 4), stands, reference)
        cells.append(cell(name, "collocation in cam angle", collocated, LIMITS))
    note = "c = 0.5 N m s/rad, 500 rpm, five turns from rest; error of the shaft torque over its peak"
    return StabilityMap(
        "driveline_stiffness", f"Stiff and soft shafts, {STEPS} steps per revolution", tuple(cells), note
    )


def _package(shaft: Shaft, reference: Array | None) -> Outcome:
    found = elastic(shaft, 3600)
    return _error(found, reference) if reference is not None else 1.0


def _solved(solve: Callable[[], tuple[Array, Array, bool]], failure: str, reference: Array | None) -> Outcome:
    theta, torque, success = solve()
    if not success or reference is None:
        raise ArithmeticError(failure)
    return _error((theta, torque), reference)


def event_map(quick: bool) -> StabilityMap:
    """Return whether adaptive solvers, from rest, with and without a largest step, see every pump event."""
    table, shaft = load_rows(angle_grid(TABLE)), Shaft()
    reference = _reference(shaft)
    assert reference is not None
    cells = []
    for method in ("RK45", "Radau", "BDF", "LSODA"):
        for tolerance in (1e-5,) if quick else (1e-3, 1e-5, 1e-7):
            for capped in (True, False):
                step = "max_step 5 deg" if capped else "max_step free"
                solve = partial(adaptive, table, shaft, method, tolerance, capped)
                attempt = partial(_solved, solve, "solve_ivp: success = False", reference)
                cells.append(cell(f"rtol {tolerance:g}, {step}", f"scipy {method}", attempt, LIMITS))
    linear = partial(harmonic, load_rows(angle_grid(3600)), shaft)
    for name in dict.fromkeys(item.condition for item in cells):
        cells.append(cell(name, PREDICT, partial(_package, shaft, reference), LIMITS, default=True))
        cells.append(cell(name, LINEAR, lambda: _error(linear(), reference), LIMITS))
    note = "fourth turn from rest; on the base circle the shaft is at rest and a free step grows over the next lift"
    return StabilityMap("pump_event", "Stepping over the pump event", tuple(cells), note)


def drift(gain: float, turns: int, steps: int) -> float:
    """Return the gap of the closed loop over the lift for the cut joint held by force.

    Index 3 reduced to accelerations, ``y'' = Y'' omega^2 - 2 a g' - a^2 g`` with ``g = y - Y(theta)`` (Baumgarte
    1972), by RK4 at constant cam speed; minimal coordinates have g = 0 by construction.
    """
    law, omega = knotted_law(), Shaft().speed
    h = TURN / omega / steps
    grid = angle_grid(2 * steps)
    lift, slope, curve = law.derivatives(grid, 2)
    y, v, widest = 0.0, 0.0, 0.0

    def rate(place: int, y: float, v: float) -> float:
        k = place % (2 * steps)
        return float(curve[k] * omega**2 - 2.0 * gain * (v - slope[k] * omega) - gain**2 * (y - lift[k]))

    for n in range(turns * steps):
        i = 2 * n
        a1 = rate(i, y, v)
        v2 = v + 0.5 * h * a1
        a2 = rate(i + 1, y + 0.5 * h * v, v2)
        v3 = v + 0.5 * h * a2
        a3 = rate(i + 1, y + 0.5 * h * v2, v3)
        v4 = v + h * a3
        a4 = rate(i + 2, y + h * v3, v4)
        y, v = y + h * (v + 2 * v2 + 2 * v3 + v4) / 6.0, v + h * (a1 + 2 * a2 + 2 * a3 + a4) / 6.0
        if not abs(y) < 1.0:
            raise ArithmeticError("runs away (overflow)")
        gap = y - lift[(i + 2) % (2 * steps)]
        widest = max(widest, abs(gap))
    return widest / float(np.max(lift))


def _loop_gap(steps: int) -> Outcome:
    """Return by how much the package's contact point misses the roller's surface, over the lift."""
    path = kinematics(study_pump(), knotted_law(), angle_grid(steps))
    contact_x, contact_y = path.contact_point
    reach = np.hypot(contact_x - path.offset, contact_y - path.centre_height)
    return float(np.max(np.abs(reach - path.roller_radius)) / np.max(path.lift))


def drift_map(quick: bool) -> StabilityMap:
    """Return the drift of the cut joint over Baumgarte's gain and the steps, beside minimal coordinates."""
    turns, cells = 5 if quick else 20, []
    for steps in (90, 360) if quick else (90, 360, 1440):
        name = f"{steps} steps/rev, {turns} turns"
        for gain in (0.0, 10.0, 300.0, 3000.0):
            method = "index 3, no stabilisation" if gain == 0.0 else f"Baumgarte, gain {gain:g}/s"
            cells.append(cell(name, method, partial(drift, gain, turns, steps), GAPS, "gap / lift"))
        cells.append(cell(name, "minimal coordinates", partial(_loop_gap, steps), GAPS, "gap / lift", True))
    note = "largest gap between roller and cam over the lift; in minimal coordinates lift is a function of cam angle"
    return StabilityMap("constraint_drift", "Cut joint held by force", tuple(cells), note)


FAST = 6.0
"""Times the study's speed, a dry pump: inertia is then more than half of the contact force."""


def _force(acceleration: Array, lift: Array) -> Array:
    pump = study_pump()
    return pump.spring_preload + pump.spring_stiffness * lift + pump.follower_mass * acceleration


def _multiplier(rho: float, steps: int, turns: int) -> Outcome:
    """Return the error of the contact force over its peak, from the multiplier of the cut joint."""
    speed = FAST * Shaft().speed
    lift, slope, curve = knotted_law().derivatives(angle_grid(steps), 2)
    start = float(slope[0] * speed), float(curve[0] * speed**2)
    found = _force(alpha_accelerations(lift, TURN / speed / steps, turns, rho, start), lift)
    return peak_error(found, _force(curve * speed**2, lift))


def _minimal(steps: int) -> Outcome:
    speed, theta = FAST * Shaft().speed, angle_grid(steps)
    lift, _, curve = knotted_law().derivatives(theta, 2)
    found = closed_form_tables(study_pump(), knotted_law(), theta).evaluate("contact_y", np.zeros(steps), speed)
    return peak_error(found, _force(curve * speed**2, lift))


def multiplier_map(quick: bool) -> StabilityMap:
    """Return the contact force by generalized-alpha on the cut joint (index 3), beside minimal coordinates."""
    cells = []
    for steps in (90, 360) if quick else (90, 360, 720, 1440, 3600):
        for turns in (1, 20):
            name = f"{steps} steps/rev, {turns} turns"
            for rho in (1.0, 0.9, 0.8, 0.5):
                attempt = partial(_multiplier, rho, steps, turns)
                cells.append(cell(name, f"generalized-alpha, rho {rho:g}", attempt, LIMITS, "force error"))
            cells.append(cell(name, "minimal coordinates", partial(_minimal, steps), LIMITS, "force error", True))
    note = (
        "dry pump at 3000 rpm; error of the contact force over its peak; the position of the joint is exact, its force "
        "is the multiplier, which rho = 1 lets oscillate for ever and rho < 1 damps to first order at every knot"
    )
    return StabilityMap("cut_joint_force", "Force of the cut joint, index 3", tuple(cells), note)

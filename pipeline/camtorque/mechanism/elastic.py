"""Several pumps on a shaft with torsional springs between the lobes, in periodic steady running.

The drive end turns at constant speed Omega; lobe i leads it by delta_i. Its torque is the closed form at its own
angle, speed and acceleration, and the shaft pieces carry ``T_i = k_i (delta_(i-1) - delta_i)`` plus damping::

    tau_i(theta_i, omega_i, alpha_i) = T_i - T_(i+1)

A single lobe is solved by collocation in its cam angle (`collocation`), which is the cheaper one; several lobes have
no common cam angle and are solved in that of the drive (`periodic`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from camtorque.mechanism.cam import TURN
from camtorque.mechanism.collocation import solve_orbit
from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.periodic import Shaft, lobe_rows, solve_periodic
from camtorque.records import Array, ReadOnly, Refusal

ELEMENTS, STAGES = 360, 6
"""Of the collocation for a single lobe: on the front of the driveline chart (reports/studies)."""


@dataclass(frozen=True)
class ElasticShaft(ReadOnly):
    """Periodic solution on the uniform grid of drive angle, n_theta points over one revolution.

    Attributes
    ----------
    torque : (n_theta,) at the drive end [N m]
    section_torque : (n_pumps, n_theta) in each piece of shaft, drive end first [N m]
    twist : (n_pumps, n_theta) angle of each lobe ahead of the drive end, less than 0 where it lags [rad]
    speed, acceleration : (n_pumps, n_theta) of each lobe [rad/s, rad/s^2]
    """

    torque: Array
    section_torque: Array
    twist: Array
    speed: Array
    acceleration: Array


def solve_elastic(
    units: Sequence[PumpUnit], pressure: Array, speed: float, stiffness: Array, damping: Array
) -> ElasticShaft:
    """Return the periodic solution of pumps on an elastic shaft.

    Parameters
    ----------
    units : pumps from the drive end outward
    pressure : (n_pumps, n_theta) on each plunger over the angle of its own shaft piece, uniform from 0 [Pa]
    speed : of the drive end, constant [rad/s]
    stiffness, damping : (n_pumps,) of the shaft piece before each lobe [N m/rad, N m s/rad]

    Raises
    ------
    Refusal : no periodic motion was found: the shaft is too soft for its load, or resonates without damping
    """
    shaft = shaft_of(units, pressure, speed, stiffness, damping)
    with np.errstate(all="ignore"):  # a motion that runs away is refused
        found = (_alone(shaft) if len(units) == 1 else None) or solve_together(shaft)
    if found is None:
        raise _unsettled(shaft)
    return found


def shaft_of(units: Sequence[PumpUnit], pressure: Array, speed: float, stiffness: Array, damping: Array) -> Shaft:
    """Return the shaft with the pressures as periodic curves; see `solve_elastic`."""
    load = np.atleast_2d(np.asarray(pressure, dtype=np.float64))
    theta = np.asarray(np.arange(load.shape[1]) * (TURN / load.shape[1]), dtype=np.float64)
    curves = tuple(_periodic(np.append(theta, TURN), np.append(row, row[0])) for row in load)
    return Shaft(tuple(units), theta, curves, speed, np.asarray(stiffness, float), np.asarray(damping, float))


def solve_together(shaft: Shaft) -> ElasticShaft | None:
    """Return the motion of any number of lobes, None where none was found."""
    found = solve_periodic(shaft)
    if found is None:
        return None
    twist, rate, acceleration = found
    across, across_rate = (np.diff(values, axis=0, prepend=0.0) for values in (twist, rate))
    section = -(shaft.stiffness[:, None] * across + shaft.damping[:, None] * across_rate)
    return ElasticShaft(section[0], section, twist, shaft.speed + rate, acceleration)


def _alone(shaft: Shaft) -> ElasticShaft | None:
    """Return the motion of a single lobe by collocation in its cam angle, None where the cam does not turn forward."""
    rows = partial(lobe_rows, shaft.units[0], shaft.curves[0])
    values = float(shaft.stiffness[0]), float(shaft.damping[0]), shaft.speed
    orbit = solve_orbit(rows, _elements(shaft.units[0]), STAGES, values)
    if not orbit.closed:
        return None
    # from the stages to the uniform grid of the drive, which the cam leads
    drive = orbit.theta - orbit.lead
    stages = np.column_stack([orbit.torque, orbit.lead, orbit.rate, orbit.acceleration])
    curves = _periodic(np.append(drive, drive[0] + TURN), np.vstack([stages, stages[:1]]))
    torque, lead, rate, acceleration = curves(shaft.theta).T
    return ElasticShaft(torque, torque[None], lead[None], shaft.speed + rate[None], acceleration[None])


def _elements(unit: PumpUnit) -> Array:
    """Return the borders of the elements: the knots of the lift law where there are about as many, else even ones."""
    knots = unit.law.knots
    if ELEMENTS // 2 <= knots.size - 1 <= 2 * ELEMENTS:
        return np.asarray(knots + unit.phase, dtype=np.float64)
    return np.linspace(0.0, TURN, ELEMENTS + 1)


def _periodic(angle: Array, values: Array) -> CubicSpline:
    """Return a periodic interpolant of one revolution; the last row repeats the first."""
    return CubicSpline(angle, values, bc_type="periodic")


def _unsettled(shaft: Shaft) -> Refusal:
    lobes = zip(shaft.units, shaft.curves, strict=True)
    inertia = sum(float(np.mean(lobe_rows(unit, curve, shaft.theta)[2])) for unit, curve in lobes)
    stiffness = float(np.min(shaft.stiffness))
    order = np.sqrt(stiffness / inertia) / shaft.speed
    return Refusal(
        f"elastic shaft: no periodic motion was found at {shaft.speed:.6g} rad/s with {stiffness:.4g} N m/rad and "
        f"{float(np.min(shaft.damping)):.3g} N m s/rad (natural frequency at order {order:.3g} of the cam), expected a "
        "cam that keeps turning forward: a soft shaft lets it stop or turn back, a lightly damped one swings too far; "
        "check stiffness_N_m_per_rad and damping_N_m_s_per_rad, or leave them out for a rigid shaft"
    )

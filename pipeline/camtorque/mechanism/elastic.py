"""Several pumps on a shaft with torsional springs between the lobes, in periodic steady running.

The drive end turns at constant speed; lobe i runs at ``Omega t + delta_i``. Its torque is the closed form at its own
angle, speed and acceleration, and the shaft pieces carry ``T_i = k_i (delta_(i-1) - delta_i)`` plus damping::

    tau_i(theta_i, omega_i, alpha_i) = T_i - T_(i+1)

Everything is periodic in time, so the linear part (mean inertia of each lobe, springs, dampers) is solved harmonic by
harmonic, a tridiagonal system swept once from the free end to the drive end: cost grows with the number of lobes. The
rest of the torque is its load; it depends weakly on the twist and is found by fixed-point iteration, and where that
does not settle (a soft shaft, or a resonance below the highest harmonic) by collocation in drive angle with Newton's
method (`periodic`).
A single lobe is solved by collocation in its cam angle (`collocation`), which is cheaper; where that fails, the
harmonics follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.periodic import Shaft, lobe_rows, lobe_tables, periodic_curve, solve_orbit, solve_periodic
from camtorque.records import Array, ReadOnly, Refusal
from camtorque.units import TURN, angle_grid

Complex = NDArray[np.complex128]
ITERATIONS = 300
TOLERANCE = 1.0e-12
"""Change of the twist over its peak at which the iteration ends: rounding of the transforms is about 1e-13."""

ELEMENTS, STAGES = 360, 6
"""Of the collocation for a single lobe: on the front of the driveline chart (reports/studies)."""
GROWTH = 2.0
"""A step this much longer than the shortest so far does not lead to the solution."""


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
    load = np.atleast_2d(np.asarray(pressure, dtype=np.float64))
    alone = _alone(units[0], load[0], speed, stiffness, damping) if len(units) == 1 else None
    return solve_by_harmonics(units, load, speed, stiffness, damping) if alone is None else alone


def solve_by_harmonics(
    units: Sequence[PumpUnit], load: Array, speed: float, stiffness: Array, damping: Array
) -> ElasticShaft:
    """Return the same by harmonics, for any number of lobes; ``load`` (n_pumps, n_theta), see `solve_elastic`."""
    values = (np.asarray(each, dtype=np.float64) for each in (stiffness, damping))
    shaft = Shaft(units, load, speed, *values)
    theta, even = angle_grid(load.shape[1]), [replace(unit, phase=0.0) for unit in units]
    inertia = np.array([np.mean(lobe_tables(unit, theta).outputs["torque"][3]) for unit in even])
    twist = _fixed_point(shaft, inertia)
    if twist is None:
        with np.errstate(all="ignore"):
            twist = solve_periodic(shaft)
    if twist is None or np.min(_derivative(twist, speed, 1)) <= -speed:
        raise _unsettled(shaft, inertia)
    return _result(twist, shaft)


def _alone(unit: PumpUnit, load: Array, speed: float, stiffness: Array, damping: Array) -> ElasticShaft | None:
    """Return the motion of a single lobe by collocation in its cam angle, None where the cam does not turn forward."""
    rows = partial(lobe_rows, unit, periodic_curve(load))
    orbit = solve_orbit(rows, _elements(unit), STAGES, (float(stiffness[0]), float(damping[0]), speed))
    if not orbit.closed:
        return None
    # from the stages to the uniform grid of the drive, which the cam leads
    drive = orbit.theta - orbit.lead
    values = np.column_stack([orbit.torque, orbit.lead, orbit.rate, orbit.acceleration])
    curves = CubicSpline(np.append(drive, drive[0] + TURN), np.vstack([values, values[:1]]), bc_type="periodic")
    torque, lead, rate, acceleration = curves(angle_grid(load.size)).T
    return ElasticShaft(torque, torque[None], lead[None], speed + rate[None], acceleration[None])


def _elements(unit: PumpUnit) -> Array:
    """Return the borders of the elements: the knots of the lift law where there are about as many, else even ones."""
    knots = unit.law.knots
    if ELEMENTS // 2 <= knots.size - 1 <= 2 * ELEMENTS:
        return np.asarray(knots + unit.phase, dtype=np.float64)
    return np.linspace(0.0, TURN, ELEMENTS + 1)


def _fixed_point(shaft: Shaft, inertia: Array) -> Array | None:
    """Return the twist; None where the steps stop shrinking.

    They do where the shaft is soft, and where it resonates: there the varying part of the inertia, times the
    amplification, is more than the mean part that the linear answer knows.
    """
    twist, least = np.zeros(shaft.load.shape), np.inf
    for _ in range(ITERATIONS):
        change = _answer(shaft, inertia, twist) - twist
        twist, size = twist + change, float(np.max(np.abs(change)))
        if size <= TOLERANCE * np.max(np.abs(twist)):
            return twist
        if not size < GROWTH * least or np.max(np.abs(twist)) > 1.0:
            return None
        least = min(least, size)
    return None


def _answer(shaft: Shaft, inertia: Array, twist: Array) -> Array:
    """Return the twist that the loads at a twist cause in the linear shaft, (n_pumps, n_theta)."""
    rate, change = (_derivative(twist, shaft.speed, order) for order in (1, 2))
    torque = _lobe_output("torque", shaft.units, shaft.curves, twist, shaft.speed + rate, change)
    rest = np.fft.rfft(torque - inertia[:, None] * change)
    frequency = _frequency(twist, shaft.speed)
    return np.fft.irfft(_solve_harmonics(rest, frequency, inertia, shaft.stiffness, shaft.damping), twist.shape[1])


def _unsettled(shaft: Shaft, inertia: Array) -> Refusal:
    stiffness = float(np.min(shaft.stiffness))
    order = np.sqrt(stiffness / float(np.sum(inertia))) / shaft.speed
    return Refusal(
        f"elastic shaft: no periodic motion was found at {shaft.speed:.6g} rad/s with {stiffness:.4g} N m/rad and "
        f"{float(np.min(shaft.damping)):.3g} N m s/rad (natural frequency at order {order:.3g} of the cam), expected a "
        "cam that keeps turning forward: a soft shaft lets it stop or turn back, a lightly damped one swings too far; "
        "check stiffness_N_m_per_rad and damping_N_m_s_per_rad, or leave them out for a rigid shaft"
    )


def _frequency(values: Array, speed: float) -> Array:
    """Return the frequencies of the harmonics of periodic rows over one revolution [rad/s]."""
    return speed * np.fft.rfftfreq(values.shape[1], 1.0 / values.shape[1])


def _derivative(values: Array, speed: float, order: int) -> Array:
    """Return a time derivative of periodic rows."""
    return np.fft.irfft(np.fft.rfft(values) * (1j * _frequency(values, speed)) ** order, values.shape[1])


def contact_forces(units: Sequence[PumpUnit], pressure: Array, found: ElasticShaft) -> Array:
    """Return the contact normal force of each swinging lobe (n_pumps, n_theta), below 0 where it leaves its cam [N]."""
    curves = [periodic_curve(row) for row in pressure]
    return _lobe_output("contact_normal", units, curves, found.twist, found.speed, found.acceleration)


def _lobe_output(
    name: str, units: Sequence[PumpUnit], curves: list[CubicSpline], twist: Array, speed: Array, acceleration: Array
) -> Array:
    """Return an output of each lobe at its own angle, speed and acceleration, (n_pumps, n_theta)."""
    rows = []
    for unit, curve, ahead, rate, change in zip(units, curves, twist, speed, acceleration, strict=True):
        angle = angle_grid(ahead.size) + ahead
        rows.append(lobe_tables(unit, angle).evaluate(name, curve(angle), rate, change))
    return np.array(rows)


def _solve_harmonics(rest: Complex, frequency: Array, inertia: Array, stiffness: Array, damping: Array) -> Complex:
    """Solve J_i delta'' = T_i - T_(i+1) - rest_i for every harmonic by one sweep inward and one outward (Thomas 1949).

    From the free end, a lobe and all beyond it answer ``T_i = Z_i delta_(i-1) + f_i`` at the root of their shaft piece.
    """
    count = rest.shape[0]
    beyond_stiffness, beyond_load = np.zeros_like(rest[0]), np.zeros_like(rest[0])
    pivots, loads = np.empty_like(rest), np.empty_like(rest)
    pieces = stiffness[:, None] + 1j * frequency * damping[:, None]
    for i in range(count - 1, -1, -1):
        pivots[i] = pieces[i] + beyond_stiffness - frequency**2 * inertia[i]
        loads[i] = rest[i] + beyond_load
        # delta_i = (piece delta_(i-1) - load) / pivot, so T_i = piece (delta_(i-1) - delta_i)
        beyond_stiffness = pieces[i] - pieces[i] ** 2 / pivots[i]
        beyond_load = pieces[i] * loads[i] / pivots[i]
    twist, before = np.empty_like(rest), np.zeros_like(rest[0])
    for i in range(count):
        before = (pieces[i] * before - loads[i]) / pivots[i]
        twist[i] = before
    return twist


def _result(twist: Array, shaft: Shaft) -> ElasticShaft:
    """Return the record; the shaft torque follows from the twist of each piece."""
    rate, change = (_derivative(twist, shaft.speed, order) for order in (1, 2))
    across, across_rate = (np.diff(x, axis=0, prepend=np.zeros((1, x.shape[1]))) for x in (twist, rate))
    section = -(shaft.stiffness[:, None] * across + shaft.damping[:, None] * across_rate)
    return ElasticShaft(section[0], section, twist, shaft.speed + rate, change)

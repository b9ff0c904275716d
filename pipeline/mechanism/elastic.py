"""Several pumps on a shaft with torsional springs between the lobes, in periodic steady running.

The drive end turns at constant speed; lobe i runs at ``Omega t + delta_i``. Its torque is the closed form at its own
angle, speed and acceleration, and the shaft pieces carry ``T_i = k_i (delta_(i-1) - delta_i)`` plus damping::

    tau_i(theta_i, omega_i, alpha_i) = T_i - T_(i+1)

Everything is periodic in time, so the linear part (mean inertia of each lobe, springs, dampers) is solved harmonic by
harmonic, a tridiagonal system swept once from the free end to the drive end: cost grows with the number of lobes. The
rest of the torque is its load; it depends weakly on the twist and is found by fixed-point iteration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pipeline.mechanism.cam import TURN
from pipeline.mechanism.closed_form import closed_form_tables
from pipeline.mechanism.mounting import PumpUnit
from pipeline.records import Array, Refusal, freeze_arrays

Complex = NDArray[np.complex128]
ITERATIONS = 300
TOLERANCE = 1.0e-12
"""Change of the twist over its peak at which the iteration ends: rounding of the transforms is about 1e-13."""


@dataclass(frozen=True)
class ElasticShaft:
    """Periodic solution on the uniform grid of drive angle, n_theta points over one revolution.

    Attributes
    ----------
    torque : (n_theta,) at the drive end [N m]
    section_torque : (n_pumps, n_theta) in each piece of shaft, drive end first [N m]
    twist : (n_pumps, n_theta) angle of each lobe ahead of the drive end, less than 0 where it lags [rad]
    speed, acceleration : (n_pumps, n_theta) of each lobe [rad/s, rad/s^2]
    iterations : fixed-point steps taken
    """

    torque: Array
    section_torque: Array
    twist: Array
    speed: Array
    acceleration: Array
    iterations: int

    def __post_init__(self) -> None:
        freeze_arrays(self)


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
    Refusal : the iteration does not settle: the shaft is too soft for its load, or near a resonance without damping
    """
    load = np.atleast_2d(np.asarray(pressure, dtype=np.float64))
    count, size = load.shape
    theta = np.arange(size) * (TURN / size)
    frequency = speed * np.fft.rfftfreq(size, 1.0 / size)
    inertia = np.array(
        [np.mean(closed_form_tables(u.pump, u.law, theta, u.mounting).outputs["torque"][3]) for u in units]
    )
    curves = [_periodic(theta, row) for row in load]
    twist = np.zeros((count, size))
    for iteration in range(1, ITERATIONS + 1):
        rate, change = (_derivative(twist, frequency, order) for order in (1, 2))
        torque = _lobe_torque(units, curves, theta, twist, speed + rate, change)
        rest = np.fft.rfft(torque - inertia[:, None] * change)
        solved = _solve_harmonics(rest, frequency, inertia, stiffness, damping)
        step = np.fft.irfft(solved, size) - twist
        twist = twist + step
        if not np.all(np.isfinite(twist)) or np.max(np.abs(twist)) > 1.0:
            break
        if np.max(np.abs(step)) <= TOLERANCE * np.max(np.abs(twist)):
            return _result(twist, frequency, speed, stiffness, damping, iteration)
    raise Refusal(
        f"elastic shaft: the twist does not settle at {speed:.6g} rad/s with {np.min(stiffness):.4g} N m/rad; "
        "expected a stiffer shaft or more damping; check stiffness_N_m_per_rad and damping_N_m_s_per_rad"
    )


def _periodic(theta: Array, values: Array) -> CubicSpline:
    """Return a periodic interpolant of one revolution."""
    return CubicSpline(np.append(theta, TURN), np.append(values, values[0]), bc_type="periodic")


def _derivative(values: Array, frequency: Array, order: int) -> Array:
    """Return a time derivative of periodic rows."""
    return np.fft.irfft(np.fft.rfft(values) * (1j * frequency) ** order, values.shape[1])


def _lobe_torque(
    units: Sequence[PumpUnit],
    curves: list[CubicSpline],
    theta: Array,
    twist: Array,
    speed: Array,
    acceleration: Array,
) -> Array:
    """Return the torque of each lobe at its own angle, speed and acceleration, (n_pumps, n_theta)."""
    rows = []
    for unit, curve, ahead, rate, change in zip(units, curves, twist, speed, acceleration, strict=True):
        angle = theta + ahead
        tables = closed_form_tables(unit.pump, unit.law, angle - unit.phase, unit.mounting)
        rows.append(tables.evaluate("torque", curve(angle), rate, change))
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


def _result(
    twist: Array, frequency: Array, speed: float, stiffness: Array, damping: Array, iterations: int
) -> ElasticShaft:
    """Return the record; the shaft torque follows from the twist of each piece."""
    rate = _derivative(twist, frequency, 1)
    across, across_rate = (np.diff(x, axis=0, prepend=np.zeros((1, x.shape[1]))) for x in (twist, rate))
    section = -(stiffness[:, None] * across + damping[:, None] * across_rate)
    return ElasticShaft(section[0], section, twist, speed + rate, _derivative(twist, frequency, 2), iterations)

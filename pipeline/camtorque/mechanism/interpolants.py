"""Laws that follow a lift table point by point: cubic, quintic, and the smoothest that it could be a rounding of."""

from __future__ import annotations

import numpy as np

from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.periodic_spline import PeriodicSplines, solve_cyclic
from camtorque.mechanism.smoothing import smoothing_spline, table_error
from camtorque.records import Array, CamTable, Refusal
from camtorque.units import TURN


def _closed(table: CamTable) -> tuple[Array, Array]:
    """Return angle and lift with the first point repeated one revolution later."""
    return np.append(table.theta, table.theta[0] + TURN), np.append(table.lift, table.lift[0])


def _interpolant(table: CamTable, degree: int) -> CamLaw:
    """Return the periodic spline through every point; its error is that of rounding to the stated step."""
    theta, lift = _closed(table)
    splines = PeriodicSplines(theta, degree)
    normal = splines.normal(theta[:-1], np.ones(theta.size - 1))
    coefficients = solve_cyclic(normal, splines.right_side(theta[:-1], lift[:-1]))
    return CamLaw(theta, splines.pieces(coefficients), float(table.resolution / np.sqrt(12.0)))


def cubic_law(table: CamTable) -> CamLaw:
    """Return the periodic cubic interpolant, the method of the paper (Section 2.1, after Tsay et al.).

    It passes through every point, so the rounding of the table enters y'' with about 6 sigma / step^2.
    """
    return _interpolant(table, 3)


def quintic_law(table: CamTable) -> CamLaw:
    """Return the periodic quintic interpolant: y'' is smooth, and the rounding still enters with 4.8 sigma / step^2."""
    return _interpolant(table, 5)


def smoothing_law(table: CamTable) -> CamLaw:
    """Return the smoothest periodic quintic spline of which the table could be a rounding.

    Raises
    ------
    Refusal : the table's resolution is not positive, so that nothing says how far to smooth

    Notes
    -----
    See `camtorque.mechanism.smoothing`; an exact table (resolution 0) calls for `quintic_law`.
    """
    step = table.resolution
    if not step > 0.0:
        raise Refusal(
            f"lift table: resolution is {step} m, expected a positive step; state the resolution of the table"
        )
    theta, lift = _closed(table)
    knots, pieces = smoothing_spline(theta, lift, step)
    return CamLaw(knots, pieces, table_error(theta, table.lift, step))

"""Laws that follow a lift table point by point: cubic and quintic."""

from __future__ import annotations

import numpy as np

from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.periodic_spline import PeriodicSplines, solve_cyclic
from camtorque.records import CamTable
from camtorque.units import closed


def _interpolant(table: CamTable, degree: int) -> CamLaw:
    """Return the periodic spline through every point; its error is that of rounding to the stated step."""
    theta, _ = closed(table.theta, table.lift)
    splines = PeriodicSplines(theta, degree)
    normal = splines.normal(table.theta, np.ones(table.theta.size))
    coefficients = solve_cyclic(normal, splines.right_side(table.theta, table.lift))
    return CamLaw(theta, splines.pieces(coefficients), float(table.resolution / np.sqrt(12.0)))


def cubic_law(table: CamTable) -> CamLaw:
    """Return the periodic cubic interpolant, the method of the paper (Section 2.1, after Tsay et al.).

    It passes through every point, so the rounding of the table enters y'' with about 6 sigma / step^2.
    """
    return _interpolant(table, 3)


def quintic_law(table: CamTable) -> CamLaw:
    """Return the periodic quintic interpolant: y'' is smooth, and the rounding still enters with 4.8 sigma / step^2."""
    return _interpolant(table, 5)

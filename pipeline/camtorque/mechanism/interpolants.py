"""Laws that follow a lift table point by point: cubic, quintic, and the smoothest that it could be a rounding of."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline

from camtorque.mechanism.cam import TURN, CamLaw
from camtorque.mechanism.smoothing import smoothing_spline, table_error
from camtorque.records import Array, CamTable, Refusal


def _closed(table: CamTable) -> tuple[Array, Array]:
    """Return angle and lift with the first point repeated one revolution later."""
    return np.append(table.theta, table.theta[0] + TURN), np.append(table.lift, table.lift[0])


def _table_std(table: CamTable) -> float:
    """Return the standard deviation of rounding to the stated step, resolution / sqrt(12) [m]."""
    return float(table.resolution / np.sqrt(12.0))


def cubic_law(table: CamTable) -> CamLaw:
    """Return the periodic cubic interpolant, the method of the paper (Section 2.1, after Tsay et al.).

    It passes through every point, so the rounding of the table enters y'' with about 6 sigma / step^2.
    """
    theta, lift = _closed(table)
    spline = CubicSpline(theta, lift, bc_type="periodic")
    return CamLaw(spline.x, spline.c, _table_std(table))


def quintic_law(table: CamTable) -> CamLaw:
    """Return the periodic quintic interpolant: y'' is smooth, and the rounding still enters with 4.8 sigma / step^2."""
    theta, lift = _closed(table)
    pieces = PPoly.from_spline(make_interp_spline(theta, lift, k=5, bc_type="periodic"))
    return _trimmed(pieces, theta, _table_std(table))


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
            f"lift table: resolution is {step} m, expected a positive step; state the resolution of the table, "
            "or choose the quintic law for an exact one"
        )
    theta, lift = _closed(table)
    pieces = smoothing_spline(theta, lift, step)
    return _trimmed(pieces, theta, table_error(theta, table.lift, step))


def _trimmed(pieces: PPoly, theta: Array, lift_std: float) -> CamLaw:
    """Return the law of the pieces inside one revolution (a B-spline carries empty pieces at its ends)."""
    inside = (pieces.x[:-1] >= theta[0] - 1e-12) & (pieces.x[1:] <= theta[-1] + 1e-12) & (np.diff(pieces.x) > 1e-12)
    knots = np.append(pieces.x[:-1][inside], theta[-1])
    return CamLaw(knots, np.ascontiguousarray(pieces.c[:, inside]), lift_std)

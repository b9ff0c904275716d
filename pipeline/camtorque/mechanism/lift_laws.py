"""The registry of lift laws: how a table becomes a law. A new law is one function of a table and one line here.

`smoothing_law` takes the largest smoothing that the table's error allows, which is right for acceleration and Hertz
stress and rounds the ends of the dwells by a few micrometres. For torque the slope counts: `spectral_law` lets the
table itself decide, and generalised cross-validation (Golub, Heath & Wahba 1979) leaves less bias. On a uniform
periodic table a smoothing spline of order m is the filter ``1 / (1 + (k/k_c)^(2m))`` on its harmonics, so the choice is
a search over one number.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.periodic_spline import PeriodicSplines, solve_cyclic
from camtorque.mechanism.smoothing import smoothing_law, table_error
from camtorque.records import Array, CamTable, Refusal
from camtorque.units import TURN, closed

LEAST_POINTS = 12
"""Fewer points in a revolution leave a spline of order 6 with a pure guess between them."""
ORDER = 4
LEAST_CORNER = 8.0
"""Lowest corner harmonic that is tried: a table of three times as many points, or fewer, leaves nothing to choose."""
PIECES_PER_HARMONIC = 8
LEFT_OF_SCATTER = 2.0
"""Times the rounding up to which a scatter leaves no more than that behind the spectral law: it averages over rows."""


def _interpolant(table: CamTable, degree: int) -> CamLaw:
    """Return the periodic spline through every point; its error is that of rounding to the stated step."""
    theta, _ = closed(table.theta, table.lift)
    splines = PeriodicSplines(theta, degree)
    normal = splines.normal(table.theta, np.ones(table.theta.size))
    coefficients = solve_cyclic(normal, splines.right_side(table.theta, table.lift))
    return CamLaw(theta, splines.pieces(coefficients), float(table.resolution / np.sqrt(12.0)), TURN / table.theta.size)


def cubic_law(table: CamTable) -> CamLaw:
    """Return the periodic cubic interpolant, the method of the paper (Section 2.1, after Tsay et al.).

    It passes through every point, so the rounding of the table enters y'' with about 6 sigma / step^2.
    """
    return _interpolant(table, 3)


def quintic_law(table: CamTable) -> CamLaw:
    """Return the periodic quintic interpolant: y'' is smooth, and the rounding still enters with 4.8 sigma / step^2."""
    return _interpolant(table, 5)


def _attenuation(harmonic: Any, corner: float) -> Array:
    return 1.0 / (1.0 + (harmonic / corner) ** (2 * ORDER))


def cross_validation_corner(lift: Array) -> float:
    """Return the corner harmonic that minimises generalised cross-validation of a uniform periodic table (n,)."""
    n = lift.size
    spectrum = np.fft.rfft(lift)
    harmonic = np.arange(spectrum.size)
    weight = np.where((harmonic == 0) | (2 * harmonic == n), 1.0, 2.0)
    corners = np.arange(LEAST_CORNER, n / 3.0)
    scores = []
    for corner in corners:
        kept = _attenuation(harmonic, corner)
        residual = np.sum(weight * np.abs(spectrum * (1.0 - kept)) ** 2)
        scores.append(residual / (n - np.sum(weight * kept)) ** 2)
    return float(corners[int(np.argmin(scores))])


def spectral_law(table: CamTable) -> CamLaw:
    """Return the lift law for torque; a table of uneven steps, or of few points, goes to `smoothing_law`."""
    theta = table.theta
    step = TURN / theta.size
    if theta.size <= 3.0 * LEAST_CORNER or np.max(np.abs(np.diff(theta) - step)) > 1e-6 * step:
        return smoothing_law(table)
    corner = cross_validation_corner(table.lift)
    spectrum = np.fft.rfft(table.lift)
    harmonic = np.arange(spectrum.size)
    spectrum = spectrum * _attenuation(harmonic, corner)
    n = int(PIECES_PER_HARMONIC * np.ceil(corner))
    knots = theta[0] + np.arange(n + 1) * TURN / n
    derivatives = [_harmonic_sum(spectrum, harmonic, order, knots - theta[0], theta.size) for order in range(3)]
    return CamLaw(knots, _quintic_pieces(TURN / n, *derivatives), table_error(table, LEFT_OF_SCATTER), step)


def _quintic_pieces(width: float, lift: Array, slope: Array, curve: Array) -> Array:
    """Return the polynomials of degree 5 that meet lift, slope and curvature at both ends, (6, m), highest first."""
    c = np.array([lift[:-1], slope[:-1] * width, 0.5 * curve[:-1] * width**2])
    rise = lift[1:] - c[0] - c[1] - c[2]
    steeper = slope[1:] * width - c[1] - 2.0 * c[2]
    bent = 0.5 * curve[1:] * width**2 - c[2]
    cubic, quartic = 10.0 * rise - 4.0 * steeper + bent, -15.0 * rise + 7.0 * steeper - 2.0 * bent
    quintic = 6.0 * rise - 3.0 * steeper + bent
    return np.array([quintic, quartic, cubic, c[2], c[1], c[0]]) / width ** np.arange(5.0, -1.0, -1.0)[:, None]


def _harmonic_sum(spectrum: Any, harmonic: Any, order: int, theta: Array, size: int) -> Array:
    """Return a derivative of the Fourier sum at some angles."""
    scale = np.where((harmonic == 0) | (2 * harmonic == size), 1.0, 2.0) / size
    terms = spectrum * scale * (1j * harmonic) ** order
    return np.real(np.exp(1j * np.outer(theta, harmonic)) @ terms)


LIFT_METHODS: dict[str, Callable[[CamTable], CamLaw]] = {
    "smoothing": smoothing_law,
    "spectral": spectral_law,
    "quintic": quintic_law,
    "cubic": cubic_law,
}
"""``smoothing`` is the default for forces and Hertz stress, where y'' counts; ``spectral`` is for the torque of a fit,
where y' counts (docs/lift_laws.md); the other two interpolate, and a rounded table ruins their y''."""


def lift_law(table: CamTable, method: str = "smoothing") -> CamLaw:
    """Return the lift law of a table by one of `LIFT_METHODS`.

    Raises
    ------
    Refusal : unknown method, or a table too short for it
    """
    if method not in LIFT_METHODS:
        raise Refusal(f"lift law: method {method!r} is unknown, expected one of {', '.join(LIFT_METHODS)}")
    if table.theta.size < LEAST_POINTS:
        raise Refusal(
            f"lift table: {table.theta.size} points in one revolution, expected at least {LEAST_POINTS}; measure finer"
        )
    return _law(
        table.theta.astype(np.float64).tobytes(), table.lift.astype(np.float64).tobytes(), table.resolution, method
    )


@lru_cache(maxsize=8)
def _law(theta: bytes, lift: bytes, resolution: float, method: str) -> CamLaw:
    """Return the law of a table; a run asks for the same one before its fit and after it, which takes 0.03 s."""
    return LIFT_METHODS[method](CamTable(np.frombuffer(theta), np.frombuffer(lift), resolution))

"""A lift law for torque: periodic smoothing whose amount the table itself decides.

`smoothing_law` takes the largest smoothing that the table's error allows, which is right for acceleration and Hertz
stress and rounds the ends of the dwells by a few micrometres. For torque the slope counts, and generalised
cross-validation (Golub, Heath & Wahba 1979) leaves less bias. On a uniform periodic table a smoothing spline of order
m is the filter ``1 / (1 + (k/k_c)^(2m))`` on its harmonics, so the choice is a search over one number.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.smoothing import smoothing_law, table_error
from camtorque.records import Array, CamTable
from camtorque.units import TURN

ORDER = 4
LEAST_CORNER = 8.0
"""Lowest corner harmonic that is tried: a table of three times as many points, or fewer, leaves nothing to choose."""
PIECES_PER_HARMONIC = 8


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
    return CamLaw(knots, _quintic_pieces(TURN / n, *derivatives), table_error(table))


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

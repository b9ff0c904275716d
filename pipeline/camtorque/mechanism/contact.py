"""Hertz line contact of cam and roller, and the speed at which the follower leaves the cam."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.config import PumpData
from camtorque.records import Array, Mask

ROUNDING = 1.0e-12
"""Share of the largest force below which one is none."""
SHEAR_VALUE = 0.300
"""Greatest shear stress below a line contact over p0 (Johnson, Contact Mechanics, 1985, Section 4.2)."""
SHEAR_DEPTH = 0.786
"""Its depth over the half width b (same place)."""


def contact_modulus(pump: PumpData) -> float:
    """Return E* with 1/E* = (1 - nu^2) (1/E_cam + 1/E_roller) [Pa]."""
    compliance = (1.0 - pump.poisson_ratio**2) * (1.0 / pump.youngs_modulus_cam + 1.0 / pump.youngs_modulus_roller)
    return 1.0 / compliance


def hertz_factor(pump: PumpData, relative_radius: Array) -> Array:
    """Return h in p0 = h sqrt(F_n), h = sqrt(E* / (pi B R)) [Pa / sqrt(N)]; nan where the cam is undercut."""
    radius = np.where(relative_radius > 0.0, relative_radius, np.nan)
    return np.sqrt(contact_modulus(pump) / (np.pi * pump.roller_width * radius))


def hertz_pressure(factor: Array, normal_force: Array) -> Array:
    """Return the greatest contact pressure p0 [Pa], 0 where there is no contact."""
    return factor * np.sqrt(np.maximum(normal_force, 0.0))


def half_width(pump: PumpData, hertz: Array, relative_radius: Array) -> Array:
    """Return the half width of the contact, b = 2 p0 R / E* [m]."""
    return 2.0 * hertz * relative_radius / contact_modulus(pump)


def pulls(force: Array) -> Mask:
    """Return where a force on the follower would have to pull it; one that only rests on its cam has none."""
    return np.asarray(force < -ROUNDING * np.max(np.abs(force), initial=0.0))


@dataclass(frozen=True)
class ContactLoss:
    """Where and how fast the follower jumps: lowest such speed [rad/s] and its cam angle [rad]; inf, nan for never."""

    speed: float
    theta: float


def jump_speed(theta: Array, force_at_rest: Array, force_per_speed_squared: Array) -> ContactLoss:
    """Return the lowest constant speed at which the contact force vanishes, and where.

    Parameters
    ----------
    force_at_rest : (n_theta,) contact normal force at standstill: preload, spring, pressure, gravity [N]
    force_per_speed_squared : (n_theta,) its inertia part [N s^2/rad^2]

    Notes
    -----
    F = F_0 + F_2 omega^2 <= 0, per angle omega^2 = -F_0 / F_2 where F_2 < 0; a negative force at rest means speed 0.
    """
    # below a billionth of the greatest inertia the force could not vanish at any realistic speed
    least = 1e-9 * np.max(np.abs(force_per_speed_squared), initial=1e-21)
    pulled = force_per_speed_squared < -least
    squared = np.maximum(force_at_rest, 0.0) / np.where(pulled, -force_per_speed_squared, least)
    squared = np.where(pulled, squared, np.inf)
    squared = np.where(pulls(force_at_rest), 0.0, squared)
    lowest = int(np.argmin(squared))
    if not np.isfinite(squared[lowest]):
        return ContactLoss(float("inf"), float("nan"))
    return ContactLoss(float(np.sqrt(squared[lowest])), float(theta[lowest]))

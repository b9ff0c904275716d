"""The compiled laws of the rig: lift, liquid, orifice. Scalars in, scalars out."""

from __future__ import annotations

import numpy as np

from rigs.jit import compiled

TWO_PI = 2.0 * np.pi


@compiled
def _unit_flank(profile, x):
    """Return f, f', f'' of a flank from (0, 0) to (1, 1) with dwell at both ends."""
    if profile == 0:  # 4-5-6-7 polynomial
        x2 = x * x
        x3 = x2 * x
        f = x2 * x2 * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x)))
        omx = 1.0 - x
        return f, 140.0 * x3 * omx * omx * omx, 420.0 * x2 * omx * omx * (1.0 - 2.0 * x)
    if profile == 1:  # modified sine
        c = 1.0 / (4.0 + np.pi)
        if x < 0.125 or x > 0.875:
            z = 4.0 * np.pi * x
            shift = 0.0 if x < 0.125 else 4.0 * c
            return (
                c * (np.pi * x - 0.25 * np.sin(z)) + shift,
                c * np.pi * (1.0 - np.cos(z)),
                4.0 * c * np.pi**2 * np.sin(z),
            )
        z = 4.0 * np.pi * x / 3.0 + np.pi / 3.0
        return (
            c * (2.0 + np.pi * x - 2.25 * np.sin(z)),
            c * np.pi * (1.0 - 3.0 * np.cos(z)),
            4.0 * c * np.pi**2 * np.sin(z),
        )
    z = TWO_PI * x  # cycloidal
    return x - np.sin(z) / TWO_PI, 1.0 - np.cos(z), TWO_PI * np.sin(z)


@compiled
def _flank(profile, skew, angle, width, height):
    """Return lift and derivatives with respect to angle of a skewed rising flank."""
    x = angle / width
    if skew == 1.0:
        f, f1, f2 = _unit_flank(profile, x)
        return height * f, height * f1 / width, height * f2 / (width * width)
    rest = 1.0 - x
    if rest < 1e-12:
        return height, 0.0, 0.0
    power = rest ** (skew - 1.0)
    g1 = skew * power
    g2 = -skew * (skew - 1.0) * power / rest
    f, f1, f2 = _unit_flank(profile, 1.0 - power * rest)
    return height * f, height * f1 * g1 / width, height * (f2 * g1 * g1 + f1 * g2) / (width * width)


@compiled
def lift_law(k, theta):
    """Return y, y', y'' at cam angle theta in [0, 2 pi)."""
    x = theta - k.rise_start
    if x <= 0.0:
        return 0.0, 0.0, 0.0
    if x < k.rise_angle:
        return _flank(k.rise_profile, k.rise_skew, x, k.rise_angle, k.lift)
    x -= k.rise_angle
    if x <= k.dwell_angle:
        return k.lift, 0.0, 0.0
    x -= k.dwell_angle
    if x < k.fall_angle:
        y, y1, y2 = _flank(k.fall_profile, k.fall_skew, x, k.fall_angle, k.lift)
        return k.lift - y, -y1, -y2
    return 0.0, 0.0, 0.0


@compiled
def density_of(k, pressure):
    """Liquid density from dp/drho * rho = modulus + slope p."""
    return k.density * (1.0 + k.slope * pressure / k.modulus) ** (1.0 / k.slope)


@compiled
def pressure_of(k, density):
    """Inverse of `density_of`, not below the cavitation floor."""
    if density <= k.floor_density:
        return k.floor
    return k.modulus / k.slope * ((density / k.density) ** k.slope - 1.0)


@compiled
def enthalpy_of(k, pressure, density):
    """Integral of dp/rho from zero gauge pressure [J/kg]."""
    u = 1.0 + k.slope * pressure / k.modulus
    return k.modulus / ((k.slope - 1.0) * k.density) * (u * k.density / density - 1.0)


@compiled
def orifice(effective_area, pressure_drop, density, laminar):
    """Signed orifice flow [m^3/s], linear below about ``laminar``: A sqrt(2/rho) dp / (dp^2 + laminar^2)^(1/4)."""
    root = np.sqrt(np.sqrt(pressure_drop * pressure_drop + laminar * laminar))
    return effective_area * np.sqrt(2.0 / density) * pressure_drop / root


@compiled
def ramp(x):
    """0 below 0, 1 above 1, linear between."""
    if x <= 0.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    return x

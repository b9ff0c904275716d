"""Fluid: how much room the fuel takes at a pressure, with free air and down to vapour.

Specific volume over that of the liquid at zero gauge pressure::

    v(p) = (1 + b p / beta_0)**(-1/b) + alpha (p_a / (p + p_a))**(1/1.2) + vapour(p)

The bulk modulus of the liquid is ``beta_0 + b p``; alpha is the share of air that is not dissolved, at atmospheric
pressure, compressed polytropically. The vapour term is negligible above a tenth of a bar absolute and grows by a
factor e for each tenth below, so that mass is kept through cavitation and the pressure stays near zero absolute.

Sources: Payri et al., Fuel 90 (2011): 1.25-1.33 GPa for diesel at 40 degrees, slope about 10; Nikolic, Thermal Science
16 (2012); other fluids and temperatures 1.1-1.7 GPa.
"""

from __future__ import annotations

import numpy as np

from camtorque import units
from camtorque.compiled import njit
from camtorque.laws.rows import parameter

AIR_EXPONENT = 1.0 / 1.2
ATMOSPHERE = units.ATMOSPHERE / units.BAR
"""[bar]"""
VAPOUR_SHARE = 0.01
VAPOUR_SCALE = 0.1
"""Vapour takes `VAPOUR_SHARE` of the liquid's room at `VAPOUR_SCALE` bar absolute, e times more per scale below."""
LEAST_AIR_PRESSURE = 0.05
"""Absolute pressure below which the air stops expanding; the vapour has taken over [bar]."""

ROWS = (
    parameter("bulk_modulus", "beta_0", "GPa", 1.0e9, (1.40, 0.6, 2.4, 0.05), (1.40, 0.20),
            "bulk modulus of the fuel at feed pressure", "fuels and test oils over 20-100 degrees: 1.0-1.8 GPa"),
    parameter("bulk_modulus_slope", "b", "-", 1.0, (9.0, 4.0, 15.0, 0.5), (9.0, 2.0),
            "increase of the bulk modulus with pressure", "Payri, Fuel 2011; Nikolic, Thermal Science 2012: 8-12"),
    parameter("free_air", "alpha", "%", 0.01, (0.02, 0.0, 2.0, 0.05), (0.0, 0.40),
            "share of air that is not dissolved, at atmospheric pressure", "gear pumps feed 0-1 %"),
)  # fmt: skip


@njit(cache=True, error_model="numpy", inline="always")
def specific_volume(pressure, modulus, slope, air):  # type: ignore[no-untyped-def]
    """Return v and its derivatives by pressure, modulus, slope and air; gauge pressure and modulus in bar."""
    ratio = 1.0 + slope * pressure / modulus
    if ratio < 0.5:
        ratio = 0.5
    liquid = np.exp(-np.log(ratio) / slope)
    stiff = modulus + slope * pressure
    absolute = pressure + ATMOSPHERE
    root = np.sqrt(absolute * absolute + LEAST_AIR_PRESSURE * LEAST_AIR_PRESSURE)
    smooth = 0.5 * (absolute + root)
    compressed = np.exp(-AIR_EXPONENT * np.log(smooth / ATMOSPHERE))
    by_pressure = -liquid / stiff - air * compressed * AIR_EXPONENT / root
    volume = liquid + air * compressed
    if absolute < 3.0:
        vapour = VAPOUR_SHARE * np.exp(-(absolute - VAPOUR_SCALE) / VAPOUR_SCALE)
        volume += vapour
        by_pressure -= vapour / VAPOUR_SCALE
    by_modulus = liquid * pressure / (modulus * stiff)
    by_slope = liquid * (np.log(ratio) / (slope * slope) - pressure / (slope * stiff))
    return volume, by_pressure, by_modulus, by_slope, compressed

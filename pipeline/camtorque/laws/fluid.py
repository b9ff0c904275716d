"""Fluid: how much room the fuel takes at a pressure, with free air and down to vapour.

Specific volume over that of the liquid at zero gauge pressure::

    v(p) = (1 + b p / beta_0)**(-1/b) + alpha (p_a / (p + p_a))**(1/1.2) + vapour(p)

The bulk modulus of the liquid is ``beta_0 + b p``; alpha is the share of air that is not dissolved, at atmospheric
pressure, compressed polytropically. The vapour term is negligible above a tenth of a bar absolute and grows by a
factor e for each tenth below, so that mass is kept through cavitation and the pressure stays near zero absolute.

Sources: Payri et al., Fuel 90 (2011): 1.25-1.33 GPa for diesel at 40 degrees, slope about 10; Nikolic, Thermal Science
16 (2012); other fluids and temperatures 1.1-1.7 GPa.

What temperature and name of the fuel tell beforehand. Modulus: -8 MPa per kelvin at 40 degrees, from the equations of
state of n-dodecane and n-decane between 20 and 60 degrees (Lemmon & Huber, Energy Fuels 18 (2004): 8.1 and 7.6 MPa/K),
the same for heavier fuels of larger modulus, and exponential beyond. Viscosity: the straight line of Ubbelohde and
Walther (ASTM D341) through 2.6 mm^2/s at 40 and 1.1 mm^2/s at 100 degrees, as ISO 4113 test oil and diesel have it;
only its ratio to 40 degrees is used: a pump for a thin fuel has a tighter gap.
"""

from __future__ import annotations

import math
import re

import numpy as np

from camtorque import units
from camtorque.compiled import njit
from camtorque.config import FluidSpec, quantities
from camtorque.laws.rows import parameter
from camtorque.records import CamCycles

AIR_EXPONENT = 1.0 / 1.2
ATMOSPHERE = units.ATMOSPHERE / units.BAR
"""[bar]"""
VAPOUR_SHARE = 0.01
VAPOUR_SCALE = 0.1
"""Vapour takes `VAPOUR_SHARE` of the liquid's room at `VAPOUR_SCALE` bar absolute, e times more per scale below."""
LEAST_AIR_PRESSURE = 0.05
"""Absolute pressure below which the air stops expanding; the vapour has taken over [bar]."""
REFERENCE = 313.15
"""40 degrees Celsius, at which sheets of fuels state their figures [K]."""
MODULUS_PER_KELVIN = -8.0e6
"""At 40 degrees [Pa/K]."""
UNKNOWN_WARMTH = 15.0
"""Standard uncertainty of a temperature that nobody states, about 40 degrees [K]."""
WARMTH_STD = 3.0
"""How far the fuel in the chamber is from the inlet [K]."""
MINOR = re.compile(
    r"\w+-free\b|\bfree of \w+|\b(no|non|without)[- ]\w+"
    r"|(?<![\d.,])(?![34]\d([.,]\d+)?\s?%\s(of\s)?gly[ck]ol)[1-4]?\d([.,]\d+)?\s?%\s(of\s)?\w+"
    r"|\b(?!gly[ck]ol\s[34]\d)\w+\s[1-4]?\d([.,]\d+)?\s?%\s*(?=$|[,;)])",
    re.IGNORECASE,
)
"""What a name says is not in a fuel, or less than half of it; a third of glycol makes its water as stiff as more."""
HEAVY = "heavy fuel"
KINDS: dict[str, tuple[float, float, str]] = {
    "dimethyl ether": (0.50e9, 0.08e9, r"dimethyl.?ether|\bdme\b"),
    "biodiesel": (1.55e9, 0.12e9, r"bio.?diesel|methyl.?ester|\b(fame|rme|sme|b100)\b|en.?14214"),
    "gasoline": (1.00e9, 0.12e9, r"gasoline|petrol(?!eum)|benzin|\botto|en.?228|\be(5|10|20)\b"),
    "alcohol": (0.89e9, 0.08e9, r"methanol|ethanol|alcohol|\b(e85|e100|m85|m100)\b"),
    "kerosene": (1.21e9, 0.09e9, r"kerosene|kerosin|\bjet.?a(.?1)?\b|avtur|\bjp.?[58]\b"),
    HEAVY: (2.05e9, 0.20e9,
                 r"heavy.?fuel|\b(hfo|ifo|vlsfo|bunker)|residual.(fuel|oil)|\brm[a-k].?\d|schwer(ö|oe)l"),
    "marine distillate": (1.47e9, 0.13e9, r"marine|\b(mgo|mdo|dm[abxz])\b"),
    "paraffinic diesel": (1.25e9, 0.09e9, r"\b(hvo|gtl)|paraffinic|en.?15940"),
    "urea solution": (2.70e9, 0.20e9, r"urea|adblue|\baus.?32"),
    "glycol in water": (2.90e9, 0.25e9, r"(?<!poly)(?<!alkylene )(?<!alkylene)gly[ck]ol(?!.?ether)"),
    "diesel": (1.33e9, 0.10e9,
               r"diesel|gas.?oil|gasöl|iso.?4113|en.?590|test.?oil|calibration|normafluid|prüföl"),
    "water": (2.30e9, 0.20e9, r"\bwater\b|\bwasser\b|emulsion"),
}  # fmt: skip
"""Kind of fuel -> bulk modulus at 40 degrees and feed pressure, its spread over makes [Pa], and the names by which it
goes; the first that is found holds.
Methyl esters: 1350 m/s and 865 kg/m^3 (Tat & Van Gerpen, J. Am. Oil Chem. Soc. 77 (2000)) give 1.57. Diesel: Payri,
Fuel 90 (2011), 1.25-1.33; 1330 m/s and 820 kg/m^3 give 1.45 for a dense one. Dimethyl ether: 0.64 at 20 degrees
(Arcoumanis et al., Fuel 87 (2008), table 1). The others by sound and density, m/s and kg/m^3: gasoline 1150,
735; methanol 1050, 772; ethanol 1095, 773; kerosene 1240, 785; heavy fuel 1460, 965; marine distillate 1320, 845;
paraffinic 1275, 765; urea solution 1600, 1080; 40 to 60 % glycol 1640 to 1680, 1040 to 1070; water 1530, 992."""
ANY_MODULUS = (1.35e9, 0.18e9)
"""Fuels and test oils of any kind, gasoline among them: 1.0-1.7 GPa [Pa]."""
ANY_LIQUID = (1.40e9, 0.40e9)
"""Of a liquid whose name tells nothing: it may be a brand of test oil, and may be no fuel at all [Pa]."""
VISCOSITIES = ((313.15, 2.6), (373.15, 1.1))
"""Temperature [K] and kinematic viscosity [mm^2/s]."""

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


def fuel_temperature(fluid: FluidSpec, cycles: CamCycles) -> float | None:
    """Return the temperature of the fuel as measured, else as stated, None where unknown [K]."""
    if "fuel_temperature" in cycles.channels:
        measured = cycles.channels["fuel_temperature"]
        low, high = (units.ZERO_CELSIUS + end for end in quantities.LIQUID_C)
        liquid = measured[(measured >= low) & (measured <= high)]
        if liquid.size:
            return float(np.mean(liquid))
    return fluid.temperature


def kind_of(name: str) -> str | None:
    """Return the kind in `KINDS` that a fuel's name tells, None for none; what it holds little of does not count."""
    main = MINOR.sub(" ", name)
    return next((kind for kind, (*_, names) in KINDS.items() if re.search(names, main, re.IGNORECASE)), None)


def modulus_prior(name: str, temperature: float | None) -> tuple[float, float, str] | None:
    """Return mean and spread of the bulk modulus beforehand [Pa], and what they are drawn from.

    None where neither name nor temperature is stated; the modulus is that at feed pressure.

    Parameters
    ----------
    name : of the fuel; ``temperature`` : [K]
    """
    if not name and temperature is None:
        return None
    kind = kind_of(name)
    mean, spread = KINDS[kind][:2] if kind else ANY_LIQUID if name else ANY_MODULUS
    warm = REFERENCE if temperature is None else temperature
    unsure = UNKNOWN_WARMTH if temperature is None else WARMTH_STD
    softer = math.exp(MODULUS_PER_KELVIN / mean * (warm - REFERENCE))
    std = softer * math.hypot(spread, MODULUS_PER_KELVIN * unsure)
    text = name if kind else f"{name}, of which nothing is known," if name else "fuels and test oils"
    text += f" at {warm - units.ZERO_CELSIUS:.0f} degC"
    if temperature is None:
        text += f" +- {UNKNOWN_WARMTH:g} K, none is stated"
    return softer * mean, std, text


def viscosity_ratio(temperature: float) -> float:
    """Return the viscosity of a diesel-like fuel over that at 40 degrees; ``temperature`` in kelvin."""
    (cold, thick), (hot, thin) = VISCOSITIES
    ends = [math.log10(math.log10(value + 0.7)) for value in (thick, thin)]
    steep = (ends[0] - ends[1]) / math.log10(hot / cold)
    line = ends[0] - steep * math.log10(temperature / cold)
    return (10.0 ** (10.0**line) - 0.7) / thick


def shares_per_kelvin() -> tuple[float, float]:
    """Return by which share viscosity and bulk modulus of any fuel change per kelvin about 40 degrees [1/K]."""
    thinner = math.log(viscosity_ratio(REFERENCE + 0.5) / viscosity_ratio(REFERENCE - 0.5))
    return thinner, MODULUS_PER_KELVIN / ANY_MODULUS[0]

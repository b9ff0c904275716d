"""Conversions at the border. Inside, everything is SI and radians; signs and zeros: docs/rig.md."""

from __future__ import annotations

import difflib
import re

import numpy as np

from camtorque.records import Refusal

BAR = 1.0e5
"""Pascal per bar."""
RPM = 2.0 * np.pi / 60.0
"""Radian per second per revolution per minute."""
DEGREE = np.pi / 180.0
"""Radian per degree."""
STEEL_DENSITY = 7850.0
"""Density of bearing steel 100Cr6 [kg/m^3] (EN ISO 683-17 sheets: 7800 to 7850)."""
ATMOSPHERE = 101_325.0
"""Standard atmosphere [Pa], taken off the reading of an absolute sensor."""
POUND_FORCE = 4.448_221_615_260_5
"""Newton per pound-force (exact)."""
INCH = 0.0254
"""Metre per inch (exact)."""

BORDER_UNITS: dict[str, tuple[str, float]] = {
    "V": ("voltage", 1.0),
    "mV": ("voltage", 1.0e-3),
    "uV": ("voltage", 1.0e-6),
    "kV": ("voltage", 1.0e3),
    "mV/V": ("bridge output", 1.0),
    "uV/V": ("bridge output", 1.0e-3),
    "V/V": ("bridge output", 1.0e3),
    "Pa": ("pressure", 1.0),
    "kPa": ("pressure", 1.0e3),
    "MPa": ("pressure", 1.0e6),
    "GPa": ("pressure", 1.0e9),
    "hPa": ("pressure", 1.0e2),
    "bar": ("pressure", BAR),
    "mbar": ("pressure", 1.0e-3 * BAR),
    "psi": ("pressure", POUND_FORCE / INCH**2),
    "N/mm2": ("pressure", 1.0e6),
    "atm": ("pressure", ATMOSPHERE),
    "N m": ("torque", 1.0),
    "kN m": ("torque", 1.0e3),
    "mN m": ("torque", 1.0e-3),
    "N cm": ("torque", 1.0e-2),
    "N mm": ("torque", 1.0e-3),
    "lbf in": ("torque", POUND_FORCE * INCH),
    "lbf ft": ("torque", POUND_FORCE * 12.0 * INCH),
    "s": ("time", 1.0),
    "ms": ("time", 1.0e-3),
    "us": ("time", 1.0e-6),
    "ns": ("time", 1.0e-9),
    "min": ("time", 60.0),
    "h": ("time", 3600.0),
    "m": ("length", 1.0),
    "mm": ("length", 1.0e-3),
    "um": ("length", 1.0e-6),
    "nm": ("length", 1.0e-9),
    "in": ("length", INCH),
    "rad": ("angle", 1.0),
    "deg": ("angle", DEGREE),
    "rev": ("angle", 2.0 * np.pi),
    "K": ("temperature", 1.0),
    "degC": ("temperature", 1.0),
    "degF": ("temperature", 5.0 / 9.0),
    "rad/s": ("speed", 1.0),
    "rpm": ("speed", RPM),
    "deg/s": ("speed", DEGREE),
    "m3": ("volume", 1.0),
    "l": ("volume", 1.0e-3),
    "ml": ("volume", 1.0e-6),
    "cm3": ("volume", 1.0e-6),
    "ul": ("volume", 1.0e-9),
    "mm3": ("volume", 1.0e-9),
    "logic": ("level", 1.0),
    "Hz": ("frequency", 1.0),
    "kHz": ("frequency", 1.0e3),
    "MHz": ("frequency", 1.0e6),
}
"""Unit at the border -> (dimension, factor to SI; the output of a bridge over its supply counts in mV/V)."""

UNIT_OFFSETS: dict[str, float] = {"degC": 273.15, "degF": 459.67 * 5.0 / 9.0}
"""Units whose zero is not that of SI -> what is added after the factor."""

SPELLINGS: dict[str, str] = {
    "°C": "degC",
    "deg C": "degC",
    "Celsius": "degC",
    "°F": "degF",
    "1/min": "rpm",
    "min-1": "rpm",
    "U/min": "rpm",
    "r/min": "rpm",
    "mm^3": "mm3",
    "mm³": "mm3",
    "cm^3": "cm3",
    "cm³": "cm3",
    "cc": "cm3",
    "m³": "m3",
    "ft lb": "lbf ft",
    "lb ft": "lbf ft",
    "ft-lb": "lbf ft",
    "lb-ft": "lbf ft",
    "ft-lbs": "lbf ft",
    "ft lbs": "lbf ft",
    "ft-lbf": "lbf ft",
    "in lb": "lbf in",
    "in-lb": "lbf in",
    "lb-in": "lbf in",
    "in-lbs": "lbf in",
    "in lbs": "lbf in",
    "in-lbf": "lbf in",
    "Nm": "N m",
    "NM": "N m",
    "N-m": "N m",
    "Newton-meter": "N m",
    "Newton-meters": "N m",
    "N*m": "N m",
    "N.m": "N m",
    "kNm": "kN m",
    "mNm": "mN m",
    "Ncm": "N cm",
    "Nmm": "N mm",
    "lbf.in": "lbf in",
    "lbf*in": "lbf in",
    "in lbf": "lbf in",
    "lbf.ft": "lbf ft",
    "lbf*ft": "lbf ft",
    "ft lbf": "lbf ft",
    "N/mm^2": "N/mm2",
    "N/mm²": "N/mm2",
    "Volt": "V",
    "volt": "V",
    "Volts": "V",
    "volts": "V",
    "VDC": "V",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "Sekunden": "s",
    "msec": "ms",
    "usec": "us",
    "PSI": "psi",
    "psig": "psi",
    "psi g": "psi",
    "barg": "bar",
    "bar g": "bar",
    "Bar": "bar",
    "BAR": "bar",
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "Grad": "deg",
    "radians": "rad",
    "degCA": "deg",
    "deg CA": "deg",
    "°CA": "deg",
    "° CA": "deg",
    "°KW": "deg",
    "° KW": "deg",
    "degKW": "deg",
    "inch": "in",
    "inches": "in",
    '"': "in",
}
"""Other spellings that mean one thing only."""
ABSOLUTE = re.compile(r"^(?P<unit>[A-Za-z]+?)[ _]?\(?a(bs(olut(e)?)?)?\)?$")
"""bara, bar abs, psia, kPa(a): a pressure that counts from vacuum."""
COUNTS = re.compile(r"^rev/(?P<number>[1-9]\d{0,6})$")
"""rev/1024: a counter of so many counts a revolution."""


def tidy_unit(unit: str) -> str:
    """Return the one spelling of a unit: blanks, brackets and the two micro signs smoothed."""
    text = unit.strip().strip("[]()").replace("µ", "u").replace("μ", "u").replace("·", " ").replace("⋅", " ")
    text = " ".join(text.split())
    return SPELLINGS.get(text, text)


def is_known_unit(unit: str) -> bool:
    """Tell whether a unit is in the border table."""
    return tidy_unit(unit) in BORDER_UNITS


def unit_factor(unit: str, dimension: str, where: str, *also: str) -> float:
    """Return the factor from a border unit to SI; ``also`` are further dimensions that may be written there.

    Raises
    ------
    Refusal
        when the unit is unknown or of another dimension; a unit is never guessed
    """
    tidy = tidy_unit(unit)
    kinds = (dimension, *also)
    counts = COUNTS.match(tidy)
    if counts and "angle" in kinds:
        return 2.0 * np.pi / float(counts["number"])
    known = [name for name, (kind, _) in BORDER_UNITS.items() if kind in kinds]
    expected = " or ".join(f"{kind} unit" for kind in dict.fromkeys(kinds))
    if tidy not in BORDER_UNITS:
        raise Refusal(
            f"{where}: unknown unit {unit!r}{_absolute_hint(tidy) or did_you_mean(tidy, known)}; a {expected} is "
            f"expected ({', '.join(known)}{', rev/1024 for a counter' if dimension == 'angle' else ''})"
        )
    kind, factor = BORDER_UNITS[tidy]
    if kind not in kinds:
        raise Refusal(f"{where}: unit {unit!r} is a {kind}, expected a {expected} ({', '.join(known)})")
    return factor


def short(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, written out between 1e-4 and a million."""
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        return f"{value:.0f}" if abs(value) >= 1.0 else f"{value:.{digits + 3}f}"
    return text


def absolute_unit(unit: str) -> str:
    """Return the unit of a pressure that is written as absolute (bar for bara), "" for any other."""
    match = ABSOLUTE.match(unit.strip().strip("[]"))
    base = tidy_unit(match["unit"]) if match else ""
    return base if BORDER_UNITS.get(base, ("", 1.0))[0] == "pressure" and not is_known_unit(unit) else ""


def _absolute_hint(unit: str) -> str:
    base = absolute_unit(unit)
    return f', write {base!r} and reference = "absolute" in its [sensors] table' if base else ""


def did_you_mean(word: str, known: list[str] | tuple[str, ...]) -> str:
    """Return ", did you mean 'x'?" for the nearest known word, or an empty string."""
    lowered = {name.lower(): name for name in known}
    near = difflib.get_close_matches(word.lower(), list(lowered), n=1, cutoff=0.5)
    return f", did you mean {lowered[near[0]]!r}?" if near else ""


def expected_one_of(word: str, known: list[str] | tuple[str, ...]) -> str:
    """Return the nearest known word as a question, or all of them where none is near."""
    return did_you_mean(word, known) or f", expected one of {', '.join(known)}"

"""Conversions at the border. Inside, everything is SI and radians; signs and zeros: docs/rig.md."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence

import numpy as np

from camtorque.records import Array, Refusal

DECIMAL = r"(?:\d{1,15}(?:\.\d{0,15})?|\.\d{1,15})"
"""A number without sign and exponent in a text that a user types."""
MAYBE_ALIKE, SURELY_ALIKE = 0.5, 0.7
"""Likeness (0 to 1) of a word and a name from which one may be meant by the other, and from which it needs no more:
what begins alike or holds the other is a slip below it, 'operator' for 'rotation' is none."""
BAR = 1.0e5
"""Pascal per bar."""
TURN = 2.0 * np.pi
"""Radian per turn."""
RPM = TURN / 60.0
"""Radian per second per revolution per minute."""
DEGREE = np.pi / 180.0
"""Radian per degree."""
COVERAGE = 1.959964
"""Standard uncertainties to either side that an interval of 95 % holds."""
STEEL_DENSITY = 7850.0
"""Density of bearing steel 100Cr6 [kg/m^3] (EN ISO 683-17 sheets: 7800 to 7850)."""
ATMOSPHERE = 101_325.0
"""Standard atmosphere [Pa], taken off the reading of an absolute sensor."""
ZERO_CELSIUS = 273.15
"""Kelvin at 0 degrees Celsius."""
POUND_FORCE = 4.448_221_615_260_5
"""Newton per pound-force (exact)."""
INCH = 0.0254
"""Metre per inch (exact)."""
KILOPOND = 9.80665
"""Newton per kilogram-force (exact)."""
HOUR, DAY = 3600.0, 86_400.0
"""Seconds per hour and per day."""
FARTHEST_ZONE, STARTED_WITHIN = 14, 60.0
"""Most hours that a time zone is from UTC; time within which the loggers of one run are started by hand [s]."""

UNITS: dict[str, dict[str, float]] = {
    "voltage": {"V": 1.0, "mV": 1.0e-3, "uV": 1.0e-6, "kV": 1.0e3},
    "bridge output": {"mV/V": 1.0, "uV/V": 1.0e-3, "V/V": 1.0e3},
    "pressure": {"Pa": 1.0, "kPa": 1.0e3, "MPa": 1.0e6, "GPa": 1.0e9, "hPa": 1.0e2, "bar": BAR, "mbar": 1.0e-3 * BAR,
                 "kbar": 1.0e3 * BAR, "psi": POUND_FORCE / INCH**2, "ksi": 1.0e3 * POUND_FORCE / INCH**2,
                 "N/mm2": 1.0e6, "atm": ATMOSPHERE, "kgf/cm2": 1.0e4 * KILOPOND},
    "torque": {"N m": 1.0, "kN m": 1.0e3, "daN m": 10.0, "mN m": 1.0e-3, "N cm": 1.0e-2, "N mm": 1.0e-3,
               "lbf in": POUND_FORCE * INCH, "lbf ft": POUND_FORCE * 12.0 * INCH,
               "ozf in": POUND_FORCE / 16.0 * INCH, "kgf m": KILOPOND, "kgf cm": 1.0e-2 * KILOPOND},
    "time": {"s": 1.0, "ms": 1.0e-3, "us": 1.0e-6, "ns": 1.0e-9, "min": 60.0, "h": 3600.0},
    "length": {"m": 1.0, "mm": 1.0e-3, "um": 1.0e-6, "nm": 1.0e-9, "in": INCH},
    "angle": {"rad": 1.0, "deg": DEGREE, "rev": TURN},
    "temperature": {"K": 1.0, "degC": 1.0, "degF": 5.0 / 9.0},
    "speed": {"rad/s": 1.0, "rpm": RPM, "deg/s": DEGREE},
    "volume": {"m3": 1.0, "l": 1.0e-3, "ml": 1.0e-6, "cm3": 1.0e-6, "ul": 1.0e-9, "mm3": 1.0e-9},
    "level": {"logic": 1.0},
    "frequency": {"Hz": 1.0, "kHz": 1.0e3, "MHz": 1.0e6},
}  # fmt: skip
"""Dimension -> unit at the border -> factor to SI; the output of a bridge over its supply counts in mV/V."""
BORDER_UNITS = {unit: (kind, factor) for kind, units in UNITS.items() for unit, factor in units.items()}
"""Unit at the border -> dimension, factor to SI."""

UNIT_OFFSETS: dict[str, float] = {"degC": ZERO_CELSIUS, "degF": 459.67 * 5.0 / 9.0}
"""Units whose zero is not that of SI -> what is added after the factor."""

SPELLINGS: dict[str, str] = {spelling: unit for unit, spellings in {
    "degC": ("°C", "deg C", "Celsius"), "degF": ("°F",), "rpm": ("1/min", "min-1", "U/min", "r/min"),
    "mm3": ("mm^3", "mm³", "mm3/stroke", "mm³/stroke", "mm^3/stroke"), "cm3": ("cm^3", "cm³", "cc"), "m3": ("m³",),
    "lbf ft": ("ft lb", "lb ft", "ft-lb", "lb-ft", "ft-lbs", "ft lbs", "ft-lbf", "lbf.ft", "lbf*ft", "ft lbf",
               "ft.lbf", "ft.lb", "lb.ft", "lbf-ft"),
    "lbf in": ("in lb", "in-lb", "lb-in", "in-lbs", "in lbs", "in-lbf", "lbf.in", "lbf*in", "in lbf", "in.lbf",
               "in.lb", "lb.in", "lbf-in"),
    "ozf in": ("in oz", "in-oz", "oz in", "oz-in", "ozf.in", "ozf*in"),
    "kgf/cm2": ("kgf/cm^2", "kgf/cm²", "kg/cm2", "kg/cm^2", "kg/cm²", "kp/cm2", "kp/cm²"),
    "kgf m": ("kgfm", "kgf.m", "kgf*m", "kp m", "kpm"), "kgf cm": ("kgfcm", "kgf.cm", "kgf*cm", "kp cm"),
    "N m": ("Nm", "NM", "N-m", "Newton-meter", "Newton-meters", "Newton meter", "Newton meters", "N*m", "N.m"),
    "kN m": ("kNm", "kN.m", "kN*m", "kN-m"), "daN m": ("daNm",), "mN m": ("mNm", "mN.m", "mN*m", "mN-m"),
    "N cm": ("Ncm",), "N mm": ("Nmm",), "N/mm2": ("N/mm^2", "N/mm²"), "V": ("Volt", "volt", "Volts", "volts", "VDC"),
    "s": ("S", "SEC", "sec", "second", "seconds", "Sec", "Second", "Seconds", "Sekunde", "Sekunden"),
    "ms": ("MS", "MSEC", "msec"), "us": ("usec",), "psi": ("PSI",),
    "ksi": ("kpsi", "KSI"), "bar": ("Bar", "BAR"),
    "deg": ("°", "degree", "degrees", "Grad", "degCA", "deg CA", "°CA", "° CA", "°KW", "° KW", "degKW"),
    "rad": ("radians",), "in": ("inch", "inches", '"'),
}.items() for spelling in spellings}  # fmt: skip
"""Other spellings that mean one thing only."""
GAUGE = re.compile(r"^(?P<unit>[A-Za-z]+?)[ _]?\(?(g|gauge)\)?$", re.IGNORECASE)
"""barg, bar(g), psig, kPa gauge: a pressure that counts from the atmosphere, as all do."""
ABSOLUTE = re.compile(r"^(?P<unit>[A-Za-z]+?)[ _]?\(?a(bs(olut(e)?)?)?\)?$", re.IGNORECASE)
"""bara, bar abs, psia, kPa(a): a pressure that counts from vacuum."""
LOGARITHM = re.compile(r"ln\((.*)\)")
"""Unit of a parameter that acts by its logarithm; one of 1 is no unit."""
CURRENTS, CURRENT_HINT = ("mA", "A", "uA"), ", a current: write 'V' and its sheet as if 1 mA were 1 V"
"""Units of what a current loop gives; its sheet is linear in the current as another's in the voltage."""
COUNTS = re.compile(r"^rev/(?P<number>[1-9]\d{0,6})$")
"""rev/1024: a counter with that many counts a revolution."""


def angle_grid(n: int) -> Array:
    """Return n angles of a revolution from 0, (n,) [rad]."""
    return np.asarray(np.arange(n) * (TURN / n), dtype=np.float64)


def on_grid(values: Array, n: int) -> Array:
    """Return a periodic signal (m,) on another uniform grid from the same zero, by its harmonics."""
    if values.size == n:
        return np.ascontiguousarray(values)
    return np.asarray(np.fft.irfft(np.fft.rfft(values)[: n // 2 + 1], n) * (n / values.size))


def closed(theta: Array, values: Array) -> tuple[Array, Array]:
    """Return angles (n,) [rad] and values (n,) of a revolution, the first repeated one revolution later, (n + 1,)."""
    return np.append(theta, theta[0] + TURN), np.append(values, values[0])


def tidy_unit(unit: str) -> str:
    """Return the one spelling of a unit: blanks, brackets and the two micro signs smoothed."""
    text = unit.strip().strip("[]()").replace("µ", "u").replace("μ", "u").replace("·", " ").replace("⋅", " ")
    text = " ".join(text.split())
    gauge = GAUGE.match(text)
    base = SPELLINGS.get(gauge["unit"], gauge["unit"]) if gauge else ""
    return base if base in UNITS["pressure"] else SPELLINGS.get(text, text)


def plain_unit(unit: str) -> str:
    """Return a unit of a report without typography: a user may write mm^3, mm3 or mm³, and J for J per revolution."""
    text = unit.removesuffix(" per revolution")
    for sign, plain in (("²", "2"), ("³", "3"), ("µ", "u"), ("μ", "u"), ("°", "deg"), *((sign, "") for sign in "^·* ")):
        text = text.replace(sign, plain)
    return text


def unit_kind(unit: str) -> str:
    """Return the dimension of a unit at the border, "" where it is unknown."""
    tidy = tidy_unit(unit)
    return "angle" if COUNTS.match(tidy) else BORDER_UNITS.get(tidy, ("", 1.0))[0]


def is_known_unit(unit: str) -> bool:
    """Tell whether a unit is one of the border."""
    return bool(unit_kind(unit))


def unit_factor(unit: str, dimension: str, where: str, *also: str) -> float:
    """Return the factor from a border unit to SI; ``also`` are further dimensions that may be written there.

    Raises
    ------
    Refusal : when the unit is unknown or of another dimension; a unit is never guessed
    """
    tidy = tidy_unit(unit)
    kinds = (dimension, *also)
    counts = COUNTS.match(tidy)
    if counts and "angle" in kinds:
        return TURN / float(counts["number"])
    known = [name for name, (kind, _) in BORDER_UNITS.items() if kind in kinds]
    expected = " or ".join(f"{kind} unit" for kind in dict.fromkeys(kinds))
    if tidy not in BORDER_UNITS:
        base = absolute_unit(tidy)
        hint = f', write {base!r} and reference = "absolute" in its [sensors] table' if base else ""
        hint = CURRENT_HINT if tidy in CURRENTS else hint
        raise Refusal(
            f"{where}: unknown unit {unit!r}{hint or did_you_mean(tidy, known)}; a {expected} is "
            f"expected ({', '.join(known)}{', rev/1024 for a counter' if dimension == 'angle' else ''})"
        )
    kind, factor = BORDER_UNITS[tidy]
    if kind not in kinds:
        found = f"an {kind}" if kind == "angle" else f"a {kind}"
        raise Refusal(f"{where}: unit {unit!r} is {found}, expected a {expected} ({', '.join(known)})")
    return factor


def short(value: float, digits: int = 3) -> str:
    """Return a number with ``digits`` significant digits, written out between 1e-4 and a million."""
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        return f"{value:.0f}" if abs(value) >= 1.0 else f"{value:.{digits + 3}f}"
    return text


def absolute_unit(unit: str) -> str:
    """Return the unit of a pressure that is written as absolute (bar for bara), "" for any other."""
    match = ABSOLUTE.match(unit.strip().strip("[]"))
    base = tidy_unit(match["unit"]) if match else ""
    return base if BORDER_UNITS.get(base, ("", 1.0))[0] == "pressure" and not is_known_unit(unit) else ""


def did_you_mean(word: str, known: list[str] | tuple[str, ...], ask: str = "did you mean") -> str:
    """Return ", did you mean 'x'?" for the nearest known word, or an empty string."""
    word, lowered = word.lower(), {name.lower(): name for name in known}
    near = difflib.get_close_matches(word, list(lowered), n=3, cutoff=MAYBE_ALIKE)
    for name in near:
        surely = difflib.SequenceMatcher(None, name, word).ratio() > SURELY_ALIKE
        if surely or word[:1] == name[:1] or word in name or name in word:
            return f", {ask} {lowered[name]!r}?"
    return ""


def zone_hint(apart: float) -> str:
    """Return what to look at where two logs begin whole hours apart [s], "" where they do not."""
    hours = round(apart / HOUR)
    if not 0 < hours <= FARTHEST_ZONE or abs(apart - hours * HOUR) > STARTED_WITHIN:
        return ""
    return f"; {hours} h are what two time zones differ by (a stamp that ends in Z is in UTC): export both in one"


def counted(number: int, one: str, many: str) -> str:
    """Return a number with its noun and verb, in the singular where it is one."""
    return f"{number} {one if number == 1 else many}"


def first_of(names: Sequence[str], most: int) -> str:
    """Return the first of some names, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"


def expected_one_of(word: str, known: list[str] | tuple[str, ...]) -> str:
    """Return the nearest known word as a question, or all of them where none is near."""
    return did_you_mean(word, known) or f", expected one of {', '.join(known)}"

"""Numbers, units and words as texts: significant digits, an en dash where nothing was determined, one typography."""

from __future__ import annotations

import math
import re

UNKNOWN = "\u2013"
MINUS = "\u2212"


POWERS = str.maketrans("0123456789-", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b")
SIGNS = (
    (re.compile(r"\+/?-(?=[\s\d.]|$)"), "\u00b1"),
    (re.compile(r"(?<=[A-Za-z\u00b5)])\^(-?\d+)"), lambda found: found[1].translate(POWERS)),
    (re.compile(r"(?<![A-Za-z])u(?=rad\b)|(?<=[\d)] )u(?=[ms]\b)"), "\u00b5"),
    (re.compile(r"(?<=\d )Nm\b"), "N m"),
    (re.compile(r"(?<=\d) x (?=[a-z])"), " \u00d7 "),
)


def typeset(text: str) -> str:
    """Return a sentence with the signs of print: \u00b1, \u00b5m, mm\u00b3, N m."""
    for pattern, sign in SIGNS:
        text = pattern.sub(sign, text)
    return text


def exponents(text: str) -> str:
    """Return a sentence with powers of ten in place of ``e-06``; for pages, as not every terminal has the signs."""
    return re.sub(r"(?<=\d)e([+-]?\d+)\b", lambda found: "\u00b710" + str(int(found[1])).translate(POWERS), text)


def unit_text(unit: str) -> str:
    """Return a unit with the signs of print, nothing for a pure number."""
    if unit in ("-", "1"):
        return ""
    return typeset(re.sub(r"^u(?=[ms]\b)", "\u00b5", unit))


def words(name: str) -> str:
    """Return the name of a parameter, cause or loss as words."""
    return name.split("__")[0].replace("_", " ")


def _known(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def num(value: float | None, digits: int = 3) -> str:
    """Return a number with so many significant digits."""
    if value is None or not _known(value):
        return UNKNOWN
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        text = f"{value:.0f}" if abs(value) >= 1.0 else f"{value:.{digits + 3}f}"
    return exponents(text).replace("-", MINUS)


def signed(value: float | None, digits: int = 2) -> str:
    """Return a number with its sign."""
    if value is None or not _known(value):
        return UNKNOWN
    return ("+" if value >= 0.0 else "") + num(value, digits)


def fixed(value: float | None, decimals: int = 2) -> str:
    """Return a number with so many decimals."""
    if value is None or not _known(value):
        return UNKNOWN
    text = f"{value:.{decimals}f}"
    return text.replace("-", MINUS if float(text) else "")


def scaled(value: float | None, factor: float) -> str:
    """Return a number in a smaller unit."""
    return UNKNOWN if value is None or not _known(value) else num(value * factor, 2)


def near(value: float | None, stderr: float | None) -> str:
    """Return a value with as many decimals as two digits of its standard error ask for."""
    if value is None or stderr is None or not _known(value) or not _known(stderr) or stderr <= 0.0:
        return num(value, 4)
    decimals = 1 - math.floor(math.log10(stderr))
    return fixed(round(value, decimals), max(decimals, 0)) if -3 <= decimals <= 7 else num(value, 4)


def plus_minus(stderr: float | None) -> str:
    """Return a standard error with two digits; one that is zero or unknown says nothing."""
    return UNKNOWN if stderr is None or not _known(stderr) or stderr <= 0.0 else num(stderr, 2)


FILTERS = {
    "num": num, "signed": signed, "fixed": fixed, "scaled": scaled, "near": near, "plus_minus": plus_minus,
    "unit": unit_text, "words": words, "typeset": lambda text: exponents(typeset(text)),
}  # fmt: skip
"""Name in a template -> function."""

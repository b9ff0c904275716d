"""Numbers, units and words as texts: significant digits, an en dash where nothing was determined, one typography."""

from __future__ import annotations

import math
import posixpath
import re
from collections.abc import Sequence
from typing import TypeGuard

from camtorque.laws import ROWS
from camtorque.units import short

UNKNOWN = "\u2013"
MINUS = "\u2212"


UNITS = "%|rpm|bar|GPa|deg|Hz|kHz|s|ms|min|minutes|mm|mm\u00b2|mm\u00b3|\u00b5m|N|N m|kN|J"
POWERS = str.maketrans("0123456789-", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b")
RANGE = "\\1\u2013\\2"
SIGNS = (
    (re.compile(r"\+/?-(?=[\s\d.]|$)"), "\u00b1"),
    (re.compile(r"(?<=\d) (?=10\^\d)"), " \u00d7 "),
    (re.compile(r"(?<=[\w\u00b5)])\^(-?\d+)"), lambda found: found[1].translate(POWERS)),
    (re.compile(r"(?<![A-Za-z])u(?=rad\b)|(?<=[\d)] )u(?=[ms]\b)"), "\u00b5"),
    (re.compile(r"(?<=\d )Nm\b"), "N m"),
    (re.compile(r"(?<=\d) x (?=[a-z])"), " \u00d7 "),
    (re.compile(r"(?<![\w.-])(\d+\.\d+|\d+(?=-\d+\.\d))-(\d+(?:\.\d+)?)(?![\w-]|\.\d)"), RANGE),
    (re.compile(rf"(?<![\w.-])(\d+)-(\d+)(?= (?:{UNITS}|g|kg|degrees)(?!\w))"), RANGE),
)
"""The last are ranges; whole numbers without a unit behind them (36-1) may be the name of a recording or a wheel."""

TIES = re.compile(rf"(?<=\d) (?=(?:{UNITS})(?![\w\u00b2\u00b3]))|(?<=\u00b1) |(?<=\d N) (?=m\b)")
"""Spaces between a number and its unit, and after ±."""


def typeset(text: str) -> str:
    """Return a sentence with the signs of print: \u00b1, \u00b5m, mm\u00b3, N m."""
    for pattern, sign in SIGNS:
        text = pattern.sub(sign, text)
    return text


def exponents(text: str) -> str:
    """Return a sentence with minus signs and with powers of ten in place of ``e-06``; not every terminal has them."""
    text = re.sub(r"(?:(?<=[\s(])|^)-(?=\d)", MINUS, text)
    return re.sub(r"(?<=\d)e([+-]?\d+)\b", lambda found: "\u00b710" + str(int(found[1])).translate(POWERS), text)


def no_break(text: str) -> str:
    """Return a sentence with hard spaces between numbers and units, so that no line breaks there."""
    return TIES.sub("\u00a0", text)


def unit_text(unit: str) -> str:
    """Return a unit with the signs of print, nothing for a pure number."""
    if unit in ("-", "1"):
        return ""
    return typeset(re.sub(r"^u(?=[ms]\b)", "\u00b5", unit))


def named(text: str) -> str:
    """Return a sentence with the names of parameters as words; keys of a file stay as they have to be typed."""
    return re.sub(r"[a-z]+(?:_[a-z]+)+", lambda found: words(found[0]) if found[0] in ROWS else found[0], text)


def words(name: str) -> str:
    """Return the name of a parameter, cause or loss as words."""
    return name.split("__")[0].replace("_", " ")


def in_a_row(names: Sequence[str]) -> str:
    """Return names as a sentence has them: a, b and c."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def _known(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value)


def significant(value: float | None, digits: int = 3) -> str:
    """Return a number with ``digits`` significant digits."""
    return exponents(short(value, digits)).replace("-", MINUS) if _known(value) else UNKNOWN


def signed_significant(value: float | None) -> str:
    """Return a number with its sign and two significant digits."""
    return ("+" if _known(value) and value >= 0.0 else "") + significant(value, 2)


def with_sign(value: float | None, decimals: int = 2) -> str:
    """Return a number with its sign and ``decimals`` decimals."""
    text = with_decimals(value, decimals)
    return f"+{text}" if _known(value) and value > 0.0 and float(text) else text


def with_decimals(value: float | None, decimals: int = 2) -> str:
    """Return a number with ``decimals`` decimals."""
    if not _known(value):
        return UNKNOWN
    text = f"{value:.{decimals}f}"
    return text.replace("-", MINUS if float(text) else "")


def rounded_to_error(value: float | None, stderr: float | None) -> str:
    """Return a value with the decimals that show two digits of its standard error."""
    if not _known(value) or not _known(stderr) or stderr <= 0.0:
        return significant(value, 4)
    decimals = 1 - math.floor(math.log10(stderr))
    return with_decimals(round(value, decimals), max(decimals, 0)) if -3 <= decimals <= 7 else significant(value, 4)


def plus_minus(stderr: float | None) -> str:
    """Return a standard error with two digits; one that is zero or unknown says nothing."""
    return rounded_to_error(stderr, stderr) if _known(stderr) and stderr > 0.0 else UNKNOWN


FILTERS = {
    "significant": significant, "signed_significant": signed_significant, "with_decimals": with_decimals,
    "with_sign": with_sign, "rounded_to_error": rounded_to_error, "plus_minus": plus_minus,
    "unit": unit_text, "words": words, "typeset": lambda text: exponents(typeset(named(text))), "no_break": no_break,
    "path": posixpath.normpath, "sentence": lambda text: text[:1].upper() + text[1:],
}  # fmt: skip
"""Name in a template -> function."""

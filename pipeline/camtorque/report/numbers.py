"""Numbers as texts for a page: significant digits, an en dash where nothing was determined."""

from __future__ import annotations

import math

UNKNOWN = "\u2013"
MINUS = "\u2212"


def _known(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def num(value: float | None, digits: int = 3) -> str:
    """Return a number with so many significant digits."""
    if value is None or not _known(value):
        return UNKNOWN
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        text = f"{value:.0f}" if abs(value) >= 1.0 else f"{value:.{digits + 3}f}"
    return text.replace("-", MINUS)


def signed(value: float | None, digits: int = 2) -> str:
    """Return a number with its sign."""
    if value is None or not _known(value):
        return UNKNOWN
    return ("+" if value >= 0.0 else "") + num(value, digits)


def fixed(value: float | None, decimals: int = 2) -> str:
    """Return a number with so many decimals."""
    return UNKNOWN if value is None or not _known(value) else f"{value:.{decimals}f}".replace("-", MINUS)


def scaled(value: float | None, factor: float) -> str:
    """Return a number in a smaller unit."""
    return UNKNOWN if value is None or not _known(value) else num(value * factor, 2)


def near(value: float | None, stderr: float | None) -> str:
    """Return a value with as many decimals as two digits of its standard error ask for."""
    if value is None or stderr is None or not _known(value) or not _known(stderr) or stderr <= 0.0:
        return num(value, 4)
    decimals = 1 - math.floor(math.log10(stderr))
    return fixed(round(value, decimals), max(decimals, 0)) if -3 <= decimals <= 7 else num(value, 4)


FILTERS = {"num": num, "signed": signed, "fixed": fixed, "scaled": scaled, "near": near}

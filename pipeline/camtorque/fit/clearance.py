"""What a change of the plunger's clearance makes of its leakage, which goes with the cube of it."""

from __future__ import annotations

import re

from camtorque.fit.known_fit import KnownFit
from camtorque.laws import ROWS
from camtorque.records import Refusal
from camtorque.units import DECIMAL

CLEARANCE = 4.0e-6
"""Clearance that a change is counted from where none is given [m]."""


def leakage_factor(text: str) -> float:
    """Return by how much a change of clearance such as ``+1um`` or ``3um+1um`` multiplies the leakage.

    Raises
    ------
    Refusal : not such a text, or no clearance is left
    """
    match = re.fullmatch(rf"(?:({DECIMAL})\s*um)?\s*([+-]{DECIMAL})\s*um", text.replace("µ", "u").strip())
    if match is None:
        raise Refusal(f"--clearance: found {text!r}, expected a change such as +1um, or 3um+1um from a known clearance")
    base = float(match[1]) * 1e-6 if match[1] else CLEARANCE
    if base <= 0.0:
        raise Refusal(f"--clearance: found {text!r}, expected a known clearance above 0 um before the change")
    factor = 1.0 + float(match[2]) * 1e-6 / base
    if factor <= 0.0:
        raise Refusal(f"--clearance: {text} leaves no clearance of {base * 1e6:g} um; give a smaller change")
    return factor**3


def refuse_leaky(known: KnownFit, clearance: str, factor: float) -> None:
    """Refuse a clearance whose leakage no pump has."""
    row = ROWS["leakage"]
    leak = factor * float(known.values[known.names.index(row.name)]) if row.name in known.names else 0.0
    if leak > row.upper and factor > 1.0:
        raise Refusal(
            f"--clearance: {clearance} makes a leakage of {leak / row.per_unit:.3g} {row.unit}, expected "
            f"{row.upper / row.per_unit:g} or less; give a smaller change"
        )

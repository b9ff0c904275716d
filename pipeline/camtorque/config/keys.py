"""What a TOML key may hold: type, unit, default, allowed band with its reason, meaning. One `Key` per key.

Parsers, "did you mean", `camtorque check`, `camtorque new` and the tables of docs/recording_toml.md derive from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from camtorque.units import BAR, DEGREE, RPM, ZERO_CELSIUS

SI_UNITS = ("Hz", "N", "N_per_m", "N_m_per_rad", "N_m_s_per_rad", "Nm_per_rad", "Pa", "V", "hz", "kg", "kg_m2", "m",
            "m_per_s2", "mV_per_V", "s")  # fmt: skip
KEY_UNITS: dict[str, tuple[float, float]] = {
    **dict.fromkeys(SI_UNITS, (1.0, 0.0)),
    "C": (1.0, ZERO_CELSIUS), "bar": (BAR, 0.0), "deg": (DEGREE, 0.0), "mm": (1.0e-3, 0.0), "rpm": (RPM, 0.0),
    "um": (1.0e-6, 0.0),
}  # fmt: skip
"""Unit at the end of a key -> factor and offset to SI: SI = factor * value + offset."""

SLIPS: dict[str, dict[str, float]] = {
    "Hz": {"kHz": 1.0e3},
    "N": {"kN": 1.0e3, "lbf": 4.4482},
    "N_per_m": {"N/mm": 1.0e3, "kN/m": 1.0e3},
    "Nm_per_rad": {"kN m/rad": 1.0e3, "N m/deg": 57.296},
    "N_m_per_rad": {"kN m/rad": 1.0e3, "N m/deg": 57.296},
    "Pa": {"GPa": 1.0e9, "MPa": 1.0e6, "bar": 1.0e5},
    "V": {"mV": 1.0e-3},
    "hz": {"kHz": 1.0e3, "MHz": 1.0e6},
    "kg": {"g": 1.0e-3, "lb": 0.45359},
    "kg_m2": {"kg mm2": 1.0e-6, "kg cm2": 1.0e-4, "g mm2": 1.0e-9, "g cm2": 1.0e-7},
    "m": {"mm": 1.0e-3, "um": 1.0e-6, "cm": 1.0e-2, "in": 0.0254},
    "mV_per_V": {"uV/V": 1.0e-3},
    "mm": {"m": 1.0e3, "um": 1.0e-3, "in": 25.4},
    "rpm": {"Hz": 60.0, "rad/s": 9.5493},
    "um": {"mm": 1.0e3, "m": 1.0e6},
    "s": {"ms": 1.0e-3, "us": 1.0e-6},
    "bar": {"Pa": 1.0e-5, "kPa": 1.0e-2, "MPa": 10.0},
}
"""Unit of a key -> units that are written into it by mistake, the usual one first, with their factor to that unit."""

LEAST_SLIP = 0.05
"""Who writes the number of another unit writes 8 or 0.8, never 0.0045."""

UNKNOWN = "?"
"""What `camtorque new` writes for a value that the logs cannot tell; refused until it is replaced."""

REQUIRED: Any = type("Required", (), {"__repr__": lambda self: "required"})()
"""The default of a key that has none."""


@dataclass(frozen=True)
class Band:
    """Allowed values from ``low`` to ``high`` in the key's own unit, and why no sound value lies outside.

    ``or_zero`` allows 0 beside the band (no spring, no delay).
    """

    low: float
    high: float
    reason: str
    or_zero: bool = False

    def holds(self, value: float) -> bool:
        """Tell whether a value is allowed; nan, inf and numbers too large for a float are not."""
        return bool(self.low <= value <= self.high) or (self.or_zero and value == 0)

    def __str__(self) -> str:
        zero = "0, or " if self.or_zero and not self.low <= 0.0 <= self.high else ""
        return f"{zero}{self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class Key:
    """One key of a TOML table.

    Attributes
    ----------
    name : as written in the file; ends in ``_<unit>`` where ``unit`` is one of `KEY_UNITS`
    kind : ``number``, ``whole``, ``numbers``, ``pair``, ``flag``, ``text``, ``path``, ``choice``, ``date``
    meaning : one line for a test engineer
    unit : of a number in the file
    default : value in SI where the key is left out, `REQUIRED` where it may not be
    band : allowed values of a number
    choices : allowed words -> value
    attribute : field of the record; the name without its unit where not given
    own : True where the product adds the key to the bench's schema
    used : False for what people note down: checked, but nothing is computed from it
    """

    name: str
    kind: str
    meaning: str
    unit: str = ""
    default: Any = REQUIRED
    band: Band | None = None
    choices: Mapping[str, Any] = field(default_factory=dict)
    attribute: str = ""
    own: bool = False
    used: bool = True

    def __post_init__(self) -> None:
        ending = f"_{self.unit}" if self.unit in KEY_UNITS else ""
        if not self.name.endswith(ending):
            raise ValueError(f"{self.name}: the name has to end in its unit {ending!r}")
        if self.kind in ("number", "whole", "numbers", "pair") and self.band is None:
            raise ValueError(f"{self.name}: a number needs a band")
        if not self.attribute:
            object.__setattr__(self, "attribute", self.name.removesuffix(ending) if ending else self.name)

    @property
    def required(self) -> bool:
        """Tell whether the key has to be given."""
        return self.default is REQUIRED

    def si(self, value: float) -> float:
        """Return a number of the file in SI."""
        factor, offset = KEY_UNITS.get(self.unit, (1.0, 0.0))
        return factor * float(value) + offset

    def of_si(self, value: float) -> float:
        """Return a number in SI as the file has it."""
        factor, offset = KEY_UNITS.get(self.unit, (1.0, 0.0))
        return (float(value) - offset) / factor

    def slip(self, value: float) -> str:
        """Return ": did you mean 8 mm = 0.008?" where another unit brings the value into the band."""
        if self.band is None or abs(value) < LEAST_SLIP:
            return ""
        if self.unit == "C" and self.band.holds(value - ZERO_CELSIUS):
            return f": did you mean {value:g} K = {value - ZERO_CELSIUS:g}?"
        for name, factor in SLIPS.get(self.unit, {}).items():
            if self.band.holds(value * factor):
                return f": did you mean {value:g} {name} = {value * factor:g}?"
        return ""


@dataclass(frozen=True)
class TableSchema:
    """The keys of one table; ``header`` as it stands in the file, ``many`` for an array of tables."""

    header: str
    meaning: str
    keys: tuple[Key, ...]
    required: bool = True
    many: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all keys."""
        return tuple(key.name for key in self.keys)

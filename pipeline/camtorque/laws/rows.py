"""Parameter rows: what a physical law needs to be told, beside the law itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

ROLES = ("shared", "own")


@dataclass(frozen=True)
class ParameterRow:
    """One parameter of one law, in SI, with all that a fit and a report need to know about it.

    Attributes
    ----------
    name, symbol : full name, and the symbol that the equations in the docstrings use
    unit, per_unit : unit of the report, and SI per that unit
    start, lower, upper : start value and bounds [SI]
    step : change that matters; scales the parameter in the solver [SI]
    prior : (mean, standard deviation) [SI], or None where nothing is known beforehand
    meaning, source : one sentence each
    role : ``shared`` by all recordings of a pump, or ``own`` to each recording
    is_linear : True where the torque before the sensor is linear in it
    """

    name: str
    symbol: str
    unit: str
    per_unit: float
    start: float
    lower: float
    upper: float
    step: float
    prior: tuple[float, float] | None
    meaning: str
    source: str
    role: str = "shared"
    is_linear: bool = False

    def __post_init__(self) -> None:
        if not self.lower <= self.start <= self.upper:
            raise ValueError(f"{self.name}: start {self.start} is outside [{self.lower}, {self.upper}]")
        if not (self.step > 0.0 and math.isfinite(self.step)):
            raise ValueError(f"{self.name}: step {self.step} has to be positive and finite")
        if self.role not in ROLES:
            raise ValueError(f"{self.name}: role {self.role!r}, expected one of {ROLES}")
        if self.prior is not None and not self.prior[1] > 0.0:
            raise ValueError(f"{self.name}: the standard deviation of the prior has to be positive")


def display(
    name: str,
    symbol: str,
    unit: str,
    per_unit: float,
    values: tuple[float, float, float, float],
    prior: tuple[float, float] | None,
    meaning: str,
    source: str,
    role: str = "shared",
    is_linear: bool = False,
) -> ParameterRow:
    """Return a row whose (start, lower, upper, step) and prior are given in the unit of the report."""
    start, lower, upper, step = (value * per_unit for value in values)
    scaled = None if prior is None else (prior[0] * per_unit, prior[1] * per_unit)
    return ParameterRow(
        name, symbol, unit, per_unit, start, lower, upper, step, scaled, meaning, source, role, is_linear
    )

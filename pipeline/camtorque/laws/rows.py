"""A law as the registries read it: its parameter rows, the columns of torque that they scale, what it is called."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

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

    def __post_init__(self) -> None:
        if not self.lower <= self.start <= self.upper:
            raise ValueError(f"{self.name}: start {self.start} is outside [{self.lower}, {self.upper}]")
        if not (self.step > 0.0 and math.isfinite(self.step)):
            raise ValueError(f"{self.name}: step {self.step} has to be positive and finite")
        if self.role not in ROLES:
            raise ValueError(f"{self.name}: role {self.role!r}, expected one of {ROLES}")
        if self.prior is not None and not self.prior[1] > 0.0:
            raise ValueError(f"{self.name}: the standard deviation of the prior has to be positive")


def parameter(
    name: str,
    symbol: str,
    unit: str,
    per_unit: float,
    values: tuple[float, float, float, float],
    prior: tuple[float, float] | None,
    meaning: str,
    source: str,
    role: str = "shared",
) -> ParameterRow:
    """Return a row whose (start, lower, upper, step) and prior are given in the unit of the report."""
    start, lower, upper, step = (value * per_unit for value in values)
    scaled = None if prior is None else (prior[0] * per_unit, prior[1] * per_unit)
    return ParameterRow(name, symbol, unit, per_unit, start, lower, upper, step, scaled, meaning, source, role)


@dataclass(frozen=True)
class Law:
    """What one file of this room states.

    Attributes
    ----------
    rows : its parameters
    columns : compiled function from `camtorque.laws.columns.At` to a tuple of `Column`, one for each of ``linear``
    causes : parameter -> cause of torque, where that is not called as the parameter
    loss : group of the energy balance that its causes belong to
    on_bridge : its columns are what the transducer's bridge feels beside the torque; they load no shaft and do no work
    nonlinear : parameters without a column
    """

    rows: tuple[ParameterRow, ...]
    columns: Callable[..., Any] | None = None
    causes: Mapping[str, str] = field(default_factory=dict)
    loss: str = ""
    on_bridge: bool = False
    nonlinear: tuple[str, ...] = ()

    @property
    def linear(self) -> tuple[str, ...]:
        """Parameters that the torque before the sensor is linear in."""
        return tuple(row.name for row in self.rows if self.columns and row.name not in self.nonlinear)

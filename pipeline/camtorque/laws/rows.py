"""A law as the registries read it: its parameter rows, the columns of torque that they scale, what it is called.

A law whose torque is linear in a parameter acts in one of three ways, per unit of it:

* `on_contact`: an arm [m] on which the contact load rubs;
* `on_plunger`: a force along the plunger [N], raised by the guide's friction like every other;
* `on_shaft`: a torque on the shaft [N m].

Each states its derivatives, by cam angle at constant time rates, and by what else it depends on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from camtorque.compiled import njit

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


class At(NamedTuple):
    """State of the pump at each cam angle; ``_by`` is the derivative by angle.

    Attributes
    ----------
    lift, slope, curve : y [m], y' [m/rad], y'' [m/rad^2]
    rate, pressure : cam speed [rad/s], pressure on the plunger [Pa]
    sign, sign_by : smooth sign of the sliding velocity
    cosine, sine : of the cam angle
    tangent, tangent_by : tan(phi), share of the contact load that acts across the follower
    lever, lever_by : 1 / cos(phi), contact load normal to the cam over that along the follower
    spin, spin_by : rate of the roller over that of the cam
    turn, turn_by : acceleration of the roller [rad/s^2]
    stiffness, preload, area : of spring [N/m, N] and plunger [m^2]
    """

    lift: float
    slope: float
    curve: float
    rate: float
    pressure: float
    sign: float
    sign_by: float
    cosine: float
    sine: float
    tangent: float
    tangent_by: float
    lever: float
    lever_by: float
    spin: float
    spin_by: float
    turn: float
    turn_by: float
    stiffness: float
    preload: float
    area: float


class Column(NamedTuple):
    """Torque per unit of one parameter: arm of the contact load, force along the plunger, torque on the shaft."""

    arm: float
    arm_by_angle: float
    force: float
    force_by_angle: float
    force_by_rate: float
    force_by_pressure: float
    torque: float
    torque_by_angle: float
    torque_by_rate: float
    torque_by_second: float


@njit(cache=True, error_model="numpy")
def on_contact(arm, by_angle):  # type: ignore[no-untyped-def]
    """Return the column of an arm on which the contact load rubs [m]."""
    return Column(arm, by_angle, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@njit(cache=True, error_model="numpy")
def on_plunger(force, by_angle, by_rate, by_pressure):  # type: ignore[no-untyped-def]
    """Return the column of a force along the plunger [N], positive against the lift."""
    return Column(0.0, 0.0, force, by_angle, by_rate, by_pressure, 0.0, 0.0, 0.0, 0.0)


@njit(cache=True, error_model="numpy")
def on_shaft(torque, by_angle, by_rate, by_second=0.0):  # type: ignore[no-untyped-def]
    """Return the column of a torque that the shaft has to overcome [N m]; ``by_second``: by cam acceleration."""
    return Column(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, torque, by_angle, by_rate, by_second)


@dataclass(frozen=True)
class Law:
    """What one file of this room states.

    Attributes
    ----------
    rows : its parameters
    columns : compiled function from `At` to a tuple of `Column`, one for each of ``linear``
    causes : parameter -> cause of torque, where that is not called as the parameter
    loss : group of the energy balance that its causes belong to
    on_bridge : its columns are what the transducer's bridge feels beside the torque; they load no shaft and do no work
    nonlinear : parameters without a column
    on_contact : those whose column is an arm on which the contact load rubs
    """

    rows: tuple[ParameterRow, ...]
    columns: Callable[..., Any] | None = None
    causes: Mapping[str, str] = field(default_factory=dict)
    loss: str = ""
    on_bridge: bool = False
    nonlinear: tuple[str, ...] = ()
    on_contact: tuple[str, ...] = ()

    @property
    def linear(self) -> tuple[str, ...]:
        """Parameters that the torque before the sensor is linear in."""
        return tuple(row.name for row in self.rows if self.columns and row.name not in self.nonlinear)

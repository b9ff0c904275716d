"""The fitting problem: which parameters are free, what they act on, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.laws import ROWS
from camtorque.laws.chain import NONLINEAR_NAMES, ChainInput
from camtorque.laws.rows import ParameterRow
from camtorque.records import Array, freeze_arrays

SEPARATOR = "__"
"""Joins the name of an own parameter and the name of its recording."""


@dataclass(frozen=True)
class FitData:
    """One recording as the fit sees it.

    Attributes
    ----------
    name : recording
    chain : input of the chain for the fitted cycles
    torque : (m,) mean measured torque in bins [N m]
    mean_torque : (n_theta,) the same on the fine grid
    weight : (m,) one over the standard deviation of an independent bin [1/(N m)]
    delivery : ``closed`` (the outlet closes), ``spill`` or ``none``
    rows : parameter rows with this recording's starts, bounds and priors
    """

    name: str
    chain: ChainInput
    torque: Array
    mean_torque: Array
    weight: Array
    delivery: str
    rows: Mapping[str, ParameterRow]

    def __post_init__(self) -> None:
        if self.torque.shape != self.weight.shape:
            raise ValueError(f"{self.name}: torque {self.torque.shape} and weight {self.weight.shape} differ")
        freeze_arrays(self)


@dataclass(frozen=True)
class Slot:
    """One free parameter: its row, and the index of its recording (-1: shared by all)."""

    row: ParameterRow
    recording: int
    name: str


@dataclass(frozen=True)
class Problem:
    """Recordings, free parameters, and fixed values.

    Attributes
    ----------
    data : recordings
    effects : effects that are switched on
    nonlinear, linear : free parameters; torque zeros are among the linear ones
    fixed : value of every parameter that is not free (the identity of an effect that is off)
    uses_lift : True where the lift table is corrected (one coefficient per basis function, shared)
    held_linear : linear parameters that keep a value; held_lift : (n_basis,) coefficients that keep theirs
    """

    data: tuple[FitData, ...]
    effects: tuple[str, ...]
    nonlinear: tuple[Slot, ...]
    linear: tuple[Slot, ...]
    fixed: Mapping[str, float]
    uses_lift: bool
    held_linear: Mapping[str, float]
    held_lift: Array | None = None

    @property
    def n_lift(self) -> int:
        """Number of free lift coefficients."""
        basis = self.data[0].chain.lift_basis
        return basis.n_basis if self.uses_lift and self.held_lift is None and basis is not None else 0

    def values(self, x: Array, recording: int) -> dict[str, float]:
        """Return the value of every non-linear parameter for one recording [SI]."""
        result = dict(self.fixed)
        for slot, value in zip(self.nonlinear, x, strict=True):
            if slot.recording in (-1, recording):
                result[slot.row.name] = float(value)
        delivery = self.data[recording].delivery
        if delivery != "closed":
            result["end_of_delivery"] = IDENTITY["end_of_delivery"]
        if delivery != "spill":
            result["spill_lift"], result["spill_width"] = IDENTITY["spill_lift"], 0.0
        return result

    def start(self) -> Array:
        """Return the start of the non-linear parameters, (n_nonlinear,) [SI]."""
        return np.array([slot.row.start for slot in self.nonlinear])


IDENTITY: dict[str, float] = dict.fromkeys(NONLINEAR_NAMES, 0.0)
"""Values that make every link of the chain the identity."""
IDENTITY.update(
    coupling_resonance=750.0, coupling_damping=0.1, cutoff=1.0e9, filter_damping=0.707, end_of_delivery=99.0,
    drive_damping=0.7, spill_lift=99.0, end_width=0.01, dead_volume=1.0e-6,
    bulk_modulus=1.3e9, bulk_modulus_slope=10.0, valve_range=1.0e5, port_closing_lift=1.0e-3,
)  # fmt: skip

EFFECT_PARAMETERS: dict[str, tuple[str, ...]] = {
    "chamber": (
        "dead_volume", "bulk_modulus", "bulk_modulus_slope", "feed_pressure", "valve_opening", "valve_area",
        "valve_range", "leakage", "leak_growth", "port_closing_lift", "port_width", "end_of_delivery", "end_width",
        "spill_lift", "spill_width", "pressure_zero"),
    "trigger": ("trigger_offset",),
    "driveline": ("shaft_compliance", "shaft_damping", "cam_side_inertia", "drive_admittance"),
    "sensor": ("gain_error", "delay_error", "cutoff", "filter_damping"),
    "friction": ("bearing_arm", "pin_arm", "guide_friction", "shaft_drag"),
    "damping": ("shaft_viscous", "plunger_viscous"),
    "spring": ("spring_stiffness_error", "spring_preload_error"),
    "lift": (),
    "controller": ("drive_frequency", "drive_damping"),
    "coupling": ("coupling_compliance", "coupling_resonance", "coupling_damping"),
}  # fmt: skip
"""Effect of the ladder -> the parameters that it frees; the torque zero is free on every rung but the rigid one."""
FIT_EFFECTS = tuple(EFFECT_PARAMETERS)
SEVERAL_SPEEDS = ("controller",)
"""Effects that one speed cannot tell from inertia and stiffness: offered to fits over several speeds alone."""
LEAST_SPEED_RATIO = 1.2
CLOSED_ONLY = ("end_of_delivery",)
SPILL_ONLY = ("spill_lift", "spill_width")


def offered_effects(data: Sequence[FitData]) -> tuple[str, ...]:
    """Return the effects that are offered to the fit of some recordings unless the user chooses."""
    speeds = [item.chain.speed for item in data]
    if max(speeds) > LEAST_SPEED_RATIO * min(speeds):
        return FIT_EFFECTS
    return tuple(name for name in FIT_EFFECTS if name not in SEVERAL_SPEEDS)


def own_name(parameter: str, recording: str) -> str:
    """Return the name of a recording's own parameter in a joint fit."""
    return f"{parameter}{SEPARATOR}{recording}"


def build_problem(
    data: Sequence[FitData],
    effects: Sequence[str],
    held: Mapping[str, float] | None = None,
    held_lift: Array | None = None,
) -> Problem:
    """Return the problem of a set of effects.

    Parameters
    ----------
    data : recordings of one pump
    effects : names of `EFFECT_PARAMETERS`
    held : parameters that keep a value instead of being fitted [SI]
    held_lift : (n_basis,) lift coefficients that keep theirs [m]

    Raises
    ------
    KeyError
        For an effect that does not exist.
    """
    held = dict(held or {})
    names = [name for effect in FIT_EFFECTS if effect in effects for name in EFFECT_PARAMETERS[effect]]
    unknown = set(effects) - set(FIT_EFFECTS)
    if unknown:
        raise KeyError(f"unknown effects {sorted(unknown)}; there are {FIT_EFFECTS}")
    nonlinear: list[Slot] = []
    linear: list[Slot] = []
    for name in [*names, "torque_zero"]:
        if name in held:
            continue
        target = linear if ROWS[name].is_linear else nonlinear
        if ROWS[name].role == "shared":
            target.append(Slot(data[0].rows[name], -1, name))
            continue
        for index, item in enumerate(data):
            if _applies(name, item.delivery):
                label = own_name(name, item.name) if len(data) > 1 else name
                target.append(Slot(item.rows[name], index, label))
    fixed = {**IDENTITY, **{name: held[name] for name in held if name in IDENTITY}}
    held_linear = {name: value for name, value in held.items() if ROWS[name].is_linear}
    prepared = tuple(_with_effects(item, effects) for item in data)
    uses_lift = "lift" in effects
    return Problem(prepared, tuple(effects), tuple(nonlinear), tuple(linear), fixed, uses_lift, held_linear, held_lift)


def _with_effects(item: FitData, effects: Sequence[str]) -> FitData:
    """Return the recording without the chamber and lift basis that the effects do not ask for."""
    basis = item.chain.lift_basis if "lift" in effects else None
    if item.chain.uses_chamber == ("chamber" in effects) and basis is item.chain.lift_basis:
        return item
    return replace(item, chain=replace(item.chain, uses_chamber="chamber" in effects, lift_basis=basis))


def _applies(name: str, delivery: str) -> bool:
    if name in CLOSED_ONLY:
        return delivery == "closed"
    if name in SPILL_ONLY:
        return delivery == "spill"
    return True

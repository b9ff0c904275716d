"""The fitting problem: recordings, structures, free parameters, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from camtorque.fit.teeth import lead_slopes, leads_at
from camtorque.laws import ROWS, ripple
from camtorque.laws.chain import COLUMN_NAMES, NONLINEAR_NAMES, ChainInput, ChainOutput, Motion
from camtorque.laws.chamber import NAMES as CHAMBER_NAMES
from camtorque.laws.chamber import NEVER
from camtorque.laws.lift import LiftCorrection
from camtorque.laws.rows import ParameterRow
from camtorque.records import Array, ReadOnly

Indices = NDArray[np.int64]
ALL_NAMES = (*NONLINEAR_NAMES, *COLUMN_NAMES)
ORDER = {name: k for k, name in enumerate(ALL_NAMES)}
"""Parameters in the chain's own order."""
SEPARATOR = "__"
"""Joins the name of an own parameter and the name of its recording."""
END_NAMES = ("end_of_delivery", "end_width")
LAND_NAMES = (*END_NAMES, "outlet_return")
SPILL_NAMES = ("spill_lift", "spill_width", "spill_span")
STRUCTURES: dict[str, str] = {
    "land": "delivery ends by a land",
    "spill": "delivery ends by spill",
    "open": "no end of delivery seen",
    "line": "line pressure on the plunger",
}
"""What is compared discretely; everything else is continuous and free."""
NEUTRAL: dict[str, float] = {
    "end_of_delivery": NEVER, "end_width": 0.03, "outlet_return": 0.0,
    "spill_lift": NEVER, "spill_width": 5.0e-3, "spill_span": 1.0e-3,
}  # fmt: skip
"""Values that switch an end of delivery off."""
WITHOUT: dict[str, float] = {
    **{name: ROWS[name].start for name in NONLINEAR_NAMES}, **dict.fromkeys(COLUMN_NAMES, 0.0), **NEUTRAL,
}  # fmt: skip
"""Values of parameters that are not free."""


@dataclass(frozen=True)
class FitData(ReadOnly):
    """One recording as the fit sees it.

    Attributes
    ----------
    name : recording
    chain : input of the chain for the fitted cycles
    torque : (bins,) mean measured torque [N m]
    weight : (bins,) one over the standard deviation of an independent bin [1/(N m)]
    structure : one of `STRUCTURES`
    rows : parameter rows with this recording's starts, bounds and priors
    lift_basis : correction of the lift table
    measures_chamber : whether its pressure is that on the plunger, so that it has the structure ``line`` and no other
    teeth : (t, 3) of each further tooth of a turn: even angle at which it passes, how much further the cam leads there
        than at the trigger's edge, standard deviation of that [rad]
    """

    name: str
    chain: ChainInput
    torque: Array
    weight: Array
    structure: str
    rows: Mapping[str, ParameterRow]
    lift_basis: LiftCorrection
    measures_chamber: bool = False
    teeth: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        if self.torque.shape != self.weight.shape:
            raise ValueError(f"{self.name}: torque {self.torque.shape} and weight {self.weight.shape} differ")
        if self.structure not in STRUCTURES:
            raise ValueError(f"{self.name}: structure {self.structure!r}, expected one of {tuple(STRUCTURES)}")
        super().__post_init__()

    @property
    def structures(self) -> tuple[str, ...]:
        """The structures that are compared."""
        return ("line",) if self.measures_chamber else tuple(STRUCTURES)

    def tooth_misfit(self, motion: Motion) -> Array:
        """Return how far the further teeth are off a motion of the cam, in standard deviations, (t,)."""
        if not self.teeth.size:  # nearly always, and every step of every search asks
            return np.zeros(0)
        place, lead, std = self.teeth.T
        return np.asarray((lead - leads_at(motion, self.chain, place)) / std)

    def tooth_columns(self, motion: Motion, chosen: Indices, scale: Array) -> Array:
        """Return the derivatives at the further teeth by some of `ALL_NAMES`, scaled, and the misfit, (t, m + 1)."""
        place, _, std = self.teeth.T
        slopes = np.zeros((place.size, len(ALL_NAMES)))
        slopes[:, : len(NONLINEAR_NAMES)] = lead_slopes(motion, self.chain, place)
        return np.column_stack([slopes[:, chosen] * scale / std[:, None], self.tooth_misfit(motion)])

    def applies(self, name: str) -> bool:
        """Return whether a parameter acts in this recording's structure."""
        if name in LAND_NAMES:
            return self.structure == "land"
        if name in SPILL_NAMES:
            return self.structure == "spill"
        if name in ripple.NAMES:
            return self.chain.ripple_order > 0
        return self.structure != "line" or name not in CHAMBER_NAMES or name == "pressure_zero"

    def residual(self, output: ChainOutput, coefficients: Array) -> Array:
        """Return measured less modelled torque in units of its standard deviation, (bins,)."""
        return (self.torque - output.torque - output.linear @ coefficients) * self.weight


@dataclass(frozen=True)
class FreeParameter:
    """One free parameter: its row, and the index of its recording (-1: shared by all)."""

    row: ParameterRow
    recording: int
    name: str


@dataclass(frozen=True)
class Problem:
    """Recordings, free parameters (non-linear ones first), and values of those that are not free.

    ``places`` holds per recording the indices of its parameters in the free ones, and in the chain's own order;
    ``held`` per recording all parameters in that order with those at their values that are not free.
    """

    data: tuple[FitData, ...]
    parameters: tuple[FreeParameter, ...]
    n_nonlinear: int
    fixed: Mapping[str, float]
    places: tuple[tuple[Indices, Indices], ...] = field(init=False)
    held: tuple[Array, ...] = field(init=False)

    def __post_init__(self) -> None:
        own: list[list[int]] = [[] for _ in self.data]
        for k, parameter in enumerate(self.parameters):
            for index in (parameter.recording,) if parameter.recording >= 0 else range(len(self.data)):
                if self.data[index].applies(parameter.row.name):
                    own[index].append(k)
        places, held = [], []
        values = np.array([self.fixed[name] for name in ALL_NAMES])
        for item, mine in zip(self.data, own, strict=True):
            chain = [ORDER[self.parameters[k].row.name] for k in mine]
            places.append((np.array(mine, dtype=np.int64), np.array(chain, dtype=np.int64)))
            base = values.copy()
            for name, value in NEUTRAL.items():
                if not item.applies(name):
                    base[ORDER[name]] = value
            held.append(base)
        object.__setattr__(self, "places", tuple(places))
        object.__setattr__(self, "held", tuple(held))

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return len(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    def values(self, z: Array, recording: int) -> tuple[dict[str, float], Array]:
        """Return every non-linear parameter of one recording and the coefficients of its columns [SI]."""
        own, chain = self.places[recording]
        full = self.held[recording].copy()
        full[chain] = z[own]
        n = len(NONLINEAR_NAMES)
        return dict(zip(NONLINEAR_NAMES, full[:n].tolist(), strict=True)), full[n:]

    def add_teeth(self, recording: int, output: ChainOutput, product: Array) -> None:
        """Add what further teeth tell to the products (m + 1, m + 1) of a recording's scaled columns and residual."""
        item, (own, chain) = self.data[recording], self.places[recording]
        if item.teeth.size:
            rows = item.tooth_columns(output.motion, chain, self.steps[own])
            product += rows.T @ rows

    @property
    def start(self) -> Array:
        """Starts of the free parameters [SI]."""
        return np.array([parameter.row.start for parameter in self.parameters])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the free parameters [SI]."""
        return np.array([s.row.lower for s in self.parameters]), np.array([s.row.upper for s in self.parameters])

    @cached_property
    def steps(self) -> Array:
        """Scale of the free parameters [SI]."""
        return np.array([parameter.row.step for parameter in self.parameters])

    @cached_property
    def priors(self) -> tuple[Array, Array]:
        """Means and standard deviations of the free parameters, infinite where nothing is known [SI]."""
        pairs = [parameter.row.prior or (parameter.row.start, np.inf) for parameter in self.parameters]
        return np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])

    def index(self, name: str) -> int:
        """Return the index of a free parameter by its name, -1 where it is not free."""
        return next((k for k, parameter in enumerate(self.parameters) if parameter.name == name), -1)


def build_problem(data: Sequence[FitData], held: Mapping[str, float] | None = None) -> Problem:
    """Return the problem of all parameters that act in the recordings' structures.

    Parameters
    ----------
    data : recordings of one pump
    held : parameters that keep a value instead of being fitted [SI]
    """
    held = held or {}
    fixed = {**WITHOUT, **held}
    parameters: list[FreeParameter] = []
    for name in ALL_NAMES:
        if name in held:
            continue
        users = [index for index, item in enumerate(data) if item.applies(name)]
        if not users:
            continue
        if data[users[0]].rows[name].role == "shared":
            parameters.append(FreeParameter(data[users[0]].rows[name], -1, name))
            continue
        for index in users:
            label = f"{name}{SEPARATOR}{data[index].name}" if len(data) > 1 else name
            parameters.append(FreeParameter(data[index].rows[name], index, label))
    n_nonlinear = sum(parameter.row.name in NONLINEAR_NAMES for parameter in parameters)
    return Problem(tuple(data), tuple(parameters), n_nonlinear, fixed)


def in_structure(data: FitData, structure: str) -> FitData:
    """Return the recording with another structure, with a chamber where it has one."""
    chain, uses_chamber = data.chain, structure != "line"
    if chain.uses_chamber != uses_chamber:  # a chain that is made anew works its twist out again
        chain = replace(chain, uses_chamber=uses_chamber)
    return replace(data, structure=structure, chain=chain)


def with_rows(data: FitData, changes: Mapping[str, Mapping[str, object]]) -> FitData:
    """Return the recording with some fields of some rows replaced."""
    rows = dict(data.rows)
    for name, fields in changes.items():
        rows[name] = replace(rows[name], **fields)  # type: ignore[arg-type]
    return replace(data, rows=rows)


def with_starts(data: FitData, starts: Mapping[str, float]) -> FitData:
    """Return the recording with other starts, clipped into their bounds [SI]."""
    changes = {
        name: {"start": min(max(float(value), data.rows[name].lower), data.rows[name].upper)}
        for name, value in starts.items()
    }
    return with_rows(data, changes)


def started_at(problem: Problem, z: Array) -> list[FitData]:
    """Return the recordings of a problem, started at values of the free parameters (k,) [SI]."""
    pairs = list(zip(problem.parameters, z.tolist(), strict=True))
    shared = {parameter.row.name: value for parameter, value in pairs if parameter.recording < 0}
    starts = [dict(shared) for _ in problem.data]
    for parameter, value in pairs:
        if parameter.recording >= 0:
            starts[parameter.recording][parameter.row.name] = value
    return [with_starts(*pair) for pair in zip(problem.data, starts, strict=True)]

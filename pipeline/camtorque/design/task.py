"""DESIGN.toml -> `Task`: what is free within which bounds, loads, aims, limits, tolerances; checked, SI inside."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from camtorque.config.keys import Key
from camtorque.config.pump import PumpConfig
from camtorque.config.tables import Table, read_schema
from camtorque.design.loads import FittedPump, Load, loads_of, same_pump
from camtorque.design.profile import BSPLINE, LAWS, Family
from camtorque.design.responses import EQUAL, MOST, RESPONSES
from camtorque.design.schema import (
    ANSWER,
    ANY_SIZE,
    DESIGN_SCHEMA,
    LIFT,
    LOBE,
    MILLIMETRE,
    PUMP_FIELDS,
    QUANTITIES,
    TOLERANCES,
    TOP,
    phase_name,
    read_values,
)
from camtorque.hashes import input_files
from camtorque.ingest.pump_file import read_pump
from camtorque.records import Array, Finding, InputFile, Refusal
from camtorque.units import DEGREE, expected_one_of

Value = TypeVar("Value", float, Array)
SLIP = 50.0
"""Bounds further than this factor from the value of the pump file are taken for a slip of units."""
LEAST_OFFSET = 0.002
"""Share of the base circle's radius below which the bounds of a follower offset are taken for one, too."""
KNEE = "knee"
PHASE = r"phase_\d+_deg"
"""Name of the phase of a pump on a shaft."""


@dataclass(frozen=True)
class Variable:
    """A free quantity: name, bounds and first guess in the unit of its name."""

    name: str
    low: float
    high: float
    start: float


@dataclass(frozen=True)
class Limit:
    """A limit on a response, in its unit: kind ``most``, ``least`` or ``equal``."""

    response: str
    kind: str
    value: float

    @property
    def text(self) -> str:
        """Return the limit as the user wrote it."""
        return f"{self.response} {self.kind} {self.value:g}"

    @property
    def scale(self) -> float:
        """The number by which an optimiser divides it."""
        return max(abs(self.value), 1.0)

    def missed_by(self, value: Value) -> Value:
        """Return by how much values of the response miss the limit, in its unit; below 0 where they keep it."""
        beyond = value - self.value
        return abs(beyond) if self.kind == EQUAL else beyond if self.kind == MOST else -beyond

    def as_tight_as(self, other: Limit) -> bool:
        """Return whether what keeps this limit keeps another one, too."""
        if (self.response, self.kind) != (other.response, other.kind):
            return False
        return self.value <= other.value if self.kind == MOST else self.value >= other.value


@dataclass(frozen=True)
class Task:
    """A design task, complete; ``tolerances``: key of `schema.TOLERANCES` -> value in SI."""

    path: Path
    text: str
    config: PumpConfig
    families: tuple[Family, ...]
    fixed: Mapping[str, float]
    variables: tuple[Variable, ...]
    loads: tuple[Load, ...]
    aims: tuple[str, ...]
    limits: tuple[Limit, ...]
    tolerances: Mapping[str, Any]
    points: int
    choose: str
    seed: int
    starts: int
    findings: tuple[Finding, ...]
    inputs: tuple[InputFile, ...]


def read_task(path: Path | str, fitted: FittedPump | None = None) -> Task:
    """Return a design task from its file, pump file and pressure curves read.

    Raises
    ------
    Refusal : a missing or unknown key, a free quantity without bounds, a slip of units, an unknown aim or limit
    """
    file = Path(path)
    text, root = read_schema(file, DESIGN_SCHEMA, f"expected a design file (schema {DESIGN_SCHEMA})")
    top = read_values(root, TOP, "lift", "free", "load", "aims", "limits", "tolerances", "answer")
    config, findings = read_pump(top["pump"])
    if fitted is not None:
        same_pump(fitted.path, config, fitted.pump_id)
        config = replace(config, friction=fitted.friction)
    lift, free = root.table("lift", optional=True), root.table("free", optional=True)
    shape = read_values(lift, LIFT, "law")
    fixed = _lobe_values(config, lift, shape, free)
    variables = _variables(free, fixed, len(config.phases))
    families = _families(lift, shape)
    loads = tuple(load for table in root.tables("load") for load in loads_of(table, config, fitted))
    return _checked(Task(
        path=file,
        text=text,
        config=config,
        families=families,
        fixed=fixed,
        variables=variables,
        loads=loads,
        aims=_aims(root.table("aims")),
        limits=_limits(root.table("limits", optional=True)),
        tolerances=read_values(root.table("tolerances", optional=True), TOLERANCES),
        findings=findings,
        inputs=input_files(
            file, config.path, config.pump.cam_table_path, *(load.pressure_file for load in loads)
        ),
        **read_values(root.table("answer", optional=True), ANSWER),
    ))  # fmt: skip


def _families(table: Table, shape: Mapping[str, Any]) -> tuple[Family, ...]:
    laws = table.values.get("law", BSPLINE)
    names = [laws] if isinstance(laws, str) else laws
    if not isinstance(names, list) or not names or not all(name in LAWS for name in names):
        raise Refusal(f"{table.where('law')}: found {laws!r}, expected one or a list of {', '.join(LAWS)}")
    spline = Family(BSPLINE, shape["degree"], shape["pieces"])
    return tuple(spline if name == BSPLINE else Family(name) for name in dict.fromkeys(names))


def _lobe_values(config: PumpConfig, lift: Table, shape: Mapping[str, Any], free: Table) -> dict[str, float]:
    """Return the value of every quantity before anything moves, in the unit of its name."""
    values = {name: getattr(config.pump, field) / QUANTITIES[name].factor for name, field in PUMP_FIELDS.items()}
    values |= {phase_name(k + 1): phase / DEGREE for k, phase in enumerate(config.phases)}
    if len(config.sections) == 4 and config.sections[1].kind == config.sections[3].kind == "dwell":
        rise, top, fall, _ = config.sections
        parts = (rise.rise / MILLIMETRE, rise.angle / DEGREE, top.angle / DEGREE, fall.angle / DEGREE)
        values |= dict(zip(LOBE, parts, strict=True))
    values |= {name: shape[name] / QUANTITIES[name].factor for name in LOBE if shape[name] is not None}
    missing = [name for name in LOBE if name not in values and not free.has(name)]
    if missing:
        raise Refusal(
            f"{lift.where(missing[0])}: this key is missing, and the pump file does not give rise, dwell, return and "
            f"dwell as sections; give {', '.join(missing)} here, or bounds in [free]"
        )
    return values


def _variables(free: Table, values: dict[str, float], pumps: int) -> tuple[Variable, ...]:
    """Return the free quantities; their first guess is the value of the pump file, moved into the bounds."""
    allowed = (*QUANTITIES, *(phase_name(k) for k in range(2, pumps + 1)))
    found = []
    for name, bounds in free.values.items():
        if name not in allowed:
            told = (
                f"; the pump file has {pumps} pump{'s' * (pumps > 1)} on the shaft: give a phase for each more in "
                "phases_deg of its [shaft]" if re.fullmatch(PHASE, name) else expected_one_of(name, allowed)
            )  # fmt: skip
            raise Refusal(f"{free.where(name)}: nothing of this name can be free{told}")
        low, high = _bounds(free, name, bounds)
        least = QUANTITIES[name].least if name in QUANTITIES else -360.0
        if low < least:
            raise Refusal(f"{free.where(name)}: found a lower bound of {low:g}, expected at least {least:g}")
        start = values.get(name, 0.5 * (low + high))
        _refuse_slip(free, name, (low, high), start, values["base_circle_radius_mm"])
        found.append(Variable(name, low, high, float(np.clip(start, low, high))))
        values[name] = found[-1].start
    return tuple(found)


def _refuse_slip(free: Table, name: str, bounds: tuple[float, float], start: float, radius: float) -> None:
    """Refuse bounds that look like another unit's: far from the pump's value, or from its size where that may be 0."""
    low, high = bounds
    largest = max(abs(low), abs(high))
    far = largest < abs(start) / SLIP or (min(abs(low), abs(high)) > SLIP * abs(start) > 0.0)
    reason = f"the pump has {start:g} in this unit; expected bounds near it"
    if name == "follower_offset_mm":
        far = largest < LEAST_OFFSET * radius
        reason = f"the base circle has {radius:g} in this unit; expected bounds of {LEAST_OFFSET:g} of it or more"
    if far and name != "spring_preload_N" and not name.startswith("phase"):
        raise Refusal(f"{free.where(name)}: found bounds {low:g} to {high:g}, but {reason}; check the unit")


def _bounds(free: Table, name: str, bounds: Any) -> tuple[float, float]:
    numbers = isinstance(bounds, list) and all(isinstance(x, int | float) and ANY_SIZE.holds(x) for x in bounds)
    if not numbers or len(bounds) != 2 or not bounds[0] < bounds[1]:
        raise Refusal(
            f"{free.where(name)}: found {bounds!r}, expected two bounds such as [lower, upper]; a quantity without "
            "bounds cannot be free"
        )
    return float(bounds[0]), float(bounds[1])


def _aims(table: Table) -> tuple[str, ...]:
    for name, way in table.values.items():
        _known_response(table, name)
        expected = RESPONSES[name].aim
        if way != expected:
            raise Refusal(f"{table.where(name)}: found {way!r}, expected {expected!r}")
    if not table.values:
        raise Refusal(f"{table.file} [aims]: is empty, expected at least one of {', '.join(RESPONSES)}")
    return tuple(table.values)


def _known_response(table: Table, name: str) -> None:
    if name not in RESPONSES:
        raise Refusal(f"{table.where(name)}: unknown{expected_one_of(name, tuple(RESPONSES))}")


def _limits(table: Table) -> tuple[Limit, ...]:
    """Return the limits; a response may have a ``least`` and a ``most`` where it is a single number."""
    found = []
    for name, rule in table.values.items():
        _known_response(table, name)
        kinds = RESPONSES[name].limits
        if not isinstance(rule, dict) or not rule or not set(rule) <= set(kinds):
            raise Refusal(
                f"{table.where(name)}: found {rule!r}, expected {{ {kinds[0]} = number }}"
                + (f" (or {', '.join(kinds[1:])})" if kinds[1:] else "")
            )
        inner = Table(rule, table.file, f"{table.header} {name}")
        found += [Limit(name, kind, inner.value(Key(kind, "number", "the limit", band=ANY_SIZE))) for kind in rule]
    return tuple(found)


def _offset_fits(task: Task) -> None:
    """Refuse bounds within which the follower axis could pass beside the cam."""
    bounds = {variable.name: (variable.low, variable.high) for variable in task.variables}

    def bound(name: str, end: int) -> float:
        return bounds[name][end] if name in bounds else task.fixed[name]

    least = bound("base_circle_radius_mm", 0) + bound("roller_radius_mm", 0)
    largest = max(abs(bound("follower_offset_mm", end)) for end in (0, 1))
    if largest >= least:
        raise Refusal(
            f"{task.path} [free] follower_offset_mm: reaches {largest:g} mm, but base circle and roller may be as "
            f"small as {least:g} mm together, expected less than that; narrow the bounds"
        )


def _checked(task: Task) -> Task:
    """Return the task, or refuse what cannot be asked of it."""
    if task.choose not in (KNEE, *task.aims):
        raise Refusal(
            f"{task.path} [answer] choose: found {task.choose!r}, expected {KNEE!r} or one of the aims "
            f"({', '.join(task.aims)})"
        )
    _offset_fits(task)
    rough = {"friction_work_j"} & {*task.aims, *(limit.response for limit in task.limits)}
    if rough and not any(task.config.friction):
        raise Refusal(
            f"{task.path}: friction_work_j is asked for, but {task.config.path} has no [friction]; add it or "
            "take that of a fit (--from)"
        )
    if not task.variables and not any(family.size for family in task.families):
        raise Refusal(f"{task.path} [free]: nothing is free, expected bounds of at least one quantity")
    if np.isfinite(task.config.shaft_stiffness):
        raise Refusal(f"{task.config.path} [shaft]: found a stiffness, a design is made on a rigid shaft; leave it out")
    return task

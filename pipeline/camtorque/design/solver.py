"""Smallest greatest values under limits: one smooth programme per point of the front, solved by scipy's SLSQP.

The greatest value of an aim is a bound t_i on all of its values (the epigraph form), so that the corner where two peaks
are equally high is an ordinary vertex of smooth constraints. A point of the front is the design that comes closest,
along a fixed direction, to a reference point (Pascoletti & Serafini 1984)::

    min s + AUGMENT sum(t_i)   with   t_i - a_i <= s,   sign (f_i - z) <= t_i,   z <= lower values,   limits

Every limit is scaled by its size; the multipliers come from the stationarity of the same programme.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, nnls

from camtorque.design.problem import Problem, Values
from camtorque.design.responses import EQUAL, LEAST, MOST, RESPONSES
from camtorque.design.task import Limit
from camtorque.records import Array, ReadOnly

AUGMENT = 1.0e-4
"""Weight of the sum of all aims: what costs no other aim is taken along."""
Label = tuple[str, Limit | str]
"""What a constraint is of: its kind, and the limit or the name of aim or quantity that it belongs to."""


@dataclass(frozen=True)
class Block:
    """Some constraints: values (k,), slopes by the variables (k, n) and their factor, slope by other unknowns."""

    value: Array
    slope: Array
    factor: float
    others: Mapping[int, float]
    label: Label

    def rows(self, size: int, variables: int) -> Array:
        """Return the slopes by all unknowns, (k, size)."""
        rows = np.zeros((self.value.size, size))
        rows[:, :variables] = self.factor * self.slope
        for column, share in self.others.items():
            rows[:, column] = share
        return rows


@dataclass(frozen=True)
class Scale(ReadOnly):
    """Offset and width by which each aim is made 0 to 1; one value per aim, in its unit and with its sign."""

    offset: Array
    width: Array


def signs_of(problem: Problem) -> Array:
    """Return +1 for aims that are to be least, -1 for those to be most."""
    return np.array([1.0 if RESPONSES[name].aim == LEAST else -1.0 for name in problem.task.aims])


class Programme:
    """The constraints of a problem on the vector (variables, t of every aim, floors, s)."""

    def __init__(self, problem: Problem, scale: Scale, reference: Array | None, relaxed: bool = False) -> None:
        self.problem, self.scale, self.reference, self.relaxed = problem, scale, reference, relaxed
        parts = problem.values(problem.start())
        self.aims: tuple[str, ...] = () if relaxed else problem.task.aims
        ranges = [name for name in problem.names if RESPONSES[name].extreme == "range"]
        floors = [(name, k) for name in ranges for k in range(len(parts[name]) // 2)]
        self.floors = {floor: i for i, floor in enumerate(floors)}
        n, m = problem.size, len(self.aims)
        self.at_aims, self.at_floors = n, n + m
        self.size = n + m + len(self.floors) + 1
        self.floor_scale = {name: max(float(np.max(np.abs(parts[name][0]))), 1e-9) for name in ranges}

    def blocks(self, vector: Array, slopes: bool) -> tuple[list[Array], list[Array], list[Label]]:
        """Return what has to be 0 or more as (values, rows, labels); no rows without ``slopes``."""
        n = self.problem.size
        variables = np.ascontiguousarray(vector[:n])
        parts = self.problem.values(variables)
        tangents = self.problem.slopes(variables) if slopes else parts
        found = [*self._aims(vector, parts, tangents), *self._floors(vector, parts, tangents),
                 *self._limits(vector, parts, tangents)]  # fmt: skip
        rules = self.problem.shape_rules()
        found.append(Block(rules @ variables, rules, 1.0, {}, ("shape", "")))
        labels = [block.label for block in found for _ in range(block.value.size)]
        return [b.value for b in found], [b.rows(self.size, n) for b in found] if slopes else [], labels

    def _aims(self, vector: Array, parts: Values, tangents: Values) -> Iterator[Block]:
        """Yield that every value of an aim stays below its bound t, and t near the reference."""
        for i, (name, sign) in enumerate(zip(self.aims, signs_of(self.problem), strict=False)):
            width, offset, t = self.scale.width[i], self.scale.offset[i], vector[self.at_aims + i]
            for part, slope, others in self._leveled(name, vector, parts[name], tangents[name], sign / width):
                value = t - (sign * part - offset) / width
                yield Block(value, slope, -sign / width, {self.at_aims + i: 1.0, **others}, ("aim", name))
            if self.reference is not None:
                value = np.array([vector[-1] - t + self.reference[i]])
                others = {self.size - 1: 1.0, self.at_aims + i: -1.0}
                yield Block(value, np.zeros((1, self.problem.size)), 0.0, others, ("reference", name))

    def _floors(self, vector: Array, parts: Values, tangents: Values) -> Iterator[Block]:
        """Yield that the lower values of a range stay above its floor."""
        for (name, k), i in self.floors.items():
            share, at = self.floor_scale[name], self.at_floors + i
            value = parts[name][2 * k + 1] / share - vector[at]
            yield Block(value, tangents[name][2 * k + 1], 1.0 / share, {at: -1.0}, ("floor", name))

    def _limits(self, vector: Array, parts: Values, tangents: Values) -> Iterator[Block]:
        """Yield that every limit is kept, or missed by no more than s."""
        slack, shared = (vector[-1], {self.size - 1: 1.0}) if self.relaxed else (0.0, {})
        for limit in self.problem.limits:
            if limit.kind == EQUAL:
                continue
            sign, size, name = (1.0 if limit.kind == MOST else -1.0), limit.scale, limit.response
            for part, slope, others in self._leveled(name, vector, parts[name], tangents[name], sign / size):
                value = sign * (limit.value - part) / size + slack
                yield Block(value, slope, -sign / size, {**shared, **others}, ("limit", limit))

    def _leveled(
        self, name: str, vector: Array, parts: tuple[Array, ...], tangents: tuple[Array, ...], scale: float
    ) -> Iterator[tuple[Array, Array, dict[int, float]]]:
        """Yield the values that a level bounds, less their floor, their slopes, and the slope by that floor."""
        if RESPONSES[name].extreme != "range":
            yield parts[0], tangents[0], {}
            return
        for k in range(len(parts) // 2):
            floor, share = self.at_floors + self.floors[name, k], self.floor_scale[name]
            yield parts[2 * k] - vector[floor] * share, tangents[2 * k], {floor: share * scale}

    def equalities(self, vector: Array, slopes: bool) -> Array:
        """Return what has to be 0: the limits of kind ``equal``, values or rows."""
        variables = np.ascontiguousarray(vector[: self.problem.size])
        found = []
        for limit in self.problem.limits:
            if limit.kind != EQUAL:
                continue
            if slopes:
                row = np.zeros((1, self.size))
                row[:, : self.problem.size] = self.problem.slopes(variables)[limit.response][0] / limit.scale
                found.append(row)
            else:
                found.append((self.problem.values(variables)[limit.response][0] - limit.value) / limit.scale)
        return np.concatenate(found) if found else np.zeros((0, self.size) if slopes else 0)

    def objective(self) -> Array:
        """Return the gradient of the objective, which is linear."""
        gradient = np.zeros(self.size)
        gradient[self.at_aims : self.at_floors] = AUGMENT
        if self.reference is not None or self.relaxed:
            gradient[-1] = 1.0
        return gradient

    def first(self, variables: Array) -> Array:
        """Return the vector of some variables, everything else where it just fits."""
        vector = np.zeros(self.size)
        vector[: self.problem.size] = variables
        parts = self.problem.values(variables)
        for (name, k), i in self.floors.items():
            vector[self.at_floors + i] = np.min(parts[name][2 * k + 1]) / self.floor_scale[name]
        if self.aims:
            vector[self.at_aims : self.at_floors] = scaled_aims(self.problem, self.scale, variables)
        if self.reference is not None:
            vector[-1] = np.max(vector[self.at_aims : self.at_floors] - self.reference)
        if self.relaxed:
            vector[-1] = max(violation(self.problem, variables), 0.0)
        return vector

    def bounds(self) -> list[tuple[float | None, float | None]]:
        """Return the bounds of the vector."""
        free: list[tuple[float | None, float | None]] = [(0.0, 1.0)] * self.problem.size
        rest: list[tuple[float | None, float | None]] = [(None, None)] * (self.size - self.problem.size - 1)
        return [*free, *rest, (0.0, None) if self.relaxed else (None, None)]


def scaled_aims(problem: Problem, scale: Scale, variables: Array) -> Array:
    """Return the aims of a design, 0 to 1 between ideal and worst."""
    design = problem.evaluated(variables)
    values = np.array([RESPONSES[name].value(design) for name in problem.task.aims])
    return (signs_of(problem) * values - scale.offset) / scale.width


def violation(problem: Problem, variables: Array) -> float:
    """Return the greatest scaled violation of any limit, 0 where all are kept."""
    design = problem.evaluated(variables)
    misses = [limit.missed_by(RESPONSES[limit.response].value(design)) / limit.scale for limit in problem.limits]
    return max([0.0, *misses])


FEASIBLE = 1.0e-5
"""Scaled violation below which a limit is kept."""
ITERATIONS, TOLERANCE = 30, 1.0e-6
"""Of a point of the front: tighter ones cost five times as much and move it by 1e-5 of the front."""
END_ITERATIONS, END_TOLERANCE = 150, 1.0e-8
"""Of the best design of one aim: the corners of the front carry all the others."""
ACTIVE = 1.0e-4


@dataclass(frozen=True)
class Solution(ReadOnly):
    """One solved programme: variables, scaled aims and scaled violation."""

    variables: Array
    aims: Array
    violation: float

    @property
    def feasible(self) -> bool:
        """Whether every limit is kept."""
        return self.violation <= FEASIBLE


def reached(problem: Problem, scale: Scale, variables: Array) -> Solution:
    """Return some variables with what their design reaches."""
    return Solution(variables, scaled_aims(problem, scale, variables), violation(problem, variables))


def solve(
    problem: Problem, scale: Scale, start: Array, *, single: int | None = None, reference: Array | None = None,
    relaxed: bool = False,
) -> Solution:  # fmt: skip
    """Return the solution of one programme from a start.

    It is asked for by ``single``, the index of the only aim that counts; or by ``reference`` (m,), the point to be
    approached; or ``relaxed`` for the least violation of the limits.
    """
    programme = Programme(problem, scale, reference, relaxed)
    gradient, between = programme.objective(), reference is not None
    if single is not None:
        gradient[programme.at_aims + single] = 1.0
    constraints = [{
        "type": "ineq",
        "fun": lambda v: np.concatenate(programme.blocks(v, False)[0]),
        "jac": lambda v: np.concatenate(programme.blocks(v, True)[1]),
    }]  # fmt: skip
    if any(limit.kind == EQUAL for limit in problem.limits):
        constraints.append({
            "type": "eq",
            "fun": lambda v: programme.equalities(v, False),
            "jac": lambda v: programme.equalities(v, True),
        })  # fmt: skip
    found = minimize(
        lambda v: float(gradient @ v), programme.first(np.clip(start, 0.0, 1.0)), jac=lambda v: gradient,
        bounds=programme.bounds(), constraints=constraints, method="SLSQP",
        options={"maxiter": ITERATIONS if between else END_ITERATIONS, "ftol": TOLERANCE if between else END_TOLERANCE},
    )  # fmt: skip
    return reached(problem, scale, np.clip(np.nan_to_num(found.x[: problem.size]), 0.0, 1.0))


def multipliers(problem: Problem, scale: Scale, variables: Array, reference: Array | None, relaxed: bool = False
                ) -> Mapping[Label, float]:  # fmt: skip
    """Return the multipliers of everything that is active at a solution; bounds are ``lower`` and ``upper``.

    Non-negative least squares of the objective's gradient on those of the active constraints. `AUGMENT` is left out: in
    the scale of an aim that hardly changes along the front it would be the price of that aim.
    """
    programme = Programme(problem, scale, reference, relaxed)
    vector = programme.first(variables)
    values, rows, labels = programme.blocks(vector, True)
    slack, jacobian = np.concatenate(values), np.concatenate(rows)
    near = slack < ACTIVE
    columns = [jacobian[near].T]
    signed: list[tuple[Label, float]] = [(label, 1.0) for label, active in zip(labels, near, strict=True) if active]
    equal = programme.equalities(vector, True)
    columns += [equal.T, -equal.T]
    signed += [(("limit", limit), sign) for sign in (1.0, -1.0) for limit in problem.limits if limit.kind == EQUAL]
    for k in range(problem.size):
        name = problem.task.variables[k].name if k < problem.low.size else "shape"
        for side, sign, at_bound in (("lower", 1.0, variables[k] < ACTIVE), ("upper", -1.0, variables[k] > 1 - ACTIVE)):
            if at_bound:
                unit = np.zeros((programme.size, 1))
                unit[k] = sign
                columns.append(unit)
                signed.append(((side, name), 1.0))
    gradient = programme.objective()
    gradient[programme.at_aims : programme.at_floors] = 0.0
    weights, _ = nnls(np.concatenate(columns, axis=1), gradient)
    found: dict[Label, float] = {}
    for (label, sign), weight in zip(signed, weights, strict=True):
        if weight > 0.0:
            found[label] = found.get(label, 0.0) + sign * weight
    return found

"""A problem under users' ties: chain rule through the expressions, the untouched linear parameters still eliminated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import lmfit
import numpy as np

from camtorque.fit.full_space import FullPoint, as_solution, full_jacobian, full_limits, full_point, full_rows
from camtorque.fit.levenberg import Rule, covariance_of, minimise
from camtorque.fit.lmfit_names import lmfit_name, lmfit_names
from camtorque.fit.problem import Problem
from camtorque.fit.solve import Solution, try_at
from camtorque.fit.ties import Ties
from camtorque.records import Array

TIED_RULE = Rule()


@dataclass(frozen=True)
class TiedProblem:
    """A problem whose named parameters follow free ones through expressions.

    Attributes
    ----------
    problem, ties : the problem, and what follows what
    outer : free names that are searched: the non-linear ones, those in ties, and those that users added
    start : (n_free,) values of all free names [unit of the report]
    """

    problem: Problem
    ties: Ties
    outer: tuple[str, ...]
    start: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the problem's parameters, in order."""
        return tuple(lmfit_names(self.problem).values())

    def point(self, u: Array) -> FullPoint:
        """Return the problem at values of the outer names, (n_outer,), with the best of the other linear ones."""
        values = self.ties.values(self.free_values(u))
        rows = self.problem.nonlinear
        x = np.array([values[lmfit_name(slot.name)] * slot.row.per_unit for slot in rows])
        return full_point(self.problem, try_at(self.pinned(values), x))

    def pinned(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with the linear parameters that take part in ties held at their values."""
        inner = self.inner_names()
        slots = []
        for slot in self.problem.linear:
            name = lmfit_name(slot.name)
            value = values[name] * slot.row.per_unit
            row = slot.row if name in inner else replace(slot.row, start=value, lower=value, upper=value)
            slots.append(replace(slot, row=row))
        return replace(self.problem, linear=tuple(slots))

    def inner_names(self) -> frozenset[str]:
        """Return the names of the linear parameters that are eliminated."""
        linear = {lmfit_name(slot.name) for slot in self.problem.linear}
        return frozenset(linear & set(self.ties.free) - set(self.outer))

    def free_values(self, u: Array) -> Array:
        """Return values of all free names for those of the outer ones."""
        given = dict(zip(self.outer, u, strict=True))
        return np.array([given.get(name, value) for name, value in zip(self.ties.free, self.start, strict=True)])

    def jacobian(self, point: FullPoint, u: Array) -> Array:
        """Return d(residual)/d[free names, lift coefficients] (m, n_free + n_lift), lift in units of its steps."""
        slopes, count = self.ties.slopes(self.free_values(u)), len(self.names)
        rows = [slopes.get(name, np.zeros(len(self.ties.free))) for name in self.names]
        per = np.array([row.per_unit for row in full_rows(self.problem)])
        full = full_jacobian(self.problem, point)
        lift = full_limits(self.problem).steps[count:]
        return np.column_stack([full[:, :count] @ (np.array(rows) * per[:, None]), full[:, count:] * lift])

    def projected(self, u: Array) -> Array:
        """Return the derivative with respect to the outer names with the eliminated directions taken out."""
        point = self.point(u)
        matrix = self.jacobian(point, u)
        outer = np.array([self.ties.free.index(name) for name in self.outer], dtype=int)
        columns, inner = matrix[:, outer], matrix[:, self.moving(point)]
        norms = np.linalg.norm(inner, axis=0)
        basis = np.linalg.qr(inner[:, norms > 0.0] / norms[norms > 0.0])[0]
        return columns - basis @ (basis.T @ columns)

    def moving(self, point: FullPoint) -> Array:
        """Return the columns of eliminated parameters that are inside their bounds, as indices."""
        limits, count = full_limits(self.problem), len(self.names)
        inside = (point.z > limits.lower) & (point.z < limits.upper)
        inner = self.inner_names()
        named = [self.ties.free.index(name) for k, name in enumerate(self.names) if name in inner and inside[k]]
        return np.r_[named, len(self.ties.free) + np.flatnonzero(inside[count:])].astype(np.intp)


def tied_problem(problem: Problem, params: lmfit.Parameters, ties: Ties) -> TiedProblem:
    """Return a problem with the ties of a user's parameters."""
    in_ties = set(ties.tied) | {name for names in ties.needs.values() for name in names}
    linear = {lmfit_name(slot.name) for slot in problem.linear}
    outer = tuple(name for name in ties.free if name not in linear or name in in_ties)
    return TiedProblem(problem, ties, outer, np.array([float(params[name].value) for name in ties.free]))


def tied_minimum(tied: TiedProblem, lower: Array, upper: Array) -> tuple[Array, Array, FullPoint, Solution]:
    """Return values and covariance of all free names [units of the report], the point and it as a solution.

    ``lower`` and ``upper`` bound all free names, (n_free,).
    """
    outer = np.array([tied.ties.free.index(name) for name in tied.outer], dtype=int)
    found = minimise(
        lambda u: tied.point(u).vector, tied.projected, tied.start[outer], lower[outer], upper[outer], TIED_RULE
    )
    point = tied.point(found.x)
    values = tied.free_values(found.x)
    for k, (name, row) in enumerate(zip(tied.names, full_rows(tied.problem), strict=True)):
        if name in tied.inner_names():
            values[tied.ties.free.index(name)] = point.z[k] / row.per_unit
    limits, count = full_limits(tied.problem), len(tied.names)
    lift = (point.z > limits.lower)[count:] & (point.z < limits.upper)[count:]
    inside = np.r_[(values > lower) & (values < upper), lift]
    n_free = values.size
    covariance = covariance_of(tied.jacobian(point, found.x), inside)[:n_free, :n_free]
    cost = (found.iterations, found.evaluations)
    full = full_jacobian(tied.problem, point)
    return values, covariance, point, as_solution(tied.problem, point, full, cost, found.converged)

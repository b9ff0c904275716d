"""Smallest greatest values under limits: one smooth programme per point of the front, solved by scipy's SLSQP.

The greatest value of an aim is a bound t_i on all of its values (the epigraph form), so that the corner where two peaks
are equally high is an ordinary vertex of smooth constraints. A point of the front is the design that comes closest,
along a fixed direction, to a reference point (Pascoletti & Serafini 1984)::

    min s + AUGMENT sum(t_i)   with   t_i - a_i <= s,   sign (f_i - z) <= t_i,   z <= lower values,   limits

Every limit is scaled by its size; the multipliers come from the stationarity of the same programme.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, nnls

from camtorque.design.problem import Problem
from camtorque.design.programme import Label, Programme, Scale, scaled_aims, violation
from camtorque.design.responses import EQUAL
from camtorque.records import Array, ReadOnly

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


def solve(
    problem: Problem, scale: Scale, start: Array, *, single: int | None = None, reference: Array | None = None,
    relaxed: bool = False,
) -> Solution:  # fmt: skip
    """Return the solution of one programme from a start.

    Parameters
    ----------
    single : index of the only aim that counts; or ``reference`` (m,), the point to be approached; or ``relaxed`` for
        the least violation of the limits
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
    variables = np.clip(np.nan_to_num(found.x[: problem.size]), 0.0, 1.0)
    return Solution(variables, scaled_aims(problem, scale, variables), violation(problem, variables))


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

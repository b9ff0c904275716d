"""Minimum, covariance and model spread -> the parameters as they are reported."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.effects import EFFECT_OF
from pipeline.effects.rows import ParameterRow
from pipeline.fit.problem import Problem, Slot
from pipeline.fit.solve import Solution
from pipeline.fit.uncertainty import (
    PRIOR_DOMINATED,
    Covariance,
    at_bounds,
    confounded_with,
    parameter_values,
)
from pipeline.records import Array, Finding, ParameterEstimate

COVERAGE = 1.96
LIFT_NAME = "lift_correction_max"
PULLED = 2.0
"""A prior that is left by more than this many standard deviations is a finding."""


def estimates(problem: Problem, solution: Solution, cov: Covariance, spreads: Array) -> tuple[ParameterEstimate, ...]:
    """Return every free parameter with statistical and total uncertainty, in the unit of its row."""
    values = parameter_values(problem, solution)
    bound = at_bounds(problem, solution)
    statistical = np.sqrt(np.maximum(np.diag(cov.matrix), 0.0))
    result = []
    for index, slot in enumerate((*problem.nonlinear, *problem.linear)):
        total = float(np.hypot(statistical[index], spreads[index]))
        result.append(
            _estimate(slot, float(values[index]), float(statistical[index]), total, bool(bound[index]), cov, index)
        )
    if problem.n_lift:
        result.append(_lift_estimate(problem, solution))
    return tuple(result)


def _estimate(
    slot: Slot, value: float, statistical: float, total: float, bound: bool, cov: Covariance, index: int
) -> ParameterEstimate:
    row = slot.row
    per = row.per_unit
    low, high = _interval(row, value, total, bound)
    told = row.prior is None or statistical < PRIOR_DOMINATED * row.prior[1]
    confounded = confounded_with(cov, index)
    return ParameterEstimate(
        name=slot.name, value=value / per, unit=row.unit, stderr=total / per, stderr_statistical=statistical / per,
        ci95=(low / per, high / per), at_bound=bound, identifiable=bool(told and not bound and not confounded),
        confounded_with=confounded, prior=None if row.prior is None else (row.prior[0] / per, row.prior[1] / per),
        meaning=row.meaning, source=row.source, role=row.role, effect=EFFECT_OF[row.name], symbol=row.symbol,
    )  # fmt: skip


def _interval(row: ParameterRow, value: float, total: float, bound: bool) -> tuple[float, float]:
    """Return the 95 % interval inside the bounds; at a bound it is one-sided, from the bound inwards."""
    width = total if total > 0.0 else row.step
    low, high = value - COVERAGE * width, value + COVERAGE * width
    if bound:
        low, high = (value, value + COVERAGE * width) if value <= row.lower + row.step else (low, value)
    return max(low, row.lower), min(high, row.upper)


def _lift_estimate(problem: Problem, solution: Solution) -> ParameterEstimate:
    basis = problem.data[0].chain.lift_basis
    assert basis is not None
    lift = solution.c[len(problem.linear) :] * 1e6
    largest = float(np.max(np.abs(lift)))
    bound = basis.bound * 1e6
    return ParameterEstimate(
        LIFT_NAME, largest, "um", basis.prior_std * 1e6, basis.prior_std * 1e6, (0.0, bound), largest >= bound * 0.999,
        True, (), (0.0, basis.prior_std * 1e6),
        f"largest of {lift.size} coefficients of the lift correction (rms {np.std(lift):.2f} um), each within the "
        "table's resolution", "lift table: resolution and scatter", "shared", "lift", "dy",
    )  # fmt: skip


def prior_findings(parameters: Sequence[ParameterEstimate]) -> tuple[Finding, ...]:
    """Return a finding for every parameter that the data pull more than two standard deviations off its prior."""
    result = []
    for parameter in parameters:
        if parameter.prior is None or parameter.name == LIFT_NAME:
            continue
        pull = (parameter.value - parameter.prior[0]) / parameter.prior[1]
        if abs(pull) > PULLED:
            text = (
                f"{parameter.name} is {parameter.value:.4g} {parameter.unit}, {pull:+.1f} standard deviations off what "
                f"was expected ({parameter.prior[0]:.4g} +- {parameter.prior[1]:.2g}): a law may be missing"
            )
            result.append(Finding("prior_pulled", "warning", text, parameter.name))
        if parameter.at_bound:
            text = (
                f"{parameter.name} sits at its bound, {parameter.value:.4g} {parameter.unit}; its interval is one-sided"
            )
            result.append(Finding("parameter_at_bound", "info", text, parameter.name))
    return tuple(result)

"""Where the uncertainty of each parameter comes from: recording, certificates, sheets, literature, model (GUM, 5.1.2).

At the minimum the estimate is a linear combination of what the data and every prior say,
``x = C (H_data x_data + P m)``, so the variance splits exactly: ``C = C H_data C + sum_j C P_j C``. The gain of the
pressure has no parameter of its own; its share is the shift of the minimum when all pressures are scaled by one
standard uncertainty of the certificate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.many import minimise
from camtorque.fit.problem import Problem
from camtorque.fit.solve import Solution, linear_steps
from camtorque.fit.uncertainty import (
    VARIANT_ITERATIONS,
    VARIANT_TOLERANCE,
    Covariance,
    free_parameters,
    inverse_over,
    parameter_names,
    parameter_values,
)
from camtorque.records import Array

RECORDING, LITERATURE, LIFT, PRESSURE_GAIN, MODEL = (
    "the recording itself", "literature", "lift table", "pressure gain", "model spread",
)  # fmt: skip
SOURCE_OF_PRIOR: dict[str, str] = {
    "gain_error": "torque gain",
    "torque_zero": "torque zero",
    "delay_error": "torque delay and low-pass",
    "cutoff": "torque delay and low-pass",
    "filter_damping": "torque delay and low-pass",
    "pressure_zero": "pressure zero",
    "trigger_offset": "trigger mounting",
    "spring_stiffness_error": "spring catalogue",
    "spring_preload_error": "spring catalogue",
}
"""Parameter -> source of its prior; a prior that is not here comes from the literature."""
SOURCES = (RECORDING, *dict.fromkeys(SOURCE_OF_PRIOR.values()), PRESSURE_GAIN, LITERATURE, LIFT, MODEL)


@dataclass(frozen=True)
class BudgetRow:
    """Standard uncertainty of one parameter by source, in the unit of the report; their squares sum to the total's."""

    name: str
    unit: str
    contributions: Mapping[str, float]

    @property
    def total(self) -> float:
        """Total standard uncertainty."""
        return float(np.sqrt(sum(value**2 for value in self.contributions.values())))


def pressure_gain_shift(problem: Problem, solution: Solution, relative_std: float) -> Array:
    """Return how far every parameter moves with the gain of the line pressure, (k,) [SI].

    Parameters
    ----------
    relative_std : relative standard uncertainty of the gain, by its certificate; all recordings share the sensor
    """
    if not relative_std > 0.0:
        return np.zeros(len(parameter_names(problem)))
    data = tuple(
        replace(item, chain=replace(item.chain, line_pressure=item.chain.line_pressure * (1.0 + relative_std)))
        for item in problem.data
    )
    moved = replace(problem, data=data)
    found = minimise(moved, solution.x, VARIANT_ITERATIONS, VARIANT_TOLERANCE)
    return np.abs(parameter_values(moved, found) - parameter_values(problem, solution))


def uncertainty_budget(
    problem: Problem, solution: Solution, cov: Covariance, spreads: Array, gain_shift: Array
) -> tuple[BudgetRow, ...]:
    """Return the budget of every free parameter.

    Parameters
    ----------
    problem, solution, cov : the chosen model, its minimum and covariance
    spreads : (k,) all that is not statistical, ``gain_shift`` included [SI]
    gain_shift : (k,) by `pressure_gain_shift` [SI]
    """
    slots = (*problem.nonlinear, *problem.linear)
    steps = np.r_[[slot.row.step for slot in problem.nonlinear], linear_steps(problem)]
    prior = np.diag(solution.hessian - solution.data_hessian)
    data = solution.data_hessian / cov.inflation
    inverse = inverse_over(data + np.diag(prior), free_parameters(problem, solution))
    per_prior = inverse**2 * prior
    by_source = {RECORDING: np.einsum("ij,jk,ik->i", inverse, data, inverse)}
    for j in range(steps.size):
        source = SOURCE_OF_PRIOR.get(slots[j].row.name, LITERATURE) if j < len(slots) else LIFT
        by_source[source] = by_source.get(source, 0.0) + per_prior[:, j]
    model = np.sqrt(np.maximum(spreads**2 - gain_shift**2, 0.0))
    rows = []
    for i, slot in enumerate(slots):
        parts = {name: float(np.sqrt(max(by_source[name][i], 0.0))) * steps[i] for name in SOURCES if name in by_source}
        parts = {**parts, PRESSURE_GAIN: float(gain_shift[i]), MODEL: float(model[i])}
        rows.append(BudgetRow(slot.name, slot.row.unit, {k: v / slot.row.per_unit for k, v in parts.items()}))
    return tuple(rows)

"""What users meet: a problem as `lmfit.Parameters`, and the package's solver behind `minimize`.

Values and bounds are in the unit of the report (``user_data.unit``), so that a line of `lmfit.fit_report` is a line of
the report. Users fix a parameter (``vary=False``), move bounds, tie it by ``expr``, or put a changed row into
``user_data`` (another prior). The weights come from measured scatter, so standard errors are not scaled by the misfit
unless asked for (lmfit's own default hides a wrong sigma).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import lmfit
import numpy as np
from lmfit.minimizer import MinimizerResult

from pipeline.effects.rows import ParameterRow
from pipeline.fit.full_space import (
    FullPoint,
    as_solution,
    evaluate_full,
    full_jacobian,
    full_limits,
    full_rows,
    full_values,
)
from pipeline.fit.levenberg import Rule, covariance_of, finite_jacobian, free_inverse, minimise
from pipeline.fit.lmfit_result import Outcome, lmfit_result
from pipeline.fit.prepare import CORRELATION
from pipeline.fit.problem import Problem, Slot
from pipeline.fit.solve import Solution, linear_steps, solve
from pipeline.fit.ties import Ties, ties_of
from pipeline.records import Array

TIED_RULE = Rule(max_iterations=80)


def lmfit_names(problem: Problem) -> dict[str, str]:
    """Return label -> name that lmfit accepts: characters outside ``[A-Za-z0-9_]`` become ``_``.

    Raises
    ------
    ValueError
        When two recordings' own parameters would get the same name.
    """
    labels = [slot.name for slot in (*problem.nonlinear, *problem.linear)]
    names = {label: re.sub(r"\W", "_", label, flags=re.ASCII) for label in labels}
    if len(set(names.values())) != len(labels):
        raise ValueError("two recordings differ only in characters that lmfit does not allow; rename one of them")
    return names


def to_lmfit(problem: Problem) -> lmfit.Parameters:
    """Return the free parameters of a problem in the units of the report; ``user_data`` holds the row of each."""
    params = lmfit.Parameters()
    names = lmfit_names(problem)
    for slot in (*problem.nonlinear, *problem.linear):
        row, per = slot.row, slot.row.per_unit
        pinned = row.lower == row.upper
        params.add(
            names[slot.name], value=row.start / per, vary=not pinned, min=-np.inf if pinned else row.lower / per,
            max=np.inf if pinned else row.upper / per,
        )  # fmt: skip
        params[names[slot.name]].user_data = row
    return params


def from_lmfit(problem: Problem, params: lmfit.Parameters) -> Problem:
    """Return the problem with starts, bounds, fixed values and priors as the parameters say.

    A fixed parameter stays in its place with equal bounds. Ties are not part of a `Problem`; `minimize` follows them.

    Raises
    ------
    KeyError
        When a parameter is missing or does not belong to the problem.
    ValueError
        When a bound leaves the range that the law allows.
    """
    names = lmfit_names(problem)
    missing = set(names.values()) - set(params)
    if missing:
        raise KeyError(f"parameters {sorted(missing)} are missing; start from to_lmfit(problem)")
    return replace(problem, nonlinear=_slots(problem.nonlinear, params), linear=_slots(problem.linear, params))


def _slots(slots: tuple[Slot, ...], params: lmfit.Parameters) -> tuple[Slot, ...]:
    return tuple(
        replace(slot, row=_row(slot.row, params[re.sub(r"\W", "_", slot.name, flags=re.ASCII)])) for slot in slots
    )


def _row(row: ParameterRow, parameter: lmfit.Parameter) -> ParameterRow:
    """Return a row as one parameter says."""
    given = parameter.user_data if isinstance(parameter.user_data, ParameterRow) else row
    per, value = row.per_unit, float(parameter.value) * row.per_unit
    margin = 1e-9 * row.step
    if not row.lower - margin <= value <= row.upper + margin:
        raise ValueError(f"{row.name}: {parameter.value} {row.unit} is outside [{row.lower / per}, {row.upper / per}]")
    value = min(max(value, row.lower), row.upper)
    if not parameter.vary and not parameter.expr:
        return replace(given, start=value, lower=value, upper=value)
    # an infinite bound is no wish: the law keeps its own
    lower = max(parameter.min * per, row.lower) if np.isfinite(parameter.min) else row.lower
    upper = min(parameter.max * per, row.upper) if np.isfinite(parameter.max) else row.upper
    return replace(given, start=min(max(value, lower), upper), lower=lower, upper=upper)


def minimize(problem: Problem, params: lmfit.Parameters | None = None, scale_covar: bool = False) -> MinimizerResult:
    """Return the fit of a problem as lmfit's result, with the package's own `Solution` as ``result.solution``.

    Parameters
    ----------
    problem : what to fit
    params : as changed by the user; `to_lmfit` of the problem by default. Further parameters may be added (with
        ``params.add``) and used in ties.
    scale_covar : True scales the covariance by the reduced chi-square

    Notes
    -----
    ``residual`` holds the weighted residuals and those of the priors; ``nfree`` counts independent residuals, since
    neighbouring bins repeat each other. Lift coefficients are fitted and counted, but have no name of their own.
    """
    params = to_lmfit(problem) if params is None else params
    changed = from_lmfit(problem, params)
    ties = ties_of(params)
    if ties.tied or set(ties.free) - set(lmfit_names(problem).values()):
        outcome, solution = _tied(changed, params, ties)
    else:
        outcome, solution = _untied(changed, ties)
    result = lmfit_result(params, ties, outcome, scale_covar)
    result.problem, result.solution = changed, solution
    return result


def _per_unit(problem: Problem) -> Array:
    return np.array([row.per_unit for row in full_rows(problem)])


def _untied(problem: Problem, ties: Ties) -> tuple[Outcome, Solution]:
    """Return the minimum of the solver and its covariance in the units of the report."""
    solution = solve(problem)
    per, z, limits = _per_unit(problem), full_values(solution), full_limits(problem)
    inside = (z > limits.lower) & (z < limits.upper)
    steps = np.r_[[slot.row.step for slot in problem.nonlinear], linear_steps(problem)]
    count = per.size
    matrix = free_inverse(solution.hessian, inside)[:count, :count] * np.outer(steps[:count], steps[:count])
    names = list(lmfit_names(problem).values())
    order = [names.index(name) for name in ties.free]
    covariance = (matrix / np.outer(per, per))[np.ix_(order, order)]
    values = (z[:count] / per)[order]
    point = evaluate_full(problem, z)
    return _outcome(problem, values, covariance, point, solution), solution


def _outcome(problem: Problem, values: Array, covariance: Array, point: FullPoint, solution: Solution) -> Outcome:
    n_bins = sum(item.torque.size for item in problem.data)
    n_priors = point.vector.size - n_bins
    return Outcome(
        values, covariance, point.vector, point.chi_square, n_bins / CORRELATION + n_priors, solution.evaluations,
        "separable least squares", "converged" if solution.converged else "iterations ran out", solution.converged,
        problem.n_lift,
    )  # fmt: skip


def _tied(problem: Problem, params: lmfit.Parameters, ties: Ties) -> tuple[Outcome, Solution]:
    """Return the minimum under ties: free parameters [unit of the report] and lift coefficients, chain rule."""
    names, per = list(lmfit_names(problem).values()), _per_unit(problem)
    limits, n_free = full_limits(problem), len(ties.free)
    lift = limits.steps[len(names) :]

    def z_of(u: Array) -> Array:
        values = ties.values(u[:n_free])
        return np.r_[np.array([values[name] for name in names]) * per, u[n_free:] * lift]

    def jacobian(u: Array) -> Array:
        slopes = ties.slopes(u[:n_free])
        slope = np.array([slopes.get(name, np.zeros(n_free)) for name in names]) * per[:, None]
        full = full_jacobian(problem, evaluate_full(problem, z_of(u)))
        return np.column_stack([full[:, : len(names)] @ slope, full[:, len(names) :] * lift])

    lower, upper = _bounds(problem, params, ties)
    start = np.r_[[float(params[name].value) for name in ties.free], np.zeros(lift.size)]
    found = minimise(lambda u: evaluate_full(problem, z_of(u)).vector, jacobian, start, lower, upper, TIED_RULE)
    point = evaluate_full(problem, z_of(found.x))
    inside = (found.x > lower) & (found.x < upper)
    covariance = covariance_of(finite_jacobian(jacobian, found.x), inside)[:n_free, :n_free]
    cost = (found.iterations, found.evaluations)
    solution = as_solution(problem, point, full_jacobian(problem, point), cost, found.converged)
    return _outcome(problem, found.x[:n_free], covariance, point, solution), solution


def _bounds(problem: Problem, params: lmfit.Parameters, ties: Ties) -> tuple[Array, Array]:
    """Return bounds of the free parameters [unit of the report], then of the scaled lift coefficients."""
    labels: Mapping[str, str] = {name: label for label, name in lmfit_names(problem).items()}
    rows = {slot.name: slot.row for slot in (*problem.nonlinear, *problem.linear)}
    lower, upper = [], []
    for name in ties.free:
        row = rows.get(labels.get(name, ""))
        lower.append(row.lower / row.per_unit if row else params[name].min)
        upper.append(row.upper / row.per_unit if row else params[name].max)
    limits, count = full_limits(problem), len(labels)
    steps = limits.steps[count:]
    return np.r_[lower, limits.lower[count:] / steps], np.r_[upper, limits.upper[count:] / steps]

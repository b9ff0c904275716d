"""What users meet: a problem as `lmfit.Parameters`, and the package's solver behind `minimize`.

Values and bounds are in the unit of the report (``user_data.unit``), so that a line of `lmfit.fit_report` is a line of
the report. Users fix a parameter (``vary=False``), move bounds, tie it by ``expr``, or put a changed row into
``user_data`` (another prior). The weights come from measured scatter, so standard errors are not scaled by the misfit
unless asked for (lmfit's own default hides a wrong sigma).
"""

from __future__ import annotations

from dataclasses import replace

import lmfit
import numpy as np
from lmfit.minimizer import MinimizerResult

from camtorque.fit.full_space import FullPoint, evaluate_full, full_limits, full_rows, full_values
from camtorque.fit.levenberg import free_inverse
from camtorque.fit.lmfit_names import lmfit_name, lmfit_names
from camtorque.fit.lmfit_result import Outcome, lmfit_result
from camtorque.fit.prepare import CORRELATION
from camtorque.fit.problem import Problem, Slot
from camtorque.fit.solve import Solution, solve
from camtorque.fit.tied import tied_minimum, tied_problem
from camtorque.fit.ties import Ties, ties_of
from camtorque.laws.rows import ParameterRow
from camtorque.records import Array


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
    return tuple(replace(slot, row=_row(slot.row, params[lmfit_name(slot.name)])) for slot in slots)


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
    count, steps = per.size, limits.steps[: per.size]
    matrix = free_inverse(solution.hessian, inside)[:count, :count] * np.outer(steps, steps)
    names = list(lmfit_names(problem).values())
    order = [names.index(name) for name in ties.free]
    covariance = (matrix / np.outer(per, per))[np.ix_(order, order)]
    values = (z[:count] / per)[order]
    point = evaluate_full(problem, z)
    return outcome_of(problem, values, covariance, point, solution), solution


def outcome_of(problem: Problem, values: Array, covariance: Array, point: FullPoint, solution: Solution) -> Outcome:
    """Return a minimum as lmfit's result needs it; correlated bins count as fewer independent residuals."""
    n_bins = sum(item.torque.size for item in problem.data)
    n_priors = point.vector.size - n_bins
    return Outcome(
        values, covariance, point.vector, point.chi_square, n_bins / CORRELATION + n_priors, solution.evaluations,
        "least_squares", "converged" if solution.converged else "ended before a minimum", solution.converged,
        problem.n_lift,
    )  # fmt: skip


def _tied(problem: Problem, params: lmfit.Parameters, ties: Ties) -> tuple[Outcome, Solution]:
    """Return the minimum under ties and its covariance in the units of the report."""
    rows = {lmfit_name(slot.name): slot.row for slot in (*problem.nonlinear, *problem.linear)}
    bounds = []
    for name in ties.free:
        row = rows.get(name)
        bounds.append(
            (row.lower / row.per_unit, row.upper / row.per_unit) if row else (params[name].min, params[name].max)
        )
    lower, upper = np.array(bounds, dtype=float).T
    values, covariance, point, solution = tied_minimum(tied_problem(problem, params, ties), lower, upper)
    return outcome_of(problem, values, covariance, point, solution), solution

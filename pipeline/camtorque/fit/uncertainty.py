"""How sure: covariance, spread over plausible models, and which parameters the data cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from camtorque.fit.delivery import DISTRUSTED, drop_torque, with_valve_error
from camtorque.fit.many import minimise
from camtorque.fit.prepare import CORRELATION
from camtorque.fit.problem import FitData, Problem, build_problem
from camtorque.fit.solve import Solution, linear_steps
from camtorque.records import Array, freeze_arrays

WEAK_PRIOR = 1.0e-4
"""Share of the priors' weight that is left when the data are asked what they alone can tell."""
CONFOUNDED = 0.95
PRIOR_DOMINATED = 0.8
"""Posterior over prior standard deviation above which the data have said next to nothing."""
CONTROLLER = 2.0 * np.pi * 8.0
"""Frequency of a drive on its speed controller where the data have not told it [rad/s]."""
PORT_FACTOR = 3.0
"""Area per lift of the inlet port in the variant that closes it faster: ports are round, the law is straight."""
VARIANT_ITERATIONS = 25
VARIANT_TOLERANCE = 1.0e-5


@dataclass(frozen=True)
class Covariance:
    """Uncertainty of all free parameters, non-linear first, then linear; lift coefficients left out.

    Attributes
    ----------
    names : (k,) labels
    matrix : (k, k) statistical covariance [SI]
    correlation : (k, k) with priors
    data_correlation : (k, k) of what the data alone tell
    data_deviation : (k,) standard errors that the data alone would leave [SI]
    inflation : factor on the variances because the residual exceeds what the weights admit
    """

    names: tuple[str, ...]
    matrix: Array
    correlation: Array
    data_correlation: Array
    data_deviation: Array
    inflation: float

    def __post_init__(self) -> None:
        freeze_arrays(self)


def parameter_names(problem: Problem) -> tuple[str, ...]:
    """Return the labels of all free parameters, lift coefficients left out."""
    return tuple(slot.name for slot in (*problem.nonlinear, *problem.linear))


def parameter_values(problem: Problem, solution: Solution) -> Array:
    """Return their values [SI]."""
    return np.concatenate([solution.x, solution.c[: len(problem.linear)]])


def covariance(problem: Problem, solution: Solution) -> Covariance:
    """Return the covariance at a minimum, parameters at a bound taken as known."""
    slots = (*problem.nonlinear, *problem.linear)
    count = len(slots)
    steps = np.r_[[slot.row.step for slot in problem.nonlinear], linear_steps(problem)]
    free = free_parameters(problem, solution)
    n_bins = sum(item.torque.size for item in problem.data)
    independent = n_bins / CORRELATION
    inflation = max(1.0, solution.data_chi_square / max(independent - count, 1.0))
    prior = solution.hessian - solution.data_hessian
    # the data say less than their weights claim; what the sheets say stays as it is
    inverse = inverse_over(solution.data_hessian / inflation + prior, free)
    matrix = inverse[:count, :count] * np.outer(steps[:count], steps[:count])
    alone = inverse_over(solution.data_hessian + WEAK_PRIOR * prior, free)[:count, :count]
    deviation = np.sqrt(np.maximum(np.diag(alone), 0.0)) * steps[:count]
    return Covariance(
        parameter_names(problem), matrix, _correlation(matrix), _correlation(alone), deviation, float(inflation)
    )


def free_parameters(problem: Problem, solution: Solution) -> NDArray[np.bool_]:
    """Return which parameters and lift coefficients are off their bounds, (k + n_lift,); lift counts as free."""
    return ~np.r_[at_bounds(problem, solution), np.zeros(problem.n_lift, dtype=bool)]


def inverse_over(matrix: Array, free: NDArray[np.bool_]) -> Array:
    """Return the inverse over the free rows, zero elsewhere; null directions get a very large variance."""
    result = np.zeros_like(matrix)
    block = matrix[np.ix_(free, free)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(block), 1e-30))
    values, vectors = np.linalg.eigh(block * np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    result[np.ix_(free, free)] = inverse * np.outer(scale, scale)
    return result


def _correlation(matrix: Array) -> Array:
    deviation = np.sqrt(np.diag(matrix))
    safe = np.where(deviation > 0.0, deviation, 1.0)
    result = matrix / np.outer(safe, safe)
    np.fill_diagonal(result, 1.0)
    return result


def at_bounds(problem: Problem, solution: Solution) -> NDArray[np.bool_]:
    """Return which parameters sit at a bound, (k,) bool."""
    values = parameter_values(problem, solution)
    rows = [slot.row for slot in (*problem.nonlinear, *problem.linear)]
    return np.array(
        [
            v <= row.lower + 1e-9 * row.step or v >= row.upper - 1e-9 * row.step
            for v, row in zip(values, rows, strict=True)
        ],
        dtype=bool,
    )


@dataclass(frozen=True)
class Variant:
    """A plausible other model: what it changes, and the minimum that it leads to."""

    name: str
    problem: Problem
    solution: Solution


def variants(problem: Problem, solution: Solution, other_laws: Sequence[Sequence[FitData]] = ()) -> tuple[Variant, ...]:
    """Return the minima of the plausible other chains, each from the same start.

    Parameters
    ----------
    problem, solution : the chosen model
    other_laws : the same recordings with another smoothing of the lift table

    Notes
    -----
    Other valve law (square root instead of lift-limited), faster port, stiff clearance, no guide friction, sharp end of
    delivery, a drive on a controller, delivery or the whole chain trusted less in the weights, other smoothing of the
    lift table.
    """
    known = dict(zip(parameter_names(problem), parameter_values(problem, solution), strict=True))
    specs: list[tuple[str, Sequence[FitData], dict[str, float]]] = []
    if "chamber" in problem.effects:
        specs.append(("valve opens at once (square-root law)", problem.data, {"valve_range": 1.0e5}))
        specs.append(("outlet closes within 0.3 deg", problem.data, {"end_width": 0.3 * np.pi / 180.0}))
        width = (
            min(PORT_FACTOR * known["port_width"], slot_upper(problem, "port_width")) if "port_width" in known else 0.0
        )
        if width > 0.0:
            specs.append(("inlet port closes over a third of the lift", problem.data, {"port_width": width}))
        specs.append(("clearance of the plunger does not widen", problem.data, {"leak_growth": 0.0}))
        specs.append(("bulk modulus slope as in the literature", problem.data, {"bulk_modulus_slope": 10.0}))
        specs.append(("valve law trusted to a tenth of its pressure drop", _valve_distrusted(problem, solution), {}))
    if "driveline" in problem.effects and "controller" not in problem.effects:
        specs.append(
            ("drive on a speed controller", problem.data, {"drive_frequency": CONTROLLER, "drive_damping": 0.7})
        )
    if "friction" in problem.effects:
        specs.append(("guide without friction", problem.data, {"guide_friction": 0.0}))
    specs.append(("four times the model error in the weights", [_softer(item) for item in problem.data], {}))
    specs.extend((f"other smoothing of the lift table {k + 1}", laws, {}) for k, laws in enumerate(other_laws))
    result = []
    for name, data, held in specs:
        changed = build_problem(data, problem.effects, held)
        start = np.array([known[slot.name] for slot in changed.nonlinear])
        result.append(Variant(name, changed, minimise(changed, start, VARIANT_ITERATIONS, VARIANT_TOLERANCE)))
    return tuple(result)


def slot_upper(problem: Problem, name: str) -> float:
    """Return the upper bound of a free parameter."""
    return next(slot.row.upper for slot in problem.nonlinear if slot.name == name)


def _valve_distrusted(problem: Problem, solution: Solution) -> list[FitData]:
    return [
        with_valve_error(item, drop_torque(item.chain, output, problem.values(solution.x, index)), DISTRUSTED)
        for index, (item, output) in enumerate(zip(problem.data, solution.outputs, strict=True))
    ]


def _softer(item: FitData) -> FitData:
    weight = item.weight / np.sqrt(1.0 + 15.0 * (item.torque / np.max(np.abs(item.torque))) ** 2)
    return replace(item, weight=weight)


def spread(problem: Problem, solution: Solution, others: Sequence[Variant]) -> Array:
    """Return the root mean square change of each parameter over the variants that have it free, (k,) [SI]."""
    names = parameter_names(problem)
    values = dict(zip(names, parameter_values(problem, solution), strict=True))
    squares: dict[str, list[float]] = {name: [] for name in names}
    for variant in others:
        found = parameter_values(variant.problem, variant.solution)
        for name, value in zip(parameter_names(variant.problem), found, strict=True):
            squares[name].append((value - values[name]) ** 2)
    return np.array([np.sqrt(np.mean(squares[name])) if squares[name] else 0.0 for name in names])


def confounded_with(cov: Covariance, index: int) -> tuple[str, ...]:
    """Return the parameters that the data alone cannot tell from this one."""
    row = np.abs(cov.data_correlation[index])
    return tuple(name for j, name in enumerate(cov.names) if j != index and row[j] > CONFOUNDED)

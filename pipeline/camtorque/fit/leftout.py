"""Every recording predicted by the others: own zero and end of delivery fitted, and blind from its line pressure.

The fit of the others is one step from the joint minimum: the recording's own normal equations are taken off, which is
exact for a linear model and costs nothing, however many recordings there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.metrics import metrics
from camtorque.fit.problem import END_NAMES, SPILL_NAMES, FitData, Problem, build_problem, with_starts
from camtorque.fit.result import model_on_grid
from camtorque.fit.single import Fit, Prepared
from camtorque.fit.solver import Solution, lifts_at, solve, try_at
from camtorque.records import Array, Metrics

ZERO_SPREAD_SHARE = 1.0e-3
"""Blind predictions take off the mean where the torque zero is known worse than this share of the peak."""
MODES = ("own_zero_and_end", "blind")
MATCH_WINDOW = 1.0e-3
"""Time before and after an end of delivery over which the slope of the line pressure is compared [s]."""
LEAST_INFORMATION = 1.0e-3
"""Information, in units of the prior's, below which a direction is left where the joint fit has it."""
MATCH_POINTS = 41
MOST_TEMPLATES = 2


@dataclass(frozen=True)
class HeldOut:
    """Prediction of one recording by the others."""

    name: str
    mode: str
    fitted_on_held_out: tuple[str, ...]
    metrics: Metrics
    mean_removed: bool


def left_out_values(fit: Fit, index: int) -> Array:
    """Return the shared parameters that all recordings but one give, at their places in z (own ones as they are)."""
    problem, solution = fit.problem, fit.solution
    own, chain = problem.places[index]
    output, item = solution.outputs[index], problem.data[index]
    both = np.column_stack([output.derivative, output.linear])[:, chain] * item.weight[:, None]  # type: ignore[list-item]
    lift, residual = solution.lifts[index], solution.residuals[index]
    rest = solution.hessian.copy()
    rest[np.ix_(own, own)] -= lift.product(both, both)
    vector = solution.gradient.copy()
    vector[own] -= lift.product(both, residual)
    kept = np.array([slot.recording != index for slot in problem.slots])
    step = np.zeros(problem.size)
    step[kept] = _cautious(rest[np.ix_(kept, kept)], fit.covariance.prior_std[kept]) @ vector[kept]
    lower, upper = problem.bounds
    largest = 3.0 * fit.covariance.std + 1e-30
    return np.clip(solution.z + np.clip(step, -largest, largest), lower, upper)


def _cautious(matrix: Array, scale: Array) -> Array:
    """Return the inverse of an information matrix; what it says less of than the prior (std ``scale``) stays put."""
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    shares = np.where(values > LEAST_INFORMATION, 1.0 / np.maximum(values, LEAST_INFORMATION), 0.0)
    return (vectors * shares) @ vectors.T * np.outer(scale, scale)


def left_out_predictions(prepared: Sequence[Prepared], fit: Fit) -> tuple[HeldOut, ...]:
    """Return both predictions of every recording by the others."""
    result: list[HeldOut] = []
    for index, item in enumerate(prepared):
        z = left_out_values(fit, index)
        shared = {s.row.name: float(v) for s, v in zip(fit.problem.slots, z, strict=True) if s.recording < 0}
        data = with_starts(fit.problem.data[index], shared)
        result.append(_prediction(item, fit, index, data, {**shared, "pressure_zero": 0.0}, "own_zero_and_end"))
        blind = {**shared, "pressure_zero": 0.0, "torque_zero": 0.0, **predicted_end(fit, index)}
        result.append(_prediction(item, fit, index, with_starts(data, blind), blind, "blind"))
    return tuple(result)


def _prediction(prepared: Prepared, fit: Fit, index: int, data: FitData, held: dict[str, float], mode: str) -> HeldOut:
    problem = build_problem([data], held)
    solution = solve(problem, None, 20) if problem.size else _evaluated(problem)
    alone = replace(
        fit, problem=problem, solution=solution, covariance=fit.covariance, measured=(fit.measured[index],),
        pressure_gain_std=(fit.pressure_gain_std[index],),
    )  # fmt: skip
    means, rigid = prepared.means, prepared.rigid
    torque = model_on_grid(alone, 0, means.held_torque, means.held_pressure).torque
    removed = mode == "blind" and _zero_unknown(prepared)
    if removed:
        torque = torque + float(np.mean(means.held_torque) - np.mean(torque))
    scored = metrics(means.held_torque, torque, rigid.torque, rigid.lift, rigid.lift_velocity)
    return HeldOut(data.name, mode, tuple(slot.name for slot in problem.slots), scored, removed)


def _evaluated(problem: Problem) -> Solution:
    """Return a problem without free parameters as a solution."""
    z = np.zeros(0)
    lifts = lifts_at(problem, z)
    trial = try_at(problem, z, lifts)
    empty = np.zeros((0, 0))
    return Solution(z, trial.chi_square, trial.data_chi_square, empty, empty, z, trial.outputs, trial.residuals, lifts,
                    0, 1, True)  # fmt: skip


def _zero_unknown(prepared: Prepared) -> bool:
    prior = prepared.data.rows["torque_zero"].prior
    peak = float(np.max(prepared.means.torque_all))
    return prior is None or prior[1] > ZERO_SPREAD_SHARE * peak


def predicted_end(fit: Fit, index: int) -> dict[str, float]:
    """Return where delivery ends by the line pressure, as it looked around the ends of the recordings next in speed."""
    problem = fit.problem
    item = problem.data[index]
    names = {"land": END_NAMES, "spill": SPILL_NAMES}.get(item.structure, ())
    if not names:
        return {}
    others = [k for k, other in enumerate(problem.data) if k != index and other.structure == item.structure]
    if not others:
        return {name: _expected(item, name) for name in names}
    others.sort(key=lambda k: abs(np.log(problem.data[k].chain.speed / item.chain.speed)))
    templates = [_slope_around(problem.data[k], _end_angle(fit, k)) for k in others[:MOST_TEMPLATES]]
    lift = item.chain.law.evaluate(item.chain.theta, 0)
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    places = item.chain.theta[(lift > 0.25 * np.max(lift)) & (np.arange(lift.size) <= top)]
    errors = [sum(float(np.sum((_slope_around(item, a) - t) ** 2)) for t in templates) for a in places]
    angle = float(places[int(np.argmin(errors))])
    found = {name: float(np.mean([_own_value(fit, k, name) for k in others])) for name in names[1:]}
    return {names[0]: angle if item.structure == "land" else float(np.interp(angle, item.chain.theta, lift)), **found}


def _expected(item: FitData, name: str) -> float:
    row = item.rows[name]
    return row.prior[0] if row.prior is not None else 0.75 * item.chain.top_lift if "lift" in name else row.start


def _own_value(fit: Fit, index: int, name: str) -> float:
    for slot, value in zip(fit.problem.slots, fit.solution.z, strict=True):
        if slot.row.name == name and slot.recording in (-1, index):
            return float(value)
    return fit.problem.data[index].rows[name].start


def _end_angle(fit: Fit, index: int) -> float:
    item = fit.problem.data[index]
    if item.structure == "land":
        return _own_value(fit, index, "end_of_delivery")
    lift = item.chain.law.evaluate(item.chain.theta, 0)
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    return float(
        np.interp(
            _own_value(fit, index, "spill_lift"), np.maximum.accumulate(lift[: top + 1]), item.chain.theta[: top + 1]
        )
    )


def _slope_around(item: FitData, angle: float) -> Array:
    """Return the slope of the line pressure over time around an angle, over its greatest size there."""
    chain = item.chain
    times = np.linspace(-MATCH_WINDOW, MATCH_WINDOW, MATCH_POINTS)
    slope = np.gradient(chain.line_pressure, chain.theta) * chain.speed
    found = np.interp(angle + times * chain.speed, chain.theta, slope, period=2.0 * np.pi)
    return np.asarray(found / (np.max(np.abs(slope)) + 1e-12))

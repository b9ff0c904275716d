"""Every recording predicted by the others: own zero and end of delivery fitted, and blind from its line pressure.

The fit of the others is one step from the joint minimum: the recording's own normal equations are taken off, which is
exact for a linear model and costs nothing, however many recordings there are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from camtorque.fit.joint_fit import JointFit, values_of_each
from camtorque.fit.joint_input import JointInput
from camtorque.fit.joint_solver import JointSolution
from camtorque.fit.metrics import metrics
from camtorque.fit.problem import END_NAMES, SPILL_NAMES, FitData, Problem, build_problem, with_starts
from camtorque.fit.result import modelled
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
END_OF = {"land": END_NAMES, "spill": SPILL_NAMES}
"""Structure -> parameters of its end of delivery, the place first."""


@dataclass(frozen=True)
class HeldOut:
    """Prediction of one recording by the others."""

    name: str
    mode: str
    fitted_on_held_out: tuple[str, ...]
    metrics: Metrics


@dataclass(frozen=True)
class Shares:
    """The joint normal equations of the shared parameters, and each recording's share of them.

    places : of the shared parameters in z; matrix (s, s), vector (s,); parts : per recording its matrix and vector
    """

    places: NDArray[np.int64]
    matrix: Array
    vector: Array
    parts: tuple[tuple[Array, Array], ...]


def shares(solution: JointSolution) -> Shares:
    """Return what each recording adds to the equations of the shared parameters, its own ones eliminated."""
    hessian, gradient = solution.hessian, solution.gradient
    places = np.flatnonzero(hessian.recording < 0)
    where = np.zeros(gradient.size, dtype=np.int64)
    where[places] = np.arange(places.size)
    everything = np.ones(gradient.size, dtype=bool)
    matrix, vector, parts = np.diag(hessian.diagonal[places]), gradient[places].copy(), []
    for index, (place, part) in enumerate(zip(hessian.places, solution.parts, strict=True)):
        found, own_matrix, own_vector, _ = hessian.reduced(index, gradient, everything, pseudo=True)
        full, right = np.zeros_like(matrix), np.zeros_like(vector)
        full[np.ix_(where[found], where[found])] = own_matrix
        right[where[found]] = own_vector
        matrix, vector = matrix + full, vector + right
        right = right.copy()
        right[where[found]] += part[hessian.recording[place] < 0]
        parts.append((full, right))
    return Shares(places, matrix, vector, tuple(parts))


def left_out_values(fit: JointFit, found: Shares, index: int) -> Array:
    """Return the shared parameters that all recordings but one give, at their places in z (own ones as they are)."""
    places, (matrix, vector) = found.places, found.parts[index]
    z, (lower, upper) = fit.solution.z.copy(), fit.problem.bounds
    inverse = _cautious(found.matrix - matrix, fit.covariance.prior_std[places])
    largest = 3.0 * fit.covariance.std[places] + 1e-30
    step = np.clip(inverse @ (found.vector - vector), -largest, largest)
    z[places] = np.clip(z[places] + step, lower[places], upper[places])
    return z


def _cautious(matrix: Array, scale: Array) -> Array:
    """Return the inverse of an information matrix; what it says less of than the prior (std ``scale``) stays put."""
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    shares = np.where(values > LEAST_INFORMATION, 1.0 / np.maximum(values, LEAST_INFORMATION), 0.0)
    return (vectors * shares) @ vectors.T * np.outer(scale, scale)


@dataclass(frozen=True)
class Ends:
    """Ends of delivery of all recordings of one structure.

    places : (m,) of the recordings; speed : (m,) natural logarithm of it; values : (m, k) per parameter of the end [SI]
    """

    places: NDArray[np.int64]
    speed: Array
    values: Array


@dataclass(frozen=True)
class Others:
    """What predictions of each recording by the others rest on: shares of the equations, ends by structure."""

    found: Shares
    ends: Mapping[str, Ends]


def left_out(fit: JointFit) -> Others:
    """Return what predictions of left-out recordings rest on."""
    return Others(shares(fit.solution), ends_of(fit.problem, values_of_each(fit.problem, fit.solution.z)))


def ends_of(problem: Problem, owns: Sequence[Mapping[str, float]]) -> dict[str, Ends]:
    """Return the ends of delivery by structure; ``owns`` are the values of each recording's parameters."""
    found = {}
    for structure, names in END_OF.items():
        places = np.array([k for k, item in enumerate(problem.data) if item.structure == structure], dtype=np.int64)
        speed = np.array([np.log(problem.data[k].chain.speed) for k in places])
        rows = [[owns[k].get(name, problem.data[k].rows[name].start) for name in names] for k in places]
        found[structure] = Ends(places, speed, np.array(rows).reshape(-1, len(names)))
    return found


def predicted(fit: JointFit, others: Others, index: int, item: JointInput) -> tuple[HeldOut, ...]:
    """Return both predictions of a recording by the others."""
    z = left_out_values(fit, others.found, index)
    places = others.found.places
    shared = {fit.problem.parameters[k].row.name: float(z[k]) for k in places}
    data = with_starts(fit.problem.data[index], shared)
    own = _prediction(item, data, {**shared, "pressure_zero": 0.0}, MODES[0])
    blind = {**shared, "pressure_zero": 0.0, "torque_zero": 0.0, **predicted_end(fit.problem, others.ends, index)}
    return own, _prediction(item, with_starts(data, blind), blind, MODES[1])


def _prediction(item: JointInput, data: FitData, held: dict[str, float], mode: str) -> HeldOut:
    problem = build_problem([data], held)
    solution = solve(problem, None, 20) if problem.size else _evaluated(problem)
    means, lifts = item.means, solution.lifts[0].coefficients(solution.residuals[0])
    held_out = (means.held_torque, means.held_pressure)
    torque = modelled(problem, solution.z, 0, lifts, item.measured, held_out).torque
    if mode == "blind" and _zero_unknown(item):
        torque = torque + float(np.mean(means.held_torque) - np.mean(torque))
    scored = metrics(means.held_torque, torque, item.rigid_torque, item.lift, item.lift_velocity)
    return HeldOut(data.name, mode, problem.names, scored)


def _evaluated(problem: Problem) -> Solution:
    """Return a problem without free parameters as a solution."""
    z = np.zeros(0)
    lifts = lifts_at(problem, z)
    trial = try_at(problem, z, lifts)
    empty = np.zeros((0, 0))
    return Solution(z, trial.chi_square, trial.data_chi_square, empty, empty, z, trial.outputs, trial.residuals, lifts,
                    0, 1, True)  # fmt: skip


def _zero_unknown(item: JointInput) -> bool:
    prior = item.data.rows["torque_zero"].prior
    peak = float(np.max(item.means.torque_all))
    return prior is None or prior[1] > ZERO_SPREAD_SHARE * peak


def predicted_end(problem: Problem, ends: Mapping[str, Ends], index: int) -> dict[str, float]:
    """Return where delivery ends by the line pressure, as it looked around the ends of the recordings next in speed.

    ``ends`` are those of `ends_of`; the recording's own is not used.
    """
    item = problem.data[index]
    names = END_OF.get(item.structure, ())
    if not names:
        return {}
    others = ends[item.structure]
    kept = np.flatnonzero(others.places != index)
    if not kept.size:
        return {name: _expected(item, name) for name in names}
    near = kept[np.argsort(np.abs(others.speed[kept] - np.log(item.chain.speed)), kind="stable")[:MOST_TEMPLATES]]
    templates = []
    for k in near:
        other = problem.data[others.places[k]]
        templates.append(_slopes_around(other, np.array([_end_angle(other, others.values[k, 0])])))
    lift = item.chain.law.evaluate(item.chain.theta, 0)
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    places = item.chain.theta[(lift > 0.25 * np.max(lift)) & (np.arange(lift.size) <= top)]
    slopes = _slopes_around(item, places)
    errors = np.sum([np.sum((slopes - template) ** 2, axis=1) for template in templates], axis=0)
    angle = float(places[int(np.argmin(errors))])
    end = angle if item.structure == "land" else float(np.interp(angle, item.chain.theta, lift))
    return dict(zip(names, (end, *np.mean(others.values[kept, 1:], axis=0).tolist()), strict=True))


def _expected(item: FitData, name: str) -> float:
    row = item.rows[name]
    return row.prior[0] if row.prior is not None else 0.75 * item.chain.top_lift if "lift" in name else row.start


def _end_angle(item: FitData, end: float) -> float:
    if item.structure == "land":
        return end
    lift = item.chain.law.evaluate(item.chain.theta, 0)
    top = int(np.argmax(lift >= 0.999 * np.max(lift)))
    rising = np.maximum.accumulate(lift[: top + 1])
    return float(np.interp(end, rising, item.chain.theta[: top + 1]))


def _slopes_around(item: FitData, angles: Array) -> Array:
    """Return the slope of the line pressure over time around angles (n,), over its greatest size."""
    chain = item.chain
    times = np.linspace(-MATCH_WINDOW, MATCH_WINDOW, MATCH_POINTS)
    slope = np.gradient(chain.line_pressure, chain.theta) * chain.speed
    found = np.interp(angles[:, None] + times * chain.speed, chain.theta, slope, period=2.0 * np.pi)
    return np.asarray(found / (np.max(np.abs(slope)) + 1e-12))

"""Many recordings of one pump: shared physics fitted once, own nuisances each, every recording left out in turn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.budget import pressure_gain_shift
from camtorque.fit.estimates import estimates, prior_findings
from camtorque.fit.events import predicted_end
from camtorque.fit.ladder import climb
from camtorque.fit.many import MANY, left_out_misfit, left_out_steps, minimise, without_one
from camtorque.fit.metrics import metrics
from camtorque.fit.predict import HeldOutError, left_out
from camtorque.fit.prepare import swapped, with_rows
from camtorque.fit.problem import (
    EFFECT_PARAMETERS,
    SEVERAL_SPEEDS,
    FitData,
    Problem,
    build_problem,
    offered_effects,
)
from camtorque.fit.result import Fit, fitted_torque, model_on_grid
from camtorque.fit.single import FitOptions, Prepared, other_lift_laws, pressure_gain_std, with_law
from camtorque.fit.solve import Solution, solve
from camtorque.fit.starts import past_valleys, started_at, with_best_coupling
from camtorque.fit.uncertainty import covariance, parameter_names, parameter_values, spread, variants
from camtorque.records import Array, Finding, FittedTorque, LadderRung, Metrics, ParameterEstimate

LEFT_OUT_ITERATIONS = 8
LEFT_OUT_TOLERANCE = 1.0e-5
ZERO_SPREAD_SHARE = 1.0e-3
"""Blind predictions take off the mean where the torque zero is known worse than this share of the peak."""
BAD_RECORDING = 25.0
"""A recording whose misfit exceeds the median misfit by this factor is left out of the joint fit."""
SEVERAL_SPEEDS_NAMES = tuple(name for effect in SEVERAL_SPEEDS for name in EFFECT_PARAMETERS[effect])
"""Shared parameters that no recording can tell alone; they keep their joint values there."""
MODES = ("own_zero_and_end", "blind")


@dataclass(frozen=True)
class HeldOut:
    """Prediction of one recording by the others."""

    name: str
    mode: str
    fitted_on_held_out: tuple[str, ...]
    metrics: Metrics
    mean_removed: bool


@dataclass(frozen=True)
class Drift:
    """A shared parameter fitted to each recording alone, to see whether it drifts with speed.

    values and stderrs in ``unit``, in the order of ``recordings``; chi_square of the values against their mean with
    ``degrees`` of freedom; slope_per_1000_rpm of a weighted straight line and its standard error
    """

    name: str
    unit: str
    recordings: tuple[str, ...]
    speeds_rpm: tuple[float, ...]
    values: tuple[float, ...]
    stderrs: tuple[float, ...]
    slope_per_1000_rpm: float
    slope_stderr: float


@dataclass(frozen=True)
class CampaignFit:
    """The joint fit: shared parameters, every recording's result, predictions of left-out recordings."""

    names: tuple[str, ...]
    effects: tuple[str, ...]
    shared_parameters: tuple[ParameterEstimate, ...]
    fitted: tuple[FittedTorque, ...]
    held_out: tuple[HeldOut, ...]
    ladder: tuple[LadderRung, ...]
    drifts: tuple[Drift, ...]
    left_aside: tuple[str, ...]
    findings: tuple[Finding, ...]
    chi_square: float


def joint_start(data: Sequence[FitData]) -> list[FitData]:
    """Return the recordings with one common start of the shared parameters: the median of their own."""
    names = [name for name, row in data[0].rows.items() if row.role == "shared"]
    common = {name: {"start": float(np.median([item.rows[name].start for item in data]))} for name in names}
    limits = {
        name: {
            "lower": min(item.rows[name].lower for item in data),
            "upper": max(item.rows[name].upper for item in data),
        }
        for name in names
    }
    merged = {name: {**limits[name], **common[name]} for name in names}
    return [with_rows(item, merged) for item in data]


def solve_joint(data: Sequence[FitData], effects: Sequence[str]) -> tuple[Problem, Solution]:
    """Return the joint minimum from the common start, and from each recording's own start where that is better."""
    problem = build_problem(joint_start(data), effects)
    best = minimise(problem)
    for item in data if len(data) < MANY else ():
        start = problem.start()
        for j, slot in enumerate(problem.nonlinear):
            if slot.recording < 0:
                start[j] = item.rows[slot.row.name].start
        trial = solve(problem, start, max_iterations=10)
        if trial.chi_square < best.chi_square * (1.0 - 1e-6):
            best = solve(problem, trial.x)
    return problem, past_valleys(problem, best, minimise)


def without(problem: Problem, solution: Solution, index: int) -> tuple[Problem, Solution]:
    """Return the joint fit of all recordings but one, started at the joint minimum."""
    data = [
        started_at(item, problem, solution, position) for position, item in enumerate(problem.data) if position != index
    ]
    fewer = build_problem(data, problem.effects)
    return fewer, solve(fewer, None, LEFT_OUT_ITERATIONS, LEFT_OUT_TOLERANCE)


def left_out_error(problem: Problem, solution: Solution) -> HeldOutError:
    """Return the error over all recordings, each predicted by the others with own zero and end of delivery.

    The misfit counts what the own zero is pulled off its standstill reading: without it a chain that lacks a drag goes
    unpunished, for every left-out recording hides it in its zero.
    """
    squares, misfit = [], 0.0
    for index, item in enumerate(problem.data):
        _, found = left_out(*without(problem, solution, index), item)
        squares.append(np.mean(found.residuals[0] ** 2))
        misfit += found.chi_square
    return HeldOutError(float(np.sqrt(np.mean(squares))), misfit)


def _held_out(prepared: Prepared, others: tuple[Problem, Solution], mode: str) -> HeldOut:
    problem, solution = others
    extra: dict[str, float] = {}
    if mode == "blind":
        extra = {**predicted_end(problem, solution, prepared.data), "torque_zero": 0.0}
        if prepared.data.delivery == "spill":
            extra["spill_width"] = prepared.data.rows["spill_width"].prior[0]  # type: ignore[index]
    own, found = left_out(problem, solution, prepared.data, extra)
    chain = swapped(own.data[0], prepared.means.held_torque, prepared.means.held_pressure)
    torque = model_on_grid(own, found, 0, chain).torque
    removed = mode == "blind" and _zero_unknown(prepared)
    measured = prepared.means.held_torque
    if removed:
        torque = torque + float(np.mean(measured) - np.mean(torque))
    rigid = prepared.rigid
    names = tuple(slot.name for slot in (*own.nonlinear, *own.linear))
    scored = metrics(measured, torque, rigid.torque, rigid.lift, rigid.lift_velocity)
    return HeldOut(prepared.data.name, mode, names, scored, removed)


def _zero_unknown(prepared: Prepared) -> bool:
    prior = prepared.data.rows["torque_zero"].prior
    peak = float(np.max(prepared.means.torque_all))
    return prior is None or prior[1] > ZERO_SPREAD_SHARE * peak


def fit_joint(prepared: Sequence[Prepared], options: FitOptions | None = None) -> CampaignFit:
    """Return the joint fit of several recordings of one pump.

    Parameters
    ----------
    prepared : recordings whose starts are found
    options : effects to offer

    Notes
    -----
    The ladder decides on left-out recordings: odd and even cycles of one recording share every systematic error.
    """
    options = options or FitOptions()
    offered = options.effects
    if offered is None:
        offered = offered_effects([item.data for item in prepared])
    used, aside = _without_bad(list(prepared), offered)
    data = [item.data for item in used]
    data = with_best_coupling(joint_start(data), offered)
    problem, solution = solve_joint(data, offered)
    data = [started_at(item, problem, solution, k) for k, item in enumerate(problem.data)]
    data = [replace(item, chain=original.data.chain) for item, original in zip(data, used, strict=True)]
    rungs: tuple[LadderRung, ...] = ()
    if options.use_ladder and len(used) > 2:
        error = left_out_error if len(used) < MANY else left_out_misfit
        effects, solution, rungs = climb(
            data, lambda names, minimum, items: error(build_problem(items, names), minimum), offered,
            "left-out recordings",
        )  # fmt: skip
        problem = build_problem(data, effects)
        solution = minimise(problem, solution.x)
    fit = _with_uncertainty(used, problem, solution, rungs)
    return _campaign(used, fit, aside)


def _without_bad(prepared: list[Prepared], effects: Sequence[str]) -> tuple[list[Prepared], tuple[str, ...]]:
    """Return the recordings that a joint fit can explain, and the names of those left aside."""
    aside: list[str] = []
    while len(prepared) > 3:
        problem, solution = solve_joint([item.data for item in prepared], effects)
        misfit = np.array(
            [np.mean((r * item.weight) ** 2) for r, item in zip(solution.residuals, problem.data, strict=True)]
        )
        worst = int(np.argmax(misfit))
        if misfit[worst] < BAD_RECORDING * np.median(misfit):
            break
        aside.append(prepared.pop(worst).data.name)
    return prepared, tuple(aside)


def _with_uncertainty(
    used: Sequence[Prepared], problem: Problem, solution: Solution, rungs: tuple[LadderRung, ...]
) -> Fit:
    cov = covariance(problem, solution)
    laws = other_lift_laws(used[0].recording)
    other = [[with_law(item, law) for item in problem.data] for law in laws]
    found = variants(problem, solution, other)
    gain = pressure_gain_shift(problem, solution, max(pressure_gain_std(item) for item in used))
    return Fit(problem, solution, cov, np.hypot(spread(problem, solution, found), gain), gain, found, rungs)


def _campaign(used: Sequence[Prepared], fit: Fit, aside: tuple[str, ...]) -> CampaignFit:
    problem, solution = fit.problem, fit.solution
    drifts = shared_drifts(problem, solution) if len(used) > 2 else ()
    fit = replace(fit, spreads=widened(fit, drifts))
    fitted = tuple(
        fitted_torque(fit, k, item.recording, item.cycles, item.rigid, item.means) for k, item in enumerate(used)
    )
    held: list[HeldOut] = []
    for index, (item, others) in enumerate(zip(used, _others(problem, solution), strict=False)):
        prepared = replace(item, data=replace(problem.data[index], chain=item.data.chain))
        held.extend(_held_out(prepared, others, mode) for mode in MODES)
    rows = estimates(problem, solution, fit.covariance, fit.spreads)
    shared = tuple(row for row in rows if row.role == "shared")
    findings = (*prior_findings(rows), *_drift_findings(drifts), *_aside_findings(aside))
    names = tuple(item.data.name for item in used)
    return CampaignFit(
        names, problem.effects, shared, fitted, tuple(held), fit.ladder, drifts, aside, findings, solution.chi_square
    )


def _others(problem: Problem, solution: Solution) -> Iterator[tuple[Problem, Solution]]:
    """Yield the fit of all recordings but one, for each in turn; by summaries where there are many."""
    count = len(problem.data)
    if count >= MANY:
        for index, (_, step) in enumerate(left_out_steps(problem, solution)):
            yield without_one(problem, solution, index, step)
    elif count > 1:
        for index in range(count):
            yield without(problem, solution, index)


def _aside_findings(aside: tuple[str, ...]) -> tuple[Finding, ...]:
    return tuple(
        Finding(
            "recording_left_aside", "warning",
            f"{name} does not fit the others ({BAD_RECORDING:.0f} times their misfit); left out of the joint fit",
            name,
        )
        for name in aside
    )  # fmt: skip


def widened(fit: Fit, drifts: Sequence[Drift]) -> Array:
    """Return the model spread with what the recordings, fitted alone, say about each shared parameter, (k,) [SI].

    Physics that the chain lacks pulls the joint value away from the mean of the single ones: that distance belongs to
    the uncertainty, however small the formal error of the joint fit is.
    """
    names = parameter_names(fit.problem)
    values = parameter_values(fit.problem, fit.solution)
    rows = {slot.name: slot.row for slot in (*fit.problem.nonlinear, *fit.problem.linear)}
    spreads = fit.spreads.copy()
    for drift in drifts:
        stds = np.array(drift.stderrs)
        told = stds > 0.0
        if told.sum() > 1:
            weight = 1.0 / stds[told] ** 2
            mean = float(np.sum(weight * np.array(drift.values)[told]) / np.sum(weight)) * rows[drift.name].per_unit
            index = names.index(drift.name)
            spreads[index] = np.hypot(spreads[index], mean - values[index])
    return spreads


def shared_drifts(problem: Problem, solution: Solution) -> tuple[Drift, ...]:
    """Return every shared parameter that one recording can tell, fitted per recording, with its slope over speed."""
    speeds = np.array([item.chain.speed for item in problem.data]) * 60.0 / (2.0 * np.pi)
    table: dict[str, list[tuple[float, float]]] = {}
    held = {name: value for name, value in problem.values(solution.x, 0).items() if name in SEVERAL_SPEEDS_NAMES}
    for index, item in enumerate(problem.data):
        alone = build_problem([started_at(item, problem, solution, index)], problem.effects, held)
        found = solve(alone, max_iterations=25)
        deviation = np.sqrt(np.maximum(np.diag(covariance(alone, found).matrix), 0.0))
        values = parameter_values(alone, found)
        for name, value, std in zip(parameter_names(alone), values, deviation, strict=True):
            table.setdefault(name, []).append((float(value), float(std)))
    rows = {slot.row.name: slot.row for slot in (*problem.nonlinear, *problem.linear) if slot.recording < 0}
    drifts = []
    for name, row in rows.items():
        if name in held:
            continue
        pairs = np.array(table[name])
        if pairs.shape[0] == len(problem.data):
            drifts.append(_drift(name, row.unit, pairs / row.per_unit, speeds, problem))
    return tuple(drifts)


def _drift(name: str, unit: str, pairs: Array, speeds: Array, problem: Problem) -> Drift:
    values, stds = pairs[:, 0], pairs[:, 1]
    safe = np.where(stds > 0.0, stds, np.max(stds) if np.max(stds) > 0.0 else 1.0)
    design = np.column_stack([np.ones_like(speeds), (speeds - np.mean(speeds)) / 1000.0]) / safe[:, None]
    cov = np.linalg.pinv(design.T @ design)
    slope = float((cov @ design.T @ (values / safe))[1])
    names = tuple(item.name for item in problem.data)
    return Drift(
        name, unit, names, tuple(map(float, speeds)), tuple(map(float, values)), tuple(map(float, stds)), slope,
        float(np.sqrt(cov[1, 1])),
    )  # fmt: skip


def _drift_findings(drifts: Sequence[Drift]) -> tuple[Finding, ...]:
    result = []
    for drift in drifts:
        if drift.slope_stderr > 0.0 and abs(drift.slope_per_1000_rpm) > 2.5 * drift.slope_stderr:
            text = (
                f"{drift.name} should be the same in every recording but drifts by {drift.slope_per_1000_rpm:+.3g} +- "
                f"{drift.slope_stderr:.2g} {drift.unit} per 1000 rpm fitted alone: a law may be missing"
            )
            result.append(Finding("shared_parameter_drifts", "warning", text, drift.name))
    return tuple(result)

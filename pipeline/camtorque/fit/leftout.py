"""Every recording predicted by the others: own zero and end of delivery fitted, and blind from its line pressure.

The fit of the others begins one step from the joint minimum: the recording's own normal equations are taken off, within
the bounds, which is exact for a linear model and costs nothing, however many recordings there are. Where they are few,
each weighs enough for the step to leave what is linear: if it makes their chi-square larger they are fitted again.
Where the delivery ends, which correction the lift table needs, and what is typical where the model steps within what
the others leave open, a prediction takes from them as `predict --from` does.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from camtorque.fit.derived import modelled, on_cycles
from camtorque.fit.descent import Effort, free_at
from camtorque.fit.endings import endings_of, load_for
from camtorque.fit.forecast import values_of
from camtorque.fit.joint_fit import JointFit, residual_covariance
from camtorque.fit.joint_input import JointInput
from camtorque.fit.joint_solver import JointSolution, joint_setup, solve_many, try_at
from camtorque.fit.known_ends import END_OF, WIDTHS_OF, Curve
from camtorque.fit.known_fit import FRACTIONS, FittedAt, KnownFit, LoadKnowledge, draws, middle, steps
from camtorque.fit.own_start import BEGIN, begun_as_nearest
from camtorque.fit.prepare import cam_angles
from camtorque.fit.problem import NEUTRAL, FitData, Problem, build_problem, started_at, with_starts
from camtorque.fit.quadratic import bounded_quadratic
from camtorque.fit.residual import metrics
from camtorque.fit.shared_lift import LiftInformation, all_lift_information, lift_information, shared_lift_from
from camtorque.fit.solver import solve
from camtorque.fit.valleys import TRIGGER_ANGLE
from camtorque.laws import ripple
from camtorque.laws.chain import coefficients_of, evaluate
from camtorque.records import Array, Finding, Mask, Metrics

ZERO_SPREAD_SHARE = 1.0e-3
"""Blind predictions take off the mean where the torque zero is known worse than this share of the peak."""
MODES = ("own_zero_and_end", "blind")
LEAST_INFORMATION = 1.0e-3
"""Information, in units of the prior's, below which a direction is left where the joint fit has it."""
LARGEST_STEP = 3.0
"""Of the shared parameters when a recording is left out, in standard deviations: the step is shortened as a whole."""
POOR = {MODES[0]: 0.3, MODES[1]: 1.0}
"""Error of a left-out prediction, by its mode, above which the campaign says so [% of the peak torque]."""
PREDICTED_BADLY = "predicted_badly"
"""Code of the finding on a recording that the others predict badly."""
MOST_TOLD = 5
"""Badly predicted recordings that have a finding of their own."""
MOST_FITTED_ON, FIT_ON_STEPS = 12, 12
"""Largest campaign whose recordings are fitted again without one where the step fails, and the iterations of that."""
DRAWS = 16
"""Runs that tell whether the model steps within what the others leave open, by each of `known_fit.FRACTIONS`."""


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


def _moving(problem: Problem, solution: JointSolution) -> Mask:
    """Return which parameters may follow a step: all shared ones, and own ones that no bound holds, (k,)."""
    free = free_at(solution.z, solution.gradient, *problem.bounds)
    return np.asarray(free | (solution.hessian.recording < 0))


def shares(problem: Problem, solution: JointSolution) -> Shares:
    """Return what each recording adds to the equations of the shared parameters, its own ones eliminated."""
    hessian, gradient = solution.hessian, solution.gradient
    places = np.flatnonzero(hessian.recording < 0)
    moving = _moving(problem, solution)
    matrix, vector, parts = np.diag(hessian.diagonal[places]), gradient[places].copy(), []
    for index, (place, part) in enumerate(zip(hessian.places, solution.parts, strict=True)):
        found, own_matrix, own_vector, _ = hessian.reduced(index, gradient, moving, pseudo=True)
        full, right, at = np.zeros_like(matrix), np.zeros_like(vector), np.searchsorted(places, found)
        full[np.ix_(at, at)] = own_matrix
        right[at] = own_vector
        matrix, vector = matrix + full, vector + right
        right[at] += part[hessian.recording[place] < 0]
        parts.append((full, right))
    return Shares(places, matrix, vector, tuple(parts))


def left_out_values(fit: JointFit, found: Shares, index: int) -> Array:
    """Return the shared parameters that all recordings but one give, at their places in z (own ones as they are).

    A parameter that a bound holds stays there: a step that left the bounds and was cut back afterwards would move all
    others as if it had been made.
    """
    places, (matrix, vector) = found.places, found.parts[index]
    z, scale = fit.solution.z.copy(), fit.covariance.prior_std[places]
    here = z[places]
    lower, upper = (bound[places] for bound in fit.problem.bounds)
    information = _regularised((found.matrix - matrix) * np.outer(scale, scale))
    pull = scale * (found.vector - vector)
    step = scale * bounded_quadratic(
        information, pull, (lower - here) / scale, (upper - here) / scale, np.zeros(here.size)
    )
    size = np.abs(step) / (LARGEST_STEP * fit.covariance.std[places] + 1e-30)
    z[places] = np.clip(here + step / max(1.0, float(np.max(size))), lower, upper)
    return z


def _regularised(information: Array) -> Array:
    """Return information in units of the prior's; what it says less of than the prior stays put."""
    values, vectors = np.linalg.eigh(information)
    kept = np.where(values > LEAST_INFORMATION, values, max(float(values[-1]), 1.0) / LEAST_INFORMATION)
    return np.asarray((vectors * kept) @ vectors.T)


def fitted_without(fit: JointFit, found: Shares, index: int) -> tuple[Array, bool]:
    """Return the values that all recordings but one give (the own ones of that one as they are); whether they settled.

    Where the linear step makes chi-square of the others larger, as it may where they are few, they are fitted again
    from the joint minimum.
    """
    problem, near = fit.problem, left_out_values(fit, found, index)
    if len(problem.data) > MOST_FITTED_ON:
        return near, True
    near = _followed(fit, near, index)
    stepped, joint = (_without(problem, z, index) for z in (near, fit.solution.z))
    setup = joint_setup(joint, joint.start, 0.0)
    if try_at(setup, stepped.start).chi_square <= try_at(setup, joint.start).chi_square:
        return near, True
    solved = solve_many(joint, joint.start, FIT_ON_STEPS)
    keys = [_key(joint, k) for k in range(joint.size)]
    values = dict(zip(keys, solved.z.tolist(), strict=True))
    return np.array([values.get(_key(problem, k), near[k]) for k in range(problem.size)]), solved.converged


def _followed(fit: JointFit, z: Array, index: int) -> Array:
    """Return values whose own ones of the other recordings follow the step of the shared ones."""
    hessian, gradient = fit.solution.hessian, fit.solution.gradient
    step, z, moving = z - fit.solution.z, z.copy(), _moving(fit.problem, fit.solution)
    for k, place in enumerate(hessian.places):
        if k != index:
            shared, _, _, back = hessian.reduced(k, gradient, moving, pseudo=True)
            z[place[(hessian.recording[place] >= 0) & moving[place]]] += back[:, -1] - back[:, :-1] @ step[shared]
    return np.clip(z, *fit.problem.bounds)


def _without(problem: Problem, z: Array, index: int) -> Problem:
    """Return the problem of all recordings but one, started at values of the joint problem."""
    return build_problem([item for k, item in enumerate(started_at(problem, z)) if k != index])


def _key(problem: Problem, k: int) -> tuple[str, str]:
    """Return name of a free parameter and of its recording, empty for a shared one."""
    parameter = problem.parameters[k]
    return parameter.row.name, problem.data[parameter.recording].name if parameter.recording >= 0 else ""


@dataclass(frozen=True)
class LeaveOneOut:
    """What predictions of each recording by the others rest on.

    found : shares of the equations; known : the joint fit as `predict --from` takes it; curves : line pressures by
    name; lift : what all recordings ask of the lift correction together
    """

    found: Shares
    known: KnownFit
    curves: Mapping[str, Curve]
    lift: LiftInformation


def left_out(fit: JointFit) -> LeaveOneOut:
    """Return what predictions of left-out recordings rest on."""
    data, cov = fit.problem.data, fit.covariance
    recordings = tuple(FittedAt(item.name, item.chain.speed, item.structure, 0.0, True) for item in data)
    known = KnownFit(fit.problem.names, fit.solution.z, cov.arrow, recordings, residual_covariance(fit.solution, cov))
    curves = {item.name: Curve(cam_angles(item.chain), item.chain.line_pressure, item.chain.speed) for item in data}
    asked = all_lift_information(fit.problem, fit.solution.z, cov.inflation)
    return LeaveOneOut(shares(fit.problem, fit.solution), known, curves, asked)


def predicted(fit: JointFit, others: LeaveOneOut, index: int, item: JointInput) -> tuple[tuple[HeldOut, HeldOut], bool]:
    """Return both predictions of a recording by the others, and whether the fit of the others had settled."""
    problem = fit.problem
    z, settled = fitted_without(fit, others.found, index)
    shared = {problem.parameters[k].row.name: float(z[k]) for k in others.found.places}
    lift = others.lift - lift_information(problem, fit.solution.z, index, fit.covariance.inflation)
    correction = shared_lift_from(problem, lift).values
    data = replace(with_starts(problem.data[index], shared), lift_basis=problem.data[0].lift_basis)
    known = replace(others.known, values=z)
    ends = predicted_end(known, others.curves, data)
    shared = typical(known, data, shared, ends)
    data = with_starts(data, shared)
    own = _prediction(item, data, {**shared, "pressure_zero": 0.0}, MODES[0], correction)
    nothing = dict.fromkeys((TRIGGER_ANGLE, "pressure_zero", "torque_zero", *ripple.NAMES), 0.0)
    # the trigger's angle is shared by recordings of one trigger
    blind = {**nothing, **shared, **begun_as_nearest(known, data), **ends}
    return (own, _prediction(item, with_starts(data, blind), blind, MODES[1], correction)), settled


def typical(known: KnownFit, data: FitData, shared: Mapping[str, float], ends: Mapping[str, float]) -> dict[str, float]:
    """Return the shared values of the drawn run nearest to the median torque where the model steps, else as they are.

    Parameters
    ----------
    known : the fit of the others; data : the recording that is predicted
    shared : parameter -> value in the fit of the others [SI]
    ends : where and how sharply delivery ends [SI]
    """
    source = next(one for one in known.recordings if one.id == data.name)
    places = {name: k for name, k in known.own(source.id).items() if name in shared}
    mean = {**shared, "torque_zero": 0.0}
    found = [draws(known, places, mean, LoadKnowledge({}), fraction, DRAWS) for fraction in FRACTIONS]

    def torque(values: Mapping[str, float]) -> Array:
        full = values_of({**values, **ends}, source)
        linear = coefficients_of(full)
        output = evaluate(data.chain, full, linear)
        return output.torque + output.linear @ linear

    center = torque(shared)
    small, whole = (
        np.array([torque(item) - center for item in each]) / fraction
        for each, fraction in zip(found, FRACTIONS, strict=True)
    )
    best = found[-1][middle(whole)] if steps(small, whole) else shared
    return {name: best[name] for name in shared}


def _prediction(item: JointInput, data: FitData, held: Mapping[str, float], mode: str, lift: Array) -> HeldOut:
    problem = build_problem([data], held)
    z = solve(problem, None, Effort(20)).z if problem.size else np.zeros(0)
    means = item.means
    model = modelled(problem, z, 0, lift, item.measured, (means.held_torque, means.held_pressure))
    torque = on_cycles(model, means.held_torque.size).torque
    prior = item.data.rows["torque_zero"].prior
    zero_unknown = prior is None or prior[1] > ZERO_SPREAD_SHARE * float(np.max(means.torque_all))
    if mode == "blind" and zero_unknown:
        torque = torque + float(np.mean(means.held_torque) - np.mean(torque))
    scored = metrics(means.held_torque, torque, item.rigid_torque, item.lift, item.lift_velocity)
    return HeldOut(data.name, mode, problem.names, scored)


def predicted_end(known: KnownFit, curves: Mapping[str, Curve], item: FitData) -> dict[str, float]:
    """Return where and how sharply delivery ends by the line pressure, from the other recordings of a joint fit.

    Where no end was seen in any of them none is predicted: one fitted near the full lift is no end either.
    """
    if item.structure not in END_OF:
        return {}
    others = tuple(one for one in known.recordings if one.id != item.name)
    if not any(one.structure in END_OF for one in others):
        names = (END_OF[item.structure], *WIDTHS_OF[item.structure])
        open_throughout = any(one.structure == "open" for one in others)
        return {name: NEUTRAL[name] if open_throughout else _expected(item, name) for name in names}
    known = replace(known, recordings=others)
    source = endings_of(known, item.chain.speed, item.structure)[0]
    own = known.own(source.id)
    kept = {name: float(known.values[own[name]]) for name in WIDTHS_OF[item.structure] if name in own}
    load = load_for(known, source, curves, item.chain, curves[item.name])
    return {**kept, **{name: end.value for name, end in load.ends.items()}}


def _expected(item: FitData, name: str) -> float:
    row = item.rows[name]
    return row.prior[0] if row.prior is not None else 0.75 * item.chain.top_lift if "lift" in name else row.start


def settling_findings(names: Sequence[str]) -> tuple[Finding, ...]:
    """Return the finding on recordings without which the fit of the others had not settled."""
    if not names:
        return ()
    text = (
        f"without {', '.join(names)}: the fit of the other recordings was still moving after {FIT_ON_STEPS} steps; the "
        "error of such a left-out prediction may change by as much as it differs from the joint fit's own"
    )
    return (Finding("left_out_not_settled", "info", text, names[0]),)


def is_poor(mode: str, rms_percent: float | None) -> bool:
    """Return whether a prediction by the others is worse than what a run not made may be built on."""
    return rms_percent is not None and rms_percent > POOR[mode]


def error_text(error: Metrics) -> str:
    """Return how far a prediction is off: over the revolution, and at its highest torque."""
    excess = error.peak_excess_percent
    high = f", its highest torque {abs(excess):.2g} % too {'high' if excess > 0.0 else 'low'}"
    return f"{error.rms_percent_of_peak:.2g} % of the peak (RMS){high if np.isfinite(excess) else ''}"


def poor_findings(held: Sequence[HeldOut]) -> tuple[Finding, ...]:
    """Return a finding on each recording that the others predict badly, the worst first; of many one on the rest."""
    poor: dict[str, list[HeldOut]] = {}
    # what a blind one is off by is then the trigger's mounting, which no prediction over cam angle knows of
    own_triggers = any(_fits_trigger(row) for row in held)
    for row in sorted(held, key=lambda row: -row.metrics.rms_percent_of_peak):
        if is_poor(row.mode, row.metrics.rms_percent_of_peak) and not (own_triggers and row.mode == MODES[1]):
            poor.setdefault(row.name, []).append(row)
    names = list(poor)
    found = [Finding(PREDICTED_BADLY, "warning", _poor_text(name, poor[name]), name) for name in names[:MOST_TOLD]]
    if rest := names[MOST_TOLD:]:
        told = ", ".join(f"{name} {poor[name][0].metrics.rms_percent_of_peak:.2g} %" for name in rest)
        found.append(Finding(PREDICTED_BADLY, "warning", f"less, but too much, are off: {told}", rest[0]))
    return tuple(found)


def _fits_trigger(row: HeldOut) -> bool:
    return TRIGGER_ANGLE in row.fitted_on_held_out


def own_text(fitted: Collection[str]) -> str:
    """Return in words what a left-out recording has of its own; ``fitted``: names of what was fitted to it."""
    zero = "zero, trigger angle" if TRIGGER_ANGLE in fitted else "zero"
    return f"{zero} and {'start and end' if BEGIN[0] in fitted else 'end'} of delivery"


def _mode_text(row: HeldOut) -> str:
    return f"own {own_text(row.fitted_on_held_out)} fitted" if row.mode == MODES[0] else "nothing of it fitted"


def _poor_text(name: str, rows: Sequence[HeldOut]) -> str:
    parts = (f"{error_text(row.metrics)} ({_mode_text(row)}, at most {POOR[row.mode]:g} %)" for row in rows)
    return (
        f"left out and predicted from the others, {name} is off by {'; '.join(parts)}; a run at such a speed "
        "and load that was not recorded is not known better than that"
    )

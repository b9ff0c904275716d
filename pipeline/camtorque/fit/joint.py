"""Many recordings of one pump: shared physics fitted once, own nuisances each, every recording left out in turn.

Starts come from anchors, recordings that are explained alone. What is then fitted badly has its structure and end of
delivery searched anew with the shared values held. The error that the laws have in common does not average out: its
share of the weights, and the lift table's, grow with the number of recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.leftout import HeldOut, left_out_predictions
from camtorque.fit.prepare import DISCREPANCY, INDEPENDENT, SMALLEST_SHARE
from camtorque.fit.problem import FitData, Problem, build_problem, with_rows, with_starts
from camtorque.fit.result import fitted_torque, parameter_estimates, prior_findings
from camtorque.fit.search import SCAN_SHARES, rising_angles
from camtorque.fit.single import Candidate, Fit, FitOptions, Prepared, pressure_gain_std
from camtorque.fit.solver import Solution, lifts_at, solve, try_at
from camtorque.fit.uncertainty import covariance
from camtorque.laws.chain import BINS
from camtorque.records import Array, Finding, FittedTorque, LadderRung, ParameterEstimate, Refusal
from camtorque.units import DEGREE

MOST_ANCHORS = 8
MOST_STARTS = 5
SMOOTHINGS_DEG = (5.0, 1.5, 0.0)
ANCHOR_LIMIT, ANCHOR_FACTOR = 3.0, 3.0
"""An anchor's inflation alone is below the larger of this and so many times the least one."""
START_ITERATIONS = 6
OWN_ITERATIONS = 6
BAD_FACTOR = 4.0
"""A recording whose misfit exceeds the median by this factor has its structure searched anew."""
ASIDE_FACTOR = 25.0
SAME_SPEED = 0.05
TWO_STATES = 5.0
"""Standard errors between two recordings at one speed beyond which they are not one pump in one state."""
DRIFT_TOLD = 2.5
COMPARED = (
    "trigger_offset", "leakage", "dead_volume", "bearing_arm", "spring_preload_error", "port_closing_lift",
    "shaft_drag", "shaft_compliance",
)  # fmt: skip
"""Shared parameters that tell whether recordings belong to one pump in one state."""


@dataclass(frozen=True)
class Drift:
    """A shared parameter fitted to each recording alone, to see whether it drifts with speed.

    values and stderrs in ``unit``, in the order of ``recordings``; slope_per_1000_rpm of a weighted straight line and
    its standard error
    """

    name: str
    unit: str
    recordings: tuple[str, ...]
    speeds_rpm: tuple[float, ...]
    values: tuple[float, ...]
    stderrs: tuple[float, ...]
    slope_per_1000_rpm: float
    slope_stderr: float

    @property
    def told(self) -> bool:
        """Whether the slope stands out of its standard error."""
        return self.slope_stderr > 0.0 and abs(self.slope_per_1000_rpm) > DRIFT_TOLD * self.slope_stderr


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


def common_error(item: FitData, count: int) -> FitData:
    """Return a recording whose weights hold the error of the laws ``count`` times: it is the same in all."""
    torque = item.torque
    law = (SMALLEST_SHARE * np.max(np.abs(torque))) ** 2 + (DISCREPANCY * np.abs(torque)) ** 2
    variance = 1.0 / item.weight**2 + (count - 1.0) * law * BINS / INDEPENDENT
    return replace(item, weight=1.0 / np.sqrt(variance))


def with_common_rows(data: Sequence[FitData]) -> list[FitData]:
    """Return the recordings with the same bounds of the shared parameters."""
    names = [name for name, row in data[0].rows.items() if row.role == "shared"]
    limits = {
        name: {"lower": min(d.rows[name].lower for d in data), "upper": max(d.rows[name].upper for d in data)}
        for name in names
    }
    return [with_rows(item, limits) for item in data]


def anchors(prepared: Sequence[Prepared]) -> list[int]:
    """Return the places of the recordings that are explained alone, best first."""
    inflation = [covariance(item.candidates[0].problem, item.candidates[0].solution).inflation for item in prepared]
    limit = max(ANCHOR_LIMIT, ANCHOR_FACTOR * min(inflation))
    order = sorted(range(len(inflation)), key=lambda k: inflation[k])
    return [k for k in order if inflation[k] <= limit][:MOST_ANCHORS]


def shared_starts(found: Sequence[Candidate]) -> list[dict[str, float]]:
    """Return the anchors' shared values, the mean weighted by their information first."""
    each = []
    top, bottom = {}, {}  # type: ignore[var-annotated]
    for item in found:
        std = covariance(item.problem, item.solution).std
        values = {}
        for k, slot in enumerate(item.problem.slots):
            if slot.row.role == "shared":
                value, weight = float(item.solution.z[k]), 1.0 / float(std[k]) ** 2
                values[slot.row.name] = value
                top[slot.row.name] = top.get(slot.row.name, 0.0) + weight * value
                bottom[slot.row.name] = bottom.get(slot.row.name, 0.0) + weight
        each.append(values)
    return [{name: top[name] / bottom[name] for name in top}, *each]


def joint_solution(problem: Problem, start: Array, iterations: int, smoothing: float = 0.0) -> Solution:
    """Return a joint minimum; the lift table's error is one for all recordings."""
    lifts = lifts_at(problem, start, float(np.sqrt(len(problem.data))))
    return solve(problem, start, iterations, lifts, smoothing)


def solve_joint(prepared: Sequence[Prepared]) -> tuple[Problem, Solution]:
    """Return the joint minimum: that of the anchors first, then with every other recording searched anew."""
    count = len(prepared)
    data = with_common_rows([common_error(item.data, count) for item in prepared])
    chosen = anchors(prepared)
    starts = shared_starts([prepared[k].candidates[0] for k in chosen])
    problem, solution = _of_anchors([data[k] for k in chosen], starts[:MOST_STARTS])
    shared = {s.row.name: float(z) for s, z in zip(problem.slots, solution.z, strict=True) if s.recording < 0}
    items = [
        started_at(problem, solution, chosen.index(k)) if k in chosen else searched_anew(with_known(data[k], shared))
        for k in range(count)
    ]
    problem = build_problem(items)
    solution = joint_solution(problem, problem.start, 25)
    again = [started_at(problem, solution, k) for k in range(count)]
    bad = misfits(problem, solution)
    if any(bad):
        again = [searched_anew(item) if worse else item for item, worse in zip(again, bad, strict=True)]
        problem = build_problem(again)
        solution = joint_solution(problem, problem.start, 25)
    return problem, solution


def _of_anchors(data: Sequence[FitData], starts: Sequence[Mapping[str, float]]) -> tuple[Problem, Solution]:
    """Return the joint minimum of the anchors from the best two of some shared starts."""
    found: list[tuple[float, int, Problem, Solution]] = []
    for values in starts:
        problem = build_problem([searched_anew(with_known(item, values), (item.structure,)) for item in data])
        start = problem.start
        for smoothing in SMOOTHINGS_DEG:
            trial = joint_solution(problem, start, START_ITERATIONS, smoothing * DEGREE)
            start = trial.z
        found.append((trial.chi_square, len(found), problem, trial))
    found.sort(key=lambda entry: entry[:2])
    ends = []
    for _, _, problem, trial in found[:2]:
        again = build_problem([started_at(problem, trial, k) for k in range(len(data))])
        ends.append((again, joint_solution(again, again.start, 30)))
    return min(ends, key=lambda pair: pair[1].chi_square)


def with_known(item: FitData, values: Mapping[str, float]) -> FitData:
    """Return a recording that starts at shared values, those that it has rows for."""
    return with_starts(item, {name: value for name, value in values.items() if name in item.rows})


def started_at(problem: Problem, solution: Solution, index: int) -> FitData:
    """Return a recording that starts at a solution."""
    starts = {
        s.row.name: float(z) for s, z in zip(problem.slots, solution.z, strict=True) if s.recording in (-1, index)
    }
    return with_starts(problem.data[index], starts)


def misfits(problem: Problem, solution: Solution) -> list[bool]:
    """Return which recordings the joint fit meets much worse than the median one."""
    each = recording_misfit(solution)
    return [bool(value > max(BAD_FACTOR * float(np.median(each)), 30.0)) for value in each]


def recording_misfit(solution: Solution) -> Array:
    """Return the chi-square of each recording's residual."""
    return np.array([float(lift.product(r, r)) for lift, r in zip(solution.lifts, solution.residuals, strict=True)])


def own_fitted(item: FitData, iterations: int = OWN_ITERATIONS) -> FitData:
    """Return a recording whose own parameters were fitted with the shared ones held at their starts."""
    problem = build_problem([item], {name: row.start for name, row in item.rows.items() if row.role == "shared"})
    solution = solve(problem, None, iterations)
    return started_at(problem, solution, 0)


def searched_anew(item: FitData, structures: tuple[str, ...] = ("land", "spill", "open")) -> FitData:
    """Return a recording in the structure and with the end of delivery that the shared values like best."""
    held = {name: row.start for name, row in item.rows.items() if row.role == "shared"}
    found: list[tuple[float, int, FitData]] = []
    for structure in structures:
        other = replace(item, structure=structure)
        angles, lifts = rising_angles(other, SCAN_SHARES)
        name, places = ("end_of_delivery", angles) if structure == "land" else ("spill_lift", lifts)
        tried = [with_starts(other, {name: float(place)}) for place in places] if structure != "open" else [other]
        tried = [item, *tried] if structure == item.structure else tried
        for trial in tried:
            problem = build_problem([trial], held)
            found.append(
                (try_at(problem, problem.start, lifts_at(problem, problem.start)).chi_square, len(found), trial)
            )
    best = [entry[2] for entry in sorted(found, key=lambda entry: entry[:2])[:4]]
    fitted = [own_fitted(trial, 12) for trial in best]
    values = []
    for trial in fitted:
        problem = build_problem([trial], held)
        values.append(try_at(problem, problem.start, lifts_at(problem, problem.start)).chi_square)
    return fitted[int(np.argmin(values))]


def fit_joint(prepared: Sequence[Prepared], options: FitOptions | None = None) -> CampaignFit:
    """Return the joint fit of several recordings of one pump.

    Parameters
    ----------
    prepared : recordings whose minima are found
    options : choices of the user

    Raises
    ------
    Refusal : two recordings at one speed cannot be one pump in one state
    """
    refuse_two_states(prepared)
    used, aside = list(prepared), []
    while True:
        problem, solution = solve_joint(used)
        each = recording_misfit(solution)
        worst = int(np.argmax(each))
        if len(used) <= 3 or each[worst] < max(ASIDE_FACTOR * float(np.median(each)), 10.0 * INDEPENDENT):
            break
        aside.append(used.pop(worst).data.name)
    cov = covariance(problem, solution)
    drifts = shared_drifts(used) if len(used) > 2 else ()
    shifts = {"drift of what should be the same": drift_spread(problem, solution, drifts)}
    n = len(used)
    fit = Fit(
        problem, solution, cov, shifts, tuple(np.zeros((0, item.data.chain.theta.size)) for item in used), (), (), (),
        tuple(item.measured for item in used), tuple(pressure_gain_std(item.recording) for item in used),
    )  # fmt: skip
    fitted = tuple(
        fitted_torque(fit, k, item.recording, item.cycles, item.rigid, item.means) for k, item in enumerate(used)
    )
    held = left_out_predictions(used, fit) if n > 1 else ()
    rows = parameter_estimates(fit, 0)
    findings = (*prior_findings(rows), *_drift_findings(drifts), *_aside_findings(aside))
    names = tuple(item.data.name for item in used)
    shared = tuple(row for row in rows if row.role == "shared")
    return CampaignFit(names, (), shared, fitted, held, (), drifts, tuple(aside), findings, solution.chi_square)


def refuse_two_states(prepared: Sequence[Prepared]) -> None:
    """Refuse recordings at one speed whose shared parameters contradict each other."""
    for k, one in enumerate(prepared):
        for other in prepared[:k]:
            if abs(one.data.chain.speed / other.data.chain.speed - 1.0) > SAME_SPEED:
                continue
            for name, (a, s), (b, t), unit in _pairs(one.candidates[0], other.candidates[0]):
                if abs(a - b) > TWO_STATES * np.hypot(s, t):
                    raise Refusal(
                        f"joint fit: {other.data.name} and {one.data.name} run at one speed but differ in "
                        f"{name.replace('_', ' ')} ({b:.3g} +- {t:.2g} and {a:.3g} +- {s:.2g} {unit}): they are not "
                        "one pump in one state and are not averaged; give each state its own `group` in [recording], "
                        "or use `camtorque compare`"
                    )


def _pairs(one: Candidate, other: Candidate) -> list[tuple[str, tuple[float, float], tuple[float, float], str]]:
    stds = covariance(one.problem, one.solution).std, covariance(other.problem, other.solution).std
    result = []
    for name in COMPARED:
        k, j = one.problem.index(name), other.problem.index(name)
        if k >= 0 and j >= 0:
            row = one.problem.slots[k].row
            first = float(one.solution.z[k]) / row.per_unit, float(stds[0][k]) / row.per_unit
            second = float(other.solution.z[j]) / row.per_unit, float(stds[1][j]) / row.per_unit
            result.append((name, first, second, row.unit))
    return result


def shared_drifts(prepared: Sequence[Prepared]) -> tuple[Drift, ...]:
    """Return every shared parameter as each recording alone tells it, with its slope over speed."""
    speeds = np.array([item.data.chain.speed for item in prepared]) * 60.0 / (2.0 * np.pi)
    names = tuple(item.data.name for item in prepared)
    best = [item.candidates[0] for item in prepared]
    stds = [covariance(c.problem, c.solution).std for c in best]
    result = []
    for slot in best[0].problem.slots:
        places = [c.problem.index(slot.name) for c in best]
        if slot.row.role != "shared" or min(places) < 0:
            continue
        per = slot.row.per_unit
        values = np.array([c.solution.z[k] / per for c, k in zip(best, places, strict=True)])
        errors = np.array([std[k] / per for std, k in zip(stds, places, strict=True)])
        design = np.column_stack([np.ones_like(speeds), (speeds - np.mean(speeds)) / 1000.0]) / errors[:, None]
        cov = np.linalg.pinv(design.T @ design)
        slope = float((cov @ design.T @ (values / errors))[1])
        result.append(Drift(
            slot.name, slot.row.unit, names, tuple(speeds.tolist()), tuple(values.tolist()), tuple(errors.tolist()),
            slope, float(np.sqrt(cov[1, 1])),
        ))  # fmt: skip
    return tuple(result)


def drift_spread(problem: Problem, solution: Solution, drifts: Sequence[Drift]) -> Array:
    """Return how far the joint value of each parameter that drifts lies off the mean of the single ones, (k,) [SI]."""
    spread = np.zeros(problem.size)
    for drift in drifts:
        k = problem.index(drift.name)
        if drift.told and k >= 0:
            weight = 1.0 / np.array(drift.stderrs) ** 2
            mean = float(np.sum(weight * np.array(drift.values)) / np.sum(weight)) * problem.slots[k].row.per_unit
            spread[k] = abs(mean - solution.z[k])
    return spread


def _drift_findings(drifts: Sequence[Drift]) -> tuple[Finding, ...]:
    return tuple(
        Finding(
            "shared_parameter_drifts", "warning",
            f"{drift.name} should be the same in every recording but drifts by {drift.slope_per_1000_rpm:+.3g} +- "
            f"{drift.slope_stderr:.2g} {drift.unit} per 1000 rpm fitted alone: a law may be missing", drift.name,
        )
        for drift in drifts if drift.told
    )  # fmt: skip


def _aside_findings(aside: Sequence[str]) -> tuple[Finding, ...]:
    return tuple(
        Finding(
            "recording_left_aside", "warning",
            f"{name} does not fit the others ({ASIDE_FACTOR:.0f} times their misfit); left out of the joint fit", name,
        )
        for name in aside
    )  # fmt: skip

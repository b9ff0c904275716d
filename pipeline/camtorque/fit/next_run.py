"""What another recording would tell: the covariance of the fit with a recording that has not been made yet.

The chain predicts the recording from the present minimum, its design is added to the information of the fit, and the
standard errors before and after are compared (Fisher information; Raue et al., Bioinformatics 25 (2009), section 3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.predict import torque_zero
from camtorque.fit.prepare import with_rows
from camtorque.fit.problem import FitData, Problem, build_problem, own_name
from camtorque.fit.solve import Solution, chain_coefficients, solve
from camtorque.fit.uncertainty import covariance, parameter_names
from camtorque.laws.chain import evaluate_chain

EARLIER = 0.85
"""End of delivery of a smaller load, as a share of the present angle or lift."""
STANDSTILL_SHARE = 2.0e-4
"""Standard uncertainty of a torque zero read before and after the run, as a share of the peak torque."""
ADDED = "another run"
LOADS = ("end_of_delivery", "spill_lift")


@dataclass(frozen=True)
class Gain:
    """Standard error of one parameter before and after another recording, statistical, in the unit of the report."""

    recording: str
    name: str
    unit: str
    before: float
    after: float


def at_speed(factor: float) -> Callable[[FitData], FitData]:
    """Return how a recording changes with the speed: pressure over angle stays, times shrink."""

    def change(item: FitData) -> FitData:
        return replace(item, chain=replace(item.chain, speed=item.chain.speed * factor))

    return change


def unpressurised(item: FitData) -> FitData:
    """Return the recording with neither line nor chamber pressure."""
    chain = replace(item.chain, line_pressure=np.zeros_like(item.chain.line_pressure), uses_chamber=False)
    return replace(item, chain=chain, weight=np.full_like(item.weight, np.max(item.weight)))


def smaller_load(item: FitData) -> FitData:
    """Return the recording with an earlier end of delivery."""
    name = "spill_lift" if item.delivery == "spill" else "end_of_delivery"
    row = item.rows[name]
    return with_rows(item, {name: {"start": max(EARLIER * row.start, row.lower)}})


def zero_read(item: FitData) -> FitData:
    """Return the recording with standstill readings of the torque before and after."""
    std = STANDSTILL_SHARE * float(np.max(np.abs(item.torque)))
    prior = item.rows["torque_zero"].prior
    known = min(std, prior[1]) if prior is not None else std
    return with_rows(item, {"torque_zero": {"prior": (0.0, known)}})  # type: ignore[dict-item]


RUNS: dict[str, Callable[[FitData], FitData]] = {
    "the same load at half the speed": at_speed(0.5),
    "the same load at twice the speed": at_speed(2.0),
    "a smaller load at the same speed": smaller_load,
    "an unpressurised run at the same speed": unpressurised,
    "an unpressurised run at half the speed": lambda item: unpressurised(at_speed(0.5)(item)),
    "a repeat with standstill readings of the torque": zero_read,
}
"""Recording that could be made next -> how it differs from the present one."""


def expected_gains(problem: Problem, solution: Solution, index: int) -> tuple[Gain, ...]:
    """Return what every recording of `RUNS` would do to every parameter of one recording.

    Parameters
    ----------
    problem, solution : the chosen model at its minimum
    index : the recording that the next one would resemble
    """
    before = _deviations(problem, solution)
    result = []
    for recording, change in RUNS.items():
        after = _with_another(problem, solution, index, change)
        for slot in (*problem.nonlinear, *problem.linear):
            if slot.recording in (-1, index):
                label = own_name(slot.row.name, problem.data[index].name) if slot.recording >= 0 else slot.name
                pair = before[slot.name] / slot.row.per_unit, after[label] / slot.row.per_unit
                result.append(Gain(recording, slot.row.name, slot.row.unit, *pair))
    return tuple(result)


def _deviations(problem: Problem, solution: Solution) -> dict[str, float]:
    deviation = np.sqrt(np.maximum(np.diag(covariance(problem, solution).matrix), 0.0))
    return dict(zip(parameter_names(problem), map(float, deviation), strict=True))


def _with_another(
    problem: Problem, solution: Solution, index: int, change: Callable[[FitData], FitData]
) -> dict[str, float]:
    """Return the standard errors of the fit with one recording more, by label."""
    known = {slot.name: float(v) for slot, v in zip(problem.nonlinear, solution.x, strict=True)}
    item = problem.data[index]
    here = {slot.row.name: known[slot.name] for slot in problem.nonlinear if slot.recording in (-1, index)}
    started = with_rows(item, {name: {"start": value} for name, value in here.items()})
    extra = _predicted(replace(change(started), name=ADDED), problem, solution, index)
    more = _joined((*problem.data, extra), problem)
    start = [
        extra.rows[slot.row.name].start if slot.recording == len(problem.data) else _known(slot.name, known)
        for slot in more.nonlinear
    ]
    return _deviations(more, solve(more, np.array(start), max_iterations=0))


def _known(label: str, known: dict[str, float]) -> float:
    return known[label] if label in known else known[label.split("__")[0]]


def _joined(data: tuple[FitData, ...], problem: Problem) -> Problem:
    """Return the problem of more recordings; the links of each chain stay as they are given."""
    joined = build_problem(data, problem.effects)
    return replace(joined, data=data)


def _predicted(item: FitData, problem: Problem, solution: Solution, index: int) -> FitData:
    """Return the recording with the torque that the minimum predicts for it, so that it has no residual."""
    values = {**problem.values(solution.x, index), **{n: item.rows[n].start for n in LOADS if n in item.rows}}
    output = evaluate_chain(item.chain, values)
    torque = output.torque + output.linear @ chain_coefficients(problem, solution.c)
    return replace(item, torque=torque + torque_zero(problem, solution, index))

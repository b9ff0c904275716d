"""Many recordings of one pump: shared physics fitted once, own nuisances each, every recording left out in turn.

Starts come from anchors, recordings that are explained alone. What is then fitted badly has its structure and end of
delivery searched anew with the shared values held. The error that the laws have in common does not average out: its
share of the weights, and the lift table's, grow with the number of recordings.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.drift import (
    EXCLUSION_FACTOR,
    Drift,
    aside_findings,
    contradiction,
    contradiction_findings,
    drift_findings,
    drift_spread,
    shared_drifts,
)
from camtorque.fit.findings import prior_findings
from camtorque.fit.joint_fit import (
    JointFit,
    JointRecording,
    joint_covariance,
    joint_evidence,
    joint_recording,
    pin_shift,
    residual_covariance,
    softer_shift,
    with_likelier_pin,
)
from camtorque.fit.joint_input import (
    Alone,
    FittedAlone,
    JointInput,
    common_error,
    refuse_two_states,
    with_common_rows,
    with_own_triggers,
)
from camtorque.fit.joint_solver import JointSolution, solve_many
from camtorque.fit.kinds import PIN
from camtorque.fit.leftout import HeldOut, left_out, poor_findings, predicted, settling_findings
from camtorque.fit.minima import attempted
from camtorque.fit.one_ending import searched_anew, with_known, with_one_ending
from camtorque.fit.own_start import start_findings, with_own_starts
from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.problem import FitData, Problem, build_problem, started_at
from camtorque.fit.result import parameter_estimates
from camtorque.fit.shared_lift import SharedLift, shared_lift_from
from camtorque.fit.single import SOFTER, SWITCHING, switching_shift
from camtorque.process.threads import Each, in_turn, side_by_side
from camtorque.records import Array, Finding, LossEvidence, ParameterEstimate, Refusal
from camtorque.units import DEGREE

MOST_ANCHORS = 8
MOST_STARTS = 5
LADDER = ((5.0, 3), (1.5, 2), (0.0, 2))
"""Smoothings of the residual that starts walk down [deg], and how many of them go on from each."""
ANCHOR_LIMIT, ANCHOR_FACTOR = 3.0, 3.0
"""An anchor's inflation alone is below the larger of this and so many times the least one."""
START_ITERATIONS = 6
BAD_FACTOR = 4.0
"""A recording whose misfit exceeds the median by this factor has its structure searched anew."""
FEWEST = 3
"""Recordings of a joint fit below which none is excluded (`EXCLUSION_FACTOR`)."""


@dataclass(frozen=True)
class CampaignFit:
    """The joint fit: shared parameters, every recording's result, predictions of left-out recordings.

    ``covariance`` is that of the free parameters ``free``, at ``values`` (k,) [SI]; ``residual_covariance`` and
    ``lift`` are as in `known_fit.KnownFit`; ``evidence`` says whether the pump needs friction and damping.
    """

    names: tuple[str, ...]
    shared_parameters: tuple[ParameterEstimate, ...]
    fitted: tuple[JointRecording, ...]
    free: tuple[str, ...]
    values: Array
    covariance: ArrowCovariance
    held_out: tuple[HeldOut, ...]
    drifts: tuple[Drift, ...]
    excluded: tuple[str, ...]
    findings: tuple[Finding, ...]
    residual_covariance: ArrowCovariance | None
    lift: SharedLift
    evidence: tuple[LossEvidence, ...]


def anchors(inputs: Sequence[FittedAlone]) -> list[int]:
    """Return the places of the recordings that are explained alone and end as most of these do, best first.

    One pump mostly ends one way. What ends otherwise alone may have been taken for it: as an anchor it would bend all
    the others to its own, while its structure is searched anew with the values of those.
    """
    inflation = [item.inflation for item in inputs]
    limit = max(ANCHOR_LIMIT, ANCHOR_FACTOR * min(inflation))
    sound = sorted((k for k, value in enumerate(inflation) if value <= limit), key=lambda k: inflation[k])
    kinds = Counter(inputs[k].data.structure for k in sound)
    usual = kinds.most_common(1)[0][0]
    return [k for k in sound if inputs[k].data.structure == usual][:MOST_ANCHORS]


def shared_starts(found: Sequence[FittedAlone]) -> list[dict[str, float]]:
    """Return the anchors' shared values, the mean weighted by their information first."""
    rows: dict[str, list[Alone]] = {}
    for item in found:
        for name, row in item.alone.items():
            rows.setdefault(name, []).append(row)
    mean = {
        name: sum(1.0 / row.std**2 * row.value for row in each) / sum(1.0 / row.std**2 for row in each)
        for name, each in rows.items()
    }
    return [mean, *({name: row.value for name, row in item.alone.items()} for item in found)]


def solve_joint(inputs: Sequence[FittedAlone], each: Each = in_turn) -> tuple[Problem, JointSolution]:
    """Return the joint minimum: that of the anchors first, then with every other recording searched anew.

    An anchor that is then met badly has bent the others, and is none a second time. ``each`` calls with every
    recording; it changes no number.
    """
    chosen = anchors(inputs)
    problem, solution = _from_anchors(inputs, chosen, each)
    bad = met_badly(solution)
    sound = [k for k in chosen if not bad[k]]
    if 0 < len(sound) < len(chosen):
        again = attempted(_from_anchors, inputs, sound, each)
        if again and again[1].chi_square < solution.chi_square:
            problem, solution = again
    return with_bad_anew(problem, solution, each)


def _from_anchors(inputs: Sequence[FittedAlone], chosen: Sequence[int], each: Each) -> tuple[Problem, JointSolution]:
    """Return the joint minimum from some anchors, given by their places."""
    count = len(inputs)
    data = with_common_rows([common_error(item.data, count) for item in inputs])
    starts = shared_starts([inputs[k] for k in chosen])
    problem, solution = _of_anchors([data[k] for k in chosen], starts[:MOST_STARTS], each)
    shared = {s.row.name: float(z) for s, z in zip(problem.parameters, solution.z, strict=True) if s.recording < 0}
    others = [k for k in range(count) if k not in chosen]
    found = dict(zip(others, each(lambda k: searched_anew(with_known(data[k], shared)), others), strict=True))
    found |= dict(zip(chosen, started_at(problem, solution.z), strict=True))
    problem = build_problem([found[k] for k in range(count)])
    return problem, solve_many(problem, problem.start, 25, each=each)


def met_badly(solution: JointSolution) -> list[bool]:
    """Return for each recording whether a joint minimum meets it much worse than the median one."""
    limit = max(BAD_FACTOR * float(np.median(solution.misfits)), 30.0)
    return [bool(value > limit) for value in solution.misfits]


def with_bad_anew(problem: Problem, solution: JointSolution, each: Each) -> tuple[Problem, JointSolution]:
    """Return a joint minimum with what it meets much worse than the median searched anew, where that ends lower."""
    bad = met_badly(solution)
    if not any(bad):
        return problem, solution
    found = started_at(problem, solution.z)
    better = each(searched_anew, [item for item, is_bad in zip(found, bad, strict=True) if is_bad])
    anew = build_problem([better.pop(0) if is_bad else item for item, is_bad in zip(found, bad, strict=True)])
    ended = attempted(solve_many, anew, anew.start, 25, 0.0, each)
    return (anew, ended) if ended and ended.chi_square < solution.chi_square else (problem, solution)


def _of_anchors(
    data: Sequence[FitData], starts: Sequence[Mapping[str, float]], each: Each
) -> tuple[Problem, JointSolution]:
    """Return the joint minimum of the anchors from the best two of some shared starts."""
    n = len(data)
    begun = [with_known(item, values) for values in starts for item in data]
    items = each(lambda item: searched_anew(item, (item.structure,)), begun)
    problems = [build_problem(items[first : first + n]) for first in range(0, len(items), n)]
    again = [build_problem(started_at(problem, z)) for problem, z in _continued(problems, each)]
    ends = each(lambda problem: attempted(solve_many, problem, problem.start, 30), again)
    found = [(problem, end) for problem, end in zip(again, ends, strict=True) if end]
    if not found:
        raise FloatingPointError("no start of the joint fit ends anywhere")
    return min(found, key=lambda pair: pair[1].chi_square)


def _continued(problems: Sequence[Problem], each: Each) -> list[tuple[Problem, Array]]:
    """Return where the best of some starts lead with less and less smoothing."""
    led = [(problem, problem.start) for problem in problems]
    for smoothing, kept in LADDER:
        trials = each(partial(_step_down, smoothing=smoothing), led)
        going = [(problem, end) for (problem, _), end in zip(led, trials, strict=True) if end]
        led = [(problem, end.z) for problem, end in sorted(going, key=lambda pair: pair[1].chi_square)[:kept]] or led
    return led


def _step_down(start: tuple[Problem, Array], smoothing: float) -> JointSolution | None:
    return attempted(solve_many, *start, START_ITERATIONS, smoothing * DEGREE)


def fit_joint(known: Sequence[FittedAlone], read: Callable[[int], JointInput], threads: int) -> CampaignFit:
    """Return the joint fit of several recordings of one pump.

    Parameters
    ----------
    known : two recordings or more whose minima are found
    read : gives all of one of them by its place; only so many are held at a time as are worked at
    threads : recordings that are worked at side by side; it changes no number

    Raises
    ------
    Refusal : two recordings at one speed cannot be one pump in one state; no start leads to a minimum
    """
    try:
        with side_by_side(threads) as each:
            return _fit_joint(known, read, each)
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        raise Refusal(
            f"joint fit of {len(known)} recordings: every start runs to where the model overflows ({error}), expected "
            "a minimum near those of the single fits; leave out the recording whose page is least like the others'"
        ) from error


def _fit_joint(known: Sequence[FittedAlone], read: Callable[[int], JointInput], each: Each) -> CampaignFit:
    places, used, problem, solution = _solved(known, each)
    excluded = [item.name for place, item in enumerate(known) if place not in places]
    drifts = shared_drifts(used) if len(used) > 2 else ()
    fit = joint_fit_of(used, problem, solution, drifts, each)
    others = left_out(fit)

    def told(index: int) -> tuple[JointRecording, tuple[HeldOut, HeldOut], bool]:
        item = read(places[index])
        return joint_recording(fit, index, item), *predicted(fit, others, index, item)

    fitted, without, settled = zip(*each(told, range(len(used))), strict=True)
    held = tuple(row for both in without for row in both)
    shared = tuple(row for row in parameter_estimates(fit.recording(0)) if row.role == "shared")
    findings = (
        *prior_findings(shared),
        *(
            replace(found, where=f"{item.name}, {found.where}")
            for item, one in zip(used, fitted, strict=True)
            for found in prior_findings(one.parameters)
        ),
        *contradiction_findings(contradiction(fit.covariance.inflation, [item.inflation for item in used])),
        *start_findings(problem),
        *drift_findings(drifts),
        *aside_findings(excluded, [item.name for item, one in zip(used, fitted, strict=True) if not one.explained]),
        *poor_findings(held),
        *settling_findings([item.name for item, one in zip(used, settled, strict=True) if not one]),
    )
    return CampaignFit(
        tuple(item.name for item in used), shared, fitted, problem.names, solution.z,
        fit.covariance.arrow, held, drifts, tuple(excluded), findings,
        residual_covariance(solution, fit.covariance), shared_lift_from(problem, others.lift),
        joint_evidence(fit, all(one.explained for one in fitted), each),
    )  # fmt: skip


def _solved(known: Sequence[FittedAlone], each: Each) -> tuple[list[int], list[FittedAlone], Problem, JointSolution]:
    """Return the places of the recordings that fit together, these as they are fitted, and their joint minimum."""
    refuse_two_states(known)
    places = list(range(len(known)))
    used, problem, solution = _together(known, each)
    while odd := fitting_no_other(solution.misfits):
        places = [place for k, place in enumerate(places) if k not in odd]
        used, problem, solution = _together([known[place] for place in places], each)
    problem, solution = with_one_ending(problem, solution, each)
    problem, solution = with_likelier_pin(problem, solution, each)
    return places, used, problem, solution


def _together(known: Sequence[FittedAlone], each: Each) -> tuple[list[FittedAlone], Problem, JointSolution]:
    """Return recordings with what is each one's own, and their joint minimum."""
    used = with_own_triggers(known)
    return with_own_starts(used, *solve_joint(used, each), partial(solve_joint, each=each))


def fitting_no_other(misfits: Array) -> list[int]:
    """Return the places of recordings that the joint fit is done again without, the worst first.

    The worst of few, of many up to a tenth at once: done again for each of them, a fit of a thousand would never end.
    """
    limit = max(EXCLUSION_FACTOR * float(np.median(misfits)), 10.0 * INDEPENDENT)
    worst = [int(k) for k in np.argsort(-misfits, kind="stable") if misfits[k] >= limit]
    return worst[: min(max(1, len(misfits) // 10), max(len(misfits) - FEWEST, 0))]


def joint_fit_of(
    inputs: Sequence[FittedAlone], problem: Problem, solution: JointSolution, drifts: Sequence[Drift] = (),
    each: Each = in_turn,
) -> JointFit:  # fmt: skip
    """Return a joint minimum with its covariance and the uncertainties that do not average out."""
    covariance = joint_covariance(problem, solution)
    contradicted = contradiction(covariance.inflation, [item.inflation for item in inputs])
    spread = drift_spread(problem, solution.z, drifts, contradicted)
    pin, other_pin = pin_shift(problem, solution, covariance)
    shifts = {
        "drift of what should be the same": spread[None],
        SWITCHING: switching_shift(problem, [item.switching_std for item in inputs])[None],
        PIN: pin[None],
        SOFTER: softer_shift(problem, solution, covariance, each)[None],
    }
    return JointFit(problem, solution, covariance, shifts, other_pin)

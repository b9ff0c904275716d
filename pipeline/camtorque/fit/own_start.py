"""Where delivery begins in the recordings of one pump: at one lift in all, or at one of its own in each.

An inlet port closes at the same lift whatever the load is. A pump that is metered at its inlet, by a valve that is
switched or by an edge of the plunger that turns, begins elsewhere at every load.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from camtorque.fit.drift import CONTRADICTED, contradiction
from camtorque.fit.joint_fit import joint_covariance
from camtorque.fit.joint_input import FittedAlone
from camtorque.fit.joint_solver import JointSolution
from camtorque.fit.known_fit import FittedAt, KnownFit
from camtorque.fit.minima import attempted
from camtorque.fit.one_ending import OTHERWISE, costs
from camtorque.fit.problem import SEPARATOR, FitData, Problem, with_rows
from camtorque.records import Estimate, Finding

BEGIN = ("port_closing_lift", "port_span", "port_width", "port_roundness")
"""Parameters that say where, over how much of the lift and in what manner the inlet closes."""
Solve = Callable[[Sequence[FittedAlone]], tuple[Problem, JointSolution]]


def with_own_starts(
    inputs: Sequence[FittedAlone], problem: Problem, solution: JointSolution, solve: Solve
) -> tuple[list[FittedAlone], Problem, JointSolution]:
    """Return recordings and their joint minimum, each with its own start of delivery where that is better by enough.

    It is asked where recordings that are met alone contradict one another. What it has to gain is told by
    `one_ending.costs`.

    Parameters
    ----------
    solve : gives the joint minimum of recordings
    """
    inflation = joint_covariance(problem, solution).inflation
    if contradiction(inflation, [item.inflation for item in inputs]) <= CONTRADICTED:
        return list(inputs), problem, solution
    apart = [_with_own_start(item) for item in inputs]
    own = attempted(solve, apart)
    if own is None:
        return list(inputs), problem, solution
    shared_cost, own_cost = costs([(problem, solution), own])
    if own_cost + OTHERWISE * (len(inputs) - 1) < shared_cost:
        return apart, *own
    return list(inputs), problem, solution


def _with_own_start(item: FittedAlone) -> FittedAlone:
    own = {name: {"role": "own"} for name in BEGIN}
    alone = {name: row for name, row in item.alone.items() if name not in BEGIN}
    return replace(item, data=with_rows(item.data, own), alone=alone)


def begins_apart(problem: Problem) -> bool:
    """Return whether each recording of a joint fit has its own start of delivery."""
    return any(item.row.name in BEGIN and item.recording >= 0 for item in problem.parameters)


def begun_as(known: KnownFit, source: FittedAt, load: str) -> KnownFit:
    """Return a fit in which a recording begins to deliver as the one whose load it gets, where that has its own start.

    Parameters
    ----------
    load : name of the recording whose line pressure is the load, or of a file; empty where it is that of ``source``
    """
    if not _has_own(known, load):
        return known
    ends = {source.id: load, load: source.id}
    parts = [name.partition(SEPARATOR) for name in known.names]
    names = (name + mark + (ends.get(whose, whose) if name in BEGIN else whose) for name, mark, whose in parts)
    return replace(known, names=tuple(names))


def begun_elsewhere(known: KnownFit, source: FittedAt, load: str) -> dict[str, Estimate]:
    """Return the lift at which delivery begins under a load that no fitted recording has [SI].

    It is as unsure as those of other recordings lie from the one that is taken for it. Nothing where all begin alike.
    ``load`` as in `begun_as`.
    """
    if not load or _has_own(known, load) or not _has_own(known, source.id):
        return {}
    found = [item.id for item in known.recordings if _has_own(known, item.id)]  # none where the chamber was measured
    lifts = {name: float(known.values[known.own(name)[BEGIN[0]]]) for name in found}
    taken = lifts.pop(source.id)
    apart = np.array([lift - taken for lift in lifts.values()])
    return {BEGIN[0]: Estimate(taken, float(np.sqrt(np.mean(apart**2))))} if lifts else {}


def _has_own(known: KnownFit, recording: str) -> bool:
    return BEGIN[0] + SEPARATOR + recording in known.names


def predicted_to_begin(known: KnownFit, source: FittedAt, load: str) -> str:
    """Return what is taken for the start of delivery of a run that was not made; nothing where all begin alike.

    ``load`` as in `begun_as`.
    """
    name = next((one for one in (load, source.id) if _has_own(known, one)), "")
    if not name:
        return ""
    text = f"; delivery begins at the lift at which that of {name} does: in this pump each load begins elsewhere"
    return f"{text}, and how far fitted ones lie apart is in the band" if load not in ("", name) else text


def begun_as_nearest(known: KnownFit, item: FitData) -> dict[str, float]:
    """Return where delivery begins in the other recording that is nearest in speed [SI]; nothing where all begin alike.

    Nothing tells where a run that was not made begins.
    """
    others = [one for one in known.recordings if one.id != item.name and _has_own(known, one.id)]
    if not others:
        return {}
    nearest = min(others, key=lambda one: abs(np.log(one.speed / item.chain.speed)))
    places = known.own(nearest.id)
    return {
        name: float(known.values[places[name]])
        for name in BEGIN if name in places and item.rows[name].role == "own"
    }  # fmt: skip


def start_findings(problem: Problem) -> tuple[Finding, ...]:
    """Return a note on recordings that begin to deliver at lifts of their own."""
    if not begins_apart(problem):
        return ()
    text = (
        "delivery begins at another lift in each recording, as in a pump that is metered at its inlet, or whose port "
        "was moved between them: it is each recording's own, fitted where one is predicted from the others, and that "
        "of the nearest speed in a blind prediction"
    )
    return (Finding("own_starts", "info", text, BEGIN[0]),)

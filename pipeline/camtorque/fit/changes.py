"""Which parameters changed between two recordings: evidence over sets of plausible changes.

A change is a group of parameters that one event moves (wear, mounting, temperature). Every single event is fitted
together with all that is common and own, and so are those sets of up to three that its linearisation makes worth it;
the evidence of a set is taken at its own minimum, since what a change explains bends with the size of what it changes.
Probabilities of a change are sums over the sets. The prior odds of each group and the width of each parameter
(`fit.events`) pay for the length of the list.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product

import numpy as np

from camtorque.fit.difference import (
    Basis,
    PairState,
    along,
    evaluated,
    inflation,
    minimised,
    normal_equations,
    objective,
)
from camtorque.fit.events import ALWAYS, CHANGES, basis_of, may_differ, two_ln_odds
from camtorque.fit.pair import TwoRecordings, with_difference
from camtorque.process.second_process import in_two
from camtorque.records import Array

TOLD = 0.90
"""Probability from which a change is told."""
MOST_CHANGES = 3
EXTENDED, WORTH = 3, 8.0
"""Sets of each size that get another event, and how far below the best its linearised two ln evidence may be."""
OTHERS = 2
"""Other events that may have happened beside the one whose smallest visible change is asked for."""
ALONE_ITERATIONS, START_ITERATIONS, ITERATIONS = 20, 8, 20
RULED_OUT = 50.0
"""A set whose objective is so many times the least one is left where it is: its probability is nothing."""


@dataclass(frozen=True)
class EventSetPosterior:
    """A set of groups and its posterior.

    two_ln_evidence : with the prior odds; mean, covariance : of the differences of all candidates, (m,), (m, m) [SI]
    """

    groups: tuple[str, ...]
    two_ln_evidence: float
    mean: Array
    covariance: Array


@dataclass(frozen=True)
class Attribution:
    """What changed.

    Attributes
    ----------
    names : parameters that may differ, own ones first
    hypotheses : best first
    probabilities : of the hypotheses
    mean, covariance : of the differences, mixed over the hypotheses [SI]
    free_mean, free_std : farthest from zero and widest of each difference while it, and any two other events beside the
        best ones, are free, (m,) [SI]
    inflation : factors on the variance of mean and difference that their residuals ask for
    state : the pair at the best hypothesis
    """

    names: tuple[str, ...]
    hypotheses: tuple[EventSetPosterior, ...]
    probabilities: tuple[float, ...]
    mean: Array
    covariance: Array
    free_mean: Array
    free_std: Array
    inflation: tuple[float, float]
    state: PairState

    def moved(self, *names: str) -> float:
        """Return the probability that a group changed to which one of some parameters belongs."""
        pairs = zip(self.hypotheses, self.probabilities, strict=True)
        return float(sum(p for item, p in pairs if any(name in CHANGES[g] for g in item.groups for name in names)))

    @property
    def unchanged(self) -> float:
        """Probability that no event happened."""
        return float(sum(p for item, p in zip(self.hypotheses, self.probabilities, strict=True) if not item.groups))

    @property
    def best(self) -> tuple[str, ...]:
        """Groups of the best hypothesis."""
        return self.hypotheses[0].groups


@dataclass(frozen=True)
class EventSetMinimum:
    """A set of groups at its own minimum.

    covariance : along the directions, whatever the common values are, (m, m)
    """

    groups: tuple[str, ...]
    state: PairState
    covariance: Array
    two_ln_evidence: float


def marginal(matrix: Array, vector: Array, k: int) -> tuple[Array, Array]:
    """Return normal equations of all unknowns after the first ``k``, which are integrated out."""
    gain = np.linalg.solve(matrix[:k, :k], np.column_stack([matrix[:k, k:], vector[:k]]))
    return matrix[k:, k:] - matrix[k:, :k] @ gain[:, :-1], vector[k:] - matrix[k:, :k] @ gain[:, -1]


def fitted(pair: TwoRecordings, start: tuple[PairState, tuple[str, ...], int]) -> EventSetMinimum:
    """Return a set at its minimum; ``start``: state of a smaller set, the groups, iterations at most."""
    state, groups, iterations = start
    state = minimised(pair, along(pair, state, basis_of(pair, state.before, groups)), iterations)
    matrix, vector = normal_equations(pair, state, state.basis.columns, state.moved)
    apart, _ = marginal(matrix, vector, len(pair.names))
    evidence = -objective(pair, state) - float(np.linalg.slogdet(apart)[1]) + two_ln_odds(groups)
    return EventSetMinimum(groups, state, np.asarray(np.linalg.inv(apart)), evidence)


def differences(pair: TwoRecordings, item: EventSetMinimum, names: Sequence[str]) -> EventSetPosterior:
    """Return the differences of some parameters under a set of groups: what its events moved, and what always differs.

    The error of edges and starts that each recording has its own is no change of the trigger.
    """
    state = item.state
    counts = [bool(event) or name in ALWAYS for event, name in state.basis.labels]
    place = [pair.names.index(name) for name in names]
    rows = state.basis.columns[place] * counts
    beside = (state.basis.columns @ (state.moved * np.logical_not(counts)))[place]
    mean = np.where(rows.any(axis=1), (state.after - state.before)[place] - beside, 0.0)
    return EventSetPosterior(item.groups, item.two_ln_evidence, mean, rows @ item.covariance @ rows.T)


def evidence_with(pair: TwoRecordings, item: EventSetMinimum, group: str) -> float:
    """Return two ln evidence of a set with one more event, linearised where the set has its minimum."""
    basis = basis_of(pair, item.state.before, (*item.groups, group))
    place = {label: k for k, label in enumerate(item.state.basis.labels)}
    moved = np.array([item.state.moved[place[label]] if label in place else 0.0 for label in basis.labels])
    matrix, vector = normal_equations(pair, item.state, basis.columns, moved)
    matrix, vector = marginal(matrix, vector, len(pair.names))
    gain = float(vector @ np.linalg.solve(matrix, vector))
    return gain - objective(pair, item.state) - float(np.linalg.slogdet(matrix)[1]) + two_ln_odds((*item.groups, group))


def searched(
    pair: TwoRecordings, states: Mapping[tuple[str, ...], PairState], groups: Sequence[str]
) -> tuple[EventSetMinimum, ...]:
    """Return no event, every single one, and the sets of up to `MOST_CHANGES` that are worth it, best first.

    Parameters
    ----------
    states : near the minimum of no event and of each single one
    """
    lost = ruled_out({chosen: objective(pair, state) for chosen, state in states.items()})
    starts = [(state, chosen, 0 if chosen in lost else ITERATIONS) for chosen, state in states.items()]
    found = dict(zip(states, in_two(partial(fitted, pair), starts), strict=True))
    for size in range(1, MOST_CHANGES):
        best = max(item.two_ln_evidence for item in found.values())
        smaller = sorted((item for item in found.values() if len(item.groups) == size),
                         key=lambda item: -item.two_ln_evidence)[:EXTENDED]  # fmt: skip
        larger: dict[tuple[str, ...], PairState] = {}
        for item, group in product(smaller, groups):
            chosen = tuple(sorted((*item.groups, group), key=list(CHANGES).index))
            if group not in item.groups and chosen not in larger and evidence_with(pair, item, group) > best - WORTH:
                larger[chosen] = item.state
        starts = [(state, chosen, 12) for chosen, state in larger.items()]
        found |= zip(larger, in_two(partial(fitted, pair), starts), strict=True)
    return tuple(sorted(found.values(), key=lambda item: -item.two_ln_evidence))


def attribution(pair: TwoRecordings) -> tuple[Attribution, TwoRecordings]:
    """Return what changed, and the pair with the weights that were used."""
    told = set(pair.names) - ({"trigger_offset"} if pair.other_trigger else set())  # that one tells of no event
    groups = tuple(name for name, names in CHANGES.items() if told.intersection(names))
    values = np.array([pair.fixed[name] for name in pair.names])
    own = basis_of(pair, values, ())
    here = evaluated(pair, values, own, np.zeros(len(own.labels)))
    sets = [(), *((group,) for group in groups)]
    bases = [basis_of(pair, values, chosen) for chosen in sets]
    states = dict(zip(sets, in_two(partial(near_minimum, pair, here), bases), strict=True))
    # the weights are those of the set that leaves least: under the weights of "no change" a large change is only noise
    least = min(states.values(), key=lambda state: objective(pair, state))
    pair = with_difference(pair, pair.values(least.before), 0.5 * (least.residuals[0] + least.residuals[1]))
    states = nested(pair, polished(pair, states))
    factors = min((inflation(pair, state) for state in states.values()), key=lambda item: (item[1], item[0]))
    roots = [root * np.sqrt(f) for root, f in zip((pair.mean_root, pair.difference_root), factors, strict=True)]
    pair = replace(pair, mean_root=roots[0], difference_root=roots[1])
    found, names = searched(pair, states, groups), may_differ(pair)
    hypotheses = tuple(differences(pair, item, names) for item in found)
    weight, mean, covariance = mixture(hypotheses, np.array([item.two_ln_evidence for item in hypotheses]))
    free = freed(pair, found[0], names, groups)
    return Attribution(names, hypotheses, weight, mean, covariance, *free, factors, found[0].state), pair


def near_minimum(pair: TwoRecordings, here: PairState, basis: Basis) -> PairState:
    """Return a set near its minimum: first its directions alone, from the first recording's own fit.

    What is common runs away where a change has no name, and before a large one with a name has grown to its size.
    """
    alone = minimised(pair, along(pair, here, basis), ALONE_ITERATIONS, common=False)
    return minimised(pair, alone, START_ITERATIONS)


def ruled_out(values: Mapping[tuple[str, ...], float]) -> set[tuple[str, ...]]:
    """Return the sets of which nothing can come, by the objective of each."""
    least = min(values.values())
    return {chosen for chosen, value in values.items() if value > RULED_OUT * least}


def polished(pair: TwoRecordings, states: Mapping[tuple[str, ...], PairState]) -> dict[tuple[str, ...], PairState]:
    """Return every set that may still be the one at its minimum, and the others as they are."""
    lost = ruled_out({chosen: objective(pair, state) for chosen, state in states.items()})
    kept = {chosen: state for chosen, state in states.items() if chosen not in lost}
    ends = in_two(partial(minimised, pair, iterations=ITERATIONS), list(kept.values()))
    return {**states, **dict(zip(kept, ends, strict=True))}


def nested(pair: TwoRecordings, states: Mapping[tuple[str, ...], PairState]) -> dict[tuple[str, ...], PairState]:
    """Return states of which none that may be the one lies above no event, which starts again from the least one."""
    values = {chosen: objective(pair, state) for chosen, state in states.items()}
    least = states[min(values, key=lambda chosen: values[chosen])]
    again = minimised(pair, along(pair, least, states[()].basis), ITERATIONS)
    base = min((states[()], again), key=lambda state: objective(pair, state))
    floor, lost = objective(pair, base), ruled_out(values)
    found: dict[tuple[str, ...], PairState] = {(): base}
    for chosen, state in states.items():
        if chosen and values[chosen] > floor and chosen not in lost:
            state = minimised(pair, along(pair, base, state.basis), ITERATIONS)
        found.setdefault(chosen, state)
    return found


def freed(
    pair: TwoRecordings, best: EventSetMinimum, names: Sequence[str], groups: Sequence[str]
) -> tuple[Array, Array]:
    """Return how far each difference may be from zero and how well it is known, whatever two other events did, (m,)."""
    state = best.state
    basis = basis_of(pair, state.before, [group for group in groups if group != "temperature"])
    own = len(pair.own)
    by_events = state.after - state.before - state.basis.columns[:, :own] @ state.moved[:own]
    apart = by_events / np.max(np.abs(basis.columns), axis=1, initial=1e-300)
    moved = np.array([0.0 if not event else apart[pair.names.index(name)] for event, name in basis.labels])
    moved[:own] = state.moved[:own]
    matrix, vector = normal_equations(pair, state, basis.columns, moved)
    matrix, vector = marginal(matrix, vector, len(pair.names))
    vector = vector + matrix @ moved  # extrapolated to where nothing differs
    events = list(dict.fromkeys(event for event, _ in basis.labels[own:]))
    index = {event: [j for j, label in enumerate(basis.labels) if label[0] == event] for event in ("", *events)}
    always = [*index[""], *(j for event in best.groups for j in index.get(event, []))]
    result = np.zeros((2, len(names)))
    for j, (event, name) in enumerate(basis.labels):
        if not event:
            continue
        width = float(np.max(np.abs(basis.columns[:, j])))
        for others in combinations([other for other in events if other != event and other not in best.groups], OTHERS):
            chosen = sorted({j, *always, *(i for other in others for i in index[other])})
            covariance = np.linalg.inv(matrix[np.ix_(chosen, chosen)])
            at = chosen.index(j)
            mean, std = float(covariance[at] @ vector[chosen]), float(np.sqrt(covariance[at, at]))
            k = list(names).index(name)
            result[0, k] = max(result[0, k], mean * width, key=abs)
            result[1, k] = max(result[1, k], std * width)
    return result[0], result[1]


def mixture(hypotheses: Sequence[EventSetPosterior], evidence: Array) -> tuple[tuple[float, ...], Array, Array]:
    """Return the probabilities of some hypotheses, and mean and covariance over them."""
    weight = np.exp(0.5 * (evidence - np.max(evidence)))
    weight /= np.sum(weight)
    kept = [(float(w), item) for w, item in zip(weight, hypotheses, strict=True) if w > 1e-6]
    mean = np.sum([w * item.mean for w, item in kept], axis=0)
    parts = [w * (item.covariance + np.outer(item.mean - mean, item.mean - mean)) for w, item in kept]
    return tuple(weight.tolist()), np.asarray(mean), np.asarray(np.sum(parts, axis=0))

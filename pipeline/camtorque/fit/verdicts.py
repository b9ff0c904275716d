"""Differences of parameters and losses with their verdicts: changed, not changed, cannot tell.

*Changed*: the sets of changes that move it hold `TOLD` of the probability. *Not changed*: whatever any two other events
did, the interval stays within the smallest change that would have been seen, and that is smaller than what matters.
Everything else cannot be told. Behind the differences of several pairs of recordings of one pump are the same events.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from camtorque.fit.changes import TOLD, Attribution, EventSetPosterior, mixture
from camtorque.fit.derived import work_at
from camtorque.fit.events import ALWAYS, CHANGES, basis_of, two_ln_odds
from camtorque.fit.gains import GAINS
from camtorque.fit.pair import TwoRecordings
from camtorque.laws import GROUPS
from camtorque.laws.chain import coefficients_of
from camtorque.records import Array
from camtorque.units import COVERAGE

SEEN = 4.3
"""Standard errors of a change that would have been told nearly always, the whole list counted."""
SURE = 2.6
SIGNED = 0.67
"""Standard errors that a change has at least that is told with its size: its sign is then known by three to one."""
HINTS = 25.0
"""Inflation of the difference above which nothing is told by name: something changed that no event stands for. It was
13 where a preload was named rightly, 62 where a softer coupling was told as one."""
MATTERS = 1.0
"""Size that matters, in steps of a parameter."""
BALANCE_LOSSES: dict[str, tuple[str, ...]] = {**GROUPS, "pressure": ()}
"""Loss of the energy balance -> parameters that it vanishes or moves with."""
SMALL_LOSS = 0.05
"""Change of a loss that matters, as a share of the larger of the loss and a hundredth of the input."""


@dataclass(frozen=True)
class Difference:
    """One parameter or loss, in ``unit``.

    stderr leaves out what both recordings share; smallest_change would have been seen; matters is the size asked for
    """

    name: str
    before: float
    after: float
    difference: float
    stderr: float
    unit: str
    verdict: str
    smallest_change: float
    matters: float

    @property
    def ci95(self) -> tuple[float, float]:
        """95 % interval of the difference; that of a change that is told has its sign: only its size is in doubt."""
        if self.verdict == "changed" and self.difference:
            factor = float(np.exp(COVERAGE * self.stderr / abs(self.difference)))
            low, high = sorted((self.difference / factor, self.difference * factor))
            return low, high
        return self.difference - COVERAGE * self.stderr, self.difference + COVERAGE * self.stderr


def verdict(told: bool, free: tuple[float, float], matters: float) -> str:
    """Return the verdict of a difference.

    Parameters
    ----------
    told : whether the evidence names it
    free : difference and standard error whatever two other events did
    matters : size that matters, in the same unit
    """
    if told:
        return "changed"
    mean, std = free
    smallest = SEEN * std
    return "not changed" if smallest <= matters and abs(mean) + SURE * std <= smallest else "cannot tell"


def of_a_gain(rows: Sequence[Difference]) -> tuple[Difference, ...]:
    """Return differences of which none names a part of the pump: the torque is another one times a factor."""
    hidden = [row.verdict == "changed" and row.name not in GAINS for row in rows]
    return tuple(replace(row, verdict="cannot tell") if one else row for row, one in zip(rows, hidden, strict=True))


def whole_verdict(rows: Sequence[Difference], found: Attribution) -> str:
    """Return the verdict on the whole list: that something changed can be sure where none of the names is."""
    kinds = {row.verdict for row in rows}
    if "changed" in kinds or found.unchanged < 1.0 - TOLD:
        return "changed"
    return "not changed" if kinds == {"not changed"} else "cannot tell"


def parameter_differences(pair: TwoRecordings, found: Attribution) -> tuple[Difference, ...]:
    """Return every parameter that belongs to the pump and may differ."""
    result = []
    for j, name in enumerate(found.names):
        if name in ALWAYS or (pair.other_trigger and name == "trigger_offset"):  # each side's own
            continue
        row = pair.items[0].rows[name]
        k = pair.names.index(name)
        per = row.per_unit
        mean, std = float(found.mean[j]) / per, float(np.sqrt(found.covariance[j, j])) / per
        free = float(found.free_mean[j]) / per, float(found.free_std[j]) / per
        matters = MATTERS * row.step / per
        # an event of several parameters is told by the one that surely moved as far as matters
        told = _named(found, name) and (_alone(found, name) or abs(mean) > max(SEEN * std, matters))
        before = float(found.state.before[k]) / per
        if not told:
            mean, std = free
        # a linearised difference knows no bounds: no friction below zero is ever stated
        after = float(np.clip(before + mean, row.lower / per, row.upper / per))
        kind = verdict(told and abs(mean) > SIGNED * std, free, matters)
        result.append(Difference(
            name, before, after, after - before, std, row.unit, kind, SEEN * free[1], matters
        ))  # fmt: skip
    return tuple(result)


def common_attributions(found: Sequence[Attribution], pairs: Sequence[TwoRecordings]) -> tuple[Attribution, ...]:
    """Return the attributions of several pairs of one pump when the same events are behind all of them."""
    every = dict.fromkeys(item.groups for one in found for item in one.hypotheses)
    each = [{groups: _within(*one, groups) for groups in every} for one in zip(found, pairs, strict=True)]
    score = {g: sum(one[g].two_ln_evidence for one in each) - (len(each) - 1) * two_ln_odds(g) for g in every}
    order = sorted(every, key=lambda groups: (-score[groups], groups))
    evidence = np.array([score[groups] for groups in order])
    result = []
    for one, table in zip(found, each, strict=True):
        hypotheses = tuple(table[groups] for groups in order)
        weight, mean, covariance = mixture(hypotheses, evidence)
        result.append(replace(one, hypotheses=hypotheses, probabilities=weight, mean=mean, covariance=covariance))
    return tuple(result)


def _within(found: Attribution, pair: TwoRecordings, groups: tuple[str, ...]) -> EventSetPosterior:
    """Return a set, or where it was not worth fitting the best of its parts, with the odds of what it adds.

    Of what it adds the pair says nothing: that is as unsure as beforehand, not known to be zero.
    """
    parts = [item for item in found.hypotheses if set(item.groups) <= set(groups)]

    def added(item: EventSetPosterior) -> list[str]:
        return [name for name in groups if name not in item.groups]

    def score(item: EventSetPosterior) -> float:
        return item.two_ln_evidence + two_ln_odds(added(item))

    exact = [item for item in parts if item.groups == groups]
    best = exact[0] if exact else max(parts, key=score)
    basis = basis_of(pair, found.state.before, added(best))
    rows = [pair.names.index(name) for name in found.names]
    open_ones = basis.columns[rows][:, [bool(group) for group, _ in basis.labels]]
    covariance = best.covariance + open_ones @ open_ones.T
    return replace(best, groups=groups, two_ln_evidence=score(best), covariance=covariance)


def pooled(rows: Sequence[Difference]) -> Difference:
    """Return one difference of several pairs, weighted by what each knows."""
    weight = np.array([1.0 / max(row.stderr, 1e-30) ** 2 for row in rows])
    std = float(1.0 / np.sqrt(np.sum(weight)))
    weight /= np.sum(weight)
    mean = [float(weight @ [getattr(row, key) for row in rows]) for key in ("before", "difference")]
    smallest = float(1.0 / np.sqrt(np.sum([1.0 / max(row.smallest_change, 1e-30) ** 2 for row in rows])))
    told = any(row.verdict == "changed" for row in rows)
    kind = verdict(told, (mean[1], smallest / SEEN), rows[0].matters)
    return Difference(
        rows[0].name, mean[0], mean[0] + mean[1], mean[1], std, rows[0].unit, kind, smallest, rows[0].matters
    )


def _named(found: Attribution, *names: str) -> bool:
    """Return whether events that move some parameters are told: probable, and enough to explain what changed."""
    return found.moved(*names) > TOLD and found.inflation[1] <= HINTS


def _alone(found: Attribution, name: str) -> bool:
    """Return whether a parameter is told by itself: its event moves it in a fixed proportion, or it alone."""
    return any(len(CHANGES[g]) == 1 or g == "temperature" for g in found.best if name in CHANGES[g])


def works(pair: TwoRecordings, values: Array, side: int) -> dict[str, float]:
    """Return the work of each loss of one recording at values of the free parameters, (k,) [J per revolution]."""
    chain, full = pair.sensed(side, values)
    return work_at(chain, full, coefficients_of(full))


def loss_differences(pair: TwoRecordings, found: Attribution) -> tuple[Difference, ...]:
    """Return the losses with the differences that their parameters' differences make."""
    base, after = works(pair, found.state.before, 0), works(pair, found.state.after, 1)
    slopes = _slopes(pair, found, after)
    total = sum(base.values())
    result = []
    for name, members in BALANCE_LOSSES.items():
        slope = slopes[name]
        std = float(np.sqrt(np.maximum(slope @ found.covariance @ slope, 0.0)))
        free = float(np.sqrt(np.sum((slope * found.free_std) ** 2)))
        told = _named(found, *members)
        moved = after[name] - base[name]
        matters = SMALL_LOSS * max(abs(base[name]), 0.01 * abs(total))
        mean = float(slope @ found.free_mean)
        kind = verdict(told and abs(moved) > SIGNED * std, (mean, free), matters)
        std = std if told else max(std, free)
        result.append(
            Difference(name, base[name], after[name], moved, std, "J per revolution", kind, SEEN * free, matters)
        )
    return tuple(result)


def _slopes(pair: TwoRecordings, found: Attribution, after: Mapping[str, float]) -> Mapping[str, Array]:
    """Return the derivative of each loss by the differences, (m,) [J per SI]; ``after``: losses of the second."""
    slopes = {name: np.zeros(len(found.names)) for name in BALANCE_LOSSES}
    for j, parameter in enumerate(found.names):
        k = pair.names.index(parameter)
        step = 0.1 * pair.items[1].rows[parameter].step
        moved = found.state.after.copy()
        moved[k] += step
        shifted = works(pair, moved, 1)
        for name in BALANCE_LOSSES:
            slopes[name][j] = (shifted[name] - after[name]) / step
    return slopes

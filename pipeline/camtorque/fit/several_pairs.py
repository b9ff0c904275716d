"""Several pairs of recordings of one pump: the same events are behind all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from camtorque.fit.changes import Attribution, Hypothesis, mixture, two_ln_odds


def common_attributions(found: Sequence[Attribution]) -> tuple[Attribution, ...]:
    """Return the attributions of several pairs of one pump when the same events are behind all of them."""
    every = dict.fromkeys(item.groups for one in found for item in one.hypotheses)
    each = [{groups: _within(one.hypotheses, groups) for groups in every} for one in found]
    score = {g: sum(one[g].two_ln_evidence for one in each) - (len(each) - 1) * two_ln_odds(g) for g in every}
    order = sorted(every, key=lambda groups: (-score[groups], groups))
    evidence = np.array([score[groups] for groups in order])
    result = []
    for one, table in zip(found, each, strict=True):
        hypotheses = tuple(table[groups] for groups in order)
        weight, mean, covariance = mixture(hypotheses, evidence)
        result.append(replace(one, hypotheses=hypotheses, probabilities=weight, mean=mean, covariance=covariance))
    return tuple(result)


def _within(hypotheses: Sequence[Hypothesis], groups: tuple[str, ...]) -> Hypothesis:
    """Return a set, or where it was not worth fitting the best of its parts, with the odds of what it adds."""
    parts = [item for item in hypotheses if set(item.groups) <= set(groups)]

    def score(item: Hypothesis) -> float:
        return item.two_ln_evidence + two_ln_odds([name for name in groups if name not in item.groups])

    exact = [item for item in parts if item.groups == groups]
    best = exact[0] if exact else max(parts, key=score)
    return replace(best, groups=groups, two_ln_evidence=score(best))

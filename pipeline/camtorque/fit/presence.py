"""Bayes factors of parameters against zero from one fit's Gaussian: of a set of them, of two groups of parts.

The parts of a group may be there or not, each by itself: its evidence is the mean over all sets of them, not that of
all at once, which pays for every part that the data do not know.
Sources: Dickey, Ann. Math. Statist. 42 (1971); George & McCulloch, JASA 88 (1993).
"""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np

from camtorque.fit.truncated import Gaussian


def savage_dickey(posterior: Gaussian, prior: Gaussian, chosen: Any) -> float:
    """Return 2 ln K for parameters (indices ``chosen``) against zero."""
    return _ratio(posterior, chosen) - _ratio(prior, chosen)


def _ratio(whole: Gaussian, chosen: Any) -> float:
    mean, matrix = whole.mean, whole.matrix
    rest = np.setdiff1d(np.arange(mean.size), chosen)
    block = matrix[np.ix_(chosen, chosen)]
    solved = np.linalg.solve(block, mean[chosen])
    quadratic = float(mean[chosen] @ solved) + float(np.linalg.slogdet(block)[1])
    gain = np.linalg.solve(block, matrix[np.ix_(chosen, rest)])
    conditional = matrix[np.ix_(rest, rest)] - matrix[np.ix_(rest, chosen)] @ gain
    given = Gaussian(mean[rest] - gain.T @ mean[chosen], conditional, whole.lower[rest], whole.upper[rest])
    return quadratic + 2.0 * (whole.within.log_probability - given.within.log_probability)


def presence(known: Gaussian, before: Gaussian, n_first: int) -> tuple[float, float, float]:
    """Return 2 ln K for the first group of parts, for the second, and for either: means over the sets with and without.

    Beforehand a group is there or not, and how many of its parts, and which, are equally probable each.

    Parameters
    ----------
    known, before : of the parts, the first group's first, with and without the data; before them they are independent
    n_first : parts of the first group
    """
    sizes = n_first, known.mean.size - n_first
    beforehand = np.array([_ratio(before, np.array([k])) for k in range(known.mean.size)])
    logs, counts = [], []
    for there in product((False, True), repeat=known.mean.size):
        gone = np.flatnonzero(~np.array(there))
        n_there = sum(there[:n_first]), sum(there[n_first:])
        choices = [size * math.comb(size, n) for size, n in zip(sizes, n_there, strict=True) if n]
        ratio = _ratio(known, gone) - float(np.sum(beforehand[gone])) if gone.size else 0.0
        logs.append(-0.5 * ratio - sum(map(math.log, choices)))
        counts.append(n_there)
    log_weights, present = np.array(logs), np.array(counts) > 0

    def factor(with_it: Any) -> float:
        parts = [float(np.logaddexp.reduce(log_weights[chosen])) for chosen in (with_it, ~with_it)]
        return 2.0 * (parts[0] - parts[1])

    either = factor(present.any(axis=1)) - 2.0 * math.log(3.0)  # the first, the second or both against none
    return factor(present[:, 0]), factor(present[:, 1]), either

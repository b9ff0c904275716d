"""A Gaussian cut off at a box: its probability and moments by expectation propagation.

Every bound is stood in for by a Gaussian factor ``exp(nu x - tau x^2 / 2)`` of its parameter, changed until mean and
variance of that parameter agree with those of the bound itself under all other factors. Deterministic, and within some
hundredths of ln Pr for boxes. Source: Cunningham, Hennig & Lacoste-Julien, arXiv:1111.6832 (2011).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from camtorque.records import Array

FAR_OFF = 4.0
"""A bound so many standard deviations off takes nothing away."""
SWEEPS, CLOSE = 60, 1e-6
"""Passes over all bounds at most; change of ln Pr and of the means below which they end."""
ERFC_ENDS = 37.0
"""Standard deviations below which `math.erfc` is no number any more; the asymptotic series is exact there."""
FAR_TAIL = 30.0
"""Distance of a bound, in standard deviations, beyond which its tail is taken as a series."""
LEAST_VARIANCE = 1e-10
"""Of a parameter against its bound, as a share of what it is without bounds."""


@dataclass(frozen=True)
class Gaussian:
    """Mean (k,), covariance (k, k) and box of some parameters."""

    mean: Array
    matrix: Array
    lower: Array
    upper: Array

    @cached_property
    def within(self) -> Truncated:
        """Probability of the box and moments within it."""
        return truncated(self)

    def of(self, places: Array) -> Gaussian:
        """Return what is known of some of the parameters by themselves."""
        return Gaussian(self.mean[places], self.matrix[np.ix_(places, places)], self.lower[places], self.upper[places])


@dataclass(frozen=True)
class Truncated:
    """ln of the probability of the box, and mean (k,) and covariance (k, k) within it."""

    log_probability: float
    mean: Array
    matrix: Array


def truncated(gaussian: Gaussian) -> Truncated:
    """Return probability and moments of a Gaussian within its box."""
    std = np.sqrt(np.diag(gaussian.matrix))
    low, high = (gaussian.lower - gaussian.mean) / std, (gaussian.upper - gaussian.mean) / std
    near = np.flatnonzero((low > -FAR_OFF) | (high < FAR_OFF))
    start = gaussian.matrix / np.outer(std, std)
    start = 0.5 * (start + start.T)  # what an inverse's rounding leaves unequal grows with every bound that is far off
    matrix, mean = start.copy(), np.zeros(std.size)
    precision, shift = np.zeros(std.size), np.zeros(std.size)
    constant = np.zeros(std.size)
    before = np.inf
    total = 0.0
    for _ in range(SWEEPS):
        last = mean.copy()
        for i in near:
            cavity = 1.0 / matrix[i, i] - precision[i] if matrix[i, i] > 0.0 else 0.0
            if not cavity > 0.0:
                continue  # hundreds of deviations off the box rounding may leave no Gaussian of the other factors
            centre = (mean[i] / matrix[i, i] - shift[i]) / cavity
            share, inside, variance = one_sided_moments(centre, cavity**-0.5, low[i], high[i])
            more = max(1.0 / variance - cavity, 0.0) - precision[i]
            precision[i] += more
            shift[i] = inside * (cavity + precision[i]) - centre * cavity
            moved = (cavity * centre + shift[i]) ** 2 / (cavity + precision[i]) - cavity * centre**2
            constant[i] = share + 0.5 * (np.log1p(precision[i] / cavity) - moved)
            column = matrix[:, i].copy()
            matrix -= np.outer(column, column * (more / (1.0 + more * column[i])))
            mean = matrix @ shift
        log_det = float(np.linalg.slogdet(np.eye(std.size) + start * precision)[1])
        total = float(np.sum(constant) - 0.5 * log_det + 0.5 * shift @ mean)
        if abs(total - before) < CLOSE and np.max(np.abs(mean - last), initial=0.0) < CLOSE:
            break
        before = total
    return Truncated(min(total, 0.0), gaussian.mean + std * mean, matrix * np.outer(std, std))


def log_share_below(x: float) -> float:
    """Return ln Pr of a standard normal number below x (scipy.special takes longer to import than a fit's evidence)."""
    if x > -ERFC_ENDS:
        tail = 0.5 * math.erfc(abs(x) / math.sqrt(2.0))
        return math.log1p(-tail) if x > 0.0 else math.log(tail)
    if math.isinf(x):
        return -math.inf
    square = 1.0 / (x * x)
    series = -square * (1.0 - 3.0 * square * (1.0 - 5.0 * square * (1.0 - 7.0 * square)))
    return -0.5 * x * x - math.log(-x) - 0.5 * math.log(2.0 * math.pi) + math.log1p(series)


def one_sided_moments(mean: float, std: float, lower: float, upper: float) -> tuple[float, float, float]:
    """Return ln Pr(lower < x < upper) of one Gaussian parameter, and its mean and variance there."""
    a, b = (lower - mean) / std, (upper - mean) / std
    turned = a > 0.0  # in the upper tail the normal distribution is 1 to rounding: look at the lower one
    first, last = (-b, -a) if turned else (a, b)
    top, bottom = log_share_below(float(last)), log_share_below(float(first))
    share = top + float(np.log1p(-np.exp(min(bottom - top, -1e-15))))
    if last < -FAR_TAIL:
        # mean and variance are differences of large numbers there: the tail as an exponential, next order included
        centre = last + 1.0 / last - 2.0 / last**3
        variance = 1.0 / last**2 - 6.0 / last**4
    else:
        at_first, at_last = (
            np.exp(-0.5 * (x * x + np.log(2.0 * np.pi)) - share) if np.isfinite(x) else 0.0 for x in (first, last)
        )
        centre = at_first - at_last
        spread = sum(x * at for x, at in ((first, at_first), (last, -at_last)) if at > 0.0 or at < 0.0)
        variance = max(1.0 + spread - centre**2, LEAST_VARIANCE)
    return share, mean + std * (-centre if turned else centre), std**2 * variance

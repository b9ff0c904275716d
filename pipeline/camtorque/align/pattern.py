"""What the pattern of a turn is made of: errors of a wheel's teeth and waves of the angle.

Over the turns the teeth repeat one pattern. One wheel cannot tell by itself which part of it is the speed that varies
within the turn and which part teeth that are not where they should be. What helps is how they look: the angle of an
inert shaft is smooth (its harmonic of order n falls as 1 / n^2), errors of teeth are as large at every tooth and
independent of each other. Both sizes are taken from the pattern itself (largest marginal likelihood), and what then
remains open is the standard deviation that is stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from camtorque.records import Array, Integers, Mask
from camtorque.signal.threshold import Threshold
from camtorque.units import TURN

MOST_ORDERS = 30
"""Orders of the deviation, at most; fewer on a wheel with fewer teeth."""
LEAST_ORDERS = 8
"""Few teeth do not see all orders that a shaft may have: what they cannot tell apart is stated, not left out."""
LOBES = 3.0
"""Up to this order the torque of a cam may be as large as in the first one: that of its lobes."""
SMOOTHNESS = 2.0
"""The angle's harmonic of order n falls as 1 / n to this power: torque over inertia, integrated twice."""
TOOTH_STD = (1.0e-3, np.log(10.0))
"""Before the data: errors of teeth of 0.06 degrees, give or take a factor of ten [rad]."""
RIPPLE_STD = (1.0e-2, np.log(30.0))
"""Before the data: first harmonic of the angle of 0.6 degrees, give or take a factor of thirty [rad]."""
FREE_TOOTH = Threshold(
    0.1, "rad", "recordings",
    "Standard deviation of the teeth beside a gap of an inductive wheel, whose wave the gap bends: six degrees."
)  # fmt: skip
COMMON_SHIFT = Threshold(
    0.03, "rad", "physics",
    "Of all teeth together, which the pattern leaves open: two degrees are more than any mean of teeth."
)  # fmt: skip
SIZES = (-6.0, 0.5)
"""Decades of both sizes that are tried [rad]."""
OWN_SIZES = np.array([1.0e-4, 1.0e-3, 1.0e-2, 1.0e-1])
"""Sizes of an order that stands out, times the order: parts of the speed [rad]."""
STANDS_OUT = Threshold(
    3.0, "nat", "statistics",
    "Gain in the logarithm of the probability for which an order gets its own size: odds of 20 to 1."
)  # fmt: skip
MOST_OWN = 6
SPREAD = np.linspace(-2.4, 2.4, 9)
"""Logarithms of the factors on both sizes over which the result is averaged."""
LEAST_WEIGHT = 1.0e-3


@dataclass(frozen=True)
class Alike:
    """Teeth of a wheel that a turn of the cam shows equally often with one variance, and their sums of squares.

    Attributes
    ----------
    count, times : teeth of the wheel, and how often a turn shows each
    variance : of the mean of each passage [rad^2]
    apart, together : (k, k) of the passages about the mean of their tooth, and of those means times ``times``
    """

    count: int
    times: int
    variance: float
    apart: Array
    together: Array


@dataclass(frozen=True)
class Pattern:
    """The pattern of a turn and what it may be made of: errors of the wheel's teeth, waves of the angle, a shift.

    Attributes
    ----------
    orders : of the waves
    alike : the teeth by how they are shown; the sums of squares are of waves, shift and pattern
    times, variance, sums : of each tooth of the wheel: (t,), (t,), and (t, k) the sum of its passages
    free : (t,) teeth that have a place of their own
    """

    orders: Integers
    alike: tuple[Alike, ...]
    times: Integers
    variance: Array
    sums: Array
    free: Mask

    def squares(self, tooth: float) -> Array:
        """Return the sums of squares (k, k) in units of the variance that errors of the teeth leave.

        What passages of one tooth have in common holds its error, what is between them does not.
        """
        return np.asarray(sum(
            part.apart / part.variance + part.together / (part.variance + part.times * tooth**2) for part in self.alike
        ))  # fmt: skip

    def log_variance(self, tooth: float) -> float:
        """Return the logarithm of the determinant of the covariance of variance and errors of teeth alone."""
        return float(sum(
            part.count * ((part.times - 1) * np.log(part.variance) + np.log(part.variance + part.times * tooth**2))
            for part in self.alike
        ))  # fmt: skip


@dataclass(frozen=True)
class Sizes:
    """Standard deviations: of the teeth's errors, of the first order, and of orders that stand out [rad]."""

    tooth: float
    ripple: float
    own: tuple[tuple[int, float], ...] = ()

    def waves(self, orders: Integers) -> Array:
        """Return the prior variance of each coefficient."""
        variance = self.ripple**2 / np.maximum(orders / LOBES, 1.0) ** (2.0 * SMOOTHNESS)
        for order, size in self.own:
            variance = variance + np.where(orders == order, size**2, 0.0)
        return np.tile(variance, 2)


def pattern_of(tooth: Integers, mean: Array, variance: float, free: Mask, n: int) -> Pattern:
    """Return the pattern of n pulses per turn of the cam, of which some show a tooth of the wheel.

    Parameters
    ----------
    tooth, mean : (m,) numbers of the pulses that are shown, and how far each is off even running [rad]
    variance : of each mean [rad^2]
    free : (t,) teeth of the wheel that have a place of their own
    """
    which = tooth % free.size
    orders = np.arange(1, max(LEAST_ORDERS, min(MOST_ORDERS, (tooth.size - 1) // 2)) + 1)
    # a cam that is ahead passes its teeth earlier
    columns = np.column_stack([-waves_of(np.asarray(tooth * (TURN / n)), orders), np.ones(tooth.size), mean])
    times = np.bincount(which, minlength=free.size)
    sums = np.zeros((free.size, columns.shape[1]))
    np.add.at(sums, which, columns)
    apart = columns - sums[which] / times[which, None]
    each = variance + np.where(free, FREE_TOOTH, 0.0) ** 2
    alike = []
    for shown, own in sorted({(int(k), bool(f)) for k, f in zip(times, free, strict=True) if k}):
        these = (times == shown) & (free == own)
        rows = apart[these[which]]
        together = sums[these].T @ sums[these] / shown
        alike.append(Alike(int(these.sum()), shown, float(each[these][0]), rows.T @ rows, together))
    return Pattern(orders, tuple(alike), times, each, sums, free)


def waves_of(angle: Array, orders: Integers) -> Array:
    """Return cosines, then sines, of some orders at angles (m,) [rad], (m, 2 n_orders)."""
    phase = np.asarray(angle)[:, None] * orders[None, :]
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=1)


def _prior_std(pattern: Pattern, sizes: Sizes) -> Array:
    """Return the prior standard deviations of waves and shift; a common shift of all teeth is left open."""
    return np.sqrt(np.append(sizes.waves(pattern.orders), COMMON_SHIFT**2))


def score_of(pattern: Pattern, sizes: Sizes) -> float:
    """Return the log of the marginal likelihood times the priors of the sizes."""
    std, squares = _prior_std(pattern, sizes), pattern.squares(sizes.tooth)
    # the factor of what the waves add to the covariance, and below it their share of the misfit: numpy alone solves no
    # triangle
    size = std.size
    bordered = np.eye(size + 1)
    bordered[:size, :size] += std[:, None] * squares[:size, :size] * std
    bordered[size, :size] = squares[size, :size] * std
    bordered[size, size] = 1.0e300  # above any square
    root = np.linalg.cholesky(bordered)
    told = root[size, :size]
    value = -0.5 * (float(squares[size, size] - told @ told) + pattern.log_variance(sizes.tooth))
    value -= float(np.log(np.diag(root)[:size]).sum())
    for known, (usual, spread) in ((sizes.tooth, TOOTH_STD), (sizes.ripple, RIPPLE_STD)):
        value -= 0.5 * (np.log(known / usual) / spread) ** 2
    return value


def best_sizes(pattern: Pattern) -> Sizes:
    """Return the sizes that make the pattern most probable; an order that stands out gets one of its own.

    A cam with four lobes makes a ripple of order four and next to none of orders one to three.
    """
    sizes = _best_pair(pattern, ())
    score = score_of(pattern, sizes)
    for _ in range(MOST_OWN):
        trials = [
            replace(sizes, own=(*sizes.own, (int(order), float(size))))
            for order in pattern.orders
            for size in OWN_SIZES / order
        ]
        best = max(trials, key=lambda trial: score_of(pattern, trial))
        if score_of(pattern, best) < score + STANDS_OUT:
            return sizes
        sizes = _best_pair(pattern, best.own)
        score = score_of(pattern, sizes)
    return sizes


def _best_pair(pattern: Pattern, own: tuple[tuple[int, float], ...]) -> Sizes:
    low, high = np.log(10.0) * SIZES[0], np.log(10.0) * SIZES[1]
    centre, reach = (0.5 * (low + high), 0.5 * (low + high)), 0.5 * (high - low)
    for _ in range(6):
        axis = np.linspace(-reach, reach, 5)
        trials = [(centre[0] + a, centre[1] + b) for a in axis for b in axis]
        centre = max(trials, key=lambda trial: score_of(pattern, Sizes(np.exp(trial[0]), np.exp(trial[1]), own)))
        reach *= 0.5
    return Sizes(float(np.exp(centre[0])), float(np.exp(centre[1])), own)


def mixture(pattern: Pattern, best: Sizes) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return places and their variances, coefficients of waves and their covariance, over all sizes that are probable.

    Few teeth leave the sizes open.
    """
    trials = [
        replace(best, tooth=best.tooth * a, ripple=best.ripple * b) for a in np.exp(SPREAD) for b in np.exp(SPREAD[::2])
    ]
    scores = np.array([score_of(pattern, trial) for trial in trials])
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    kept = np.flatnonzero(weights > LEAST_WEIGHT)
    parts = [posteriors(pattern, trials[k]) for k in kept]
    share = weights[kept] / weights[kept].sum()
    teeth, waves = ([part[k] for part in parts] for k in (0, 1))
    place, coefficient = (share @ [mean for mean, _ in both] for both in (teeth, waves))
    variance = share @ [spread + (mean - place) ** 2 for mean, spread in teeth]
    covariance = np.tensordot(
        share, [spread + np.outer(mean - coefficient, mean - coefficient) for mean, spread in waves], 1
    )
    return (place, variance), (coefficient, covariance)


def posteriors(pattern: Pattern, sizes: Sizes) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return places of the teeth with their variances, and coefficients of the waves with their covariance."""
    std, squares = _prior_std(pattern, sizes), pattern.squares(sizes.tooth)
    size = std.size
    told = np.eye(size) + std[:, None] * squares[:size, :size] * std
    covariance = std[:, None] * np.linalg.inv(told) * std
    mean = covariance @ squares[:size, size]
    over = pattern.variance + pattern.times * sizes.tooth**2
    beside = pattern.sums[:, :size] / over[:, None]
    left = pattern.sums[:, size] / over - beside @ mean
    sure = pattern.times / over - np.sum(beside @ covariance * beside, axis=1)
    prior = np.where(pattern.free, FREE_TOOTH, sizes.tooth) ** 2
    return (prior * left, prior - prior**2 * sure), (mean[:-1], covariance[:-1, :-1])

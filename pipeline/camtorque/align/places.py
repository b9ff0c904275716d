"""How the angle deviates from even running within a turn of the cam, and where the teeth of a wheel really are.

Over many turns the teeth repeat one pattern. Part of it is the speed that varies within the turn, part are teeth that
are not where they should be; one wheel cannot tell the two apart by itself. What helps is how they look: the angle of a
shaft with inertia is smooth (its harmonic of order n falls as 1 / n^2), errors of teeth are as large at every tooth and
independent of each other. Both sizes are taken from the pattern itself (largest marginal likelihood), and what then
remains open is the standard deviation that is stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from camtorque.align.pulses import PulseTrain
from camtorque.config import TriggerSpec
from camtorque.records import Array, Integers, Mask
from camtorque.signal.threshold import Count, Threshold
from camtorque.units import TURN

LEAST_TURNS = Count(
    4, "turns", "statistics", "Whole turns of the cam between two others from which on the pattern is known."
)
LEAST_PULSES = Count(
    4, "pulses", "statistics", "Pulses per turn from which on tooth and speed can be separated at all."
)
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
LEAST_VARIANCE = 1.0e-14
"""Of a mean place: below it the digits of numbers do not hold it beside the common shift [rad^2]."""
LEAST_WEIGHT = 1.0e-3


@dataclass(frozen=True)
class Places:
    """What the turns of a cam have in common.

    Attributes
    ----------
    place, place_std : (pulses per cycle,) where a tooth is against its nominal place, and how well that is known [rad]
    orders : orders of the deviation, per turn of the cam
    coefficient : (2 n_orders,) cosines, then sines, of the angle since the pulse of step zero [rad]
    covariance : of the coefficients [rad^2]
    tooth_std : size of the teeth's errors that the pattern shows [rad]
    scatter : of a single pulse about the pattern: error of its edge and what the speed does not repeat [rad]
    turns : turns that were used
    """

    place: Array
    place_std: Array
    orders: Integers
    coefficient: Array
    covariance: Array
    tooth_std: float
    scatter: float
    turns: int

    def at(self, step: float) -> tuple[float, float]:
        """Return the place of what passes between two teeth, by time, and its standard deviation [rad].

        The straight line between the teeth, and what the speed bends it by: a quarter of a turn holds much of that.
        """
        n, low = self.place.size, int(np.floor(step))
        part = step - low
        pair = [low % n, (low + 1) % n]
        share = np.array([1.0 - part, part])
        waves = _waves(np.array([step, low, low + 1.0]) * (TURN / n), self.orders)
        bend = waves[0] - share @ waves[1:]
        variance = share**2 @ self.place_std[pair] ** 2 + max(float(bend @ self.covariance @ bend), 0.0)
        return float(share @ self.place[pair] + bend @ self.coefficient), float(np.sqrt(variance))

    def deviation(self, since_zero: Array) -> tuple[Array, Array]:
        """Return how far the cam is ahead of even running, and its standard deviation [rad].

        Parameters
        ----------
        since_zero : cam angle since the pulse of step zero [rad]
        """
        waves = _waves(since_zero, self.orders)
        std = np.sqrt(np.maximum(np.sum((waves @ self.covariance) * waves, axis=1), 0.0))
        return waves @ self.coefficient, std


def tooth_places(train: PulseTrain, spec: TriggerSpec, n: int) -> Places | None:
    """Return the places of the teeth and the deviation of the angle; None where too few turns or pulses show them.

    ``n`` are the pulses per turn of the cam.
    """
    found = _pattern(train, n) if n >= LEAST_PULSES else None
    if found is None:
        return None
    tooth, mean, scatter, turns = found
    # one variance for all teeth: that of a single one is known poorly from a few turns
    variance = max(scatter**2 / turns + 1e-18, LEAST_VARIANCE)
    pattern = _design(tooth, mean, variance, spec, n)
    sizes = _sizes(pattern)
    (place, spread), (coefficient, covariance) = _mixture(pattern, sizes)
    everywhere = np.arange(n) % pattern.free.size
    std = np.sqrt(np.maximum(spread, 0.0))
    return Places(
        place[everywhere], std[everywhere], pattern.orders, coefficient, covariance, sizes.tooth, scatter, turns
    )


@dataclass(frozen=True)
class _Alike:
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
class _Pattern:
    """The pattern of a turn and what it may be made of: errors of the wheel's teeth, waves of the angle, a shift.

    Attributes
    ----------
    orders : of the waves
    alike : the teeth by how they are shown; the sums of squares are of waves, shift and pattern
    times, variance, sums : of each tooth of the wheel: (t,), (t,), and (t, k) the sum of its passages
    free : (t,) teeth that have a place of their own
    """

    orders: Integers
    alike: tuple[_Alike, ...]
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
class _Sizes:
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


def _design(tooth: Integers, mean: Array, variance: float, spec: TriggerSpec, n: int) -> _Pattern:
    per_wheel = max(1, n // spec.revolutions_per_cycle)
    free, which = _beside_gap(spec, per_wheel), tooth % per_wheel
    orders = np.arange(1, max(LEAST_ORDERS, min(MOST_ORDERS, (tooth.size - 1) // 2)) + 1)
    # a cam that is ahead passes its teeth earlier
    columns = np.column_stack([-_waves(np.asarray(tooth * (TURN / n)), orders), np.ones(tooth.size), mean])
    times = np.bincount(which, minlength=per_wheel)
    sums = np.zeros((per_wheel, columns.shape[1]))
    np.add.at(sums, which, columns)
    apart = columns - sums[which] / times[which, None]
    each = variance + np.where(free, FREE_TOOTH, 0.0) ** 2
    alike = []
    for shown, own in sorted({(int(k), bool(f)) for k, f in zip(times, free, strict=True) if k}):
        these = (times == shown) & (free == own)
        rows = apart[these[which]]
        together = sums[these].T @ sums[these] / shown
        alike.append(_Alike(int(these.sum()), shown, float(each[these][0]), rows.T @ rows, together))
    return _Pattern(orders, tuple(alike), times, each, sums, free)


def _waves(angle: Array, orders: Integers) -> Array:
    phase = np.asarray(angle)[:, None] * orders[None, :]
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=1)


def _beside_gap(spec: TriggerSpec, per_wheel: int) -> Mask:
    """Tell which teeth have a place of their own: a coil sees the two beside a gap elsewhere."""
    free = np.zeros(per_wheel, dtype=bool)
    if spec.sensor == "inductive" and spec.missing_teeth and per_wheel - spec.missing_teeth > 2 * LEAST_PULSES:
        free[[0, per_wheel - spec.missing_teeth - 1]] = True
    return free


def _pattern(train: PulseTrain, n: int) -> tuple[Integers, Array, float, int] | None:
    """Return tooth numbers, mean deviation of each from even running, scatter of single ones [rad], turns used."""
    times, tooth = _turns(train, n)
    if tooth.size < LEAST_PULSES:
        return None
    whole: Mask = np.asarray(np.isfinite(times).all(axis=1))
    inner = np.flatnonzero(whole[1:-1] & whole[:-2] & whole[2:]) + 1
    if inner.size < LEAST_TURNS:
        return None
    middle = times.mean(axis=1)
    part = (tooth - tooth.mean()) / n
    before, here, after = (middle[inner + k][:, None] for k in (-1, 0, 1))
    # a parabola through the mean times of three turns is even running with a speed that changes
    slope, bend = 0.5 * (after - before), 0.5 * (after + before) - here
    even = here + slope * part + bend * part**2
    rate = slope + 2.0 * bend * part
    deviation = TURN * (times[inner] - even) / rate
    centre = np.median(deviation, axis=0)
    scale = 1.4826 * np.median(np.abs(deviation - centre), axis=0)
    good = np.abs(deviation - centre) <= 4.0 * scale + 1e-12
    count = good.sum(axis=0)
    mean = np.where(good, deviation, 0.0).sum(axis=0) / count
    variance = np.where(good, (deviation - mean) ** 2, 0.0).sum(axis=0) / np.maximum(count - 1, 1)
    return tooth, mean, float(np.sqrt(np.mean(variance))), int(inner.size)


def teeth_shown(train: PulseTrain, n: int) -> int:
    """Return how many of the ``n`` steps of a turn of the cam most turns show a pulse at."""
    return int(_turns(train, n)[1].size)


def _turns(train: PulseTrain, n: int) -> tuple[Array, Integers]:
    """Return (turns, teeth) times, nan where a turn is not whole, and the teeth that most turns show."""
    turn, tooth = train.step // n, train.step % n
    first = int(turn[0])
    times = np.full((int(turn[-1]) - first + 1, n), np.nan)
    sound = ~train.repaired
    times[turn[sound] - first, tooth[sound]] = train.time[sound]
    times[np.unique(turn[train.broken | train.jumps]) - first] = np.nan
    shown = np.flatnonzero(np.isfinite(times).sum(axis=0) > 0.5 * times.shape[0])
    return times[:, shown], shown


def _prior_std(pattern: _Pattern, sizes: _Sizes) -> Array:
    """Return the prior standard deviations of waves and shift; a common shift of all teeth is left open."""
    return np.sqrt(np.append(sizes.waves(pattern.orders), COMMON_SHIFT**2))


def _score(pattern: _Pattern, sizes: _Sizes) -> float:
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


def _sizes(pattern: _Pattern) -> _Sizes:
    """Return the sizes that make the pattern most probable; an order that stands out gets one of its own.

    A cam with four lobes makes a ripple of order four and next to none of orders one to three.
    """
    sizes = _best_pair(pattern, ())
    score = _score(pattern, sizes)
    for _ in range(MOST_OWN):
        trials = [
            replace(sizes, own=(*sizes.own, (int(order), float(size))))
            for order in pattern.orders
            for size in OWN_SIZES / order
        ]
        best = max(trials, key=lambda trial: _score(pattern, trial))
        if _score(pattern, best) < score + STANDS_OUT:
            return sizes
        sizes = _best_pair(pattern, best.own)
        score = _score(pattern, sizes)
    return sizes


def _best_pair(pattern: _Pattern, own: tuple[tuple[int, float], ...]) -> _Sizes:
    low, high = np.log(10.0) * SIZES[0], np.log(10.0) * SIZES[1]
    centre, reach = (0.5 * (low + high), 0.5 * (low + high)), 0.5 * (high - low)
    for _ in range(6):
        axis = np.linspace(-reach, reach, 5)
        trials = [(centre[0] + a, centre[1] + b) for a in axis for b in axis]
        centre = max(trials, key=lambda trial: _score(pattern, _Sizes(np.exp(trial[0]), np.exp(trial[1]), own)))
        reach *= 0.5
    return _Sizes(float(np.exp(centre[0])), float(np.exp(centre[1])), own)


def _mixture(pattern: _Pattern, best: _Sizes) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return places and their variances, coefficients of waves and their covariance, over all sizes that are probable.

    Few teeth leave the sizes open.
    """
    trials = [
        replace(best, tooth=best.tooth * a, ripple=best.ripple * b) for a in np.exp(SPREAD) for b in np.exp(SPREAD[::2])
    ]
    scores = np.array([_score(pattern, trial) for trial in trials])
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    kept = np.flatnonzero(weights > LEAST_WEIGHT)
    parts = [_posteriors(pattern, trials[k]) for k in kept]
    share = weights[kept] / weights[kept].sum()
    teeth, waves = ([part[k] for part in parts] for k in (0, 1))
    place, coefficient = (share @ [mean for mean, _ in both] for both in (teeth, waves))
    variance = share @ [spread + (mean - place) ** 2 for mean, spread in teeth]
    covariance = np.tensordot(
        share, [spread + np.outer(mean - coefficient, mean - coefficient) for mean, spread in waves], 1
    )
    return (place, variance), (coefficient, covariance)


def _posteriors(pattern: _Pattern, sizes: _Sizes) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
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

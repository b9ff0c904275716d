"""How the angle deviates from even running within a turn of the cam, and where the teeth of a wheel really are.

What the turns have in common is told apart by `camtorque.align.pattern`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from camtorque.align.pattern import best_sizes, mixture, pattern_of, waves_of
from camtorque.align.pulses import PulseTrain
from camtorque.config import TriggerSpec
from camtorque.records import Array, Integers, Mask
from camtorque.signal.threshold import Count
from camtorque.units import TURN

LEAST_TURNS = Count(
    4, "turns", "statistics", "Whole turns of the cam between two others from which on the pattern is known."
)
LEAST_PULSES = Count(
    4, "pulses", "statistics", "Pulses per turn from which on tooth and speed can be separated at all."
)
LEAST_VARIANCE = 1.0e-14
"""Of a mean place: below it the digits of numbers do not hold it beside the common shift [rad^2]."""


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
    passed : when each tooth passes, as `camtorque.records.TEETH` says
    """

    place: Array
    place_std: Array
    orders: Integers
    coefficient: Array
    covariance: Array
    tooth_std: float
    scatter: float
    turns: int
    passed: Array

    @property
    def _told(self) -> Mask:
        """Orders that the teeth tell apart; of the others only the expected size is known."""
        return np.asarray(self.orders <= max(1, (self.place.size - 1) // 2))

    def at(self, step: float) -> tuple[float, float]:
        """Return the place of what passes between two teeth, by time, and its standard deviation [rad].

        The straight line between the teeth, and what the speed bends it by: a quarter of a turn holds much of that.
        """
        n, low = self.place.size, int(np.floor(step))
        part = step - low
        pair = [low % n, (low + 1) % n]
        share = np.array([1.0 - part, part])
        waves = waves_of(np.array([step, low, low + 1.0]) * (TURN / n), self.orders)
        bend = waves[0] - share @ waves[1:]
        variance = share**2 @ self.place_std[pair] ** 2 + max(float(bend @ self.covariance @ bend), 0.0)
        return float(share @ self.place[pair] + bend @ self.coefficient), float(np.sqrt(variance))

    def deviation(self, since_zero: Array) -> tuple[Array, Array]:
        """Return how far the cam is ahead of even running in the orders that the teeth tell apart, and its std [rad].

        Parameters
        ----------
        since_zero : cam angle since the pulse of step zero [rad]
        """
        told = np.tile(self._told, 2)
        waves = waves_of(since_zero, self.orders)[:, told]
        std = np.sqrt(np.maximum(np.sum((waves @ self.covariance[np.ix_(told, told)]) * waves, axis=1), 0.0))
        return waves @ self.coefficient[told], std

    def errors(self, zero: float) -> NDArray[np.complex128]:
        """Return what the deviation may be off by: harmonics (k, m + 1) of k errors of one standard deviation each.

        ``zero`` is the cam angle of step zero; ``irfft(errors, n) * n / 2`` is over n cam angles [rad].
        """
        both, orders = np.tile(self._told, 2), self.orders[self._told]
        size, axes = np.linalg.eigh(self.covariance[np.ix_(both, both)])
        cosine, sine = np.split(axes * np.sqrt(np.maximum(size, 0.0)), 2)
        spectrum = np.zeros((size.size, int(orders[-1]) + 1), dtype=np.complex128)
        spectrum[:, orders] = (cosine - 1j * sine).T * np.exp(-1j * orders * zero)
        return spectrum


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
    pattern = pattern_of(tooth, mean, variance, _beside_gap(spec, n), n)
    sizes = best_sizes(pattern)
    (place, spread), (coefficient, covariance) = mixture(pattern, sizes)
    everywhere = np.arange(n) % pattern.free.size
    std = np.sqrt(np.maximum(spread, 0.0))
    return Places(
        place[everywhere],
        std[everywhere],
        pattern.orders,
        coefficient,
        covariance,
        sizes.tooth,
        scatter,
        turns,
        np.column_stack([TURN / n * tooth + mean - mean[0], mean[0] - mean]),
    )


def _beside_gap(spec: TriggerSpec, n: int) -> Mask:
    """Tell which teeth of a wheel have a place of their own: a coil sees the two beside a gap elsewhere."""
    per_wheel = max(1, n // spec.revolutions_per_cycle)
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


def passages(train: PulseTrain, n: int) -> Array:
    """Return how two or three teeth pass, as `camtorque.records.PASSED` says; (0, 3) where step zero shows no pulse."""
    times, tooth = _turns(train, n)
    if not tooth.size or tooth[0] or train.offset:
        return np.zeros((0, 3))
    part = TURN * (times[:-1, 1:] - times[:-1, :1]) / np.diff(times[:, :1], axis=0)
    part = part[np.isfinite(part).all(axis=1)]
    if part.shape[0] < LEAST_TURNS:
        return np.zeros((0, 3))
    even = part.mean(axis=0)
    return np.column_stack([even, TURN / n * tooth[1:] - even, part.std(axis=0, ddof=1) / np.sqrt(part.shape[0])])


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

"""Valleys along the trigger angle and a stiff shaft's compliance: the best minimum with it held aside, and how wide.

Trigger angle, friction and drive trade against one another along a bent valley of the residual. Its curvature at one
point tells neither its width nor whether a deeper place lies further on, so it is walked: the angle is held, all else
follows, both halves of the cycles judge. Where the posterior along the walk (profile likelihood; Raue et al.,
Bioinformatics 25 (2009) 1923) is wider than the curvature says, the angle is that uncertain; narrower it may be rugged,
and is not believed.

Of a stiff shaft the torque tells little more than where it rings, which is compliance times inertia: a hyperbola, which
looks narrow where the compliance is at its bound.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from camtorque.fit.descent import Effort
from camtorque.fit.minima import Candidate, Halves, at_minimum
from camtorque.fit.problem import with_rows
from camtorque.fit.uncertainty import covariance
from camtorque.process.second_process import in_two
from camtorque.records import Array, ReadOnly
from camtorque.units import DEGREE

ANGLE = "trigger_offset"
COMPLIANCE = "shaft_compliance"
HELD = 1.0e-9
"""Standard deviation of what is held [rad], [rad/(N m)]."""
STEP_SHARE, STEPS_DEG = 0.6, (0.02, 0.3)
"""Step in standard deviations of the angle at the minimum, and its limits [deg]."""
MOST_STEPS, ROUNDS = 14, 3
A_STEP = Effort(12, gain=2.0e-3)
STIFF, FACTOR, MOST_FACTORS = 2.0, 2.0, 7
"""A shaft is stiff whose compliance lies that many standard deviations above its lower bound or less; it is walked by
that factor a step, in so many steps at most."""
WALKED = 9.0
"""Rise of chi-square at which a walk ends: three standard deviations."""
DEEPER, GAINED = 1.0, 0.5
"""Fall of chi-square on the walk from which a minimum is sought there, and what that has to gain."""


@dataclass(frozen=True)
class Valley(ReadOnly):
    """Values of a parameter that were held (m,) [SI] with what they cost, and its value at the best minimum [SI].

    ``chi_square`` is that of the residual on both halves of the cycles, ``prior`` that of all parameters, (m,) each.
    """

    places: Array
    chi_square: Array
    prior: Array
    at: float

    def std(self, inflation: float) -> float:
        """Return the root mean square distance from the minimum under the posterior along the valley [SI].

        It is nan where the valley was not walked. ``inflation``: factor on the residual's variance.
        """
        if self.places.size < 3:
            return float("nan")
        between = np.linspace(self.places[0], self.places[-1], 50 * self.places.size)
        chi = np.interp(between, self.places, self.chi_square / inflation + self.prior)
        weight = np.exp(-0.5 * (chi - np.min(chi)))
        return float(np.sqrt(np.sum(weight * (between - self.at) ** 2) / np.sum(weight)))


Point = tuple[float, float, Candidate]
"""Value that was held [SI], chi-square there with the priors, and the fit."""
NO_VALLEY = Valley(np.zeros(0), np.zeros(0), np.zeros(0), float("nan"))
"""Of a minimum that nobody walked from."""


def swept(best: Candidate, halves: Halves) -> tuple[Candidate, Valley]:
    """Return the deepest minimum of the valley that a minimum lies in, and the valley.

    ``best`` is a minimum on the fine grid, judged.
    """
    for _ in range(ROUNDS):
        points = _walked(best, halves)
        deepest = min(points, key=lambda point: point[1])
        if deepest[1] > best.value - DEEPER:
            break
        prior = best.data.rows[ANGLE].prior
        freed = halves.minimum(at_minimum, with_rows(deepest[2].data, {ANGLE: {"prior": prior}}))
        if freed is None or freed.value > best.value - GAINED:
            break
        best = freed
    return best, _valley(best, ANGLE, points)


def softer_shaft(best: Candidate, halves: Halves) -> Candidate | None:
    """Return the fit with a stiff shaft that is more compliant by the deviation of the valley from its value up.

    It is None of a shaft that yields enough, and where the valley leads nowhere.
    """
    index, row = best.problem.index(COMPLIANCE), best.data.rows[COMPLIANCE]
    if index < 0:
        return None
    at, cov = float(best.solution.z[index]), covariance(best.problem, best.solution)
    if at > row.lower + STIFF * cov.std[index]:
        return None
    places = np.asarray(at * FACTOR ** np.arange(1.0, MOST_FACTORS + 1.0), dtype=np.float64)
    ends = _held(best, halves, COMPLIANCE, places[places < row.upper])
    points = [(at, best.value, best), *_until_risen(ends, best.value, WALKED * cov.inflation)]
    softer = at + _valley(best, COMPLIANCE, points).std(cov.inflation)
    if not np.isfinite(softer):
        return None
    nearest = max((point for point in points if point[0] <= softer), key=lambda point: point[0])[2]
    return next((end for _, _, end in _held(nearest, halves, COMPLIANCE, np.array([softer]))), None)


def _valley(best: Candidate, name: str, points: list[Point]) -> Valley:
    places, values = np.array([point[:2] for point in points]).T
    of_data = np.array([end.solution.data_chi_square + end.unseen for _, _, end in points])
    return Valley(places, of_data, values - of_data, float(best.solution.z[best.problem.index(name)]))


def _walked(best: Candidate, halves: Halves) -> list[Point]:
    """Return all points in order."""
    index = best.problem.index(ANGLE)
    cov = covariance(best.problem, best.solution)
    std = float(cov.std[index])
    step = min(max(STEP_SHARE * std, STEPS_DEG[0] * DEGREE), STEPS_DEG[1] * DEGREE)
    points, rise = [(float(best.solution.z[index]), best.value, best)], WALKED * cov.inflation
    for walked in in_two(partial(_one_way, best, halves, rise), (step, -step)):
        points += _until_risen(walked, min(point[1] for point in points), rise)
    return sorted(points, key=lambda point: point[0])


def _until_risen(points: Iterable[Point], least: float, rise: float) -> list[Point]:
    """Return points up to the first whose chi-square is that far above the least of them and what was the least."""
    kept = []
    for point in points:
        kept.append(point)
        least = min(least, point[1])
        if point[1] > least + rise:
            break
    return kept


def _one_way(best: Candidate, halves: Halves, rise: float, step: float) -> list[Point]:
    """Return steps away from a minimum until chi-square has risen."""
    row = best.data.rows[ANGLE]
    places = float(best.solution.z[best.problem.index(ANGLE)]) + step * np.arange(1.0, MOST_STEPS + 1.0)
    inside = places[(row.lower <= places) & (places <= row.upper)]
    return _until_risen(_held(best, halves, ANGLE, inside), best.value, rise)


def _held(best: Candidate, halves: Halves, name: str, places: Array) -> Iterator[Point]:
    """Yield fits with a parameter held, each from the one before, with the lift correction of the minimum."""
    mean, std = best.data.rows[name].prior or (0.0, np.inf)
    item = best.data
    for place in places.tolist():
        there = with_rows(item, {name: {"start": place, "prior": (place, HELD)}})
        end = halves.minimum(at_minimum, there, A_STEP, best.solution.lift)
        if end is None:
            return
        item = end.data
        yield place, end.value + ((place - mean) / std) ** 2, end

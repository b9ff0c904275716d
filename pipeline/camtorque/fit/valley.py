"""The valley along the trigger angle: the best minimum with that angle held aside, and how wide the valley is.

Trigger angle, friction and drive trade against one another along a bent valley of the residual. Its curvature at one
point tells neither its width nor whether a deeper place lies further on, so it is walked: the angle is held, all else
follows, both halves of the cycles judge. Where the posterior along the walk (profile likelihood; Raue et al.,
Bioinformatics 25 (2009) 1923) is wider than the curvature says, the angle is that uncertain; narrower it may be rugged,
and is not believed.
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
"""Parameter whose valley is walked."""
HELD = 1.0e-9
"""Standard deviation of an angle that is held [rad]."""
STEP_SHARE, STEPS_DEG = 0.6, (0.02, 0.3)
"""Step in standard deviations of the angle at the minimum, and its limits [deg]."""
MOST_STEPS, ROUNDS = 14, 3
A_STEP = Effort(12, gain=2.0e-3)
WALKED = 9.0
"""Rise of chi-square at which a walk ends: three standard deviations."""
DEEPER, GAINED = 1.0, 0.5
"""Fall of chi-square on the walk from which a minimum is sought there, and what that has to gain."""


@dataclass(frozen=True)
class Valley(ReadOnly):
    """Trigger angles that were held (m,) [rad] with what they cost, and the angle of the best minimum [rad].

    ``chi_square`` is that of the residual on both halves of the cycles, ``prior`` that of all parameters, (m,) each.
    """

    angles: Array
    chi_square: Array
    prior: Array
    at: float

    def std(self, inflation: float) -> float:
        """Return the root mean square distance from the minimum under the posterior along the valley [rad].

        It is nan where the valley was not walked on both sides. ``inflation``: factor on the residual's variance.
        """
        if self.angles.size < 3:
            return float("nan")
        angles = np.linspace(self.angles[0], self.angles[-1], 50 * self.angles.size)
        chi = np.interp(angles, self.angles, self.chi_square / inflation + self.prior)
        weight = np.exp(-0.5 * (chi - np.min(chi)))
        return float(np.sqrt(np.sum(weight * (angles - self.at) ** 2) / np.sum(weight)))


Point = tuple[float, float, Candidate]
"""Angle that was held [rad], chi-square there with the priors, and the fit."""
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
    angles, values = np.array([point[:2] for point in points]).T
    of_data = np.array([end.solution.data_chi_square + end.unseen for _, _, end in points])
    return best, Valley(angles, of_data, values - of_data, float(best.solution.z[best.problem.index(ANGLE)]))


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
    return _until_risen(_stepped(best, halves, step), best.value, rise)


def _stepped(best: Candidate, halves: Halves, step: float) -> Iterator[Point]:
    """Yield steps away from a minimum, each from the one before, with the lift correction of the minimum."""
    row = best.data.rows[ANGLE]
    mean, std = row.prior or (0.0, np.inf)
    angle, item = float(best.solution.z[best.problem.index(ANGLE)]), best.data
    for _ in range(MOST_STEPS):
        angle += step
        if not row.lower <= angle <= row.upper:
            return
        there = with_rows(item, {ANGLE: {"start": angle, "prior": (angle, HELD)}})
        end = halves.minimum(at_minimum, there, A_STEP, best.solution.lift)
        if end is None:
            return
        item = end.data
        yield angle, end.value + ((angle - mean) / std) ** 2, end

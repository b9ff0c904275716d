"""The way down: what ends it, and what does not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from camtorque.fit.descent import LOOKED_BACK, Basin, Descent, Effort, cannot_catch_up, minimise


@dataclass(frozen=True)
class Tilted:
    """A floor that falls gently along a narrow valley: (x - y) is known ten thousand times better than (x + y)."""

    z: np.ndarray
    residual: np.ndarray

    @property
    def chi_square(self) -> float:
        return float(self.residual @ self.residual)


JACOBIAN = np.array([[1e3, -1e3], [0.1, 0.1]])
FLOOR = np.array([0.0, 5.0])


def valley() -> Descent:
    def linearise(trial):
        return JACOBIAN.T @ JACOBIAN, -JACOBIAN.T @ trial.residual

    def step(point, _, damping):
        matrix, vector = point
        found = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), vector)
        return found, float(found @ (2.0 * vector - matrix @ found))

    return Descent(
        try_at=lambda z: Tilted(z, JACOBIAN @ z - FLOOR),
        linearise=linearise,
        step=step,
        promise=lambda point, _: float(point[1] @ np.linalg.solve(*point)),
        bounds=(np.full(2, -1e9), np.full(2, 1e9)),
    )


def test_a_descent_goes_on_where_damping_alone_promises_nothing():
    descent = valley()
    start = descent.try_at(np.zeros(2))
    # with the damping that a descent begins with, the way along the valley is hidden
    assert descent.step(descent.linearise(start), start.z, 1e-2)[1] < 1e-3
    ended = minimise(descent, start, Effort(40))
    assert ended.cost[2]
    assert start.chi_square == pytest.approx(25.0)
    assert ended.trial.chi_square < 0.1
    np.testing.assert_allclose(ended.trial.z, [25.0, 25.0], rtol=0.1)


def test_a_descent_ends_where_what_promises_more_has_failed():
    descent = valley()

    def wall(z):
        trial = Tilted(z, JACOBIAN @ z - FLOOR)
        return trial if np.all(z == 0.0) else Tilted(z, trial.residual + 10.0)

    ended = minimise(
        Descent(wall, descent.linearise, descent.step, descent.promise, descent.bounds), wall(np.zeros(2)), Effort(40)
    )
    assert np.all(ended.trial.z == 0.0)
    assert ended.cost[1] < 40
    assert not ended.cost[2], "what promises more is no minimum"


def test_a_descent_that_will_not_come_below_what_is_asked_for_is_given_up():
    descent = valley()

    def creeping(point, at, damping):
        found, promise = descent.step(point, at, damping)
        return 0.02 * found, 0.04 * promise

    slow, start = replace(descent, step=creeping), descent.try_at(np.zeros(2))
    assert minimise(slow, start, Effort(40)).cost[0] == 40
    given_up = minimise(slow, start, Effort(40, limit=1.0))
    assert given_up.cost == (LOOKED_BACK, LOOKED_BACK + 1, False)
    assert 15.0 < given_up.trial.chi_square < 25.0
    # one that comes there all the same is not
    still = given_up.trial.chi_square - 12.0 * (25.0 - given_up.trial.chi_square) / LOOKED_BACK
    assert minimise(slow, start, Effort(40, limit=still + 1.0)).cost[0] == 40
    assert minimise(descent, start, Effort(40, limit=1.0)).trial.chi_square < 0.1


def test_a_descent_is_not_given_up_before_its_gain_is_known():
    falling = [100.0, 90.0, 80.0, 70.0, 60.0]
    assert not cannot_catch_up(falling[:LOOKED_BACK], 0.0)
    assert not cannot_catch_up(falling, 0.0)  # 12 more steps of 10
    assert cannot_catch_up(falling, -61.0)
    assert not cannot_catch_up([10.0] * 9, 10.0)


def test_a_descent_that_has_come_back_to_a_known_minimum_ends():
    descent, start = valley(), valley().try_at(np.zeros(2))
    whole = minimise(descent, start, Effort(40, gain=1e-9))
    matrix = descent.linearise(whole.trial)[0]
    known = Basin(whole.trial.z, whole.trial.chi_square, matrix)
    back = minimise(descent, start, Effort(40, gain=1e-9, basin=known))
    assert back.cost[1] <= whole.cost[1]
    assert known.holds(back.trial)
    # nearby, but far above it, or as deep, but elsewhere, is another minimum
    assert not replace(known, chi_square=known.chi_square - 2.0).holds(back.trial)
    far = known.z + 40.0
    assert not replace(known, z=far).holds(back.trial)
    assert minimise(descent, start, Effort(40, gain=1e-9, basin=replace(known, z=far))).cost == whole.cost

"""Values drawn from a finished fit: within what may be, and still a fit of what was measured."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.known_fit import FittedAt, KnownFit, LoadKnowledge, draws, within
from camtorque.laws import ROWS

RECORDING = FittedAt("a", 100.0, "open", 0.01, True)


def drawn(names: tuple[str, ...], values: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    fit = KnownFit(names, values, ArrowCovariance.whole(covariance), (RECORDING,))
    mean = {**dict(zip(names, values, strict=True)), "torque_zero": 0.0}
    found = draws(fit, fit.own("a"), mean, LoadKnowledge({}), 1.0, 200)
    return np.array([[one[name] for name in names] for one in found])


def test_draws_beyond_a_bound_keep_what_is_known_of_sums():
    """Two compliances of which only the sum is known: one cut off at rigid left the shaft softer by as much."""
    names = ("shaft_compliance", "coupling_compliance")
    here, wide, sure = np.array([60.0e-6, 5.0e-6]), 30.0e-6, 0.2e-6
    difference, total = np.array([1.0, -1.0]) / np.sqrt(2.0), np.array([1.0, 1.0]) / np.sqrt(2.0)
    covariance = wide**2 * np.outer(difference, difference) + sure**2 * np.outer(total, total)
    found = drawn(names, here, covariance)
    assert np.min(found) >= 0.0
    assert 0.3 < np.mean(found[:, 1] == 0.0) < 0.6, "half of them want a coupling stiffer than rigid"
    assert np.max(np.abs(np.sum(found, axis=1) - np.sum(here))) < 5.0 * sure


def test_draws_within_their_rooms_stay():
    apart = np.random.default_rng(1).standard_normal((50, 3))
    found = within(apart, np.zeros(3), np.eye(3), np.array([[-9.0, 9.0]] * 3))
    np.testing.assert_allclose(found, apart)


@pytest.mark.parametrize(("lift", "is_open"), [(6.0e-6, False), (1.4e-3, True)])
def test_no_draw_opens_a_port_that_is_none(lift: float, is_open: bool):
    """Beside a suction valve: where it closes tells nothing, and half of the draws opened it (decision 0186)."""
    row = ROWS["port_closing_lift"]
    found = drawn(("port_closing_lift",), np.array([lift]), np.array([[1.7e-3**2]]))
    assert np.any(found > row.lower) == is_open
    assert np.any(found != lift) == is_open

"""A roller's pin on needles or in a plain bush: which one a recording tells, and what the other one adds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit import kinds
from camtorque.fit.joint_input import with_common_rows
from camtorque.fit.kinds import ARM, BUSH, BUSH_SOURCE, kind_rows, log_odds, of_most, pin_decided
from camtorque.fit.problem import with_rows
from camtorque.fit.single import PIN, fit_prepared
from camtorque.laws import ROWS
from fit_cases import quick, quick_data, quick_halves, quick_prepared, rig

NEEDLES, IN_BUSH = ("closed_volume", 0, 1000.0), ("plain_bush", 0, 1000.0)


def arm(item) -> float:
    return float(item.solution.z[item.problem.index(ARM)])


@pytest.fixture(scope="module")
def bushed():
    minima, other = pin_decided([quick(IN_BUSH)], quick_halves(IN_BUSH))
    return minima[0], other


def test_a_plain_bush_is_told_by_its_friction(bushed):
    best, other = bushed
    rub = rig(*IN_BUSH).truth.friction
    true = rub.pin_mu * rub.pin_radius
    assert best.data.rows[ARM].source == BUSH_SOURCE
    assert other is not None
    assert other.probability < 0.4
    # needles take less than half of the friction that a bush had, and the rest goes to other losses
    assert abs(arm(best) - true) < 0.5 * abs(arm(other.candidate) - true)


def test_needles_stay_what_they_are():
    best = quick(NEEDLES)
    minima, other = pin_decided([best], quick_halves(NEEDLES))
    assert minima == [best]
    assert other is not None
    assert other.probability < 0.4
    assert other.candidate.data.rows[ARM].prior == BUSH


def test_the_other_kind_widens_what_it_moves(bushed):
    best, other = bushed
    prepared = replace(quick_prepared(*IN_BUSH), candidates=(best,))
    alone = fit_prepared(prepared, weighed=False)
    both = fit_prepared(replace(prepared, other_pin=other), weighed=False)
    moved = other.candidate.solution.z - best.solution.z
    np.testing.assert_allclose(both.std**2 - alone.std**2, other.probability * moved**2, rtol=1e-4)
    assert set(both.shifts) - set(alone.shifts) == {PIN}
    assert len(both.pressure_shifts) == len(alone.pressure_shifts) + 1


def test_a_fit_that_ends_nowhere_decides_nothing(monkeypatch):
    best = quick(NEEDLES)
    monkeypatch.setattr(kinds, "_in_bush", lambda halves, item: None)
    assert pin_decided([best], quick_halves(NEEDLES)) == ([best], None)


def test_a_foot_that_slides_has_no_pin():
    best = quick(NEEDLES)
    foot = replace(best, data=with_rows(best.data, {ARM: {"source": "a foot that slides"}}))
    assert pin_decided([foot], quick_halves(NEEDLES)) == ([foot], None)


def test_odds_that_overflow_decide_nothing(monkeypatch):
    def overflowing(*arguments):
        raise np.linalg.LinAlgError

    best = quick(NEEDLES)
    monkeypatch.setattr(kinds, "laplace", overflowing)
    assert log_odds(best, best) is None
    assert pin_decided([best], quick_halves(NEEDLES)) == ([best], None)


def test_two_fits_alike_are_as_likely_as_benches_are():
    best = quick(NEEDLES)
    assert log_odds(best, best) == pytest.approx(np.log(kinds.BUSHES / (1.0 - kinds.BUSHES)))


@pytest.mark.parametrize(("bushes", "prior"), [(0, ROWS[ARM].prior), (1, ROWS[ARM].prior), (2, BUSH)])
def test_a_pump_has_the_pin_that_most_of_its_recordings_have(bushes, prior):
    one = quick_data(NEEDLES)
    items = [with_rows(one, {ARM: kind_rows(one.rows[ARM])[1]}) if k < bushes else one for k in range(3)]
    assert {item.rows[ARM].prior for item in with_common_rows(items)} == {prior}
    assert of_most([one.rows[ARM], items[0].rows[ARM]])[0].prior == ROWS[ARM].prior

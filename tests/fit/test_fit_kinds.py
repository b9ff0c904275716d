"""A pin on needles or in a plain bush, a suction valve or none: which one a recording tells, what the other adds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit import kinds
from camtorque.fit.fitted import either_kind
from camtorque.fit.joint_input import with_common_rows
from camtorque.fit.kinds import INLET, KINDS, PIN, OtherFit, kinds_decided, log_odds, weighed_losses
from camtorque.fit.problem import with_rows
from camtorque.fit.single import fit_prepared
from camtorque.fit.uncertainty import confidence
from camtorque.laws import ROWS
from camtorque.records import LossEvidence
from fit_cases import quick, quick_data, quick_halves, quick_prepared, rig

NEEDLES, IN_BUSH = ("closed_volume", 0, 1000.0), ("plain_bush", 0, 1000.0)
BUSH = KINDS[PIN]
ARM = BUSH.parameter
VALVE = KINDS[INLET]


def kind_decided(minima, halves, name):
    """Return minima and the fit beside them where one part alone is asked for."""
    found, others = kinds_decided(minima, halves, {name: KINDS[name]})
    return found, others.get(name)


def arm(item) -> float:
    return float(item.solution.z[item.problem.index(ARM)])


@pytest.fixture(scope="module")
def bushed():
    minima, other = kind_decided([quick(IN_BUSH)], quick_halves(IN_BUSH), PIN)
    return minima[0], other


def test_a_plain_bush_is_told_by_its_friction(bushed):
    best, other = bushed
    rub = rig(*IN_BUSH).truth.friction
    true = rub.pin_mu * rub.pin_radius
    assert best.data.rows[ARM].source == BUSH.source
    assert other is not None
    assert other.probability < 0.4
    # needles take less than half of the friction that a bush had, and the rest goes to other losses
    assert abs(arm(best) - true) < 0.5 * abs(arm(other.candidate) - true)


def test_needles_stay_what_they_are():
    best = quick(NEEDLES)
    minima, other = kind_decided([best], quick_halves(NEEDLES), PIN)
    assert minima == [best]
    assert other is not None
    assert other.probability < 0.4
    assert other.candidate.data.rows[ARM].prior == BUSH.prior


def test_the_other_kind_widens_what_it_moves(bushed):
    best, other = bushed
    prepared = replace(quick_prepared(*IN_BUSH), candidates=(best,))
    alone = fit_prepared(prepared, weighed=False)
    both = fit_prepared(replace(prepared, other_kinds={PIN: other}), weighed=False)
    moved = other.candidate.solution.z - best.solution.z
    np.testing.assert_allclose(both.std**2, alone.std**2 + other.probability * moved**2, rtol=1e-9)
    assert set(both.shifts) - set(alone.shifts) == {PIN}
    assert len(both.pressure_shifts) == len(alone.pressure_shifts) + 1


def test_a_fit_that_ends_nowhere_decides_nothing(monkeypatch):
    best = quick(NEEDLES)
    monkeypatch.setattr(kinds, "_with_other", lambda halves, turned: None)
    assert kind_decided([best], quick_halves(NEEDLES), PIN) == ([best], None)


def test_a_foot_that_slides_has_no_pin():
    best = quick(NEEDLES)
    foot = replace(best, data=with_rows(best.data, {ARM: {"source": "a foot that slides"}}))
    assert kind_decided([foot], quick_halves(NEEDLES), PIN) == ([foot], None)


def test_odds_that_overflow_decide_nothing(monkeypatch):
    def overflowing(*arguments):
        raise np.linalg.LinAlgError

    best = quick(NEEDLES)
    monkeypatch.setattr(kinds, "laplace", overflowing)
    assert log_odds(BUSH, best, best) is None
    assert kind_decided([best], quick_halves(NEEDLES), PIN) == ([best], None)


def test_two_fits_alike_are_as_likely_as_benches_are():
    best = quick(NEEDLES)
    assert log_odds(BUSH, best, best) == pytest.approx(np.log(BUSH.share / (1.0 - BUSH.share)))


@pytest.mark.parametrize(("bushes", "prior"), [(0, ROWS[ARM].prior), (1, ROWS[ARM].prior), (2, BUSH.prior)])
def test_a_pump_has_the_pin_that_most_of_its_recordings_have(bushes, prior):
    one = quick_data(NEEDLES)
    items = [with_rows(one, {ARM: BUSH.rows(one.rows[ARM])[1]}) if k < bushes else one for k in range(3)]
    assert {item.rows[ARM].prior for item in with_common_rows(items)} == {prior}
    assert BUSH.of_most([one.rows[ARM], items[0].rows[ARM]])[0].prior == ROWS[ARM].prior


def viscous(item) -> float:
    return float(item.solution.z[item.problem.index("plunger_viscous")])


def test_a_valve_that_fills_the_chamber_on_the_return_is_told_from_none():
    """Without one what passes for it throttles the return, and the plunger's viscous drag pays (decision 0187).

    Draws 0 and 2 are told as pumps without one, at odds of nine to one: their drag is too low by 0.4 standard errors.
    """
    case = ("suction_valve", 1, 1000.0)
    minima, others = kinds_decided([quick(case)], quick_halves(case), KINDS)
    best, other = minima[0], others[INLET]
    assert set(others) == set(KINDS)
    assert best.data.rows[VALVE.parameter].source == VALVE.source
    assert other.probability < 0.4
    assert other.beside == best
    assert viscous(other.candidate) < viscous(best)
    assert abs(viscous(best) - rig(*case).truth.friction.plunger_viscous) < 1.0  # of 4.4 that it is known to


def test_a_pump_without_a_suction_valve_gets_none():
    case = ("spill", 0, 1000.0)
    minima, other = kind_decided([quick(case)], quick_halves(case), INLET)
    assert minima == [quick(case)]
    assert other is not None
    assert other.probability < 0.5


def test_a_chamber_that_is_the_line_has_no_inlet():
    """Its fit has no such parameter."""
    line = quick(("bare", 0, 1000.0))
    measured = replace(line, problem=replace(line.problem, parameters=()))
    assert kind_decided([measured], quick_halves(("bare", 0, 1000.0)), INLET) == ([measured], None)


@pytest.mark.parametrize(
    ("probability", "usual", "verdict"),
    [(0.4, "not needed", "not needed"), (0.001, "not needed", "cannot tell"), (0.4, "needed", "cannot tell")],
)
def test_what_comes_with_a_valve_that_may_not_be_there_is_not_needed(monkeypatch, probability, usual, verdict):
    """Of sixteen pumps without friction and valve eleven were told that they may have some, with a valve's pull."""
    case = ("suction_valve", 0, 1000.0)
    ports = quick(case)
    valve = kinds._with_other(quick_halves(case), (VALVE, ports))
    row = LossEvidence("friction", -15.0, "cannot tell", False, 0.3, (0.0, 0.4), "N m", "")
    damping = replace(row, name="damping", verdict="needed")
    said = {VALVE.source: (row, damping), ROWS[VALVE.parameter].source: (replace(row, verdict=usual), damping)}
    monkeypatch.setattr(
        kinds, "loss_evidence",
        lambda problem, *_: said[problem.data[0].rows[VALVE.parameter].source],
    )  # fmt: skip
    others = {INLET: OtherFit(ports, valve, probability)}
    cov = kinds.covariance(valve.problem, valve.solution)
    found = {row.name: row.verdict for row in weighed_losses(valve, others, cov)}
    assert found == {"friction": verdict, "damping": "needed"}


@pytest.mark.parametrize(("kept", "other", "up"), [(40.0e-6, 150.0e-6, True), (150.0e-6, 35.0e-6, False)])
@pytest.mark.parametrize("probability", [0.03, 0.13, 0.4])
def test_an_interval_reaches_as_far_as_both_kinds_do(kept: float, other: float, up: bool, probability: float):
    """Draws of both kinds lie beyond the end on the other one's side as often as an interval of 95 % says."""
    row = ROWS[ARM] if up else replace(ROWS[ARM], source=BUSH.source, prior=BUSH.prior)
    width, own, rng = BUSH.turned(row)["prior"][1], 25.0e-6, np.random.default_rng(5)
    low, high = either_kind(row, (kept, own), other, probability, (0.0, 300.0e-6))
    is_other = rng.random(400_000) < probability
    drawn = np.where(is_other, rng.normal(other, width, is_other.size), rng.normal(kept, own, is_other.size))
    if up:
        assert low == 0.0
        assert np.mean(drawn > high) == pytest.approx(0.025, abs=0.001)
    else:
        assert high == 300.0e-6
        assert np.mean(drawn < low) == pytest.approx(0.025, abs=0.001) if low > 0.0 else np.mean(drawn < 0.0) >= 0.025


def test_where_nothing_tells_the_kind_of_the_pin_the_interval_is_that_of_one():
    fit = fit_prepared(quick_prepared(*NEEDLES), weighed=False)
    k = fit.problem.index(ARM)
    row, value = fit.problem.parameters[k].row, float(fit.solution.z[k])
    alone = replace(fit, other_pin=0.0)
    assert alone.interval(k) == confidence(value, float(fit.std[k]), row.lower, row.upper)
    assert fit.interval(k)[1] >= alone.interval(k)[1] or not fit.other_pin

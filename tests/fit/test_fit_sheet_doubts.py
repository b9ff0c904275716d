"""What is stated wrongly is named by what torque and pressure would have in its place; sound sheets are not doubted."""

from __future__ import annotations

import math
from dataclasses import fields

import numpy as np
import pytest
from camtorque.config import PumpData
from camtorque.fit import sheet_doubts as room
from camtorque.fit.findings import sheet_findings
from camtorque.fit.minima import Candidate, at_minimum
from camtorque.fit.sheet_doubts import (
    AS_WELL,
    DELAYS,
    OF_PUMP,
    QUANTITIES,
    WRONG_BY,
    WRONG_SHEETS,
    SheetDoubt,
    odds_against,
    sheet_doubts,
)
from camtorque.fit.uncertainty import covariance, narrowed
from fit_cases import quick
from scipy.stats import cauchy

RUN = ("spill", 0, 1000.0)


def doubts_of(item: Candidate) -> tuple[SheetDoubt, ...]:
    cov = narrowed(covariance(item.problem, item.solution), item.solution)
    return sheet_doubts(item, cov.inflation)


@pytest.mark.parametrize("family", ["closed_volume", "spill", "plain", "foreign_leak", "foreign_hysteresis"])
def test_sound_sheets_are_not_doubted(family: str):
    assert doubts_of(quick((family, 0, 1000.0))) == ()


@pytest.mark.parametrize(("family", "quantity", "wrong_by"), [
    ("spill", "plunger_diameter_m", 1.15), ("spill", "plunger_diameter_m", 1.2),
    ("spill", "spring_stiffness_N_per_m", 1.6), ("spill", "spring_preload_N", 0.5), ("spill", "follower_mass_kg", 2.0),
    ("spill", "gain of the pressure", 1.3), ("spill", "gain of the torque", 1.2),
    ("plain", "lift of the cam", 1.12), ("closed_volume", "lift of the cam", 1.15),
])  # fmt: skip
def test_a_wrong_sheet_is_named_with_its_size(family: str, quantity: str, wrong_by: float):
    """Area, lift and both gains stand in for one another: the one that is wrong is told, first or beside another."""
    wrong = at_minimum(QUANTITIES[quantity](quick((family, 0, 1000.0)).data, wrong_by))
    found = doubts_of(wrong)
    assert all(one.two_ln_odds > found[0].two_ln_odds - AS_WELL for one in found)
    (mine,) = [one for one in found if one.quantity == quantity]
    assert abs(mine.factor * wrong_by - 1.0) < 4.0 * mine.std * wrong_by + 0.03  # bounds and weights move with it


@pytest.mark.parametrize(("family", "quantity", "later"), [
    ("spill", "delay of the pressure", -0.25), ("closed_volume", "delay of the torque", 0.3),
    ("plain", "delay of the torque", 0.3),
])  # fmt: skip
def test_a_wrong_delay_is_told_as_that_of_one_sensor_or_the_other(family: str, quantity: str, later: float):
    """The trigger angle takes what both have in common: torque too late and pressure too early are one."""
    wrong = at_minimum(QUANTITIES[quantity](quick((family, 0, 1000.0)).data, math.exp(later)))
    found = doubts_of(wrong)[0]
    assert found.quantity in DELAYS
    asked = -later if found.quantity == quantity else later
    assert math.log(found.factor) == pytest.approx(asked, abs=3.0 * found.std / found.factor)


def test_a_descent_that_runs_away_is_no_doubt(monkeypatch: pytest.MonkeyPatch):
    wrong = at_minimum(QUANTITIES["plunger_diameter_m"](quick(RUN).data, 1.15))
    assert doubts_of(wrong)

    def runs_away(*_: object) -> Candidate:
        raise FloatingPointError

    for name in ("at_minimum", "_pull"):
        monkeypatch.setattr(room, name, runs_away)
        assert doubts_of(wrong) == ()


@pytest.mark.parametrize(("std", "told"), [(0.31, False), (0.05, True)])
def test_a_factor_that_may_as_well_be_one_is_no_doubt(monkeypatch: pytest.MonkeyPatch, std: float, told: bool):
    """A deeper minimum elsewhere said 15.9 +- 4.0 mm in place of 13, where 10 were true."""
    wrong = at_minimum(QUANTITIES["plunger_diameter_m"](quick(RUN).data, 1.15))
    monkeypatch.setattr(
        room, "_followed", lambda best, scaled, inflation, name, start: SheetDoubt(name, 1.2, std, 20.0)
    )
    assert bool(doubts_of(wrong)) is told


def test_odds_go_with_gain_and_with_how_sharply_a_factor_is_known():
    assert odds_against(20.0, 1.1, 0.05) - odds_against(15.0, 1.1, 0.05) == pytest.approx(5.0)
    assert odds_against(15.0, 1.1, 0.1) > odds_against(15.0, 1.1, 0.01)
    assert odds_against(0.0, 1.0, 0.3) < -7.0  # one sheet in fifty is wrong


def test_odds_are_the_evidence_of_a_cauchy_factor_by_quadrature():
    """A mass twice as large had odds fourteen times too high: of the prior the density at one was taken everywhere."""
    grid = np.linspace(-6.0, 6.0, 240_001)
    for factor, std, gain in ((2.0, 0.08, 12.0), (0.9, 0.02, 9.0)):
        likelihood = np.exp(-0.5 * ((grid - math.log(factor)) / std) ** 2 + 0.5 * gain)
        evidence = np.trapezoid(likelihood * cauchy.pdf(grid, scale=WRONG_BY), grid)
        odds = evidence * WRONG_SHEETS / (1.0 - WRONG_SHEETS)
        assert odds_against(gain, factor, std) == pytest.approx(2.0 * math.log(odds), abs=0.1)  # Laplace


def test_quantities_of_the_pump_are_its_fields():
    assert set(OF_PUMP.values()) <= {field.name for field in fields(PumpData)}
    assert set(OF_PUMP) <= set(QUANTITIES)


def test_the_finding_says_what_is_asked_for_and_what_is_stated():
    pump = quick(RUN).data.chain.pump
    (found,) = sheet_findings(
        (SheetDoubt("plunger_diameter_m", 0.9, 0.01, 20.0), SheetDoubt("gain of the torque", 1.2, 0.03, 18.0)), pump
    )
    assert found.code == "sheet_contradicted"
    assert found.severity == "warning"
    assert f"plunger_diameter_m = {0.9 * pump.plunger_diameter:.3g}" in found.text
    assert "a gain of the torque that is 1.20 ± 0.03 times as large" in found.text
    (found,) = sheet_findings((SheetDoubt("delay of the torque", math.exp(0.3), 0.031 * math.exp(0.3), 20.0),), pump)
    assert "a delay of the torque that is 0.30 ± 0.03 ms shorter (the two delays" in found.text
    assert sheet_findings((), pump) == ()
    for factor, slip in (
        (1.35, "large, as of lbf ft taken"),
        (0.735, "large, as of N m taken for lbf ft"),
        (1.5, "large ("),
        (1.2, "large ("),
    ):
        (found,) = sheet_findings((SheetDoubt("gain of the torque", factor, 0.06, 20.0),), pump)
        assert slip in found.text
    (found,) = sheet_findings((SheetDoubt("gain of the pressure", 1.35, 0.06, 20.0),), pump)
    assert "lbf" not in found.text

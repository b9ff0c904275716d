"""Truth in, truth out: rigs stepped in time, fitted in the angle and harmonic domain."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from camtorque.fit import FitOptions, Prepared, fit_prepared
from camtorque.fit.problem import FIT_EFFECTS
from camtorque.fit.result import Fit, fitted_torque
from camtorque.records import FittedTorque
from rig_prepared import prepared_run
from rigs.cycles import as_cycles
from rigs.families import FAMILIES
from rigs.rig import RigRun, simulate

CHAIN = tuple(name for name in FIT_EFFECTS if name not in ("controller", "coupling"))
"""Without the ladder: what one speed can tell; a controller needs several."""


@cache
def case(family: str, speed: float, ladder: bool) -> tuple[RigRun, Prepared, Fit, FittedTorque]:
    truth = FAMILIES[family](np.random.default_rng(5))
    run = simulate(truth, speed_rpm=speed, load=0.7, n_cycles=16, seed=3, step=1e-5)
    prepared = prepared_run(run)
    fit = fit_prepared(prepared, FitOptions(effects=None if ladder else CHAIN, use_ladder=ladder))
    return run, prepared, fit, fitted_torque(
        fit, 0, prepared.recording, prepared.cycles, prepared.rigid, prepared.means
    )  # fmt: skip


@pytest.mark.parametrize("family", ["plain", "negative_rotation", "foreign_leak"])
def test_closed_volume_rig_is_recovered(family):
    run, _, _, fitted = case(family, 612.0, False)
    # the wanted figures of a fit: 0.1 deg, 1 % of the pressure, 0.2 % of the torque, energy within 1 %
    trigger = np.rad2deg(run.truth.trigger.angle_offset)
    found = fitted.parameter("trigger_offset")
    assert abs(found.value - trigger) < 0.1
    assert abs(found.value - trigger) < 3.0 * found.stderr
    chamber = run.true_cycles("chamber_pressure", 3600).mean(axis=0)
    grid = 2 * np.pi * np.arange(3600) / 3600
    model = np.interp(grid, fitted.true_angle, fitted.chamber_pressure, period=2 * np.pi)
    assert np.sqrt(np.mean((model - chamber) ** 2)) < 0.01 * np.max(chamber)
    held = fitted.metrics["fitted_held_out_cycles"]
    assert held.rms_percent_of_peak < 0.2
    assert abs(held.forward_gap_percent) < 0.5
    assert abs(held.return_min_measured_nm - held.return_min_model_nm) < 0.4
    assert abs(fitted.losses["closure_percent"]) < 1.0


def test_cam_angle_within_the_revolution_is_recovered():
    run, _, _, fitted = case("plain", 612.0, False)
    truth = as_cycles(run)["true_angle"].mean(axis=0)
    nominal = 2 * np.pi * np.arange(3600) / 3600
    before = np.rad2deg(np.sqrt(np.mean((nominal - truth) ** 2)))
    after = np.rad2deg(np.sqrt(np.mean((fitted.true_angle - truth) ** 2)))
    assert after < 0.15
    assert after < 0.5 * before


def test_spill_is_told_from_a_closed_volume():
    _, prepared, _, fitted = case("plain_spill", 612.0, False)
    assert prepared.data.delivery == "spill"
    assert fitted.metrics["fitted_held_out_cycles"].rms_percent_of_peak < 0.2
    assert case("plain", 612.0, False)[1].data.delivery == "closed"


def test_ladder_finds_no_chamber_where_there_is_none():
    _, _, fit, fitted = case("bare", 455.0, True)
    assert "chamber" not in fit.problem.effects
    assert "friction" not in fit.problem.effects
    assert fitted.chamber_pressure is None
    assert fitted.chamber_peak is None
    assert fitted.metrics["fitted_held_out_cycles"].rms_percent_of_peak < 0.2


def test_ladder_finds_friction_alone():
    _, _, fit, _ = case("friction_only", 1185.0, True)
    assert "friction" in fit.problem.effects
    assert "chamber" not in fit.problem.effects
    assert "driveline" not in fit.problem.effects


def test_ladder_rows_start_rigid_and_have_one_choice():
    _, _, fit, _ = case("friction_only", 1185.0, True)
    assert fit.ladder[0].effects == ()
    assert fit.ladder[0].n_parameters == 0
    assert sum(row.chosen for row in fit.ladder) >= 1
    assert {row.effects for row in fit.ladder if row.chosen} == {fit.problem.effects}
    assert all("untested on other recordings" in row.reason for row in fit.ladder[1:])


def test_causes_sum_to_the_model():
    _, _, _, fitted = case("plain", 612.0, False)
    total = np.sum(list(fitted.by_cause.values()), axis=0)
    # sums of floats in another order
    np.testing.assert_allclose(total, fitted.torque, atol=1e-9)

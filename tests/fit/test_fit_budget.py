"""The budget of every parameter, its profile interval, and what another recording would bring."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.advice import GROUPS, next_measurement
from camtorque.fit.budget import MODEL, PRESSURE_GAIN, SOURCE_OF_PRIOR, pressure_gain_shift
from camtorque.fit.estimates import COVERAGE, profile_findings, with_profiles
from camtorque.fit.next_run import RUNS, expected_gains
from camtorque.fit.profiles import KINDS, PROFILED, Profile
from camtorque.fit.result import fitted_torque
from camtorque.fit.single import BOOTSTRAP_DRAWS, FitOptions, fit_prepared
from camtorque.laws import ROWS
from camtorque.records import ParameterEstimate
from rig_prepared import prepared_run
from rigs.families import FAMILIES
from rigs.rig import simulate

EFFECTS = ("chamber", "trigger", "driveline", "sensor", "friction", "damping")


@pytest.fixture(scope="module")
def case():
    run = simulate(
        FAMILIES["plain"](np.random.default_rng(3)), speed_rpm=560.0, load=0.7, n_cycles=12, seed=2, step=1e-5
    )
    prepared = prepared_run(run)
    fit = fit_prepared(prepared, FitOptions(effects=EFFECTS, use_ladder=False))
    return fit, fitted_torque(fit, 0, prepared.recording, prepared.cycles, prepared.rigid, prepared.means)


def test_squares_of_the_budget_sum_to_the_total(case):
    _, fitted = case
    for row in fitted.details["budget"]:
        # the split is an identity of the covariance; rounding of one inverse
        assert row.total == pytest.approx(fitted.parameter(row.name).stderr, rel=1e-5, abs=1e-12)


def test_a_parameter_told_by_its_certificate_alone_has_it_as_source(case):
    _, fitted = case
    rows = {row.name: row for row in fitted.details["budget"]}
    assert rows["gain_error"].contributions["torque gain"] > 0.95 * rows["gain_error"].total
    assert rows["trigger_offset"].contributions["torque gain"] < 0.05 * rows["trigger_offset"].total
    assert rows["trigger_offset"].contributions[MODEL] > 0.0
    assert set(SOURCE_OF_PRIOR) <= set(ROWS)


def test_gain_of_the_pressure_moves_the_friction_and_is_counted(case):
    fit, fitted = case
    assert np.all(pressure_gain_shift(fit.problem, fit.solution, 0.0) == 0.0)
    small = pressure_gain_shift(fit.problem, fit.solution, 1e-3)
    large = pressure_gain_shift(fit.problem, fit.solution, 2e-3)
    names = [slot.name for slot in (*fit.problem.nonlinear, *fit.problem.linear)]
    k = names.index("gain_error")
    assert small[k] > 0.0
    # to first order twice the gain moves every parameter twice as far
    assert large[k] == pytest.approx(2.0 * small[k], rel=0.05)
    assert all(row.contributions[PRESSURE_GAIN] >= 0.0 for row in fitted.details["budget"])


def test_profiles_give_the_stated_intervals(case):
    fit, fitted = case
    assert {profile.name for profile in fit.profiles} == set(PROFILED)
    for profile in fit.profiles:
        row = fitted.parameter(profile.name)
        assert profile.kind in KINDS
        assert row.ci95[0] <= max(profile.low, row.ci95[0]) <= row.value <= row.ci95[1]
        if profile.kind == "two-sided":
            assert row.ci95[1] >= min(profile.high, row.value + COVERAGE * row.stderr_statistical * 0.5)


def test_bootstrap_of_the_cycles_stays_below_the_statistical_error(case):
    fit, fitted = case
    drawn = dict(zip(fit.bootstrap.names, fit.bootstrap.std, strict=True))
    assert fit.bootstrap.samples.shape[0] == BOOTSTRAP_DRAWS
    ratio = [drawn[n] / fitted.parameter(n).stderr_statistical for n in PROFILED if fitted.parameter(n).stderr > 0.0]
    # the weights admit a model error that all cycles share, which the bootstrap cannot see
    assert 0.0 < np.median(ratio) < 1.2


def estimate(**changes) -> ParameterEstimate:
    row = ParameterEstimate(
        "leakage", 0.4, "mm^3/s/bar", 0.5, 0.4, (0.0, 1.4), False, True, (), (0.5, 2.0), "leak", "literature"
    )
    return replace(row, **changes)


@pytest.mark.parametrize(
    ("kind", "low", "high", "interval", "identifiable"),
    [
        ("two-sided", 0.1, 1.0, (0.4 - np.hypot(0.3, 0.588), 0.4 + np.hypot(0.6, 0.588)), True),
        ("upper limit", 0.0, 1.0, (0.0, 0.4 + np.hypot(0.6, 0.588)), True),
        ("lower limit", 0.1, 200.0, (0.4 - np.hypot(0.3, 0.588), 200.0), True),
        ("flat", 0.0, 200.0, (0.0, 200.0), False),
    ],
)
def test_sides_without_an_end_reach_to_the_bound(kind, low, high, interval, identifiable):
    profile = Profile("leakage", "mm^3/s/bar", np.array([low, high]), np.zeros(2), 0.4, low, high, kind, False)
    (row,) = with_profiles([estimate()], [profile])
    assert row.ci95 == pytest.approx((max(interval[0], 0.0), interval[1]), rel=1e-3)
    assert row.identifiable == identifiable
    findings = profile_findings([profile])
    assert len(findings) == (kind != "two-sided")


def test_another_recording_never_makes_anything_worse(case):
    fit, _ = case
    gains = expected_gains(fit.problem, fit.solution, 0)
    assert {gain.recording for gain in gains} == set(RUNS)
    for gain in gains:
        # the inflation of the variances is renewed with more data; by a few percent at most
        assert gain.after <= 1.05 * gain.before + 1e-12


def test_each_recording_helps_what_it_is_made_for(case):
    fit, _ = case
    ratio = {(g.recording, g.name): g.after / g.before for g in expected_gains(fit.problem, fit.solution, 0)}
    assert ratio["a repeat with standstill readings of the torque", "torque_zero"] < 0.75
    assert ratio["the same load at half the speed", "leakage"] < 0.6
    assert ratio["the same load at twice the speed", "delay_error"] < 0.8
    assert ratio["a repeat with standstill readings of the torque", "gain_error"] > 0.95


def test_advice_names_the_recording_and_its_gain(case):
    fit, _ = case
    weak = estimate(name="shaft_drag", unit="N m", identifiable=False)
    text = next_measurement([weak], expected_gains(fit.problem, fit.solution, 0))
    assert len(text) == 1
    assert "expected of" in text[0] or "would not tell" in text[0]
    assert next_measurement([weak]) == (text[0].split("; expected")[0].split("; another")[0],)
    assert all(members <= set(ROWS) for members, _ in GROUPS)

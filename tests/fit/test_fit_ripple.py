"""Torque that a drive repeats many times a revolution: seen on the base circle, fitted, told; ringing is none."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.align import align
from camtorque.fit.minima import at_minimum
from camtorque.fit.prepare import base_circle, fit_data, mean_cycles, repeated_order
from camtorque.fit.problem import with_starts
from camtorque.fit.result import fitted_torque
from camtorque.fit.single import Prepared, fit_prepared
from camtorque.fit.valleys import NO_VALLEY
from camtorque.ingest import read_recording
from camtorque.laws.ripple import binned_waves, waves
from camtorque.mechanism.lift_laws import spectral_law
from fit_cases import bridged, rig, true_starts

EXAMPLE = Path(__file__).resolve().parents[2] / "raw_examples" / "A_0300rpm"
N = 1800
THETA = np.arange(N) * 2.0 * np.pi / N
LIFT = 8e-3 * np.sin(np.clip(1.5 * (THETA - 0.1), 0.0, np.pi)) ** 2
STROKE = 40.0 * np.sin(np.clip(3.0 * (THETA - 0.4), 0.0, np.pi)) ** 2
AMPLITUDE, ORDER, PHASE = 0.3, 41, 0.7
RIG = ("closed_volume", 0, 1000.0)
BASE = 2.0 * np.pi - 2.0 * np.pi / 3.0


def test_the_base_circle_is_where_the_lift_stands_and_nothing_rings_any_more():
    places = base_circle(LIFT)
    assert places.size * 360.0 / N == pytest.approx(np.degrees(BASE) - 40.0, abs=8.0)
    assert np.all(LIFT[places % N] < 0.01 * LIFT.max())
    np.testing.assert_array_equal(base_circle(np.roll(LIFT, 1500)) % N, (places + 1500) % N)


@pytest.mark.parametrize("order", [4, 24, 41, 150])
def test_an_order_that_stands_all_around_is_seen(order):
    wave = 0.2 * np.cos(order * THETA + 1.0)
    drag = 0.5 + 0.05 * np.sin(THETA)
    noise = 0.03 * np.random.default_rng(order).standard_normal(N)
    assert repeated_order(STROKE + drag + wave + noise, LIFT) == order
    assert repeated_order(STROKE + drag + wave + noise, LIFT + 0.05 * LIFT.max()) == order, "its zero is no base circle"
    assert repeated_order(STROKE + drag + noise, LIFT) == 0
    assert repeated_order(STROKE + drag + 0.02 * wave + noise, LIFT) == 0


@pytest.mark.parametrize(("order", "decay"), [(17.0, 1.0), (17.5, 0.3), (30.5, 0.0), (8.0, 1.5)])
def test_what_rings_after_the_stroke_is_none(order, decay):
    since = np.maximum(THETA - 2.2, 0.0)
    ringing = 3.0 * np.exp(-decay * since) * np.sin(order * since) * (since > 0.0)
    assert repeated_order(STROKE + 0.5 + ringing, LIFT) == 0


@pytest.mark.parametrize("each", [1, 2, 3, 12])
def test_waves_in_bins_are_means_of_those_on_the_grid(each):
    fine = np.arange(600 * each) * 2.0 * np.pi / (600 * each)
    np.testing.assert_allclose(
        binned_waves(ORDER, 600, 600 * each), waves(ORDER, fine).reshape(600, each, 2).mean(axis=1), atol=1e-12
    )
    assert not binned_waves(0, 600, 600 * each).any()


def test_without_a_base_circle_nothing_is_said():
    assert repeated_order(STROKE + np.cos(41 * THETA), 4e-3 * (1.0 - np.cos(3.0 * THETA))) == 0


@pytest.fixture(scope="module")
def fitted():
    recording, cycles, rigid = bridged(RIG)
    wave = AMPLITUDE * np.cos(ORDER * cycles.theta - PHASE)
    found = []
    for torque in (cycles.torque, cycles.torque + wave):
        run = replace(cycles, torque=torque)
        means = mean_cycles(run)
        data = replace(fit_data(recording, run, spectral_law(recording.cam_table), means), structure="land")
        near = at_minimum(with_starts(data, true_starts(rig(*RIG).truth)))
        prepared = Prepared(recording, run, rigid, means, (near,), NO_VALLEY, data.chain.shaft_torque)
        found.append(fitted_torque(fit_prepared(prepared, weighed=False), recording, run, rigid, means))
    return found


def test_a_fit_without_such_an_order_has_no_parameter_of_it():
    recording = read_recording(EXAMPLE)
    cycles = align(recording)
    data = fit_data(recording, cycles, spectral_law(recording.cam_table), mean_cycles(cycles))
    assert data.chain.ripple_order == 0
    assert not data.applies("ripple_cosine")


def test_the_ripple_that_was_put_in_is_fitted_and_nothing_else_moves(fitted):
    without, found = fitted
    known, before = ({row.name: row for row in item.parameters} for item in (found, without))
    assert known["ripple_cosine"].value == pytest.approx(AMPLITUDE * np.cos(PHASE), abs=0.01)
    assert known["ripple_sine"].value == pytest.approx(AMPLITUDE * np.sin(PHASE), abs=0.01)
    assert found.explained
    for name in ("trigger_offset", "shaft_compliance", "feed_pressure"):
        # of two minima that fit alike rounding picks one, and they differ in the feed pressure
        doubt = np.hypot(known[name].stderr, before[name].stderr)
        assert abs(known[name].value - before[name].value) < doubt, name
    assert "ripple_cosine" not in before
    (told,) = [item for item in found.findings if item.code == "drive_ripple"]
    amplitude = re.match(r"on the base circle the torque repeats itself 41 times a revolution \(amplitude (.*) N m\)",
                         told.text)  # fmt: skip
    assert amplitude is not None
    assert float(amplitude[1]) == pytest.approx(AMPLITUDE, abs=0.01)


def test_the_causes_with_the_ripple_sum_to_the_model(fitted):
    _, found = fitted
    np.testing.assert_allclose(np.sum(list(found.by_cause.values()), axis=0), found.torque, atol=0.02)
    assert np.ptp(found.by_cause["drive_ripple"]) == pytest.approx(2.0 * AMPLITUDE, rel=0.05)
    assert "drive_ripple" not in fitted[0].by_cause

"""Truth in, truth out: rigs that share no code with the fit, their values, intervals, chamber and cam angle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.derived import delivered_volume
from camtorque.fit.minima import at_minimum, followed
from camtorque.fit.prepare import FINER_BINS, INDEPENDENT, fit_data, mean_cycles
from camtorque.fit.problem import build_problem, with_rows, with_starts
from camtorque.fit.residual import is_explained
from camtorque.fit.result import fitted_torque
from camtorque.fit.search import SearchState, load_anew
from camtorque.fit.single import fit_prepared
from camtorque.fit.solver import lift_at, no_lift, try_at
from camtorque.fit.starts import (
    SMOOTHINGS_DEG,
    Start,
    coarse,
    continued,
    descend,
    first_starts,
    reweighted,
    rising_angles,
)
from camtorque.fit.uncertainty import covariance, narrowed, prior_std, ripple
from camtorque.laws import ROWS, bridge, valve
from camtorque.laws.chain import BINS
from camtorque.mechanism.lift_laws import spectral_law
from camtorque.units import COVERAGE, angle_grid
from fit_cases import bridged, quick, quick_data, quick_prepared, rig, true_starts
from rigs.cycles import as_cycles

LAND = ("closed_volume", 0, 1000.0)
SPILL = ("spill", 1, 800.0)
N = 1800


@pytest.fixture(scope="module", params=[LAND, SPILL], ids=["land", "spill"])
def case(request):
    return request.param


@pytest.fixture(scope="module")
def record(case):
    prepared = quick_prepared(*case)
    fit = fit_prepared(prepared, weighed=False)
    return fitted_torque(fit, prepared.recording, prepared.cycles, prepared.rigid, prepared.means)


def known(case):
    truth = rig(*case).truth
    rub = truth.friction
    return {
        **true_starts(truth), "bulk_modulus_slope": truth.fluid.slope,
        "bearing_arm": rub.bearing_mu * rub.bearing_radius, "pin_arm": rub.pin_mu * rub.pin_radius,
        "guide_friction": rub.guide_mu * rub.guide_lever, "packing_force": rub.seal_force,
        "shaft_drag": rub.drag_torque, "shaft_viscous": rub.shaft_viscous, "plunger_viscous": rub.plunger_viscous,
        "spring_stiffness_error": truth.pump.spring_stiffness_error,
        "delay_error": truth.torque_sensor.delay_error * truth.torque_sensor.delay,
        "torque_zero": truth.torque_sensor.zero_residual, "gain_error": truth.torque_sensor.gain_error,
        "pressure_zero": truth.pressure_sensor.zero_residual,
    }  # fmt: skip


FOREIGN = {"valve_opening", "valve_area", "retraction_volume"}
"""The rig's valve obeys another law: its numbers mean something else."""


def test_intervals_hold_the_truth(case, record):
    rows = {row.name: row for row in record.parameters}
    scale = {parameter.name: parameter.row.per_unit for parameter in quick(case).problem.parameters}
    true = {name: value / scale[name] for name, value in known(case).items() if name in scale and name not in FOREIGN}
    missed = [name for name, value in true.items() if not rows[name].ci95[0] <= value <= rows[name].ci95[1]]
    assert len(true) >= 20
    assert len(missed) <= 2, {name: (true[name], rows[name].ci95) for name in missed}
    # and are no wider than what was known without the data where the data speak
    told = [row for row in rows.values() if row.knowledge == "measured"]
    assert {"trigger_offset", "port_closing_lift"} <= {row.name for row in told}
    assert all(row.stderr <= 1.3 * (row.prior[1] if row.prior else np.inf) for row in told)


def test_trigger_cam_angle_and_chamber_are_the_rigs(case, record):
    run = rig(*case)
    cycles = as_cycles(run, N)
    angle = cycles["true_angle"].mean(axis=0)
    assert abs(record.trigger_angle.value - run.truth.trigger.nominal_angle - run.truth.trigger.angle_offset) < (
        np.radians(0.12)
    )
    assert np.degrees(np.sqrt(np.mean((record.true_angle - angle) ** 2))) < 0.12
    chamber = run.true_cycles("chamber_pressure", 3600).mean(axis=0)
    true = np.interp(record.true_angle, np.arange(3600) * 2 * np.pi / 3600, chamber, period=2 * np.pi)
    error, peak = record.chamber_pressure - true, true.max()
    assert np.sqrt(np.mean(error**2)) < 0.008 * peak
    loaded = true > 0.3 * peak
    assert np.mean(np.abs(error[loaded]) < 2.0 * record.chamber_pressure_std[loaded]) > 0.85
    assert np.median(record.chamber_pressure_std[loaded]) < 0.03 * peak
    assert np.all(record.chamber_pressure_std >= ripple(record.chamber_pressure))  # whose phase no torque tells


def test_model_meets_the_cycles_that_were_not_fitted(record):
    assert record.explained
    assert record.metrics["fitted_held_out_cycles"].rms_percent_of_peak < 0.12
    assert record.metrics["fitted"].rms_percent_of_peak < 0.1
    assert record.metrics["rigid"].rms_percent_of_peak > 20.0 * record.metrics["fitted"].rms_percent_of_peak
    assert abs(record.losses["closure_percent"]) < 1.0


def test_the_work_put_in_is_known_as_well_as_it_says(case, record):
    """It stood without an uncertainty beside causes that have theirs: an unread zero alone is worth some percent."""
    work, std = record.losses["input"], record.losses_stderr["input"]
    true = float(np.mean(np.diff(rig(*case).totals["shaft_work"])))
    assert abs(work - true) < 2.0 * std
    assert 0.0005 * work < std < 0.03 * work
    zero = next(row for row in record.parameters if row.name == "torque_zero")
    assert std > 2.0 * np.pi * 0.3 * zero.stderr


def test_causes_sum_to_the_model_of_the_measured_torque(record):
    np.testing.assert_allclose(np.sum(list(record.by_cause.values()), axis=0), record.torque, atol=1e-9)
    # and the model is not the sum by definition alone: it meets what was measured
    assert record.metrics["fitted"].rms_nm < 0.1


def test_a_bridge_that_feels_bending():
    # the rig's bridge feels the load along the follower alone: its arms are no more than near those of the law
    case = ("turning_bridge", 0, 1000.0)
    sensor = rig(*case).truth.torque_sensor
    prepared = quick_prepared(*case)
    fit = fit_prepared(prepared, weighed=False)
    found = dict(zip(fit.problem.names, zip(fit.solution.z, fit.std, strict=True), strict=True))
    steady = sensor.turning_torque * np.array([np.cos(sensor.turning_phase), np.sin(sensor.turning_phase)])
    for name, true in zip(("turning_cosine", "turning_sine"), steady, strict=True):
        value, std = found[name]
        assert abs(value - true) < 2.0 * std, name
    value, std = found["trigger_offset"]
    assert abs(value - rig(*case).truth.trigger.angle_offset) < 2.0 * std
    without = at_minimum(with_rows(prepared.candidates[0].data, {
        name: {"start": 0.0, "prior": (0.0, 1e-9 * ROWS[name].step)} for name in bridge.LAW.linear}))  # fmt: skip
    assert without.solution.data_chi_square > fit.solution.data_chi_square + 50.0


@pytest.mark.parametrize("n_theta", [7200])
def test_intervals_do_not_depend_on_the_grid_of_the_cycles(n_theta):
    # the same minimum on both: which one a walk from the truth ends in hangs on the last digit
    first = quick(LAND)
    there = dict(zip(first.problem.names, first.solution.z.tolist(), strict=True))
    found = [first, followed(quick_data(LAND, n_theta), replace(start_of(first), data=with_starts(
        start_of(first).data, there)))]  # fmt: skip
    stds = [covariance(item.problem, item.solution).std for item in found]
    names = [parameter.name for parameter in found[0].problem.parameters]
    assert names == [parameter.name for parameter in found[1].problem.parameters]
    before = prior_std(found[0].problem)
    told = stds[0] < 0.8 * before
    assert told.sum() >= 8
    # end of delivery and valve sit on kinks of the model, whose slopes depend on which grid point they meet
    kinked = {"end_of_delivery", *(row.name for row in valve.ROWS)}
    clear = told & np.array([name not in kinked for name in names])
    # and what hardly acts sits beside its bound, where the slope by its neighbours comes and goes with it
    clear &= found[0].solution.z - found[0].problem.bounds[0] > stds[0]
    ratio = stds[1][clear] / stds[0][clear]
    off = np.abs(ratio - 1.0)
    # four in five within 10 %; a coupling that hardly yields leaves one of them at 18 %
    assert np.quantile(off, 0.8) < 0.1, dict(zip(np.array(names)[clear], ratio, strict=True))
    assert np.max(off) < 0.25
    moved = np.abs(found[1].solution.z - found[0].solution.z)[told] / stds[0][told]
    assert np.max(moved) < 0.7


def start_of(found):
    """Return a minimum as a start."""
    return Start(found.data, found.solution.lift, found.value)


def test_a_small_residual_narrows_the_intervals_as_far_as_it_tells():
    found = quick(LAND)
    none = replace(found.solution, data_chi_square=0.0)
    careful = covariance(found.problem, none)
    assert careful.inflation == 1.0

    def scale_of(chi_square: float, freedom: float) -> float:
        return narrowed(replace(careful, freedom=freedom), replace(none, data_chi_square=chi_square)).inflation

    assert scale_of(30.0, 30.0) == 1.0
    assert scale_of(0.0, 30.0) == pytest.approx(0.25), "40 values, of which 30 have no scatter"
    assert scale_of(0.0, 3.0) > 0.7, "few values may be small by luck"
    assert 1.0 > scale_of(20.0, 30.0) > 20.0 / 30.0 > scale_of(10.0, 30.0) > 10.0 / 30.0
    close = narrowed(careful, none)
    assert np.all(close.std <= careful.std * (1.0 + 1e-9))
    told = careful.std < 0.02 * careful.prior_std
    assert np.min(close.std[told] / careful.std[told]) < 0.8
    worse = replace(found.solution, data_chi_square=9.0 * careful.freedom)
    wide = covariance(found.problem, worse)
    assert narrowed(wide, worse) is wide


def test_misfit_widens_the_intervals():
    found = quick(LAND)
    plain = covariance(found.problem, found.solution)
    worse = replace(found.solution, data_chi_square=9.0 * plain.freedom)
    wide = covariance(found.problem, worse)
    assert plain.inflation == pytest.approx(max(1.0, found.solution.data_chi_square / plain.freedom))
    assert wide.inflation == pytest.approx(9.0)
    told = plain.std < 0.02 * plain.prior_std
    assert told.any()
    assert np.max(wide.std[told] / plain.std[told]) > 1.6
    assert np.all(wide.std >= plain.std * (1.0 - 1e-9))
    assert np.all(wide.std <= plain.prior_std * (1.0 + 1e-9))
    assert pytest.approx(1.959964) == COVERAGE


def test_fitted_cycles_enter_the_fit_and_held_out_ones_the_score():
    recording, cycles, _ = bridged(LAND)
    law = spectral_law(recording.cam_table)

    def seen(torque):
        means = mean_cycles(replace(cycles, torque=torque))
        return means, fit_data(recording, cycles, law, means)

    means, data = seen(cycles.torque)
    moved = cycles.torque.copy()
    moved[cycles.held_out] += 3.0
    other, same = seen(moved)
    np.testing.assert_array_equal(same.torque, data.torque)
    np.testing.assert_array_equal(same.chain.shaft_torque, data.chain.shaft_torque)
    np.testing.assert_allclose(other.held_torque, means.held_torque + 3.0)
    moved = cycles.torque.copy()
    moved[~cycles.held_out] += 3.0
    other, shifted = seen(moved)
    np.testing.assert_allclose(shifted.torque, data.torque + 3.0)
    np.testing.assert_array_equal(other.held_torque, means.held_torque)


def test_a_recording_that_stays_unexplained_says_where():
    prepared = quick_prepared(*LAND)
    cycles, item = prepared.cycles, prepared.candidates[0].data
    bump = 1.5 * np.exp(-(((cycles.theta - 4.0) / 0.05) ** 2))  # on the base circle, where no law acts
    disturbed = replace(cycles, torque=cycles.torque + bump)
    means = mean_cycles(disturbed)
    torque = np.asarray(means.torque.reshape(600, -1).mean(axis=1))
    data = replace(item, torque=torque)
    start = continued(data, 0.0, core=False, iterations=6)
    found = replace(quick(LAND), data=data, problem=replace(quick(LAND).problem, data=(data,)))
    assert start is not None
    fit = fit_prepared(replace(prepared, cycles=disturbed, means=means, candidates=(found,)), weighed=False)
    record = fitted_torque(fit, prepared.recording, disturbed, prepared.rigid, means)
    assert not record.explained
    finding = next(row for row in record.findings if row.code == "unexplained")
    assert finding.severity == "error"
    assert "do not rely on" in finding.text
    largest = record.bumps[0]
    assert largest.start < 4.0 < largest.stop
    assert largest.peak == pytest.approx(1.5, abs=0.4)
    assert largest.phase == "base circle"


def test_a_shaft_that_rings_between_the_bins_is_told():
    """At 150 rpm its ringing was the fit's own, and the recording unexplained (decision 0185)."""
    found = quick(("stiff_shaft",))
    values, _ = found.problem.values(found.solution.z, 0)
    ring = values["shaft_resonance"]

    def turning(order, bins=BINS):
        chain = replace(coarse(found.data).chain, speed=ring / order)
        chain = chain if bins == BINS else replace(chain, theta=angle_grid(bins), bins=bins)
        return replace(found, data=replace(found.data, chain=chain))

    assert not turning(0.79 * BINS / 2).rings_between_bins
    assert turning(0.81 * BINS / 2).rings_between_bins
    assert not turning(0.81 * BINS / 2, FINER_BINS).rings_between_bins


def test_what_counts_as_explained():
    residual = np.full(100, 0.2)
    assert is_explained(residual, 0.1, 50.0)  # twice what the cycles repeat
    assert not is_explained(residual, 0.05, 50.0)
    assert is_explained(residual, 0.05, 200.0)  # a thousandth of the peak


@pytest.mark.slow
def test_search_finds_the_structure_and_the_truth_from_nothing():
    data = replace(quick_data(SPILL), structure="land", rows=unknown_rows(SPILL))
    rough = coarse(data)
    tried = {"spill": first_starts(rough, "spill")[1::2], "land": first_starts(rough, "land")[1::3]}
    found = descend(tried, SMOOTHINGS_DEG, True)
    best = min((group[0] for group in found.values() if group), key=lambda start: start.chi_square)
    assert best.data.structure == "spill"
    near = quick(SPILL)
    ended = followed(data, best)
    assert ended.value < near.value + 6.0
    trigger = ended.problem.index("trigger_offset")
    assert ended.solution.z[trigger] == pytest.approx(rig(*SPILL).truth.trigger.angle_offset, abs=np.radians(0.12))
    assert all(start.chi_square > 10.0 * best.chi_square for start in found.get("land", []))


def test_weights_of_the_search_are_as_large_as_the_residual():
    data = with_starts(quick_data(LAND), {"dead_volume": 2.0e-6, "shaft_compliance": 400.0e-6})
    problem = build_problem([data])
    lift = lift_at(problem, problem.start)
    far = try_at(problem, problem.start, lift)
    assert far.data_chi_square > 100.0 * INDEPENDENT
    weighed = reweighted(problem, far)
    again = try_at(weighed, far.z, lift)  # the linear parameters give way to their priors a little
    assert INDEPENDENT <= again.data_chi_square < 1.5 * INDEPENDENT
    near = quick(LAND)
    trial = try_at(near.problem, near.solution.z, near.solution.lift)
    assert reweighted(near.problem, trial).data[0].weight == pytest.approx(near.data.weight)


def test_the_load_is_begun_anew_on_the_shaft_that_was_found():
    data = with_starts(quick_data(LAND), {"coupling_resonance": 365.0, "dead_volume": 2.0e-6})
    start = Start(coarse(data), no_lift(), 1.0)
    found = SearchState({"land": [start], "spill": [], "line": []}, ((start, replace(quick(LAND), data=data)),))
    begun = load_anew(found, coarse(quick_data(LAND)))
    assert set(begun) == {"land", "spill"}
    assert {item.rows["coupling_resonance"].start for group in begun.values() for item in group} == {365.0}
    assert all(item.rows["dead_volume"].start != 2.0e-6 for group in begun.values() for item in group)


def unknown_rows(case):
    """Return the rows of a rig with the starts that sheets and certificates give."""
    recording, cycles, _ = bridged(case)
    means = mean_cycles(cycles)
    law = spectral_law(recording.cam_table)
    return fit_data(recording, cycles, law, means).rows


def test_smoothing_leads_an_end_of_delivery_that_is_ten_degrees_off():
    data = quick_data(LAND)
    true = data.rows["end_of_delivery"].start
    rows = dict(data.rows)
    rows["end_of_delivery"] = replace(rows["end_of_delivery"], start=true + np.radians(10.0))
    start = continued(replace(data, rows=rows), 14.0, core=True)
    assert start is not None
    start = continued(start.data, 7.0, core=False)
    assert start is not None
    assert abs(start.data.rows["end_of_delivery"].start - true) < np.radians(3.0)
    angles, lifts = rising_angles(data, (0.5, 0.9))
    assert np.all(np.diff(angles) > 0.0)
    np.testing.assert_allclose(data.chain.law.evaluate(angles, 0), lifts, rtol=1e-3)


def test_the_delivered_volume_is_that_of_the_rig(case):
    fit = fit_prepared(quick_prepared(*case), weighed=False)
    found = delivered_volume(fit)
    past_valve = rig(*case).totals["valve_mass"]
    true = (past_valve[-1] - past_valve[0]) / (past_valve.size - 1) / rig(*case).truth.fluid.density
    assert abs(found.value - true) < 2.0 * found.stderr
    # one recording hardly tells it; how far a variant's valve moves it is the search's, and differs between machines
    assert found.stderr_statistical < 1.5 * true

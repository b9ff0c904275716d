"""What a fit hands on: budget, knowledge, bumps, proposals, findings, refusals."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from camtorque.fit import derived as derived_room
from camtorque.fit import minima, proposals
from camtorque.fit import result as result_room
from camtorque.fit.derived import carried, derived_estimates, model_of, modelled, on_cycles, sureness, work_at
from camtorque.fit.descent import free_at
from camtorque.fit.findings import (
    fit_findings,
    frictionless_findings,
    implausible_findings,
    largest_chi_square,
    light_cam_findings,
    mounting_findings,
    prior_findings,
    spill_findings,
    stress_findings,
)
from camtorque.fit.kinds import structure_spread
from camtorque.fit.minima import LIGHT, Halves
from camtorque.fit.pair import pair_of
from camtorque.fit.planning import TOOTH, Measuring, tooth_shifts
from camtorque.fit.prepare import INDEPENDENT, bin_weights, mean_cycles, on_grid
from camtorque.fit.problem import with_starts
from camtorque.fit.proposals import at_other_speeds, next_measurement, with_tooth
from camtorque.fit.residual import BUMP_WINDOW_DEG, least_place_std, parts_of_gap, phase_at, residual_bumps, ringing
from camtorque.fit.result import (
    alternatives,
    fitted_torque,
    parameter_estimates,
    return_start,
)
from camtorque.fit.search import SearchState
from camtorque.fit.single import SWITCHING, every_structure, fit_prepared, pressure_gain_std
from camtorque.fit.solver import no_lift
from camtorque.fit.starts import Start, coarse
from camtorque.fit.uncertainty import confidence, covariance, knowledge, uncertainty_budget
from camtorque.laws.chain import binned
from camtorque.laws.driveline import cam_side_inertia
from camtorque.mechanism.sections import dwell, flank, section_law
from camtorque.records import Refusal
from camtorque.units import DEGREE
from fit_cases import bridged, quick, quick_data, quick_prepared
from scipy.stats import chi2

LAND = ("closed_volume", 0, 1000.0)


@pytest.fixture(scope="module")
def fit():
    return fit_prepared(quick_prepared(*LAND), weighed=False)


def test_budget_splits_the_whole_variance(fit):
    spreads = {"other law": np.full(fit.problem.size, 1e-9)}
    rows = uncertainty_budget(fit.problem, fit.covariance, fit.deviation, spreads)
    for row, std in zip(rows, np.sqrt(np.diag(fit.deviation)), strict=True):
        assert row.total**2 == pytest.approx(sum(part**2 for part in row.contributions.values()), rel=1e-6)
        assert row.total**2 == pytest.approx(std**2 + 1e-18, rel=2e-2)


@pytest.mark.parametrize("turned", [0.0, 2.0, 4.0])  # the return may go through the seam
@pytest.mark.parametrize("n_theta", [600, 601, 20000])
def test_where_the_return_starts_does_not_hang_on_the_grid(n_theta: int, turned: float) -> None:
    theta = np.arange(n_theta) * 2.0 * np.pi / n_theta
    output = SimpleNamespace(
        pressure=1e8 + 2e7 * np.cos(theta - turned),
        motion=SimpleNamespace(lift=[4e-3 * (1.0 + np.cos(theta - turned))]),
    )
    fitted = SimpleNamespace(output=output, chamber_pressure=output.pressure)
    found = return_start(fitted, np.array([np.full(n_theta, 1e5), np.full(n_theta, 6e4)]))  # type: ignore[arg-type]
    assert found is not None
    assert found.value == pytest.approx(1e8 + 2e7 * 0.9, rel=1e-5)  # cos is 0.9 at 95 % of the lift
    assert found.stderr == pytest.approx(1e5)
    assert found.stderr_statistical == pytest.approx(6e4)


def test_work_and_torque_by_cause_scatter_as_stated(fit):
    """Draws of all parameters, so narrow that all is straight over them, against the carried covariance."""
    narrow = replace(fit, deviation=1e-4 * fit.deviation, shifts={})
    case = quick_prepared(*LAND)
    forward, fall, lowest = parts_of_gap(case.rigid, case.means.torque_all)
    stated_work, stated_gap = sureness(narrow, case.rigid, case.means.torque_all, 0.0)
    rng = np.random.default_rng(3)
    std = np.sqrt(np.diag(narrow.deviation))
    root = np.linalg.cholesky(narrow.deviation / np.outer(std, std) + 1e-10 * np.eye(std.size))
    draws = fit.solution.z + rng.standard_normal((200, std.size)) @ root.T * std
    lifts = np.zeros(fit.solution.lift.coefficients(fit.solution.residual).size)
    means = (case.means.torque, case.means.pressure)
    n = case.means.torque.size
    models = [on_cycles(modelled(fit.problem, z, 0, lifts, fit.measured, means), n) for z in draws]
    curves_at_best = model_of(fit, *means).by_cause
    works = [work_at(fit.problem.data[0].chain, *fit.problem.values(z, 0)) for z in draws]
    for name in ("pressure", "friction", "damping", "driveline", "friction_and_damping"):
        assert np.std([work[name] for work in works]) == pytest.approx(stated_work[name], rel=0.2), name
    for name in ("bearing_friction", "guide_friction", "plunger_viscous", "torque_zero"):
        curves = np.array([model.by_cause[name] for model in models])
        found = [
            np.std(curves[:, forward].mean(axis=1)),
            np.std(curves[:, fall].mean(axis=1)),
            np.std(curves[:, lowest]),
        ]
        np.testing.assert_allclose(found, stated_gap[name], rtol=0.2, err_msg=name)
    # noise that moves the place of the minimum moves a cause by its slope there
    cause, place_std = "spring", 0.01
    placed = sureness(narrow, case.rigid, case.means.torque_all, place_std)[1]
    curve = curves_at_best[cause]
    slope = (curve[lowest + 3] - curve[lowest - 3]) / (6.0 * 2.0 * np.pi / n)
    assert placed[cause][2] == pytest.approx(np.hypot(stated_gap[cause][2], place_std * slope), rel=0.05)
    np.testing.assert_array_equal(placed[cause][:2], stated_gap[cause][:2])
    moved = replace(narrow, shifts={"other law": 1e4 * std[None]})
    assert sureness(moved, case.rigid, case.means.torque_all, 0.0)[0]["pressure"] > 10.0 * stated_work["pressure"]


@pytest.mark.parametrize(("noise", "width_deg"), [(0.005, 3.0), (0.02, 3.0), (0.05, 0.0)])
def test_the_place_of_a_minimum_scatters_as_stated(noise: float, width_deg: float) -> None:
    """Torques of a flat minimum under noise, white or over some degrees, drawn 400 times, by what their halves tell."""
    n, rng = 1800, np.random.default_rng(8)
    theta = np.arange(n) * 2.0 * np.pi / n
    lift = 1.0 + np.cos(theta - 0.5 * np.pi)
    rigid = SimpleNamespace(torque=1.0 + lift, lift=lift, lift_velocity=-np.sin(theta - 0.5 * np.pi))
    spectrum = np.exp(-0.5 * (np.fft.rfftfreq(n, 1.0 / n) * np.radians(width_deg)) ** 2)

    def half() -> np.ndarray:
        drawn = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * spectrum, n)
        return 10.0 * np.cos(theta) + noise * drawn / np.std(drawn)

    places, stated = [], []
    for _ in range(400):
        one, other = half(), half()
        both = 0.5 * (one + other)
        lowest = parts_of_gap(rigid, both)[2]  # type: ignore[arg-type]
        places.append(theta[lowest])
        stated.append(least_place_std(SimpleNamespace(torque=one, held_torque=other, torque_all=both), lowest))  # type: ignore[arg-type]
    assert np.mean(places) == pytest.approx(np.pi, abs=3.0 * np.std(places) / 20.0)
    assert np.std(places) == pytest.approx(np.sqrt(np.mean(np.square(stated))), rel=0.25)


def test_a_prior_alone_leaves_the_prior(fit):
    names = fit.problem.names
    for name in ("drive_lag",):
        k = names.index(name)
        assert fit.covariance.std[k] == pytest.approx(fit.covariance.prior_std[k], rel=0.05)


@pytest.mark.parametrize(
    ("ratio", "least", "lower", "word"),
    [(0.1, 0.3, 0.0, "measured"), (0.1, 0.0, 0.0, "upper limit"), (0.1, -0.1, -0.3, "measured"),
     (0.1, 0.02, 0.02, "upper limit"), (0.1, -0.3, -0.3, "measured"), (0.5, 0.0, 0.0, "narrowed"),
     (0.95, 0.0, 0.0, "from the sheet")],
)  # fmt: skip
def test_words_for_what_the_data_added(ratio, least, lower, word):
    assert knowledge(ratio, 1.0, least, lower) == word


def test_what_no_sheet_has_and_the_data_do_not_narrow_is_not_told():
    assert knowledge(0.95, 1.0, 0.0, 0.0, has_prior=False) == "not told by the data"
    assert knowledge(0.1, 1.0, 0.3, 0.0, has_prior=False) == "measured"


def test_intervals_stop_at_bounds():
    assert confidence(1.0, 1.0, 0.0, 10.0) == pytest.approx((0.0, 2.959964))
    assert confidence(0.0, 1.0, 0.0, 10.0) == pytest.approx((0.0, 1.959964))
    assert confidence(-0.3, 1.0, -0.3, 10.0)[0] == -0.3
    assert confidence(4.0, 1.0, 4.0, 10.0)[0] == pytest.approx(2.040036), "a bound of the search is no limit"
    assert confidence(4.0, 9.0, 4.0, 10.0)[0] == 0.0


def test_bounds_narrow_what_is_stated_and_tell_nothing(fit):
    k = int(np.argmin(fit.std / fit.unbounded_std))
    assert fit.std[k] < 0.7 * fit.unbounded_std[k]
    rows = {row.name: row for row in parameter_estimates(fit)}
    parameter = fit.problem.parameters[k]
    row = rows[parameter.name]
    assert row.stderr == pytest.approx(fit.std[k] / parameter.row.per_unit)
    told = fit.unbounded_std[k]
    assert row.knowledge == knowledge(told, fit.covariance.prior_std[k], row.ci95[0], parameter.row.lower)


def test_structures_that_exchange_two_losses_leave_their_sum_sure():
    def minimum(z, pressure):
        motion = SimpleNamespace(theta=np.array([0.0, 2.0, 4.0]))
        return SimpleNamespace(
            problem=SimpleNamespace(names=("friction", "damping")),
            data=SimpleNamespace(chain=SimpleNamespace(theta=np.zeros(3))),
            solution=SimpleNamespace(z=np.array(z), output=SimpleNamespace(pressure=np.array(pressure), motion=motion)),
        )  # fmt: skip

    found = (minimum([4.0, 2.0], [5.0] * 3), minimum([1.0, 5.0], [6.0, 5.0, 5.0]), minimum([9.0, 9.0], [0.0] * 3))
    shifts, pressures = structure_spread(found, (0.75, 0.25, 0.0))
    np.testing.assert_allclose(np.sqrt(np.sum(shifts**2, axis=0)), [1.5, 1.5])
    np.testing.assert_allclose(shifts @ [1.0, 1.0], 0.0)
    np.testing.assert_allclose(np.sqrt(np.sum(pressures**2, axis=0)), [0.5, 0.0, 0.0])
    (alone,), (still,) = structure_spread(found[:1], (1.0,))
    assert not alone.any()
    assert not still.any()


def test_variants_only_widen(fit):
    assert np.all(fit.std >= np.sqrt(np.diag(fit.deviation)))
    assert "what the delivery valve does as it opens" in fit.shifts
    assert any(np.any(shift) for shift in fit.shifts.values())


BENCH = Measuring(0.2, {"torque_zero": 0.1, "pressure_zero": 0.5e5})


def test_a_second_tooth_and_another_speed_narrow(fit):
    names, trigger = fit.problem.names, fit.problem.names.index("trigger_offset")
    tooth = with_tooth(fit)
    assert np.all(tooth <= fit.std * (1.0 + 1e-6))
    assert tooth[trigger] < 0.9 * fit.std[trigger]
    (slow, after), _ = at_other_speeds(fit, BENCH, 4.0)
    assert slow == f"the same load at {0.6 * fit.problem.data[0].chain.speed * 30.0 / np.pi:.0f} rpm, fitted jointly,"
    for name in ("trigger_offset", "shaft_compliance", "dead_volume"):
        assert after[names.index(name)] < fit.std[names.index(name)], name


def test_a_second_tooth_tells_structures_apart_that_disagree_on_the_twist(fit):
    """What other structures leave open of the trigger was held fixed: 67 % were promised, 34 % came."""
    at, size = fit.problem.names.index("trigger_offset"), 10.0 * fit.std
    turned = tooth_shifts(fit.problem.data[0].chain, fit.solution.output)
    differs = [turned.get(name, 0.0) != 0.0 for name in fit.problem.names]
    seen, unseen = (np.where(where, size, 0.0) for where in (differs, np.zeros(size.size, dtype=bool)))
    for shift in (seen, unseen):
        shift[at] = size[at]
    after = [with_tooth(replace(fit, shifts={"other structures": one[None]}))[at] for one in (seen, unseen)]
    assert after[0] < 0.5 * after[1], "a tooth sees no trigger that is off, but what twists more or less"
    assert after[1] > 0.9 * np.hypot(size[at], 0.8 * fit.std[at])


def test_another_speed_counts_no_spread_that_a_joint_fit_does_not_state(fit):
    size = 100.0 * fit.std[None]
    plain, other, switching = (
        at_other_speeds(replace(fit, shifts=shifts), BENCH, 4.0)[0][1]
        for shifts in ({}, {"other structures": size}, {SWITCHING: size})
    )
    assert other == pytest.approx(plain)
    assert switching == pytest.approx(np.hypot(plain, size[0]))


def test_the_same_run_again_tells_nothing_beyond_its_noise(fit, monkeypatch):
    """The error of laws and lift table is the same in both: another one of its own would leave 0.71."""
    monkeypatch.setattr(proposals, "SPEED_FACTORS", (1.0, 0.6))
    monkeypatch.setattr(proposals, "LASTS", 4.0)
    (_, again), (_, slower) = at_other_speeds(fit, replace(BENCH, scatter=1e-4), 4.0)
    shaft = fit.problem.names.index("shaft_compliance")
    assert again[shaft] > 0.78 * np.sqrt(fit.deviation[shaft, shaft])
    assert slower[shaft] < again[shaft]


def test_a_second_tooth_is_not_proposed_beside_a_wheel_or_a_recorded_angle(fit, monkeypatch):
    monkeypatch.setattr(proposals, "WORTH", 0.9)
    plain = next_measurement(fit, BENCH, 4.0)
    assert any(text.startswith(TOOTH) for text in plain)
    beside = next_measurement(fit, BENCH, 4.0, has_teeth=True)
    assert beside == tuple(text for text in plain if not text.startswith(TOOTH))


def test_a_speed_at_which_the_torque_runs_away_is_not_proposed(fit, monkeypatch):
    def running_away(*given):
        raise Refusal("no finite torque")

    monkeypatch.setattr(proposals, "operating_point", running_away)
    assert at_other_speeds(fit, BENCH, 4.0) == []
    assert all(text.startswith(TOOTH) for text in next_measurement(fit, BENCH, 4.0))


def test_each_recording_of_a_pair_is_turned_by_its_own_tooth():
    before = quick_prepared(*LAND)
    config = before.recording.config
    elsewhere = replace(config.trigger, nominal_angle=config.trigger.nominal_angle + 0.5)
    after = replace(before, recording=replace(before.recording, config=replace(config, trigger=elsewhere)))
    angles = [item.chain.trigger_angle for item in pair_of(before, after, before.candidates[0]).items]
    assert angles == [config.trigger.nominal_angle, elsewhere.nominal_angle]


@pytest.fixture(scope="module")
def record(fit):
    prepared = quick_prepared(*LAND)
    return fitted_torque(fit, prepared.recording, prepared.cycles, prepared.rigid, prepared.means)


@pytest.mark.parametrize(("base_pressure", "lost"), [(0.0, False), (-1.0e5, True)])
def test_a_follower_that_rests_on_its_cam_without_a_force_has_not_left_it(fit, monkeypatch, base_pressure, lost):
    rise, fall = flank("polynomial_4567", 60.0 * DEGREE, 8e-3), flank("polynomial_4567", 55.0 * DEGREE, -8e-3)
    law = section_law([rise, dwell(20.0 * DEGREE), fall, dwell(225.0 * DEGREE)])

    def unloaded(fit, torque, pressure):
        model = model_of(fit, torque, pressure)
        theta = model.output.motion.theta
        pushed = np.where(law.evaluate(theta, 0) > 0.0, 2e7, base_pressure)
        output = replace(model.output, pressure=pushed)
        return replace(model, output=output, plunger_force=np.zeros(theta.size))

    monkeypatch.setattr(result_room, "model_of", unloaded)
    monkeypatch.setattr(result_room, "lift_law", lambda table: law)
    prepared = quick_prepared(*LAND)
    config = prepared.recording.config
    config = replace(config, pump_sheet=replace(config.pump, spring_preload=0.0))
    recording = replace(prepared.recording, config=config)
    record = fitted_torque(fit, recording, prepared.cycles, prepared.rigid, prepared.means)
    assert np.min(record.forces.contact_normal) == 0.0
    assert record.contact_lost is lost
    assert [found.code for found in record.findings].count("contact_lost") == lost


def test_losses_close_to_no_percent_of_no_input(fit, monkeypatch):
    prepared = quick_prepared(*LAND)
    fitted = model_of(fit, prepared.means.torque, prepared.means.pressure)
    monkeypatch.setattr(derived_room, "drive_work", lambda chain, values: 0.0)
    through = result_room._losses(fit, fitted)["input"]
    monkeypatch.setattr(derived_room, "drive_work", lambda chain, values: -through)
    losses = result_room._losses(fit, fitted)
    assert losses["input"] == 0.0
    assert np.isnan(losses["closure_percent"])


def test_what_else_fits_is_measured_beside_the_lift_correction(fit):
    (best, *rest), lift = fit.candidates, fit.candidates[0].solution.lift
    strongest = int(np.argmax(lift.strength))
    asked = best.solution.residual + 20.0 * lift.vectors[:, strongest]
    off = replace(best, solution=replace(best.solution, residual=asked))
    (before, *_), (after, *_) = (alternatives(replace(fit, candidates=(item, *rest)), 0.0) for item in (best, off))
    assert 20.0 * (1.0 - lift.shrink[strongest]) < 3.0
    assert after.rms_nm == pytest.approx(before.rms_nm, rel=0.3)


def test_a_search_that_ended_early_is_told_where_values_may_still_move(fit):
    against = np.where(fit.solution.z <= fit.problem.bounds[0], -1.0, 1.0)  # what lies at a bound pushes against it
    free = np.flatnonzero(free_at(fit.solution.z, against, *fit.problem.bounds))
    place = int(np.flatnonzero(free == fit.problem.index("trigger_offset"))[0])
    matrix = fit.solution.hessian[np.ix_(free, free)]
    along = np.linalg.inv(matrix)[place]

    def told(moved):
        step = moved * np.sqrt(fit.covariance.inflation / along[place]) * along  # of the trigger by so many of its std
        gradient = against.copy()
        gradient[free] = matrix @ step
        early = replace(fit, solution=replace(fit.solution, converged=False, gradient=gradient))
        return [
            item.text
            for item in fit_findings(early, 1.0, np.zeros(8, dtype=bool), None)
            if item.code == "not_converged"
        ]

    assert told(0.4) == []
    (text,) = told(2.0)
    assert "by up to 2.0 of their standard uncertainty" in text


def test_nuisances_pulled_off_their_sheet_are_told(record):
    assert prior_findings(record.parameters) == tuple(f for f in record.findings if f.code == "prior_pulled")
    row = next(row for row in record.parameters if row.name == "cutoff")
    pulled = replace(row, value=row.prior[0] + 4.0 * row.prior[1], at_bound=False)
    (finding,) = prior_findings([pulled])
    # a gain that its bound stops at three standard deviations is no better than one that lies there freely
    (held,) = prior_findings([replace(pulled, at_bound=True)])
    assert "at its bound" in held.text
    assert "4.0 standard deviations off" in finding.text
    assert finding.where == "cutoff"


@pytest.mark.parametrize(("name", "pull", "told"), [("shaft_drag", 5.0, True), ("shaft_viscous", 5.0, True),
                                                     ("cutoff", 5.0, False)])  # fmt: skip
def test_a_drag_far_off_may_be_a_zero_that_nobody_read(record, name, pull, told):
    """A torque channel 7.5 N m off its zero was told as a drag and as a law that is missing, never as a zero."""
    row = next(row for row in record.parameters if row.name == name)
    (finding,) = prior_findings([replace(row, value=row.prior[0] + pull * row.prior[1], at_bound=False)])
    assert ("or for a torque zero that is off: note the reading at standstill" in finding.text) == told


def test_a_pulled_logarithm_is_told_as_the_value_that_it_is_of(record):
    rows = {row.name: row for row in record.parameters}
    for name, value, text in (
        (
            "drive_lag",
            -2.9,
            "drive lag is 0.055 s, 2.8 standard deviations off what was expected (0.0015 times or over",
        ),
        ("half_damping", -3.4, "half damping is 0.0334, 3.9 standard deviations off what was expected (1.65 times or"),
    ):
        row = rows[name]
        (finding,) = prior_findings([replace(row, value=value, at_bound=False)])
        assert finding.text.startswith(text), finding.text


@pytest.mark.parametrize(("pull", "stderr", "told"), [(2.4, 0.1, True), (1.8, 0.1, False), (2.4, 0.5, False),
                                                       (-2.4, 0.1, True)])  # fmt: skip
def test_a_trigger_beyond_its_mounting_tolerance_is_told(record, pull, stderr, told):
    row = next(row for row in record.parameters if row.name == "trigger_offset")
    mean, std = row.prior
    moved = replace(row, value=mean + pull * std, stderr=stderr * std)
    assert prior_findings([moved]) == ()
    texts = [finding.text for finding in mounting_findings([moved])]
    assert [f"beyond its mounting tolerance of +-{1.7320508 * std:.3g} deg" in text for text in texts] == [True] * told
    far = replace(moved, value=4.0 * std)
    assert len(mounting_findings([far])) == 1
    assert prior_findings([far]) == ()


def test_values_that_are_unusual_together_are_told(record):
    assert implausible_findings(record.parameters, True) == ()
    rows = [row for row in record.parameters if row.prior is not None]
    off = [replace(row, value=row.prior[0] + 1.2 * row.prior[1], stderr=0.5 * row.prior[1], at_bound=False)
           for row in rows]  # fmt: skip
    # 1.2 deviations each is usual for one and unusual for all of them: chi-square 1.92 for each degree of freedom
    assert implausible_findings(off[:3], True) == ()
    (finding,) = implausible_findings(off, True)
    assert finding.severity == "warning"
    assert "one bench in a thousand (chiefly" in finding.text
    # what the data do not tell stays where it is expected: it is no evidence of a sound bench
    silent = [replace(row, name=f"{row.name}_2", value=row.prior[0], stderr=row.prior[1]) for row in off]
    assert implausible_findings([*off, *silent], True) == implausible_findings(off, True)
    assert implausible_findings([replace(row, at_bound=True) for row in off], True) == ()


@pytest.mark.parametrize(("relative", "known"), [(0.2, "measured"), (0.5, "narrowed"), (1.0, "not told by the data")])
def test_what_follows_from_the_shaft_is_known_no_better_than_its_error_says(fit, relative, known):
    alone = replace(fit, shifts={})
    now = derived_estimates(alone)[0]
    wider = (relative * now.value / now.stderr) ** 2
    row = derived_estimates(replace(alone, deviation=wider * fit.deviation))[0]
    assert row.stderr == pytest.approx(relative * row.value)
    assert (row.knowledge, row.identifiable) == (known, relative < 1.0)


@pytest.mark.parametrize(
    ("moved", "told"),
    [({}, True), ({"guide_friction": (0.03, (0.0, 0.05))}, False), ({"pin_arm": (0.0, (0.0, 2.0))}, False)],
)
def test_a_pump_in_which_nothing_rubs_under_load_is_told(record, moved, told):
    """A pressure that reads too much leaves no room for friction: all of it ends at zero, and surely so."""
    nothing = dict.fromkeys(("bearing_arm", "pin_arm", "guide_friction"), (0.0, (0.0, 0.3))) | moved
    rows = []
    for row in record.parameters:
        value, ci95 = nothing.get(row.name, (None, None))
        expected = row.prior[0] if row.prior else np.nan
        rows.append(row if ci95 is None else replace(row, value=value, ci95=tuple(expected * end for end in ci95)))
    found = frictionless_findings(rows)
    assert bool(found) == told
    if told:
        assert found[0].code == "no_load_friction"
        assert "the line pressure reads too high or the torque too low" in found[0].text
    assert frictionless_findings([row for row in rows if row.name != "pin_arm"]) == ()
    assert all(one.code != "no_load_friction" for one in record.findings)


def test_the_volume_up_to_the_valve_is_that_of_its_parts_with_what_they_share(fit, record):
    """The data tell the sum: what the outlet's two sides hold each was stated alone, and compared with a drawing."""
    rows = {row.name: row for row in record.parameters}
    dead, gallery, both = (rows[name] for name in ("dead_volume", "gallery_volume", "volume_to_valve"))
    assert both.value == pytest.approx(dead.value + gallery.value)
    places = [fit.problem.index(name) for name in ("dead_volume", "gallery_volume")]
    statistical = 1e9 * np.sqrt(fit.deviation[np.ix_(places, places)].sum())
    shifted = 1e9 * np.sqrt(sum(np.sum(shift[:, places].sum(axis=1) ** 2) for shift in fit.shifts.values()))
    assert both.stderr == pytest.approx(np.hypot(statistical, shifted))


@pytest.mark.parametrize("name", ["cam_side_inertia", "shaft_damping", "volume_to_valve"])
def test_what_follows_from_parameters_is_log_normal_with_its_relative_deviation(record, name):
    row = next(row for row in record.parameters if row.name == name)
    spread = np.sqrt(np.log1p((row.stderr / row.value) ** 2))
    np.testing.assert_allclose(np.log(np.array(row.ci95) / row.value), [-1.959964 * spread, 1.959964 * spread])


def test_a_shaft_that_rings_as_if_the_cam_were_lighter_than_it_is_is_told(record):
    row = next(row for row in record.parameters if row.name == "cam_side_inertia")
    least = 1e-6 * row.ci95[1]
    assert light_cam_findings(record.parameters, 0.99 * least) == ()
    (finding,) = light_cam_findings(record.parameters, 2.0 * least)
    assert (finding.severity, finding.where) == ("warning", "cam_side_inertia")
    assert "less than the cam alone has by the sheet" in finding.text
    assert light_cam_findings([row for row in record.parameters if row.name != "cam_side_inertia"], 1.0) == ()
    assert all(found.code != "cam_side_too_light" for found in record.findings)


@pytest.mark.parametrize("degrees", [1.0, 8.0, 20.0, 60.0])
def test_the_largest_chi_square_is_that_of_the_tables(degrees):
    assert largest_chi_square(degrees) == pytest.approx(chi2.isf(1e-3, degrees), rel=0.035)


def test_bumps_are_where_the_residual_stands_out():
    n = 3600
    theta = np.arange(n) * 2.0 * np.pi / n
    rng = np.random.default_rng(0)
    repeat = 0.02 * rng.standard_normal(n)
    residual = 0.02 * rng.standard_normal(n) - 0.8 * np.exp(-(((theta - 1.0) / 0.02) ** 2))
    lift = np.where(theta < np.pi, np.sin(theta) ** 2, 0.0)
    flows = np.zeros((n, 4))
    flows[:, 2] = np.where(np.abs(theta - 1.0) < 0.2, 1.0, 0.0)
    motion = SimpleNamespace(lift=np.stack([lift, np.gradient(lift, theta)]))
    fitted = SimpleNamespace(
        chain=SimpleNamespace(theta=theta, speed=100.0), output=SimpleNamespace(motion=motion, flows=flows)
    )
    (bump,) = residual_bumps(residual, repeat, fitted)
    assert bump.start < 1.0 < bump.stop
    assert np.degrees(bump.stop - bump.start) < 4.0 * BUMP_WINDOW_DEG
    assert bump.peak == pytest.approx(-0.8, abs=0.1)
    assert bump.phase == "delivery"
    assert bump.frequency == 0.0
    assert residual_bumps(repeat[::-1].copy(), repeat, fitted) == ()
    twice = residual - 0.5 * np.exp(-(((theta - 1.0 - np.radians(0.9 * BUMP_WINDOW_DEG)) / 0.005) ** 2))
    assert len(residual_bumps(twice, repeat, fitted)) == 1  # nearer than the window: one bump
    (across,) = residual_bumps(np.roll(residual, -round(n / (2.0 * np.pi))), repeat, fitted)
    assert across.stop < 0.1 < 6.2 < across.start  # over the zero of the angle: still one
    assert across.peak == bump.peak


def test_the_base_circle_is_where_the_lift_is_least_even_in_a_table_that_never_comes_down_to_zero():
    theta = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    lift = 0.2e-3 + 8e-3 * np.where(theta < np.pi, np.sin(theta) ** 2, 0.0)
    motion = SimpleNamespace(lift=np.stack([lift, np.gradient(lift, theta)]))
    fitted = SimpleNamespace(output=SimpleNamespace(motion=motion, flows=np.zeros((360, 4))))
    assert [phase_at(fitted, place) for place in (0, 45, 90, 135, 270)] == [
        "base circle", "compression", "top dwell", "expansion on the return", "base circle",
    ]  # fmt: skip


@pytest.mark.parametrize(("signal", "told"), [
    (lambda t: np.sin(2.0 * np.pi * 800.0 * t) * np.exp(-60.0 * t), 800.0),
    (lambda t: np.exp(-((t - 0.01) / 0.002) ** 2), 0.0),
    (lambda t: np.sin(2.0 * np.pi * 150.0 * t), 0.0),  # three swings may be anything
    (lambda t: np.random.default_rng(1).standard_normal(t.size), 0.0),
])  # fmt: skip
def test_ringing_is_told_where_most_swings_at_one_frequency(signal, told):
    step = 2e-5
    assert ringing(signal(np.arange(1000) * step), step) == pytest.approx(told, rel=0.01)


def test_weights_know_scatter_and_the_admitted_model_error():
    torque = np.linspace(-20.0, 100.0, 600)
    plain, noisy = bin_weights(torque, 0.01), bin_weights(torque, 1.0)
    assert np.all(noisy < plain)
    assert plain[-1] < plain[100]  # more torque, more model error
    assert 1.0 / noisy[100] == pytest.approx(np.sqrt(10.0) * 1.0, rel=0.01)


def test_a_report_on_a_finer_grid_shows_the_model_that_was_fitted(fit):
    item = fit.problem.data[0]
    torque, pressure = item.chain.shaft_torque, item.chain.line_pressure
    coarse = model_of(fit, torque, pressure)
    fine = on_cycles(model_of(fit, on_grid(torque, 3600), on_grid(pressure, 3600)), 3600)
    np.testing.assert_allclose(fine.output.pressure[::2], coarse.output.pressure, rtol=1e-9)
    np.testing.assert_allclose(fine.torque[::2], coarse.torque, atol=1e-6 * np.ptp(coarse.torque))
    middle = 0.5 * (coarse.torque + np.roll(coarse.torque, -1))
    np.testing.assert_allclose(fine.torque[1::2], middle, atol=1e-6 * np.ptp(middle))
    assert np.all(np.diff(fine.output.motion.theta) > 0.0)


def test_a_minimum_is_worth_what_it_is_on_the_other_half_of_the_cycles():
    cycles = bridged(LAND)[1]
    data, found = quick_data(LAND), quick(LAND)
    means = mean_cycles(cycles)
    # the same cycles once more: nothing unseen; the other ones as noisy: little; another pressure: much
    same = Halves(data, data).judged(found)
    assert same.holdout_penalty == pytest.approx(0.0, abs=1e-6 * found.value)
    other = replace(data, chain=replace(data.chain, line_pressure=1.02 * data.chain.line_pressure))
    assert Halves(data, other).judged(found).value > found.value + 10.0
    held = replace(data, torque=binned(on_grid(means.held_torque, 1800)))
    assert abs(Halves(data, held).judged(found).holdout_penalty) < 0.5 * INDEPENDENT


def test_a_minimum_whose_cam_is_lighter_than_the_sheets_counts_the_less():
    found = quick(LAND)
    values, _ = found.problem.values(found.solution.z, 0)
    inertia = cam_side_inertia(values)

    def with_cam(kilogram_square_metres):
        pump = replace(found.data.chain.pump, cam_inertia=kilogram_square_metres)
        return replace(found, data=replace(found.data, chain=replace(found.data.chain, pump=pump)))

    lighter, as_heavy = with_cam(0.9 * inertia), with_cam(inertia * np.exp(3.0 * LIGHT))
    assert lighter.value == found.solution.chi_square + found.holdout_penalty
    assert as_heavy.value - lighter.value == pytest.approx(9.0)
    rigid = replace(
        found.solution, z=np.where(np.array(found.problem.names) == "shaft_compliance", 0.0, found.solution.z)
    )
    assert replace(as_heavy, solution=rigid).light_cam_penalty == 0.0


def test_the_certificate_says_how_sure_the_gain_of_the_pressure_is():
    recording = bridged(LAND)[0]
    sheet = recording.of("pressure")[0].calibration
    assert pressure_gain_std(recording) == sheet.gain_relative_std > 0.0

    def with_sheet(other):
        channels = [replace(c, calibration=other) if c.quantity == "pressure" else c for c in recording.channels]
        return replace(recording, channels=tuple(channels))

    assert pressure_gain_std(with_sheet(None)) == 0.0
    assert pressure_gain_std(with_sheet(replace(sheet, gain_relative_std=np.nan))) == 0.0


def test_a_minimum_that_falls_on_the_other_half_comes_last(monkeypatch):
    found, data = quick(LAND), quick_data(LAND)

    def falls(*_arguments):
        raise FloatingPointError

    monkeypatch.setattr(minima, "try_at", falls)
    worth = Halves(data, data).judged(found)
    assert worth.solution is found.solution
    assert worth.value > 0.4 * minima.FALLEN


def test_minima_are_compared_once_each_and_every_structure_has_one():
    data, found = quick_data(LAND), quick(LAND)
    start = Start(coarse(found.data), found.solution.lift, found.value)
    end = found.data.rows["end_of_delivery"].start
    spilled = {"spill_lift": float(np.interp(end, data.chain.theta, data.chain.law.evaluate(data.chain.theta, 0)))}
    spill = Start(with_starts(replace(start.data, structure="spill"), spilled), no_lift(), 1e5)
    moved = found.solution.z + np.where(
        np.arange(found.problem.size) == 0, 2.0 * covariance(found.problem, found.solution).std, 0.0
    )
    apart = replace(found, solution=replace(found.solution, z=moved), holdout_penalty=5.0)
    same = replace(found, holdout_penalty=1.0)
    known = SearchState({"land": [start], "spill": [spill]}, ((start, found), (start, same), (start, apart)))
    ends = every_structure(known, Halves(data, data))
    assert ends[:2] == [found, apart]
    assert [item.data.structure for item in ends] == ["land", "land", "spill"]
    assert known.best == (start, found)


def test_signals_keep_their_harmonics_on_another_grid():
    theta = np.arange(3600) * 2.0 * np.pi / 3600
    signal = 3.0 + np.sin(5.0 * theta) + 0.2 * np.cos(90.0 * theta)
    np.testing.assert_allclose(on_grid(signal, 1800), signal[::2], atol=1e-9)


def test_recordings_that_cannot_be_fitted_are_refused():
    _, cycles, _ = bridged(LAND)
    with pytest.raises(Refusal, match="no torque channel; use `camtorque align`"):
        mean_cycles(replace(cycles, torque=None))
    with pytest.raises(Refusal, match="expected at least 600"):
        mean_cycles(bridged(LAND, 300)[1])
    with pytest.raises(Refusal, match="at least 4 are needed"):
        mean_cycles(replace(cycles, held_out=np.zeros_like(cycles.held_out)))


def test_what_the_lift_table_explains_is_no_doubt():
    found = quick(LAND)
    modes, residual = found.solution.lift, found.solution.residual
    asked = modes.asked(residual)
    # the whitened square is what is left beside the correction, and what the correction costs
    left = residual - modes.vectors @ (modes.strength * asked)
    assert left @ left + asked @ asked == pytest.approx(modes.product(residual, residual), rel=1e-9)
    assert found.value - found.left_to_explain == pytest.approx(min(asked @ asked, np.sum(modes.shrink)))
    assert found.value > found.left_to_explain
    # beyond what the table states the rest stays a doubt
    assert modes.expected_part(100.0 * residual) == pytest.approx(np.sum(modes.shrink))


def test_a_jump_of_the_model_at_a_bound_is_no_slope_without_end():
    """As where an outlet opens again: the model is 0 at the bound and 2 everywhere above it."""

    def jumps(values, _):
        return np.array([2.0 * (values["share"] > 0.0) + 3.0 * values["line"]])

    problem = SimpleNamespace(values=lambda z, _: (dict(zip(("share", "line"), z, strict=True)), None),
                              bounds=(np.array([0.0, -9.0]), np.array([1.0, 1.0])))  # fmt: skip
    std = np.array([0.1, 0.2])
    fit = SimpleNamespace(problem=problem, solution=SimpleNamespace(z=np.array([0.0, 1.0])), std=std,
                          deviation=np.diag(std**2), shifts={})  # fmt: skip
    assert carried(fit, jumps) == pytest.approx([np.hypot(2.0, 3.0 * 0.2)])


@pytest.mark.parametrize(("largest", "told"), [(2.1e9, False), (5.9e9, False), (26.8e9, True)])
def test_a_contact_that_no_steel_bears_is_told_with_its_place(largest: float, told: bool):
    """A lift table whose angles had lost digits was explained, with 26.8 GPa for 1.0."""
    hertz = 1e9 * np.sin(np.linspace(0.0, np.pi, 3600))
    hertz[900], hertz[5] = largest, np.nan
    found = stress_findings(hertz)
    assert [finding.code for finding in found] == ["contact_stress_impossible"] * told
    assert not told or "26.8 GPa at 90 deg" in found[0].text


@pytest.mark.parametrize(
    ("opens", "std", "told"), [(7.65, 0.05, True), (7.55, 0.05, True), (6.9, 0.1, False), (6.0, 2.0, False)]
)
def test_a_spill_port_at_the_top_of_the_lift_is_told(record, opens: float, std: float, told: bool):
    """Of eight pumps whose delivery nothing ended all had a port that was *measured* at the top of the lift."""
    port = replace(record.parameters[0], name="spill_lift", value=opens, stderr=std, unit="mm")
    found = spill_findings([*record.parameters, port], 7.62e-3)
    assert [finding.code for finding in found] == ["spill_at_the_top"] * told

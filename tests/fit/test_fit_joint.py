"""One pump at three speeds: shared parameters, left-out predictions, and recordings that are not one pump."""

from __future__ import annotations

import json
import pickle
import weakref
from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest
from camtorque.fit import joint as joint_room
from camtorque.fit import joint_fit as joint_fit_room
from camtorque.fit import leftout as leftout_room
from camtorque.fit import one_ending as ending_room
from camtorque.fit.arrow import Arrow, ArrowCovariance, arrow_inverse
from camtorque.fit.drift import (
    Drift,
    contradiction,
    contradiction_findings,
    drift_findings,
    drift_spread,
    shared_drifts,
)
from camtorque.fit.evidence import LOSSES
from camtorque.fit.joint import (
    anchors,
    fit_joint,
    fitting_no_other,
    joint_fit_of,
    solve_joint,
)
from camtorque.fit.joint_fit import joint_evidence, residual_covariance, unbounded_mean
from camtorque.fit.joint_input import (
    HeldOnce,
    common_error,
    joint_input,
    refuse_two_states,
    with_common_rows,
    with_own_triggers,
)
from camtorque.fit.joint_solver import joint_setup, solve_many, try_at
from camtorque.fit.known_fit import KnownFit
from camtorque.fit.leftout import (
    LARGEST_STEP,
    MODES,
    HeldOut,
    Shares,
    error_text,
    fitted_without,
    left_out,
    left_out_values,
    poor_findings,
    predicted,
    predicted_end,
    settling_findings,
    shares,
    typical,
)
from camtorque.fit.one_ending import searched_anew, with_one_ending
from camtorque.fit.prepare import DISCREPANCY, INDEPENDENT, SMALLEST_SHARE
from camtorque.fit.problem import (
    END_NAMES,
    NEUTRAL,
    SEPARATOR,
    build_problem,
    in_structure,
    started_at,
    with_rows,
    with_starts,
)
from camtorque.fit.shared_lift import all_lift_information, lift_information, shared_lift_from
from camtorque.fit.single import switching_shift
from camtorque.fit.solver import with_slopes
from camtorque.fit.starts import ends_at
from camtorque.fit.truncated import Gaussian
from camtorque.fit.uncertainty import deviation_within
from camtorque.laws import ROWS
from camtorque.laws.chain import BINS, COLUMN_NAMES, binned, derivative_by, evaluate, filtered, transfer
from camtorque.laws.lift import LiftCorrection
from camtorque.process.threads import in_turn
from camtorque.records import Metrics, Refusal
from camtorque.report.bundle import CampaignEntry, CampaignResult
from camtorque.report.fit_file import campaign_fit_document, known_covariance, known_lift, known_shown
from dense_solver import dense_covariance, dense_solve
from fit_cases import quick_prepared, rig

SPEEDS = (700.0, 900.0, 1200.0)
FAMILY = ("closed_volume", 3)


def dense(arrow: Arrow) -> np.ndarray:
    total = np.diag(arrow.diagonal)
    for place, block in zip(arrow.places, arrow.blocks, strict=True):
        total[np.ix_(place, place)] += block
    return total


@pytest.fixture(scope="module")
def prepared():
    return [joint_input(quick_prepared(*FAMILY, rpm)) for rpm in SPEEDS]


@pytest.fixture(scope="module")
def solved(prepared):
    return solve_joint(prepared)


@pytest.fixture(scope="module")
def campaign(prepared, solved):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint_room, "solve_joint", lambda used, each: solved)  # the same three, solved once
        return fit_joint(prepared, prepared.__getitem__, 1)


@pytest.fixture(scope="module")
def joint(prepared, solved):
    return joint_fit_of(prepared, *solved)


def test_a_recording_has_its_own_parameters_whatever_another_is_called():
    names = ("leakage", "torque_zero__700rpm", "torque_zero__B__700rpm")
    known = KnownFit(names, np.zeros(3), ArrowCovariance.whole(np.eye(3)), ())
    assert known.own("700rpm") == {"leakage": 0, "torque_zero": 1}
    assert known.own("B__700rpm") == {"leakage": 0, "torque_zero": 2}


def test_one_switch_is_late_in_all_recordings_alike(prepared, solved):
    late = [replace(item, switching_std=angle) for item, angle in zip(prepared, (0.001, 0.002, 0.003), strict=True)]
    prompt = [replace(item, switching_std=0.0) for item in prepared]
    fit, known = (joint_fit_of(items, *solved).recording(0) for items in (late, prompt))
    k = fit.problem.index("trigger_offset")
    assert fit.std[k] == pytest.approx(np.hypot(known.std[k], 0.002))  # not averaged away


def test_shared_parameters_are_told_better_together(prepared, campaign):
    truth = rig(*FAMILY, SPEEDS[0]).truth
    rows = {row.name: row for row in campaign.shared_parameters}
    offset = np.degrees(truth.trigger.angle_offset)
    assert rows["trigger_offset"].ci95[0] < offset < rows["trigger_offset"].ci95[1]
    assert abs(rows["trigger_offset"].value - offset) < 0.15
    dead = 1e9 * truth.chamber.dead_volume
    assert rows["dead_volume"].ci95[0] < dead < rows["dead_volume"].ci95[1]
    assert rows["dead_volume"].stderr_statistical < 1e9 * prepared[1].alone["dead_volume"].std
    assert all(SEPARATOR not in name for name in rows)
    assert campaign.excluded == ()
    assert len(campaign.fitted) == 3
    for record in campaign.fitted:
        assert record.metrics["fitted_held_out_cycles"].rms_percent_of_peak < 0.2
        own = {row.name for row in record.parameters if row.role == "own"}
        assert len({name.split(SEPARATOR)[1] for name in own}) == 1


def test_a_recording_that_fits_no_other_is_excluded_and_told(prepared, solved, campaign):
    encoder = {**prepared[0].stated, "[trigger] pulses_per_rev": "360"}
    odd = replace(prepared[0], data=replace(prepared[0].data, name="odd"), stated=encoder)
    bad = SimpleNamespace(misfits=np.array([60.0, 2000.0, 70.0, 80.0]))
    four = [prepared[0], odd, *prepared[1:]]
    roles = []

    def solve(used, each):
        roles.append({item.data.rows["trigger_offset"].role for item in used})
        return (None, bad) if len(used) == 4 else solved

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint_room, "solve_joint", solve)
        patch.setattr(joint_room, "with_own_starts", lambda used, problem, solution, _: (used, problem, solution))
        found = fit_joint(four, four.__getitem__, 1)
    assert roles == [{"own"}, {"shared"}], "the others have one trigger"
    assert found.names == campaign.names
    assert found.excluded == ("odd",)
    (told,) = [finding for finding in found.findings if finding.code == "recording_excluded"]
    assert told.where == "odd"
    np.testing.assert_array_equal(found.covariance.std, campaign.covariance.std)


@pytest.mark.parametrize(
    ("misfits", "places"),
    [
        ([60.0, 2000.0, 70.0, 3000.0, 65.0], [3]),  # the worst may be what makes the other one bad
        ([60.0] * 25 + [9000.0, 8000.0, 9500.0], [27, 25]),
        ([60.0, 70.0, 9000.0], []),
        ([1.0, 1.2, 1.1, 30.0], []),  # far off the others, and still within the noise
    ],
)
def test_which_recordings_fit_no_other(misfits, places):
    assert fitting_no_other(np.array(misfits)) == places


def test_what_is_met_badly_is_searched_anew_and_taken_where_that_ends_lower(solved, monkeypatch):
    problem, solution = solved
    assert joint_room.with_bad_anew(*solved, in_turn) == solved  # none is met badly
    far = [replace(item, structure="open") for item in started_at(problem, solution.z)]
    there = build_problem([far[0], *started_at(problem, solution.z)[1:]])
    wrong = solve_many(there, there.start, 1)  # more of them wreck what all share
    assert wrong.misfits[0] > joint_room.BAD_FACTOR * np.median(wrong.misfits)
    again, mended = joint_room.with_bad_anew(there, wrong, in_turn)
    assert again.data[0].structure == problem.data[0].structure
    assert mended.chi_square < 0.01 * wrong.chi_square
    monkeypatch.setattr(joint_room, "BAD_FACTOR", 0.0)
    monkeypatch.setattr(joint_room, "searched_anew", lambda item: replace(item, structure="open"))
    assert joint_room.with_bad_anew(*solved, in_turn) == solved  # what was found is worse


def test_recordings_of_one_pump_end_alike_unless_one_is_better_otherwise(solved, monkeypatch):
    problem, solution = solved
    assert with_one_ending(*solved, in_turn) == solved  # they do
    usual = problem.data[0].structure
    other = "spill" if usual == "land" else "land"
    items = started_at(problem, solution.z)
    there = build_problem([searched_anew(items[0], (other,)), *items[1:]])
    mixed = solve_many(there, there.start, 60)  # from where 25 leave it neither way has settled
    alike, ended = with_one_ending(there, mixed, in_turn)
    assert [item.structure for item in alike.data] == [usual] * len(items)
    assert ended.chi_square < mixed.chi_square + ending_room.OTHERWISE
    # one that is far better otherwise stays so
    sure = replace(mixed, chi_square=0.0, data_chi_square=0.0)
    assert with_one_ending(there, sure, in_turn) == (there, sure)
    monkeypatch.setattr(ending_room, "solve_many", overflowing_many)
    assert with_one_ending(there, mixed, in_turn) == (there, mixed)


def overflowing_many(*_, **__):
    raise FloatingPointError("the derivative of the chain is not finite")


def test_a_start_that_overflows_is_dropped(prepared, monkeypatch):
    item, asked = prepared[0].data, []

    def overflowing(tried, held):
        asked.append(tried)
        if len(asked) == 1:
            raise FloatingPointError("the derivative of the chain is not finite")
        return 1.0, tried

    monkeypatch.setattr(ending_room, "own_fitted", overflowing)
    found = searched_anew(item, (item.structure,))
    assert [row.start for row in found.rows.values()] == [row.start for row in asked[1].rows.values()]
    assert found.lift_basis is item.lift_basis


def test_a_joint_fit_that_overflows_from_every_start_is_refused(prepared, monkeypatch):
    def overflowing(*_, **__):
        raise FloatingPointError("the derivative of the chain is not finite")

    monkeypatch.setattr(joint_room, "solve_many", overflowing)
    with pytest.raises(Refusal, match=r"joint fit of \d recordings: every start runs to where the model overflows"):
        fit_joint(prepared, prepared.__getitem__, 1)


def test_drift_of_what_should_be_the_same_is_looked_for_in_three_recordings(campaign):
    assert {row.name for row in campaign.drifts} <= {row.name for row in campaign.shared_parameters}
    assert "dead_volume" in {row.name for row in campaign.drifts}
    told = [finding.where for finding in campaign.findings if finding.code == "shared_parameter_drifts"]
    assert told == [row.name for row in campaign.drifts if row.chance < 0.05 / len(campaign.drifts)]


def test_a_drift_is_the_slope_over_speed_in_the_units_of_the_report(prepared):
    std, moved = 2e-9, []
    for item, rpm in zip(prepared, (500.0, 1000.0, 2000.0), strict=True):
        chain = replace(item.data.chain, speed=rpm * np.pi / 30.0)
        alone = replace(item.alone["dead_volume"], value=1e-6 + 4e-11 * rpm, std=std)
        moved.append(replace(item, data=replace(item.data, chain=chain), alone={"dead_volume": alone}))
    (row,) = shared_drifts(moved)
    assert row.slope_per_1000_rpm == pytest.approx(40.0, rel=1e-9)  # mm^3
    # equal errors: sigma over the root of the summed squares of speed about its mean, 1.1667 (1000 rpm)^2
    assert row.slope_stderr == pytest.approx(2.0 / np.sqrt(7.0 / 6.0), rel=1e-9)
    assert row.significant


@pytest.mark.parametrize("step", [0.0, 1e-6, 2e-3, 20.0])
def test_recordings_at_one_speed_tell_no_slope_over_speed(prepared, step):
    """Three runs within 2 mrpm made a slope of 10^5 per 1000 rpm, whose factor ended a campaign as unexpected."""
    same = []
    for k, item in enumerate(prepared):
        chain = replace(item.data.chain, speed=(1000.0 + step * k) * np.pi / 30.0)
        same.append(replace(item, data=replace(item.data, chain=chain)))
    rows = shared_drifts(same)
    assert rows
    assert all(np.isnan(row.slope_per_1000_rpm) and not row.significant and row.chance == 1.0 for row in rows)
    assert drift_findings(rows) == ()


def test_one_of_many_that_drifts_by_chance_widens_its_interval_and_is_no_finding():
    rows = [Drift(f"p{k}", "mm", ("a", "b", "c"), (5.0, 7.0, 9.0), (1.0,) * 3, (1.0,) * 3, slope, 1.0)
            for k, slope in enumerate([2.6, 3.6, *[0.5] * 58])]  # fmt: skip
    assert rows[0].significant
    assert rows[0].chance == pytest.approx(0.0093, abs=1e-4)
    assert [finding.where for finding in drift_findings(rows)] == ["p1"]
    assert [finding.where for finding in drift_findings(rows[:1])] == ["p0"]


def test_recordings_contradict_one_another_where_sharing_costs_more_than_each_leaves():
    assert contradiction(4.0, [1.0, 1.0, 30.0]) == pytest.approx(np.sqrt(0.75))
    assert contradiction(1.2, [1.5, 1.2, 1.0]) == 0.0
    assert contradiction_findings(0.4) == ()
    (told,) = contradiction_findings(0.8)
    assert told.severity == "warning"
    assert "64 % of the residual's variance" in told.text


def test_intervals_of_recordings_that_contradict_one_another_reach_to_what_each_says(prepared, solved):
    problem, solution = solved
    drifts = [replace(row, slope_per_1000_rpm=0.0) for row in shared_drifts(prepared)]
    assert not any(row.significant for row in drifts)
    np.testing.assert_array_equal(drift_spread(problem, solution.z, drifts, 0.0), 0.0)
    half, all_of_it = (drift_spread(problem, solution.z, drifts, share) for share in (0.5, 1.0))
    np.testing.assert_allclose(half, 0.5 * all_of_it)
    for name in prepared[0].alone:  # all of them move at once: what two exchange does not move their sum
        values = [item.alone[name].value for item in prepared]
        weights = [item.alone[name].std ** -2.0 for item in prepared]
        apart = np.average(values, weights=weights) - solution.z[problem.index(name)]
        assert all_of_it[problem.index(name)] == pytest.approx(apart, rel=1e-6, abs=1e-30), name
    place = problem.index("dead_volume")
    # one that drifts counts wholly, whether or not the others do
    drifting = [replace(row, slope_per_1000_rpm=9.0, slope_stderr=1.0) for row in drifts if row.name == "dead_volume"]
    assert drift_spread(problem, solution.z, drifting, 0.0)[place] == all_of_it[place]
    worse = replace(solution, data_chi_square=10.0 * INDEPENDENT * len(prepared))
    widened = joint_fit_of(prepared, problem, worse, drifts)
    (spread,) = widened.shifts["drift of what should be the same"]
    assert 0.5 < spread[place] / all_of_it[place] < 1.0


def test_every_recording_is_predicted_by_the_others_in_both_ways(prepared, campaign):
    assert [(row.name, row.mode) for row in campaign.held_out] == [
        (item.data.name, mode) for item in prepared for mode in MODES
    ]
    for row in campaign.held_out:
        if row.mode == "own_zero_and_end":
            assert {name.split(SEPARATOR)[0] for name in row.fitted_on_held_out} == (
                {"torque_zero", "end_of_delivery", "end_width"}
            )
            assert row.metrics.rms_percent_of_peak < 0.6
        else:
            assert row.fitted_on_held_out == ()
            assert row.metrics.rms_percent_of_peak > 0.0
    own = [row.metrics.rms_nm for row in campaign.held_out if row.mode == MODES[0]]
    blind = [row.metrics.rms_nm for row in campaign.held_out if row.mode == MODES[1]]
    assert np.mean(own) < np.mean(blind)


def test_a_blind_prediction_fits_no_ripple_of_the_drive(prepared, joint):
    data = list(joint.problem.data)
    data[1] = replace(data[1], chain=replace(data[1].chain, ripple_order=41))
    fit = replace(joint, problem=replace(joint.problem, data=tuple(data)))
    (own, blind), _ = predicted(fit, left_out(fit), 1, prepared[1])
    assert {"ripple_cosine", "ripple_sine"} < set(own.fitted_on_held_out)
    assert blind.fitted_on_held_out == ()


def end_predicted(joint, index):
    found = left_out(joint)
    return predicted_end(found.known, found.curves, joint.problem.data[index])


def test_where_no_end_was_seen_in_the_others_none_is_predicted(joint):
    found, item = left_out(joint), joint.problem.data[1]

    def predicted(structure):
        others = (one if one.id == item.name else replace(one, structure=structure) for one in found.known.recordings)
        return predicted_end(replace(found.known, recordings=tuple(others)), found.curves, item)

    assert predicted("open") == {name: NEUTRAL[name] for name in END_NAMES}
    # a line pressure that is the plunger's tells nothing of ends: what is usual
    assert predicted("line")["end_of_delivery"] == item.rows["end_of_delivery"].start


def test_blind_end_of_delivery_does_not_know_the_recordings_own(joint):
    index = 1
    place = joint.problem.index(f"end_of_delivery{SEPARATOR}{joint.problem.data[index].name}")
    assert place >= 0
    z = joint.solution.z.copy()
    z[place] += np.radians(6.0)
    moved = replace(joint, solution=replace(joint.solution, z=z))
    found = end_predicted(joint, index)
    assert set(found) == {"end_of_delivery", "end_width"}
    assert end_predicted(moved, index) == found
    # but the neighbours' ends are what it is matched to
    z = z.copy()
    for other in (0, 2):
        z[joint.problem.index(f"end_of_delivery{SEPARATOR}{joint.problem.data[other].name}")] += np.radians(6.0)
    moved = replace(joint, solution=replace(joint.solution, z=z))
    assert end_predicted(moved, index)["end_of_delivery"] != found["end_of_delivery"]
    assert abs(found["end_of_delivery"] - joint.solution.z[place]) < np.radians(4.0)


def test_left_out_values_are_the_minimum_of_the_others_to_first_order(joint, solved):
    index = 2
    problem, solution = solved
    found = left_out_values(joint, shares(problem, solution), index)
    rest = build_problem(started_at(problem, solution.z)[:2])
    task = joint_setup(problem, solution.z, 0.0)
    alone = dense_solve(rest, rest.start, 12, (task.lift(0), task.lift(1)))
    names = problem.names
    std = dense_covariance(rest, alone.data_hessian, alone.data_chi_square, alone.lift_share).std
    for name in ("trigger_offset", "dead_volume", "shaft_compliance", "port_closing_lift"):
        k = rest.index(name)
        assert abs(found[names.index(name)] - alone.z[k]) < 1.0 * std[k], name
    own = [k for k, parameter in enumerate(problem.parameters) if parameter.recording == index]
    np.testing.assert_array_equal(found[own], solution.z[own])


@pytest.mark.parametrize("held", ["", "end_width"])
def test_left_out_values_are_those_of_the_whole_matrix(joint, solved, held):
    problem, solution = solved
    wide = np.full(solution.z.size, np.inf)
    bounds, free = (-wide, wide.copy()), np.ones(wide.size, dtype=bool)
    if held:  # own parameters that an upper bound holds move no others
        free = np.array([parameter.row.name != held for parameter in problem.parameters])
        bounds[1][~free] = solution.z[~free]
        solution = replace(solution, gradient=np.where(free, solution.gradient, 1.0))
        assert np.count_nonzero(~free) == 3
    unbound = SimpleNamespace(solution=solution, covariance=joint.covariance, problem=SimpleNamespace(bounds=bounds))
    for index in range(3):
        place, kept = solution.hessian.places[index], (solution.hessian.recording != index) & free
        rest, vector = dense(solution.hessian), solution.gradient.copy()
        rest[np.ix_(place, place)] -= solution.hessian.blocks[index]
        vector[place] -= solution.parts[index]
        scale = joint.covariance.prior_std[kept]
        step = scale * np.linalg.solve(rest[np.ix_(kept, kept)] * np.outer(scale, scale), scale * vector[kept])
        shared = (solution.hessian.recording < 0)[kept]
        largest = np.max(np.abs(step[shared]) / (LARGEST_STEP * joint.covariance.std[kept][shared]))
        expected = solution.z[kept][shared] + step[shared] / max(1.0, largest)
        found = left_out_values(unbound, shares(unbound.problem, solution), index)[solution.hessian.recording < 0]
        unit = scale[shared]  # some values are 0
        np.testing.assert_allclose(found / unit, expected / unit, rtol=1e-6, atol=1e-9)


def quadratic_fit(z, upper):
    """Return a joint fit of two shared parameters that are nearly one, at a minimum that a bound holds."""
    bounds = np.full(2, -10.0), np.array([upper, 10.0])
    covariance = SimpleNamespace(prior_std=np.full(2, 100.0), std=np.full(2, 10.0))
    solution = SimpleNamespace(z=np.array(z))
    return SimpleNamespace(solution=solution, problem=SimpleNamespace(bounds=bounds), covariance=covariance)


@pytest.mark.parametrize(("z", "wanted"), [([1.0, 0.0], [1.0, 0.5]), ([0.8, 0.0], [1.0, 0.32])])
def test_a_parameter_that_a_bound_holds_does_not_move_the_others(z, wanted):
    """A step over the bound that was cut back afterwards would take the other parameter with it, by 4 and more."""
    matrix, pull = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([5.0, 0.5])
    nothing = (np.zeros((2, 2)), np.zeros(2))
    found = left_out_values(quadratic_fit(z, 1.0), Shares(np.arange(2), matrix, pull, (nothing,)), 0)
    np.testing.assert_allclose(found, wanted, atol=1e-3)
    assert abs(np.linalg.solve(matrix, pull)[1]) > 4.0


def test_few_others_are_fitted_again_where_the_linear_step_fails(joint, solved, monkeypatch):
    problem, solution = solved
    index, found = 1, shares(problem, solution)
    z, settled = fitted_without(joint, found, index)
    assert settled
    near = left_out_values(joint, found, index)

    def chi_square(values):
        rest = leftout_room._without(problem, values, index)
        return try_at(joint_setup(rest, rest.start, 0.0), rest.start).chi_square

    assert chi_square(z) < min(chi_square(solution.z), chi_square(near))
    own = [k for k, parameter in enumerate(problem.parameters) if parameter.recording == index]
    np.testing.assert_array_equal(z[own], solution.z[own])
    # from a place where the valley is long, one step is too few, and it is said
    away = replace(joint, solution=replace(solution, z=problem.start + 0.3 * problem.steps))
    monkeypatch.setattr(leftout_room, "left_out_values", lambda *_: away.solution.z + 3.0 * problem.steps)
    monkeypatch.setattr(leftout_room, "FIT_ON_STEPS", 1)
    assert not fitted_without(away, found, index)[1]
    (told,) = settling_findings(["a", "b"])
    assert (told.severity, told.where) == ("info", "a")
    assert "without a, b: the fit of the other recordings was still moving after 1 steps" in told.text
    assert settling_findings([]) == ()
    # of many, each is a small part: the step is taken as it is
    monkeypatch.setattr(leftout_room, "MOST_FITTED_ON", 2)
    np.testing.assert_array_equal(fitted_without(away, found, index)[0], away.solution.z + 3.0 * problem.steps)


def test_recordings_that_the_others_predict_badly_are_told(campaign):
    rows = [replace(row, metrics=replace(row.metrics, rms_percent_of_peak=0.25)) for row in campaign.held_out]
    assert poor_findings(rows) == ()
    bad = replace(rows[1], metrics=replace(rows[1].metrics, rms_percent_of_peak=1.5))
    (told,) = poor_findings([rows[0], bad, *rows[2:]])
    assert (told.severity, told.where) == ("warning", bad.name)
    assert f"left out and predicted from the others, {bad.name} is off" in told.text
    assert "1.5 % of the peak (RMS), its highest torque" in told.text
    assert "(nothing of it fitted, at most 1 %)" in told.text


def test_a_trigger_of_its_own_is_no_error_of_what_a_run_is_predicted_with(campaign):
    """Blind, a recording is off by as much as its trigger is mounted: 2.4 to 4.6 % of the peak within 1.5 degrees."""
    own, blind = (replace(row, metrics=replace(row.metrics, rms_percent_of_peak=2.5)) for row in campaign.held_out[:2])
    assert (own.mode, blind.mode) == MODES
    turned = replace(own, fitted_on_held_out=(*own.fitted_on_held_out, "trigger_offset"))
    (told,) = poor_findings([turned, blind])
    assert "(own zero, trigger angle and end of delivery fitted, at most 0.3 %); a run" in told.text
    assert "nothing of it fitted" not in told.text
    (both,) = poor_findings([own, blind])
    assert "(nothing of it fitted" in both.text


def test_a_prediction_says_how_far_its_highest_torque_is_off():
    error = Metrics(2.0, 5.0, 0.0, -16.0, -20.0, -20.0, 0.3)
    assert error.peak_excess_percent == pytest.approx(40.0)
    assert error_text(error) == "5 % of the peak (RMS), its highest torque 40 % too high"
    assert error_text(replace(error, rms_percent_of_peak=0.0, rms_nm=0.0)) == "0 % of the peak (RMS)"


def test_of_many_badly_predicted_recordings_the_worst_have_a_finding_each():
    error = Metrics(0.8, 2.0, 0.0, -1.0, -20.0, -20.0, 0.3)
    rows = [HeldOut(f"r{k}", "blind", (), replace(error, rms_percent_of_peak=2.0 + k)) for k in range(8)]
    found = poor_findings(rows)
    assert [row.where for row in found] == ["r7", "r6", "r5", "r4", "r3", "r2"]
    assert found[-1].text == "less, but too much, are off: r2 4 %, r1 3 %, r0 2 %"


def test_beside_a_step_of_the_model_a_prediction_is_typical(joint, monkeypatch):
    """Best values may lie on the rare side of a step: there a drawn run stands for all, elsewhere they do."""
    others, data = left_out(joint), joint.problem.data[1]
    names = [joint.problem.parameters[k].row.name for k in others.found.places]
    shared = dict(zip(names, joint.solution.z[others.found.places].tolist(), strict=True))
    assert typical(others.known, data, shared, {}) == shared

    def stepping(chain, values, _linear):
        rare = values["dead_volume"] == shared["dead_volume"]
        torque = np.full(chain.theta.size, 100.0 if rare else 1e9 * values["dead_volume"] * 1e-3)
        return SimpleNamespace(torque=torque, linear=np.zeros((torque.size, len(COLUMN_NAMES))))

    monkeypatch.setattr(leftout_room, "evaluate", stepping)
    found = typical(others.known, data, shared, {})
    assert list(found) == names
    one = joint.recording(1)
    std = one.std[one.problem.index("dead_volume")]
    # draws know of no bounds, the standard deviation does: half of it where the minimum is another by rounding
    assert 0.0 < abs(found["dead_volume"] - shared["dead_volume"]) < std
    assert all(ROWS[name].lower <= value <= ROWS[name].upper or value == shared[name] for name, value in found.items())


def test_the_lift_correction_of_a_prediction_is_that_which_the_others_ask_for(joint, solved):
    problem, solution = solved
    others = all_lift_information(problem, solution.z, 1.0) - lift_information(problem, solution.z, 2, 1.0)
    rest = leftout_room._without(problem, solution.z, 2)
    np.testing.assert_allclose(
        shared_lift_from(problem, others).values,
        shared_lift_from(rest, all_lift_information(rest, rest.start, 1.0)).values,
        rtol=1e-6,
        atol=1e-12,
    )


def test_many_recordings_are_solved_as_few_are(prepared):
    """The steps by sums of small blocks are those of the whole matrix."""
    data = with_common_rows([common_error(item.data, 3) for item in prepared])
    problem = build_problem(data)
    task = joint_setup(problem, problem.start, 0.02)
    whole = dense_solve(problem, problem.start, 4, tuple(map(task.lift, range(3))), 0.02)
    blocks = solve_many(problem, problem.start, 4, 0.02)
    assert (blocks.iterations, blocks.evaluations) == (whole.iterations, whole.evaluations)
    np.testing.assert_allclose(blocks.z, whole.z, rtol=1e-6, atol=1e-9 * problem.steps.max())
    assert blocks.chi_square == pytest.approx(whole.chi_square, rel=1e-8)
    assert blocks.data_chi_square == pytest.approx(whole.data_chi_square, rel=1e-8)
    scale = np.sqrt(np.diag(whole.hessian))
    np.testing.assert_allclose(
        dense(blocks.hessian) / np.outer(scale, scale), whole.hessian / np.outer(scale, scale), atol=1e-6
    )
    # the misfits are those of the normal equations, one linearisation before
    assert np.sum(blocks.misfits) == pytest.approx(blocks.data_chi_square, rel=3e-5)
    assert try_at(replace(task, about=whole.z), whole.z).chi_square == pytest.approx(whole.chi_square, rel=1e-6)


@pytest.mark.parametrize("pseudo", [False, True])
def test_an_arrow_is_solved_without_its_whole_matrix(pseudo):
    chance = np.random.default_rng(3)
    recording = np.array([-1, -1, -1, 0, 0, 1, 2])
    places = tuple(np.flatnonzero((recording < 0) | (recording == k)) for k in range(3))
    halves = [chance.normal(size=(p.size + 2, p.size)) for p in places]
    arrow = Arrow(places, tuple(h.T @ h for h in halves), np.full(7, 0.1), recording)
    free = np.array([True, False, True, True, False, True, True])
    vector = chance.normal(size=7)
    whole = dense(arrow)
    expected = np.zeros(7)
    expected[free] = np.linalg.solve(whole[np.ix_(free, free)], vector[free])
    np.testing.assert_allclose(arrow.solve(free, vector, pseudo), expected, rtol=1e-9)
    np.testing.assert_allclose(arrow.times(vector), whole @ vector, rtol=1e-12)
    np.testing.assert_allclose(arrow.main_diagonal(), np.diag(whole), rtol=1e-12)


def test_an_arrow_beyond_the_largest_number_is_refused_in_silence():
    block = np.array([[1e-300, 1e300], [1e300, 1e-300]])
    arrow = Arrow((np.array([0, 1]),), (block,), np.zeros(2), np.array([-1, -1]))
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        arrow.solve(np.ones(2, dtype=bool), np.ones(2), pseudo=True)


def test_the_inverse_of_an_arrow_is_told_without_the_whole_matrix():
    chance = np.random.default_rng(4)
    recording = np.array([-1, 0, -1, 1, -1, 0, 2])
    places = tuple(np.flatnonzero((recording < 0) | (recording == k)) for k in range(3))
    halves = [chance.normal(size=(p.size + 2, p.size)) * 10.0 ** chance.integers(-3, 3, p.size) for p in places]
    arrow = Arrow(places, tuple(h.T @ h for h in halves), np.full(7, 1e-3), recording)
    found, expected = arrow_inverse(arrow), np.linalg.inv(dense(arrow))
    scale = np.outer(*[np.sqrt(np.diag(expected))] * 2)
    np.testing.assert_allclose(found.among(range(7)) / scale, expected / scale, atol=1e-8)
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(expected)), rtol=1e-8)
    chosen = [6, 1, 0, 5]  # own ones of two recordings, in any order
    np.testing.assert_allclose(found.among(chosen), expected[np.ix_(chosen, chosen)], rtol=1e-6)
    vector = chance.normal(size=7) / np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found.times(vector), expected @ vector, rtol=1e-6)
    of, block = found.of(0)
    np.testing.assert_allclose(block, expected[np.ix_(of, of)], rtol=1e-6)


def test_the_joint_covariance_is_that_of_the_whole_matrix(joint, solved):
    problem, solution = solved
    data = dense(replace(solution.hessian, diagonal=np.zeros(problem.size)))
    whole = dense_covariance(problem, data, solution.data_chi_square, solution.lift_share)
    assert joint.covariance.freedom == pytest.approx(whole.freedom, rel=1e-6)
    assert joint.covariance.inflation == pytest.approx(whole.inflation, rel=1e-6)
    scale = np.outer(whole.std, whole.std)
    found = joint.covariance.arrow.among(range(problem.size))
    np.testing.assert_allclose(found / scale, whole.matrix / scale, atol=1e-5)
    one = joint.recording(1)
    kept = [k for k, parameter in enumerate(problem.parameters) if parameter.recording in (-1, 1)]
    assert list(one.problem.names) == [problem.parameters[k].name for k in kept]
    np.testing.assert_allclose(one.covariance.std, whole.std[kept], rtol=1e-5)
    np.testing.assert_array_equal(one.solution.z, solution.z[kept])


@pytest.mark.parametrize("index", [0, 2])
def test_joint_uncertainties_lie_within_the_bounds(joint, index):
    """As those of one recording do (0148); the bounds of the others' own parameters, left out, take little away."""
    problem, solution, cov = joint.problem, joint.solution, joint.covariance
    every = range(problem.size)
    whole = Gaussian(unbounded_mean(solution, cov), cov.arrow.among(every), *problem.bounds)
    wanted = np.sqrt(np.diag(deviation_within(whole, solution.z)))
    one = joint.recording(index)
    kept = [k for k, parameter in enumerate(problem.parameters) if parameter.recording in (-1, index)]
    off = np.abs(one.statistical_std / wanted[kept] - 1.0)
    assert np.max(off) < 0.1
    assert np.median(off) < 0.01
    narrower = one.statistical_std / one.covariance.std
    assert narrower[one.problem.names.index("shaft_drag")] < 0.9
    assert np.median(narrower) < 0.97


def test_the_file_of_a_joint_fit_grows_with_its_recordings_and_not_with_their_square(campaign):
    """What one recording adds is told beside it; the matrix is that of the shared parameters."""
    entries = [CampaignEntry(name, name, "ok", "", {"speed_rpm": 900.0}, folder=name) for name in campaign.names]
    doc = campaign_fit_document(CampaignResult(tuple(entries), campaign, (), {}, ""))
    shared = [name for name in doc["names"] if SEPARATOR not in name]
    assert np.shape(doc["correlation"]) == (len(shared), len(shared))
    assert len(json.dumps(doc["recordings"])) < 12_000 * len(entries)
    found, names = known_covariance(json.loads(json.dumps(doc))), doc["names"]
    scale = np.outer(campaign.covariance.std, campaign.covariance.std)
    everything = range(len(names))
    np.testing.assert_allclose(
        found.among(everything) / scale, campaign.covariance.among(everything) / scale, atol=1e-5
    )
    known = KnownFit(tuple(names), np.array(doc["values"]), found, ())
    only = known.only([campaign.names[2]])
    assert {name for name in only.names if SEPARATOR not in name} == set(shared)
    assert {name.split(SEPARATOR)[1] for name in only.names if SEPARATOR in name} == {campaign.names[2]}
    kept = [names.index(name) for name in only.names]
    np.testing.assert_allclose(only.covariance.matrix, found.among(kept))


def test_what_a_wrong_lift_table_does_in_all_recordings_is_found_as_one_correction(solved):
    """A bump of 3 um in the middle of the rise, put into the measured torque of all three; a table good to 3 um."""
    problem, solution = solved
    basis = replace(problem.data[0].lift_basis, prior_std=3e-6)
    problem = replace(problem, data=tuple(replace(item, lift_basis=basis) for item in problem.data))
    middle = basis.knots[0] + 0.35 * (basis.knots[-1] - basis.knots[0])
    bump = 3e-6 * np.exp(-0.5 * ((basis.knots[2:-2] - middle) / np.radians(2.0)) ** 2)
    moved = []
    for index, item in enumerate(problem.data):
        values = problem.values(solution.z, index)[0]
        output, (shaft, measured, *_) = evaluate(item.chain, values), transfer(item.chain, values, BINS)
        cam = binned(output.load * basis.correction(output.motion.theta, bump, 1))
        moved.append(replace(item, torque=item.torque + filtered(cam, shaft * measured)))
    problems = [replace(problem, data=tuple(data)) for data in (problem.data, moved)]
    plain, found = (shared_lift_from(one, all_lift_information(one, solution.z, 1.0)) for one in problems)
    lift = LiftCorrection(basis.knots, 0.0)
    theta = middle + np.radians(np.linspace(-8.0, 8.0, 60))
    wanted, told = lift.correction(theta, bump, 1), found.slope(theta) - plain.slope(theta)
    assert np.sqrt(np.mean((told - wanted) ** 2)) < 0.25 * np.sqrt(np.mean(wanted**2))
    before = basis.prior_std / (basis.knots[1] - basis.knots[0])
    assert 0.02 * before < np.median(found.slope_stderr(theta)) < before
    beside = np.array([basis.knots[-1] + 0.5])
    assert (found.slope(beside), found.slope_stderr(beside)) == (0.0, 0.0)


def test_a_residual_smaller_than_the_weights_admit_narrows_predictions_and_no_parameter(joint, solved):
    problem, solution = solved
    cov = joint.covariance
    small = replace(solution, data_chi_square=0.25 * cov.freedom)
    shown = residual_covariance(small, cov)
    data = dense(replace(solution.hessian, diagonal=np.zeros(problem.size)))
    wanted = np.linalg.inv(data / 0.25 + np.diag(cov.prior_std**-2.0))
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(shown.among(range(problem.size)) / np.outer(scale, scale),
                               wanted / np.outer(scale, scale), atol=1e-4)  # fmt: skip
    assert residual_covariance(replace(solution, data_chi_square=1.1 * cov.freedom), cov) is None
    rows = replace(KnownFit(problem.names, solution.z, cov.arrow, ()), residual_covariance=shown)
    assert rows.predictive is cov.arrow, "no left-out recordings tell what the laws get wrong"


def test_lift_correction_and_shown_covariance_are_read_back_from_the_file(campaign):
    entries = [CampaignEntry(name, name, "ok", "", {"speed_rpm": 900.0}, folder=name) for name in campaign.names]
    told = replace(campaign, residual_covariance=campaign.covariance)
    doc = json.loads(json.dumps(campaign_fit_document(CampaignResult(tuple(entries), told, (), {}, ""))))
    everything = range(len(doc["names"]))
    scale = np.outer(campaign.covariance.std, campaign.covariance.std)
    np.testing.assert_allclose(
        known_shown(doc).among(everything) / scale, campaign.covariance.among(everything) / scale, atol=1e-5
    )
    theta = np.linspace(0.0, 2.0 * np.pi, 300)
    largest = np.max(np.abs(campaign.lift.slope(theta)))
    np.testing.assert_allclose(known_lift(doc).slope(theta), campaign.lift.slope(theta), atol=1e-5 * largest)
    np.testing.assert_allclose(known_lift(doc).slope_stderr(theta), campaign.lift.slope_stderr(theta), rtol=1e-5)
    old = {name: value for name, value in doc.items() if name not in ("shown", "lift_correction")}
    assert (known_shown(old), known_lift(old)) == (None, None)


def test_the_error_of_the_laws_does_not_average_out(prepared):
    item = prepared[0].data
    assert common_error(item, 1).weight == pytest.approx(item.weight)
    wide = common_error(item, 5)
    law = (SMALLEST_SHARE * np.max(np.abs(item.torque))) ** 2 + (DISCREPANCY * np.abs(item.torque)) ** 2
    added = 1.0 / wide.weight**2 - 1.0 / item.weight**2
    np.testing.assert_allclose(added, 4.0 * law * BINS / INDEPENDENT, rtol=1e-9)


def test_one_that_was_taken_for_another_ending_does_not_bend_the_others(prepared, solved):
    assert anchors(prepared) == sorted(range(len(prepared)), key=lambda k: prepared[k].inflation)
    data = replace(prepared[0].data, structure="spill")
    mistaken = replace(prepared[0], data=with_starts(data, ends_at(data, (0.6,))[0]))
    assert 0 not in anchors([mistaken, *prepared[1:]])
    problem, solution = solve_joint([mistaken, *prepared[1:]])
    assert [item.structure for item in problem.data] == [item.structure for item in solved[0].data]
    assert solution.chi_square < 1.1 * solved[1].chi_square + 10.0


def test_an_anchor_that_is_met_badly_is_none_a_second_time(prepared, solved, monkeypatch):
    asked = []

    def from_anchors(inputs, chosen, each):
        asked.append(list(chosen))
        problem, solution = solved
        bent = replace(solution, misfits=np.array([5e4, 30.0, 30.0]), chi_square=5e4)
        return (problem, bent) if 0 in chosen else solved

    monkeypatch.setattr(joint_room, "_from_anchors", from_anchors)
    assert solve_joint(prepared) == solved
    assert [sorted(chosen) for chosen in asked] == [[0, 1, 2], [1, 2]]


def test_bounds_of_shared_parameters_are_common(prepared):
    found = with_common_rows([item.data for item in prepared])
    for name, row in found[0].rows.items():
        if row.role == "shared":
            assert len({(item.rows[name].lower, item.rows[name].upper) for item in found}) == 1


def test_a_prior_that_one_recording_states_holds_for_all_whichever_comes_first(prepared):
    def common(*priors):
        items = [with_rows(item.data, {"bulk_modulus": {"prior": prior, "source": f"source {prior[1]:g}"}})
                 for item, prior in zip(prepared, priors, strict=True)]  # fmt: skip
        orders = [[found.rows["bulk_modulus"] for found in with_common_rows(list(order))]
                  for order in permutations(items)]  # fmt: skip
        (prior,) = {row.prior for rows in orders for row in rows}
        assert len({row.source for rows in orders for row in rows}) == 1
        return prior, orders[0][0].source

    assert common((1.4, 0.2), (1.1, 0.1), (1.4, 0.2)) == ((1.1, 0.1), "source 0.1")
    assert common((0.0, 0.2), (0.0, 0.5), (0.0, 0.3)) == ((0.0, 0.5), "source 0.5")  # one knowledge, other loads
    (mean, std), _ = common((1.1, 0.1), (1.3, 0.1), (1.4, 0.2))
    assert (mean, std) == (pytest.approx(1.2), pytest.approx(np.hypot(0.1, 0.1)))


def test_a_recording_without_a_chamber_is_searched_with_one(prepared):
    line = in_structure(prepared[0].data, "line")
    assert not line.chain.uses_chamber
    assert not searched_anew(line, ("line",)).chain.uses_chamber
    for structure in ("land", "spill", "open"):
        found = searched_anew(line, (structure,))
        assert (found.structure, found.chain.uses_chamber) == (structure, True)


def test_recordings_of_other_triggers_have_their_own_trigger_angle_each(prepared):
    assert all("trigger_offset" in item.alone for item in with_own_triggers(prepared))
    first, *rest = prepared
    encoder = {**first.stated, "[trigger] pulses_per_rev": "360"}
    row = first.alone["trigger_offset"]
    turned = {**first.alone, "trigger_offset": replace(row, value=row.value + 12.0 * row.std)}
    beside = replace(first, alone=turned, stated=encoder, data=replace(first.data, name="encoder"))
    refuse_two_states([first, beside])
    with pytest.raises(Refusal, match="differ in trigger offset"):
        refuse_two_states([first, replace(beside, stated=first.stated)])
    mixed = with_own_triggers([beside, *rest])
    assert not any("trigger_offset" in item.alone for item in mixed)
    problem = build_problem(with_common_rows([item.data for item in mixed]))
    found = [name for name in problem.names if name.startswith("trigger_offset")]
    assert found == [f"trigger_offset{SEPARATOR}{item.name}" for item in mixed]
    late = switching_shift(problem, [1e-3, 2e-3, 3e-3])
    assert [late[problem.index(name)] for name in found] == [1e-3, 2e-3, 3e-3]
    assert np.count_nonzero(late) == 3, "it moved the last parameter, whatever that was"


def test_two_answers_at_one_speed_are_refused_and_not_averaged(prepared):
    one = prepared[0]
    refuse_two_states([one, prepared[1]])  # another speed
    row = one.alone["dead_volume"]
    moved = {**one.alone, "dead_volume": replace(row, value=row.value + 12.0 * row.std)}
    other = replace(one, alone=moved, data=replace(one.data, name="after"))
    with pytest.raises(Refusal, match=r"and after run at one speed but differ in dead volume .* campaign of each"):
        refuse_two_states([one, other])
    begun = replace(one.alone["port_closing_lift"], value=1.5 * one.alone["port_closing_lift"].value)
    refuse_two_states([one, replace(other, alone={**one.alone, "port_closing_lift": begun})])  # metered at its inlet
    with pytest.raises(Refusal, match="differ in dead volume"):
        refuse_two_states([one, replace(other, alone={**moved, "port_closing_lift": begun})])
    faster = replace(other, data=replace(other.data, chain=replace(other.data.chain, speed=100.0)))
    refuse_two_states([one, faster])


def test_a_group_of_recordings_counts_as_a_pump_of_its_own():
    before = quick_prepared(*FAMILY, SPEEDS[0])
    config = replace(before.recording.config, group="after")
    after = replace(before, recording=replace(before.recording, config=config))
    assert joint_input(before).pump_id == config.pump_id
    assert joint_input(after).pump_id == f"{config.pump_id} (after)"


def test_what_is_the_same_is_held_once(prepared):
    copies = pickle.loads(pickle.dumps(prepared))
    for item, copy in zip(prepared, map(HeldOnce(), copies), strict=True):
        for name in ("theta", "line_pressure", "shaft_torque", "substeps"):
            np.testing.assert_array_equal(getattr(copy.data.chain, name), getattr(item.data.chain, name))
        assert copy.data.rows == item.data.rows
        assert copy.alone == item.alone
        assert not hasattr(copy, "means"), "curves are read again"
    found = list(map(HeldOnce(), [*copies, *pickle.loads(pickle.dumps(prepared))]))
    assert len({id(item.data.chain.law) for item in found}) == 1, "one pump, one lift table"
    assert len({id(item.data.rows["leakage"].meaning) for item in found}) == 1


@pytest.mark.parametrize(("kept", "needed"), [(1.0, True), (0.0, False)])
def test_several_speeds_tell_damping_from_other_losses(prepared, solved, kept, needed):
    """At one speed viscous drag of the shaft is a constant, like other drag and the transducer's zero."""
    problem, solution = solved
    friction = rig(*FAMILY, SPEEDS[0]).truth.friction
    losses = {name: getattr(friction, name) for name in LOSSES["damping"]}
    items = []
    for k, one in enumerate(started_at(problem, solution.z)):
        columns = derivative_by(with_slopes(problem, solution.z, k)[0], list(losses))
        items.append(replace(one, torque=one.torque - (1.0 - kept) * columns @ list(losses.values())))
    moved = build_problem(items)
    fit = joint_fit_of(prepared, moved, solve_many(moved, moved.start, 25))
    rows = {row.name: row for row in joint_evidence(fit, True)}
    assert rows["friction"].verdict == "needed"
    assert (rows["damping"].verdict == "needed") == needed, rows["damping"]


def test_evidence_of_many_recordings_holds_the_chain_of_one_at_a_time(joint, monkeypatch):
    """Two megabytes each: a thousand of them filled gigabytes."""
    held, alive = [], []

    def watched(*arguments):
        output, columns = with_slopes(*arguments)
        alive.append(sum(one() is not None for one in held))
        held.append(weakref.ref(output))
        return output, columns

    monkeypatch.setattr(joint_fit_room, "with_slopes", watched)
    joint_evidence(joint, True)
    assert len(alive) == len(SPEEDS)
    assert max(alive) <= 1


def test_evidence_of_many_recordings_takes_no_matrix_of_all_their_parameters(joint, monkeypatch):
    """A thousand recordings have four thousand parameters of their own, whose square fills 130 MB."""
    made, whole = [], np.diag
    monkeypatch.setattr(np, "diag", lambda values: made.append(np.shape(values)) or whole(values))
    joint_evidence(joint, True)
    n_shared = joint.covariance.arrow.shared.size
    assert joint.problem.size > n_shared
    assert max(shape for shape in made if len(shape) == 1) == (n_shared,)

"""One pump at three speeds: shared parameters, left-out predictions, and recordings that are not one pump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit import joint as joint_room
from camtorque.fit.joint import common_error, fit_joint, refuse_two_states, solve_joint, started_at, with_common_rows
from camtorque.fit.leftout import MODES, left_out_values, predicted_end
from camtorque.fit.prepare import DISCREPANCY, INDEPENDENT, SMALLEST_SHARE
from camtorque.fit.problem import SEPARATOR, build_problem
from camtorque.fit.single import Fit
from camtorque.fit.solver import solve
from camtorque.fit.uncertainty import covariance
from camtorque.laws.chain import BINS
from camtorque.records import Refusal
from fit_cases import quick_prepared, rig

SPEEDS = (700.0, 900.0, 1200.0)
FAMILY = ("closed_volume", 3)


@pytest.fixture(scope="module")
def prepared():
    return [quick_prepared(*FAMILY, rpm) for rpm in SPEEDS]


@pytest.fixture(scope="module")
def solved(prepared):
    return solve_joint(prepared)


@pytest.fixture(scope="module")
def campaign(prepared, solved):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint_room, "solve_joint", lambda used: solved)  # the same three, solved once
        return fit_joint(prepared)


@pytest.fixture(scope="module")
def joint(prepared, solved):
    problem, solution = solved
    nothing = tuple(np.zeros((0, item.data.chain.theta.size)) for item in prepared)
    return Fit(
        problem, solution, covariance(problem, solution), {}, nothing, (), (), (),
        tuple(item.measured for item in prepared), (0.0,) * len(prepared),
    )  # fmt: skip


def test_shared_parameters_are_told_better_together(prepared, campaign):
    truth = rig(*FAMILY, SPEEDS[0]).truth
    rows = {row.name: row for row in campaign.shared_parameters}
    offset = np.degrees(truth.trigger.angle_offset)
    assert rows["trigger_offset"].ci95[0] < offset < rows["trigger_offset"].ci95[1]
    assert abs(rows["trigger_offset"].value - offset) < 0.15
    dead = 1e9 * truth.chamber.dead_volume
    assert rows["dead_volume"].ci95[0] < dead < rows["dead_volume"].ci95[1]
    single = covariance(prepared[1].candidates[0].problem, prepared[1].candidates[0].solution)
    place = prepared[1].candidates[0].problem.index("dead_volume")
    assert rows["dead_volume"].stderr_statistical < 1e9 * single.std[place]
    assert all(SEPARATOR not in name for name in rows)
    assert campaign.left_aside == ()
    assert len(campaign.fitted) == 3
    for record in campaign.fitted:
        assert record.metrics["fitted_held_out_cycles"].rms_percent_of_peak < 0.2
        own = {row.name for row in record.parameters if row.role == "own"}
        assert len({name.split(SEPARATOR)[1] for name in own}) == 1


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


def test_blind_end_of_delivery_does_not_know_the_recordings_own(joint):
    index = 1
    place = joint.problem.index(f"end_of_delivery{SEPARATOR}{joint.problem.data[index].name}")
    assert place >= 0
    z = joint.solution.z.copy()
    z[place] += np.radians(6.0)
    moved = replace(joint, solution=replace(joint.solution, z=z))
    found = predicted_end(joint, index)
    assert set(found) == {"end_of_delivery", "end_width"}
    assert predicted_end(moved, index) == found
    # but the neighbours' ends are what it is matched to
    z = z.copy()
    for other in (0, 2):
        z[joint.problem.index(f"end_of_delivery{SEPARATOR}{joint.problem.data[other].name}")] += np.radians(6.0)
    moved = replace(joint, solution=replace(joint.solution, z=z))
    assert predicted_end(moved, index)["end_of_delivery"] != found["end_of_delivery"]
    assert abs(found["end_of_delivery"] - joint.solution.z[place]) < np.radians(4.0)


def test_left_out_values_are_the_minimum_of_the_others_to_first_order(joint):
    index = 2
    found = left_out_values(joint, index)
    rest = build_problem([started_at(joint.problem, joint.solution, k) for k in (0, 1)])
    solution = solve(rest, rest.start, 12, joint.solution.lifts[:2])
    names = [slot.name for slot in joint.problem.slots]
    std = covariance(rest, solution).std
    for name in ("trigger_offset", "dead_volume", "shaft_compliance", "port_closing_lift"):
        k = rest.index(name)
        assert abs(found[names.index(name)] - solution.z[k]) < 1.0 * std[k], name
    own = [k for k, slot in enumerate(joint.problem.slots) if slot.recording == index]
    np.testing.assert_array_equal(found[own], joint.solution.z[own])


def test_the_error_of_the_laws_does_not_average_out(prepared):
    item = prepared[0].data
    assert common_error(item, 1).weight == pytest.approx(item.weight)
    wide = common_error(item, 5)
    law = (SMALLEST_SHARE * np.max(np.abs(item.torque))) ** 2 + (DISCREPANCY * np.abs(item.torque)) ** 2
    added = 1.0 / wide.weight**2 - 1.0 / item.weight**2
    np.testing.assert_allclose(added, 4.0 * law * BINS / INDEPENDENT, rtol=1e-9)


def test_bounds_of_shared_parameters_are_common(prepared):
    found = with_common_rows([item.data for item in prepared])
    for name, row in found[0].rows.items():
        if row.role == "shared":
            assert len({(item.rows[name].lower, item.rows[name].upper) for item in found}) == 1


def test_two_answers_at_one_speed_are_refused_and_not_averaged(prepared):
    one = prepared[0]
    refuse_two_states([one, prepared[1]])  # another speed
    best = one.candidates[0]
    z = best.solution.z.copy()
    place = best.problem.index("dead_volume")
    z[place] += 12.0 * covariance(best.problem, best.solution).std[place]
    changed = replace(best, solution=replace(best.solution, z=z), data=replace(best.data, name="after"))
    other = replace(one, candidates=(changed,))
    with pytest.raises(Refusal, match=r"and after run at one speed but differ in dead volume .* own `group`"):
        refuse_two_states([one, other])
    faster = replace(changed, data=replace(changed.data, chain=replace(changed.data.chain, speed=100.0)))
    refuse_two_states([one, replace(one, candidates=(faster,))])

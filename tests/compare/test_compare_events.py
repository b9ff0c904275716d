"""Events behind a difference of two recordings made from the model: found, and found where they are."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from camtorque.fit import pair as pair_module
from camtorque.fit.changes import (
    Attribution,
    EventSetMinimum,
    EventSetPosterior,
    attribution,
    evidence_with,
    fitted,
    freed,
    marginal,
    near_minimum,
)
from camtorque.fit.difference import along, evaluated, linearised, minimised, objective, step_within, turn_of_tooth
from camtorque.fit.events import CHANGES, STEPS_OF_CHANGE, basis_of, may_differ, two_ln_odds
from camtorque.fit.gains import GAINS
from camtorque.fit.pair import (
    COMMON_TIME_BASE,
    RESIDUAL_REACH,
    RESIDUAL_SHARE,
    TwoRecordings,
    _difference_weights,
    _slope,
    best_pair,
    shift_covariance,
)
from camtorque.fit.prepare import INDEPENDENT
from camtorque.fit.problem import with_rows
from camtorque.fit.residual import mean_square_about
from camtorque.fit.verdicts import HINTS, common_attributions, parameter_differences, pooled
from camtorque.laws.chain import BINS, ChainInput, ChainOutput, evaluate
from camtorque.process.second_process import Second, second_process
from camtorque.records import Array
from camtorque.units import DEGREE, angle_grid
from compare_pair import made_pair

BEGIN = Second.begin
LEAK, TURNED, SPRING = 3e-15, 0.3 * DEGREE, -0.06
RINGING = 1.5 * np.cos(90.0 * angle_grid(BINS)) * np.exp(-angle_grid(BINS))


@cache
def told(
    leak: float = 0.0, turned: float = 0.0, spring: float = 0.0, zero: float = 0.0, rate: float = 0.0
) -> tuple[Attribution, TwoRecordings]:
    return attribution(made_pair({
        "leakage": leak, "trigger_offset": turned, "spring_preload_error": spring, "torque_zero": zero,
        "spring_stiffness_error": rate,
    }))  # fmt: skip


@pytest.mark.parametrize(("truth", "found"), [
    ({}, ()), ({"zero": 0.05}, ()), ({"leak": LEAK}, ("leakage",)), ({"turned": TURNED}, ("trigger",)),
    ({"leak": LEAK, "spring": SPRING}, ("leakage", "spring")), ({"rate": -0.05}, ("spring_rate",)),
])  # fmt: skip
def test_the_event_behind_a_difference_is_found_and_no_other(truth: dict[str, float], found: tuple[str, ...]) -> None:
    assert told(**truth)[0].best == found
    assert (told(**truth)[0].unchanged > 0.5) == (not found)


@pytest.mark.parametrize(("torque", "pressure", "event"), [
    (0.01, 0.0, "torque_gain"), (-0.05, 0.0, "torque_gain"), (0.1, 0.0, "torque_gain"), (0.0, 0.03, "pressure_gain"),
    (0.0, -0.01, "pressure_gain"),
])  # fmt: skip
def test_the_gain_of_a_sensor_is_no_change_of_the_pump(torque: float, pressure: float, event: str) -> None:
    """A transducer 1 % off had been a preload and a fluid for certain, a pressure 3 % off a delivery valve."""
    found, pair = attribution(made_pair({}, gains=(torque, pressure)))
    assert found.best == (event,)
    [(name, row)] = [(row.name, row) for row in parameter_differences(pair, found) if row.verdict == "changed"]
    assert (name,) == CHANGES[event]
    assert row.difference == pytest.approx(100.0 * (torque + pressure), abs=3.0 * row.stderr)


def test_a_tooth_in_another_place_is_no_event() -> None:
    """The shaft twists between both teeth, and so does the cam against the angles of both recordings."""
    found, pair = attribution(made_pair({}, left=RINGING, tooth=25.0 * DEGREE))
    assert abs(turn_of_tooth(pair, found.state.outputs[0])) > 0.1 * DEGREE
    assert found.unchanged > 0.5


def test_a_trigger_that_is_declared_otherwise_is_off_by_something_else_and_no_event() -> None:
    """An encoder in the place of a tooth, 0.8 degrees from it: its own mounting tells nothing of a change."""
    pair = made_pair({"trigger_offset": 0.8 * DEGREE})
    assert attribution(pair)[0].best == ("trigger",)
    found, weighed = attribution(replace(pair, other_trigger=True))
    assert found.unchanged > 0.5
    assert found.moved("trigger_offset") == 0.0
    assert "trigger_offset" in found.names
    names = [row.name for row in parameter_differences(weighed, found)]
    assert "leakage" in names
    assert "trigger_offset" not in names, "it was told as not changed, by 0 with a standard error of 0"


def test_nothing_is_named_where_most_of_the_difference_is_left() -> None:
    found, pair = told(turned=TURNED)
    named = [row.name for row in parameter_differences(pair, found) if row.verdict == "changed"]
    assert named == ["trigger_offset"]
    left = replace(found, inflation=(1.0, 1.01 * HINTS))
    assert not [row for row in parameter_differences(pair, left) if row.verdict == "changed"]


@pytest.mark.parametrize(("load", "share"), [(1.0, RESIDUAL_SHARE), (1.01, RESIDUAL_SHARE), (1.03, 1.0), (0.97, 1.0)])
def test_what_the_laws_leave_is_another_one_at_another_load(load: float, share: float) -> None:
    pair, noise = made_pair({}), 1e-4 * np.eye(BINS)
    first, second = pair.items
    other = replace(second, chain=replace(second.chain, line_pressure=load * second.chain.line_pressure))
    loads = replace(pair, items=(first, other))
    of_left = [
        _difference_weights(loads, loads.fixed, noise, left)["difference_root"] for left in (RINGING, 0.0 * RINGING)
    ]
    apart = np.diag(of_left[0] @ of_left[0].T - of_left[1] @ of_left[1].T)
    np.testing.assert_allclose(
        apart, share**2 * mean_square_about(RINGING, RESIDUAL_REACH) * BINS / INDEPENDENT, rtol=1e-6
    )


@pytest.mark.skipif(sys.platform != "linux", reason="a fork beside threads is safe on Linux alone")
def test_two_processes_find_the_same_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    alone, _ = told(leak=LEAK)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    begun = []
    monkeypatch.setattr(Second, "begin", lambda self: begun.append(self) or BEGIN(self))
    with second_process():
        both, _ = attribution(made_pair({"leakage": LEAK}))
    assert begun
    assert both.probabilities == alone.probabilities
    assert np.array_equal(both.covariance, alone.covariance)
    assert np.array_equal(both.free_std, alone.free_std)


def test_differences_cover_what_was_changed() -> None:
    rows = {row.name: row for row in parameter_differences(told(leak=LEAK)[1], told(leak=LEAK)[0])}
    assert rows["leakage"].verdict == "changed"
    assert rows["leakage"].ci95[0] < LEAK / 1e-14 < rows["leakage"].ci95[1]
    assert rows["trigger_offset"].difference == pytest.approx(0.0, abs=rows["trigger_offset"].smallest_change)


@pytest.mark.parametrize(("size", "kind"), [(0.5, "cannot tell"), (2.0, "changed")])
def test_a_change_without_a_sign_is_not_told_with_its_size(size: float, kind: str) -> None:
    """Its interval is that of a logarithm, and went to -1.6e11."""
    found, pair = told(leak=LEAK)
    place = found.names.index("leakage")
    covariance = found.covariance.copy()
    covariance[place, place] = (found.mean[place] / size) ** 2
    rows = {row.name: row for row in parameter_differences(pair, replace(found, covariance=covariance))}
    assert rows["leakage"].verdict == kind


def test_no_value_is_stated_beyond_its_bounds() -> None:
    found, pair = told()
    far = replace(found, free_mean=found.free_mean - 1e3 * np.abs(found.free_std) - 1.0)
    rows = {row.name: row for row in parameter_differences(pair, far)}
    leakage = pair.items[0].rows["leakage"]
    assert rows["leakage"].after == pytest.approx(leakage.lower / leakage.per_unit)
    assert rows["leakage"].difference == pytest.approx(rows["leakage"].after - rows["leakage"].before)
    assert rows["leakage"].verdict == "cannot tell"


def test_a_step_of_the_model_is_not_taken_for_a_slope(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = made_pair({}, clock=COMMON_TIME_BASE)
    smooth = shift_covariance(pair, pair.fixed)
    at, jump = int(np.argmax(pair.items[0].chain.line_pressure)) + 2, 4.0
    level = pair.items[0].chain.line_pressure[at]

    def stepping(chain: ChainInput, values: dict[str, float], linear: Array) -> ChainOutput:
        output = evaluate(chain, values, linear)
        return replace(output, torque=output.torque + jump * (chain.line_pressure[at] > level))

    monkeypatch.setattr(pair_module, "evaluate", stepping)
    apart = np.abs(np.sqrt(np.diag(shift_covariance(pair, pair.fixed))) - np.sqrt(np.diag(smooth)))
    assert 0.0 < np.max(apart) <= 0.5 * jump + 1e-9


@pytest.mark.parametrize(("worse", "louder", "kept"), [(40.0, 0.3, 1), (200.0, 0.3, 0), (400.0, 3.0, 0)])
def test_a_minimum_that_says_nothing_of_the_difference_is_left_for_one_a_little_worse(
    worse: float, louder: float, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    roots = [np.eye(BINS) * np.exp(louder * 100.0 / BINS), np.eye(BINS)]
    starts = [SimpleNamespace(value=300.0), SimpleNamespace(value=300.0 + worse)]
    pair = made_pair({})
    monkeypatch.setattr(pair_module, "pair_of", lambda before, after, start: pair)
    monkeypatch.setattr(pair_module, "_weights", lambda bare: {"difference_root": roots[starts.index(bare[1])]})
    found = best_pair(SimpleNamespace(candidates=starts), None)  # type: ignore[arg-type]
    assert np.array_equal(found.difference_root, roots[kept])


def test_a_change_is_never_called_unchanged_above_the_smallest_stated() -> None:
    unchanged = {row.name: row for row in parameter_differences(told()[1], told()[0])}
    for size in (1.05, 2.0):
        leak = size * unchanged["leakage"].smallest_change * 1e-14
        rows = {row.name: row for row in parameter_differences(*reversed(told(leak=leak)))}
        assert rows["leakage"].verdict != "not changed"


def test_what_no_law_explains_stays_where_it_is_on_the_cam() -> None:
    found, _ = attribution(made_pair({"trigger_offset": TURNED}, RINGING))
    assert found.best == ("trigger",)
    assert found.inflation[1] == pytest.approx(1.0, abs=0.1)
    place = found.names.index("trigger_offset")
    assert found.mean[place] == pytest.approx(TURNED, abs=3.0 * np.sqrt(found.covariance[place, place]))


def test_the_start_of_a_file_is_no_event() -> None:
    late = 12e-6
    with_starts = made_pair({}, RINGING, COMMON_TIME_BASE, late)
    assert with_starts.own["delay_error"] == pytest.approx(8e-6 * np.sqrt(2.0))
    assert attribution(with_starts)[0].best == ()
    one_clock = made_pair({}, RINGING, late=late)
    assert "delay_error" not in one_clock.own
    assert attribution(one_clock)[0].best != ()


@pytest.mark.parametrize("unread", [0, 1], ids=["before", "after"])
def test_a_zero_that_one_of_both_did_not_read_is_no_event(unread: int) -> None:
    """A shift of 2 N m is two standard deviations of a zero without readings, whichever recording comes first."""
    pair = made_pair({"torque_zero": 2.0})
    items = list(pair.items)
    items[unread] = with_rows(items[unread], {"torque_zero": {"prior": (0.0, 1.0), "lower": -30.0, "upper": 30.0}})
    pair = replace(pair, items=tuple(items))
    assert pair.own["torque_zero"] == pytest.approx(1.0, rel=0.1)
    assert pair.bounds[1][pair.names.index("torque_zero")] == pytest.approx(30.0)
    assert attribution(pair)[0].best == ()


@pytest.mark.parametrize("name", ["trigger_offset", "delay_error", "leakage"])
def test_derivatives_of_the_difference_are_those_of_finite_steps(name: str) -> None:
    pair = made_pair({}, RINGING, COMMON_TIME_BASE)
    values = np.array([pair.fixed[key] for key in pair.names])
    k = pair.names.index(name)
    step = 1e-3 * pair.items[0].rows[name].step
    basis = replace(basis_of(pair, values, ()), labels=(("", name),), columns=np.eye(len(pair.names))[:, [k]] * step)
    ends = [evaluated(pair, values, basis, np.array([way])).residuals[1] for way in (-1.0, 1.0)]
    state = evaluated(pair, values, basis, np.zeros(1))
    expected = -((state.jacobians[1] + state.turned) @ basis.columns)[:, 0]
    assert 0.5 * (ends[1] - ends[0]) == pytest.approx(expected, abs=2e-3 * np.max(np.abs(expected)))


@pytest.mark.parametrize("name", GAINS)
def test_a_gain_moves_the_second_recording_alone_and_as_linearised(name: str) -> None:
    """Pressure, twist and torque at once, read at the angle of the first; the secant over 0.3 % is that over 0.15 %."""
    pair = made_pair({}, RINGING, tooth=25.0 * DEGREE)
    values = np.array([pair.fixed[key] for key in pair.names])
    basis = basis_of(pair, values, [group for group, names in CHANGES.items() if names == (name,)])
    start = np.zeros(len(basis.labels))
    states = [evaluated(pair, values, basis, start + np.eye(start.size)[-1] * way) for way in (0.0, 0.05)]
    assert np.array_equal(states[0].residuals[0], states[1].residuals[0])
    expected = (states[0].residuals[1] - states[1].residuals[1]) / 0.05
    derivatives, _ = linearised(pair, states[0], basis.columns)
    found = pair.difference_root @ derivatives[BINS:, -1]
    np.testing.assert_allclose(found, expected, atol=0.01 * np.max(np.abs(expected)))


def test_evidence_of_a_small_change_is_that_foreseen() -> None:
    pair = made_pair({"leakage": 5e-18})
    values = np.array([pair.fixed[name] for name in pair.names])
    start = evaluated(pair, values, basis_of(pair, values, ()), np.zeros(len(pair.own)))
    none = fitted(pair, (start, (), 20))
    both = fitted(pair, (minimised(pair, none.state, 5), ("leakage",), 20))
    assert evidence_with(pair, none, "leakage") == pytest.approx(both.two_ln_evidence, abs=0.3)


def test_a_large_change_grows_to_its_size_before_what_is_common_moves() -> None:
    pair = made_pair({"leakage": 20.0 * LEAK})
    values = np.array([pair.fixed[name] for name in pair.names])
    own, event = basis_of(pair, values, ()), basis_of(pair, values, ("leakage",))
    here = evaluated(pair, values, own, np.zeros(len(own.labels)))
    alone = minimised(pair, along(pair, here, event), 20, common=False)
    assert alone.before == pytest.approx(values), "what is common stays"
    state = near_minimum(pair, here, event)
    least = objective(pair, minimised(pair, state, 60))
    at = pair.names.index("leakage")
    assert (state.after - state.before)[at] == pytest.approx(20.0 * LEAK, rel=0.02)
    assert objective(pair, state) == pytest.approx(least, rel=1e-3)
    found, _ = attribution(pair)
    assert (found.best, found.inflation[1]) == (("leakage",), pytest.approx(1.0, abs=0.1))


def test_integrating_out_is_conditioning_on_nothing() -> None:
    rng = np.random.default_rng(2)
    design = rng.standard_normal((30, 5))
    matrix, vector = design.T @ design, design.T @ rng.standard_normal(30)
    left, rest = marginal(matrix, vector, 2)
    assert np.linalg.inv(left) == pytest.approx(np.linalg.inv(matrix)[2:, 2:])
    assert np.linalg.solve(left, rest) == pytest.approx(np.linalg.solve(matrix, vector)[2:])


def test_pairs_of_a_campaign_share_their_events() -> None:
    def of(scores: dict[tuple[str, ...], float]) -> Attribution:
        sets = tuple(EventSetPosterior(g, s, np.zeros(1), np.eye(1)) for g, s in scores.items())
        state = told()[0].state
        return Attribution(("leakage",), sets, (), np.zeros(1), np.eye(1), np.zeros(1), np.ones(1), (1.0, 1.0), state)

    odds = two_ln_odds(("leakage",))
    joined = common_attributions(
        [of({(): 0.0, ("leakage",): 3.0 + odds}), of({(): 0.0, ("leakage",): 4.0 + odds, ("spring",): -60.0})],
        [told()[1]] * 2,
    )
    assert joined[0].best == ("leakage",)
    assert joined[0].hypotheses[0].groups == joined[1].hypotheses[0].groups
    assert joined[0].moved("leakage") == pytest.approx(1.0 / (1.0 + np.exp(-0.5 * (7.0 + odds))), rel=1e-3)


def test_a_pair_that_says_nothing_of_a_change_does_not_say_that_it_is_zero() -> None:
    """Its 0 ± 0 had all the weight: 'leakage changed: 0.0000 ± 0.0000' where the other pair told how much."""
    pair, names = told()[1], ("leakage", "spring_preload_error")

    def of(leak: float, std: float, sets: dict[tuple[str, ...], float]) -> Attribution:
        moves = {True: (np.array([leak, 0.0]), np.diag([std**2, 0.0])), False: (np.zeros(2), np.zeros((2, 2)))}
        found = tuple(EventSetPosterior(g, s, *moves["leakage" in g]) for g, s in sets.items())
        state, none = told()[0].state, np.zeros(2)
        return Attribution(names, found, (), none, np.eye(2), none, np.ones(2), (1.0, 1.0), state)

    clear = of(LEAK, 0.05 * LEAK, {("leakage", "spring"): 90.0, ("leakage",): 0.0, ("spring",): 0.0, (): 0.0})
    silent = of(0.0, 0.0, {("spring",): 20.0, (): 0.0})
    joined = common_attributions([clear, silent], [pair, pair])
    assert set(joined[0].best) == {"leakage", "spring"}
    rows = [next(row for row in parameter_differences(pair, one) if row.name == "leakage") for one in joined]
    row = pair.items[0].rows["leakage"]
    assert rows[1].stderr == pytest.approx(STEPS_OF_CHANGE * row.step / row.per_unit, rel=1e-3)
    assert pooled(rows).difference == pytest.approx(LEAK / row.per_unit, rel=0.05)
    assert pooled(rows).stderr == pytest.approx(0.05 * LEAK / row.per_unit, rel=0.05)


@pytest.mark.parametrize(("common", "moved", "wanted"), [
    (0.5, 0.5, (0.0, 0.3)), (0.5, -0.5, (0.0, -0.3)), (1.0, 0.0, (0.3, 0.0)), (0.0, 0.0, (-0.3, 0.0)),
])  # fmt: skip
def test_a_step_never_leaves_the_bounds_of_either_recording(
    common: float, moved: float, wanted: tuple[float, float]
) -> None:
    pair = SimpleNamespace(names=("one",), priors=(None, np.ones(1)), bounds=(np.zeros(1), np.ones(1)))
    state = SimpleNamespace(before=np.array([common]), after=np.array([common + moved]), moved=np.array([moved]),
                            basis=SimpleNamespace(columns=np.ones((1, 1))))  # fmt: skip
    assert step_within(np.eye(2), np.array(wanted), pair, state).tolist() == [0.0, 0.0]  # type: ignore[arg-type]
    back = step_within(np.eye(2), -np.array(wanted), pair, state)  # type: ignore[arg-type]
    np.testing.assert_allclose(back, -np.array(wanted))


def test_slope_in_time_of_a_signal_over_the_cam_angle() -> None:
    angle, speed = angle_grid(3600), 50.0
    np.testing.assert_allclose(_slope(np.sin(3.0 * angle), speed), 3.0 * speed * np.cos(3.0 * angle), atol=1e-3)


def test_what_is_each_recordings_own_is_not_counted_as_an_event_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """How far the trigger may have moved does not hang on whether its own error has taken that already."""
    monkeypatch.setattr(TwoRecordings, "own", {"trigger_offset": 0.05 * DEGREE})
    pair, groups = made_pair({"trigger_offset": 0.04 * DEGREE}), ["trigger", "leakage", "spring"]
    values, names = np.array([pair.fixed[name] for name in pair.names]), may_differ(pair)
    before = evaluated(pair, values, basis_of(pair, values, ()), np.zeros(1))
    taken = minimised(pair, before, 20)
    assert taken.moved[0] * 0.05 > 0.03, "the own error has taken most of the difference"
    place = names.index("trigger_offset")
    moved, std = zip(
        *(freed(pair, EventSetMinimum((), at, np.eye(1), 0.0), names, groups) for at in (before, taken)), strict=True
    )
    assert moved[1][place] == pytest.approx(moved[0][place], abs=0.1 * float(std[0][place]))

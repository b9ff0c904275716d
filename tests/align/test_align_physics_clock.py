"""A logger without a trigger, tied to the other by torque and pressure; a file whose own time jumps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from align_truth import TWO_PI, LogClock, Rig, Samples, angle_error_deg, lift_of, make, pressure_of, torque_of
from camtorque.align import align
from camtorque.records import Recording, Refusal
from camtorque.signal.logger_time import pause_intervals, sample_positions, sample_times

CLOCK = LogClock(-0.42, 65e-6, 0.35)


def pump_torque(theta: np.ndarray) -> np.ndarray:
    """Line pressure on a plunger of 50 mm^2 times lift velocity while the lift rises, the spring on the return."""
    velocity = (lift_of(np.mod(theta + 1e-4, TWO_PI)) - lift_of(np.mod(theta - 1e-4, TWO_PI))) / 2e-4
    return np.where(velocity > 0.0, 5.0e-5 * pressure_of(theta) * velocity, 600.0 * velocity) + 1.0


RIG = Rig(
    clock_kind="independent",
    clocks={"B": CLOCK},
    torque_noise=0.3,
    pressure_noise=1.0e5,
    duration=8.0,
    scatter=0.01,
    torque_law=pump_torque,
)


def without(recording: Recording, name: str) -> Recording:
    return replace(recording, channels=tuple(c for c in recording.channels if c.name != name))


@pytest.mark.parametrize("lost", ["trigger", "trigger_b"])
def test_clock_without_trigger_from_torque_and_pressure(lost: str) -> None:
    cycles = align(without(make(RIG), lost))
    assert [c.method for c in cycles.clocks if c.logger == "A"] == ["reference"]
    fit = next(c for c in cycles.clocks if c.logger == "B")
    assert fit.method == "torque and pressure"
    middle = 4.0
    found = fit.offset_s + 1e-6 * fit.skew_ppm * middle
    assert abs(found - CLOCK.offset - CLOCK.skew * middle) < 2.0 * fit.stderr_s
    assert {f.code for f in cycles.findings if f.severity != "info"} == {"clock_from_physics"}


def edited(recording: Recording, quantity: str, change: Callable[[np.ndarray], np.ndarray]) -> Recording:
    channels = tuple(
        replace(c, source=Samples(change(c.source.values.copy()))) if c.quantity == quantity else c
        for c in recording.channels
    )
    return replace(recording, channels=channels)


def without_one_sample(values: np.ndarray) -> np.ndarray:
    values[values.size // 2] = np.nan
    return values


@pytest.mark.parametrize("lost", ["trigger", "trigger_b"])
@pytest.mark.parametrize("change", [np.negative, without_one_sample])
def test_an_inverted_torque_and_a_missing_sample_leave_the_clock_as_it_is(
    lost: str, change: Callable[[np.ndarray], np.ndarray]
) -> None:
    cycles = align(edited(without(make(RIG), lost), "torque", change))
    fit = next(c for c in cycles.clocks if c.logger == "B")
    found = fit.offset_s + 1e-6 * fit.skew_ppm * 4.0
    assert abs(found - CLOCK.offset - CLOCK.skew * 4.0) < 2.0 * fit.stderr_s
    codes = {f.code for f in cycles.findings if f.severity != "info"}
    assert codes == {"clock_from_physics"} | ({"torque_inverted"} if change is np.negative else set())
    assert np.mean(cycles.torque) > 0.0


def test_cycles_that_all_lack_samples_tie_no_clock() -> None:
    def holed(values: np.ndarray) -> np.ndarray:
        values[::500] = np.nan
        return values

    with pytest.raises(Refusal, match="found 0 whole revolutions in common"):
        align(edited(without(make(RIG), "trigger_b"), "pressure", holed))


def test_equal_revolutions_leave_the_lag_open() -> None:
    cycles = align(without(make(replace(RIG, scatter=0.0)), "trigger_b"))
    assert {f.code for f in cycles.findings if f.severity != "info"} == {"clock_from_physics", "clock_lag_ambiguous"}


def test_constant_speed_leaves_the_pulse_lag_open() -> None:
    steady = replace(RIG, shaft=replace(RIG.shaft, wander=0.0))
    findings = {f.code: f.text for f in align(make(steady)).findings if f.severity != "info"}
    assert set(findings) == {"clock_lag_ambiguous"}
    assert "logarithm of the odds" in findings["clock_lag_ambiguous"]


def test_logger_with_nothing_in_common_is_refused() -> None:
    recording = without(make(RIG), "trigger_b")
    pressure_only = replace(recording, channels=recording.channels[1:])
    with pytest.raises(Refusal, match="logger 'B' has its own clock, recorded no trigger and shares neither"):
        align(pressure_only)


@pytest.mark.parametrize("samples", [1, 9, 10, 300])
def test_a_few_samples_without_a_trigger_are_refused(samples: int) -> None:
    recording = edited(without(make(RIG), "trigger_b"), "pressure", lambda values: values[:samples])
    with pytest.raises(Refusal, match="found 0 whole revolutions in common with logger 'A'"):
        align(recording)


def test_too_short_a_recording_is_refused() -> None:
    with pytest.raises(Refusal, match=r"revolutions in common .* expected at least 5"):
        align(without(make(replace(RIG, duration=0.5, clocks={})), "trigger_b"))


def paused(rig: Rig, quantity: str, at: float, pause: float) -> Recording:
    """A recording whose channel lost ``pause`` seconds at a part of its length, and whose file says so."""
    channels = []
    for c in make(rig).channels:
        if quantity in (c.quantity, "all"):
            first, n = int(at * c.n_samples), round(pause * c.sample_rate)
            c = replace(
                c,
                source=Samples(np.delete(c.source.values, slice(first, first + n))),
                breaks=(first,),
                break_steps=(n / c.sample_rate,),
            )
        channels.append(c)
    return replace(make(rig), channels=tuple(channels))


@pytest.mark.parametrize("quantity", ["torque", "pressure", "all"])
@pytest.mark.parametrize("pause", [0.03, 0.5])
def test_pause_of_a_file_costs_its_cycles_only(quantity: str, pause: float) -> None:
    cycles = align(paused(Rig(torque_noise=0.3, pressure_noise=1.0e5), quantity, 0.5, pause))
    reasons = {row.reason: row.cycles for row in cycles.cut_flow if row.cycles and row.reason != "incomplete"}
    # A pause of 0.03 s lies in one revolution of 0.12 s or two, one of 0.5 s in five or six; and the trigger's own
    # pulse intervals on either side when it stops too.
    assert sum(reasons.values()) <= (2 if pause < 0.1 else 6) + 1
    assert "clock_jump" in reasons
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05
    assert abs(angle_error_deg(cycles.pressure, pressure_of, cycles.theta)) < 0.05


def test_clock_set_back_is_left_out_of_the_time() -> None:
    recording = make(Rig(torque_noise=0.3, pressure_noise=1.0e5))
    channels = tuple(replace(c, breaks=(c.n_samples // 2,), break_steps=(-1.5,)) for c in recording.channels)
    cycles = align(replace(recording, channels=channels))
    assert 30 <= len(cycles.index) < cycles.cycles_found
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05


def test_positions_invert_times_across_pauses() -> None:
    channel = replace(make(Rig(duration=0.3)).channels[0], breaks=(100, 2000), break_steps=(0.25, 0.5))
    position = np.array([0.0, 50.5, 99.0, 100.0, 1500.25, 2000.0, 2500.0])
    np.testing.assert_allclose(sample_positions(channel, sample_times(channel, position)), position, atol=1e-8)
    begin, end = pause_intervals(channel).T
    step = 1.0 / channel.sample_rate
    np.testing.assert_allclose(end - begin, [0.25 + step, 0.5 + step])
    np.testing.assert_allclose(sample_positions(channel, 0.5 * (begin + end)), [100.0, 2000.0], atol=1.0)

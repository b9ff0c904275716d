"""What was put into a log by closed formulas comes back out of the aligner."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from align_truth import LogClock, Rig, Samples, Shaft, angle_error_deg, make, pressure_of, torque_of, trigger_channel
from camtorque.align import AlignOptions, align, angle
from camtorque.align import channels as aligned_channels
from camtorque.align.budget import RESAMPLING_DEG
from camtorque.align.timebase import time_base
from camtorque.records import Channel
from camtorque.signal import edges as edge_search
from camtorque.signal.edges import find_edges
from hypothesis import given, settings
from hypothesis import strategies as st

ANGLE_DEG = 0.05
"""The requirement on the trigger angle."""
NOISY = Rig(torque_noise=0.3, pressure_noise=1.0e5)


def angle_errors(cycles) -> tuple[float, float]:
    return (
        angle_error_deg(cycles.torque, torque_of, cycles.theta),
        angle_error_deg(cycles.pressure, pressure_of, cycles.theta),
    )


@pytest.mark.parametrize("rpm", [150.0, 300.0, 500.0, 1250.0, 3000.0])
def test_angle_is_recovered_over_speed(rpm: float) -> None:
    cycles = align(make(replace(NOISY, shaft=Shaft(rpm=rpm), duration=2400.0 / rpm)))
    assert np.max(np.abs(angle_errors(cycles))) < ANGLE_DEG


@pytest.mark.parametrize(
    ("torque_rate", "pressure_rate", "trigger_rate"), [(10e3, 20e3, 20e3), (20e3, 100e3, 50e3), (5e3, 5e3, 100e3)]
)
def test_angle_is_recovered_at_unequal_rates(torque_rate: float, pressure_rate: float, trigger_rate: float) -> None:
    rig = replace(NOISY, torque_rate=torque_rate, pressure_rate=pressure_rate, trigger_rate=trigger_rate)
    assert np.max(np.abs(angle_errors(align(make(rig))))) < ANGLE_DEG


@settings(max_examples=15, deadline=None)
@given(
    rpm=st.floats(250.0, 1500.0),
    start=st.floats(0.0, 6.28),
    nominal=st.floats(0.0, 359.0),
    delay_us=st.floats(0.0, 900.0),
    switching_us=st.floats(0.0, 200.0),
    flank_us=st.floats(20.0, 400.0),  # a shorter one is known to a sample only: 0.4 degrees at 1411 rpm
)
def test_angle_is_recovered_whatever_the_mounting_and_delays(
    rpm: float, start: float, nominal: float, delay_us: float, switching_us: float, flank_us: float
) -> None:
    rig = replace(
        NOISY, shaft=Shaft(rpm=rpm, start=start), nominal_deg=nominal, torque_delay=1e-6 * delay_us, duration=1.5,
        switching_delay=1e-6 * switching_us, flank=1e-6 * flank_us,
    )  # fmt: skip
    cycles = align(make(rig))
    assert np.max(np.abs(angle_errors(cycles))) < ANGLE_DEG


def test_each_cycle_holds_its_own_signal() -> None:
    cycles = align(make(Rig(shaft=Shaft(wander=1e-3))))
    # Without noise only the speed between two pulses is unknown: 0.1 % wander at 0.37 Hz moves the middle of a
    # revolution by up to 0.013 degrees, 0.04 N m on the steepest flank of 3 N m per degree.
    assert np.max(np.abs(cycles.torque - torque_of(cycles.theta))) < 0.04


def test_smooth_speed_beats_constant_speed_between_pulses(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = make(Rig(shaft=Shaft(wander=1e-3)))

    def error() -> float:
        return float(np.sqrt(np.mean((align(recording).torque - torque_of(grid(3600))) ** 2)))

    smooth = error()
    monkeypatch.setattr(angle, "hermite_slopes", lambda turned, time, _: 2 * (np.diff(time) / np.diff(turned),))
    assert smooth < 0.5 * error()


def test_cubic_beats_linear_where_samples_are_coarser_than_the_grid() -> None:
    rig = Rig(shaft=Shaft(wander=0.0), torque_rate=10e3, trigger_rate=100e3, trigger_noise=0.0)
    recording = make(rig)
    error = {
        rule: np.max(np.abs(align(recording, AlignOptions(interpolation=rule)).torque - torque_of(grid(3600))))
        for rule in ("linear", "cubic")
    }
    assert error["cubic"] < 0.1 * error["linear"]


def test_averaging_lowers_the_noise_of_fine_samples() -> None:
    rig = replace(NOISY, pressure_rate=200e3, duration=1.5)
    recording = make(rig)
    noise = {
        rule: np.std(align(recording, AlignOptions(interpolation=rule)).pressure - pressure_of(grid(3600)))
        for rule in ("auto", "cubic")
    }
    # 6.7 samples per grid step: the mean of the linear interpolant has about a 2.5th of the noise of one sample.
    assert noise["auto"] < 0.55 * noise["cubic"]


@pytest.mark.parametrize("rate", [5e3, 10e3, 20e3, 50e3, 200e3])
@pytest.mark.parametrize("rpm", [300.0, 1250.0])
def test_resampling_shifts_no_angle(rate: float, rpm: float) -> None:
    rig = Rig(
        shaft=Shaft(rpm=rpm, wander=0.0), torque_rate=rate, pressure_rate=rate, trigger_rate=200e3, trigger_noise=0.0,
        duration=1.2,
    )  # fmt: skip
    assert np.max(np.abs(angle_errors(align(make(rig))))) < RESAMPLING_DEG


def grid(n: int) -> np.ndarray:
    return np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)


def test_wheel_sees_the_ripple_that_one_pulse_per_revolution_does_not() -> None:
    shaft = Shaft(ripple=0.01, order=2)
    wheel = align(make(Rig(shaft=shaft, pulses_per_rev=60, missing_teeth=2, trigger_rate=50e3)))
    pulse = align(make(Rig(shaft=shaft)))
    assert np.max(np.abs(angle_errors(wheel))) < 0.01
    # 1 % of order 2 is an angle error of up to 0.29 degrees each way.
    assert np.max(np.abs(angle_errors(pulse))) > ANGLE_DEG


@pytest.mark.parametrize(
    "wheel",
    [
        {"pulses_per_rev": 60, "missing_teeth": 2},
        {"pulses_per_rev": 36, "missing_teeth": 1},
        {"pulses_per_rev": 36, "double_tooth": True},
    ],
)
def test_wheels_are_read_from_their_mark(wheel: dict) -> None:
    cycles = align(make(replace(NOISY, trigger_rate=50e3, **wheel)))
    assert np.max(np.abs(angle_errors(cycles))) < ANGLE_DEG


@settings(max_examples=8, deadline=None)
@given(skew_ppm=st.floats(-100.0, 100.0), offset=st.floats(-5.0, 5.0), late=st.floats(0.0, 1.0))
def test_independent_clocks_are_recovered(skew_ppm: float, offset: float, late: float) -> None:
    clock = LogClock(offset, 1e-6 * skew_ppm, late)
    rig = replace(NOISY, clock_kind="independent", clocks={"B": clock}, duration=6.0)
    cycles = align(make(rig))
    fit = next(c for c in cycles.clocks if c.logger == "B")
    # The offset holds at t = 0, the begin of the reference: its error is that of an end of the line.
    assert abs(fit.offset_s - offset) < 20e-6
    assert abs(fit.skew_ppm - skew_ppm) < 5.0
    assert np.max(np.abs(angle_errors(cycles))) < ANGLE_DEG


def test_clock_over_a_minute_within_a_ppm_and_twenty_microseconds() -> None:
    clock = LogClock(-0.42, 65e-6, 0.35)
    rig = replace(
        NOISY, clock_kind="independent", clocks={"B": clock}, duration=60.0, torque_rate=5e3, pressure_rate=20e3,
        edge_jitter=5e-6,
    )  # fmt: skip
    fit = align(make(rig), AlignOptions(n_theta=720)).clocks[-1]
    assert abs(fit.offset_s + 0.42) < 20e-6
    assert abs(fit.skew_ppm - 65.0) < 1.0
    assert abs(fit.offset_s + 0.42) < 5.0 * fit.stderr_s


def test_a_pulse_that_two_loggers_saw_has_the_noise_of_their_mean() -> None:
    rig = replace(NOISY, clock_kind="independent", clocks={"B": LogClock(0.1, 20e-6)}, duration=6.0)
    base = time_base(make(rig), "A")
    one, other = (base.triggers[logger].edges.noise for logger in ("A", "B"))
    assert base.edge_noise == pytest.approx((one**-2.0 + other**-2.0) ** -0.5)
    assert base.edge_noise < min(one, other)


def test_two_loggers_without_any_noise_are_fused() -> None:
    recording = make(Rig(clock_kind="independent", trigger_noise=0.0, flank=3e-4))
    quiet = tuple(
        replace(c, source=Samples(np.round(c.source.values - 0.06, 6))) if c.quantity == "trigger" else c
        for c in recording.channels
    )
    recording = replace(recording, channels=quiet)
    base = time_base(recording, "A")
    assert [base.triggers[logger].edges.noise for logger in ("A", "B")] == [0.0, 0.0]
    assert base.edge_noise < 1e-9
    assert np.max(np.abs(angle_errors(align(recording)))) < ANGLE_DEG


def test_a_pulse_that_one_logger_missed_is_where_the_other_saw_it() -> None:
    rig = replace(NOISY, clock_kind="independent", clocks={"B": LogClock(0.1, 20e-6)}, duration=6.0, edge_jitter=2e-4)
    recording = make(rig)
    seen = time_base(recording, "A")
    missed = seen.triggers["B"].train.time[20] - recording.of("trigger")[1].start_time

    def without(c: Channel) -> Channel:
        volts = c.source.values.copy()
        middle = round(missed * c.sample_rate)
        volts[middle - 200 : middle + 600] = np.min(volts)
        return replace(c, source=Samples(volts))

    other = recording.of("trigger")[1]
    assert other.logger == "B"
    channels = tuple(without(c) if c is other else c for c in recording.channels)
    base = time_base(replace(recording, channels=channels), "A")
    assert list(np.flatnonzero(base.triggers["B"].train.repaired)) == [20]
    at = int(np.argmin(np.abs(seen.train.time - seen.clocks["B"].to_reference(seen.triggers["B"].train.time[20:21]))))
    alone = base.triggers["A"].train.time
    assert base.train.time[at] == alone[at]
    assert np.all(np.delete(base.train.time, at) != np.delete(alone, at))


def test_synchronised_loggers_keep_their_own_start() -> None:
    rig = replace(NOISY, clock_kind="synchronised", clocks={"B": LogClock(begin=0.27)})
    cycles = align(make(rig))
    assert np.max(np.abs(angle_errors(cycles))) < ANGLE_DEG
    assert [c.method for c in cycles.clocks] == ["reference", "common time base"]


@pytest.mark.parametrize(("rate", "best_us"), [(10e3, 10.0), (20e3, 1.0), (50e3, 0.5), (100e3, 0.5)])
def test_edge_times_are_right_within_their_standard_error(rate: float, best_us: float) -> None:
    rig = Rig(trigger_noise=0.03, duration=8.0, trigger_rate=rate)
    channel = trigger_channel(rig)
    edges = find_edges(channel, "rising")
    truth = rig.pulse_times() + rig.switching_delay
    nearest = truth[np.argmin(np.abs(edges.time[:, None] - truth[None, :]), axis=1)]
    error = edges.time - nearest
    # A flank of 60 us sampled every 50 us: linear interpolation alone leaves 1.7 us rms; every 100 us, four in ten
    # edges show no sample on it and lie anywhere within 40 us.
    rms = np.sqrt(np.mean(error**2))
    assert rms < 1e-6 * best_us
    assert 0.4 * rms < edges.noise < 2.5 * rms


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = make(NOISY)
    whole = align(recording)
    monkeypatch.setattr(aligned_channels, "BLOCK", 1024)
    monkeypatch.setattr(edge_search, "BLOCK", 2048)
    pieces = align(recording)
    np.testing.assert_array_equal(whole.index, pieces.index)
    # The plateaus of edges are pooled within a block: edge times may differ by their noise.
    np.testing.assert_allclose(pieces.torque, whole.torque, atol=0.02)

"""Wheels of all kinds, tooth by tooth against the truth: the stated error lies between one and two times the actual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from align_truth import TWO_PI, Samples, Shaft, angle_error_deg, pressure_of, torque_of
from camtorque.align import align
from camtorque.align.sources import trigger_trains
from camtorque.align.timebase import time_base
from camtorque.fit.prepare import cam_swing, over_even_angle
from camtorque.laws.swing import swing_of
from camtorque.records import DEVIATION, LEAD, PASSED, Refusal
from camtorque.signal.inductive import NEIGHBOURS, find_crossings
from scipy.signal import lfilter
from wheel_truth import Wheel, index_volts, judged, pulse_channel, true_deviation, wheel_recording, wheel_volts

SEEDS = (1, 2, 3, 4)
WHEELS = {
    "60-2": Wheel(),
    "36-2": Wheel(teeth=36),
    "60-1": Wheel(missing=1),
    "36-1": Wheel(teeth=36, missing=1),
    "12-1": Wheel(teeth=12, missing=1),
    "60-2 inductive": Wheel(kind="inductive", edge="falling"),
    "36-2 inductive": Wheel(kind="inductive", edge="falling", teeth=36),
    "60-2 inductive, ten samples a tooth": Wheel(kind="inductive", edge="falling", rate=6e3),
    "60-2 on the crank, index": Wheel(turns=2, index=True),
    "60 and index": Wheel(missing=0, index=True),
    "36-2 on the crank, index": Wheel(teeth=36, turns=2, index=True),
    "4 and index": Wheel(teeth=4, missing=0, index=True),
    "8 and index": Wheel(teeth=8, missing=0, index=True),
    "24 and index": Wheel(teeth=24, missing=0, index=True),
    "4+1": Wheel(teeth=4, missing=0, extra=0.3),
    "four lobes": Wheel(shaft=Shaft(rpm=600.0, ripple=0.01, order=4)),
    "100 rpm": Wheel(shaft=Shaft(rpm=100.0, ripple=0.02), duration=8.0, rate=10e3),
    "6000 rpm": Wheel(shaft=Shaft(rpm=6000.0, ripple=0.005), duration=1.0, rate=200e3),
}


@pytest.mark.parametrize("name", WHEELS)
def test_error_of_every_tooth_is_stated(name: str) -> None:
    wheels = [replace(WHEELS[name], seed=seed) for seed in SEEDS]
    found = [judged(wheel, wheel_recording(wheel)) for wheel in wheels]
    actual = np.sqrt(np.mean([np.mean(item.error**2) for item in found]))
    stated = np.sqrt(np.mean([np.mean(item.stated**2) for item in found]))
    assert 1.0 < stated / actual < 2.0
    # five standard errors: no tooth is far from what is stated for it
    assert all(np.max(np.abs(item.error) / item.stated) < 5.0 for item in found)


def test_two_teeth_at_a_part_of_a_revolution_are_a_wheel_with_missing_teeth() -> None:
    for teeth in (6, 4):
        cycles = align(wheel_recording(Wheel(teeth=teeth, missing=teeth - 2)))
        assert cycles.index.size > 20
        assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.2


@pytest.mark.parametrize(
    "wheel",
    [Wheel(teeth=6, missing=4, error_deg=0.0), Wheel(teeth=2, missing=0, index=True, index_at=0.0, error_deg=0.0)],
)
def test_pulses_too_few_for_the_speed_do_not_bend_the_cam_angle(wheel: Wheel) -> None:
    """What they see of the swing of the shaft a fit rebuilds from the torque: it would be corrected twice."""
    found = align(wheel_recording(wheel))
    (told,) = (finding for finding in found.findings if finding.code == "few_teeth")
    assert "2 pulses per turn of the cam do not show how the speed varies within it, 4 or more do" in told.text
    assert "ripple_unseen" in {finding.code for finding in found.findings}
    alone = align(wheel_recording(replace(wheel, teeth=1, missing=0, index=False)))
    assert np.sqrt(np.mean((found.mean_torque - alone.mean_torque) ** 2)) < 0.002 * np.ptp(alone.mean_torque)


@pytest.mark.parametrize("name", ["60-2", "36-2 inductive", "60 and index", "four lobes"])
def test_deviation_from_even_running_is_handed_on_with_its_error(name: str) -> None:
    errors, stated = [], []
    for seed in SEEDS:
        wheel = replace(WHEELS[name], seed=seed)
        cycles = align(wheel_recording(wheel))
        truth = true_deviation(wheel.shaft, cycles.theta)
        error = cycles.details["angle_deviation"] - (truth - truth.mean())
        errors.append(np.mean(error**2))
        stated.append(np.mean(cycles.details["angle_deviation_std"] ** 2))
        assert np.sqrt(errors[-1]) < 0.3 * np.std(truth)
        assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05
        assert "ripple_unseen" not in {finding.code for finding in cycles.findings}
    assert 1.0 < np.sqrt(np.mean(stated) / np.mean(errors)) < 2.0


def test_two_teeth_say_how_far_the_cam_leads_between_them() -> None:
    shaft = Shaft(rpm=600.0, ripple=0.05, order=1, wander=0.0)
    wheel = Wheel(shaft=shaft, teeth=6, missing=4, error_deg=0.0)
    cycles = align(wheel_recording(wheel))
    first, second = shaft.time_of(np.radians(wheel.nominal_deg) + TWO_PI * (3.0 + np.array([0.0, 1.0 / 6.0])))
    even = (second - first) * shaft.speed
    assert cycles.details[PASSED] == pytest.approx(np.array([[even, TWO_PI / 6.0 - even, 0.0]]), abs=3e-5)
    assert abs(TWO_PI / 6.0 - even) > 0.02


@pytest.mark.parametrize(("teeth", "told"), [(4, 1), (8, 3), (24, 11)])
def test_few_teeth_tell_no_order_that_they_do_not_see(teeth: int, told: int) -> None:
    wheel = Wheel(teeth=teeth, missing=0, index=True, shaft=Shaft(rpm=600.0, ripple=0.05, order=1))
    deviation = np.abs(np.fft.rfft(align(wheel_recording(wheel)).details["angle_deviation"]))
    assert np.flatnonzero(deviation > 1e-9 * deviation.max()).max() == told


@pytest.mark.parametrize("wheel", [
    Wheel(), Wheel(teeth=8, missing=0, index=True, index_at=0.0), Wheel(teeth=4, missing=0, index=True, index_at=0.0),
], ids=["60-2", "8", "4"])  # fmt: skip
def test_over_even_angle_a_wheel_counts_from_its_pulse_as_one_pulse_does(wheel: Wheel) -> None:
    """It counted from where the revolution begins: behind few teeth the twist by the torque had another zero."""
    wheel = replace(wheel, error_deg=0.0, shaft=Shaft(rpm=600.0, ripple=0.05, order=1))
    found, alone = (align(wheel_recording(one)) for one in (wheel, replace(wheel, teeth=1, missing=0, index=False)))
    swing = swing_of(found.details[LEAD], found.details[DEVIATION], 30)
    even = swing.evened(found.mean_torque)
    assert np.sqrt(np.mean((found.mean_torque - alone.mean_torque) ** 2)) > 0.005 * np.ptp(alone.mean_torque)
    assert np.sqrt(np.mean((even - alone.mean_torque) ** 2)) < 0.0005 * np.ptp(alone.mean_torque)


def test_one_pulse_per_turn_tells_no_deviation() -> None:
    wheel = Wheel(teeth=1, missing=0)
    assert "angle_deviation" not in align(wheel_recording(wheel)).details


def test_exchanged_wires_of_a_coil_are_told_and_read_right() -> None:
    wheel = replace(WHEELS["60-2 inductive"], edge="rising")
    cycles = align(wheel_recording(wheel))
    assert {finding.code for finding in cycles.findings} == {"trigger_inverted"}
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05


@pytest.mark.parametrize("samples", [6.3, 7.3])
def test_an_encoder_is_read_where_half_of_its_samples_lie_on_flanks(samples: float) -> None:
    """Behind the input stage of an amplifier most of the few samples of a line are on their way to a level."""
    wheel = Wheel(teeth=360, missing=0, index=True, rate=3600.0 * samples, error_deg=0.0, flank_rad=1e-3)
    volts = lfilter([0.7], [1.0, -0.3], wheel_volts(wheel))
    recording = wheel_recording(
        wheel, pulse_channel(wheel, "trigger", volts), pulse_channel(wheel, "index", index_volts(wheel))
    )
    cycles = align(recording)
    assert cycles.index.size >= 28
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.2


@pytest.mark.parametrize("volts", [np.zeros(10_000), np.full(10_000, np.nan), np.full(3, 1.0), np.zeros(0)])
def test_a_dead_coil_is_refused(volts: np.ndarray) -> None:
    wheel = WHEELS["60-2 inductive"]
    with pytest.raises(Refusal, match=r"found 0 teeth in .* of an inductive pick-up .* check that the channel is the"):
        find_crossings(pulse_channel(wheel, "trigger", volts), "falling")


def test_coil_from_standstill_keeps_its_teeth_over_a_range_of_speed() -> None:
    # 0.2 to 1.8 times the speed: the waves grow ninefold, and the first interval is the longest
    wheel = replace(WHEELS["60-2 inductive"], shaft=Shaft(rpm=300.0, ramp=0.0), duration=4.0, noise=0.002)
    t = wheel.times

    class Ramp(Shaft):
        def angle(self, t: np.ndarray) -> np.ndarray:
            return self.start + self.speed * (0.2 * t + 0.2 * t**2)

    ramp = replace(wheel, shaft=Ramp(rpm=300.0))
    edges = find_crossings(pulse_channel(ramp, "trigger", wheel_volts(ramp)), "falling")
    turned = ramp.wheel_angle(np.array([0.0, t[-1]])) / (TWO_PI / 60)
    k = np.arange(np.ceil(turned[0]), np.floor(turned[1]) + 1)
    assert edges.time.size == pytest.approx(np.sum(k % 60 < 58), abs=1)


@pytest.mark.parametrize(("share", "mains"), [(0.02, 50.0), (0.1, 60.0), (0.2, 50.0)])
def test_a_hum_between_single_teeth_of_a_coil_is_none(share: float, mains: float) -> None:
    """Most waves are the hum's: a coil of 3 V with 0.06 V of it was told to turn three times as fast as the cam."""
    wheel = Wheel(kind="inductive", edge="falling", teeth=12, missing=11, noise=1e-3)
    volts = wheel_volts(wheel)
    alone = find_crossings(pulse_channel(wheel, "trigger", volts), "falling")
    hum = share * np.max(np.abs(volts)) * np.sin(2.0 * np.pi * mains * wheel.times)
    found = find_crossings(pulse_channel(wheel, "trigger", volts + hum), "falling")
    turns = wheel.duration * wheel.shaft.rpm / 60.0
    assert alone.time.size == pytest.approx(turns, abs=1)
    assert found.time.size == alone.time.size
    assert np.max(np.abs(found.time - alone.time)) * wheel.shaft.rpm / 60.0 < 0.01 * share


def test_teeth_of_a_slow_stretch_are_no_hum() -> None:
    both = [replace(WHEELS["60-2 inductive"], shaft=Shaft(rpm=rpm), noise=1e-3) for rpm in (60.0, 600.0)]
    volts = [wheel_volts(wheel) for wheel in both]
    assert np.max(np.abs(volts[1])) > 5.0 * np.max(np.abs(volts[0]))
    counts = [find_crossings(pulse_channel(both[0], "t", part), "falling").time.size for part in volts]
    whole = find_crossings(pulse_channel(both[0], "t", np.concatenate(volts)), "falling")
    assert whole.time.size == pytest.approx(sum(counts), abs=NEIGHBOURS)


def slipped(wheel: Wheel, at: float, by: float) -> np.ndarray:
    """Volts of a wheel that slips on its shaft by some teeth: the log goes on with a later part of the wheel."""
    volts = wheel_volts(wheel)
    i = round(at * wheel.rate)
    skip = round(by * 60.0 / wheel.shaft.rpm / wheel.teeth * wheel.rate)
    return np.r_[volts[:i], volts[i + skip :], volts[i : i + skip]]


def test_count_starts_anew_at_the_mark_after_lost_teeth() -> None:
    wheel = replace(WHEELS["60-2"], shaft=Shaft(rpm=600.0))
    volts = wheel_volts(wheel)
    angle = wheel.wheel_angle(wheel.times) / TWO_PI
    # between two marks, seven teeth are hidden and three false ones added
    hidden = (angle % 1.0 > 0.3) & (angle % 1.0 < 0.3 + 7.0 / 60.0) & (np.floor(angle) == 10)
    volts[hidden] = 0.0
    false = np.flatnonzero((np.floor(angle) == 20) & (angle % 1.0 > 0.5))[: 3 * 20]
    volts[false] = 5.0 * (np.arange(false.size) % 20 < 10)
    cycles = align(wheel_recording(wheel, volts=volts))
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05
    lost = {row.reason: row.cycles for row in cycles.cut_flow if row.cycles and row.reason != "incomplete"}
    assert sum(lost.values()) <= 4
    assert np.max(cycles.speed) / np.min(cycles.speed) < 1.01


def test_a_wheel_that_slips_costs_the_revolution_and_no_more() -> None:
    wheel = replace(WHEELS["60-2"], shaft=Shaft(rpm=600.0), duration=4.0)
    cycles = align(wheel_recording(wheel, volts=slipped(wheel, 2.0, 5.4)))
    codes = {finding.code for finding in cycles.findings}
    assert "trigger_slipped" in codes
    before = cycles.index < cycles.index[0] + 15
    assert abs(angle_error_deg(cycles.torque[before], torque_of, cycles.theta)) < 0.05
    # after the slip the wheel stands five teeth further on the shaft: the angle of the wheel is kept, no cycle is odd
    assert np.max(cycles.speed) / np.min(cycles.speed) < 1.01


def test_noisy_36_2_with_glitches_is_used() -> None:
    wheel = Wheel(teeth=36, shaft=Shaft(rpm=900.0, ripple=0.01), duration=3.0, rate=20e3, noise=0.25)
    volts = wheel_volts(wheel)
    rng = np.random.default_rng(5)
    for place in rng.integers(0, volts.size - 3, 12):
        volts[place : place + 2] = 5.0 * (volts[place] < 2.5)
    cycles = align(wheel_recording(wheel, volts=volts))
    assert cycles.index.size >= 0.7 * cycles.cycles_found
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05


def encoder(wheel: Wheel, phase: float) -> np.ndarray:
    pitch = TWO_PI / wheel.teeth
    part = wheel.wheel_angle(wheel.times) / pitch - phase
    return (part % 1.0 < 0.5).astype(float)


@pytest.mark.parametrize("quarter", [0.25, -0.25])
def test_encoder_tracks_with_index(quarter: float) -> None:
    wheel = Wheel(shaft=Shaft(rpm=300.0, ripple=0.01), teeth=720, missing=0, rate=100e3, error_deg=0.0, index=True)
    channels = [
        pulse_channel(wheel, "encoder_a", encoder(wheel, 0.0)),
        pulse_channel(wheel, "encoder_b", encoder(wheel, quarter)),
        pulse_channel(wheel, "index", (index_volts(wheel) > 2.5).astype(float)),
    ]
    recording = wheel_recording(wheel, *channels)
    found = judged(wheel, recording)
    assert np.sqrt(np.mean(found.error**2)) < 0.03
    assert 1.0 < found.ratio < 2.0
    cycles = align(recording)
    assert abs(angle_error_deg(cycles.pressure, pressure_of, cycles.theta)) < 0.05
    assert cycles.index.size == cycles.cycles_found


def test_of_two_channels_that_tell_the_angle_the_one_that_counts_is_named() -> None:
    wheel = Wheel(teeth=360, missing=0, rate=100e3, error_deg=0.0, index=True)
    pulse = pulse_channel(wheel, "index", (index_volts(wheel) > 2.5).astype(float))
    channels = (pulse_channel(wheel, "encoder_a", encoder(wheel, 0.0)), replace(pulse, quantity="trigger", name="Z"))
    recording = wheel_recording(wheel, *channels)
    trigger = replace(recording.config.trigger, pulses_per_rev=1)
    base = time_base(replace(recording, config=replace(recording.config, trigger=trigger)), "DAQ")
    (told,) = (finding for finding in base.findings if finding.code == "angle_told_twice")
    assert told.severity == "warning"
    assert (
        "is taken from 'Z' (trigger), to which nominal_angle_deg refers; 'encoder_a' (encoder_a) on the same"
        in told.text
    )
    assert told.text.endswith(
        'any that does not count, or quantity = "index" under one pulse per turn beside an encoder'
    )
    alone = wheel_recording(wheel, channels[0], pulse)
    assert "angle_told_twice" not in {row.code for row in time_base(alone, "DAQ").findings}


def test_encoder_that_swings_back_is_counted_once() -> None:
    wheel = Wheel(shaft=Shaft(rpm=300.0), teeth=360, missing=0, rate=100e3, error_deg=0.0, index=True)
    tracks = {name: encoder(wheel, phase) for name, phase in (("encoder_a", 0.0), ("encoder_b", 0.25))}
    i, j = 150_000, 150_700
    # three counts back and forth again, as a shaft that is stopped by hand
    tracks = {k: np.r_[v[:j], v[i:j][::-1], v[i:j], v[j:]][: v.size] for k, v in tracks.items()}
    channels = [pulse_channel(wheel, k, v) for k, v in tracks.items()]
    index = index_volts(wheel) > 2.5
    index = np.r_[index[:j], np.zeros(2 * (j - i), dtype=bool), index[j:]][: index.size].astype(float)
    recording = wheel_recording(wheel, *channels, pulse_channel(wheel, "index", index))
    # torque and pressure ran on: only the numbering is looked at
    base = time_base(recording, "DAQ")
    assert "encoder_reversed" in {finding.code for finding in base.findings}
    assert "trigger_slipped" not in {finding.code for finding in base.findings}


@pytest.mark.parametrize(
    "law",
    [
        lambda angle: angle % TWO_PI,
        lambda angle: -angle,
        lambda angle: np.floor(angle / (TWO_PI / 360)) * (TWO_PI / 360) % TWO_PI,
        lambda angle: np.floor(angle / (TWO_PI / 36000)) * (TWO_PI / 36000),
        lambda angle: (angle + 0.002 * np.random.default_rng(2).standard_normal(angle.size)) % TWO_PI,
    ],
    ids=["wrapped", "decreasing", "counts of a degree", "fine counts", "analogue with noise"],
)
def test_recorded_angle(law) -> None:
    wheel = Wheel(shaft=Shaft(rpm=300.0, ripple=0.01), missing=0, rate=20e3, nominal_deg=40.0)
    recording = wheel_recording(wheel, pulse_channel(wheel, "angle", law(wheel.wheel_angle(wheel.times))))
    cycles = align(recording)
    # a counter that rounds down is half a count late: 0.5 degrees of one that counts degrees, and stated
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.52
    truth = true_deviation(wheel.shaft, cycles.theta)
    assert np.std(cycles.details["angle_deviation"] - truth) < 0.1 * np.std(truth)


def test_a_logger_that_samples_by_the_angle_leaves_no_scatter() -> None:
    wheel = Wheel(shaft=Shaft(rpm=1000.0, ripple=0.0), missing=0, rate=12e3, nominal_deg=40.0)
    steps = np.arange(wheel.times.size) % 720 * 0.5
    cycles = align(wheel_recording(wheel, pulse_channel(wheel, "angle", np.radians(steps))))
    assert cycles.index.size >= cycles.cycles_found - 1
    assert cycles.mean_speed == pytest.approx(wheel.shaft.rpm * TWO_PI / 60.0)


@pytest.mark.parametrize("rounded", [np.floor, np.rint], ids=["counts edges", "rounds"])
@pytest.mark.parametrize("counts", [360, 3600, 36000])
def test_error_of_a_counter_is_stated_however_it_rounds(counts: int, rounded) -> None:
    wheel = Wheel(shaft=Shaft(rpm=300.37, ripple=0.01), missing=0, rate=20e3, nominal_deg=40.0)
    angle = rounded(wheel.wheel_angle(wheel.times) * counts / TWO_PI) * TWO_PI / counts % TWO_PI
    found = judged(wheel, wheel_recording(wheel, pulse_channel(wheel, "angle", angle)))
    assert 1.0 < found.ratio < 2.0


def test_wheel_without_mark_needs_an_index() -> None:
    wheel = replace(WHEELS["60-2"], missing=0)
    with pytest.raises(Refusal, match=r"60 pulses per revolution without a mark .* or a channel with quantity"):
        align(wheel_recording(wheel))
    assert align(wheel_recording(replace(wheel, index=True))).index.size > 20


def test_crank_wheel_without_index_is_told_from_the_lift() -> None:
    wheel = replace(WHEELS["60-2 on the crank, index"], index=False)
    cycles = align(wheel_recording(wheel))
    assert "cycle_phase_by_lift" in {finding.code for finding in cycles.findings}
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05
    bare = wheel_recording(wheel)
    open_ = align(replace(bare, lift_table=None))
    assert "cycle_phase_open" in {finding.code for finding in open_.findings}


@pytest.mark.parametrize("start", [0.3, 0.3 + np.pi])
@pytest.mark.parametrize("damage", ["inverted torque", "one sample missing"])
def test_the_turn_of_a_crank_is_told_from_damaged_torque(start: float, damage: str) -> None:
    wheel = replace(WHEELS["60-2 on the crank, index"], index=False)
    bare = wheel_recording(replace(wheel, shaft=replace(wheel.shaft, start=start)))
    torque = bare.of("torque")[0].source.values.copy()
    if damage == "inverted torque":
        torque *= -1.0
    else:
        torque[torque.size // 2] = np.nan
    channels = tuple(
        replace(channel, source=Samples(torque)) if channel.quantity == "torque" else channel
        for channel in bare.channels
    )
    cycles = align(replace(bare, channels=channels))
    codes = {finding.code for finding in cycles.findings}
    assert "cycle_phase_by_lift" in codes
    assert ("torque_inverted" in codes) == (damage == "inverted torque")
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05


def test_index_of_another_shaft_is_refused() -> None:
    wheel = Wheel(missing=0, index=True)
    slow = replace(wheel, shaft=Shaft(rpm=170.0))
    channels = (pulse_channel(wheel, "trigger", wheel_volts(wheel)), pulse_channel(wheel, "index", index_volts(slow)))
    with pytest.raises(Refusal, match=r"index pulses, one every .* pulses, expected one every 60 \(per turn"):
        align(wheel_recording(wheel, *channels))


def test_angle_that_does_not_turn_is_refused() -> None:
    wheel = Wheel(missing=0, rate=5e3)
    still = pulse_channel(wheel, "angle", 0.3 + 0.2 * np.sin(wheel.times))
    with pytest.raises(Refusal, match=r"the angle runs over .* turns and .* expected at least two turns"):
        align(wheel_recording(wheel, still))
    with pytest.raises(Refusal, match="the angle does not change"):
        align(wheel_recording(wheel, replace(still, source=Samples(np.zeros(wheel.times.size)))))


def test_index_as_reference_of_a_wheel_with_a_gap() -> None:
    # the index stands 7.3 pitches after the first tooth; the nominal angle is declared for it
    wheel = replace(WHEELS["60-2"], index=True, index_at=7.3)
    recording = wheel_recording(wheel)
    trigger = recording.config.trigger
    at_index = replace(trigger, reference="index", nominal_angle=trigger.nominal_angle + 7.3 * TWO_PI / 60)
    cycles = align(replace(recording, config=replace(recording.config, trigger=at_index)))
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05
    (row,) = (row for row in cycles.angle_errors if row.source == "place of the index")
    assert 0.0 < row.std_deg < 0.1
    # as declared without reference the mark counts
    assert abs(angle_error_deg(align(recording).torque, torque_of, cycles.theta)) < 0.05


def test_leading_edge_of_an_index_beside_a_coil_counts() -> None:
    wheel = replace(WHEELS["60-2 inductive"], missing=0, index=True)
    cycles = align(wheel_recording(wheel))
    assert abs(angle_error_deg(cycles.torque, torque_of, cycles.theta)) < 0.05


@pytest.mark.parametrize(("side", "words"), [("cam", "not corrected here"), ("motor", "sits on the motor's side")])
def test_side_of_the_trigger_is_told_in_the_budget(side: str, words: str) -> None:
    recording = wheel_recording(WHEELS["36-1"])
    trigger = replace(recording.config.trigger, side=side)
    cycles = align(replace(recording, config=replace(recording.config, trigger=trigger)))
    assert words in next(row.text for row in cycles.angle_errors if row.source == "shaft twist")


@pytest.mark.parametrize(
    "wheel", [Wheel(turns=2, duration=0.08), Wheel(teeth=4, missing=1, duration=0.15)], ids=["crank", "four teeth"]
)
def test_a_log_of_less_than_a_turn_is_refused(wheel: Wheel):
    with pytest.raises(Refusal, match=r"the pulses cover [01]\.?\d* turns of the cam without a whole one"):
        align(wheel_recording(wheel))


@pytest.mark.parametrize(("teeth", "missing"), [(60, 2), (360, 0)])
def test_what_a_wheel_of_a_recording_saw_is_the_swing_of_its_shaft(teeth: int, missing: int):
    shaft = Shaft(rpm=600.0, ripple=0.06, order=4, wander=0.0)
    wheel = Wheel(shaft=shaft, teeth=teeth, missing=missing, index=not missing, error_deg=0.0)
    recording = wheel_recording(wheel)
    cycles = align(recording)
    known = cam_swing(recording.config, cycles.details, 22)
    assert known is not None
    assert 20 <= known.order <= 22
    # the phase of the formula is the even angle but for where it counts from, the pulse of the nominal angle
    nominal, theta = recording.config.trigger.nominal_angle, np.arange(1800) * TWO_PI / 1800
    pulses = shaft.time_of(TWO_PI * np.array([3.0, 4.0]) + nominal)
    truth = shaft.angle(pulses[0] + np.diff(pulses) * (theta - nominal) / TWO_PI) - 3.0 * TWO_PI
    # a wheel's zero is known to a few hundredths of a degree
    for found in (theta + known.told(1800)[0], known.cam(1800)):
        assert found == pytest.approx(truth, abs=np.radians(0.06))
    # the transducer's declared lag moves the curve, the swing would by ten times as much
    assert over_even_angle(cycles.mean_torque, known) == pytest.approx(torque_of(truth), abs=0.25)
    assert over_even_angle(cycles.mean_torque, None) != pytest.approx(torque_of(truth), abs=1.5)


@pytest.mark.parametrize(("missing", "declared"), [(1, 2), (2, 1), (2, 3)])
def test_a_gap_of_another_size_is_told_with_what_to_write(missing: int, declared: int) -> None:
    wheel = Wheel(teeth=36, missing=missing)
    recording = wheel_recording(wheel)
    trigger = replace(recording.config.trigger, missing_teeth=declared)
    said = rf"found {missing} missing once in 36: write missing_teeth = {missing}, pulses_per_rev = 36; else check"
    with pytest.raises(Refusal, match=said):
        align(replace(recording, config=replace(recording.config, trigger=trigger)))


@pytest.mark.parametrize(("edge", "noise"), [("falling", 1e-4), ("rising", 1e-4), ("rising", 1e-3), ("rising", 0.02)])
def test_exchanged_wires_of_a_coil_before_a_single_tooth_are_told(edge: str, noise: float) -> None:
    """The edge as declared lay a tooth's width, some degrees, beside the tooth, without a word."""
    wheel = Wheel(kind="inductive", edge=edge, teeth=12, missing=11, noise=noise, error_deg=0.0)
    recording = wheel_recording(wheel)
    trigger = replace(recording.config.trigger, pulses_per_rev=1, missing_teeth=0)
    (used,) = trigger_trains(replace(recording, config=replace(recording.config, trigger=trigger))).values()
    assert ("trigger_inverted" in {row.code for row in used.edges.findings}) == (edge == "rising")
    truth = wheel.true_angle(used.edges.time)
    off = np.remainder(truth - np.radians(wheel.nominal_deg) + np.pi, TWO_PI) - np.pi
    assert np.max(np.abs(np.degrees(off))) < 0.05

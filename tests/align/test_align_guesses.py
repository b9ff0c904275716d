"""What `new` makes of a stranger's channels: triggers of all kinds, two of a quantity, names that tell nothing."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from align_truth import TWO_PI, Samples, Shaft, pressure_of, torque_of
from camtorque.align import align
from camtorque.align.counter import counter_train
from camtorque.config.recording import load_recording_config
from camtorque.ingest.check import _pulse_findings
from camtorque.ingest.new_recording import new_recording
from camtorque.ingest.proposal import look_into
from camtorque.ingest.raw import ArraySource, FileChannel
from camtorque.ingest.wheel import Wheel, angle_wheel, wheel_of
from camtorque.records import Channel, Refusal
from camtorque.signal.marks import repeats_every, uneven_marks
from camtorque.units import unit_factor
from wheel_truth import Wheel as TrueWheel
from wheel_truth import index_volts, wheel_recording, wheel_volts

SHAFT = Shaft(rpm=600.0, ripple=0.01)
RATE = 40e3


def channel(values: np.ndarray, rate: float = RATE, unit: str = "V") -> FileChannel:
    return FileChannel("", "trigger", unit, values.size, rate, "", ArraySource(values))


def of(wheel: TrueWheel, **more: FileChannel) -> Wheel | None:
    sensor = "inductive" if wheel.kind == "inductive" else "digital"
    return wheel_of(channel(wheel_volts(wheel), wheel.rate), sensor, **more)


def true_wheel(**keys: object) -> TrueWheel:
    return TrueWheel(**{"shaft": SHAFT, "rate": RATE, "duration": 1.2, "noise": 0.0, **keys})  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["digital", "inductive"])
@pytest.mark.parametrize(("teeth", "missing"), [(60, 2), (36, 1)])
def test_a_gap_tells_the_teeth_of_switch_and_coil(kind: str, teeth: int, missing: int):
    found = of(true_wheel(teeth=teeth, missing=missing, kind=kind))
    assert found is not None
    assert (found.pulses_per_rev, found.missing_teeth, found.speed) == (teeth, missing, pytest.approx(10.0, rel=2e-3))


def test_a_gap_is_found_while_the_shaft_runs_up():
    found = of(true_wheel(shaft=Shaft(rpm=300.0, ramp=1.0)))
    assert found is not None
    assert (found.pulses_per_rev, found.missing_teeth) == (60, 2)


def test_an_extra_tooth_tells_the_revolution():
    angle = SHAFT.angle(np.arange(40_000) / RATE) % TWO_PI
    at = angle / TWO_PI * 12.0
    volts = 5.0 * (((at % 1.0) < 0.2) | ((at > 11.5) & (at < 11.7)))
    assert wheel_of(channel(volts)) == Wheel(pytest.approx(10.0, rel=2e-3), 12, 0, True)


def test_an_index_tells_the_lines_of_an_encoder_and_the_turns_of_a_crank():
    plain = true_wheel(teeth=90, missing=0, index=True)
    found = of(plain, index=channel(index_volts(plain)))
    assert found == Wheel(pytest.approx(10.0, rel=2e-3), 90, known_from="the index")
    crank = true_wheel(turns=2, index=True)
    found = of(crank, index=channel(index_volts(crank)))
    assert found is not None
    assert (found.pulses_per_rev, found.missing_teeth, found.revolutions_per_cycle) == (60, 2, 2)
    assert found.speed == pytest.approx(10.0, rel=2e-3)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_the_torque_tells_a_trigger_on_a_faster_shaft(turns: int):
    angle = SHAFT.angle(np.arange(60_000) / RATE)
    volts = 5.0 * ((turns * angle) % TWO_PI < 0.4)
    found = wheel_of(channel(volts), load=channel(torque_of(angle), unit="N m"))
    assert found is not None
    assert (found.revolutions_per_cycle, found.speed) == (turns, pytest.approx(10.0, rel=2e-3))


def test_revolutions_that_scatter_are_not_said_to_repeat():
    rng = np.random.default_rng(1)
    cycle = torque_of(np.linspace(0.0, TWO_PI, 48))
    assert repeats_every(cycle + 0.05 * np.ptp(cycle) * rng.standard_normal((40, 48))) == 1
    assert repeats_every(rng.standard_normal((40, 48))) == 1
    alternating = np.array([cycle, 0.2 * cycle] * 8)
    assert repeats_every(alternating) == 2
    assert repeats_every(np.where(np.arange(16)[:, None] == 3, np.nan, alternating)) == 2


def test_a_stray_sample_in_most_revolutions_makes_none_alternate():
    rows = torque_of(np.linspace(0.0, TWO_PI, 720)) + 0.3 * np.random.default_rng(1).standard_normal((10, 720))
    rows[np.arange(2, 8), 9 * np.arange(6)] = 2000.0
    assert repeats_every(rows) == 1


def test_an_angle_tells_speed_and_turns():
    angle = np.degrees(SHAFT.angle(np.arange(40_000) / RATE))
    factor = np.pi / 180.0
    assert angle_wheel(channel(np.round(angle % 360.0, 1)), factor) == Wheel(pytest.approx(10.0, rel=5e-3), 0)
    assert angle_wheel(channel(-angle), factor) == Wheel(pytest.approx(10.0, rel=5e-3), 0)
    crank = angle_wheel(channel((2.0 * angle) % 720.0), factor)
    assert crank is not None
    assert (crank.revolutions_per_cycle, crank.speed) == (2, pytest.approx(10.0, rel=5e-3))
    assert angle_wheel(channel(np.zeros(500)), factor) is None


def log(folder: Path, **columns: np.ndarray) -> Path:
    """Write a log of the given columns; __ in a name begins its unit."""
    file = folder / "log.csv"
    named = [name.replace("__", " [") + "]" * ("__" in name) for name in columns]
    lines = [",".join(["time [s]", *named])]
    lines += [",".join(f"{v:.5g}" for v in row) for row in zip(*columns.values(), strict=True)]
    body = [lines[0], *[f"{n / 10e3:.4f},{line}" for n, line in enumerate(lines[1:])]]
    file.write_text("\n".join(body) + "\n", encoding="utf-8")
    return file


def signals(n: int = 6000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    angle = SHAFT.angle(np.arange(n) / 10e3)
    return torque_of(angle), 1e-5 * pressure_of(angle), 5.0 * (angle % TWO_PI < 0.3)


def written(file: Path) -> tuple[str, tuple[str, ...]]:
    new = new_recording(file.parent, look_into([file]), None)
    (file.parent / "recording.toml").write_text(new.text, encoding="utf-8")
    return new.text, new.unknown


def test_which_of_two_torques_counts_has_to_be_said(tmp_path: Path):
    torque, pressure, trigger = signals()
    file = log(tmp_path, Torque_motor__Nm=torque + 1.0, Torque_pump__Nm=torque, p__bar=pressure, Trigger__V=trigger)
    text, unknown = written(file)
    assert unknown.count("used") == 2
    toml = tmp_path / "recording.toml"
    known = re.sub(r"\[pump\].*?(?=\n\[)", "", text, count=1, flags=re.DOTALL).replace('pump_id = "?"', 'pump_id = "P"')
    known = known.replace('_deg = "?"', "_deg = 1.0")
    toml.write_text(re.sub(r"used = .*", "", known), encoding="utf-8")
    with pytest.raises(
        Refusal, match=r"2 channels measure torque \('Torque_motor', 'Torque_pump'\); write used = false"
    ):
        load_recording_config(tmp_path)
    toml.write_text(
        known.replace('used = "?"', "used = false", 1).replace('used = "?"', "used = true"), encoding="utf-8"
    )
    config = load_recording_config(tmp_path)
    assert [c.channel for c in config.channels if c.quantity == "torque"] == ["Torque_pump"]
    assert ["Torque_motor" in f.text for f in config.findings if f.code == "channel_left_out"] == [True]


def test_channels_that_nothing_names_are_asked_for_with_their_sheets(tmp_path: Path):
    torque, pressure, trigger = signals()
    text, unknown = written(log(tmp_path, A__V=0.05 * torque, B__V=0.01 * pressure, C__V=trigger))
    assert unknown.count("quantity") == 2
    assert unknown.count("sensitivity_V_per_unit") == 2
    assert re.search(r'quantity = "trigger"[^\[]*channel = "C"', text)


def test_values_above_any_amplifier_are_not_asked_for_a_sensitivity(tmp_path: Path):
    torque, pressure, trigger = signals()
    _, unknown = written(log(tmp_path, M=torque, p=pressure, trig=trigger))
    assert "sensitivity_V_per_unit" not in unknown
    assert unknown.count("unit") == 2


def test_a_single_column_may_be_named_by_its_file(tmp_path: Path):
    torque, pressure, trigger = signals()
    files = []
    for name, values in (("C1_torque", torque), ("C2_pressure", pressure), ("C3_trigger", trigger)):
        files.append(log(tmp_path, Ampl=values).rename(tmp_path / f"{name}.csv"))
    assert [item.quantity for item in look_into(files)] == ["torque", "pressure", "trigger"]


def test_a_unit_that_is_not_known_is_shown(tmp_path: Path):
    torque, pressure, trigger = signals()
    file = log(tmp_path, **{"Torque__digit": 0.01 * torque, "p__bar": pressure, "trigger__V": trigger})
    assert "# the file says 'digit', which is no known unit" in written(file)[0]


def test_of_two_pulse_trains_the_slower_one_is_the_index(tmp_path: Path):
    torque, pressure, cam = signals()
    angle = SHAFT.angle(np.arange(cam.size) / 10e3)
    crank = 5.0 * ((2.0 * angle) % TWO_PI * 12.0 / TWO_PI % 1.0 < 0.5) * ((2.0 * angle) % TWO_PI < TWO_PI * 11.0 / 12.0)
    text, _ = written(log(tmp_path, Sensor_cam=cam, T__Nm=torque, p__bar=pressure, Sensor_crank=crank))
    kinds = re.findall(r'quantity = "(\w+)"[^\[]*?channel = "Sensor_(\w+)"', text)
    assert sorted(kinds) == [("index", "cam"), ("trigger", "crank")]
    for line in ("pulses_per_rev = 12", "missing_teeth = 1", "revolutions_per_cycle = 2", "told by: the index"):
        assert line in text
    assert "reference" not in re.sub("#.*", "", text)  # tooth 1 is told by the gap
    even = 5.0 * (angle * 20.0 / TWO_PI % 1.0 < 0.5)
    text, _ = written(log(tmp_path, Sensor_cam=cam, T__Nm=torque, p__bar=pressure, Sensor_wheel=even))
    assert 'reference = "index"' in text
    assert "pulses_per_rev = 20" in text
    text, _ = written(log(tmp_path, Sensor_a=cam, T__Nm=torque, p__bar=pressure, Sensor_b=np.roll(cam, 100)))
    assert '"index"' not in text


@pytest.mark.parametrize("unit", ["bar abs", "bar(a)"])
def test_a_pressure_from_vacuum_says_so(tmp_path: Path, unit: str):
    torque, pressure, trigger = signals()
    file = log(tmp_path, **{"T__Nm": torque, f"p__{unit}": pressure + 1.0, "trigger__V": trigger})
    text, _ = written(file)
    assert re.search(r'\[sensors.pressure\][^\[]*reference = "absolute"', text)
    assert 'unit = "bar"' in text


def test_pulses_of_a_faster_shaft_are_told_where_cycles_would_only_be_thrown_away() -> None:
    fast = true_wheel(shaft=Shaft(rpm=1200.0), teeth=1, missing=0, duration=2.0, rate=20e3)
    angle = 0.5 * fast.shaft.angle(fast.times)
    recording = wheel_recording(fast)
    slow = {"torque": torque_of(angle), "pressure": pressure_of(angle)}
    channels = tuple(
        replace(c, source=Samples(slow[c.quantity]), calibration=None) if c.quantity in slow else c
        for c in recording.channels
    )
    try:
        findings = align(replace(recording, channels=channels)).findings
        texts = [finding.text for finding in findings if finding.code == "revolutions_alternate"]
    except Refusal as refusal:
        texts = [str(refusal)]
    assert ["write revolutions_per_cycle = 2 under [trigger] (it is 1)" in text for text in texts] == [True]


def two_marks(apart_deg: float, turns: int = 40) -> np.ndarray:
    """Return the times of two marks on a shaft of 600 rpm [s]."""
    return 0.1 * np.sort(np.concatenate([np.arange(turns), np.arange(turns) + apart_deg / 360.0]))


@pytest.mark.parametrize(("apart", "keys"), [
    (60.0, "60 and 300 deg apart in turn: .* write pulses_per_rev = 6, missing_teeth = 4 under"),
    (300.0, "write pulses_per_rev = 6, missing_teeth = 4 under"), (90.0, "pulses_per_rev = 4, missing_teeth = 2"),
    (145.0, None), (137.0, "at no whole part of a revolution; take one away"), (180.0, None),
    (54.0, "54 and 306 .*, at no whole part"), (46.0, "pulses_per_rev = 8,"), (4.0, "too near each other to tell"),
])  # fmt: skip
def test_two_uneven_marks_are_told_with_the_keys_that_describe_them(apart: float, keys: str | None) -> None:
    times = two_marks(apart)
    assert re.search(keys, uneven_marks(times)) if keys else not uneven_marks(times)
    assert bool(uneven_marks(np.delete(times, 9))) == bool(keys), "a pulse that is missing hides nothing"
    assert not uneven_marks(times[:4])


@pytest.mark.parametrize(("apart", "text"), [
    (60.0, "none of the 34 periods between the trigger pulses is within 30 % of their median.*pulses_per_rev = 6"),
    (180.0, ""),
])  # fmt: skip
def test_pulses_without_a_usual_period_are_no_short_recording(apart: float, text: str) -> None:
    config = true_wheel(teeth=1, missing=0)
    recording = wheel_recording(config)
    found = _pulse_findings(recording.of("trigger")[0], two_marks(apart, 18)[:-1], recording.config)
    assert [bool(re.search(text, row.text)) for row in found if row.code == "pulses_irregular"] == [True] * bool(text)


def test_an_angle_in_coarse_steps_has_no_clock_jumps() -> None:
    shaft, rate = Shaft(rpm=1000.0, ripple=0.004), 20e3
    angle = np.radians(np.round(np.degrees(shaft.angle(np.arange(round(1.2 * rate)) / rate)) % 360.0, 1))
    recorded = Channel("angle", "DAQ", Samples(angle), 0.0, rate, None, Path("log.csv"), "angle")
    counted = counter_train(recorded, 1)
    quantum = np.radians(0.1) / np.sqrt(12.0) / shaft.speed
    assert counted.edges.noise == pytest.approx(quantum, rel=0.3)


@pytest.mark.parametrize("rate", [5e3, 50e3])
def test_an_even_angle_of_full_precision_has_no_counts(rate: float) -> None:
    """Its step from sample to sample was taken for a count, and the angle read a quarter of it late."""
    angle = 2.0 * np.pi * 20.0 * np.arange(round(1.5 * rate)) / rate
    recorded = Channel("angle", "DAQ", Samples(angle), 0.0, rate, None, Path("log.csv"), "angle")
    counted = counter_train(recorded, 1)
    pitch = 2.0 * np.pi / counted.pulses_per_cycle
    expected = counted.train.step * pitch / (2.0 * np.pi * 20.0)
    np.testing.assert_allclose(counted.train.time, expected, atol=1e-9)
    assert counted.train.offset_std == 0.0


def test_missing_samples_of_an_angle_are_told() -> None:
    angle = np.linspace(0.0, 12.0 * np.pi, 4001)
    angle[100:103] = np.nan
    channel = Channel("angle", "DAQ", Samples(angle), 0.0, 1e3, None, Path("log.csv"), "angle")
    found = counter_train(channel, 1).findings
    assert [(item.code, item.text.split()[0]) for item in found] == [("trigger_drop_out", "3")]


@pytest.mark.parametrize("first", [0, -32768], ids=["unsigned", "signed"])
def test_a_counter_of_sixteen_bits_starts_again_within_a_turn(first: int) -> None:
    """3600 counts a turn: taken to jump by 18 turns, the angle was 74 degrees off after each."""
    time = np.arange(60_000) / 2e4
    counts = np.floor(3600.0 * (20.0 * time + 0.05))
    angle = ((counts - first) % 65536 + first) * TWO_PI / 3600
    channel = Channel("angle", "DAQ", Samples(angle), 0.0, 2e4, None, Path("log.csv"), "angle")
    found = counter_train(channel, 1)
    assert [(item.code, item.severity) for item in found.findings] == [("counter_overflows", "warning")]
    assert "starts again after 65536 counts, 18.2 turns" in found.findings[0].text
    periods = np.diff(found.train.time)
    np.testing.assert_allclose(periods, np.median(periods), rtol=0.02)
    whole = counter_train(replace(channel, source=Samples(counts % 3600 * TWO_PI / 3600)), 1)
    assert whole.findings == ()


def test_counts_of_an_encoder_that_are_taken_for_degrees_are_refused_by_their_unit() -> None:
    """4096 of them were a counter that overflows after 11.4 turns: the torque did not follow the cam."""
    counts = np.floor(4096.0 * 5.0 * np.arange(80_000) / 1e4) % 4096
    channel = Channel("angle", "DAQ", Samples(np.radians(counts)), 0.0, 1e4, None, Path("log.csv"), "angle")
    text = 'again after 4096 whole degrees, 11.38 turns, expected .* a turn, write unit = "rev/4096"'
    with pytest.raises(Refusal, match=text):
        counter_train(channel, 1)


@pytest.mark.parametrize(("factor", "text"), [
    (np.pi / 180.0, r"after 0\.017\d turns, expected whole ones; check its unit: in rad it is 1 turn"),
    (180.0 / np.pi, r"after 57\.\d turns, expected whole ones; check its unit: in deg it is 1 turn"),
])  # fmt: skip
def test_an_angle_in_the_other_unit_is_refused_by_its_turns(factor: float, text: str) -> None:
    angle = factor * (TWO_PI * 20.0 * np.arange(60_000) / 2e4 % TWO_PI)
    channel = Channel("angle", "DAQ", Samples(angle), 0.0, 2e4, None, Path("log.csv"), "angle")
    with pytest.raises(Refusal, match=text):
        counter_train(channel, 1)


@pytest.mark.parametrize(("turns", "seen"), [(180.0 / np.pi, "57.3"), (np.pi / 180.0, "0.0175"), (2.78, "2.78")])
def test_an_angle_that_starts_again_after_no_whole_turns_is_refused(turns: float, seen: str) -> None:
    """It was taken for whole turns: the torque then did not follow the cam, check sensor, cable and supply."""
    angle = 0.3 * turns * np.arange(4001) / 100.0 % turns * TWO_PI
    channel = Channel("angle", "DAQ", Samples(angle), 0.0, 1e3, None, Path("log.csv"), "angle")
    with pytest.raises(Refusal, match=f"starts again after {seen} turns, expected whole ones; check its unit"):
        counter_train(channel, 1)


def test_a_counter_that_is_set_to_zero_while_it_turns_is_refused() -> None:
    angle = TWO_PI * 0.1 * np.arange(4000.0)
    angle[3004:] -= angle[3004]
    channel = Channel("angle", "DAQ", Samples(angle), 0.0, 1e3, None, Path("log.csv"), "angle")
    with pytest.raises(
        Refusal, match=r"starts again after 300\.3 turns, expected whole ones; .* was set to zero while"
    ):
        counter_train(channel, 1)


def test_a_counter_states_its_counts_a_revolution() -> None:
    assert unit_factor("rev/1024", "angle", "") == pytest.approx(TWO_PI / 1024)
    with pytest.raises(Refusal, match=r"unknown unit 'counts'.*rev/1024 for a counter"):
        unit_factor("counts", "angle", "log.csv")
    with pytest.raises(Refusal, match=r"'bar abs', write 'bar' and reference = \"absolute\""):
        unit_factor("bar abs", "pressure", "log.csv")


def test_a_digital_line_is_no_pressure_whatever_its_name(tmp_path: Path):
    torque, pressure, trigger = signals()
    blocky = np.clip(pressure, 0.3 * pressure.max(), 0.5 * pressure.max())
    file = log(tmp_path, Torque__Nm=torque, Voltage_1=0.01 * blocky, **{"port0/line3": trigger / 5.0})
    text, _ = written(file)
    assert re.search(r'quantity = "trigger"[^\[]*channel = "port0/line3"', text)
    assert re.search(r'quantity = "\?"[^\[]*channel = "Voltage_1"[^\[]*unit = "\?"[^\[]*# its values: ', text)

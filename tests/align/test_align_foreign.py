"""Logs of machines nobody of the project built, rebuilt small and with known truth, read from files as they came.

A Stirling engine logged by LabVIEW (one magnet per revolution, 100 rpm, nominal speed wrong), a petrol engine with an
inductive 60-2 wheel on its crank, a logic log of a noisy 36-2 wheel. None has a pump, a torque or a lift table.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from align_truth import TWO_PI, Shaft, angle_error_deg
from camtorque import cli
from camtorque.align import align
from camtorque.align.teeth import missing_tooth_steps, number_teeth
from camtorque.config import TriggerSpec
from camtorque.ingest import read_recording
from camtorque.records import CamCycles, Refusal
from camtorque.units import RPM
from wheel_truth import Wheel, index_volts, wheel_volts

HEAD = """schema = "fip-bench-recording/1"
[recording]
id = "{id}"
nominal_speed_rpm = {rpm}
[trigger]
nominal_angle_deg = 20.0
installation_tolerance_deg = 1.0
{trigger}
[[loggers]]
id = "L"
clock = "single"
"""
CHANNEL = """[[channels]]
quantity = "{0}"
file = "{1}"
channel = "{2}"
unit = "{3}"
logger = "L"
sample_rate_hz = {4}
"""


def cylinder(theta: np.ndarray) -> np.ndarray:
    """Pressure in a cylinder [Pa] over the angle of the cycle."""
    return 1e5 * (4.0 + 30.0 * np.exp((np.cos(theta - 1.1) - 1.0) / 0.04) + 3.0 * np.cos(theta - 4.0))


def aligned(folder: Path, toml: str) -> CamCycles:
    """Read and align; the pressure has no delay here, which the sheet that it lacks would say."""
    (folder / "recording.toml").write_text(toml, encoding="utf-8")
    recording = read_recording(folder)
    channels = tuple(
        c if c.calibration is None else replace(c, calibration=replace(c.calibration, delay=0.0))
        for c in recording.channels
    )
    return align(replace(recording, channels=channels))


def assert_truth(cycles: CamCycles, limit_deg: float) -> None:
    assert abs(angle_error_deg(cycles.pressure, cylinder, cycles.theta)) < limit_deg
    assert cycles.index.size >= 0.9 * cycles.cycles_found
    codes = {finding.code for finding in cycles.findings}
    assert not codes & {"clock_jump", "trigger_missed", "trigger_gap", "trigger_slipped"}


def test_stirling_engine_by_labview_text(tmp_path: Path) -> None:
    shaft, rate = Shaft(rpm=103.0), 1000.0
    t = np.arange(round(12.0 * rate)) / rate
    theta = shaft.angle(t)
    magnet = 0.06 + 4.9 * ((theta - np.radians(20.0)) % TWO_PI < 0.12)
    lines = ["LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tOne", "Multi_Headings\tNo"]
    lines += ["***End_of_Header***\t", "\t", "Channels\t2\t", f"Samples\t{t.size}\t{t.size}\t"]
    lines += ["X_Dimension\tTime\tTime\t", "X0\t0.0\t0.0\t", f"Delta_X\t{1 / rate}\t{1 / rate}\t"]
    lines += ["***End_of_Header***\t", "X_Value\tPressure\tMagnet\tComment"]
    pressure = cylinder(theta) / 1e5
    lines += [f"{a:.6f}\t{b:.6f}\t{c:.4f}" for a, b, c in zip(t, pressure, magnet, strict=True)]
    (tmp_path / "run.lvm").write_text("\r\n".join(lines), encoding="utf-8", newline="")
    toml = HEAD.format(id="stirling", rpm=300.0, trigger="") + "".join(
        CHANNEL.format(quantity, "run.lvm", name, unit, rate)
        for quantity, name, unit in (("pressure", "Pressure", "bar"), ("trigger", "Magnet", "V"))
    )
    cycles = aligned(tmp_path, toml)
    assert cycles.mean_speed / RPM == pytest.approx(103.0, abs=0.05)
    # a sample is 0.6 degrees: a flank of nothing is known to that over the square root of 12, and cycles average
    assert_truth(cycles, 0.2)


def engine_file(folder: Path, wheel: Wheel, signals: dict[str, np.ndarray], trigger: str) -> str:
    with h5py.File(folder / "log.h5", "w") as file:
        for name, values in signals.items():
            file.create_dataset(name, data=values)
    units = {"pressure": "Pa"}
    return HEAD.format(id="engine", rpm=50.0, trigger=trigger) + "".join(
        CHANNEL.format(name, "log.h5", name, units.get(name, "V"), wheel.rate) for name in signals
    )


@pytest.mark.parametrize("edge", ["falling", "rising"])
def test_petrol_engine_with_a_coil_on_the_crank(tmp_path: Path, edge: str) -> None:
    # cranking at 200 rpm with the ripple of compression, ten samples a tooth
    wheel = Wheel(
        shaft=Shaft(rpm=400.0, ripple=0.04, order=4), turns=2, kind="inductive", rate=8e3, duration=6.0, index=True,
        edge=edge, error_deg=0.03,
    )  # fmt: skip
    signals = {
        "pressure": cylinder(wheel.shaft.angle(wheel.times)),
        "trigger": wheel_volts(wheel),
        "index": index_volts(wheel),
    }
    keys = f'pulses_per_rev = 60\nmissing_teeth = 2\nrevolutions_per_cycle = 2\nsensor = "inductive"\nedge = "{edge}"'
    cycles = aligned(tmp_path, engine_file(tmp_path, wheel, signals, keys))
    assert_truth(cycles, 0.05)
    assert ("trigger_inverted" in {finding.code for finding in cycles.findings}) == (edge == "rising")
    assert np.ptp(cycles.details["angle_deviation"]) == pytest.approx(2 * 0.04 / 4, rel=0.1)


def test_logic_log_of_a_noisy_36_2_wheel(tmp_path: Path) -> None:
    wheel = Wheel(shaft=Shaft(rpm=1500.0, ripple=0.02), teeth=36, rate=25e3, duration=4.0, noise=0.0)
    levels = (wheel_volts(wheel) > 2.5).astype(float)
    rng = np.random.default_rng(8)
    for place in rng.integers(10, levels.size - 10, 40):
        # glitches of one sample, and levels held for a whole tooth now and then
        levels[place : place + (1 if rng.random() < 0.7 else 20)] = 1.0 - levels[place]
    signals = {"pressure": cylinder(wheel.shaft.angle(wheel.times)), "trigger": levels}
    toml = engine_file(tmp_path, wheel, signals, "pulses_per_rev = 36\nmissing_teeth = 2")
    cycles = aligned(tmp_path, toml)
    assert abs(angle_error_deg(cycles.pressure, cylinder, cycles.theta)) < 0.1
    # 100 revolutions, 40 disturbances: those that lose or add teeth cost theirs
    assert cycles.index.size >= 60
    assert np.ptp(cycles.speed) < 0.02 * cycles.mean_speed


def checked(folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict]:
    """Return status and document of `check`."""
    capsys.readouterr()
    status = cli.main(["check", str(folder), "--json"])
    return status, json.loads(capsys.readouterr().out)


def quantised(values: np.ndarray, step: float) -> np.ndarray:
    return np.round(values / step) * step


def test_diesel_with_a_slow_trigger_flank_and_a_coarse_converter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # cylinder and fuel line through 12 bits, a flank of several degrees: 1354 stray samples were told where none is
    wheel, rng = Wheel(shaft=Shaft(rpm=500.0, ripple=0.01, order=2), rate=20e3, duration=6.0), np.random.default_rng(0)
    theta = wheel.shaft.angle(wheel.times)
    distance = (theta - np.radians(20.0) + np.pi) % TWO_PI - np.pi
    fuel = 2e5 + 6e7 * np.exp((np.cos(theta - 0.5) - 1.0) / 0.02)
    fuel += 5e5 * np.sin(40.0 * theta) * np.exp((np.cos(theta - 0.8) - 1.0) / 0.1)
    flank = 5.0 * np.exp(-0.5 * (distance / np.radians(3.0)) ** 2) + 0.01 * rng.standard_normal(theta.size)
    signals = {
        "pressure": quantised(fuel, 1e8 / 4096),
        "chamber_pressure": quantised(cylinder(theta) + 2e4 * rng.standard_normal(theta.size), 2e7 / 4096),
        "trigger": quantised(flank, 10.0 / 4096),
    }
    toml = engine_file(tmp_path, wheel, signals, "").replace(
        '"chamber_pressure"\nunit = "V"', '"chamber_pressure"\nunit = "Pa"'
    )
    cycles = aligned(tmp_path, toml)
    assert cycles.index.size == cycles.cycles_found
    # the flank rises at half of its height, 3.5 degrees before its middle; the level that is meant is a convention
    at = angle_error_deg(cycles.channels["chamber_pressure"], cylinder, cycles.theta)
    assert abs(at) == pytest.approx(3.0 * np.sqrt(2.0 * np.log(2.0)), abs=0.5)
    status, doc = checked(tmp_path, capsys)
    assert (status, doc["usable"]) == (0, ["align"])
    assert "isolated_samples" not in {row["code"] for row in doc["findings"]}


def test_coil_of_a_cranked_engine_at_ten_kilohertz(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wheel = Wheel(
        shaft=Shaft(rpm=160.7, ripple=0.06, order=4), kind="inductive", rate=10e3, duration=8.0, noise=0.004,
        edge="falling",
    )  # fmt: skip
    signals = {"pressure": cylinder(wheel.shaft.angle(wheel.times)), "trigger": wheel_volts(wheel)}
    keys = 'pulses_per_rev = 60\nmissing_teeth = 2\nsensor = "inductive"\nedge = "falling"'
    cycles = aligned(tmp_path, engine_file(tmp_path, wheel, signals, keys))
    assert_truth(cycles, 0.1)
    status, doc = checked(tmp_path, capsys)
    assert status == 0
    assert doc["speed_rpm"] == pytest.approx(160.7, rel=2e-3)
    with pytest.raises(Refusal, match='a coil is declared as sensor = "inductive"'):
        aligned(tmp_path, engine_file(tmp_path, wheel, signals, "pulses_per_rev = 60\nmissing_teeth = 2"))


@pytest.mark.parametrize(("rpm", "rate"), [(850.0, 20e3), (900.0, 10e3), (3000.0, 20e3)])
def test_logic_log_of_a_60_2_wheel_sampled_coarsely(tmp_path: Path, rpm: float, rate: float) -> None:
    # 7 to 24 samples a tooth: stairs of the edges are no jumps of the clock
    wheel = Wheel(shaft=Shaft(rpm=rpm, ripple=0.02, order=2), rate=rate, duration=4.0, noise=0.0)
    levels = (wheel_volts(wheel) > 2.5).astype("u1")
    signals = {"pressure": cylinder(wheel.shaft.angle(wheel.times)), "trigger": levels}
    toml = engine_file(tmp_path, wheel, signals, "pulses_per_rev = 60\nmissing_teeth = 2")
    assert_truth(aligned(tmp_path, toml.replace('"trigger"\nunit = "V"', '"trigger"\nunit = "logic"')), 0.2)


def test_logic_log_of_a_four_stroke_engine_with_index(tmp_path: Path) -> None:
    wheel = Wheel(shaft=Shaft(rpm=425.0, ripple=0.02, order=4), turns=2, rate=20e3, duration=6.0, index=True, noise=0.0)
    signals = {
        "pressure": cylinder(wheel.shaft.angle(wheel.times)),
        "trigger": (wheel_volts(wheel) > 2.5).astype("u1"),
        "index": (index_volts(wheel) > 2.5).astype("u1"),
    }
    keys = "pulses_per_rev = 60\nmissing_teeth = 2\nrevolutions_per_cycle = 2"
    toml = engine_file(tmp_path, wheel, signals, keys).replace('unit = "V"', 'unit = "logic"')
    assert_truth(aligned(tmp_path, toml), 0.2)


@pytest.mark.parametrize("wrapped", [True, False])
def test_shaft_line_with_an_angle_counter_and_no_pressure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], wrapped: bool
) -> None:
    wheel = Wheel(shaft=Shaft(rpm=250.0, ripple=0.02, order=3), rate=5e3, duration=10.0)
    theta = wheel.shaft.angle(wheel.times)
    counted = np.floor(np.degrees(theta) / 0.144) * 0.144
    noise = 0.05 * np.random.default_rng(1).standard_normal(theta.size)
    signals = {"torque": 3.0 + 2.0 * np.sin(theta - 1.0) + noise, "angle": counted % 360.0 if wrapped else counted}
    toml = engine_file(tmp_path, wheel, signals, "").replace('"torque"\nunit = "V"', '"torque"\nunit = "N m"')
    cycles = aligned(tmp_path, toml.replace('"angle"\nunit = "V"', '"angle"\nunit = "deg"'))
    first = np.fft.rfft(cycles.torque.mean(axis=0))[1] / cycles.theta.size
    # the counter's zero is the trigger's nominal angle; it shows the last step passed, half of that is expected
    moved = np.degrees(np.angle(first * np.exp(1j * (1.0 + np.pi / 2.0))))
    assert moved == pytest.approx(-20.0 + 0.25 * 0.144, abs=0.02)
    assert 2.0 * abs(first) == pytest.approx(2.0, rel=0.01)
    status, doc = checked(tmp_path, capsys)
    assert (status, doc["usable"]) == (0, ["align"])
    texts = [row["text"] for row in doc["findings"] if row["code"] == "speed_off_nominal"]
    assert [text.partition(";")[0] for text in texts] == [
        "angle and sample_rate_hz give 250 rpm, the nominal speed is 50 rpm"
    ]


@pytest.mark.parametrize("edge", ["falling", "rising"])
def test_negative_pulses_with_decimal_commas(tmp_path: Path, edge: str, capsys: pytest.CaptureFixture[str]) -> None:
    shaft, rate = Shaft(rpm=300.0), 5e3
    t = np.arange(round(8.0 * rate)) / rate
    theta = shaft.angle(t)
    pulse = -5.0 * ((theta - np.radians(20.0)) % TWO_PI < 0.15)
    rows = [
        f"{a:.4f};{b:.5f};{c:.3f}".replace(".", ",") for a, b, c in zip(t, cylinder(theta) / 1e5, pulse, strict=True)
    ]
    (tmp_path / "log.csv").write_text("\n".join(["Zeit [s];Druck [bar];Geber [V]", *rows]) + "\n", encoding="cp1252")
    toml = HEAD.format(id="n", rpm=300.0, trigger=f'edge = "{edge}"') + "".join(
        CHANNEL.format(quantity, "log.csv", name, unit, rate)
        for quantity, name, unit in (("pressure", "Druck", "bar"), ("trigger", "Geber", "V"))
    )
    assert_truth(aligned(tmp_path, toml), 0.3)
    status, doc = checked(tmp_path, capsys)
    assert (status, doc["usable"]) == (0, ["align"])
    # the edge at the angle is the falling one; a trigger declared the other way round is read right and told
    assert ("trigger_inverted" in {row["code"] for row in doc["findings"]}) == (edge == "rising")


def test_first_interval_long_deletes_no_teeth() -> None:
    k = np.arange(600)
    teeth = k[k % 60 < 58] * 0.1 / 60.0
    late = np.r_[-3.0, -2.99, teeth]
    train, _ = missing_tooth_steps(late, TriggerSpec(0.0, 0.1, pulses_per_rev=60, missing_teeth=2))
    assert train.time.size == late.size
    assert train.counts["doubled"] == 0


@pytest.mark.parametrize(("n", "lost"), [(3, False), (4, False), (6, False), (6, True), (12, True)])
def test_every_turn_of_two_teeth_is_counted(n: int, lost: bool) -> None:
    spec = TriggerSpec(0.0, 0.1, pulses_per_rev=n, missing_teeth=n - 2)
    step = np.sort(np.r_[0 : 40 * n : n, 1 : 40 * n : n])
    if lost:
        step = np.delete(step, [21, 46])
    angle = step / n + 0.002 * np.sin(step)
    train = number_teeth(0.05 * angle + 0.001 * angle**1.1, spec, "log", None)
    # the first tooth has no gap before it
    np.testing.assert_array_equal(train.step - train.step[0], step[1:] - step[1])
    assert set(train.step % n) == {0, 1}
    assert train.counts["slips"] == train.counts["doubled"] == 0


@pytest.mark.parametrize(("apart", "n"), [(60, 4), (90, 6), (60, 3)])
def test_two_teeth_elsewhere_than_declared_are_refused(apart: int, n: int) -> None:
    """At 60 degrees and declared at 90 they were counted, the second one 30 degrees off, without a word."""
    time = 0.05 * np.sort(np.r_[np.arange(30.0), np.arange(30.0) + apart / 360.0])
    text = f"two teeth {360 // n} deg apart .*, but the pulses stand {apart} and .* pulses_per_rev = {360 // apart},"
    with pytest.raises(Refusal, match=text):
        number_teeth(time, TriggerSpec(0.0, 0.1, pulses_per_rev=n, missing_teeth=n - 2), "log", None)

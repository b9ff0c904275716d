"""What a look at the samples finds, and what it must not find."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque import cli
from camtorque.align import align
from camtorque.config.tables import Refusals
from camtorque.ingest import check, read_recording, summarise
from camtorque.signal import damage
from camtorque.signal.damage import isolated_samples, scan_channel
from damaged.logs import CALIBRATION, Plan, clean_log, write_folder
from hypothesis import given, settings
from hypothesis import strategies as st

LOG = clean_log()
EXAMPLES = Path(__file__).resolve().parents[2] / "raw_examples"


def test_noise_alone_has_no_isolated_samples():
    noise = np.random.default_rng(5).standard_normal(400_000)
    assert isolated_samples(noise, False).size == 0


@settings(deadline=None)
@given(at=st.integers(10, 21_000), size=st.floats(0.5, 1e30), sign=st.sampled_from([-1.0, 1.0]))
def test_one_wrong_sample_is_found_where_it_is(at: int, size: float, sign: float):
    volts = LOG.volts["pressure"].copy()
    volts[at] += sign * size
    assert isolated_samples(volts, False).tolist() == [at]


def test_steps_of_a_coarse_converter_are_not_isolated_samples():
    # a smooth pressure in steps: single counts up and down, usual bend nil
    wave = 300.0 * np.sin(np.linspace(0.0, 40.0, 40_000))
    flicker = np.random.default_rng(7).random(wave.size) < 0.03
    counts = np.round(wave) + flicker
    assert isolated_samples(0.01 * counts, False).size == 0
    counts[20_000] += 40.0
    assert isolated_samples(0.01 * counts, False).tolist() == [20_000]


@pytest.mark.parametrize(("turns", "told"), [((4, 5, 7), False), ((5,), True)])
def test_what_the_signal_does_at_that_angle_in_other_turns_is_no_isolated_sample(tmp_path: Path, turns, told):
    log = clean_log(revolutions=9.0)
    volts = log.volts["pressure"].copy()
    for turn in turns:
        volts[round((turn + 0.6) * 0.1 * log.rate)] += 0.4
    recording = read_recording(write_folder(tmp_path, [log.with_volts("pressure", volts)], Plan("hdf5")))
    assert ("isolated_samples" in {row.code for row in summarise(recording).findings}) == told


@pytest.mark.parametrize("turn", [0, 1, 5, 8])
def test_a_glitch_is_told_in_the_first_and_last_turns_too(tmp_path: Path, turn):
    log = clean_log(revolutions=9.9, start=0.09)
    volts = log.volts["pressure"].copy()
    volts[round((turn + 0.7) * 1000)] += 0.4
    recording = read_recording(write_folder(tmp_path, [log.with_volts("pressure", volts)], Plan("hdf5")))
    assert "isolated_samples" in {row.code for row in summarise(recording).findings}


def test_a_contact_that_bounces_at_every_pulse_is_not_two_marks(tmp_path: Path):
    log = clean_log(revolutions=9.9)
    volts = log.volts["trigger"].copy()
    for edge in np.flatnonzero((volts[:-1] <= 2.5) & (volts[1:] > 2.5)):
        volts[edge + 25 : edge + 28] = 5.0
    found = summarise(read_recording(write_folder(tmp_path, [log.with_volts("trigger", volts)], Plan("hdf5"))))
    assert not {row.code for row in found.findings} & {"pulses_irregular", "speed_off_nominal"}
    assert found.speed_rpm == pytest.approx(600.0, rel=0.02)


@pytest.mark.parametrize(
    ("rpm", "rate", "channels", "text"),
    [(600.0, 800.0, 2, "4.5 degrees of cam angle apart, .* sample at 900 Hz or more"),
     (60.0, 900.0, 1, "900 Hz behind a low-pass of 1000 Hz: what is faster than 450 Hz comes through"),
     (60.0, 1100.0, 0, "")],
)  # fmt: skip
def test_samples_too_far_apart_are_told(tmp_path: Path, rpm: float, rate: float, channels: int, text: str):
    log = clean_log(rpm=rpm, rate=rate, revolutions=14.9)
    found = summarise(read_recording(write_folder(tmp_path, [log], Plan("hdf5")))).findings
    coarse = [row for row in found if row.code == "sampled_coarsely"]
    assert len(coarse) == channels
    assert all(re.search(text, row.text) for row in coarse)


def test_edges_of_pulses_are_not_isolated_samples():
    square = (np.arange(10_000) % 500 < 40).astype(float) + 1e-3 * np.random.default_rng(6).standard_normal(10_000)
    assert isolated_samples(square, False).size == 0


def test_blocks_do_not_change_what_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    volts = LOG.volts["pressure"].copy()
    volts[4990:5020] = np.nan
    volts = np.minimum(volts, 1.9)
    folder = write_folder(tmp_path / "r", [LOG.with_volts("pressure", volts)], Plan("hdf5"))
    channels = read_recording(folder).channels
    whole = [scan_channel(channel) for channel in channels]
    monkeypatch.setattr(damage, "BLOCK", 5000)
    again = [scan_channel(channel) for channel in channels]
    for one, other in zip(whole, again, strict=True):
        assert (one.low, one.high, one.missing, one.longest_missing) == (
            other.low,
            other.high,
            other.missing,
            other.longest_missing,
        )
    assert whole[1].longest_missing == 30


def test_the_summary_counts_pulses_and_speed(tmp_path: Path):
    summary = summarise(read_recording(write_folder(tmp_path / "r", [LOG], Plan("hdf5"))))
    trigger = summary.channels[2]
    assert trigger.pulses == 22
    # edges to the sample, 21 revolutions in 2.1 s
    assert summary.speed_rpm == pytest.approx(600.0, rel=1e-4)
    assert summary.channels[1].high == pytest.approx(460e5, rel=0.01)


def test_an_isolated_sample_beside_the_border_of_two_blocks_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    volts = LOG.volts["pressure"].copy()
    volts[5001] += 5.0
    channel = read_recording(write_folder(tmp_path / "r", [LOG.with_volts("pressure", volts)], Plan("hdf5"))).channels[
        1
    ]
    monkeypatch.setattr(damage, "BLOCK", 5000)
    found = scan_channel(channel)
    assert (found.isolated, found.isolated_at) == (1, (5001,))


@settings(deadline=None, max_examples=200)
@given(seed=st.integers(0, 10_000), spikes=st.integers(0, 4), kind=st.sampled_from(["noise", "steps", "pulses", "nan"]))
def test_the_compiled_look_leaves_out_no_isolated_sample(seed: int, spikes: int, kind: str):
    rng = np.random.default_rng(seed)
    volts = np.sin(rng.uniform(0.001, 0.05) * np.arange(rng.integers(3, 4000))) + 0.1 * rng.standard_cauchy()
    volts += rng.uniform(0.0, 0.1) * (rng.standard_cauchy if seed % 2 else rng.standard_normal)(volts.size)
    volts = {"steps": np.round(volts, 2), "pulses": np.where(volts > 0.9, 5.0, 0.0)}.get(kind, volts)
    at = rng.integers(0, volts.size, spikes)
    volts[at] += 10.0 ** rng.uniform(-2.0, 8.0, spikes)
    if kind == "nan":
        volts[rng.integers(0, volts.size)] = np.nan
    assert isolated_samples(volts, True).tolist() == isolated_samples(volts, False).tolist()


def test_pulses_that_the_alignment_found_are_not_looked_for_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    recording = read_recording(write_folder(tmp_path / "r", [LOG], Plan("hdf5")))
    cycles, plain = align(recording), summarise(recording)
    monkeypatch.setattr(check, "find_pulses", None)
    assert summarise(recording, cycles.pulses) == plain


def test_a_speed_far_from_nominal_is_told(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [LOG], Plan("hdf5"), rpm=300.0)
    codes = {finding.code for finding in summarise(read_recording(folder)).findings}
    assert "speed_off_nominal" in codes


def test_a_column_without_a_number_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    rows = [f"{n / 1000:.3f},nan,{n % 9},{5 * (n % 100 < 3)}" for n in range(3000)]
    (tmp_path / "log.csv").write_text("\n".join(["time [s],torque [Nm],pressure [bar],trigger [V]", *rows]) + "\n")
    folder = CALIBRATION.parent / "raw_examples" / "A_1250rpm"
    text = (folder / "recording.toml").read_text().replace("../../calibration", CALIBRATION.as_posix())
    head, _, _ = text.partition("[sensors")
    channels = [("torque", "N m"), ("pressure", "bar"), ("trigger", "V")]
    tail = "".join(
        f'[[channels]]\nquantity = "{name}"\nfile = "log.csv"\ngroup = ""\nchannel = "{name}"\nunit = "{unit}"\n'
        "sample_rate_hz = 1000.0\n" for name, unit in channels
    )  # fmt: skip
    (tmp_path / "recording.toml").write_text(f"{head}[sensors.torque]\n[sensors.pressure]\n{tail}")
    assert cli.main(["check", str(tmp_path)]) == 2
    shown = capsys.readouterr().out
    assert "the channel holds no number at all" in shown
    assert "nan" not in shown


def test_missing_pulses_are_no_other_speed(tmp_path: Path):
    volts = LOG.volts["trigger"].copy()
    high = volts > 0.5 * (volts.min() + volts.max())
    starts = np.flatnonzero(np.diff(high.astype(int)) == 1)
    width = int(np.argmin(high[starts[0] + 1 :])) + 2
    for start in starts[[4, 9, 10]]:
        volts[start - 1 : start + width] = volts[starts[0] - 5]
    summary = summarise(read_recording(write_folder(tmp_path / "r", [LOG.with_volts("trigger", volts)], Plan("hdf5"))))
    assert summary.channels[2].pulses == 19
    assert summary.speed_rpm == pytest.approx(600.0, rel=1e-4)
    codes = {finding.code for finding in summary.findings}
    assert "speed_off_nominal" not in codes
    assert "pulses_irregular" in codes


@pytest.mark.parametrize("jump", [3600.0, -1.0])
def test_a_clock_that_jumps_is_no_other_speed_of_a_wheel(tmp_path: Path, jump: float):
    folder = write_folder(tmp_path / "r", [LOG], Plan("hdf5"))
    config = read_recording(folder).config
    wheel = replace(config, trigger=replace(config.trigger, pulses_per_rev=36, missing_teeth=1))
    teeth = np.delete(np.arange(20 * 36), np.arange(35, 20 * 36, 36)) * 0.1 / 36
    teeth[300:] += jump
    assert check._speed(teeth, wheel) == pytest.approx(20.0 * np.pi, rel=2e-3)


@pytest.mark.parametrize(("share", "count", "expected"), [(0.004, 10, False), (0.05, 10, True), (0.05, 3, False)])
def test_noise_and_strays_below_vacuum_are_no_deep_vacuum(tmp_path: Path, share: float, count: int, expected: bool):
    plain = read_recording(write_folder(tmp_path / "plain", [LOG], Plan("hdf5"))).of("pressure")[0].calibration
    volts = LOG.volts["pressure"].copy()
    reach = plain.range_max / plain.gain
    volts[5000 : 5000 + count] = plain.zero_volts - (1.5e5 / plain.gain if not expected else 0.0) - share * reach
    folder = write_folder(tmp_path / "r", [LOG.with_volts("pressure", volts)], Plan("hdf5"))
    codes = {finding.code for finding in summarise(read_recording(folder)).findings}
    assert bool(codes & {"pressure_below_vacuum", "channels_swapped"}) is expected


@pytest.mark.parametrize(
    ("example", "slips", "told"),
    [
        ("A_1000rpm", {"Grp_torque": "Grp_Torque", "Prox_Trigger": "Prox_Triger"},
         ["no group 'Grp_Torque', did you mean 'Grp_torque'?", "no channel 'Prox_Triger'"]),
        ("A_1250rpm", {'unit = "V"': 'unit = "mV"', "Geber": "Gebr"},
         ["the file's unit is 'V'", "the file's unit is 'V'", "no column 'Gebr'"]),
    ],
)  # fmt: skip
def test_all_that_is_wrong_with_the_channels_of_one_file_is_told_at_once(tmp_path: Path, example, slips, told):
    """A misspelt group hid a misspelt channel, the first wrong unit the others."""
    shutil.copytree(EXAMPLES / example, tmp_path / "raw" / example)
    shutil.copytree(EXAMPLES.parent / "calibration", tmp_path / "calibration")
    config = tmp_path / "raw" / example / "recording.toml"
    text = config.read_text(encoding="utf-8")
    for right, wrong in slips.items():
        text = text.replace(f'"{right}"' if "=" not in right else right, f'"{wrong}"' if "=" not in wrong else wrong)
    config.write_text(text, encoding="utf-8")
    with pytest.raises(Refusals) as refusals:
        read_recording(config)
    assert len(refusals.value.problems) == len(told)
    for words, problem in zip(told, refusals.value.problems, strict=True):
        assert words in problem

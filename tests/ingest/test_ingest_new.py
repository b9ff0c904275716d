"""From a fresh log to a recording that `check` passes: `new`, one edit, `check`. What is not known is asked for."""

import json
import re
import resource
import shutil
from pathlib import Path

import numpy as np
import pytest
from camtorque import cli
from camtorque.config.recording import load_recording_config
from camtorque.ingest import read_recording
from camtorque.ingest.new_recording import new_recording
from camtorque.ingest.proposal import is_pulse_train, look_into
from camtorque.ingest.raw import ArraySource, FileChannel
from camtorque.ingest.wheel import wheel_of
from camtorque.records import Refusal
from damaged.build import PLANS, log_file
from damaged.logs import CALIBRATION, clean_log, write_folder

EXAMPLES = CALIBRATION.parent / "raw_examples"
ANSWERS = {
    "pump_id": '"FIP-A"',
    "base_circle_radius_m": "0.02",
    "roller_radius_m": "0.008",
    "roller_width_m": "0.005",
    "cam_mass_kg": "0.25",
    "cam_inertia_kg_m2": "5e-5",
    "follower_mass_kg": "0.075",
    "spring_stiffness_N_per_m": "20000",
    "spring_preload_N": "110",
    "plunger_diameter_m": "0.008",
    "youngs_modulus_cam_Pa": "210e9",
    "youngs_modulus_roller_Pa": "210e9",
    "cam_table": f'"{(CALIBRATION / "cam_A.csv").as_posix()}"',
    "nominal_angle_deg": "20",
    "installation_tolerance_deg": "1.5",
}
"""What an engineer fills in."""


def fresh_log(folder: Path, source: str = "A_1250rpm") -> Path:
    """Write the values of an example as a logger does that has scaled already."""
    recording = read_recording(EXAMPLES / source)
    torque, pressure, trigger = (recording.of(name)[0] for name in ("torque", "pressure", "trigger"))
    columns = [torque.read(), 1e-5 * pressure.read(), trigger.read_volts()]
    times = np.arange(torque.n_samples) / torque.sample_rate
    rows = zip(times, *columns, strict=True)
    lines = ["time [s];Drehmoment [Nm];Leitungsdruck [bar];Geber [V]"]
    lines += [f"{t:.6f};{a:.3f};{b:.2f};{c:.3f}" for t, a, b, c in rows]
    folder.mkdir()
    file = folder / "log.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def test_from_a_fresh_log_to_check_in_two_commands_and_one_edit(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = fresh_log(tmp_path / "lab")
    assert cli.main(["new", str(file)]) == 0
    printed = capsys.readouterr().out
    assert [name in printed for name in ("torque", "pressure", "trigger")] == [True] * 3
    toml = file.parent / "recording.toml"
    text = toml.read_text(encoding="utf-8")
    asked = re.findall(r'^(\w+) = "\?"', text, re.MULTILINE)
    assert set(asked) == set(ANSWERS)
    assert cli.main(["check", str(file.parent)]) == 2
    assert f"{len(ANSWERS)} things have to be put right" in capsys.readouterr().out
    toml.write_text(re.sub(r'^(\w+) = "\?"', lambda m: f"{m[1]} = {ANSWERS[m[1]]}", text, flags=re.MULTILINE))
    assert cli.main(["check", str(file.parent), "--json"]) == 0
    doc = json.loads(capsys.readouterr().out)
    assert doc["usable"] == ["align", "run"]
    codes = {row["code"] for row in doc["findings"]}
    # what nobody stated is assumed, and told
    assert {"accuracy_assumed", "delay_assumed", "already_scaled", "follower_offset_assumed"} <= codes


def test_keys_of_the_rig_that_may_be_left_out_stand_there_with_what_is_assumed(tmp_path: Path):
    text = new_recording(tmp_path, look_into([fresh_log(tmp_path / "lab")]), None).text
    said = dict(re.findall(r"^# (\w+) =   #.*; (.*) is assumed where it is left out$", text, re.MULTILINE))
    assumed = {"rotation": '"positive"', "follower_offset_m": "0.0", "edge": '"rising"', "switching_delay_typ_s": "0.0"}
    assert assumed.items() <= said.items()


def test_like_another_recording_nothing_is_left_to_ask(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "lab").mkdir()
    log = shutil.copy(EXAMPLES / "A_1250rpm" / "A_1250rpm_all.csv", tmp_path / "lab")
    assert cli.main(["new", str(log), "--like", str(EXAMPLES / "A_1000rpm"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unknown"] == []
    new, old = load_recording_config(tmp_path / "lab"), load_recording_config(EXAMPLES / "A_1250rpm")
    assert new.pump.cam_table_path.samefile(old.pump.cam_table_path)
    assert new.trigger == old.trigger
    assert new.nominal_speed == pytest.approx(old.nominal_speed, rel=1e-3)
    assert new.sensors["torque"].zero_before_volts is None  # a reading of the other run
    assert np.array_equal(read_recording(tmp_path / "lab").of("torque")[0].read_volts(0, 100),
                          read_recording(EXAMPLES / "A_1250rpm").of("torque")[0].read_volts(0, 100))  # fmt: skip


def test_like_a_recording_that_still_asks_all_of_it_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Its unknown lift table became a path of that name, ../first/?, and was asked for no more."""
    assert cli.main(["new", str(fresh_log(tmp_path / "first"))]) == 0
    log = fresh_log(tmp_path / "second")
    capsys.readouterr()
    assert cli.main(["new", str(log), "--like", str(tmp_path / "first"), "--json"]) == 0
    assert sorted(json.loads(capsys.readouterr().out)["unknown"]) == sorted(ANSWERS)


def test_values_that_are_asked_for_twice_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    log = shutil.copy(EXAMPLES / "A_1250rpm" / "A_1250rpm_all.csv", tmp_path)
    assert cli.main(["new", str(log)]) == 0
    printed = capsys.readouterr().out
    assert '17 values are marked "?": pump_id' in printed
    assert ", sensitivity_V_per_unit (2 times)\n" in printed


def test_a_full_disk_leaves_no_first_recording_behind(tmp_path: Path):
    """An empty file stayed, which the next `new` would not overwrite and `check` called empty."""
    log = shutil.copy(EXAMPLES / "A_1250rpm" / "A_1250rpm_all.csv", tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        assert cli.main(["new", str(log)]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [path.name for path in tmp_path.iterdir()] == ["A_1250rpm_all.csv"]
    assert cli.main(["new", str(log)]) == 0


def test_an_existing_recording_is_never_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder = write_folder(tmp_path / "r", [clean_log(revolutions=5.0)], PLANS["csv"])
    before = (folder / "recording.toml").read_bytes()
    assert cli.main(["new", str(log_file(folder))]) == 2
    assert "is there already and is not overwritten" in capsys.readouterr().err
    assert (folder / "recording.toml").read_bytes() == before


@pytest.mark.parametrize("name", sorted(set(PLANS) - {"mat"}))
def test_every_format_is_looked_into(tmp_path: Path, name: str):
    folder = write_folder(tmp_path / "r", [clean_log(revolutions=12.0)], PLANS[name])
    found = {item.quantity: item.channel.name for item in look_into([log_file(folder)])}
    assert found == {"torque": "Torque", "pressure": "Line_Pressure", "trigger": "Prox_Trigger"}


def test_names_of_a_stranger_stay_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = tmp_path / "log.csv"
    head = 'time [s],torque\x1b[31m [Nm],"=cmd|calc" [V],<b>p</b> [bar]'
    rows = [f"{n / 1000:.3f},{n % 7}.5,{5 * (n % 50 < 5)},{n % 9}" for n in range(2000)]
    file.write_text("\n".join([head, *rows]) + "\n")
    assert cli.main(["new", str(file)]) == 0
    assert "\x1b" not in capsys.readouterr().out
    assert "\x1b" not in (tmp_path / "recording.toml").read_text()
    assert cli.main(["check", str(tmp_path)]) == 2
    assert "\x1b" not in capsys.readouterr().out


def pulses(teeth: int, missing: int, turns: int = 12, samples: int = 40) -> FileChannel:
    turn = np.concatenate(
        [np.repeat([5.0, 0.0], samples // 2) for _ in range(teeth - missing)] + [np.zeros(missing * samples)]
    )
    values = np.tile(turn, turns)
    return FileChannel("", "x", "V", values.size, float(teeth * samples * 10), "", ArraySource(values))


@pytest.mark.parametrize(("teeth", "missing"), [(60, 2), (36, 1), (6, 4), (4, 2), (1, 0)])
def test_the_pulses_tell_the_wheel(teeth: int, missing: int):
    wheel = wheel_of(pulses(teeth, missing))
    assert wheel is not None
    assert (wheel.pulses_per_rev, wheel.missing_teeth) == (teeth, missing)
    assert wheel.speed == pytest.approx(10.0, rel=1e-6)


def test_a_pressure_is_no_pulse_train():
    log = clean_log(revolutions=12.0)
    assert is_pulse_train(log.volts["trigger"])
    assert not is_pulse_train(log.volts["torque"])
    assert not is_pulse_train(np.random.default_rng(1).normal(size=5000))


def test_columns_that_nothing_names_are_asked_for_and_still_ones_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    file = tmp_path / "log.csv"
    file.write_text("a,b\n" + "".join(f"{n % 13},{n * n % 17}\n" for n in range(500)))
    assert new_recording(tmp_path, look_into([file]), None).unknown.count("quantity") == 2
    assert cli.main(["new", str(file)]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()[:2]] == ["?", "?"]
    file.write_text("a,b\n" + "1,2\n" * 500)
    found = look_into([file])
    with pytest.raises(Refusal, match="no channel changes; there is no torque"):
        new_recording(tmp_path, found, None)


@pytest.mark.parametrize(("step", "rate"), [(1e-4, 1e4), (0.1, None)])
def test_a_time_without_a_unit_is_only_taken_where_it_can_be_nothing_but_seconds(tmp_path: Path, step: float, rate):
    file = tmp_path / "log.csv"
    file.write_text("time,torque\n" + "".join(f"{n * step:.4f},{n % 9}\n" for n in range(500)))
    (item,) = look_into([file])
    assert item.channel.sample_rate == (None if rate is None else pytest.approx(rate))


def test_a_range_is_printed_with_its_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = tmp_path / "log.csv"
    file.write_text("torque_Nm,misc\n" + "".join(f"{n % 13},{n % 17}\n" for n in range(500)))
    assert cli.main(["new", str(file)]) == 0
    printed = capsys.readouterr().out
    assert "0 to 12 N m\n" in printed
    assert "0 to 16 without a unit\n" in printed


def test_two_loggers_are_asked_for_their_clocks(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    logs = [shutil.copy(path, tmp_path) for path in sorted((EXAMPLES / "A_0750rpm").glob("*.mf4"))]
    assert cli.main(["new", *map(str, logs), "--like", str(EXAMPLES / "A_1000rpm"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unknown"] == ["clock", "clock"]
    toml = tmp_path / "recording.toml"
    assert "independent: own clock\n" in toml.read_text()
    toml.write_text(toml.read_text().replace('clock = "?"', 'clock = "independent"'))
    assert cli.main(["check", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["usable"] == ["align", "run"]


def test_of_a_file_for_each_channel_one_is_the_trigger(tmp_path: Path):
    recording = read_recording(EXAMPLES / "A_1250rpm")
    torque, pressure, trigger = (recording.of(name)[0].read_volts(0, 25_000)[::5] for name in
                                 ("torque", "pressure", "trigger"))  # fmt: skip
    head = ["LECROYWS3104z,12345,Waveform", "Segments,1,SegmentSize,5000", "Segment,TrigTime,TimeSinceSegment1",
            "#1,06-Mar-2013 11:51:48,0", "Time,Ampl"]  # fmt: skip
    files = [tmp_path / f"C{number}Trace00000.csv" for number in (1, 2, 3)]
    for file, values in zip(files, (torque, pressure, trigger), strict=True):
        body = [f"{1e-4 * n:.6f},{value:.5f}" for n, value in enumerate(values)]
        file.write_text("\r\n".join([*head, *body, ""]), encoding="utf-8")
    assert [item.quantity for item in look_into(files)] == ["", "", "trigger"]


def log_with_wheel(folder: Path, teeth: int, missing: int) -> Path:
    """Write a log of the example whose trigger is a tooth wheel on the same shaft."""
    wheel = pulses(teeth, missing, turns=20, samples=20)
    values, rate = wheel.source.read(0, wheel.n_samples), wheel.sample_rate
    beat = np.sin(2.0 * np.pi * 10.0 * np.arange(values.size) / float(rate or 1.0))
    file = folder / "log.npz"
    np.savez(file, trigger=values, torque_Nm=30.0 * beat, pressure_bar=300.0 + 200.0 * beat, fs=rate)
    return file


def test_the_trigger_of_another_wheel_is_not_taken_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """One tooth of the other recording and the gap of this one were mixed: 'missing_teeth: 1 of 1 pulses'."""
    assert cli.main(["new", str(log_with_wheel(tmp_path, 36, 1)), "--like", str(EXAMPLES / "A_1000rpm"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unknown"] == ["nominal_angle_deg", "installation_tolerance_deg"]
    text = (tmp_path / "recording.toml").read_text()
    assert "its [trigger] is not taken over" in text
    assert "pulses_per_rev = 36" in text
    assert 'pump_id = "FIP-A"' in text
    again = tmp_path / "again"
    (tmp_path / "recording.toml").write_text(text.replace('deg = "?"', "deg = 1.5"))
    assert cli.main(["new", str(tmp_path / "log.npz"), "--like", str(tmp_path), "--out", str(again), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unknown"] == []


def test_one_pulse_of_the_other_recording_is_no_wheel_of_many(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """The speed alone was asked for, and the torque said not to follow a cam of 450 000 rpm."""
    args = ["new", str(log_with_wheel(tmp_path, 400, 0)), "--like", str(EXAMPLES / "A_1000rpm"), "--json"]
    assert cli.main(args) == 0
    assert json.loads(capsys.readouterr().out)["unknown"] == ["nominal_speed_rpm", "pulses_per_rev"]
    assert "its pulses_per_rev is not taken over" in (tmp_path / "recording.toml").read_text()


def test_newton_metres_in_small_letters_are_asked_for_and_no_nanometres(tmp_path: Path):
    """torque_nm became a needle lift, and nothing was unknown."""
    file = tmp_path / "log.csv"
    rows = (f"{n * 5e-5:.5f},{50.0 * np.sin(0.01 * n):.3f},{n % 97}" for n in range(2000))
    file.write_text("\n".join(("time_s,torque_nm,pressure_bar", *rows)) + "\n", encoding="utf-8")
    torque, pressure = look_into([file])
    assert (torque.quantity, torque.unit, pressure.unit) == ("torque", "", "bar")


@pytest.mark.parametrize(("text", "match"), [
    ("pump = 3", "pump: found 3, expected a table .pump."),
    ("[sensors]\ntorque = 1", "torque: found 1, expected a table .sensors.torque."),
    ("channels = 3", "expected at least one ..channels.. table, found 3"),
])  # fmt: skip
def test_another_recording_that_is_none_is_refused(tmp_path: Path, text: str, match: str):
    other = tmp_path / "other.toml"
    other.write_text(text)
    proposals = look_into([EXAMPLES / "A_1250rpm" / "A_1250rpm_all.csv"])
    with pytest.raises(Refusal, match=match):
        new_recording(tmp_path, proposals, other)


def test_a_counter_that_states_its_counts_leaves_nothing_to_ask(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """'rev/1024, which is no known unit'; once it was typed: 'rev/1024 is not known; rev/1024 is used'."""
    recording = read_recording(EXAMPLES / "A_1250rpm")
    torque, pressure = (recording.of(name)[0].read_volts(0, 50_000)[::5] for name in ("torque", "pressure"))
    seconds = 1e-4 * np.arange(torque.size)
    counts = np.floor(1024.0 * (seconds * 1250.0 / 60.0 % 1.0))
    rows = np.column_stack([seconds, counts, torque, pressure])
    head = "Time [s],Shaft angle [rev/1024],Torque [V],Line pressure [V]"
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header=head, comments="")
    assert cli.main(["new", str(tmp_path / "log.csv"), "--like", str(EXAMPLES / "A_1250rpm"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unknown"] == ["nominal_angle_deg", "installation_tolerance_deg"]
    text = (tmp_path / "recording.toml").read_text()
    assert 'unit = "rev/1024"' in text
    assert re.search(r"nominal_speed_rpm = 12(49|50)\.\d", text)
    (tmp_path / "recording.toml").write_text(text.replace('deg = "?"', "deg = 1.5"))
    assert "unit_unknown" not in {finding.code for finding in read_recording(tmp_path).findings}


def test_a_pump_file_names_its_pump(tmp_path: Path):
    """docs/predict.md: its id is the pump_id of its recordings; it was asked for."""
    proposals = look_into([EXAMPLES / "A_1250rpm" / "A_1250rpm_all.csv"])
    new = new_recording(tmp_path, proposals, CALIBRATION / "pump_A.toml")
    assert 'pump_id = "FIP-A"' in new.text
    assert "pump_id" not in new.unknown


def test_a_pump_file_without_a_name_leaves_it_to_be_asked_for(tmp_path: Path):
    (tmp_path / "pump.toml").write_text('[pump]\nid = ""\n')
    proposals = look_into([EXAMPLES / "A_1250rpm" / "A_1250rpm_all.csv"])
    assert "pump_id" in new_recording(tmp_path, proposals, tmp_path / "pump.toml").unknown


def test_a_link_in_the_place_of_a_first_recording_is_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Its recording.toml may be on a disk that is not mounted."""
    log = shutil.copy(EXAMPLES / "A_1250rpm" / "A_1250rpm_all.csv", tmp_path)
    (tmp_path / "recording.toml").symlink_to(tmp_path / "elsewhere" / "recording.toml")
    assert cli.main(["new", str(log)]) == 2
    assert "is there already and is not overwritten" in capsys.readouterr().err
    assert (tmp_path / "recording.toml").is_symlink()


def test_a_wheel_without_a_tooth_is_told_what_its_keys_count(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [clean_log(revolutions=5.0)], PLANS["csv"])
    sheet = folder / "recording.toml"
    sheet.write_text(sheet.read_text().replace("[trigger]", "[trigger]\nmissing_teeth = 1"))
    with pytest.raises(Refusal, match="1 of 1 pulses per revolution are missing, expected fewer than pulses_per_rev, "):
        load_recording_config(folder)


@pytest.mark.parametrize("name", ["Null", "Prox"])
def test_one_pulse_a_turn_beside_an_encoder_is_its_index(tmp_path: Path, name: str):
    """As a trigger it would tell the angle alone, and the tracks of the encoder nothing."""
    angle = np.arange(60_000) * (12.0 / 60_000)
    tracks = {"Spur A": (360 * angle) % 1.0 < 0.5, "Spur B": (360 * angle - 0.25) % 1.0 < 0.5, name: angle % 1.0 < 0.01}
    file = tmp_path / "log.npz"
    np.savez(file, fs=20e3, torque_Nm=np.sin(angle), **{key: values.astype(float) for key, values in tracks.items()})
    assert cli.main(["new", str(file)]) == 0
    text = (tmp_path / "recording.toml").read_text(encoding="utf-8")
    assert re.findall(r'^quantity = "(\w+)"', text, re.MULTILINE) == ["torque", "encoder_a", "encoder_b", "index"]
    assert "pulses_per_rev = 360" in text
    assert 'reference = "index"' in text


def test_tracks_that_are_called_a_b_and_z_are_those_of_an_encoder(tmp_path: Path):
    angle = np.arange(60_000) * (12.0 / 60_000)
    tracks = {"A": (360 * angle) % 1.0 < 0.5, "B": (360 * angle - 0.25) % 1.0 < 0.5, "Z": angle % 1.0 < 0.01}
    file = tmp_path / "log.npz"
    np.savez(file, fs=20e3, torque_Nm=np.sin(angle), **{key: 5.0 * values for key, values in tracks.items()})
    found = {item.channel.name: (item.quantity, item.unit) for item in look_into([file])}
    assert found["A"] == ("encoder_a", "V")
    assert found["B"] == ("encoder_b", "V")
    assert found["Z"] == ("index", "V")


def test_pulses_of_zero_and_one_are_no_volts(tmp_path: Path):
    angle = np.arange(60_000) * (12.0 / 60_000)
    file = tmp_path / "log.npz"
    np.savez(file, fs=20e3, torque_Nm=np.sin(angle), trigger=(angle % 1.0 < 0.1).astype(float))
    (unit,) = (item.unit for item in look_into([file]) if item.quantity == "trigger")
    assert unit == "logic"

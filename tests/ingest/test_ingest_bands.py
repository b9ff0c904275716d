"""A slip of unit is refused with the value that was probably meant; nonsense numbers never pass; all errors at once."""

import pickle
from pathlib import Path

import pytest
from camtorque.config.recording import load_recording_config
from camtorque.config.tables import Refusals
from camtorque.records import Refusal
from test_ingest_config import TEXT, write

NUMBERS = sorted({line for line in TEXT.splitlines() if line.partition(" = ")[2].replace(".", "").isdigit()})
SLIPS = [
    ("plunger_diameter_m = 0.008", "plunger_diameter_m = 8", "did you mean 8 mm = 0.008"),
    ("plunger_diameter_m = 0.008", "plunger_diameter_m = 0.8", "did you mean 0.8 cm = 0.008"),
    ("base_circle_radius_m = 0.02", "base_circle_radius_m = 20.0", "did you mean 20 mm = 0.02"),
    ("roller_radius_m = 0.008", "roller_radius_m = 8", "did you mean 8 mm = 0.008"),
    ("spring_stiffness_N_per_m = 20000.0", "spring_stiffness_N_per_m = 20", "did you mean 20 N/mm = 20000"),
    ("cam_inertia_kg_m2 = 5e-05", "cam_inertia_kg_m2 = 50", "did you mean 50 kg mm2 = 5e-05"),
    ("youngs_modulus_cam_Pa = 210000000000.0", "youngs_modulus_cam_Pa = 210", "did you mean 210 GPa = 2.1e.11"),
    ("switching_delay_typ_s = 4e-05", "switching_delay_typ_s = 40", "did you mean 40 us = 4e-05"),
]


@pytest.mark.parametrize(("old", "new", "message"), SLIPS)
def test_a_slip_of_unit_is_named(tmp_path: Path, old: str, new: str, message: str):
    assert old in TEXT
    with pytest.raises(Refusal, match=message):
        load_recording_config(write(tmp_path, TEXT.replace(old, new)))


@pytest.mark.parametrize("line", NUMBERS)
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e308", "-1e308", "1" + "0" * 400, '"1"', "true", "[]"])
def test_no_number_of_the_file_may_be_nonsense(tmp_path: Path, line: str, value: str):
    key = line.split(" = ")[0]
    with pytest.raises(Refusal, match=key):
        load_recording_config(write(tmp_path, TEXT.replace(line, f"{key} = {value}", 1)))


def test_all_errors_are_said_at_once(tmp_path: Path):
    text = TEXT.replace("plunger_diameter_m = 0.008", "plunger_diameter_m = 8").replace(
        'edge = "rising"', 'edge = "up"'
    )
    text = text.replace("nominal_speed_rpm = 600.0\n", "")
    with pytest.raises(Refusals, match="and 2 more; 'camtorque check' lists them all") as caught:
        load_recording_config(write(tmp_path, text))
    assert len(caught.value.problems) == 3
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.problems) == (str(caught.value), caught.value.problems)


def test_a_configuration_goes_to_a_worker_and_back(tmp_path: Path):
    config = load_recording_config(write(tmp_path, TEXT))
    assert pickle.loads(pickle.dumps(config)) == config


@pytest.mark.parametrize(
    ("tail", "message"),
    [
        ("a = " + "[" * 5000, "nested too deep|not valid TOML"),
        ("a = " + "{a = " * 3000, "nested too deep|not valid TOML"),
        ("a = " + "1" * 5000, "not valid TOML"),
        (".".join("a" * 100_000) + " = 1", "a key of 100000 parts"),
        ("[" + ".".join("a" * 100_000) + "]", "a key of 100000 parts"),
        ("a = {" + ".".join("a" * 100_000) + " = 1}", "a key of 100000 parts"),
        (
            "\n".join(f"a.b{n} = 1" for n in range(200_000)),
            "has 2888890 bytes|bytes, a TOML file of a bench has at most",
        ),
        ('id = "\\u001b[31m"', "control characters|Cannot overwrite|not valid TOML"),
    ],
)
def test_a_bomb_is_refused_quickly(tmp_path: Path, tail: str, message: str):
    with pytest.raises(Refusal, match=message):
        load_recording_config(write(tmp_path, TEXT.replace("[recording]\n", "[recording]\n" + tail + "\n", 1)))


def test_the_largest_file_is_read_in_bounded_time(tmp_path: Path):
    rows = "\n".join(f"a{n}.b.c = 1" for n in range(30_000))
    assert len(rows) < 512 * 1024 - len(TEXT)
    config = load_recording_config(write(tmp_path, TEXT + "\n[extra]\n" + rows))
    assert [finding.code for finding in config.findings] == ["unknown_key"]


def test_control_characters_in_a_name_are_refused(tmp_path: Path):
    with pytest.raises(Refusal, match="control characters") as caught:
        load_recording_config(write(tmp_path, TEXT.replace('id = "x"', 'id = "\\u001b[31mred"')))
    assert "\x1b" not in str(caught.value)


def test_fluid_drive_and_defaults(tmp_path: Path):
    extra = """
[fluid]
name = "ISO 4113"
temperature_C = 40.0
bulk_modulus_Pa = 1.6e9
feed_pressure_bar = 3.0

[drive]
kind = "flywheel"
inertia_kg_m2 = 0.5
speed_loop_Hz = 5.0
"""
    text = TEXT.replace("level_V = 5.0\nswitching_delay_typ_s = 4e-05\n", "")
    config = load_recording_config(write(tmp_path, text + extra))
    assert (config.fluid.temperature, config.fluid.bulk_modulus, config.fluid.feed_pressure) == (313.15, 1.6e9, 3e5)
    assert (config.drive.inertia, config.drive.speed_loop) == (0.5, 5.0)
    assert config.trigger.switching_delay == 0.0
    bare = load_recording_config(write(tmp_path, TEXT))
    assert (bare.fluid.name, bare.fluid.temperature, bare.drive.inertia) == ("", None, None)


def test_kelvin_for_degrees_celsius_are_named(tmp_path: Path):
    with pytest.raises(Refusal, match=r"temperature_C: found 313, expected .* did you mean 313 K = 39\.85\?"):
        load_recording_config(write(tmp_path, TEXT + "\n[fluid]\ntemperature_C = 313\n"))


def test_without_a_pump_the_configuration_is_read_and_the_pump_is_asked_for_when_needed(tmp_path: Path):
    start, stop = TEXT.index("[pump]"), TEXT.index("[trigger]")
    config = load_recording_config(write(tmp_path, TEXT[:start] + TEXT[stop:]))
    with pytest.raises(Refusal, match=r"the table \[pump\] is missing; the model needs it"):
        _ = config.pump


def test_a_zero_in_volts_for_a_channel_in_bar_is_refused(tmp_path: Path):
    text = TEXT.replace('channel = "Line_Pressure"\nunit = "V"', 'channel = "Line_Pressure"\nunit = "bar"')
    with pytest.raises(Refusal, match=r"the channel is in bar, the zero of \[sensors.pressure\] in V"):
        load_recording_config(write(tmp_path, text))


def test_a_roller_mass_of_zero_means_the_same_in_both_files(tmp_path: Path):
    text = TEXT.replace("[trigger]", "roller_mass_kg = 0\nroller_inertia_kg_m2 = 0\n[trigger]")
    assert load_recording_config(write(tmp_path, text)).pump.roller_mass == 0.0

"""recording.toml: every required key is required, every bad value refused, every unknown key told."""

import gzip
import re
import tomllib
from importlib import import_module
from pathlib import Path

import pytest
from camtorque.config.recording import load_recording_config
from camtorque.config.schemas import RECORDING_TABLES
from camtorque.config.tables import Refusals, read_toml
from camtorque.ingest.formats import FORMATS, declared_format, file_format, first_bytes
from camtorque.ingest.pump_file import read_pump
from camtorque.ingest.table_file import read_small_table
from camtorque.records import Refusal
from camtorque.units import DEGREE, RPM, did_you_mean
from damaged.logs import CALIBRATION, TOML

TAIL = """
[[loggers]]
id = "DAQ1"
clock = "single"

[[channels]]
quantity = "pressure"
file = "log.h5"
group = "Main"
channel = "Line_Pressure"
unit = "V"
logger = "DAQ1"
sample_rate_hz = 10000.0
sensor = "K4067-40117"

[[channels]]
quantity = "trigger"
file = "log.h5"
group = "Main"
channel = "Prox_Trigger"
unit = "V"
logger = "DAQ1"
sample_rate_hz = 10000.0
sensor = "PROX-01"
"""
TEXT = TOML.format(id="x", rpm=600.0, file_format="hdf5", dialect="", calibration=CALIBRATION.as_posix()) + TAIL
TABLE_REQUIRED = {key.name for schema in RECORDING_TABLES.values() for key in schema.keys if key.required}


def write(tmp_path: Path, text: str) -> Path:
    (tmp_path / "recording.toml").write_text(text, encoding="utf-8")
    return tmp_path


def required_lines() -> list[str]:
    lines = [line for line in TEXT.splitlines() if " = " in line]
    return sorted({line for line in lines if line.split(" = ")[0] in TABLE_REQUIRED | {"schema"}})


def test_values_come_out_in_si(tmp_path: Path):
    config = load_recording_config(write(tmp_path, TEXT))
    assert config.nominal_speed == 600.0 * RPM
    assert config.trigger.nominal_angle == 20.0 * DEGREE
    assert config.rotation == 1
    assert config.findings == ()
    assert config.pump.poisson_ratio == 0.3
    assert config.pump.roller_mass is None
    assert config.text == TEXT


@pytest.mark.parametrize(("name", "text"), [
    ("sensors", r"sensors: found 3, expected a table \[sensors\]"),
    ("loggers", r"expected at least one \[\[loggers\]\] table, found 3"),
    ("channels", r"expected at least one \[\[channels\]\] table, found 3"),
])  # fmt: skip
def test_what_is_no_table_is_told_once(tmp_path: Path, name: str, text: str):
    rest = re.sub(rf"(?ms)^\[\[?{name}\b.*?(?=^\[\[?(?!{name}\b)|\Z)", "", TEXT)
    with pytest.raises(Refusals, match=text) as refused:
        load_recording_config(write(tmp_path, f"{name} = 3\n{rest}"))
    assert len(refused.value.problems) == 1


@pytest.mark.parametrize(("name", "typed"), [("loggers", "loggerz"), ("channels", "channel")])
def test_a_missing_row_of_tables_is_named_with_what_looks_like_it(tmp_path: Path, name: str, typed: str):
    with pytest.raises(Refusal, match=rf"at least one \[\[{name}\]\] table, found .*, is it '{typed}'\?"):
        load_recording_config(write(tmp_path, TEXT.replace(f"[[{name}]]", f"[[{typed}]]")))


def test_wrong_loggers_and_idle_stretches_are_told_at_once(tmp_path: Path):
    wrong = TEXT.replace('logger = "DAQ1"', 'logger = "DAQ2"').replace(
        "[sensors.pressure]", "[sensors.pressure]\nidle_to_s = 2.0"
    )
    with pytest.raises(Refusals, match="needs idle_from_s < idle_to_s") as refused:
        load_recording_config(write(tmp_path, wrong))
    channels = refused.value.problems[1:]
    assert [f"no. {number} logger: found 'DAQ2'" in text for number, text in enumerate(channels, 1)] == [True] * 2


def test_file_and_folder_are_the_same(tmp_path: Path):
    folder = write(tmp_path, TEXT)
    assert load_recording_config(folder) == load_recording_config(folder / "recording.toml")


@pytest.mark.parametrize("line", required_lines())
def test_a_missing_key_is_refused(tmp_path: Path, line: str):
    key = line.split(" = ")[0]
    with pytest.raises(Refusal, match=rf"{key}.*(missing|no table|expected)|is missing|schema is None"):
        load_recording_config(write(tmp_path, TEXT.replace(line + "\n", "", 1)))


@pytest.mark.parametrize("line", required_lines())
def test_a_wrong_type_is_refused(tmp_path: Path, line: str):
    key = line.split(" = ")[0]
    with pytest.raises(Refusal, match=key):
        load_recording_config(write(tmp_path, TEXT.replace(line, f"{key} = [1]", 1)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('rotation = "positive"', 'rotation = "positiv"', "did you mean 'positive'"),
        ('edge = "rising"', 'edge = "up"', "expected one of rising, falling"),
        ('clock = "single"', 'clock = "singel"', "did you mean 'single'"),
        ('quantity = "trigger"', 'quantity = "triger"', "did you mean 'trigger'"),
        ('logger = "DAQ1"', 'logger = "DAQ2"', "found 'DAQ2'"),
        ("nominal_speed_rpm = 600.0", "nominal_speed_rpm = nan", "expected a number from 1 to 30000 rpm"),
        ("pulses_per_rev = 1", "pulses_per_rev = 1.5", "expected a whole number"),
        ("pulses_per_rev = 1", "pulses_per_rev = 0", "expected a number from 1 to"),
        ("pulses_per_rev = 1", "pulses_per_rev = 60\nmissing_teeth = 60", "60 of 60 pulses"),
        ("pulses_per_rev = 1", "pulses_per_rev = 60\nmissing_teeth = 2\ndouble_tooth = true", "not both"),
        ("pulses_per_rev = 1", "pulses_per_rev = 1\ndouble_tooth = 1", "expected true or false"),
        ("[sensors.pressure]", "[sensors.presure]", "did you mean 'pressure'"),
        ('sensor = "K4067-40117"', 'sensor = "K4067-1"', "has serial 'K4067-40117'"),
        ('quantity = "pressure"', 'quantity = "trigger"', "more than once"),
        (
            "zero_after_V = 0.0301",
            "zero_after_V = 0.0301\nidle_from_s = 3.0\nidle_to_s = 1.0",
            "idle_from_s < idle_to_s",
        ),
        ("zero_after_V = 0.0301", "zero_after_V = 0.0301\nidle_from_s = 3.0", "idle_from_s < idle_to_s"),
        ("[trigger]", "[triger]", "is it 'triger'"),
        ("roller_radius_m", "rollerradius_m", "roller_radius_m: this key is missing, is it 'rollerradius_m'?"),
        ("roller_radius_m = 0.008\n", "", "roller_radius_m: this key is missing; radius"),
        ("[pump]", "[pump", "is not valid TOML"),
        # a path of Windows: the line says more than the grammar
        (
            'file = "log.h5"',
            r'file = "logs\log.h5"',
            r"not valid TOML: .*: 'file = \"logs.+log.h5\"'; a path has / between",
        ),
        ("[pump]", "[pump]\n[pump]", r"not valid TOML: Cannot declare .*; it is given twice: remove one$"),
        (
            "roller_radius_m = 0.008",
            "roller_radius_m = 0,008 # mm",
            r"line \d+: found 'roller_radius_m = 0,008 .*comma",
        ),
        (
            "roller_radius_m = 0.008",
            "roller_radius_m = 0.008\nroller_radius_m = 0.008",
            "it is given twice: remove one",
        ),
        ('rotation = "positive"', "rotation = \u201cpositive\u201d", 'write straight quotes "$'),
        ('rotation = "positive"', "rotation = positive", "'rotation = positive'; text stands in quotes, as in edge"),
        (
            '"fip-bench-recording/1"',
            '"camtorque-pump/1"',
            "expected 'fip-bench-recording/1'; this is a file of another",
        ),
        ("recording/1", "recording/2", """schema is 'fip-bench-recording/2'.*write schema = "fip-.*" at the top$"""),
        ("roller_radius_m = 0.008", "roller_radius_m = 8 mm", "'roller_radius_m = 8 mm'; write the number alone"),
        ("nominal_speed_rpm = 600.0", "nominal_speed_rpm = 1.600,0", "no sign between thousands: write 1234.5"),
        (
            "nominal_speed_rpm = 600.0",
            "nominal_speed_rpm = 1979-05-27",
            "found the date or time 1979-05-27, expected a number",
        ),
        ("nominal_speed_rpm = 600.0", f"nominal_speed_rpm = {'9' * 5000}", "value has 5000 digits$"),
    ],
)
def test_a_bad_value_is_refused(tmp_path: Path, old: str, new: str, message: str):
    with pytest.raises(Refusal, match=message):
        load_recording_config(write(tmp_path, TEXT.replace(old, new)))


def test_no_trigger_is_refused(tmp_path: Path):
    text = TEXT[: TEXT.rindex("[[channels]]")]
    with pytest.raises(Refusal, match="no channel has quantity 'trigger'"):
        load_recording_config(write(tmp_path, text))


def test_a_key_that_is_missed_is_listed_beside_one_that_is_not_known(tmp_path: Path):
    """Three of six faults were listed; the slips of a key came after the others had been put right."""
    text = TEXT.replace("nominal_angle_deg", "nominal_angel_deg")
    with pytest.raises(Refusal) as refused:
        load_recording_config(write(tmp_path, text))
    told = "\n".join(refused.value.problems)
    assert "nominal_angle_deg" in told
    assert "key 'nominal_angel_deg' is not known and not used, did you mean 'nominal_angle_deg'?" in told


@pytest.mark.parametrize("malformed", ["trigger = 3", 'pump = "x"', "sensors = [1]", "channels = 5", "loggers = [2]"])
def test_tables_that_are_none_are_refused_as_that(tmp_path: Path, malformed: str):
    with pytest.raises(Refusal):
        load_recording_config(write(tmp_path, f"{malformed}\n{TEXT}".replace(f"[{malformed.split()[0]}]", "[other]")))


def test_a_log_is_no_recording(tmp_path: Path):
    """'has 4868553 bytes, a TOML file of a bench has at most 524288', where `run log.csv` was typed."""
    log = tmp_path / "log.csv"
    log.write_text("time,torque\n0.0,1.0\n")
    with pytest.raises(Refusal, match=r"is no TOML file; .*; for a log, `camtorque new .*log\.csv` writes one$"):
        load_recording_config(log)


def test_missing_empty_and_foreign_files(tmp_path: Path):
    with pytest.raises(Refusal, match="is a folder; expected a pump file"):
        read_toml(tmp_path, "expected a pump file")
    with pytest.raises(Refusal, match="no such file; a recording is a folder"):
        load_recording_config(tmp_path)
    with pytest.raises(Refusal, match="is empty"):
        load_recording_config(write(tmp_path, " \n"))
    (tmp_path / "recording.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(Refusal, match="is not UTF-8"):
        load_recording_config(tmp_path)


def test_unknown_keys_are_findings_with_a_suggestion(tmp_path: Path):
    text = TEXT.replace('\nnote = ""', '\nnote = ""\noperator = "M. M."\nrotaton = "positive"')
    findings = load_recording_config(write(tmp_path, text)).findings
    assert [finding.code for finding in findings] == ["unknown_key", "unknown_key"]
    assert "did you mean 'rotation'" in findings[1].text


def test_a_word_that_is_no_slip_for_a_key_gets_no_suggestion(tmp_path: Path):
    text = TEXT.replace('\nnote = ""', '\nnote = ""\noperator = "M. M."')
    assert [finding.text for finding in load_recording_config(write(tmp_path, text)).findings] == [
        "key 'operator' is not known and not used"
    ]
    assert did_you_mean("Druck", ("Leitungsdruck", "Geber")) == ", did you mean 'Leitungsdruck'?"
    assert did_you_mean("rotaton", ("note", "rotation")) == ", did you mean 'rotation'?"
    assert did_you_mean("qressure", ("torque", "pressure")) == ", did you mean 'pressure'?"


def test_a_missing_file_names_what_its_folder_holds(tmp_path: Path):
    for name in ("recording.toml", "run_all.csv"):
        (tmp_path / name).write_text("x")
    with pytest.raises(Refusal, match=r"no such file, expected a log; .* own folder, did you mean 'run_all.csv'\?"):
        first_bytes(tmp_path / "run_al.csv")
    with pytest.raises(Refusal, match=r"no such file, expected a log; .*; its folder holds run_all.csv$"):
        first_bytes(tmp_path / "test.tdms")
    # a log that another channel names is none that this one lacks
    with pytest.raises(Refusal, match=r"own folder; its folder holds run_all.csv$"):
        first_bytes(tmp_path / "run_al.csv", [tmp_path / "run_al.csv", tmp_path / "run_all.csv"])
    with pytest.raises(Refusal, match=r"no such file, expected a log; .*; there is no folder .*logs$"):
        first_bytes(tmp_path / "logs" / "run_all.csv")
    with pytest.raises(Refusal, match=r"its name holds a backslash: write / between folders$"):
        first_bytes(tmp_path / r"logs\run_all.csv")
    for number in range(10):
        (tmp_path / f"x{number}.csv").write_text("x")
    with pytest.raises(
        Refusal, match=r"expected a lift table .*; its folder holds run_all.csv, .*, x6.csv and 3 more$"
    ):
        read_small_table(tmp_path / "cam", "a lift table")
    (tmp_path / "tables").mkdir()
    with pytest.raises(Refusal, match=r"tables: is a folder; expected a lift table .*; it holds no log or table$"):
        read_small_table(tmp_path / "tables", "a lift table")
    with pytest.raises(Refusal, match=r"tables: is a folder; expected a pump file .*; it holds no TOML file$"):
        read_pump(tmp_path / "tables")


def test_a_missing_sheet_names_the_sheets_beside_it(tmp_path: Path):
    (tmp_path / "torque.toml").write_text("x")
    (tmp_path / "torque.csv").write_text("x")
    with pytest.raises(Refusal, match=r"no such file; names it, did you mean 'torque.toml'\?$"):
        read_toml(tmp_path / "torqe.toml", "names it")
    with pytest.raises(Refusal, match=r"no such file; names it; its folder holds torque.toml$"):
        read_toml(tmp_path / "druck.toml", "names it")


def test_a_folder_that_is_no_recording_names_those_in_it_or_beside_it(tmp_path: Path):
    for name in ("run_1", "run_2"):
        (tmp_path / name).mkdir()
        write(tmp_path / name, TEXT)
    with pytest.raises(Refusal, match=r"or that file; in .* are run_1, run_2$"):
        load_recording_config(tmp_path)
    with pytest.raises(Refusal, match=r"or that file, did you mean 'run_1'\?$"):
        load_recording_config(tmp_path / "rum_1")


def test_a_file_under_two_clocks_is_told(tmp_path: Path):
    clocks = '[[loggers]]\nid = "DAQ1"\nclock = "independent"\n\n[[loggers]]\nid = "DAQ2"\nclock = "independent"\n'
    text = TEXT.replace('[[loggers]]\nid = "DAQ1"\nclock = "single"\n', clocks)
    first, _, last = text.rpartition('logger = "DAQ1"')
    found = load_recording_config(write(tmp_path, f'{first}logger = "DAQ2"{last}')).findings
    assert [(row.code, row.severity, row.where) for row in found] == [("one_file_several_clocks", "warning", "log.h5")]
    assert "given to the loggers DAQ1 and DAQ2" in found[0].text
    assert not load_recording_config(write(tmp_path, text)).findings


def test_an_offset_that_nobody_states_is_told(tmp_path: Path):
    assert not load_recording_config(write(tmp_path, TEXT)).findings
    found = load_recording_config(write(tmp_path, re.sub("follower_offset_m = .*", "", TEXT))).findings
    assert [(finding.code, finding.severity) for finding in found] == [("follower_offset_assumed", "info")]
    assert "follower_offset_m is not given; 0 is assumed" in found[0].text
    without = re.sub(r"\[pump\][^\[]*", "", TEXT)
    assert not load_recording_config(write(tmp_path, without)).findings


def test_tooth_wheel_and_idle_keys(tmp_path: Path):
    text = TEXT.replace("pulses_per_rev = 1", "pulses_per_rev = 60\nmissing_teeth = 2")
    text = text.replace('\nnote = ""', '\nnote = ""\nidle_from_s = 0.1\nidle_to_s = 0.6')
    config = load_recording_config(write(tmp_path, text))
    assert (config.trigger.pulses_per_rev, config.trigger.missing_teeth) == (60, 2)
    assert (config.sensors["pressure"].idle_from, config.sensors["pressure"].idle_to) == (0.1, 0.6)


def test_the_raw_examples_hold_no_unknown_key_and_every_known_key_is_a_key_of_some_table():
    root = CALIBRATION.parent / "raw_examples"
    for folder in sorted(root.glob("A_*")):
        values = tomllib.loads((folder / "recording.toml").read_text(encoding="utf-8"))
        assert set(values) <= {"schema", *RECORDING_TABLES}
        assert load_recording_config(folder).findings == ()


def test_every_word_for_a_format_is_known_and_another_is_refused():
    for name, form in FORMATS.items():
        assert {declared_format(word.upper(), "x") for word in (name, *form.aliases)} == {name}
    assert declared_format("CSV ", "x") == "csv"
    with pytest.raises(Refusal, match="did you mean 'hdf5'"):
        declared_format("hdf", "recording.toml")


def test_a_packed_log_is_no_text(tmp_path: Path):
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(b"Time,Torque\n0.0,1.0\n"))
    with pytest.raises(
        Refusal, match="file_format says CSV or ASCII text, but the content is gzip; correct file_format"
    ):
        file_format(tmp_path / "log.csv.gz", "csv")


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_has_a_module_that_reads(name: str) -> None:
    assert callable(import_module(f"camtorque.ingest.{FORMATS[name].module}").read)


def test_a_link_that_leads_nowhere_is_told_as_that(tmp_path: Path):
    """'no such file', where a folder shows one: the drive that it leads to is not there."""
    (tmp_path / "recording.toml").symlink_to(tmp_path / "share" / "recording.toml")
    with pytest.raises(Refusal, match=r"recording\.toml: is a symbolic link that leads nowhere"):
        load_recording_config(tmp_path)

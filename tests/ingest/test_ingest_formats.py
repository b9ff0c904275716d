"""Every format gives back what was written, whole and in slices, in memory and from disk."""

import builtins
import re
import sys
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from struct import pack

import h5py
import numpy as np
import pytest
from camtorque.config import ChannelSpec
from camtorque.ingest import catman, csv_log, lvm, mf4, parquet, read_recording, summarise, tdms, xlsx
from camtorque.ingest.csv_layout import SNIFF_BYTES, CsvLayout, sniff
from camtorque.ingest.csv_log import ALIKE_ROWS, Damage, is_whole_row, parse_block
from camtorque.ingest.formats import FORMATS
from camtorque.ingest.raw import FileSource
from camtorque.records import Recording, Refusal
from damaged.build import MAT, PLANS, log_file
from damaged.logs import DIALECTS, NAMES, START, Plan, clean_log, write_folder, write_mat5, write_mat73, write_tdms
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsFile, TdmsWriter

LOG = clean_log(revolutions=6.0, start=0.0321)
TOLERANCE = {"csv": 5.1e-5, "mf4": 3e-7, "hdf5": 0.0, "tdms": 0.0, "mat": 0.0, "catman": 0.0, "xlsx": 1e-15}
TOLERANCE |= {"parquet": 0.0, "numpy": 0.0, "lvm": 5.1e-7}
"""CSV logs are written with four decimals, the MF4 log in single precision; the others hold the numbers themselves."""


def recording(folder: Path, plan: Plan) -> Recording:
    return read_recording(write_folder(folder, [LOG], plan))


def assert_is_the_log(read: Recording, tolerance: float = 0.0) -> None:
    for channel in read.channels:
        assert channel.sample_rate == LOG.rate
        assert channel.start_time == pytest.approx(LOG.start, abs=1e-9)
        assert np.max(np.abs(channel.read_volts() - LOG.volts[channel.quantity])) <= tolerance


@pytest.mark.parametrize("name", sorted(PLANS))
def test_round_trip(tmp_path: Path, name: str):
    assert_is_the_log(recording(tmp_path / "r", PLANS[name]), TOLERANCE[name])


@pytest.mark.parametrize("name", sorted(DIALECTS))
def test_csv_dialects(tmp_path: Path, name: str):
    read = recording(tmp_path / "r", Plan("csv", writer_options={"dialect": name}))
    # a date counts from itself, and a file without times from zero
    start = 0.0 if name in ("iso", "no_time", "day_first") else LOG.start
    for channel in read.channels:
        assert channel.sample_rate == pytest.approx(LOG.rate, rel=1e-6)  # stamps of a date are rounded to 0.24 us
    assert read.channels[0].start_time == pytest.approx(start, abs=1e-9)
    assert np.max(np.abs(read.channels[1].read_volts() - LOG.volts["pressure"])) <= TOLERANCE["csv"]


@pytest.mark.parametrize("segments", [1, 4])
def test_tdms_segments_and_scales(tmp_path: Path, segments: int):
    plan = Plan("tdms", writer_options={"segments": segments})
    assert_is_the_log(recording(tmp_path / "plain", plan))
    plan = Plan("tdms", writer_options={"segments": segments, "scaled": True})
    # 16 bit over 20 V: half a step
    assert_is_the_log(recording(tmp_path / "scaled", plan), 0.51 * 10.0 / 32768.0)


@pytest.mark.parametrize("width", [8, 4, 2])
def test_catman_widths_against_apread(tmp_path: Path, width: int, monkeypatch: pytest.MonkeyPatch):
    plan = Plan("catman", writer_options={"width": width})
    read = recording(tmp_path / "r", plan)
    assert_is_the_log(read, {8: 0.0, 4: 3e-7, 2: 6e-5 * 5.2}[width])
    # numbers of apread, an independent reader of the same structure
    apread = pytest.importorskip("apread", exc_type=ImportError)
    monkeypatch.setattr("apread.apreader.tqdm", lambda channels, leave: channels)
    monkeypatch.setattr("apread.entries.toDatetime", lambda stamp: stamp)
    other = {channel.Name: channel.data for channel in apread.APReader(str(read.channels[0].path)).Channels}
    for channel in read.channels:
        assert np.array_equal(channel.read_volts(), np.asarray(other[NAMES[channel.quantity]], dtype=float))


def test_catman_without_time_channel_asks_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(builtins, "input", lambda *_: pytest.fail("asked on standard input"))
    read = recording(tmp_path / "r", Plan("catman", writer_options={"with_time": False}))
    assert read.channels[0].sample_rate == LOG.rate


@pytest.mark.parametrize("unit", ["s", "ms"])
def test_catman_times_tell_the_rate_in_their_own_unit(tmp_path: Path, unit: str):
    folder = write_folder(tmp_path / "r", [LOG], Plan("catman", writer_options={"time_unit": unit, "with_step": False}))
    assert {channel.sample_rate for channel in FORMATS["catman"].channels(log_file(folder))} == {LOG.rate}
    assert_is_the_log(read_recording(folder))


def test_two_time_channels_of_one_length_are_refused_not_guessed(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [LOG], PLANS["catman"])
    file = log_file(folder)
    file.write_bytes(file.read_bytes().replace(b"Line_Pressure", b"Line_Pr__time"))
    with pytest.raises(Refusal, match="2 channels may be its time"):
        read_recording(folder)
    (first,) = catman.read(file, (ChannelSpec("torque", file, "", NAMES["torque"], "V", "L", LOG.rate, "",
                                              time_channel="Time  1 - default sample rate"),), "").channels  # fmt: skip
    assert first.sample_rate == LOG.rate


def test_mat_versions_and_structs(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [LOG], MAT)
    write_mat73(log_file(folder), LOG)
    assert_is_the_log(read_recording(folder))
    plan = Plan("mat", channel_lines=MAT.channel_lines, edits=(('group = ""', 'group = "rec"'),))
    folder = write_folder(tmp_path / "s", [LOG], plan)
    write_mat5(log_file(folder), LOG, struct_name="rec")
    assert_is_the_log(read_recording(folder))


def test_mat_without_times_uses_the_declared_rate_and_start(tmp_path: Path):
    plan = Plan("mat", channel_lines="start_time_s = 0.0321\n")
    assert_is_the_log(recording(tmp_path / "r", plan))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(["csv", "hdf5", "tdms", "catman", "mat"]), bounds=st.tuples(*[st.integers(-5, 6200)] * 2))
def test_slices_are_slices(tmp_path_factory, name: str, bounds: tuple[int, int]):
    source = cached(tmp_path_factory, name).of("pressure")[0].source
    whole = source.read(0, source.n_samples)
    start, stop = max(min(bounds), 0), max(bounds)
    assert np.array_equal(source.read(start, stop), whole[start:stop])


CACHE: dict[str, Recording] = {}


def cached(factory: pytest.TempPathFactory, name: str) -> Recording:
    if name not in CACHE:
        CACHE[name] = recording(factory.mktemp(name) / "r", PLANS[name])
    return CACHE[name]


def test_a_large_csv_lies_on_disk_and_gives_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = write_folder(tmp_path / "r", [LOG], PLANS["csv"])
    small = read_recording(folder)
    monkeypatch.setattr(csv_log, "IN_MEMORY_BYTES", 1000)
    monkeypatch.setattr(csv_log, "BLOCK_BYTES", 5000)
    large = read_recording(folder)
    assert isinstance(large.channels[0].source, csv_log.CachedSource)
    for one, other in zip(small.channels, large.channels, strict=True):
        assert np.array_equal(one.read(), other.read())
        assert one.start_time == other.start_time


@pytest.mark.parametrize("in_memory", [1 << 20, 1000], ids=["at once", "in pieces"])
def test_samples_that_an_mf4_marks_as_invalid_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_memory: int
) -> None:
    asammdf = pytest.importorskip("asammdf")
    monkeypatch.setattr(mf4, "IN_MEMORY_BYTES", in_memory)
    times, file = np.arange(2000) / 1e3, tmp_path / "log.mf4"
    bad = (times > 0.5) & (times < 0.6)
    with asammdf.MDF(version="4.10") as mdf:
        values = np.where(bad, 777.0, times)
        mdf.append([asammdf.Signal(values, times, name="Torque", unit="V", invalidation_bits=bad)], acq_name="G")
        mdf.save(file)
    (channel,) = mf4.read(file, (ChannelSpec("torque", file, "G", "Torque", "V", "L", 1e3, ""),), "").channels
    np.testing.assert_array_equal(channel.source.read(0, 2000), np.where(bad, np.nan, times))


def test_a_large_mf4_is_read_in_pieces_and_gives_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = write_folder(tmp_path / "r", [LOG], PLANS["mf4"])
    small = read_recording(folder)
    monkeypatch.setattr(mf4, "IN_MEMORY_BYTES", 1000)
    large = read_recording(folder)
    for one, other in zip(small.channels, large.channels, strict=True):
        assert np.array_equal(one.read(1234, 4321), other.read(1234, 4321))


@pytest.mark.parametrize(("name", "package"), [("xlsx", "openpyxl"), ("parquet", "pyarrow")])
def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, package: str):
    pytest.importorskip(package)
    folder = write_folder(tmp_path / "r", [LOG], PLANS[name])
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(Refusal, match=r"pip install 'camtorque\[tables\]'"):
        read_recording(folder)


def test_interleaved_tdms(tmp_path: Path):
    """One segment written by hand after NI's description, three channels sample by sample in turn."""

    def text(value: str) -> bytes:
        return pack("<I", len(value)) + value.encode()

    count, names = 500, ("Torque", "Prox_Trigger", "Line_Pressure")
    values = {q: LOG.volts[q][:count] for q in ("torque", "trigger", "pressure")}
    meta = pack("<I", len(names))
    for name in names:
        meta += text(f"/'Main'/'{name}'") + pack("<IIIQ", 20, 10, 1, count) + pack("<I", 1)
        meta += text("wf_increment") + pack("<Id", 10, 1.0 / LOG.rate)
    raw = np.column_stack(list(values.values())).tobytes()
    toc = (1 << 1) | (1 << 2) | (1 << 3) | (1 << 5)
    folder = write_folder(tmp_path / "r", [LOG], PLANS["tdms"])
    toml = folder / "recording.toml"
    toml.write_text("\n".join('group = "Main"' if "Grp_" in line else line for line in toml.read_text().split("\n")))
    lead = b"TDSm" + pack("<iiQQ", toc, 4713, len(meta) + len(raw), len(meta))
    log_file(folder).write_bytes(lead + meta + raw)
    for channel in read_recording(folder).channels:
        assert np.array_equal(channel.read_volts(), values[channel.quantity])
        assert np.array_equal(channel.read_volts(17, 400), values[channel.quantity][17:400])


def test_hdf5_time_channel_and_slices(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [LOG], Plan("hdf5", channel_lines='time_channel = "t_ms"\n'))
    with h5py.File(log_file(folder), "a") as file:
        file["Main"].create_dataset("t_ms", data=1e3 * LOG.times).attrs["unit"] = "ms"
    assert_is_the_log(read_recording(folder))


@pytest.mark.parametrize(
    ("name", "begins"),
    [
        ("start", (0.0, 0.015)), ("start_time", (0.0, 0.015)),
        ("start_time", (1_759_305_600_000_000_000, 1_759_305_600_015_000_000)),
        ("start_time", ("2025-10-01T10:00:00", "2025-10-01T10:00:00.015")),
    ],
)  # fmt: skip
def test_hdf5_attributes_say_when_a_channel_began(tmp_path: Path, name: str, begins: tuple[object, object]):
    """Numbers were passed over without a word: a pressure 15 ms late was wrong by its whole swing."""
    folder = write_folder(tmp_path / "r", [LOG], PLANS["hdf5"])
    with h5py.File(log_file(folder), "a") as file:
        del file["Main"].attrs["t0_s"]
        for channel, data in file["Main"].items():
            data.attrs[name] = begins["pressure" in channel.lower()]
    channels = {channel.quantity: channel for channel in read_recording(folder).channels}
    late = channels["pressure"].start_time - channels["torque"].start_time
    assert late == pytest.approx(0.015, abs=1e-6)


def test_an_hdf5_start_that_nobody_can_read_is_told(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [LOG], PLANS["hdf5"])
    with h5py.File(log_file(folder), "a") as file:
        next(iter(file["Main"].values())).attrs["start_time"] = "01.10.2025 10:00:00.015"
    (found,) = (finding for finding in read_recording(folder).findings if finding.code == "start_not_read")
    assert "'01.10.2025 10:00:00.015' is said to be its start, expected a date as 2025-10-01T10:00:00" in found.text


def test_several_tdms_files_share_their_dates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Synchronised loggers: a file that began half a second later has its channels half a second later."""
    parts = [replace(LOG, logger=q.upper(), volts={q: v}, start=0.0) for q, v in LOG.volts.items()]
    folder = write_folder(tmp_path / "r", parts, replace(PLANS["tdms"], clock="synchronised"))
    monkeypatch.setattr("damaged.logs.START", START.replace(microsecond=500_000))
    write_tdms(folder / "PRESSURE.tdms", parts[1])
    starts = {channel.quantity: channel.start_time for channel in read_recording(folder).channels}
    assert starts == {"torque": 0.0, "pressure": pytest.approx(0.5, abs=1e-6), "trigger": 0.0}


def test_channels_of_one_name_are_called_with_their_groups(tmp_path: Path):
    """Cards that call every channel AI0: a warning on `log.tdms AI0` was of torque, pressure or trigger."""
    example = Path(__file__).parents[2] / "raw_examples" / "A_1000rpm"
    old = TdmsFile.read(example / "A_1000rpm_all.tdms")
    channels = [(group.name, channel) for group in old.groups() for channel in group.channels()]
    with TdmsWriter(tmp_path / "A_1000rpm_all.tdms") as writer:
        writer.write_segment([ChannelObject(group, "AI0", item[:], item.properties) for group, item in channels])
    text = (example / "recording.toml").read_text().replace("../../", f"{example.parents[1].as_posix()}/")
    (tmp_path / "recording.toml").write_text(re.sub('(?m)^channel = ".*"', 'channel = "AI0"', text))
    read = summarise(read_recording(tmp_path))
    assert [row.name for row in read.channels] == ["Grp_torque/AI0", "Grp_pressure/AI0", "Grp_trigger/AI0"]
    assert [channel.name for channel in read_recording(example).channels] == ["Torque", "Line_Pressure", "Prox_Trigger"]


LAYOUT = CsvLayout("utf-8", ",", ".", 0, 0, ("a", "b", "c"), ("", "", ""), ("", "", ""), None)
CELLS = st.floats(-1e6, 1e6).map(lambda value: round(value, 4))


@settings(deadline=None)
@given(st.lists(st.tuples(CELLS, CELLS, CELLS), min_size=1, max_size=30), st.data())
def test_a_damaged_row_never_shifts_the_others(rows: list[tuple[float, ...]], data):
    lines = [",".join(repr(value) for value in row) for row in rows]
    bad = data.draw(st.integers(0, len(rows) - 1))
    lines[bad] = data.draw(st.sampled_from(["1,2", "1;2;3", "", "1,2,3,4", "x,y,z", "1,,3"]))
    damage = Damage()
    columns = parse_block(("\n".join(lines) + "\n").encode(), LAYOUT, [0, 1, 2], {}, damage, 1)
    for column, values in zip(columns, zip(*rows, strict=True), strict=True):
        kept = np.arange(len(rows)) != bad
        assert column.size == len(rows)
        assert np.allclose(column[kept], np.array(values)[kept], rtol=1e-15, atol=0.0)
    assert np.isnan(np.array([column[bad] for column in columns])).any()


@given(st.binary(max_size=300))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@pytest.mark.parametrize("name", ["csv", "tdms", "hdf5", "catman", "mat"])
def test_noise_in_place_of_a_log_is_refused(tmp_path_factory, name: str, noise: bytes):
    if name not in NOISE:
        NOISE[name] = write_folder(tmp_path_factory.mktemp(name) / "r", [LOG], PLANS[name])
    log_file(NOISE[name]).write_bytes(noise)
    with pytest.raises(Refusal):
        read_recording(NOISE[name])


NOISE: dict[str, Path] = {}


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_a_column_may_be_named_with_its_unit(tmp_path: Path, form: str):
    folder = write_folder(tmp_path / "r", [LOG], PLANS[form])
    toml = folder / "recording.toml"
    name = next(line for line in toml.read_text().splitlines() if "Torque" in line and line.startswith("channel"))
    toml.write_text(toml.read_text().replace(name, 'channel = "Torque [V]"'))
    assert read_recording(folder).of("torque")[0].n_samples
    toml.write_text(toml.read_text().replace("Torque [V]", "Torque [mV]"))
    with pytest.raises(Refusal, match="no column 'Torque"):
        read_recording(folder)


def test_columns_of_pandas_with_a_row_of_names_and_one_of_units(tmp_path: Path):
    """They are called ('Torque', 'Nm'), of which the part in brackets was the unit of no name, and "no number"."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = pa.table(
        {"('Zeit', 's')": [0.0, 0.1, 0.2], "('Torque', 'Nm')": [1.0, 2.0, 3.0], "(Druck)": [4.0, 5.0, 6.0]}
    )
    pq.write_table(table, tmp_path / "log.parquet")
    found = [(item.name, item.unit, item.sample_rate) for item in parquet.channels(tmp_path / "log.parquet")]
    assert found == [("Torque", "Nm", pytest.approx(10.0)), ("(Druck)", "", pytest.approx(10.0))]


def test_feather_is_read_like_parquet(tmp_path: Path):
    assert_is_the_log(recording(tmp_path / "r", Plan("parquet", writer_options={"feather": True})))


def test_an_lvm_that_ends_with_a_row_too_early_is_told_by_its_header(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [LOG], PLANS["lvm"])
    text = log_file(folder).read_bytes()
    log_file(folder).write_bytes(b"\r\n".join(text.split(b"\r\n")[:2000]) + b"\r\n")
    assert "samples_missing" in {finding.code for finding in read_recording(folder).findings}


@pytest.mark.parametrize("between", ["\t", "\t\t"], ids=["one time", "a time each"])
def test_a_channel_without_a_unit_takes_none_of_its_neighbour_in_an_lvm(tmp_path: Path, between: str):
    names = ("Torque", "Pressure", "Trigger")
    head = ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t.", "***End_of_Header***\t", ""]
    head += ["Channels\t3", "Y_Unit_Label\t" + between.join(["Newton-Meters", "", "Volts"]), "***End_of_Header***\t"]
    times = ["X_Value"] * (3 if between == "\t\t" else 1)
    head.append("\t".join(name for k, one in enumerate(names) for name in (*times[k : k + 1], one)))
    rows = ["\t".join(f"{n / 1e3:.3f}" if name == "X_Value" else f"{n % 7}.5" for name in head[-1].split("\t"))
            for n in range(200)]  # fmt: skip
    (tmp_path / "log.lvm").write_text("\n".join([*head, *rows, ""]))
    listed = {channel.name: channel.unit for channel in lvm.channels(tmp_path / "log.lvm")}
    assert listed == {"Torque": "N m", "Pressure": "", "Trigger": "V"}


def test_a_second_segment_whose_mark_lies_across_two_pieces_of_an_lvm_is_counted(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [LOG], PLANS["lvm"])
    text = log_file(folder).read_bytes()[: SNIFF_BYTES // 2]
    log_file(folder).write_bytes(text.ljust(SNIFF_BYTES - 5) + b"***End_of_Header***\r\n")
    with pytest.raises(Refusal, match="holds 2 segments of data"):
        read_recording(folder)


def test_lvm_without_a_time_column_takes_start_and_step_of_its_header(tmp_path: Path):
    assert_is_the_log(recording(tmp_path / "r", Plan("lvm", writer_options={"x_columns": "No"})), 5.1e-7)


def test_a_number_of_an_lvm_that_is_printed_in_two_ways_is_one(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [LOG], Plan("lvm", writer_options={"x_columns": "No"}))
    text = log_file(folder).read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if line.startswith("X0"))
    first = line.split("\t")[1]
    log_file(folder).write_text(text.replace(line, line.replace(first, f"{float(first):.16E}", 1)), encoding="utf-8")
    assert {channel.start_time for channel in read_recording(folder).channels} == {float(first)}


@pytest.mark.parametrize("start", [0.0, 2.5])
def test_a_start_that_recording_toml_states_holds_even_where_it_is_zero(tmp_path: Path, start: float):
    plan = Plan("lvm", writer_options={"x_columns": "No"}, channel_lines=f"start_time_s = {start}\n")
    assert {channel.start_time for channel in recording(tmp_path / "r", plan).channels} == {start}


def test_a_column_t_is_a_channel_where_a_time_stands_beside_it(tmp_path: Path):
    folder = write_folder(tmp_path / "r", [LOG], PLANS["csv"])
    toml, log = folder / "recording.toml", log_file(folder)
    toml.write_text(toml.read_text().replace('channel = "Torque"', 'channel = "T"'))
    log.write_text(log.read_text().replace("Torque", "T").replace("Time", "time"))
    read = read_recording(folder).of("torque")[0]
    assert np.max(np.abs(read.read_volts() - LOG.volts["torque"])) <= TOLERANCE["csv"]
    log.write_text(log.read_text().replace("time,T", "sample,T"))
    assert read_recording(folder).of("torque")[0].name == "T"  # no time beside it, and still a channel


def test_dates_and_times_of_a_workbook(tmp_path: Path):
    openpyxl = pytest.importorskip("openpyxl")
    folder = write_folder(tmp_path / "r", [LOG], PLANS["xlsx"])
    book = openpyxl.Workbook()
    book.active.append(["Zeitstempel", "Torque [V]", "Line_Pressure [V]", "Prox_Trigger [V]"])
    start = datetime(2025, 3, 1, 12)
    columns = [values[:3000].tolist() for values in LOG.volts.values()]
    for number, values in enumerate(zip(*columns, strict=True)):
        book.active.append([start + timedelta(seconds=number / 500.0), *values])
    book.save(log_file(folder))
    toml = folder / "recording.toml"
    toml.write_text(toml.read_text().replace("sample_rate_hz = 10000.0", "sample_rate_hz = 500.0"))
    read = read_recording(folder)
    assert read.of("torque")[0].sample_rate == pytest.approx(500.0, rel=1e-4)
    assert "certificate_age" not in {finding.code for finding in read.findings}


@pytest.mark.parametrize(
    ("begun", "breaks", "steps"),
    [
        ([0.0, 30.0], (2000,), (28.0,)),
        ([0.0, 2.0, 4.003], (), ()),
        ([0.0, 0.0, 0.0], (), ()),
        ([30.0, 0.0], (2000,), (-32.0,)),
    ],
    ids=["pause", "blocks", "restated", "older log"],
)
def test_segments_of_a_tdms_file_have_starts_of_their_own(
    tmp_path: Path, begun: list[float], breaks: tuple[int, ...], steps: tuple[float, ...]
) -> None:
    """A program that opens a file again appends to it: the library knows the start of the last segment alone."""
    nptdms = pytest.importorskip("nptdms")
    file, day = tmp_path / "log.tdms", np.datetime64("2024-05-01T10:00:00", "us")
    with nptdms.TdmsWriter(file) as writer:
        for start in begun:
            waveform = {"wf_increment": 1e-3, "wf_start_time": day + np.timedelta64(round(1e6 * start), "us")}
            writer.write_segment([nptdms.ChannelObject("Grp", "Torque", np.ones(2000), waveform)])
    read = tdms.read(file, (ChannelSpec("torque", file, "Grp", "Torque", "V", "L", 1e3, ""),), "")
    (channel,) = read.channels
    assert channel.stamp == pytest.approx(day.astype(np.int64) / 1e6 + begun[0])
    assert channel.breaks == breaks
    assert channel.break_steps == pytest.approx(steps, abs=1e-5)
    assert [finding.severity for finding in read.findings] == ["error"] * len(breaks)


@pytest.mark.parametrize(
    "above",
    [
        [["Serial", 40117, 40118]],
        [["Test", 12], ["Range", None, 10, 5], []],
        [["Name", "Gain", "Zero"], ["Torque", 40.0, 0.001], ["Pressure", 200.0, 0.0]],
    ],
    ids=["serials", "settings", "table"],
)
def test_numbers_above_the_names_of_a_sheet_are_no_rows(tmp_path: Path, above: list[list[object]]) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (*above, ["Time [s]", "Torque [V]", "Pressure [V]"], *([n / 1e3, n % 7.0, 2.0] for n in range(300))):
        book.active.append(row)
    file = tmp_path / "log.xlsx"
    book.save(file)
    listed = [(channel.name, channel.unit, channel.source.n_samples) for channel in xlsx.channels(file)]
    assert listed == [("Torque", "V", 300), ("Pressure", "V", 300)]
    specs = tuple(ChannelSpec(name.lower(), file, "", name, "V", "L", 1e3, "") for name, _, _ in listed)
    (torque, pressure) = xlsx.read(file, specs, "").channels
    assert torque.source.read(0, 3).tolist() == [0.0, 1.0, 2.0]
    assert set(pressure.source.read(0, 300)) == {2.0}


def test_durations_and_levels_of_a_workbook(tmp_path: Path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet("Log")
    sheet.append(["Dauer", "Moment", "DI", "Text"])
    for n in range(200):
        sheet.append([timedelta(hours=23, minutes=59, seconds=59, milliseconds=900 + n), n, n % 40 > 20,
                      "EIN" if n % 40 > 20 else "AUS"])  # fmt: skip
    book.save(tmp_path / "log.xlsx")
    listed = {channel.name: channel for channel in xlsx.channels(tmp_path / "log.xlsx")}
    assert {channel.sample_rate for channel in listed.values()} == {1000.0}
    levels = np.arange(200) % 40 > 20
    for name in ("DI", "Text"):
        np.testing.assert_array_equal(listed[name].source.read(0, 200), levels)


def test_a_column_of_a_workbook_whose_numbers_are_texts_is_refused(tmp_path: Path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (["Zeit [s]", "Moment [V]", "Druck [V]"], *([n / 500.0, f"{n % 7},5", n % 9] for n in range(200))):
        book.active.append(row)
    book.save(tmp_path / "log.xlsx")
    with pytest.raises(Refusal, match="found the numbers of column 'Moment' stored as text, such as '0,5', expected"):
        xlsx.channels(tmp_path / "log.xlsx")


def test_a_workbook_with_two_sheets_asks_which(tmp_path: Path):
    openpyxl = pytest.importorskip("openpyxl")
    folder = write_folder(tmp_path / "r", [LOG], PLANS["xlsx"])
    book = openpyxl.load_workbook(log_file(folder))
    book.create_sheet("Notes")
    book.save(log_file(folder))
    with pytest.raises(Refusal, match=r"2 sheets; name one as group .*there are Log, Notes"):
        read_recording(folder)


@pytest.mark.parametrize("name", sorted(PLANS))
def test_every_format_lists_its_channels_with_rate_and_unit(tmp_path: Path, name: str):
    folder = write_folder(tmp_path / "r", [LOG], PLANS[name])
    found = {item.name: item for item in FORMATS[name].channels(log_file(folder))}
    assert set(NAMES.values()) <= set(found)
    for quantity, channel in NAMES.items():
        item = found[channel]
        assert item.sample_rate == pytest.approx(LOG.rate, rel=1e-4)
        assert item.unit in ("V", "") if name in ("mat", "numpy") else item.unit == "V"
        assert np.max(np.abs(item.source.read(0, item.n_samples) - LOG.volts[quantity])) <= TOLERANCE[name]
    assert not {"Time", "t"} & set(found)


@pytest.mark.parametrize("segments", [1, 3])
def test_the_segment_table_of_nptdms_still_tells_where_the_samples_lie(tmp_path: Path, segments: int):
    # The reader takes the places from attributes that npTDMS does not document; a version that changes them fails here.
    file = tmp_path / "log.tdms"
    write_tdms(file, LOG, segments=segments)
    with TdmsFile.open(file) as opened:
        for group in opened.groups():
            for channel in group.channels():
                pieces = tdms._pieces(opened, channel.path)
                assert pieces is not None
                assert len(pieces) == segments
                assert np.array_equal(FileSource(file, pieces).read(0, 10**9), channel[:])


def test_a_binary_file_called_csv_is_refused(tmp_path: Path):
    """Quotation marks beside a carriage return are more than Python's csv reader takes."""
    path = tmp_path / "log.csv"
    path.write_bytes(b'\x1f\x8b\x08"a\rb"c,"\x03\n\xff"d\re"f,1\n' * 40)
    with pytest.raises(Refusal, match=r"log\.csv: .*no row of numbers; expected columns of numbers"):
        sniff(path, ("Torque",))


@pytest.mark.parametrize("lost", [1, 2, 3, 9])
@pytest.mark.parametrize("dialect", ["comma", "semicolon", "crlf", "blanks", "bars", "utf16"])
def test_a_last_row_without_a_line_end_counts_where_no_digit_can_be_missing(tmp_path: Path, dialect: str, lost: int):
    folder = write_folder(tmp_path / "r", [LOG], Plan("csv", writer_options={"dialect": dialect}))
    file, wide, ends = log_file(folder), 2 if dialect == "utf16" else 1, 2 if dialect == "crlf" else 1
    whole = read_recording(folder).channels[0].n_samples
    file.write_bytes(file.read_bytes()[: -wide * lost])
    read = read_recording(folder)
    told = {finding.code for finding in read.findings} & {"csv_cut_row", "csv_no_line_end"}
    code = "csv_no_line_end" if lost < 9 else "csv_cut_row"  # the last number has six or seven characters
    assert (told, read.channels[0].n_samples) == (({code}, whole - 1) if lost > ends else (set(), whole))


@pytest.mark.parametrize(
    ("before", "row", "is_whole"),
    [
        ("1,2,0.25", "3,-4,-10.75", True),
        ("1,2,0.25", "3,4,0.7", False),
        ("1,2,0.25", "3,4,10", False),
        ("1,2,0.25", "3,4.25", False),
        ("1,2,100", "3,4,-200", True),
        ("1,2,100", "3,4,20", False),
        ("1,2,2.5E+01", "3,4,2.5E+0", False),
        ('1,2,"0.25"', '3,4,"0.25', False),
        ("1,2,0.25,", "3,4,0.25", False),
        ("1,2,0.25,", "3,4,0.25,", True),
    ],
)
def test_a_last_row_is_whole_where_it_ends_as_those_before(before: str, row: str, is_whole: bool):
    rows = f"{before}\n".encode() * ALIKE_ROWS
    assert is_whole_row(row.encode(), rows, LAYOUT) == is_whole
    assert not is_whole_row(row.encode(), rows + b"1,2,3.5\n", LAYOUT)
    assert not is_whole_row(row.encode(), rows[: -len(before) - 1], LAYOUT)


@pytest.mark.parametrize(("count", "said"), [(1, "1 cell is not a number and"), (2, "2 cells are not numbers and")])
def test_damage_is_counted_in_words(tmp_path: Path, count: int, said: str):
    folder = write_folder(tmp_path / "r", [LOG], PLANS["csv"])
    lines = log_file(folder).read_text().split("\n")
    for line in range(500, 500 + count):
        lines[line] = lines[line].rpartition(",")[0] + ",x7"
    log_file(folder).write_text("\n".join(lines))
    assert any(finding.text.startswith(said) for finding in read_recording(folder).findings)

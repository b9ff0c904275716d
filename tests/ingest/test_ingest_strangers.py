"""Texts as loggers of other labs write them: headers, numbers, stamps. Each is small; what is read is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.config import ChannelSpec
from camtorque.ingest import csv_log, xlsx
from camtorque.ingest.cells import unwrapped
from camtorque.ingest.csv_layout import sniff
from camtorque.ingest.csv_log import channels, read
from camtorque.ingest.formats import file_format
from camtorque.ingest.header import header_rate, name_and_unit
from camtorque.ingest.raw import RawFile
from camtorque.records import Refusal

ROWS = 400
TORQUE = np.round(60.0 * np.sin(0.05 * np.arange(ROWS)), 2)
PRESSURE = np.round(800.0 + 700.0 * np.cos(0.05 * np.arange(ROWS)), 1)
STEP = 5e-5


def rows(separator: str = ",", time: str = "{:.5f}", scale: float = 1.0, comma: bool = False) -> list[str]:
    times = (time.format(scale * STEP * n) for n in range(ROWS))
    lines = [separator.join((t, f"{a:.2f}", f"{b:.1f}")) for t, a, b in zip(times, TORQUE, PRESSURE, strict=True)]
    return [line.replace(".", ",") for line in lines] if comma else lines


def write(folder: Path, *lines: str, encoding: str = "utf-8") -> Path:
    file = folder / "log.csv"
    file.write_text("\n".join(lines) + "\n", encoding=encoding)
    return file


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("1.0D-05;1.0D+02;2.0D-01", r"line 2 has '2\.0D-01': write the exponent with E in the place of D"),
        ("0.1 s;0,1 Nm;700 bar", "line 2 has '700 bar': write the unit once, in the header"),
    ],
)
def test_numbers_that_are_written_otherwise_are_told_how_to_be(tmp_path: Path, row: str, said: str):
    with pytest.raises(Refusal, match=said):
        channels(write(tmp_path, "time;torque;pressure", *[row] * ROWS))


def test_the_lock_file_of_an_open_workbook_is_no_log(tmp_path: Path):
    file = tmp_path / "~$run.xlsx"
    file.write_bytes(b"\x05name" + b" " * 160)
    with pytest.raises(Refusal, match=r"what Excel keeps beside an open workbook, expected the log; name run\.xlsx"):
        file_format(file, "")


def spec(file: Path, quantity: str, channel: str, unit: str, rate: float = 1.0 / STEP) -> ChannelSpec:
    return ChannelSpec(quantity, file, "", channel, unit, "L", rate, "")


def both(file: Path, torque: str = "Torque", pressure: str = "Pressure", rate: float = 1.0 / STEP) -> RawFile:
    return read(file, (spec(file, "torque", torque, "N m", rate), spec(file, "pressure", pressure, "bar", rate)), "")


def assert_read(raw: RawFile, *codes: str, torque: np.ndarray = TORQUE, pressure: np.ndarray = PRESSURE) -> None:
    for channel, truth in zip(raw.channels, (torque, pressure), strict=True):
        np.testing.assert_allclose(channel.source.read(0, 10**6), truth)
        assert channel.sample_rate == pytest.approx(1.0 / STEP, rel=1e-5)
    assert {finding.code for finding in raw.findings} == set(codes)


GERMAN_ROWS = [line.replace(".", ",") for line in rows(";")]
HEADERS: dict[str, list[str]] = {
    "time without a name": ["Sample rate:\t20000", "\tTorque\tPressure", "[s]\t[Nm]\t[bar]", *rows("\t")],
    "axis": ["x-Achse\tTorque\tPressure", "s\tN*m\tbar", *rows("\t", comma=True)],
    "description below units": ["Zeit;Torque;Pressure", "s;Nm;bar", "Kanal;Messwelle T22;Pumpenseite", *GERMAN_ROWS],
    "channel rows below units": [
        "HBM", "Zeit - Standardrate\tTorque\tPressure", "s\tNm\tbar", "CH=1\tCH=2\tCH=3",
        "SR=20000\tSR=20000\tSR=20000",
        *rows("\t"),
    ],
    "words as units": ["x-axis,Torque,Pressure", "second,Newton-meter,Bar", *rows()],
    "unit that ends the name": ["time_s,Torque [Nm],Pressure [bar]", *rows()],
    "unit of milliseconds in the name": ["t_ms,Torque [Nm],Pressure [bar]", *rows(scale=1e3)],
    "nanoseconds": ["timestamp_ns,Torque [Nm],Pressure [bar]", *rows(time="{:.0f}", scale=1e9)],
    "slashes without blanks": ["t/ms;Torque/Nm;Pressure/bar", *rows(";", scale=1e3)],
    "index and time last": [
        ",Torque [Nm],Pressure [bar],time_s",
        *[f"{n},{a},{b},{STEP * n:.5f}" for n, (a, b) in enumerate(zip(TORQUE, PRESSURE, strict=True))],
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", HEADERS)
def test_headers_of_strangers(tmp_path: Path, name: str):
    file = write(tmp_path, *HEADERS[name])
    listed = {channel.name: channel for channel in channels(file)}
    assert {listed["Torque"].unit, listed["Pressure"].unit} <= {"Nm", "N*m", "Newton-meter", "bar", "Bar"}
    assert listed["Torque"].sample_rate == pytest.approx(1.0 / STEP, rel=1e-5)
    assert_read(both(file))


def test_a_row_of_names_may_lack_what_is_empty_at_the_end(tmp_path: Path):
    body = [f",{a},{b}," for a, b in zip(TORQUE, PRESSURE, strict=True)]
    head = [
        '"Model Name","DL850E"',
        '"TraceName","Torque","Pressure"',
        '"VUnit","Nm","bar"',
        '"SampleRate",20000,20000',
    ]
    file = write(tmp_path, *head, *body)
    assert [(c.name, c.unit, c.sample_rate) for c in channels(file) if c.unit == "bar"] == [("Pressure", "bar", 2e4)]
    assert_read(both(file))


def test_pairs_of_columns_have_each_their_own_time(tmp_path: Path):
    body = [
        f"{STEP * n:.5f};{a};{0.5 + 2 * STEP * n:.5f};{b}"
        for n, (a, b) in enumerate(zip(TORQUE, PRESSURE, strict=True))
    ]
    body[200:] = [line.rsplit(";", 2)[0] + ";;" for line in body[200:]]
    file = write(tmp_path, "Time_Md;Torque;Time_p;Pressure", "s;Nm;s;bar", *body)
    torque = spec(file, "torque", "Torque", "N m")
    raw = read(file, (torque, spec(file, "pressure", "Pressure", "bar", 0.5 / STEP)), "")
    assert [(c.start_time, c.sample_rate, c.source.n_samples) for c in raw.channels] == [
        (0.0, pytest.approx(1.0 / STEP), 400), (pytest.approx(0.5), pytest.approx(0.5 / STEP), 200)]  # fmt: skip
    assert [channel.sample_rate for channel in channels(file)] == [pytest.approx(1.0 / STEP), pytest.approx(0.5 / STEP)]


@pytest.mark.parametrize(
    ("line", "rate"),
    [
        ("Sampling rate: 20 kHz", 2e4),
        ("Abtastrate [Hz];20000", 2e4),
        ("Sample interval: 0.05 ms", 2e4),
        ("Sample Interval,5e-05,,", 2e4),
        ("# dt = 5e-05 s", 2e4),
        ("# fs=20000", 2e4),
        ("Sampling: speed 1000 1/min, 20 kS/s", 2e4),
        ("Filter frequency: 1000 Hz", None),
        ("Mains frequency 50 Hz", None),
        ("Sample rate: 20,000 Hz", None),
        ("Abtastrate 20.000 Hz", None),
        ("Sample rate: 20.5 kHz", 20500.0),
    ],
)
def test_the_rate_that_a_header_states_and_what_is_none(line: str, rate: float | None):
    for separator in ",;":
        assert header_rate(["Sheet 1", line], separator) == (rate if rate is None else pytest.approx(rate))


def grouped(value: float, digits: int, german: bool) -> str:
    text = f"{value:,.{digits}f}"
    return text.translate(str.maketrans(".,", ",.")) if german else f'"{text}"'


@pytest.mark.parametrize(("german", "digits"), [(True, 1), (True, 0), (False, 1)])
def test_points_or_commas_between_thousands(tmp_path: Path, german: bool, digits: int):
    separator = ";" if german else ","
    body = [
        separator.join(grouped(v, digits, german) for v in (1e6 * STEP * n, 1e3 * a, 1e2 * b))
        for n, (a, b) in enumerate(zip(TORQUE, PRESSURE, strict=True))
    ]
    file = write(tmp_path, separator.join(("Time [us]", "Torque [Nmm]", "Pressure [hPa]")), *body)
    specs = (spec(file, "torque", "Torque", "Nmm"), spec(file, "pressure", "Pressure", "hPa"))
    assert_read(read(file, specs, ""), "csv_thousands", torque=1e3 * TORQUE, pressure=np.round(1e2 * PRESSURE))


def test_thousands_that_begin_below_the_lines_that_tell_the_layout(tmp_path: Path):
    """Times from 1,000.00 ms on were taken for a footer, pressures from 1,000.0 psi on for damage."""
    count = 30_000
    value = np.where(np.arange(count) < 25_000, 900.0, 1366.5)
    lines = (f"{50e-3 * n:,.2f};{value[n]:,.1f}" for n in range(count))
    file = write(tmp_path, "Time [ms];p [psi]", *lines)
    raw = read(file, (spec(file, "pressure", "p", "psi"),), "")
    np.testing.assert_array_equal(raw.channels[0].source.read(0, count), value)
    assert [item.code for item in raw.findings] == ["csv_thousands"]
    assert channels(file)[0].n_samples == count


@pytest.mark.parametrize("german", [False, True])
def test_a_point_in_one_column_tells_the_comma_of_another(tmp_path: Path, german: bool):
    """28.54 N m beside 65,808 kPa were 28.54 and 65.808."""
    lines = [f"{STEP * n:.5f};{a:.2f};{100 * b:,.0f}" for n, a, b in zip(range(ROWS), TORQUE, PRESSURE, strict=True)]
    lines = [line.translate(str.maketrans(",.", ".,")) for line in lines] if german else lines
    file = write(tmp_path, "Time [s];Torque [Nm];Pressure [kPa]", *lines)
    raw = read(file, (spec(file, "torque", "Torque", "N m"), spec(file, "pressure", "Pressure", "kPa")), "")
    assert_read(raw, "csv_thousands", torque=TORQUE, pressure=np.round(100 * PRESSURE))


def test_a_row_of_groups_above_the_names_hides_no_column(tmp_path: Path):
    """Pressure stood below an empty cell of the row that was taken for the names, and was dropped without a word."""
    head = ("Zeit;Kraftseite;;Geber", ";Drehmoment;Druck;", "s;Nm;bar;V")
    file = write(tmp_path, *head, *(f"{row};{n % 7}" for n, row in enumerate(rows(";"))))
    assert [item.name for item in channels(file)] == ["Kraftseite", "Druck", "Geber"]
    assert [item.unit for item in channels(file)] == ["Nm", "bar", "V"]
    raw = read(file, (spec(file, "torque", "Kraftseite", "N m"), spec(file, "pressure", "Druck", "bar")), "")
    assert_read(raw, torque=TORQUE, pressure=PRESSURE)


def test_units_in_capitals_are_read_as_they_are_listed(tmp_path: Path):
    file = write(tmp_path, "TIME [S],TORQUE [NM],P [BAR]", *rows())
    assert [item.sample_rate for item in channels(file)] == [pytest.approx(1.0 / STEP)] * 2
    raw = read(file, (spec(file, "torque", "TORQUE", "N m"), spec(file, "pressure", "P", "bar")), "")
    assert_read(raw, torque=TORQUE, pressure=PRESSURE)


def test_three_decimals_are_no_thousands(tmp_path: Path):
    body = [f"{n};{a + 70.0:.3f};{b:.3f}" for n, (a, b) in enumerate(zip(TORQUE, PRESSURE, strict=True))]
    file = write(tmp_path, "Sample rate: 20000 Hz", "no;Torque [Nm];Pressure [bar]", *body)
    assert_read(both(file), torque=TORQUE + 70.0)


def test_commas_of_two_kinds_are_named(tmp_path: Path):
    file = write(tmp_path, "Time,Torque,Pressure", *(f"0,{k:05d},1,5{k:02d},2,7{k:02d}" for k in range(50)))
    with pytest.raises(Refusal, match=r"found 6 columns of numbers under 3 names .* export with a semicolon or tab"):
        both(file)


def test_quotes_hold_decimal_commas_together(tmp_path: Path):
    body = [",".join(f'"{field}"' for field in line.replace(".", ",").split(";")) for line in rows(";")]
    assert_read(both(write(tmp_path, '"Zeit [s]","Torque [Nm]","Pressure [bar]"', *body)))


def test_values_beyond_the_range_are_missing_whatever_the_word(tmp_path: Path):
    body, torque = rows(), TORQUE.copy()
    for place, word in enumerate(("∞", "-∞", "OVER", "OVL", "+OVFLW", "1.#INF", "9.9E+37", "9.91E+37"), start=10):
        body[place] = body[place].replace(f",{TORQUE[place]:.2f},", f",{word},")
        torque[place] = np.nan
    raw = both(write(tmp_path, "Time [s],Torque [Nm],Pressure [bar]", *body))
    assert_read(raw, "csv_overrange", torque=torque)


def test_statistics_below_the_table_are_no_samples(tmp_path: Path):
    file = write(tmp_path, "Time [s],Torque [Nm],Pressure [bar]", *rows(), "", "Statistics", "Max,62.1,867.2")
    raw = both(file)
    assert_read(raw, "rows_without_time")


def test_a_header_before_each_block_is_left_out(tmp_path: Path):
    head, body = "Time [s],Torque [Nm],Pressure [bar]", rows()
    assert_read(both(write(tmp_path, head, *body[:100], "", head, *body[100:])), "csv_header_repeated")


def test_a_header_before_each_block_of_one_column_is_left_out(tmp_path: Path):
    """A line that holds nothing is a row with one missing value there: it had been taken off the damaged rows."""
    body = [f"{value:.3f}" for value in TORQUE]
    file = write(tmp_path, "Torque [Nm]", *body[:100], "", "Torque [Nm]", *body[100:])
    raw = read(file, (spec(file, "torque", "Torque", "N m"),), "")
    assert raw.channels[0].source.n_samples == len(body)
    assert [finding.code for finding in raw.findings] == ["csv_header_repeated"]


def test_a_damaged_time_above_another_header_is_told_by_its_line(tmp_path: Path):
    head = "Time,Torque [Nm],Pressure [bar]"
    body = [f"12:00:0{n // 100}.{n % 100:02d},{TORQUE[n]:.2f},10.0" for n in range(200)]
    body[50] = body[50].replace("12:00", "12:x0")
    file = write(tmp_path, head, *body[:100], "", head, *body[100:])
    raw = read(file, (spec(file, "torque", "Torque", "N m", 100.0),), "")
    told = next(finding.text for finding in raw.findings if finding.code == "csv_cells_damaged")
    assert "(line 52)" in told


@pytest.mark.parametrize(
    "head", ["No.,Time,Torque,Pressure,Trigger", "No.,Time [s],Torque [N m],Pressure [bar],Trigger [V]"]
)
def test_a_header_with_a_name_more_is_no_guess(tmp_path: Path, head: str):
    file = write(tmp_path, head, *(f"{row},{n % 2}" for n, row in enumerate(rows())))
    assert sniff(file, ()).names == ("column 1", "column 2", "column 3", "column 4")
    with pytest.raises(
        Refusal, match=r"header has 5 names \(No\., Time.*\) for 4 columns .* or name columns by their place"
    ):
        sniff(file, ("Torque", "Pressure", "Trigger"))
    last = write(tmp_path, head.removeprefix("No.,") + ",Remark", *(f"{row},{n % 2}" for n, row in enumerate(rows())))
    assert sniff(last, ()).names[0] == "Time"
    assert sniff(last, ("Torque",)).surplus == ("Remark",)


def test_a_header_in_another_order_is_refused_where_it_stands(tmp_path: Path):
    head, turned = "Time [s],Torque [Nm],Pressure [bar]", "Time [s],Pressure [bar],Torque [Nm]"
    file = write(tmp_path, head, *rows()[:100], turned, *rows()[100:])
    with pytest.raises(Refusal, match=r"line 102: repeats the header in another order, .* split the file there"):
        both(file)


@pytest.mark.parametrize("n_rows", [20, 100])
@pytest.mark.parametrize("pressure", ["Temp [degC]", "Pressure [hPa]"])
@pytest.mark.parametrize("wanted", ["Torque", "Pressure"])
def test_another_header_below_rows_is_refused_where_it_stands(tmp_path: Path, n_rows: int, pressure: str, wanted: str):
    """A short log with another one appended: its temperature had been read as the pressure of the first header."""
    head, other = "Time [s],Torque [Nm],Pressure [bar]", f"Time [s],Torque [Nm],{pressure}"
    file = write(tmp_path, head, *rows()[:n_rows], other, *rows())
    with pytest.raises(Refusal, match=rf"line {n_rows + 2}: repeats the header .* with other names, .* split the file"):
        read(file, (spec(file, wanted.lower(), wanted, "N m" if wanted == "Torque" else "bar"),), "")


@pytest.mark.parametrize("n_rows", [20, 300])
def test_another_header_in_a_sheet_is_refused_where_it_stands(tmp_path: Path, n_rows: int):
    workbook = pytest.importorskip("openpyxl").Workbook()
    body = [[float(field) for field in line.split(",")] for line in rows()]
    names = ["Time [s]", "Torque [Nm]", "Pressure [bar]"]
    statistics = [["Statistics", *names[1:]], ["Max", 60.0, 1500.0]]
    for row in ([names, *body, *statistics], [names, *body[:n_rows], [*names[:2], "Temp [degC]"], *body]):
        sheet = workbook.create_sheet()
        for cells in row:
            sheet.append(cells)
    file = tmp_path / "log.xlsx"
    workbook.save(file)
    specs = [replace(spec(file, "torque", "Torque", "N m"), group=name) for name in ("Sheet1", "Sheet2")]
    np.testing.assert_allclose(xlsx.read(file, (specs[0],), "").channels[0].source.read(0, ROWS), TORQUE)
    with pytest.raises(Refusal, match=rf"row {n_rows + 2}: repeats the header .* other names, .* split the sheet"):
        xlsx.read(file, (specs[1],), "")


def test_names_above_statistics_below_the_table_are_no_header(tmp_path: Path):
    file = write(tmp_path, "Time [s],Torque [Nm],Pressure [bar]", *rows(), "Statistics,Torque [Nm],Pressure [bar]",
                 "Max,60.0,1500.0")  # fmt: skip
    assert_read(both(file), "rows_without_time")


def stamped(folder: Path, head: str, stamps: list[str]) -> Path:
    return write(folder, f"{head};Torque [Nm];Pressure [bar]",
                 *[s + line[line.index(";") :] for s, line in zip(stamps, rows(";"), strict=True)])  # fmt: skip


def test_american_stamps_of_the_afternoon(tmp_path: Path):
    stamps = [f"03/12/2024 1:59:59.{990000 + 50 * n - 0:06d} PM" for n in range(200)]
    stamps += [f"03/12/2024 2:00:00.{50 * n:06d} PM" for n in range(200)]
    raw = both(stamped(tmp_path, "Timestamp", stamps))
    assert_read(raw)
    assert raw.channels[0].stamp == pytest.approx(np.datetime64("2024-03-12T13:59:59.99").astype("int64") / 1e3)


@pytest.mark.parametrize("block", [512, 1 << 20])
@pytest.mark.parametrize("half", ["", " PM"])
def test_a_date_with_slashes_is_read_alike_in_the_whole_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int, half: str
):
    """Of the twelfth, which may be a month, and of the thirteenth, which may not."""
    monkeypatch.setattr(csv_log, "BLOCK_BYTES", block)
    stamps = [f"12/11/2024 11:59:59.{990000 + 50 * n:06d}{half}" for n in range(200)]
    stamps += [f"13/11/2024 {'12' if half else '00'}:00:00.{50 * n:06d}{' AM' * bool(half)}" for n in range(200)]
    if not half:
        stamps[:200] = [text.replace(" 11:", " 23:") for text in stamps[:200]]
    raw = both(stamped(tmp_path, "Timestamp", stamps))
    assert_read(raw)
    assert raw.channels[0].stamp == pytest.approx(np.datetime64("2024-11-12T23:59:59.99").astype("int64") / 1e3)


def test_a_damaged_stamp_does_not_turn_month_and_day(tmp_path: Path):
    stamps = [f"11/25/2024 10:00:00.{50 * n:06d}" for n in range(400)]
    stamps[100] = stamps[100].replace("11/", "31/")
    raw = both(stamped(tmp_path, "Timestamp", stamps))
    assert raw.channels[0].stamp == pytest.approx(np.datetime64("2024-11-25T10:00:00").astype("int64"))
    assert {row.code for row in raw.findings} == {"csv_cells_damaged", "time_stamp_damaged"}


def test_a_time_of_day_may_pass_midnight(tmp_path: Path):
    stamps = [f"12.03.2024;23:59:59.{990000 + 50 * n:06d}" for n in range(200)]
    stamps += [f"13.03.2024;00:00:00.{50 * n:06d}" for n in range(200)]
    assert_read(both(stamped(tmp_path, "Datum;Uhrzeit", stamps)))


def clock(start: float) -> list[str]:
    """Return times of day of `ROWS` samples from a number of seconds before midnight on."""
    seconds = (86400.0 - start + STEP * np.arange(ROWS)) % 86400.0
    return [f"{int(s) // 3600:02d}:{int(s) // 60 % 60:02d}:{s % 60.0:09.6f}" for s in seconds]


@pytest.mark.parametrize("in_memory", [10**8, 1000])
def test_midnight_in_a_text_that_is_read_in_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_memory: int
) -> None:
    monkeypatch.setattr(csv_log, "IN_MEMORY_BYTES", in_memory)
    monkeypatch.setattr(csv_log, "BLOCK_BYTES", 512)
    assert_read(both(stamped(tmp_path, "Uhrzeit", clock(0.01))))


def test_a_damaged_time_does_not_spoil_those_behind_it() -> None:
    stamps = np.array([86399.0, np.nan, 0.5, 2.0])
    np.testing.assert_array_equal(unwrapped(stamps, "clock"), [86399.0, np.nan, 86400.5, 86402.0])
    np.testing.assert_array_equal(unwrapped(stamps[2:], "clock", 86399.0), [86400.5, 86402.0])


def test_every_channel_may_have_a_clock_of_its_own(tmp_path: Path) -> None:
    lines = zip(clock(0.01), clock(10.0), TORQUE, PRESSURE, strict=True)
    body = [f"{one};{a:.2f};{two};{b:.1f}" for one, two, a, b in lines]
    raw = both(write(tmp_path, "Time;Torque [Nm];Time;Pressure [bar]", *body))
    assert_read(raw)
    first, second = (channel.start_time + (channel.stamp or 0.0) for channel in raw.channels)
    assert second - first == pytest.approx(-9.99)


def test_stamps_with_too_few_digits_follow_the_declared_rate(tmp_path: Path):
    stamps = [f"2024-03-12T10:00:00.{int(1e3 * STEP * n + 1e-9):03d}" for n in range(ROWS)]
    file = stamped(tmp_path, "Timestamp", stamps)
    assert channels(file)[0].sample_rate == pytest.approx(2e4)
    assert_read(both(file), "time_stamps_coarse")
    with pytest.raises(Refusal, match=r"several samples share each time stamp .* sample_rate_hz = 10000 leaves"):
        both(file, rate=1e4)


def test_a_time_without_a_unit_that_runs_back_or_stands_still_for_samples(tmp_path: Path):
    file = write(tmp_path, "Time,Torque,Pressure", *reversed(rows()))
    with pytest.raises(Refusal, match=r"time does not run forward .* from the newest to the oldest: sort them"):
        both(file)
    # which of the units it is only the whole span tells
    coarse = write(tmp_path, "Time,Torque,Pressure", *rows(time="{:.0f}", scale=1e3))
    assert_read(both(coarse), "time_stamps_coarse")
    with pytest.raises(Refusal, match="fits neither s, ms, us, ns nor days at 123 Hz; correct sample_rate_hz, or"):
        both(write(tmp_path, "Time,Torque,Pressure", *rows()), rate=123.0)


def test_stamps_that_pairs_of_samples_share_tell_the_whole_rate(tmp_path: Path):
    file = write(tmp_path, "Time [s],Torque [Nm],Pressure [bar]", *rows(time="{:.4f}"))
    assert channels(file)[0].sample_rate == pytest.approx(2e4, rel=0.01)
    assert_read(both(file), "time_stamps_coarse")


def test_missing_cells_beside_stamps_that_samples_share_stay_where_they_are(tmp_path: Path):
    """12.5 kHz with four digits: a fifth of the steps is none, as no rows of several channels have them."""
    lines = [f"{n / 12_500.0:.4f},{a},{int(n % 100 < 20)}" for n, a in enumerate(TORQUE)]
    lines[100] = lines[100].replace(f",{TORQUE[100]},", ",,")
    file = write(tmp_path, "Time [s],Torque [Nm],Trigger", *lines)
    wanted = (("torque", "Torque", "N m"), ("trigger", "Trigger", "logic"))
    raw = read(file, tuple(spec(file, *names, 12_500.0) for names in wanted), "")
    torque, trigger = (channel.source.read(0, ROWS + 1) for channel in raw.channels)
    np.testing.assert_allclose(torque, np.where(np.arange(ROWS) == 100, np.nan, TORQUE))
    np.testing.assert_array_equal(trigger, np.arange(ROWS) % 100 < 20)
    assert {finding.code for finding in raw.findings} == {"time_stamps_coarse"}
    assert [channel.n_samples for channel in channels(file)] == [ROWS, ROWS]


def test_a_column_that_counts_samples_shows_gaps(tmp_path: Path):
    body = [f"{n + 5 * (n > 200)},{a},{b}" for n, (a, b) in enumerate(zip(TORQUE, PRESSURE, strict=True))]
    raw = both(write(tmp_path, "x,Torque [Nm],Pressure [bar]", *body))
    assert_read(raw, "samples_counted", "time_gap")
    assert raw.channels[0].breaks == (201,)


def test_a_header_rate_does_not_overrule_the_time_column(tmp_path: Path):
    file = write(tmp_path, "Sample rate: 40000 Hz", "Time [s],Torque [Nm],Pressure [bar]", *rows())
    assert_read(both(file), "header_rate_differs")


def test_a_tight_slash_is_over_a_unit_not_a_rate():
    assert name_and_unit("p/bar") == ("p", "bar")
    assert name_and_unit("t/ms") == ("t", "ms")
    assert name_and_unit("m/s") == ("m/s", "")
    assert name_and_unit("km/h") == ("km/h", "")
    assert name_and_unit("in/out") == ("in/out", "")


STAMPS = {
    "milliseconds behind a colon": lambda n: f"12:03:04:{50 * n + 900000:06d}",
    "afternoon": lambda n: f"1:03:04.{50 * n + 900000:06d} PM",
    "minutes of a spreadsheet": lambda n: f"59:59.{50 * n + 900000:06d}",
    "year first": lambda n: f"2024/03/07 12:03:04.{50 * n + 900000:06d}",
    "month by name": lambda n: f"07-Mar-2024 12:03:04.{50 * n + 900000:06d}",
    "timetable": lambda n: f"{STEP * n:.5f} sec",
    "short date beside": lambda n: f"07.03.24;12:03:04.{50 * n + 900000:06d}",
}


@pytest.mark.parametrize("kind", STAMPS)
def test_stamps_of_strangers(tmp_path: Path, kind: str):
    stamps = [STAMPS[kind](n) for n in range(100_000 // 50)]
    head = "Datum;Uhrzeit" if "beside" in kind else "Zeit"
    units = ";hh:mm:ss.000" if "beside" in kind else "hh:mm:ss.000"
    body = [f"{stamp};{n % 7}.5;{n % 9}.5" for n, stamp in enumerate(stamps)]
    file = write(tmp_path, f"{head};Torque;Pressure", f"{units};Nm;bar", *body)
    assert [(c.name, c.sample_rate) for c in channels(file)] == [("Torque", 2e4), ("Pressure", 2e4)]
    raw = both(file)
    assert raw.findings == ()
    assert [channel.sample_rate for channel in raw.channels] == [pytest.approx(2e4, rel=1e-6)] * 2
    day = raw.channels[0].stamp
    assert day is None or day == pytest.approx(np.datetime64("2024-03-07T12:03:04.9").astype("int64") / 1e3)


@pytest.mark.parametrize("date", ["12.03.2024", "2024-03-12", "12-03-24", "03/12/2024", "2024/3/12"])
def test_a_date_beside_a_time_of_day_is_its_day(tmp_path: Path, date: str):
    stamps = [f"{date};10:00:00.{50 * n:06d}" for n in range(ROWS)]
    raw = both(stamped(tmp_path, "Datum;Uhrzeit", stamps))
    assert_read(raw)
    assert raw.channels[0].stamp == pytest.approx(np.datetime64("2024-03-12T10:00").astype("int64") * 60.0, abs=1e-6)


@pytest.mark.parametrize("hour", [23, 99])
def test_durations_go_on_beyond_a_day(tmp_path: Path, hour: int):
    stamps = [f"{hour}:59:59.{990000 + 50 * n:06d}" for n in range(200)]
    stamps += [f"{hour + 1}:00:00.{50 * n:06d}" for n in range(200)]
    raw = both(stamped(tmp_path, "Dauer", stamps))
    assert_read(raw)
    assert raw.channels[0].start_time == pytest.approx(3600.0 * (hour + 1) - 0.01)


@pytest.mark.parametrize("words", [("FALSE", "TRUE"), ("off", "on"), ("Falsch", "Wahr")])
def test_words_for_levels_are_pulses(tmp_path: Path, words: tuple[str, str]):
    body = [f"{STEP * n:.5f},{words[n // 40 % 2]},{n % 7}.5" for n in range(ROWS)]
    file = write(tmp_path, "Time [s],DI0,Torque [Nm]", *body)
    raw = read(file, (spec(file, "trigger", "DI0", "logic"),), "")
    np.testing.assert_array_equal(raw.channels[0].source.read(0, ROWS), np.arange(ROWS) // 40 % 2)
    assert raw.findings == ()
    body[7] = body[7].replace(words[0], "FAL5E")
    damaged = read(write(tmp_path, "Time [s],DI0,Torque [Nm]", *body), (spec(file, "trigger", "DI0", "logic"),), "")
    assert [finding.code for finding in damaged.findings] == ["csv_cells_damaged"]
    assert np.flatnonzero(np.isnan(damaged.channels[0].source.read(0, ROWS))).tolist() == [7]


def test_minutes_start_again_after_an_hour(tmp_path: Path):
    body = [f"{n // 1200 % 60:02d}:{n // 20 % 60:02d}.{n % 20 * 50:03d};{n % 7}" for n in range(71_900, 72_100)]
    raw = read(
        write(tmp_path, "Zeit;Torque", *body), (spec(tmp_path / "log.csv", "torque", "Torque", "N m", 20.0),), ""
    )
    assert [finding.code for finding in raw.findings] == []
    assert raw.channels[0].start_time == pytest.approx(3595.0)


@pytest.mark.parametrize(
    ("head", "units"),
    [([], ["", ""]), (["Pump bench 4, run 12"], ["", ""]), (["s,Nm,bar"], ["Nm", "bar"])],
    ids=["none", "title", "units"],
)
def test_columns_without_names_go_by_their_place(tmp_path: Path, head: list[str], units: list[str]):
    file = write(tmp_path, *head, *rows())
    found = channels(file)
    assert [(c.name, c.unit) for c in found] == list(zip(("column 2", "column 3"), units, strict=True))
    assert {(c.time_channel, c.sample_rate) for c in found} <= {("column 1", 2e4), ("", 2e4)}
    specs = [spec(file, "torque", "column 2", "N m"), spec(file, "pressure", "column 3", "bar")]
    raw = read(file, tuple(replace(s, time_channel="column 1") for s in specs), "")
    assert_read(raw)
    with pytest.raises(Refusal, match=r"channel = 'column 1' to 'column 3'|no column named 'Torque'"):
        both(file)


def test_a_place_beyond_the_table_or_a_name_that_two_share_is_refused(tmp_path: Path):
    file = write(tmp_path, "t [s],AI [Nm],AI [bar]", *rows())
    assert [c.name for c in channels(file)] == ["column 2", "column 3"]
    assert_read(both(file, "column 2", "column 3"))
    with pytest.raises(Refusal, match="2 columns are named 'AI'; name one by its place, channel = 'column 2' or"):
        both(file, "AI", "column 3")
    with pytest.raises(Refusal, match="no column 'column 4'"):
        both(file, "column 4", "column 3")


def test_a_line_that_lacks_a_name_names_nothing(tmp_path: Path):
    file = write(tmp_path, "Torque [Nm],Pressure [bar]", *rows())
    assert [c.name for c in channels(file)] == ["column 2", "column 3"]
    with pytest.raises(Refusal, match=r"no header line has 3 names for the 3 columns .* name columns by their place"):
        both(file)


@pytest.mark.parametrize("repeat", [1, 100])
def test_line_ends_of_old_macintosh_are_named(tmp_path: Path, repeat: int):
    file = tmp_path / "log.csv"
    file.write_bytes("\r".join(["Time,Torque,Pressure", "s,N m,bar", *rows() * repeat]).encode())
    with pytest.raises(
        Refusal,
        match="holds no line end but CR alone, as a CSV for Macintosh has: export with LF or CR LF; expected columns",
    ):
        both(file)


def test_a_counter_may_be_the_time_of_columns_without_names(tmp_path: Path):
    file = write(tmp_path, *[f"{n} {a} {b}" for n, (a, b) in enumerate(zip(TORQUE, PRESSURE, strict=True))])
    assert {(c.time_channel, c.sample_rate) for c in channels(file)} == {("column 1", None)}
    wave = write(tmp_path, *[f"{a} {b}" for a, b in zip(TORQUE, PRESSURE, strict=True)])
    assert {(c.time_channel, c.sample_rate) for c in channels(wave)} == {("", None)}

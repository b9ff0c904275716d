"""Dirt in texts of real loggers: words in the first rows, blanks between thousands, quotes, footers, other dates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from camtorque.config import ChannelSpec
from camtorque.ingest import csv_layout, csv_log
from camtorque.ingest.csv_log import channels, read
from camtorque.ingest.raw import RawFile
from camtorque.records import Refusal

ROWS = 400
RATE = 2e4
TORQUE = np.round(60.0 * np.sin(0.05 * np.arange(ROWS)), 2)
PRESSURE = np.round(1800.0 + 700.0 * np.cos(0.05 * np.arange(ROWS)), 1)
HEAD = "Time [s];Torque [Nm];Pressure [bar]"


def rows(separator: str = ";") -> list[str]:
    values = zip(np.arange(ROWS) / RATE, TORQUE, PRESSURE, strict=True)
    return [separator.join((f"{t:.5f}", f"{a:.2f}", f"{b:.1f}")) for t, a, b in values]


def log(folder: Path, *lines: str, end: str = "\n") -> RawFile:
    file = folder / "log.csv"
    file.write_text(end.join(lines) + end, encoding="utf-8")
    wanted = (("torque", "Torque", "N m"), ("pressure", "Pressure", "bar"))
    return read(file, tuple(ChannelSpec(q, file, "", name, unit, "L", RATE, "") for q, name, unit in wanted), "")


def assert_read(raw: RawFile, *codes: str) -> None:
    for channel, truth in zip(raw.channels, (TORQUE, PRESSURE), strict=True):
        np.testing.assert_allclose(channel.source.read(0, 10**6), truth)
    assert [finding.code for finding in raw.findings] == list(codes)


def test_a_first_row_with_a_word_for_none_is_no_header(tmp_path: Path):
    body = rows()
    body[:2] = ["0.00000;∞;2500.0", "0.00005;3.00;----"]
    raw = log(tmp_path, HEAD, *body)
    read_back = np.array([channel.source.read(0, 3) for channel in raw.channels])
    np.testing.assert_allclose(read_back, [[np.nan, 3.0, 5.99], [2500.0, np.nan, PRESSURE[2]]])
    assert [finding.code for finding in raw.findings] == ["csv_overrange"]
    assert raw.channels[0].start_time == 0.0


@pytest.mark.parametrize("word", ["#DIV/0!", "#WERT!", "nan(ind)", "err", "Fehler", "No Data"])
def test_a_log_that_begins_with_error_cells_keeps_its_time(tmp_path: Path, word: str):
    """They were cut off as a header: ten of them moved the pressure by 1.5 degrees, up to 250 bar."""
    body = [f"{a:.2f};{word if k < 10 else b}" for k, (a, b) in enumerate(zip(TORQUE, PRESSURE, strict=True))]
    torque, pressure = (c.source.read(0, 10**6) for c in log(tmp_path, "Torque [Nm];Pressure [bar]", *body).channels)
    np.testing.assert_allclose(torque, TORQUE)
    assert np.all(np.isnan(pressure[:10]))
    np.testing.assert_allclose(pressure[10:], PRESSURE[10:])


def test_rows_of_one_unknown_word_above_the_numbers_are_refused(tmp_path: Path):
    body = [f"{a:.2f};{'sat' if k < 10 else b}" for k, (a, b) in enumerate(zip(TORQUE, PRESSURE, strict=True))]
    with pytest.raises(Refusal, match=r"first one of numbers all hold 'sat', which is no number .* write NaN"):
        log(tmp_path, "Torque [Nm];Pressure [bar]", *body)


@pytest.mark.parametrize("cut", range(7))
def test_a_character_that_is_cut_where_sniffing_ends_is_no_other_encoding(cut: int):
    """A column "läuft" was read or not by one character of a comment 260 thousand bytes on."""
    text = "Öldruck [bar] \u2019\u2019\u202f".encode()
    assert csv_layout.encoding_of(text[: len(text) - cut]) == "utf-8"
    assert csv_layout.encoding_of("Öldruck;läuft".encode("cp1252")) == "cp1252"


@pytest.mark.parametrize("sign", ["'", "\u2019", " ", "\u00a0", "\u202f"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_apostrophes_and_blanks_between_thousands(tmp_path: Path, sign: str, decimal: str):
    body = [line.replace(".", decimal) for line in rows()]
    body = [line[:-5] + sign + line[-5:] for line in body]
    assert_read(log(tmp_path, HEAD, *body), "csv_thousands")


@pytest.mark.parametrize("end", ["\n\n", "\r\n\r\n", "\r\n \t\r\n"])
def test_a_blank_line_behind_each_row_is_left_out(tmp_path: Path, end: str, monkeypatch: pytest.MonkeyPatch):
    """Refused as not equidistant: each blank line was read as a missing sample."""
    monkeypatch.setattr(csv_log, "BLOCK_BYTES", 1001)  # the borders of blocks lie anywhere
    assert_read(log(tmp_path, HEAD, *rows(), end=end), "csv_spaced")


def test_a_blank_line_now_and_then_is_a_missing_sample(tmp_path: Path):
    raw = log(tmp_path, HEAD, *rows()[:9], "", *rows()[10:])
    assert np.flatnonzero(np.isnan(raw.channels[0].source.read(0, ROWS))).tolist() == [9]
    assert "csv_rows_damaged" in {finding.code for finding in raw.findings}


@pytest.mark.parametrize("digits", [10, 12])
def test_days_of_a_spreadsheet_are_known_by_their_mean_step(tmp_path: Path, digits: int):
    """Of ten decimals the steps of 20 kHz are 5 or 6 units of the last one, a tenth off in the median."""
    days = 45_000.25 + np.arange(ROWS) / RATE / 86_400.0
    body = [f"{day:.{digits}f};{row.partition(';')[2]}" for day, row in zip(days, rows(), strict=True)]
    raw = log(tmp_path, HEAD.replace(" [s]", ""), *body)
    assert raw.channels[0].sample_rate == pytest.approx(RATE, rel=1e-3)


def test_a_minus_of_typography_is_one(tmp_path: Path):
    assert_read(log(tmp_path, HEAD, *(line.replace("-", "\N{MINUS SIGN}") for line in rows())))


@pytest.mark.parametrize(
    "head",
    [["'Time'\t'Torque'\t'Pressure'", "'s'\t'Nm'\t'bar'"], ["'Time [s]'\t'Torque [Nm]'\t'Pressure [bar]'"]],
)
def test_names_may_stand_in_single_quotes(tmp_path: Path, head: list[str]):
    assert_read(log(tmp_path, *head, *rows("\t")))
    assert [(c.name, c.unit) for c in channels(tmp_path / "log.csv")] == [("Torque", "Nm"), ("Pressure", "bar")]


@pytest.mark.parametrize(
    "head", ["Time [s]  Torque [Nm]  Pressure [bar]", "Time (s) Torque (Nm) Pressure (bar)"], ids=["wide", "narrow"]
)
def test_units_between_blanks_belong_to_the_name_before(tmp_path: Path, head: str):
    assert_read(log(tmp_path, head, *rows("   ")))
    assert [(c.name, c.unit) for c in channels(tmp_path / "log.csv")] == [("Torque", "Nm"), ("Pressure", "bar")]


@pytest.mark.parametrize(
    "above",
    [
        ["1;2;3"],
        ["Serial;Gain;Zero", "4711;2.0;0.001"],
        ["Channel;Gain;Zero", "1;40.0;0.001", "2;200.0;0.0", ""],
    ],
    ids=["numbers", "named", "table"],
)
def test_numbers_above_the_names_are_no_rows(tmp_path: Path, above: list[str]):
    raw = log(tmp_path, *above, HEAD, *rows())
    assert_read(raw)
    assert raw.channels[0].start_time == 0.0
    assert [(c.name, c.unit) for c in channels(tmp_path / "log.csv")] == [("Torque", "Nm"), ("Pressure", "bar")]


@pytest.mark.parametrize("separator", ["\t", ";"])
@pytest.mark.parametrize("signs", ["., ", ",. "])
def test_whole_thousands_beside_broken_numbers_are_no_decimals(tmp_path: Path, separator: str, signs: str):
    """1,012 beside 0.00005 had been read as 1.012, and 1.012 beside 0,00005."""
    decimal, thousands, _ = signs
    body = [
        separator.join((f"{n / RATE:.5f}".replace(".", decimal), f"{a:.2f}".replace(".", decimal),
                        f"{int(b) - 900:,d}".replace(",", thousands)))
        for n, (a, b) in enumerate(zip(TORQUE, PRESSURE, strict=True))
    ]  # fmt: skip
    raw = log(tmp_path, HEAD.replace(";", separator), *body)
    np.testing.assert_allclose(raw.channels[0].source.read(0, ROWS), TORQUE)
    np.testing.assert_allclose(raw.channels[1].source.read(0, ROWS), PRESSURE.astype(int) - 900)
    assert [finding.code for finding in raw.findings] == ["csv_thousands"]


@pytest.mark.parametrize("sign", ["'", " ", "\u202f"])
def test_a_first_thousand_far_below_may_be_parted_by_a_blank(tmp_path: Path, sign: str):
    """A log that begins at standstill shows its thousands long after the lines that tell the layout."""
    body = [f"{n / RATE:.5f};1.5;{n + 500:,d}".replace(",", sign) for n in range(1000)]
    raw = log(tmp_path, HEAD, *body)
    np.testing.assert_array_equal(raw.channels[1].source.read(0, 1000), np.arange(500, 1500))
    assert raw.findings == ()


@pytest.mark.parametrize("n_rows", [3, 20, ROWS])
@pytest.mark.parametrize("separator", [";", " ; "])
def test_a_column_of_words_in_a_log_of_few_rows(tmp_path: Path, n_rows: int, separator: str):
    lines = [HEAD + ";Remark", *(f"{row};ok" for row in rows()[:n_rows])]
    raw = log(tmp_path, *(line.replace(";", separator) for line in lines))
    assert (raw.channels[0].source.n_samples, raw.findings) == (n_rows, ())


def test_stamps_with_and_without_a_fraction_make_no_thousands(tmp_path: Path):
    stamps = [f"12:00:{n / 100:06.3f}".removesuffix(".000") for n in range(ROWS)]
    body = [f"{t};{1.5 + n / 1e4:.3f};{1.2 + n / 1e4:.3f}" for n, t in enumerate(stamps)]
    file = tmp_path / "log.csv"
    file.write_text("\n".join([HEAD, *body, ""]), encoding="utf-8")
    raw = read(file, (ChannelSpec("torque", file, "", "Torque", "N m", "L", 100.0, ""),), "")
    assert (raw.channels[0].source.read(0, 1)[0], raw.findings) == (1.5, ())


def test_a_first_thousand_far_below_is_no_decimal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(csv_layout, "SNIFF_BYTES", 200)
    body = [f"{n / RATE:.5f};1.5;{990 + n}".replace(".", ",") for n in range(20)]
    body[10:] = [row[:-4] + "1." + row[-3:] for row in body[10:]]
    raw = log(tmp_path, HEAD, *body)
    pressure = raw.channels[1].source.read(0, 20)
    np.testing.assert_array_equal(pressure, [*range(990, 1000), *[np.nan] * 10])
    assert [finding.code for finding in raw.findings] == ["csv_cells_damaged"]


def test_a_header_that_hides_the_numbers_is_named(tmp_path: Path):
    above = [f"# key {number}: a remark of some length" for number in range(9000)]
    with pytest.raises(Refusal, match=r"no row of numbers in its first \d+ lines.*shorten what stands above"):
        log(tmp_path, *above, "Time [s];Torque;Pressure", *rows())


def test_one_sample_is_no_log(tmp_path: Path):
    with pytest.raises(Refusal, match="found 1 sample with a time, expected at least 2; record longer"):
        log(tmp_path, "Time [s];Torque;Pressure", *rows()[:1])


def test_rows_between_blanks_that_run_together_are_told(tmp_path: Path):
    body = [row.partition(" ")[2] for row in rows(" ")]
    body[10] += " " + body.pop(11)
    raw = log(tmp_path, "Torque Pressure", *body)
    assert [channel.source.n_samples for channel in raw.channels] == [ROWS, ROWS]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(raw.channels[0].source.read(0, ROWS))), [10, 11])
    assert [finding.code for finding in raw.findings] == ["csv_rows_damaged"]


@pytest.mark.parametrize("separator", [";", " "])
def test_a_short_row_beside_a_long_one_shifts_no_sample(tmp_path: Path, separator: str):
    """A separator and a line end changed places: the fields of both rows are as many as they should be."""
    body = [f"{row}{separator}5.5" for row in rows(separator)]
    body[200:202] = [rows(separator)[200], f"5.5{separator}{body[201]}"]
    raw = log(tmp_path, f"{HEAD};Gauge [bar]".replace(";", separator).replace(" [", "["), *body)
    for channel, truth in zip(raw.channels, (TORQUE, PRESSURE), strict=True):
        found = channel.source.read(0, 10**6)
        assert np.isnan(found[200:202]).all()
        np.testing.assert_allclose(np.delete(found, [200, 201]), np.delete(truth, [200, 201]))
    assert [finding.code for finding in raw.findings] == ["csv_rows_damaged", "time_stamp_damaged"]


def test_a_remark_beside_the_first_row_costs_no_slow_channel(tmp_path: Path):
    body = [f"{row};{25 if n % 10 == 2 else ''};{'' if n else 'start'}" for n, row in enumerate(rows())]
    raw = log(tmp_path, HEAD + ";Temp [degC];Remark", *body)
    assert_read(raw)
    assert [channel.name for channel in channels(tmp_path / "log.csv")] == ["Torque", "Pressure", "Temp"]


def test_a_blank_before_quotes_is_none_of_the_name(tmp_path: Path):
    head = '"Time [s]", "Torque", "Pressure, line [bar]"'
    (tmp_path / "log.csv").write_text("\n".join([head, *rows(", "), ""]), encoding="utf-8")
    assert [c.name for c in channels(tmp_path / "log.csv")] == ["Torque", "Pressure, line"]


@pytest.mark.parametrize("footer", ["End of data", "\x1a", "Max;60;2500", "(400 rows)"])
def test_a_line_below_the_table_is_told_once_and_is_no_damage(tmp_path: Path, footer: str):
    raw = log(tmp_path, HEAD, *rows(), footer)
    assert_read(raw, "rows_without_time")
    assert raw.findings[0].text == "1 row at the end holds no time; it is left out"


@pytest.mark.parametrize("footer", [["End of data"], ["", "(400 rows)"], ["Max;"]])
def test_a_line_below_a_table_without_times_is_no_damage(tmp_path: Path, footer: list[str]):
    body = [row.partition(";")[2] for row in rows()]
    raw = log(tmp_path, HEAD.partition(";")[2], *body, *footer)
    assert_read(raw, "rows_without_numbers")
    assert raw.channels[0].source.n_samples == len(body)
    body[10] = "x"
    said = {finding.code: finding.text for finding in log(tmp_path, HEAD.partition(";")[2], *body, *footer).findings}
    assert said["csv_rows_damaged"].endswith("(line 12)")


@pytest.mark.parametrize("times", [True, False], ids=["with times", "without"])
@pytest.mark.parametrize("remark", ["# marker: door opened", "% pause", "Event: door opened", "# door;gate;c;d;e;f"])
def test_a_remark_among_the_rows_is_no_lost_sample(tmp_path: Path, remark: str, times: bool):
    """A marker was a damaged row, which had the time of the one before, and cost two cycles."""
    body = rows() if times else [row.partition(";")[2] for row in rows()]
    head = HEAD if times else HEAD.partition(";")[2]
    raw = log(tmp_path, head, *body[:9], remark, *body[9:20], remark, remark, *body[20:])
    assert_read(raw, "csv_remarks")
    assert raw.findings[0].severity == "info"
    assert raw.findings[0].text == "3 lines among the rows are remarks and are left out (line 11, 23, 24)"


def test_a_whole_last_row_with_a_separator_at_its_end_is_not_cut(tmp_path: Path):
    body = [f"{row};" for row in rows()[:50]]  # too few rows to tell what the last one may lack
    (finding,) = log(tmp_path, "\n".join([HEAD, *body]), end="").findings
    assert (finding.code, finding.severity) == ("csv_no_line_end", "info")


@pytest.mark.parametrize("row", ["x", "0.00045;2.6", "\x00\x00 zz yy", "abc;def;ghi"])
def test_what_may_have_been_a_row_is_no_remark(tmp_path: Path, row: str):
    raw = log(tmp_path, HEAD, *rows()[:9], row, *rows()[10:])
    assert "csv_remarks" not in {finding.code for finding in raw.findings}
    assert np.flatnonzero(np.isnan(raw.channels[0].source.read(0, ROWS))).tolist() == [9]


def test_damage_above_a_footer_is_told_with_its_own_lines(tmp_path: Path):
    body = rows()
    body[10], body[20] = "0.0005;3.00", body[20].replace(";", ";x", 1)
    raw = log(tmp_path, HEAD, *body, "End of data")
    said = {finding.code: finding.text for finding in raw.findings}
    assert said["csv_rows_damaged"].endswith("(line 12)")
    assert said["csv_cells_damaged"].endswith("(line 22)")


@pytest.mark.parametrize("word", ["OVRRNG", "OL", "O.L", "#OVER", "over range", "---.--", "+OVR"])
def test_words_of_meters_for_a_value_beyond_the_range(tmp_path: Path, word: str):
    body = rows()
    body[10] = body[10].replace(f";{TORQUE[10]:.2f};", f";{word};")
    assert [finding.code for finding in log(tmp_path, HEAD, *body).findings] == ["csv_overrange"]


@pytest.mark.parametrize(
    ("day", "mark"),
    [("03/07/24", "."), ("07.03.24", "."), ("07-03-2024", ","), ("2024-03-07", ":"), ("07.03.2024", ":")],
)
def test_stamps_of_other_habits(tmp_path: Path, day: str, mark: str):
    body = [f"{day} 10:00:00{mark}{50 * n:06d}{line[7:]}" for n, line in enumerate(rows())]
    raw = log(tmp_path, HEAD.replace("Time [s]", "Zeitstempel"), *body)
    assert_read(raw)
    assert raw.channels[0].stamp == pytest.approx(np.datetime64("2024-03-07T10:00").astype("int64") * 60.0, abs=1e-5)


def test_a_stamp_that_is_not_known_is_named(tmp_path: Path):
    body = [f"Mar 07 2024 10:00:00.{50 * n:06d}{line[7:]}" for n, line in enumerate(rows())]
    with pytest.raises(Refusal, match=r"line 2 has 'Mar 07 2024 10:00:00.000000', which is no number or time"):
        log(tmp_path, HEAD, *body)


def test_a_word_for_counting_is_no_unit(tmp_path: Path):
    body = [f"{n};{line[8:]}" for n, line in enumerate(rows())]
    assert_read(log(tmp_path, "X;Torque;Pressure", "Sequence;Nm;bar", *body), "samples_counted")


@pytest.mark.parametrize("row", [";4711;4712", ";0.01;0.3"])
def test_numbers_of_sensors_below_the_units_are_no_samples(tmp_path: Path, row: str):
    raw = log(tmp_path, "Time;Torque;Pressure", "s;Nm;bar", row, *rows())
    assert_read(raw, "rows_without_time")
    assert raw.findings[0].text == "1 row at the beginning holds no time; it is left out"
    assert raw.channels[0].start_time == 0.0


@pytest.mark.parametrize("key", ["Unit", "Einheit"])
def test_the_key_of_a_row_of_units_is_no_unit(tmp_path: Path, key: str):
    assert_read(log(tmp_path, "Time;Torque;Pressure", f"{key};Nm;bar", *rows()))
    assert [(c.name, c.unit, c.sample_rate) for c in channels(tmp_path / "log.csv")] == [
        ("Torque", "Nm", RATE), ("Pressure", "bar", RATE)]  # fmt: skip

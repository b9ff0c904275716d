"""When logs on one clock begin: by their dates, by what is stated, and told where nothing says so."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest
from camtorque.config import ChannelSpec
from camtorque.ingest import read_recording
from camtorque.ingest.cells import header_date
from camtorque.ingest.starts import starts as begin_times
from camtorque.ingest.starts import time_findings
from camtorque.records import Recording
from damaged import logs
from damaged.build import PLANS
from damaged.logs import clean_log, write_folder, write_tdms
from nptdms import ChannelObject, RootObject, TdmsFile, TdmsWriter

LOG = clean_log(revolutions=6.0)
CODES = ("start_without_date", "starts_together")


def three_files(folder: Path, clock: str) -> Path:
    """Write one TDMS file a quantity, each by a logger of its own; pressure began 0.5 s later."""
    parts = [replace(LOG, logger=q.upper(), volts={q: v}, start=0.0) for q, v in LOG.volts.items()]
    found = write_folder(folder, parts, replace(PLANS["tdms"], clock=clock))
    original, logs.START = logs.START, logs.START + timedelta(seconds=0.5)
    try:
        write_tdms(found / "PRESSURE.tdms", parts[1])
    finally:
        logs.START = original
    return found


def take_date_away(path: Path) -> None:
    """Write a TDMS file again as a logger that states no date."""
    channels = [
        ChannelObject(c.group_name, c.name, c[:], {k: v for k, v in c.properties.items() if k != "wf_start_time"})
        for group in TdmsFile.read(path).groups() for c in group.channels()
    ]  # fmt: skip
    with TdmsWriter(path) as writer:
        writer.write_segment([RootObject(), *channels])


def told(recording: Recording) -> list[tuple[str, str, str]]:
    return [(item.code, item.severity, item.where) for item in recording.findings if item.code in CODES]


def starts(recording: Recording) -> dict[str, float]:
    return {channel.quantity: pytest.approx(channel.start_time, abs=1e-6) for channel in recording.channels}


def test_the_day_is_that_of_the_logs_where_recording_toml_states_none(tmp_path: Path):
    """A trend over date had no point of a recording whose logs are dated."""
    folder = three_files(tmp_path / "r", "synchronised")
    assert read_recording(folder).config.date == logs.START.date()
    file = folder / "recording.toml"
    file.write_text(file.read_text(encoding="utf-8").replace("[recording]", "[recording]\ndate = 2024-02-29"), "utf-8")
    assert read_recording(folder).config.date == date(2024, 2, 29)
    for log in ("TORQUE", "PRESSURE", "TRIGGER"):
        take_date_away(folder / f"{log}.tdms")
    file.write_text(file.read_text(encoding="utf-8").replace("date = 2024-02-29", ""), "utf-8")
    assert read_recording(folder).config.date is None


def test_a_log_without_a_date_counts_from_the_earliest_of_the_dated_ones(tmp_path: Path):
    folder = three_files(tmp_path / "r", "synchronised")
    take_date_away(folder / "TRIGGER.tdms")
    recording = read_recording(folder)
    assert starts(recording) == {"torque": 0.0, "pressure": 0.5, "trigger": 0.0}
    assert told(recording) == [("start_without_date", "warning", "TRIGGER.tdms")]
    (text,) = [item.text for item in recording.findings if item.code == "start_without_date"]
    assert re.match(r"no date of its start, which TORQUE.tdms, PRESSURE.tdms on the same clock has", text)


def test_a_start_that_is_stated_is_not_asked_for(tmp_path: Path):
    folder = three_files(tmp_path / "r", "synchronised")
    take_date_away(folder / "TRIGGER.tdms")
    sheet = folder / "recording.toml"
    text = sheet.read_text(encoding="utf-8")
    assert text.count('quantity = "trigger"') == 1
    sheet.write_text(text.replace('quantity = "trigger"', 'quantity = "trigger"\nstart_time_s = 0.0'), encoding="utf-8")
    assert told(read_recording(folder)) == []


@pytest.mark.parametrize(("plan", "begun"), [("csv", 0.0), ("mat", 0.0), ("csv", 7.25)])
def test_a_start_that_is_stated_goes_before_times_that_count_from_anywhere(tmp_path: Path, plan: str, begun: float):
    """Logs with a time column from 0 were laid together as if all had begun at once, and the hint to say so went."""
    log = replace(LOG, start=begun, times=LOG.times - LOG.start + begun)
    parts = [replace(log, logger=q.upper(), volts={q: v}) for q, v in log.volts.items()]
    folder = write_folder(tmp_path / "r", parts, replace(PLANS[plan], clock="synchronised"))
    sheet = folder / "recording.toml"
    text = sheet.read_text(encoding="utf-8")
    sheet.write_text(text.replace('quantity = "torque"', 'quantity = "torque"\nstart_time_s = 0.125'), encoding="utf-8")
    recording = read_recording(folder)
    assert starts(recording) == {"torque": 0.125, "pressure": begun, "trigger": begun}
    assert told(recording) == []


@pytest.mark.parametrize(
    "head",
    ["# Start: {:%Y-%m-%d %H:%M:%S.%f}", "Start time;{:%d.%m.%Y %H:%M:%S.%f}", "% begin = {:%Y/%m/%dT%H:%M:%S.%fZ}"],
)
@pytest.mark.parametrize(("first", "apart"), [(0.0, 0.0005), (7.25, 0.0)], ids=["from 0 s", "counts from elsewhere"])
def test_the_date_of_a_start_in_a_header_of_a_text_counts(tmp_path: Path, head: str, first: float, apart: float):
    """Of logs that began 0.5 ms apart the trigger was 0.6 degrees off, which their headers told."""
    log = replace(LOG, start=first, times=LOG.times - LOG.start + first)
    parts = [replace(log, logger=q.upper(), volts={q: v}) for q, v in log.volts.items()]
    folder = write_folder(tmp_path / "r", parts, replace(PLANS["csv"], clock="synchronised"))
    for name in ("TORQUE", "PRESSURE", "TRIGGER"):
        begun = logs.START + timedelta(milliseconds=0.5 * (name == "PRESSURE"))
        file = folder / f"{name}.csv"
        file.write_bytes(head.format(begun).encode() + b"\r\n" + file.read_bytes())
    assert starts(read_recording(folder)) == {"torque": first, "pressure": first + apart, "trigger": first}


def test_the_date_of_a_labview_measurement_counts(tmp_path: Path):
    parts = [replace(LOG, logger=q.upper(), volts={q: v}) for q, v in LOG.volts.items()]
    folder = write_folder(tmp_path / "r", parts, replace(PLANS["lvm"], clock="synchronised"))
    for name in ("TORQUE", "PRESSURE", "TRIGGER"):
        clock = f"12:03:04.{123456 + 500 * (name == 'PRESSURE')}"
        text = (folder / f"{name}.lvm").read_text("utf-8")
        head = text.replace("Channels\t1", f"Channels\t1\nDate\t2024/05/01\nTime\t{clock}", 1)
        assert head != text
        (folder / f"{name}.lvm").write_text(head, "utf-8")
    begun = starts(read_recording(folder))
    assert begun["pressure"].expected - begun["torque"].expected == pytest.approx(5e-4, abs=1e-6)


@pytest.mark.parametrize(
    "text",
    ["Start: 2024-05-01 12:03:04", "Saved: 2024-05-01 12:03:04.123", "restart 2024-05-01 12:03:04.123",
     "Start: 05/01/2024 12:03:04.123", "Start: 2024-02-30 12:03:04.123"],
    ids=["whole seconds", "not of the start", "another word", "month or day first", "no day"],
)  # fmt: skip
def test_what_does_not_say_when_a_log_began_is_no_start(text: str):
    assert header_date([text]) is None


def test_the_zone_of_a_start_in_a_header_counts():
    zoned, plain = (header_date([f"Start: 2024-05-01 12:03:04.125{zone}"]) for zone in ("+02:00", ""))
    assert (zoned, plain) == (1714557784.125, 1714564984.125)


def test_a_start_beside_a_date_is_told_and_not_used(tmp_path: Path):
    folder = three_files(tmp_path / "r", "synchronised")
    sheet = folder / "recording.toml"
    text = sheet.read_text(encoding="utf-8")
    sheet.write_text(text.replace('quantity = "torque"', 'quantity = "torque"\nstart_time_s = 0.125'), encoding="utf-8")
    recording = read_recording(folder)
    assert starts(recording) == {"torque": 0.0, "pressure": 0.5, "trigger": 0.0}
    (finding,) = [item for item in recording.findings if item.code == "start_not_used"]
    assert finding.severity == "warning"
    assert re.match(r"start_time_s = 0.125 is not used: the file has the date of its start", finding.text)


@pytest.mark.parametrize("clock", ["single", "synchronised"])
def test_dated_logs_are_silent(tmp_path: Path, clock: str):
    assert told(read_recording(three_files(tmp_path / "r", clock))) == []


def test_synchronised_logs_that_all_begin_at_zero_are_told(tmp_path: Path):
    folder = three_files(tmp_path / "r", "synchronised")
    for name in ("TORQUE", "PRESSURE", "TRIGGER"):
        take_date_away(folder / f"{name}.tdms")
    recording = read_recording(folder)
    assert set(starts(recording)) == {"torque", "pressure", "trigger"}
    assert told(recording) == [("starts_together", "info", "recording.toml")]
    assert "PRESSURE, TORQUE, TRIGGER are synchronised and all begin at 0 s" in str(recording.findings)


def test_one_log_that_begins_later_by_its_times_alone_is_told(tmp_path: Path):
    """A time column from 0.055 s beside a file without times: nothing said that 0 s was taken for the start of that."""
    folder = three_files(tmp_path / "r", "synchronised")
    for name in ("TORQUE", "PRESSURE", "TRIGGER"):
        take_date_away(folder / f"{name}.tdms")
    recording = read_recording(folder)
    channels = [replace(c, start_time=0.055 * (c.quantity == "torque")) for c in recording.channels]
    (text,) = [item.text for item in time_findings(recording.config, {}, channels) if item.code == "starts_together"]
    assert text.startswith(
        "PRESSURE, TRIGGER begin at 0 s, TORQUE at 0.055 s, on one clock: if these do not count from"
    )
    assert "say start_time_s" in text
    channels = [replace(c, start_time=0.055 * (c.quantity != "torque")) for c in recording.channels]
    (text,) = [item.text for item in time_findings(recording.config, {}, channels) if item.code == "starts_together"]
    assert text.startswith("TORQUE begins at 0 s, PRESSURE at 0.055 s, TRIGGER at 0.055 s, on one clock: ")


def test_logs_of_one_clock_or_of_clocks_of_their_own_begin_where_they_say(tmp_path: Path):
    for clock in ("single", "independent"):
        folder = three_files(tmp_path / clock, clock)
        for name in ("TORQUE", "PRESSURE", "TRIGGER"):
            take_date_away(folder / f"{name}.tdms")
        assert told(read_recording(folder)) == []


@pytest.mark.parametrize(("step", "early"), [(2.0, 2), (-2.0, 0)])
def test_a_clock_that_was_set_back_ends_no_log_early(tmp_path: Path, step: float, early: int):
    recording = read_recording(three_files(tmp_path / "r", "single"))
    torque, *others = (replace(channel, start_time=0.0) for channel in recording.channels)
    set_once = replace(torque, breaks=(torque.n_samples // 2,), break_steps=(step,))
    codes = [item.code for item in time_findings(recording.config, {}, [set_once, *others])]
    assert codes.count("log_ends_early") == early


@pytest.mark.parametrize(("late", "early", "expected"), [
    (86399.5, 0.2, 86400.2),  # one begun before midnight, one behind it
    (86399.5, 5.0, 5.0), (100.0, 0.2, 0.2),  # no time is shared a day on either: refused later, as they are
    (43200.5, 43200.2, 43200.2),
])  # fmt: skip
def test_times_of_day_go_on_behind_midnight_from_one_log_to_the_other(late: float, early: float, expected: float):
    rows = {
        name: ChannelSpec(name, Path(f"{name}.csv"), "", name, "V", "L", 50.0, "") for name in ("torque", "pressure")
    }
    begun = dict(zip(rows.values(), (late, early), strict=True))
    raw = {
        spec: SimpleNamespace(stamp=None, start_time=start, source=SimpleNamespace(n_samples=100), sample_rate=50.0)
        for spec, start in begun.items()
    }
    found = begin_times(SimpleNamespace(own_clocks=frozenset()), raw)  # type: ignore[arg-type]
    assert [found[spec] for spec in rows.values()] == [late, expected]

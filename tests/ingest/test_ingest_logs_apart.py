"""Logs on one clock whose times do not count from one moment: other hours, epoch stamps."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from camtorque.align import align
from camtorque.ingest.recording import read_recording
from camtorque.records import Recording, Refusal
from damaged.logs import NAMES, Plan, clean_log, write_folder

LOG = clean_log(revolutions=6.0)


def recording(folder: Path, pressure: Callable[[float], str], others: Callable[[float], str] = "{:.6f}".format):
    """Return a recording of three loggers on one clock; the functions write a time."""
    parts = [replace(LOG, logger=q.upper(), volts={q: v}, start=0.0) for q, v in LOG.volts.items()]
    write_folder(folder, parts, Plan("csv", "synchronised"))
    for quantity, volts in LOG.volts.items():
        time = pressure if quantity == "pressure" else others
        rows = [f"{time(n / LOG.rate)},{value:.6f}" for n, value in enumerate(volts.tolist())]
        text = "\n".join([f"Time,{NAMES[quantity]}", *rows]) + "\n"
        (folder / f"{quantity.upper()}.csv").write_text(text, encoding="utf-8")
    return read_recording(folder)


def iso(seconds: float) -> str:
    return f"2025-03-04T12:00:{seconds:09.6f}"


def epoch(seconds: float) -> str:
    return f"{1_741_089_600 + seconds:.6f}"


def labview(seconds: float) -> str:
    """Seconds since 1904."""
    return f"{3_823_934_400 + seconds:.6f}"


def excel(seconds: float) -> str:
    """Days since 1899-12-30."""
    return f"{45_720.5 + seconds / 86_400:.11f}"


def matlab(seconds: float) -> str:
    """Days of `datenum`: a double holds 10 us."""
    return f"{739_680.5 + seconds / 86_400:.10f}"


def texts(read: Recording) -> dict[str, str]:
    return {finding.code: finding.text for finding in read.findings}


def test_logs_that_share_no_time_are_named_with_their_times(tmp_path: Path):
    read = recording(tmp_path, lambda seconds: f"{43_200 + seconds:.6f}")
    assert texts(read)["log_ends_early"].endswith("another begins later: do their times count from one moment?")
    spans = r"\w+\.csv from 0 to 0\.\d+ s, PRESSURE\.csv from 43200 to 43200\.\d+ s"
    with pytest.raises(Refusal, match=rf"logs that share no time \({spans}\), expected"):
        align(read)


def hours_later(seconds: float) -> str:
    return f"2025-03-04T14:00:{seconds + 1.3:09.6f}"


@pytest.mark.parametrize(("turns", "told"), [(0.4, False), (1.4, True)])
def test_loggers_that_are_stopped_one_by_one_end_within_a_revolution(tmp_path: Path, turns: float, told: bool):
    recording(tmp_path, "{:.6f}".format)
    rows = (tmp_path / "PRESSURE.csv").read_text(encoding="utf-8").splitlines()
    kept = rows[: len(rows) - round(turns * len(rows) / 6.0)]
    (tmp_path / "PRESSURE.csv").write_text("\n".join(kept) + "\n", encoding="utf-8")
    assert ("log_ends_early" in texts(read_recording(tmp_path))) is told


def test_logs_whole_hours_apart_are_asked_for_their_time_zone(tmp_path: Path):
    read = recording(tmp_path / "a", hours_later, lambda seconds: iso(seconds) + "Z")
    hint = r"; 2 h are what two time zones differ by \(a stamp that ends in Z is in UTC\): export both in one$"
    assert re.search("one may be of another run" + hint, texts(read)["logs_of_other_times"])
    with pytest.raises(Refusal, match=hint):
        align(read)
    read = recording(tmp_path / "b", lambda seconds: hours_later(seconds).replace("14:00", "14:20"), iso)
    assert texts(read)["logs_of_other_times"].endswith("one may be of another run")


@pytest.mark.parametrize("stamp", [epoch, labview, excel, matlab])
def test_counts_since_a_known_day_are_a_date_as_iso_stamps_are(tmp_path: Path, stamp: Callable[[float], str]):
    read = recording(tmp_path, stamp, iso)
    assert [channel.start_time for channel in read.channels] == pytest.approx([0.0, 0.0, 0.0], abs=2e-5)
    assert not {"start_without_date", "log_ends_early", "certificate_age_unknown"} & set(texts(read))

"""A slow channel beside fast ones in one table: its value stands in one row in so many, the cells between are blank."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.config import ChannelSpec
from camtorque.ingest import table_rows
from camtorque.ingest.check import summarise
from camtorque.ingest.csv_log import channels, read
from camtorque.ingest.raw import ArraySource
from camtorque.ingest.recording import read_recording
from camtorque.records import Refusal
from damaged.logs import Plan, clean_log, write_folder

ROWS, RATE, EVERY = 600, 20_000.0, 50
HEADS = {"times": ["Time,Torque,Fuel", "s,N m,degC"], "header": ["# Sample rate 20000 Hz", "Torque,Fuel", "N m,degC"],
         "nothing": ["Torque,Fuel", "N m,degC"]}  # fmt: skip


def table(folder: Path, head: str, first: int = 0, every: int = EVERY, stray: int | None = None) -> Path:
    lines = list(HEADS[head])
    for row in range(ROWS):
        fuel = f"{40.0 + row / 1000.0:.3f}" if row % every == first or row == stray else ""
        time = f"{row / RATE:.5f}," if head == "times" else ""
        lines.append(f"{time}{np.sin(0.1 * row):.4f},{fuel}")
    file = folder / "log.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def specs(file: Path, slow: float) -> tuple[ChannelSpec, ...]:
    return (
        ChannelSpec("fuel_temperature", file, "", "Fuel", "degC", "L", slow, ""),
        ChannelSpec("torque", file, "", "Torque", "N m", "L", RATE, ""),
    )


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("first", [0, 7])
@pytest.mark.parametrize("block", [70, 10**6])
def test_a_slow_channel_is_read_at_its_own_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, head: str, first: int, block: int
):
    monkeypatch.setattr(table_rows, "ROWS", block)
    file = table(tmp_path, head, first)
    slow, fast = read(file, specs(file, RATE / EVERY), "").channels
    assert (slow.sample_rate, fast.sample_rate) == (pytest.approx(RATE / EVERY), pytest.approx(RATE))
    assert slow.start_time == pytest.approx(first / RATE, abs=1e-6)
    np.testing.assert_allclose(slow.source.read(0, 99), 40.0 + np.arange(first, ROWS, EVERY) / 1000.0)
    assert fast.source.n_samples == ROWS


def test_a_slow_channel_goes_on_behind_lost_rows(tmp_path: Path):
    """Its rows are others there: the log was refused for the rate of its stamps, and named no channel."""
    file = table(tmp_path, "times", every=20)
    lines = file.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join([*lines[:202], *lines[257:]]) + "\n", encoding="utf-8")
    slow, fast = read(file, specs(file, RATE / 20), "").channels
    assert (slow.sample_rate, fast.sample_rate) == (pytest.approx(RATE / 20), pytest.approx(RATE))
    lost = [float(np.sum(channel.break_steps)) for channel in (slow, fast)]
    assert lost == [pytest.approx(60 / RATE), pytest.approx(55 / RATE)]
    kept = [row for row in range(0, ROWS, 20) if not 200 <= row < 255]
    np.testing.assert_allclose(slow.source.read(0, 99), [40.0 + row / 1000.0 for row in kept])


def test_a_slow_channel_without_a_number_stops_no_other(tmp_path: Path):
    file = table(tmp_path, "times")
    text = file.read_text(encoding="utf-8")
    file.write_text(re.sub(r",4[01]\.\d+$", ",", text, flags=re.MULTILINE), encoding="utf-8")
    slow, fast = read(file, specs(file, RATE / EVERY), "").channels
    assert np.isnan(slow.source.read(0, slow.source.n_samples)).all()
    assert (slow.sample_rate, fast.sample_rate) == (pytest.approx(RATE / EVERY), pytest.approx(RATE))


def test_values_between_its_rows_are_no_slow_channel(tmp_path: Path):
    file = table(tmp_path, "times", stray=3)
    with pytest.raises(Refusal, match=r"time stamps say 20000 Hz, recording.toml says 400 Hz; correct the one"):
        read(file, specs(file, RATE / EVERY), "")


@pytest.mark.parametrize("celsius", [-273.2, 850.0])
def test_a_temperature_at_which_no_fuel_is_liquid_is_told(tmp_path: Path, celsius: float):
    recording = read_recording(write_folder(tmp_path, [clean_log()], Plan("hdf5")))
    fuel = replace(recording.channels[0], quantity="fuel_temperature", calibration=None, scale=1.0, name="Fuel",
                   source=ArraySource(np.r_[np.full(99, 313.15), celsius + 273.15]))  # fmt: skip
    found = summarise(replace(recording, channels=(*recording.channels, fuel))).findings
    (text,) = (finding.text for finding in found if finding.code == "temperature_not_of_liquid")
    low, high = sorted((40.0, celsius))
    assert text.startswith(
        f"the fuel reads {low:.4g} to {high:.4g} degC, expected -60 to 250: what lies outside is not"
    )


def test_a_slow_channel_is_listed_with_its_rate(tmp_path: Path):
    found = {channel.name: channel for channel in channels(table(tmp_path, "times", first=7))}
    assert (found["Torque"].sample_rate, found["Torque"].n_samples) == (pytest.approx(RATE), ROWS)
    assert (found["Fuel"].sample_rate, found["Fuel"].n_samples) == (pytest.approx(RATE / EVERY), ROWS // EVERY)


def test_a_slow_channel_under_the_rate_of_the_others_is_told_with_its_own(tmp_path: Path):
    log = clean_log()
    thin = np.where(np.arange(log.volts["torque"].size) % 5 == 0, log.volts["torque"], np.nan)
    recording = read_recording(write_folder(tmp_path, [log.with_volts("torque", thin)], Plan("hdf5")))
    texts = [finding.text for finding in summarise(recording).findings if finding.code == "samples_not_numbers"]
    assert [text.partition(": ")[2] for text in texts] == ["one in 5 holds a value; write sample_rate_hz = 2000"]

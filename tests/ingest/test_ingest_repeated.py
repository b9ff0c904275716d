"""A slow module whose values a faster table repeats."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.ingest import repeated
from camtorque.ingest.raw import ArraySource, EveryNth
from camtorque.ingest.recording import read_recording
from camtorque.ingest.repeated import OneOfEach, repeats_of, uneven_repeats_of
from damaged.logs import Plan, clean_log, write_folder
from hypothesis import given, settings
from hypothesis import strategies as st

EVERY = 5


def held(values: np.ndarray, first: int, every: int = EVERY) -> np.ndarray:
    """Return values as a table shows those of each ``every``-th row from ``first`` on, the one before at the top."""
    return values[np.maximum((np.arange(values.size) - first) // every * every + first, 0)]


@pytest.mark.parametrize("form", ["hdf5", "csv"])
@pytest.mark.parametrize("first", [0, 2])
def test_repeated_values_count_where_they_first_stand(tmp_path: Path, form: str, first: int) -> None:
    """At a tenth of the table's rate they were refused as clipped, at a fifth taken half a step late without a word."""
    log = clean_log()
    whole = read_recording(write_folder(tmp_path / "whole", [log], Plan(form))).of("torque")[0]
    slow = log.with_volts("torque", held(log.volts["torque"], first))
    recording = read_recording(write_folder(tmp_path / "slow", [slow], Plan(form)))
    (torque,) = recording.of("torque")
    assert torque.sample_rate == pytest.approx(log.rate / EVERY)
    assert torque.start_time == pytest.approx(whole.start_time + first / log.rate, abs=1e-9)
    expected = whole.source.read(0, whole.n_samples)[first::EVERY]
    np.testing.assert_array_equal(torque.source.read(0, torque.n_samples), expected)
    np.testing.assert_array_equal(torque.source.read(7, 9), expected[7:9])
    (text,) = [item.text for item in recording.findings if item.code == "values_repeated"]
    assert text.startswith("each value stands in 5 rows, as one of a module of 2000 Hz in a table of 10000 Hz")
    assert recording.of("pressure")[0].sample_rate == log.rate


@pytest.mark.parametrize("bits", [24, 12, 8])
def test_a_coarse_converter_repeats_nothing(bits: int) -> None:
    values = np.round(clean_log().volts["torque"] * 2.0 ** (bits - 4))
    assert repeats_of(ArraySource(values)) == (0, 1)


def test_what_is_repeated_at_one_end_alone_or_changes_seldom_is_taken_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(repeated, "LOOKED_AT", 1000)
    noise = np.random.default_rng(1).normal(size=4000)
    assert repeats_of(ArraySource(held(noise, 3))) == (3, EVERY)
    assert repeats_of(ArraySource(np.r_[held(noise[:2000], 3), noise[2000:]])) == (0, 1)
    assert repeats_of(ArraySource(held(noise, 0, 20))) == (0, 1)  # 49 changes at either end
    assert repeats_of(ArraySource(np.zeros(0))) == (0, 1)


def test_one_in_so_many_is_read_in_pieces() -> None:
    source = EveryNth(ArraySource(np.arange(23.0)), 2, 5)
    assert source.n_samples == 5
    assert source.read(0, 99).tolist() == [2.0, 7.0, 12.0, 17.0, 22.0]
    assert source.read(1, 3).tolist() == [7.0, 12.0]
    assert source.read(4, 4).size == 0
    assert replace(source, first=3).n_samples == 4


def test_a_module_whose_rate_does_not_divide_that_of_the_table_is_read_at_its_own(tmp_path: Path) -> None:
    """It was refused as clipped: each value stands in two or three rows."""
    log, every, first = clean_log(), 2.8, 0.7
    rows = np.arange(log.volts["torque"].size)
    taken = first + every * np.floor((rows - first) / every)
    slow = log.with_volts("torque", np.interp(taken, rows, log.volts["torque"]))
    recording = read_recording(write_folder(tmp_path / "slow", [slow], Plan("hdf5")))
    (torque,) = recording.of("torque")
    assert torque.sample_rate == pytest.approx(log.rate / every, rel=1e-8)
    assert torque.start_time == pytest.approx(first / log.rate, abs=0.02 / log.rate)
    times = first + every * np.arange(torque.n_samples)
    expected = np.interp(times, rows, log.volts["torque"])
    np.testing.assert_allclose(torque.source.read(0, torque.n_samples), expected, atol=1e-3 * np.ptp(expected))
    (text,) = [item.text for item in recording.findings if item.code == "values_repeated"]
    assert text.startswith("each value stands in 2.8 rows, as one of a module of 3571.43 Hz")


@settings(max_examples=40, deadline=None)
@given(every=st.floats(1.55, 9.95), first=st.floats(0.0, 1.5), seed=st.integers(0, 99))
def test_values_that_stand_in_uneven_numbers_of_rows_are_each_read_once(every: float, first: float, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=20_000).round(3 if every > 2.0 else 12)
    rows = np.arange(15_000.0)
    source = ArraySource(values[np.floor((rows - first) / every).astype(int) + 1])
    found = uneven_repeats_of(source)
    if found == (0.0, 1.0):  # close to a whole number one of both lengths is rare
        assert abs(every - round(every)) * rows.size / every < 120
        return
    assert found[1] == pytest.approx(every, rel=1e-5)
    one = OneOfEach(source, *found)
    begun = 1 + round((found[0] - first) / every)
    read = one.read(0, one.n_samples)
    np.testing.assert_array_equal(read, values[begun : begun + one.n_samples])
    np.testing.assert_array_equal(one.read(3, 40), read[3:40])
    assert one.read(5, 5).size == 0


@pytest.mark.parametrize("bits", [6, 8, 10, 12])
def test_a_noise_that_repeats_values_here_and_there_stands_in_no_even_number_of_rows(bits: int) -> None:
    noise = 0.8 * np.random.default_rng(bits).standard_normal(400_000)
    values = np.round(np.sin(1e-3 * np.arange(noise.size)) * 2.0**bits + noise)
    assert uneven_repeats_of(ArraySource(values)) == (0.0, 1.0)

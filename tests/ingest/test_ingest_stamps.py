"""Time stamps: rate from the whole stretch, jumps and damaged stamps found where they are."""

import numpy as np
import pandas as pd
import pytest
from camtorque.ingest.cells import STAMPS
from camtorque.ingest.raw import ArraySource
from camtorque.ingest.stamp_texts import kind_of_dates, seconds_of_texts
from camtorque.ingest.stamps import read_stamps
from camtorque.records import Refusal
from camtorque.units import counted
from hypothesis import given, settings
from hypothesis import strategies as st

RATES = st.sampled_from([1000.0, 5000.0, 12_800.0, 20_000.0, 30_000.0, 51_200.0, 100_000.0])


def stamps(rate: float, count: int, start: float = 0.0) -> np.ndarray:
    """Stamps rounded to a microsecond, as CSV files hold them."""
    return np.round(start + np.arange(count) / rate, 6)


@settings(deadline=None)
@given(rate=RATES, count=st.integers(200, 5000), start=st.floats(0.0, 100.0))
def test_rounded_stamps_give_the_declared_rate(rate: float, count: int, start: float):
    base = read_stamps(ArraySource(stamps(rate, count, start)), rate, "log")
    assert base.rate == rate
    assert base.breaks == ()
    assert base.findings == ()
    assert base.start == pytest.approx(start, abs=1e-6)  # the rounding of the stamps


@settings(deadline=None)
@given(at=st.integers(10, 900), jump=st.floats(1e-3, 10.0), sign=st.sampled_from([-1.0, 1.0]))
def test_a_jump_is_found_where_it_is(at: int, jump: float, sign: float):
    times = stamps(10_000.0, 1000)
    times[at:] += sign * jump
    base = read_stamps(ArraySource(times), 10_000.0, "log")
    assert base.breaks == (at,)
    assert base.break_steps[0] == pytest.approx(sign * jump, abs=5e-6)  # the rounding of steps and stamps
    assert base.rate == pytest.approx(10_000.0, rel=1e-4)
    assert base.findings[0].code == ("time_gap" if sign > 0 else "time_not_monotonic")


@pytest.mark.parametrize("copies", [2, 3])
def test_a_log_appended_to_itself_is_told(copies: int):
    base = read_stamps(ArraySource(np.tile(stamps(10_000.0, 1000, 2.5), copies)), 10_000.0, "log")
    assert [finding.code for finding in base.findings] == ["time_not_monotonic", "log_appended"]
    assert "at sample 1000 the time begins again" in base.findings[1].text
    assert "count twice, or another log to it; keep one of them" in base.findings[1].text


def test_a_clock_set_back_is_no_log_appended():
    times = stamps(10_000.0, 1000)
    times[600:] -= 0.03
    assert [f.code for f in read_stamps(ArraySource(times), 10_000.0, "log").findings] == ["time_not_monotonic"]


@pytest.mark.parametrize(("hours", "told"), [(-1.0, True), (1.0, True), (-0.9, False)])
def test_a_clock_set_to_summer_or_winter_time_is_told_as_that(hours: float, told: bool):
    times = stamps(10_000.0, 1000) + 3.0e4
    times[600:] += 3600.0 * hours
    (finding,) = read_stamps(ArraySource(times), 10_000.0, "log").findings
    assert ("was the clock set to summer or winter time? export the log in UTC" in finding.text) == told


@settings(deadline=None)
@given(at=st.integers(2, 990), size=st.floats(1e-3, 1e3))
def test_one_wrong_stamp_is_not_a_jump(at: int, size: float):
    times = stamps(10_000.0, 1000)
    times[at] += size
    base = read_stamps(ArraySource(times), 10_000.0, "log")
    assert base.breaks == ()
    assert [finding.code for finding in base.findings] == ["time_stamp_damaged"]


@settings(deadline=None)
@given(st.lists(st.integers(1, 998), min_size=1, max_size=20, unique=True))
def test_missing_stamps_are_bridged(places: list[int]):
    times = stamps(10_000.0, 1000)
    times[places] = np.nan
    base = read_stamps(ArraySource(times), 10_000.0, "log")
    assert base.rate == 10_000.0
    assert base.start == pytest.approx(0.0, abs=1e-9)
    assert base.findings[0].text.startswith(counted(len(places), "time stamp is", "time stamps are"))


def test_stamps_that_scatter_are_no_jumps_of_a_clock():
    times = stamps(10_000.0, 20_000) + np.random.default_rng(0).normal(0.0, 1.15e-5, 20_000)
    base = read_stamps(ArraySource(times), 10_000.0, "log")
    assert base.breaks == ()
    assert base.rate == 10_000.0
    assert [finding.code for finding in base.findings if finding.code != "time_stamp_damaged"] == ["time_stamps_stray"]
    times[7000:] += 1e-4
    lost = read_stamps(ArraySource(times), 10_000.0, "log")
    assert lost.breaks == (7000,)
    assert lost.break_steps[0] == pytest.approx(1e-4, abs=5e-5)


def test_rates_that_contradict():
    times = ArraySource(stamps(10_000.0, 5000))
    base = read_stamps(times, 10_010.0, "log")
    assert base.rate == pytest.approx(10_000.0, rel=1e-6)
    assert [finding.code for finding in base.findings] == ["rate_differs"]
    with pytest.raises(Refusal, match=r"the time stamps say 10000 Hz, .* the one that is wrong$"):
        read_stamps(times, 20_000.0, "log")
    with pytest.raises(Refusal, match=r"wrong, or the unit of the stamps \(ms or us for s\?\)"):
        read_stamps(times, 1e7, "log")
    with pytest.raises(Refusal, match=r"wrong, or the unit of the stamps \(s for ms or us\?\)"):
        read_stamps(times, 10.0, "log")


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (np.zeros(100), "time does not run forward"),
        (np.arange(100.0)[::-1], "time does not run forward .*newest to the oldest: sort them"),
        (np.array([1.0]), "expected at least 2"),
        (np.full(10, np.nan), "expected at least 2"),
        (np.sort(np.random.default_rng(0).uniform(0, 1, 1000)), "not equidistant"),
    ],
)
def test_what_is_no_time_base_is_refused(times: np.ndarray, message: str):
    with pytest.raises(Refusal, match=message):
        read_stamps(ArraySource(times), 1000.0, "log")


def test_a_first_number_above_twelve_is_a_day() -> None:
    texts = ["05/12/2024 10:00:00", "25/12/2024 10:00:00"]
    kind = kind_of_dates(pd.Series(texts), "slashes")
    assert np.diff(seconds_of_texts(texts, kind)) == pytest.approx(20.0 * 86_400.0)
    assert np.diff(seconds_of_texts(["05/12/2024 10:00:00", "05/13/2024 10:00:00"], "slashes")) == 86_400.0


@pytest.mark.parametrize(("digits", "seconds"), [(6, 12.0), (6, 60.0), (5, 3.0), (4, 3.0), (4, 1.2)])
def test_a_time_printed_with_a_fixed_number_of_digits_is_even(digits: int, seconds: float):
    times = np.arange(round(seconds * 20_000)) / 20_000.0
    printed = np.array([float(f"{time:.{digits}g}") for time in times])
    base = read_stamps(ArraySource(printed), 20_000.0, "log")
    assert base.rate == 20_000.0
    assert [row.code for row in base.findings] == ["time_stamps_coarse"]
    assert abs(base.start) < 1e-3


def test_rows_that_stand_there_twice_are_no_time_that_runs_back():
    times = np.arange(20_000) / 10_000.0
    (found,) = read_stamps(
        ArraySource(np.insert(times, [4_000, 9_000], times[[4_000, 9_000]])), 10_000.0, "log"
    ).findings
    assert found.code == "time_repeated"
    assert found.text.startswith("2 rows have the time of the one before: leave out those that are repeated")


@pytest.mark.parametrize(
    "text",
    ["2025-10-26T00:59:58.5Z", "2025-10-26 00:59:58.5 UTC", "2025-10-26 02:59:58.5 +0200", "2025-10-26 02:59:58.5+02",
     "20251026T005958.5", "20251026T025958,5+02:00"],
)  # fmt: skip
def test_iso_stamps_tell_their_zone_in_any_way(text: str):
    assert STAMPS["iso"].match(text)
    assert seconds_of_texts([text], "iso").tolist() == [1_761_440_398.5]

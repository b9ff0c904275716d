"""What `stored` tells of every format alike: which channel is meant, what gives its times, what a refusal says."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from camtorque.config import ChannelSpec
from camtorque.ingest import hdf5, mat, mf4, tdms
from camtorque.ingest.raw import ArraySource
from camtorque.ingest.stored import Stored, among, listing_of, read_stored
from camtorque.records import Refusal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

RATE = 1000.0
TIMES = np.arange(400) / RATE
FILE = Path("run.log")


def spec(channel: str, group: str = "", time: str = "", file: Path = FILE) -> ChannelSpec:
    return ChannelSpec("torque", file, group, channel, "V", "L", RATE, "", time_channel=time)


def stored(name: str, group: str = "", values: np.ndarray = TIMES, **more: object) -> Stored:
    return Stored(group, name, "V", ArraySource(values), **more)


@pytest.mark.parametrize(
    ("held", "wanted", "said"),
    [
        ([("", "p"), ("", "p")], spec("p"), "'p' is there 2 times; .* export them under two names"),
        ([("A", "p"), ("B", "p")], spec("p"), "'p' is in the groups A, B; name one as group"),
        ([("Main", "p")], spec("p", "Mian"), "no group 'Mian', did you mean 'Main'.; the file has Main"),
        ([("", "p")], spec("p", "Main"), "no group 'Main'; the file has none: leave out group"),
        ([("A", "p"), ("B", "q")], spec("P", "A"), "no channel 'P' in group 'A', did you mean 'p'.; there are p$"),
        ([("A", f"c{n}") for n in range(14)], spec("x"), "no channel 'x' in any group; there are A/c0, .* and 2 more$"),
        ([], spec("x"), "no channel 'x'; there are none"),
    ],
)
def test_a_channel_that_is_not_one_is_refused_with_those_that_are(
    held: list[tuple[str, str]], wanted: ChannelSpec, said: str
):
    items = [stored(name, group) for group, name in held]
    with pytest.raises(Refusal, match=said):
        read_stored(FILE, "log", (wanted,), among(FILE, items))


@pytest.mark.parametrize(
    ("item", "time", "said"),
    [
        (stored("p", values=np.empty(0)), "", "channel 'p' holds no samples; the logger wrote none: record it again"),
        (stored("p", rate=-2.0), "", "run.log p: the sampling rate in the file is -2.0 Hz, expected a number > 0"),
        (stored("p"), "t", "399 times in 't' for 400 samples: the file is cut or mixed up; save both from one"),
    ],
)
def test_a_channel_without_samples_rate_or_times_is_refused(item: Stored, time: str, said: str):
    items = [item, stored("t", values=TIMES[1:])]
    with pytest.raises(Refusal, match=said):
        read_stored(FILE, "log", (spec("p", time=time),), among(FILE, items))


def test_a_rate_that_is_none_is_not_listed():
    items = [stored("a", rate=float("inf")), stored("b", rate=RATE), stored("c", times=ArraySource(TIMES))]
    assert [channel.sample_rate for channel in listing_of(items)] == [None, RATE, RATE]


def test_a_date_in_the_times_says_more_than_that_of_the_file():
    item = stored("p", times=ArraySource(TIMES + 1.7e9), dates=((0, 1.6e9),))
    (channel,) = read_stored(FILE, "log", (spec("p"),), among(FILE, [item])).channels
    assert (channel.start_time, channel.stamp) == (0.0, pytest.approx(1.7e9))


def test_a_file_that_was_not_cut_says_that_a_channel_is_empty(tmp_path: Path):
    file = tmp_path / "run.tdms"
    with TdmsWriter(file) as writer:
        writer.write_segment([ChannelObject("A", "p", np.empty(0)), ChannelObject("A", "q", TIMES)])
    with pytest.raises(Refusal, match="channel 'A/p' holds no samples; the logger wrote none"):
        tdms.read(file, (spec("p", "A", file=file),), "")


def test_a_date_of_the_first_sample_does_not_count_the_time_twice_that_stands_beside(tmp_path: Path):
    """Times of two logs run from midnight and one began five seconds later: it was placed ten seconds later."""
    begun, file = [], tmp_path / "run.tdms"
    for late in (0, 5):
        date = np.datetime64("2026-01-01T12:00:00") + np.timedelta64(late, "s")
        with TdmsWriter(file) as writer:
            p = ChannelObject("A", "p", TIMES % 0.007, {"wf_start_time": date})
            writer.write_segment([p, ChannelObject("A", "Time", TIMES + 43200.0 + late)])
        (channel,) = tdms.read(file, (spec("p", "A", file=file),), "").channels
        assert channel.start_time == pytest.approx(43200.0 + late)
        begun.append(channel.stamp + channel.start_time)
    assert begun[1] - begun[0] == pytest.approx(5.0)
    assert begun[0] == pytest.approx(1767268800.0)


def test_times_beside_a_data_set_that_is_named_by_its_path(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store["Main/p"], store["Main/Time"] = TIMES % 0.007, TIMES + 2.0
    (channel,) = hdf5.read(file, (spec("Main/p", file=file),), "").channels
    assert (channel.start_time, channel.sample_rate) == (pytest.approx(2.0), pytest.approx(RATE))


def test_a_time_channel_that_is_named_holds_in_mdf_as_elsewhere(tmp_path: Path):
    asammdf = pytest.importorskip("asammdf")
    file = tmp_path / "log.mf4"
    with asammdf.MDF(version="4.10") as log:
        signals = (("p", TIMES % 0.007), ("daq_time", TIMES + 5.0))
        log.append([asammdf.Signal(values, TIMES, name=name) for name, values in signals], acq_name="G")
        log.save(file)
    (plain,) = mf4.read(file, (spec("p", "G", file=file),), "").channels
    (named,) = mf4.read(file, (spec("p", "G", "daq_time", file),), "").channels
    assert (plain.start_time, named.start_time) == (0.0, pytest.approx(5.0))
    with pytest.raises(Refusal, match="no channel 'dq_time' in group 'G', did you mean 'daq_time'"):
        mf4.read(file, (spec("p", "G", "dq_time", file),), "")


def test_the_unit_of_a_group_is_that_of_what_was_measured_not_of_its_times(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        group = store.create_group("Torque")
        group.attrs["unit"] = "V"
        group["p"], group["time"] = TIMES % 0.007, np.arange(400)
        group["time"].attrs["scale"] = 1.0 / RATE
    (channel,) = hdf5.read(file, (spec("p", "Torque", file=file),), "").channels
    assert (channel.unit, channel.sample_rate) == ("V", RATE)
    assert [item.name for item in hdf5.channels(file)] == ["p"]  # `camtorque new` had refused all
    file = tmp_path / "run.mat"
    savemat(file, {"Torque": {"Data": TIMES % 0.007, "Time": TIMES + 1.0, "units": "V"}})
    for time in ("", "Time"):
        (channel,) = mat.read(file, (spec("Data", "Torque", time, file),), "").channels
        assert (channel.unit, channel.start_time) == ("V", 1.0)
    assert [(item.name, item.unit, item.sample_rate) for item in mat.channels(file)] == [("Data", "V", RATE)]


def test_times_whose_own_unit_is_none_of_time_are_refused(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store["p"], store["time"] = TIMES % 0.007, TIMES
        store["time"].attrs["unit"] = "V"
    with pytest.raises(Refusal, match=r"run\.h5 p time column: unit 'V' is a voltage, expected a time unit"):
        hdf5.read(file, (spec("p", file=file),), "")


@pytest.mark.parametrize(
    ("name", "value"), [("Sample_Rate", "1 kg"), ("Sample_Rate", "fast"), ("dt", [1e-3, 1e-3]), ("t0", "noon")]
)
def test_an_attribute_that_is_no_number_is_named(tmp_path: Path, name: str, value: object):
    """The file was called damaged."""
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store["p"] = TIMES % 0.007
        store["p"].attrs[name] = value
    for look in (lambda: hdf5.channels(file), lambda: hdf5.read(file, (spec("p", file=file),), "")):
        with pytest.raises(Refusal, match=f"data set /p: the attribute {name} is .*, expected a number in Hz or s"):
            look()


@pytest.mark.parametrize(
    ("name", "value"), [("Sample_Rate", "1 kHz"), ("fs", "1000 Hz"), ("fs", "1000"), ("dt", "1 ms")]
)
def test_an_attribute_may_state_its_unit(tmp_path: Path, name: str, value: str):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store["p"] = TIMES % 0.007
        store["p"].attrs[name] = value
    assert hdf5.channels(file)[0].sample_rate == pytest.approx(RATE)
    assert hdf5.read(file, (spec("p", file=file),), "").channels[0].sample_rate == pytest.approx(RATE)


@pytest.mark.parametrize(("start", "rate"), [(1_700_000_000_000_000_000, RATE), (0, None)])
def test_counted_nanoseconds_without_a_unit_are_no_seconds(tmp_path: Path, start: int, rate: float | None):
    """They were listed at 1e-6 Hz."""
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store["p"] = TIMES % 0.007
        store["time"] = np.round(TIMES * 1e9).astype("i8") + start
    (listed,) = hdf5.channels(file)
    assert (listed.sample_rate, listed.time_channel) == (rate and pytest.approx(rate), "time")
    assert hdf5.read(file, (spec("p", file=file),), "").channels[0].sample_rate == pytest.approx(RATE)


def test_a_link_into_another_file_is_refused_with_that_file(tmp_path: Path):
    """The samples of the other file would have no checksum, and another data set of that name may be here."""
    with h5py.File(tmp_path / "part.h5", "w") as store:
        store["a/q"] = TIMES
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store["p"] = h5py.ExternalLink("part.h5", "a/q")
    with pytest.raises(Refusal, match=r"'p' is a link to /a/q of another file; .* file = 'part.h5', channel = 'a/q'"):
        hdf5.read(file, (spec("p", file=file),), "")


def test_a_file_of_links_alone_is_told_where_they_lead(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store["a/p"] = h5py.ExternalLink("part.h5", "p")
    with pytest.raises(Refusal, match=r"it has links to part\.h5: name such a file in its place"):
        hdf5.channels(file)


def test_times_since_a_day_are_in_the_unit_before_it(tmp_path: Path):
    """As netCDF has them by the conventions (CF)."""
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store["p"], store["time"] = TIMES % 0.007, np.round(TIMES * 1e6)
        store["time"].attrs["units"] = "us since 2026-01-01"
    assert hdf5.channels(file)[0].sample_rate == pytest.approx(RATE)
    assert hdf5.read(file, (spec("p", file=file),), "").channels[0].sample_rate == pytest.approx(RATE)


def test_stamps_beside_a_tdms_channel_are_its_times(tmp_path: Path):
    file = tmp_path / "run.tdms"
    stamps = np.datetime64("2026-03-12T09:00:00", "us") + np.round(TIMES * 1e6).astype("m8[us]")
    with TdmsWriter(file) as writer:
        writer.write_segment([ChannelObject("Log", "Time", stamps), ChannelObject("Log", "p", TIMES % 0.007)])
    (listed,) = tdms.channels(file)
    assert (listed.name, listed.sample_rate, listed.time_channel) == ("p", pytest.approx(RATE), "Time")
    (channel,) = tdms.read(file, (spec("p", "Log", file=file),), "").channels
    assert channel.sample_rate == pytest.approx(RATE)
    assert channel.stamp == pytest.approx(1773306000.0)


def test_an_element_of_an_array_of_structs_is_a_group(tmp_path: Path):
    """`new` listed rec(2), and what it wrote was refused: no variable 'rec(2)'."""
    file = tmp_path / "run.mat"
    savemat(file, {"rec": np.array([(TIMES, RATE), (2.0 * TIMES, RATE)], dtype=[("p", "O"), ("fs", "O")])})
    assert [item.group for item in mat.channels(file)] == ["rec(1)", "rec(2)"]
    (channel,) = mat.read(file, (spec("p", "rec(2)", file=file),), "").channels
    np.testing.assert_array_equal(channel.source.read(0, 400), 2.0 * TIMES)


def test_times_beside_a_rate_tell_when_the_log_begins(tmp_path: Path):
    """Two structs with fs and t each were both taken to begin at 0 s, and their logs for those of two runs."""
    later = {"Data": TIMES % 0.007, "t": TIMES + 0.25, "fs": RATE}
    savemat(tmp_path / "run.mat", {"rec": later})
    with h5py.File(tmp_path / "run.h5", "w") as store:
        store["rec/Data"], store["rec/t"] = later["Data"], later["t"]
        store["rec"].attrs["fs"] = RATE
    for name, reader in (("run.mat", mat), ("run.h5", hdf5)):
        file = tmp_path / name
        (channel,) = reader.read(file, (spec("Data", "rec", file=file),), "").channels
        assert (channel.start_time, channel.sample_rate) == (pytest.approx(0.25), pytest.approx(RATE))


def test_an_array_of_structs_is_named_with_its_elements(tmp_path: Path):
    """It said: no variable 'rec', did you mean 'rec'?"""
    file = tmp_path / "run.mat"
    savemat(file, {"rec": np.array([(TIMES,), (TIMES,)], dtype=[("p", "O")])})
    with pytest.raises(Refusal, match=r"'rec' is an array of structs; name one of rec\(1\), rec\(2\) as group"):
        mat.read(file, (spec("p", "rec", file=file),), "")


def test_times_in_a_group_are_those_though_a_channel_above_has_their_name(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store["x"], store["Main/x"], store["Main/p"] = TIMES % 0.007, TIMES + 3.0, TIMES % 0.007
    first, _ = hdf5.read(file, (spec("p", "Main", file=file), spec("x", file=file)), "").channels
    assert first.start_time == pytest.approx(3.0)


def test_a_time_channel_of_an_mdf_group_is_its_own_though_others_have_that_name(tmp_path: Path):
    asammdf = pytest.importorskip("asammdf")
    file = tmp_path / "log.mf4"
    with asammdf.MDF(version="4.10") as log:
        for name, begin in (("p", 1.0), ("q", 2.0)):
            log.append([asammdf.Signal(TIMES % 0.007, TIMES + begin, name=name)], acq_name="G")
        log.save(file)
    found = mf4.read(file, tuple(spec(name, "G", "time", file) for name in "pq"), "").channels
    assert [channel.start_time for channel in found] == [pytest.approx(1.0), pytest.approx(2.0)]

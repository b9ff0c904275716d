"""HDF5, MATLAB and Parquet files as other labs write them: nested, compound, scaled, with objects that nobody reads."""

from __future__ import annotations

import gc
import gzip
import zipfile
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from types import ModuleType

import h5py
import numpy as np
import pytest
from camtorque.config import ChannelSpec
from camtorque.ingest import hdf5, mat, numpy_file, parquet, tdms, xlsx
from camtorque.ingest.formats import file_format
from camtorque.ingest.parquet import refuse_lying_pages
from camtorque.ingest.proposal import look_into
from camtorque.ingest.raw import RawFile
from camtorque.ingest.table_file import read_small_table
from camtorque.records import Refusal
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

RATE = 20e3
TIME = np.arange(400) / RATE
TORQUE = 60.0 * np.sin(0.05 * np.arange(400))


def spec(file: Path, group: str, channel: str, time: str = "", rate: float = RATE) -> ChannelSpec:
    return ChannelSpec("torque", file, group, channel, "N m", "L", rate, "", time)


def assert_torque(raw: RawFile, atol: float = 0.0) -> None:
    np.testing.assert_allclose(raw.channels[0].source.read(0, 1000), TORQUE, atol=atol)
    assert raw.channels[0].sample_rate == pytest.approx(RATE)


def test_structs_in_structs_with_their_rate_and_unit(tmp_path: Path):
    file = tmp_path / "run.mat"
    signals = [{"values": TORQUE, "label": "M"}, {"values": 2.0 * TORQUE, "label": "p"}]
    savemat(file, {"rec": {"Torque": {"Data": TORQUE, "Units": "Nm", "SampleRate": RATE}}, "s": {"signals": signals}})
    listed = {(c.group, c.name): c for c in mat.channels(file)}
    assert (listed["rec.Torque", "Data"].unit, listed["rec.Torque", "Data"].sample_rate) == ("Nm", RATE)
    raw = mat.read(file, (spec(file, "rec.Torque", "Data"),), "")
    assert_torque(raw)
    assert raw.channels[0].unit == "Nm"
    with pytest.raises(Refusal, match=r"the file says 20000 Hz, recording.toml says 10000 Hz"):
        mat.read(file, (spec(file, "rec.Torque", "Data", rate=1e4),), "")
    with pytest.raises(Refusal, match=r"struct 'rec.Torque' has no field 'data', did you mean 'Data'"):
        mat.read(file, (spec(file, "rec.Torque", "data"),), "")


def test_german_structs_state_their_rate_and_unit_and_name_their_channels(tmp_path: Path):
    """A rate that is not read is not held against the declared one either."""
    file = tmp_path / "run.mat"
    torque = {"Werte": TORQUE, "Einheit": "Nm", "Abtastrate": RATE}
    savemat(file, {"Drehmoment": torque, "rec": {"Druck": {"y": 2.0 * TORQUE, "t": TIME}}})
    found = {(item.channel.group, item.channel.name): item for item in look_into([file])}
    assert found["Drehmoment", "Werte"].channel.sample_rate == RATE
    assert (found["Drehmoment", "Werte"].quantity, found["Drehmoment", "Werte"].unit) == ("torque", "N m")
    assert found["rec.Druck", "y"].quantity == "pressure"
    with pytest.raises(Refusal, match=r"the file says 20000 Hz, recording.toml says 10000 Hz"):
        mat.read(file, (spec(file, "Drehmoment", "Werte", rate=1e4),), "")


def test_a_rate_beside_the_variables_and_times_in_milliseconds(tmp_path: Path):
    file = tmp_path / "run.mat"
    savemat(file, {"fs": RATE, "torque": TORQUE})
    assert [(c.name, c.sample_rate) for c in mat.channels(file)] == [("torque", RATE)]
    raw = mat.read(file, (spec(file, "", "torque", rate=1.02 * RATE),), "")
    assert (raw.channels[0].sample_rate, raw.findings[0].code) == (RATE, "rate_differs")
    savemat(file, {"t_ms": 1e3 * TIME, "torque": TORQUE})
    assert [(c.name, c.sample_rate) for c in mat.channels(file)] == [("torque", pytest.approx(RATE))]
    assert_torque(mat.read(file, (spec(file, "", "torque", "t_ms"),), ""))


def store(file: Path, form: str, arrays: dict[str, np.ndarray]) -> tuple[ModuleType, str]:
    """Write arrays side by side and return their reader and group."""
    if form == "mat":
        savemat(file, arrays)
    elif form == "struct":
        savemat(file, {"rec": arrays})
    elif form == "npz":
        with file.open("wb") as stream:
            np.savez(stream, **arrays)
    elif form == "tdms":
        with TdmsWriter(file) as writer:
            writer.write_segment([ChannelObject("rec", name, values) for name, values in arrays.items()])
    else:
        table = np.rec.fromarrays(list(arrays.values()), names=list(arrays))
        with h5py.File(file, "w") as stream:
            if form == "compound":
                stream["rec"] = table
            for name, values in arrays.items() if form == "hdf5" else ():
                stream[f"rec/{name}"] = values
    readers = {"npz": numpy_file, "tdms": tdms, "mat": mat, "struct": mat}
    return readers.get(form, hdf5), "" if form in ("mat", "npz") else "rec"


STORES = ("mat", "struct", "npz", "tdms", "hdf5", "compound")


@pytest.mark.parametrize("form", STORES)
@pytest.mark.parametrize(("name", "factor"), [("Time", 1.0), ("t", 1.0), ("Zeit_ms", 1e3), ("time", 1e3)])
def test_times_beside_a_channel_are_used_where_the_file_states_no_rate(
    tmp_path: Path, form: str, name: str, factor: float
):
    later = TIME + np.where(np.arange(400) < 150, 0.0, 0.02)
    reader, group = store(tmp_path / "log", form, {"torque": TORQUE, "p": 0.0 * TORQUE, name: factor * later})
    # a pause and a declared rate that is 2 % off passed in silence
    specs = (spec(tmp_path / "log", group, "torque", rate=1.02 * RATE),)
    raw = reader.read(tmp_path / "log", specs, "")
    assert_torque(raw)
    assert raw.channels[0].breaks == (150,)
    assert [finding.code for finding in raw.findings] == ["time_gap", "rate_differs"]
    assert reader.read(tmp_path / "log", (replace(specs[0], time_channel=name),), "").channels[0].breaks == (150,)


@pytest.mark.parametrize("form", STORES)
def test_what_is_no_clock_or_a_channel_of_the_recording_is_no_time(tmp_path: Path, form: str):
    warm = 20.0 + np.random.default_rng(0).normal(0.0, 0.1, 400) + TIME
    reader, group = store(tmp_path / "log", form, {"torque": TORQUE, "T": warm, "x": TIME})
    specs = tuple(spec(tmp_path / "log", group, name, rate=1.1 * RATE) for name in ("torque", "x"))
    assert [channel.sample_rate for channel in reader.read(tmp_path / "log", specs, "").channels] == [1.1 * RATE] * 2


@pytest.mark.parametrize("form", ["v5", "v5 struct", "v5 rows", "v7.3", "hdf5"])
def test_a_matrix_is_a_table_of_its_columns(tmp_path: Path, form: str):
    file, matrix, group = tmp_path / "run.mat", np.column_stack([TIME, TORQUE]), "Data"
    module = mat if form.startswith("v") else hdf5
    if form.startswith("v5"):
        matrix = matrix.T if form == "v5 rows" else matrix
        group = "rec.Data" if form == "v5 struct" else group
        savemat(file, {"rec": {"Data": matrix}} if form == "v5 struct" else {"Data": matrix})
    else:
        with h5py.File(file, "w") as store:
            store.create_dataset("Data", data=matrix.T if form == "v7.3" else matrix)
    listed = [(c.group, c.name, c.time_channel, c.sample_rate) for c in module.channels(file)]
    assert listed == [(group, "column 2", "column 1", pytest.approx(RATE))]
    assert_torque(module.read(file, (spec(file, group, "column 2", "column 1"),), ""))
    outer, _, last = group.rpartition(".")
    with pytest.raises(Refusal, match=rf"group = '{group}', channel = 'column 1'"):
        module.read(file, (spec(file, outer, last, ""),), "")
    with pytest.raises(Refusal, match="column 3"):
        module.read(file, (spec(file, group, "column 3", ""),), "")


@pytest.mark.parametrize("mark", ["_FillValue", "missing_value"])
@pytest.mark.parametrize("kind", ["f4", ">i2"])
def test_values_that_stand_for_missing_samples_are_missing(tmp_path: Path, mark: str, kind: str):
    file, stored = tmp_path / "run.nc", np.round(100.0 * TORQUE)
    stored[100:110] = -9999
    with h5py.File(file, "w") as store:
        data = store.create_dataset("torque", data=stored.astype(kind))
        data.attrs["scale_factor"], data.attrs["rate_hz"], data.attrs[mark] = 0.01, RATE, np.array([-9999], kind)
    values = hdf5.read(file, (spec(file, "", "torque"),), "").channels[0].source.read(0, 400)
    assert np.flatnonzero(np.isnan(values)).tolist() == list(range(100, 110))
    np.testing.assert_allclose(np.delete(values, range(100, 110)), np.delete(TORQUE, range(100, 110)), atol=0.006)


def test_columns_of_a_matrix_are_named_by_its_attribute(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        data = store.create_dataset("acq/data", data=np.column_stack([TIME, TORQUE]), chunks=(100, 2), compression=3)
        data.attrs["columns"] = ["time", "Torque"]
    assert [(c.group, c.name, c.sample_rate) for c in hdf5.channels(file)] == [
        ("acq/data", "Torque", pytest.approx(RATE))
    ]
    for name in ("Torque", "column 2"):
        assert_torque(hdf5.read(file, (spec(file, "acq/data", name, "time"),), ""))
    with pytest.raises(
        Refusal, match=r"'acq/data' has no column 'torqu', did you mean 'Torque'\?; there are time, Tor"
    ):
        hdf5.read(file, (spec(file, "acq/data", "torqu", "time"),), "")


def test_an_image_is_no_table(tmp_path: Path):
    with h5py.File(tmp_path / "run.h5", "w") as store:
        store.create_dataset("map", data=np.zeros((200, 300)))
    with pytest.raises(Refusal, match=r"map \(200, 300\); store each channel as a data set of its own, a field"):
        hdf5.channels(tmp_path / "run.h5")
    savemat(tmp_path / "run.mat", {"map": np.zeros((200, 300))})
    with pytest.raises(Refusal, match=r"map \(200, 300\); store each channel as a variable or as a column"):
        mat.channels(tmp_path / "run.mat")


def test_true_and_false_are_levels(tmp_path: Path):
    with h5py.File(tmp_path / "run.h5", "w") as store:
        store.create_dataset("prox", data=TORQUE > 0.0)
    (found,) = hdf5.channels(tmp_path / "run.h5")
    np.testing.assert_array_equal(found.source.read(0, 400), TORQUE > 0.0)
    pyarrow, store = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = pyarrow.table({"timestamp": 1.7e12 + 1e3 * TIME, "prox": TORQUE > 0.0})
    store.write_table(table, tmp_path / "run.parquet")
    (found,) = parquet.channels(tmp_path / "run.parquet")
    np.testing.assert_array_equal(found.source.read(0, 400), TORQUE > 0.0)
    # milliseconds since 1970 by their size
    assert found.sample_rate == pytest.approx(RATE, rel=1e-6)


@pytest.mark.parametrize("feather", [False, True])
def test_words_for_levels_are_read_from_texts_and_categories_as_from_a_csv(tmp_path: Path, feather: bool):
    pyarrow, store = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    arrow, on = pytest.importorskip("pyarrow.feather"), TORQUE > 0.0
    words = pyarrow.array(np.where(on, "ON", "off"))
    gaps = pyarrow.array([None if n == 5 else " High" if one else "low" for n, one in enumerate(on)])
    columns = {
        "t": TIME,
        "prox": words.dictionary_encode(),
        "text": words,
        "gaps": gaps,
        "note": pyarrow.array(["a"] * 400),
    }
    table, file = pyarrow.table(columns), tmp_path / "run.parquet"
    arrow.write_feather(table, file, chunksize=150) if feather else store.write_table(table, file, row_group_size=150)
    found = {channel.name: channel.source.read(0, 400) for channel in parquet.channels(file)}
    assert list(found) == ["prox", "text", "gaps"]
    np.testing.assert_array_equal(found["prox"], on)
    np.testing.assert_array_equal(found["text"], on)
    np.testing.assert_array_equal(found["gaps"], np.where(np.arange(400) == 5, np.nan, on))
    read = parquet.read(file, (spec(file, "", "prox", "t"),), "")
    np.testing.assert_array_equal(read.channels[0].source.read(0, 400), on)
    with pytest.raises(
        Refusal, match=r"'note' holds string, expected numbers or a level in the first row \(true, .*map"
    ):
        parquet.read(file, (spec(file, "", "note", "t"),), "")


def test_an_archive_of_numpy(tmp_path: Path):
    file = tmp_path / "run.npz"
    np.savez(file, torque_Nm=TORQUE.astype("f4"), t=TIME, fs=RATE, log=np.column_stack([TORQUE, TIME]))
    assert file_format(file, "") == "numpy"
    listed = {(c.group, c.name): c.sample_rate for c in numpy_file.channels(file)}
    assert listed == {("", "torque_Nm"): RATE, ("log", "column 1"): RATE, ("log", "column 2"): RATE}
    for place in (("", "torque_Nm", "t"), ("", "torque_Nm", ""), ("log", "column 1", "")):
        np.testing.assert_allclose(
            numpy_file.read(file, (spec(file, *place),), "").channels[0].source.read(0, 400), TORQUE, atol=1e-5
        )
    with pytest.raises(Refusal, match="no variable 'torqe_Nm', did you mean 'torque_Nm'"):
        numpy_file.read(file, (spec(file, "", "torqe_Nm", ""),), "")


def test_one_array_of_numpy_by_fields_columns_or_alone(tmp_path: Path):
    file, table = tmp_path / "run.npy", np.zeros(400, dtype=[("date", "M8[us]"), ("torque", "f8")])
    table["date"], table["torque"] = np.datetime64("2024-03-12") + (1e6 * TIME).astype("m8[us]"), TORQUE
    np.save(file, table)
    assert_torque(numpy_file.read(file, (spec(file, "", "torque", "date"),), ""))
    for array in (np.column_stack([TORQUE, TIME]), np.stack([TORQUE, TIME]), TORQUE):
        np.save(file, array)
        assert_torque(numpy_file.read(file, (spec(file, "", "column 1", ""),), ""))
    np.save(file, np.array(["a", "b"]))
    with pytest.raises(Refusal, match="holds no array of one number per sample; column 1"):
        numpy_file.channels(file)


def test_what_numpy_declares_is_held_against_what_it_holds(tmp_path: Path):
    file = tmp_path / "run.npy"
    np.save(file, TORQUE)
    data = file.read_bytes()
    file.write_bytes(data.replace(b"(400,)", b"(409,)"))
    with pytest.raises(Refusal, match=r"declares 3272 bytes of numbers and holds 3200: the file is cut or damaged"):
        numpy_file.channels(file)
    np.save(file, np.array([{}]), allow_pickle=True)
    with pytest.raises(Refusal, match=r"the array holds Python objects, expected numbers; save it as numbers"):
        numpy_file.channels(file)


def matlab_73(file: Path) -> None:
    with h5py.File(file, "w") as store:
        data = store.create_dataset("TT", data=np.arange(6, dtype="u4").reshape(1, 6))
        data.attrs["MATLAB_object_decode"] = np.int32(3)
        store.create_group("#refs#").create_dataset("b", data=TORQUE)


def test_a_timetable_is_refused_with_what_to_do(tmp_path: Path):
    matlab_73(tmp_path / "run.mat")
    line = r"T = timetable2table\(TT\); .* s = table2struct\(T, .*; a timeseries: t = TS.Time; torque ="
    with pytest.raises(Refusal, match=rf"TT is a MATLAB object .*{line}"):
        mat.channels(tmp_path / "run.mat")
    for group, name in (("", "TT"), ("TT", "Torque")):
        with pytest.raises(Refusal, match=rf"TT is a MATLAB object .*{line}"):
            mat.read(tmp_path / "run.mat", (spec(tmp_path / "run.mat", group, name, ""),), "")


def test_an_object_of_an_older_file_is_refused_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file = tmp_path / "run.mat"
    savemat(file, {"fs": RATE})
    monkeypatch.setattr(mat, "whosmat", lambda path: [("fs", (1, 1), "double"), ("None", (1,), "opaque")])
    for ask in (lambda: mat.channels(file), lambda: mat.read(file, (spec(file, "", "TT", ""),), "")):
        with pytest.raises(Refusal, match=r"a variable is a MATLAB object \(a table, timetable or timeseries\)"):
            ask()


def test_attributes_are_found_however_they_are_spelled(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        group = store.create_group("M1")
        group.attrs["Sampling Frequency"] = RATE
        group.create_dataset("Torque", data=TORQUE).attrs["Units"] = "Nm"
    assert [(c.name, c.unit, c.sample_rate) for c in hdf5.channels(file)] == [("Torque", "Nm", RATE)]


def test_a_step_of_no_time_is_refused_by_its_name(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        store.create_dataset("Torque", data=TORQUE).attrs["dt"] = 0.0
    assert [c.sample_rate for c in hdf5.channels(file)] == [None]
    with pytest.raises(Refusal, match=r"Torque: the sampling rate in the file is inf Hz, .* states rate or step"):
        hdf5.read(file, (spec(file, "", "Torque"),), "")


def test_a_compound_data_set_is_a_table(tmp_path: Path):
    file, rows = tmp_path / "run.h5", np.zeros(400, dtype=[("time_ms", "f8"), ("torque_Nm", "f8"), ("note", "S3")])
    rows["time_ms"], rows["torque_Nm"] = 1e3 * TIME, TORQUE
    with h5py.File(file, "w") as store:
        store.create_dataset("log", data=rows)
    assert [(c.group, c.name, c.sample_rate) for c in hdf5.channels(file)] == [
        ("log", "torque_Nm", pytest.approx(RATE))
    ]
    assert_torque(hdf5.read(file, (spec(file, "log", "torque_Nm", "time_ms"),), ""))


def test_a_scale_by_convention_is_applied_another_refused(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as store:
        for name in ("cf", "own"):
            store.create_dataset(name, data=np.round((TORQUE - 3.0) / 0.01).astype("i2"))
        store["cf"].attrs.update({"scale_factor": 0.01, "add_offset": 3.0})
        store["own"].attrs["scale"] = 0.01
        store.create_dataset("counts", data=store["own"][:]).attrs["Gain"] = 0.9
        store.create_dataset("amplified", data=TORQUE).attrs["Gain"] = 100.0
        store.create_dataset("float", data=TORQUE).attrs["scale"] = 0.01
    assert_torque(hdf5.read(file, (spec(file, "", "cf"),), ""), atol=0.0051)
    with pytest.raises(Refusal, match=r"holds int16 and the attribute scale = 0.01, which is not applied"):
        hdf5.read(file, (spec(file, "", "own"),), "")
    with pytest.raises(Refusal, match=r"holds int16 and the attribute Gain = 0.9, which is not applied"):
        hdf5.read(file, (spec(file, "", "counts"),), "")
    assert [f.code for f in hdf5.read(file, (spec(file, "", "float"),), "").findings] == ["scale_not_applied"]
    assert not hdf5.read(file, (spec(file, "", "amplified"),), "").findings, "it is the amplifier's"


def test_whole_numbers_of_a_tdms_with_a_gain_that_nobody_applies_are_refused(tmp_path: Path):
    """912 bar had been read as 1013, and called explained."""
    file = tmp_path / "run.tdms"
    with TdmsWriter(file) as writer:
        counts = np.round(TORQUE / 0.01).astype("i2")
        writer.write_segment([ChannelObject("log", "P", counts, {"Gain": 0.9, "wf_increment": 5e-5}),
                              ChannelObject("log", "Q", counts, {"Gain": 1.0, "wf_increment": 5e-5})])  # fmt: skip
    with pytest.raises(Refusal, match=r"channel 'P' holds int16 and the property Gain = 0.9, which is not applied"):
        tdms.read(file, (spec(file, "log", "P"),), "")
    assert tdms.read(file, (spec(file, "log", "Q"),), "").channels[0].source.n_samples == TORQUE.size


def test_a_pandas_index_of_durations_is_the_time(tmp_path: Path):
    pyarrow = pytest.importorskip("pyarrow")
    steps = pyarrow.array(np.round(1e9 * TIME).astype("timedelta64[ns]"))
    file = tmp_path / "run.parquet"
    pytest.importorskip("pyarrow.parquet").write_table(
        pyarrow.table([pyarrow.array(TORQUE), steps], ["M", "span"]), file
    )
    with pytest.raises(Refusal, match="no column 'torque'"):
        parquet.read(file, (spec(file, "", "torque"),), "")
    file.unlink()
    pytest.importorskip("pyarrow.parquet").write_table(
        pyarrow.table([steps, pyarrow.array(TORQUE)], ["span", "M"]), file
    )
    assert [(c.name, c.sample_rate) for c in parquet.channels(file)] == [("M", pytest.approx(RATE))]
    assert_torque(parquet.read(file, (spec(file, "", "M"),), ""))


def pages(folder: Path) -> tuple[Path, object, int]:
    """Write a Parquet file of one column; return it, its footer and where its only data page begins."""
    pyarrow, store = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    file = folder / "run.parquet"
    lists = pyarrow.array([[1, 2]] * 400)
    store.write_table(pyarrow.table({"torque": TORQUE, "lists": lists}), file, compression="none", use_dictionary=False)
    footer = store.ParquetFile(file).metadata
    return file, footer, footer.row_group(0).column(0).data_page_offset


def patch(file: Path, start: int, old: int, new: int) -> None:
    """Replace the first number of a page header (zigzag, seven bits a byte) by another of the same length."""
    written = [bytes([0x15, *_varint(2 * value)]) for value in (old, new)]
    data = file.read_bytes()
    at = data.index(written[0], start)
    assert at < start + 30
    assert len(written[0]) == len(written[1])
    file.write_bytes(data[:at] + written[1] + data[at + len(written[1]) :])


def _varint(value: int) -> list[int]:
    return [value & 127 | 128, *_varint(value >> 7)] if value > 127 else [value]


def test_pages_of_a_parquet_file_are_held_against_its_footer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    file, footer, start = pages(tmp_path)
    refuse_lying_pages(file, footer)
    patch(file, start, 400, 399)
    with pytest.raises(Refusal, match="the footer states 400 rows, the pages of column torque 399"):
        refuse_lying_pages(file, footer)
    file, footer, start = pages(tmp_path)
    size = TORQUE.nbytes
    unpacked = next(
        size + more for more in range(64) if bytes([0x15, *_varint(2 * (size + more))]) in file.read_bytes()
    )
    patch(file, start, unpacked, 8191)
    monkeypatch.setattr("camtorque.ingest.raw.ALWAYS_UNPACKED", 8000)
    monkeypatch.setattr("camtorque.ingest.raw.BEST_PACKING", 0.5)
    with pytest.raises(Refusal, match=r"column torque unpacks to 0 MB or more from"):
        refuse_lying_pages(file, footer)
    data = file.read_bytes()
    file.write_bytes(data[:start] + bytes(40) + data[start + 40 :])
    with pytest.raises(Refusal, match=f"the page at byte {start} has no header"):
        refuse_lying_pages(file, footer)


@pytest.mark.parametrize(
    ("head", "name"),
    [(b"\xd0\xcf\x11\xe0", r"Excel 97 \(\.xls\)"), (b"|CF,2,1,1;", "imc FAMOS"), (b"\x1f\x8b\x08", "gzip"),
     (b"PK\x03\x04" + bytes(22) + b"\x07\x00\x00\x00log.csv", "a zip archive"),
     (b"RIFF\0\0\0\0WAVE", "WAV")],
)  # fmt: skip
def test_a_format_that_is_known_and_not_read_is_named(tmp_path: Path, head: bytes, name: str):
    file = tmp_path / "run.dat"
    file.write_bytes(head + bytes(64))
    ask = "unpack it" if name in ("gzip", "a zip archive") else "export the log as one of them"
    with pytest.raises(Refusal, match=f"the content is {name}; expected one of TDMS.*: {ask}$"):
        file_format(file, "")


@pytest.mark.parametrize("head", [b"version https://git-lfs.github.com/spec/v1\noid", b"/annex/objects/SHA256E-s20--1"])
@pytest.mark.parametrize("declared", ["", "tdms", "csv"])
def test_a_pointer_in_the_place_of_a_log_is_named(tmp_path: Path, head: bytes, declared: str):
    file = tmp_path / "run.tdms"
    file.write_bytes(head)
    with pytest.raises(
        Refusal, match="found a pointer of Git, expected the log that it stands for; get it by `git lfs"
    ):
        file_format(file, declared)


def test_a_packed_small_table_is_named_as_that(tmp_path: Path):
    file = tmp_path / "cam.csv"
    file.write_bytes(gzip.compress(b"cam_angle_deg,lift_mm\n0,0\n1,0\n"))
    with pytest.raises(Refusal, match="the content is gzip, expected a lift table as text or a workbook: unpack it"):
        read_small_table(file, "a lift table")


def test_a_tdms_channel_needs_its_group_only_where_others_have_its_name(tmp_path: Path):
    file, other = tmp_path / "run.tdms", {"wf_increment": 1.0 / RATE}
    with TdmsWriter(file) as writer:
        rows = [("A", "torque", TORQUE), ("A", "p", TORQUE), ("B", "p", TORQUE)]
        writer.write_segment([ChannelObject(group, name, values, other) for group, name, values in rows])
    assert_torque(tdms.read(file, (spec(file, "", "torque"),), ""))
    with pytest.raises(Refusal, match="'p' is in the groups A, B; name one as group"):
        tdms.read(file, (spec(file, "", "p"),), "")
    with pytest.raises(Refusal, match=r"no channel 'Torque' in any group, did you mean 'torque'.; there are A/torque"):
        tdms.read(file, (spec(file, "", "Torque"),), "")


def test_numbers_that_a_database_exports_are_numbers(tmp_path: Path):
    arrow, store = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    texts = [f"{value:.3f}" for value in TORQUE]
    decimals = arrow.array([Decimal(text) for text in texts])
    file = tmp_path / "run.parquet"
    store.write_table(arrow.table({"text": texts, "decimal": decimals}), file)
    found = {channel.name: channel.source.read(0, len(texts)) for channel in parquet.channels(file)}
    assert list(found) == ["text", "decimal"]
    for values in found.values():
        np.testing.assert_allclose(values, np.array(texts, dtype=float), rtol=4e-16)  # pyarrow rounds decimals so


def test_a_parquet_file_without_a_number_is_told_as_that(tmp_path: Path):
    arrow, store = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    file = tmp_path / "run.parquet"
    store.write_table(arrow.table({"note": ["ok"] * 9, "remark": ["-"] * 9}), file)
    with pytest.raises(Refusal, match="found no column of numbers, expected the samples of the channels; export them"):
        parquet.channels(file)


def test_a_parquet_column_of_texts_is_told_as_that(tmp_path: Path):
    arrow = pytest.importorskip("pyarrow")
    table = arrow.table({"torque": [f"{value:.3f}".replace(".", ",") for value in TORQUE], "p": TORQUE})
    for file, write in ((tmp_path / "run.parquet", arrow.parquet.write_table),
                        (tmp_path / "run.feather", arrow.feather.write_feather)):  # fmt: skip
        write(table, file)
        with pytest.raises(
            Refusal, match=r"column 'torque' holds string, expected numbers or a level in .*: convert them, in pandas"
        ):
            parquet.read(file, (spec(file, "", "torque"), spec(file, "", "p")), "")


@pytest.mark.parametrize("suffix", ["parquet", "feather"])
def test_columns_of_one_name_go_by_their_place(tmp_path: Path, suffix: str):
    arrow = pytest.importorskip("pyarrow")
    file = tmp_path / f"run.{suffix}"
    columns = [arrow.array(values) for values in (TIME, 2.0 * TORQUE, TORQUE)]
    table = arrow.table(columns, names=["time [s]", "M [Nm]", "M [Nm]"])
    if suffix == "parquet":
        pytest.importorskip("pyarrow.parquet").write_table(table, file)
    else:
        pytest.importorskip("pyarrow.feather").write_feather(table, file)
    assert [channel.name for channel in parquet.channels(file)] == ["column 2", "column 3"]
    assert_torque(parquet.read(file, (spec(file, "", "column 3"),), ""))


def test_every_data_set_of_a_large_file_is_listed(tmp_path: Path):
    file = tmp_path / "run.h5"
    with h5py.File(file, "w") as stream:
        stream["fs"] = RATE
        stream.create_group("sub").create_group("fs")
        stream["sub/p"] = TORQUE
        for number in range(1001):
            stream[f"a{number:04d}"] = TORQUE[:9]
        stream["torque"] = TORQUE
    listed = {channel.name: channel for channel in hdf5.channels(file)}
    assert len(listed) == 1003
    assert listed["torque"].sample_rate == RATE
    assert listed["p"].sample_rate is None


def test_numbers_stored_as_text_in_a_workbook_are_named(tmp_path: Path):
    book = pytest.importorskip("openpyxl").Workbook()
    for row in (
        ["Zeit [s]", "M [Nm]"],
        *[[f"{t:.5f}".replace(".", ","), f"{m:.2f}"] for t, m in zip(TIME, TORQUE, strict=True)],
    ):
        book.active.append(row)
    book.save(tmp_path / "run.xlsx")
    with pytest.raises(Refusal, match="its numbers are stored as text: convert them"):
        xlsx.channels(tmp_path / "run.xlsx")


def test_a_workbook_that_is_refused_is_closed(tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "log.xlsx", "w") as parts:
        parts.writestr("[Content_Types].xml", "no XML")
    with pytest.raises(Refusal, match="cannot be read as Excel workbook"):
        xlsx.sheet_names(tmp_path / "log.xlsx")
    gc.collect()  # what was left open is told here, as an error
    assert not [link for link in Path("/proc/self/fd").iterdir() if link.name.isdigit() and held(link, tmp_path)]


def held(link: Path, folder: Path) -> bool:
    try:
        return link.readlink().is_relative_to(folder)
    except FileNotFoundError:
        return False

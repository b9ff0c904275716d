"""Files that claim, or unpack to, more than they hold are refused before memory or minutes are spent on them."""

import contextlib
import resource
import struct
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from camtorque.ingest import read_recording
from camtorque.ingest.cam_table import read_cam_table
from camtorque.ingest.formats import FORMATS, file_format
from camtorque.records import Refusal
from damaged.build import MAT, PLANS
from damaged.logs import Plan, clean_log, write_folder, write_tdms


def folder_of(tmp_path: Path, plan: Plan) -> tuple[Path, Path]:
    folder = write_folder(tmp_path / "r", [clean_log(revolutions=3.0)], plan)
    return folder, next(path for path in folder.iterdir() if path.suffix != ".toml")


@pytest.fixture(autouse=True)
def little_memory():
    """Each refusal comes with less than 1 GB: numpy raises MemoryError beyond it, which is no refusal."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 2**30, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize(("chunks", "written"), [(None, 0), ((1000,), 0), ((1000,), 5000)])
def test_an_hdf5_that_claims_a_billion_samples(tmp_path: Path, chunks: tuple[int, ...] | None, written: int):
    folder, file = folder_of(tmp_path, PLANS["hdf5"])
    with h5py.File(file, "a") as data:
        del data["Main/Torque"]
        claimed = data["Main"].create_dataset("Torque", shape=(10**12,), dtype="f4", chunks=chunks)
        if written:
            claimed[:written] = 1.0
    with pytest.raises(Refusal, match=r"the file stores none of them|no measured signal does"):
        read_recording(folder)


def mat_element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def test_a_mat_of_zeros(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("camtorque.ingest.raw.ALWAYS_UNPACKED", 2**20)  # 256 times less, 256 times faster
    folder, file = folder_of(tmp_path, MAT)
    packer = zlib.compressobj(9)
    count = 1_000_000
    flags = mat_element(6, struct.pack("<II", 6, 0)) + mat_element(5, struct.pack("<ii", 1, count))
    head = flags + mat_element(1, b"Torque")
    body = struct.pack("<II", 14, len(head) + 8 + 8 * count) + head + struct.pack("<II", 9, 8 * count)
    packed = packer.compress(body + bytes(8 * count)) + packer.flush()
    file.write_bytes(file.read_bytes()[:128] + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(Refusal, match=r"unpacks to .* MB or more from .* MB, which no measured signal does"):
        read_recording(folder)


def test_a_workbook_that_unpacks_to_too_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("camtorque.ingest.raw.ALWAYS_UNPACKED", 2**20)
    folder, file = folder_of(tmp_path, PLANS["xlsx"])
    with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED) as book:
        book.writestr("xl/media/zeros", bytes(20 * 2**20))
    with pytest.raises(Refusal, match=r"unpacks to .* which no measured signal does"):
        read_recording(folder)


def test_a_workbook_that_claims_every_cell(tmp_path: Path):
    openpyxl = pytest.importorskip("openpyxl")
    folder, file = folder_of(tmp_path, PLANS["xlsx"])
    book = openpyxl.load_workbook(file)
    book.active["XFD1000"] = 1.0  # the last column there is
    book.save(file)
    assert read_recording(folder).of("torque")[0].n_samples > 0


def test_a_parquet_that_claims_more_rows_than_a_signal_packs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pyarrow = pytest.importorskip("pyarrow")
    monkeypatch.setattr("camtorque.ingest.raw.ALWAYS_UNPACKED", 2**20)
    folder, file = folder_of(tmp_path, PLANS["parquet"])
    zeros = pyarrow.array(np.zeros(500_000))
    pyarrow.parquet.write_table(pyarrow.table({"Time": zeros, "Torque": zeros}), file)
    with pytest.raises(Refusal, match=r"500000 rows unpacks to .* which no measured signal does"):
        read_recording(folder)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        (b"Linear_Input_Source", 0, "scale of 'Torque': cannot be read as TDMS"),  # points to itself
        (b"NI_Number_Of_Scales", 2**31, "states 2147483648 scales, expected at most 12"),
    ],
)
def test_a_tdms_whose_scales_cannot_be(tmp_path: Path, key: bytes, value: int, message: str):
    folder, file = folder_of(tmp_path, PLANS["tdms"])
    write_tdms(file, clean_log(revolutions=3.0), scaled=True)
    data = file.read_bytes()
    at = data.index(key) + len(key) + 4
    file.write_bytes(data[:at] + struct.pack("<I", value) + data[at + 4 :])
    with pytest.raises(Refusal, match=message):
        read_recording(folder)


def test_a_tdms_of_empty_segments(tmp_path: Path):
    folder, file = folder_of(tmp_path, PLANS["tdms"])
    empty = b"TDSm" + struct.pack("<iiQQ", 0, 4713, 0, 0)
    file.write_bytes(file.read_bytes() + 300_000 * empty)
    with pytest.raises(Refusal, match="more than 100000 segments"):
        read_recording(folder)


def test_an_mf4_whose_blocks_run_in_a_circle(tmp_path: Path):
    folder, file = folder_of(tmp_path, replace(PLANS["mf4"], writer_options={"compression": 0}))
    data = bytearray(file.read_bytes())
    at = data.index(b"##CN")
    data[at + 24 : at + 32] = struct.pack("<Q", at)
    file.write_bytes(data)
    with pytest.raises(Refusal, match="runs in a circle"):
        read_recording(folder)


def test_an_mf4_channel_outside_its_record(tmp_path: Path):
    folder, file = folder_of(tmp_path, replace(PLANS["mf4"], writer_options={"compression": 0}))
    data = bytearray(file.read_bytes())
    at = data.index(b"##CN", data.index(b"##CN") + 4)
    links = struct.unpack_from("<Q", data, at + 16)[0]
    struct.pack_into("<I", data, at + 24 + 8 * links + 4, 127)
    file.write_bytes(data)
    with pytest.raises(Refusal, match=r"takes .* bits from byte 127 of a record of"):
        read_recording(folder)


def test_an_hdf5_heap_that_never_ends(tmp_path: Path):
    folder, file = folder_of(tmp_path, PLANS["hdf5"])
    data = bytearray(file.read_bytes())
    heap = data.index(b"GCOL")
    struct.pack_into("<HHIQ", data, heap + 16, 0, 0, 0, 0)
    file.write_bytes(data)
    with pytest.raises(Refusal, match=r"the heap of texts at byte .* states an object of 0 bytes"):
        read_recording(folder)


def test_an_hdf5_whose_chunks_were_not_all_written(tmp_path: Path):
    folder, file = folder_of(tmp_path, PLANS["hdf5"])
    with h5py.File(file, "a") as stored:
        del stored["Main/Torque"]
        stored["Main"].create_dataset("Torque", shape=(3000,), dtype="f8", chunks=(1000,))[:1000] = 1.0
    with pytest.raises(Refusal, match="has 1 of its 3 blocks"):
        read_recording(folder)


def test_a_csv_with_an_endless_line(tmp_path: Path):
    folder, file = folder_of(tmp_path, PLANS["csv"])
    with file.open("ab") as stream:
        for _ in range(4):
            stream.write(b"1" * 8_000_000)
    with pytest.raises(Refusal, match="a line of more than 1048576 bytes begins with b'1111"):
        read_recording(folder)


def test_a_huge_lift_table(tmp_path: Path):
    pump = read_recording(folder_of(tmp_path, PLANS["hdf5"])[0]).config.pump
    file = tmp_path / "cam.csv"
    file.write_text("cam_angle_deg,lift_mm\n" + "".join(f"{0.00018 * n:.5f},1.0\n" for n in range(400_000)))
    with pytest.raises(Refusal, match="a lift table has at most"):
        read_cam_table(replace(pump, cam_table_path=file))


@pytest.mark.parametrize(
    ("comment", "message"),
    [("resolution 1.2.3 um", None), ("resolution 1e9999 um", "unknown unit"), ("resolution 1 furlong", "unknown unit")],
)
def test_odd_comments_of_a_lift_table(tmp_path: Path, comment: str, message: str | None):
    pump = read_recording(folder_of(tmp_path, PLANS["hdf5"])[0]).config.pump
    file = tmp_path / "cam.csv"
    angle = np.arange(0.0, 360.0, 5.0)
    rows = "".join(f"{a},{4 - 4 * np.cos(np.radians(a)):.4f}\n" for a in angle)
    file.write_text(f"# {comment}\ncam_angle_deg,lift_mm\n{rows}")
    if message is None:
        assert 0.0 < read_cam_table(replace(pump, cam_table_path=file))[0].resolution < 1.0
        return
    with pytest.raises(Refusal, match=message):
        read_cam_table(replace(pump, cam_table_path=file))


def test_content_decides_before_the_suffix(tmp_path: Path):
    folder, file = folder_of(tmp_path, PLANS["hdf5"])
    text = (folder / "recording.toml").read_text(encoding="utf-8")
    renamed = file.rename(file.with_suffix(".csv"))
    (folder / "recording.toml").write_text(
        text.replace(file.name, renamed.name).replace('file_format = "hdf5"\n', ""), encoding="utf-8"
    )
    assert FORMATS[file_format(renamed, "")].shown == "HDF5"
    assert read_recording(folder).of("torque")[0].n_samples > 0


@pytest.mark.parametrize("packing", ["zstd", "lz4"])
@pytest.mark.parametrize("batches", [1, 4])
def test_a_feather_that_unpacks_to_more_than_a_signal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packing: str, batches: int
):
    pyarrow = pytest.importorskip("pyarrow")
    feather = pytest.importorskip("pyarrow.feather")
    monkeypatch.setattr("camtorque.ingest.raw.ALWAYS_UNPACKED", 2**20)
    folder, file = folder_of(tmp_path, PLANS["parquet"])
    zeros = pyarrow.array(np.zeros(400_000))
    feather.write_feather(
        pyarrow.table({"Time": zeros, "Torque": zeros}), file, compression=packing, chunksize=400_000 // batches
    )
    with pytest.raises(Refusal, match=r"batch 1 unpacks to .* which no measured signal does|batch \d unpacks to"):
        read_recording(folder)


@pytest.mark.parametrize("packing", ["zstd", "lz4", "uncompressed"])
def test_a_feather_with_a_signal_is_read(tmp_path: Path, packing: str):
    pyarrow = pytest.importorskip("pyarrow")
    feather = pytest.importorskip("pyarrow.feather")
    folder, file = folder_of(tmp_path, PLANS["parquet"])
    expected = read_recording(folder).of("torque")[0].read_volts()
    feather.write_feather(pyarrow.parquet.read_table(file), file, compression=packing, chunksize=3000)
    np.testing.assert_array_equal(read_recording(folder).of("torque")[0].read_volts(), expected)


def test_a_feather_whose_header_is_torn_is_refused(tmp_path: Path):
    pyarrow = pytest.importorskip("pyarrow")
    feather = pytest.importorskip("pyarrow.feather")
    folder, file = folder_of(tmp_path, PLANS["parquet"])
    feather.write_feather(pyarrow.parquet.read_table(file), file, compression="lz4")
    data = bytearray(file.read_bytes())
    rng = np.random.default_rng(2)
    for _ in range(60):
        torn = bytearray(data)
        for place in rng.integers(8, 3000, 4):
            torn[place] = rng.integers(256)
        file.write_bytes(bytes(torn))
        with contextlib.suppress(Refusal):  # whatever else arises fails the test
            read_recording(folder)


def test_a_feather_with_more_missing_values_than_are_marked_is_refused(tmp_path: Path):
    """What marks missing values is not stored where none are missing: it had been read from memory beyond."""
    pyarrow = pytest.importorskip("pyarrow")
    feather = pytest.importorskip("pyarrow.feather")
    folder, file = folder_of(tmp_path, PLANS["parquet"])
    table = pyarrow.parquet.read_table(file)
    feather.write_feather(table, file, compression="lz4")
    node, data = struct.pack("<qq", table.num_rows, 0), file.read_bytes()
    place = data.rfind(node, 0, 3000)  # of the last column; the same stands once more at the end of the file
    assert place > 0
    file.write_bytes(data[: place + 8] + struct.pack("<q", 7) + data[place + 16 :])
    with pytest.raises(Refusal, match="cannot be read as Parquet or Feather, the file is damaged"):
        read_recording(folder)

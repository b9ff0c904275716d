"""catman binary (HBM), read from its published structure; nothing is asked on standard input.

Headers first, then one channel after the other without compression ("catman binary file format", file id 5010 on). The
headers state where the data begin and how many samples each channel has, so a cut file shows at once, and the samples
are read straight from the file. The tests hold this reader against apread.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Container
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.raw import FileChannel, FileSource, Piece, RawFile, refusing
from camtorque.ingest.stamps import EPOCHS
from camtorque.ingest.stored import Stored, among, listing_of, read_stored
from camtorque.records import Finding, Refusal
from camtorque.units import DAY, is_known_unit

EXTENDED = struct.Struct("<dd hhhh fff 4f 32s 8s 8s hhhh ff hhh bb f b3x f f b".replace(" ", ""))
EXPORT_BYTES = {0: 8, 1: 4, 2: 2}
RESERVED_STRINGS = 32
MAX_TEXT = 1 << 20
TIME_NAME = re.compile(r"time|zeit", re.IGNORECASE)
STEPS_16_BIT = 32767.0


@dataclass(frozen=True)
class CatmanChannel:
    """Header of one channel; ``time_step`` [s] is 0 where the file gives none, ``stamp`` counts from 1970 [s]."""

    name: str
    unit: str
    length: int
    width: int
    time_step: float
    stamp: float


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read channels of a catman binary file."""
    find = among(path, _stored(path))
    return read_stored(path, "catman binary", specs, lambda group, name: find("", name))  # the format has no groups


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the channels, rates as their headers or the time channel of their length say."""
    return listing_of(item for item in _stored(path) if item.source.n_samples and not TIME_NAME.search(item.name))


def _stored(path: Path) -> list[Stored]:
    """Return the channels, with the times that the only time channel of their length holds."""
    with refusing(path, "catman binary"):
        headers, sources = _layout(path)
    held, found = list(zip(headers, sources, strict=True)), []
    for header, source in held:
        mates = [(other, times) for other, times in held
                 if TIME_NAME.search(other.name) and other.length == header.length and other is not header]  # fmt: skip
        mate, times = mates[0] if len(mates) == 1 else (header, None)
        where, rate = f"{path.name} {header.name}", 1.0 / header.time_step if header.time_step > 0.0 else None
        text = "the file holds no times and no rate; the declared rate is used"
        found.append(Stored(
            "", header.name, _unit(header), source, rate, times=times, times_unit=_unit(mate),
            time_beside=partial(_refuse_choice, where, [other.name for other, _ in mates]) if mates else None,
            dates=((0, header.stamp),), if_untimed=(Finding("no_time_in_file", "info", text, where),),
        ))  # fmt: skip
    return found


def _unit(header: CatmanChannel) -> str:
    """Return the unit, but no unknown one of a time: its step tells it."""
    return header.unit if is_known_unit(header.unit) or not TIME_NAME.search(header.name) else ""


def _refuse_choice(where: str, mates: list[str], taken: Container[str]) -> str:
    shown = ", ".join(mates)
    raise Refusal(f"{where}: {len(mates)} channels may be its time ({shown}); name it with time_channel")


def _layout(path: Path) -> tuple[list[CatmanChannel], list[FileSource]]:
    """Return the channels and where their samples lie; the data have to end where the file does."""
    size = path.stat().st_size
    with path.open("rb") as file:
        _, data_offset = _take(file, "<hi")
        _text(file, path)
        for _ in range(RESERVED_STRINGS):
            _text(file, path)
        n_channels, _ = _take(file, "<hi")
        if not 0 < n_channels < 4096:
            raise Refusal(f"{path}: states {n_channels} channels; the header is damaged, export the file again")
        file.seek(4 * (n_channels + 1), 1)
        headers = [_channel(file, path) for _ in range(n_channels)]
        if not file.tell() <= data_offset <= size:
            raise Refusal(f"{path}: data should begin at byte {data_offset}, the headers end at {file.tell()} and "
                          f"the file at {size}: it is cut or damaged; export it again")  # fmt: skip
        sources, position = [], data_offset
        for header in headers:
            source, position = _source(file, path, header, position, size)
            sources.append(source)
    if position != size:
        raise Refusal(f"{path}: the headers state {position} bytes, the file has {size}: it is cut or damaged; "
                      "export it again")  # fmt: skip
    return headers, sources


def _take(file: BinaryIO, form: str) -> tuple:
    shape = struct.Struct(form)
    return shape.unpack(file.read(shape.size))


def _text(file: BinaryIO, path: Path, length_as: str = "<h") -> str:
    (length,) = _take(file, length_as)
    data = file.read(length) if 0 <= length <= MAX_TEXT else b""
    if len(data) != length:
        raise Refusal(f"{path}: a text of {length} bytes is stated at byte {file.tell()}: the header is cut or damaged")
    return data.decode("cp1252", errors="replace").strip()


def _channel(file: BinaryIO, path: Path) -> CatmanChannel:
    _, length = _take(file, "<hi")
    name, unit, _ = (_text(file, path) for _ in range(3))
    kind, _, _, n_extended = _take(file, "<hhdi")
    if kind != 0 or length < 0:
        raise Refusal(
            f"{path}: channel {name!r} is of kind {kind} with {length} samples, expected numbers; export it again"
        )
    after = file.tell() + n_extended
    if n_extended < EXTENDED.size:
        raise Refusal(
            f"{path}: channel {name!r} has an extended header of {n_extended} bytes, expected {EXTENDED.size}"
        )
    extended = EXTENDED.unpack(file.read(EXTENDED.size))
    file.seek(after)
    _, _, n_points = _take(file, "<bbb")
    file.seek(8 * n_points + 2, 1)
    _text(file, path)
    _text(file, path, "<i")
    export = extended[-1]
    if export not in EXPORT_BYTES:
        raise Refusal(f"{path}: channel {name!r} has the unknown number format {export}; export it as 8-byte numbers")
    stamp = extended[0] * DAY - EPOCHS["1900"]
    return CatmanChannel(name, unit, length, EXPORT_BYTES[export], 1e-3 * extended[1], stamp)


def _source(file: BinaryIO, path: Path, header: CatmanChannel, position: int, size: int) -> tuple[FileSource, int]:
    end = position + header.length * header.width + (16 if header.width == 2 and header.length else 0)
    if end > size:
        raise Refusal(
            f"{path}: channel {header.name!r} of {header.length} samples ends at byte {end}, the file has {size}: it "
            "is cut; export it again"
        )
    scale = None
    if header.width == 2 and header.length:
        file.seek(position)
        low, high = _take(file, "<dd")
        position += 16
        step = (high - low) / STEPS_16_BIT

        def scale(raw: np.ndarray) -> np.ndarray:
            return low + step * raw

    kind = np.dtype("<u2" if header.width == 2 else f"<f{header.width}")
    return FileSource(path, (Piece(0, header.length, position, kind, kind.itemsize),), scale), end

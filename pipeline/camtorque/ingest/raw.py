"""What every reader hands back, the sources of samples that the readers share, limits and checksums of unpacking."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from camtorque.config import ChannelSpec
from camtorque.records import Array, Finding, Refusal, SampleSource
from camtorque.units import is_known_unit, tidy_unit

IN_MEMORY_BYTES = 64 * 2**20
"""Decoded data of one file up to this size are kept in memory; beyond it they are read in pieces from disk."""
PIECE = 1 << 20
ALWAYS_UNPACKED = 256 * 2**20
"""Data up to this size are unpacked however well they are packed [bytes]."""
BEST_PACKING = 50
"""Measured signals pack ten to one at best; what claims more beyond `ALWAYS_UNPACKED` is a bomb."""
SUPPLY = "supply"
"""Quantity of the supply of a bridge, which is recorded beside it in a unit that recording.toml does not state."""


@dataclass(frozen=True)
class RawChannel:
    """One channel of a file before calibration.

    Attributes
    ----------
    unit : as the file says, "" where it says nothing
    source : raw samples in that unit
    start_time : time of sample 0 [s], as the file says
    sample_rate : [Hz]
    stamp : date and time of ``start_time = 0`` in seconds since 1970, None where the file holds none
    breaks, break_steps : see `camtorque.records.Channel`
    """

    name: str
    unit: str
    source: SampleSource
    start_time: float
    sample_rate: float
    stamp: float | None = None
    breaks: tuple[int, ...] = ()
    break_steps: tuple[float, ...] = ()


@dataclass(frozen=True)
class RawFile:
    """The channels that were asked for, in that order, and what is wrong with the file."""

    channels: tuple[RawChannel, ...]
    findings: tuple[Finding, ...] = ()


def refuse_other_unit(spec: ChannelSpec, unit: str) -> None:
    """Refuse a channel whose file states another unit than recording.toml."""
    known = unit.strip("-") and is_known_unit(unit) and spec.quantity != SUPPLY
    if known and tidy_unit(unit) != tidy_unit(spec.unit):
        raise Refusal(
            f"{spec.path} {spec.channel!r}: the file's unit is {unit!r}, recording.toml says {spec.unit!r}; "
            "correct the one that is wrong"
        )


def missing_samples(found: int, declared: float, where: str) -> tuple[Finding, ...]:
    """Return the finding of a file that holds fewer samples than it declares."""
    if found >= declared:
        return ()
    return (Finding("samples_missing", "error", f"{found} of {declared:.0f} declared samples are there", where),)


@dataclass(frozen=True)
class FileChannel:
    """A channel that a file holds, as `camtorque new` lists it.

    Attributes
    ----------
    group, name, unit : as the file says, "" where it says nothing
    sample_rate : [Hz], None where the file does not tell
    time_channel : the channel that holds its times, "" where the format or its name tells
    source : raw samples
    """

    group: str
    name: str
    unit: str
    n_samples: int
    sample_rate: float | None
    time_channel: str
    source: SampleSource


@contextmanager
def refusing(path: Path, kind: str, where: str = "") -> Iterator[None]:
    """Turn whatever a reader library raises into a refusal of one line."""
    try:
        yield
    except (Refusal, MemoryError):
        raise
    except Exception as error:
        place = f" {where}" if where else ""
        said = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise Refusal(
            f"{path}{place}: cannot be read as {kind}, the file is damaged or of another kind ({said}); export it anew"
        ) from error


@dataclass(frozen=True)
class ArraySource:
    """Samples in memory."""

    values: NDArray[np.generic]

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return int(self.values.size)

    def read(self, start: int, stop: int) -> Array:
        """Return raw samples ``[start, stop)``."""
        return np.asarray(self.values[start:stop], dtype=np.float64)


@dataclass(frozen=True)
class EveryNth:
    """One in so many samples of a source."""

    source: SampleSource
    first: int
    every: int

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return -(-(self.source.n_samples - self.first) // self.every)

    def read(self, start: int, stop: int) -> Array:
        """Return raw samples ``[start, stop)``."""
        start, stop, _ = slice(start, stop).indices(self.n_samples)
        low = self.first + start * self.every
        return self.source.read(low, low + max(stop - start, 0) * self.every)[:: self.every]


@dataclass(frozen=True)
class PairSource:
    """Samples computed from those of two sources of one time base: times and their fractions, a bridge's supply."""

    first: SampleSource
    second: SampleSource
    combine: Callable[[Array, Array], Array]

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.first.n_samples

    def read(self, start: int, stop: int) -> Array:
        """Return raw samples ``[start, stop)``."""
        return self.combine(self.first.read(start, stop), self.second.read(start, stop))


@dataclass(frozen=True)
class CallSource:
    """Samples that a library reads in pieces; its exceptions come out as refusals."""

    n_samples: int
    call: Callable[[int, int], NDArray[np.generic]]
    path: Path
    kind: str

    def read(self, start: int, stop: int) -> Array:
        """Return raw samples ``[start, stop)``."""
        start, stop, _ = slice(start, stop).indices(self.n_samples)
        with refusing(self.path, self.kind, f"samples {start} to {stop}"):
            values = np.asarray(self.call(start, stop), dtype=np.float64)
        if values.size != max(stop - start, 0):
            raise Refusal(f"{self.path}: holds {values.size} of the samples {start} to {stop}: the file is cut short")
        return values


@dataclass(frozen=True)
class Piece:
    """A run of samples at equal distances in a file: ``stride`` bytes from one to the next."""

    first: int
    n_samples: int
    offset: int
    dtype: np.dtype
    stride: int


@dataclass(frozen=True)
class FileSource:
    """Samples that lie uncompressed in a file, read without a library at the speed of the disk."""

    path: Path
    pieces: tuple[Piece, ...]
    scale: Callable[[NDArray[np.generic]], NDArray[np.generic]] | None = None

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.pieces[-1].first + self.pieces[-1].n_samples if self.pieces else 0

    def read(self, start: int, stop: int) -> Array:
        """Return raw samples ``[start, stop)``."""
        start, stop, _ = slice(start, stop).indices(self.n_samples)
        values = np.empty(max(stop - start, 0))
        firsts = [piece.first for piece in self.pieces]
        with self.path.open("rb", buffering=0) as file:
            number = max(int(np.searchsorted(firsts, start, side="right")) - 1, 0)
            while number < len(self.pieces) and firsts[number] < stop:
                piece = self.pieces[number]
                low, high = max(start, piece.first), min(stop, piece.first + piece.n_samples)
                self._fill(file, piece, low - piece.first, values[low - start : high - start])
                number += 1
        return values

    def _fill(self, file: BinaryIO, piece: Piece, skip: int, out: Array) -> None:
        file.seek(piece.offset + skip * piece.stride)
        native = np.dtype(np.float64)
        if piece.dtype == native and piece.stride == native.itemsize and self.scale is None:
            read_into(file, out, self.path)
            return
        raw = np.empty(out.size * piece.stride, dtype=np.uint8)
        # the last row of an interleaved file may end before its stride does
        read_into(file, raw[: raw.size - piece.stride + piece.dtype.itemsize], self.path)
        column = raw.reshape(out.size, piece.stride)[:, : piece.dtype.itemsize]
        samples = np.ascontiguousarray(column).view(piece.dtype).ravel()
        out[:] = samples if self.scale is None else self.scale(samples)


def read_into(file: BinaryIO, out: np.ndarray, path: Path) -> None:
    """Fill ``out`` from a file, or refuse where the file ends before it is full."""
    view = memoryview(out.view(np.uint8))  # type: ignore[arg-type]
    filled = 0
    while filled < len(view):
        count = file.readinto(view[filled:])  # type: ignore[attr-defined]
        if not count:
            raise Refusal(f"{path}: ends {len(view) - filled} bytes before its data do: the file is cut short")
        filled += count


def refuse_bomb(unpacked: int, packed: int, where: str) -> None:
    """Refuse data that would unpack to a size that no measured signal packs from."""
    if unpacked > max(ALWAYS_UNPACKED, BEST_PACKING * packed):
        raise Refusal(
            f"{where} unpacks to {unpacked / 2**20:.0f} MB or more from {packed / 2**20:.3g} MB, which no measured "
            "signal does; export the log again"
        )


def checked_size(file: BinaryIO, packed: int, where: str) -> int:
    """Return the unpacked size of the next ``packed`` bytes; a stream that fails its checksum or is cut is refused."""
    unpacker, total, left = zlib.decompressobj(), 0, packed
    try:
        while left > 0:
            piece = file.read(min(left, PIECE))
            if not piece:
                break
            left -= len(piece)
            data = unpacker.decompress(piece, PIECE)
            while data or unpacker.unconsumed_tail:
                total += len(data)
                refuse_bomb(total, packed, where)
                data = unpacker.decompress(unpacker.unconsumed_tail, PIECE)
        total += len(unpacker.flush())
    except zlib.error as error:
        raise Refusal(f"{where} fails its checksum ({error}): the file is damaged; copy it again") from error
    if not unpacker.eof:
        raise Refusal(f"{where} ends before its data do: the file is damaged; copy it again")
    return total

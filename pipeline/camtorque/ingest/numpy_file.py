"""NumPy files: an archive (.npz) of named arrays, or one array (.npy) whose columns or fields are channels.

What a channel is: `variables`. Arrays of Python objects are never loaded: they are programs.
"""

from __future__ import annotations

import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.lib import format as npy

from camtorque.config import ChannelSpec
from camtorque.ingest.header import numbered_name
from camtorque.ingest.raw import FileChannel, RawFile, refuse_bomb, refusing
from camtorque.ingest.variables import listed, read_variables
from camtorque.records import Refusal


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read arrays of a NumPy file."""
    arrays = _arrays(path)
    return read_variables(path, "NumPy", arrays, tuple(arrays), specs)


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the arrays, fields and columns that hold one number per sample."""
    arrays = _arrays(path)
    found = listed(arrays)
    if not found:
        shown = ", ".join(f"{name} {array.dtype} {array.shape}" for name, array in list(arrays.items())[:5])
        raise Refusal(f"{path}: holds no array of one number per sample; {shown or 'it is empty'}")
    return found


def _arrays(path: Path) -> dict[str, Any]:
    """Return the arrays by name; an array of its own gives its columns ("column 1") or fields their names."""
    with refusing(path, "NumPy"):
        if zipfile.is_zipfile(path):
            return {name: part for key, array in _archive(path).items() for name, part in _fields(key, array).items()}
        with path.open("rb") as file:
            _check_size(path, "the array", file, path.stat().st_size)
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    return _fields("", array[:, None] if array.ndim == 1 and not array.dtype.names else array)


def _archive(path: Path) -> dict[str, np.ndarray]:
    with zipfile.ZipFile(path) as parts:
        refuse_bomb(sum(part.file_size for part in parts.infolist()), path.stat().st_size, f"{path}")
        for part in parts.infolist():
            with parts.open(part) as file:
                _check_size(path, part.filename, cast(BinaryIO, file), part.file_size)
    with closing(np.load(path, allow_pickle=False)) as archive:
        return {name: archive[name] for name in archive.files}


def _check_size(path: Path, name: str, file: BinaryIO, size: int) -> None:
    """Refuse an array that declares more values than are stored, before there is room made for them."""
    read_header = npy.read_array_header_1_0 if npy.read_magic(file) == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read_header(file)
    if dtype.hasobject:
        raise Refusal(f"{path}: {name} holds Python objects, expected numbers; save it as numbers: array.astype(float)")
    declared, stored = int(np.prod([float(n) for n in shape])) * dtype.itemsize, size - file.tell()
    if declared != stored:
        raise Refusal(
            f"{path}: {name} declares {declared} bytes of numbers and holds {stored}: the file is cut or damaged; "
            "save it again"
        )


def _fields(name: str, array: np.ndarray) -> dict[str, Any]:
    """Return an array, its fields where it is a table, or its columns where it has no name."""
    array = _with_seconds(array)
    if array.dtype.names:
        return {field: _with_seconds(array[field]) for field in array.dtype.names}
    if name or array.ndim != 2:
        return {name: array}
    columns = array if array.shape[0] >= array.shape[1] else array.T
    return {numbered_name(number): columns[:, number] for number in range(columns.shape[1])}


def _with_seconds(array: np.ndarray) -> np.ndarray:
    """Return dates and durations in seconds, dates since 1970."""
    if array.dtype.kind not in "mM":
        return array
    unit = np.timedelta64(1, "ns")
    since = array - np.datetime64(0, "s") if array.dtype.kind == "M" else array
    return np.asarray(since / unit * 1e-9, dtype=np.float64)

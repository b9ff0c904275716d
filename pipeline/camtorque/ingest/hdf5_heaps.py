"""The global heaps of an HDF5 file, where its texts lie, checked before the library follows them.

HDF5 walks a heap by the sizes that its objects state; a free space of size 0 keeps it walking for ever (HDF5 file
format, "Disk Format: Level 1E - Global Heap").
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

from camtorque.records import Refusal

SIGNATURE = b"GCOL\x01\x00\x00\x00"
SEARCHED = 512 * 2**20
"""Bytes searched at either end of a file: attributes are written at its beginning or at its close."""
OBJECT = struct.Struct("<HHIQ")
HEAD = 16


def check_heaps(path: Path) -> None:
    """Refuse a file with a global heap whose objects do not fill it one after the other."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        for place in _places(data):
            _check_heap(path, data, place)


def _places(data: mmap.mmap) -> Iterator[int]:
    size = len(data)
    at = data.find(SIGNATURE)
    while at >= 0:
        yield at
        at = data.find(SIGNATURE, at + 1)
        if SEARCHED < at < size - SEARCHED:
            at = data.find(SIGNATURE, size - SEARCHED)


def _check_heap(path: Path, data: mmap.mmap, place: int) -> None:
    where = f"{path}: the heap of texts at byte {place}"
    if place + HEAD > len(data):
        raise Refusal(f"{where} is cut; copy the file again")
    end = place + int.from_bytes(data[place + 8 : place + HEAD], "little")
    if end > len(data):
        raise Refusal(f"{where} ends at byte {end}, the file has {len(data)}: it is cut or damaged; copy it again")
    at = place + HEAD
    while at + OBJECT.size <= end:
        index, _, _, size = OBJECT.unpack(data[at : at + OBJECT.size])
        step = size if index == 0 else OBJECT.size + (size + 7) // 8 * 8
        if step < OBJECT.size or at + step > end:
            raise Refusal(f"{where} states an object of {size} bytes at byte {at}: the file is damaged; copy it again")
        at += step

"""The global heaps of an HDF5 file, where its texts lie, and the blocks of its data sets, checked before they are read.

HDF5 walks a heap by the sizes that its objects state; a free space of size 0 keeps it walking for ever (HDF5 file
format, "Disk Format: Level 1E - Global Heap").
"""

from __future__ import annotations

import math
import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


def check_chunks(path: Path, data: Any) -> None:
    """Refuse chunks that are missing, stand twice or lie outside the file: the library would read beyond its memory."""
    size, seen = path.stat().st_size, set()

    def look(chunk: Any) -> None:
        inside = chunk.byte_offset > 0 and chunk.size > 0 and chunk.byte_offset + chunk.size <= size
        if (
            not inside
            or chunk.chunk_offset in seen
            or any(a % b for a, b in zip(chunk.chunk_offset, data.chunks, strict=False))
        ):
            raise Refusal(
                f"{path}: a block of {data.name} is said to be {chunk.size} bytes at byte {chunk.byte_offset} of {size}"
                ": the file is damaged; copy it again"
            )
        seen.add(chunk.chunk_offset)

    data.id.chunk_iter(look)
    expected = math.prod([-(-a // b) for a, b in zip(data.shape, data.chunks, strict=True)])
    if len(seen) != expected:
        raise Refusal(
            f"{path}: data set {data.name} has {len(seen)} of its {expected} blocks; the others were never written: "
            "export what is there"
        )

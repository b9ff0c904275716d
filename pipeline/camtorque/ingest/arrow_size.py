"""How large a Feather (Arrow IPC) file unpacks to, from the headers of its batches, before anything is unpacked.

Arrow unpacks each buffer to the size that its first eight bytes claim. Where the buffers lie is stated in the
flatbuffer of the batch's message (format/Message.fbs of Arrow), of which only four fields are read here.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

from camtorque.ingest.zlib_check import refuse_bomb
from camtorque.records import Refusal

FIRST_MESSAGE = 8
"""Bytes of the magic before it."""
HEADER, BUFFERS, COMPRESSION, DICTIONARY_DATA = 2, 2, 3, 1
"""Places of fields: header of Message; buffers and compression of RecordBatch; data of DictionaryBatch."""


def refuse_feather_bomb(path: Path, library: Any) -> None:
    """Refuse a Feather file whose batches claim to unpack to what no signal packs from; ``library`` is pyarrow."""
    size, total, batches = path.stat().st_size, 0, 0
    with library.memory_map(str(path)) as memory:
        listed = library.ipc.open_file(memory).num_record_batches
        memory.seek(FIRST_MESSAGE)
        for message in library.ipc.MessageReader.open_stream(memory):
            if message.type in ("record batch", "dictionary batch"):
                batches += message.type == "record batch"
                total += _unpacked(message)
                refuse_bomb(total, size, f"{path}: batch {batches}")
    if listed > batches:
        raise Refusal(f"{path}: its index lists {listed} batches, found {batches}; export the log again")


def _unpacked(message: Any) -> int:
    data, body = message.metadata.to_pybytes(), message.body
    batch = _child(data, struct.unpack_from("<I", data, 0)[0], HEADER)
    if message.type == "dictionary batch":
        batch = _child(data, batch, DICTIONARY_DATA)
    start = _child(data, batch, BUFFERS)
    count = struct.unpack_from("<I", data, start)[0]
    places = [struct.unpack_from("<qq", data, start + 4 + 16 * k) for k in range(count)]
    if not _field(data, batch, COMPRESSION):
        return sum(length for _, length in places)
    claims = [struct.unpack_from("<q", body, offset)[0] if length >= 8 else 0 for offset, length in places]
    # -1 marks a buffer that was left as it is
    return sum(claim if claim >= 0 else length for claim, (_, length) in zip(claims, places, strict=True))


def _field(data: bytes, table: int, place: int) -> int:
    """Return where a field of a flatbuffer table lies, 0 where it is not there."""
    layout = table - struct.unpack_from("<i", data, table)[0]
    end = struct.unpack_from("<H", data, layout)[0]
    at = 4 + 2 * place
    offset = struct.unpack_from("<H", data, layout + at)[0] if at < end else 0
    return table + offset if offset else 0


def _child(data: bytes, table: int, place: int) -> int:
    """Return where the table or vector that a field refers to begins."""
    at = _field(data, table, place)
    if not at:
        raise ValueError("a batch without its header")
    return int(at + struct.unpack_from("<I", data, at)[0])

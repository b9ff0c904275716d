"""Limits of unpacking, and the checksum (Adler-32) of a zlib stream inside a file."""

from __future__ import annotations

import zlib
from typing import BinaryIO

from camtorque.records import Refusal

PIECE = 1 << 20
ALWAYS_UNPACKED = 256 * 2**20
"""Data up to this size are unpacked however well they are packed [bytes]."""
BEST_PACKING = 50
"""Measured signals pack ten to one at best; what claims more beyond `ALWAYS_UNPACKED` is a bomb."""


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

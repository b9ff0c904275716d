"""The skeleton of an MDF 4 file, checked before a library follows its links: a broken one can crash the process.

Every block begins with ``##``, a two-letter kind, its length and its links (ASAM MDF 4.1, "Block structure"). All links
that the header reaches are followed; a link that leads out of the file or to something else is refused.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

from camtorque.ingest.zlib_check import checked_size
from camtorque.records import Refusal

MAX_BLOCKS = 2_000_000
CHAINED = ("DG", "CG", "CN", "DL", "FH", "AT", "EV", "CH")
"""Kinds whose first link is the next block of the same kind."""
GROUP_DATA = struct.Struct("<QQHHIII")
CHANNEL_DATA = struct.Struct("<BBBBII")
VARIABLE_LENGTH = 1
"""Flag of a channel group that holds signals of changing length."""
DZ_HEAD = struct.Struct("<2sBBIQQ")


def check_mf4(path: Path) -> None:
    """Refuse an MDF 4 file that is unfinished, cut, or whose links or compressed blocks are broken."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(64)
        if head.startswith(b"UnFinMF"):
            raise Refusal(f"{path}: its logger never finished it (UnFinMF); finalise it with the logger's software")
        if len(head) < 64 or not head[8:9].isdigit():
            raise Refusal(f"{path}: the first 64 bytes are not an MDF 4 identification; copy the file again")
        seen: dict[int, str] = {}
        following: dict[int, int] = {}
        waiting = [(64, "the file header")]
        while waiting:
            offset, origin = waiting.pop()
            if offset in seen:
                continue
            kind, links, length = _block(file, path, size, offset, origin)
            seen[offset] = kind
            if kind in CHAINED and links and links[0]:
                following[offset] = links[0]
            if len(seen) > MAX_BLOCKS:
                raise Refusal(f"{path}: more than {MAX_BLOCKS} blocks; the links of the file run in circles")
            if kind == "DZ":
                _check_compressed(file, path, offset, length)
            waiting += [(link, f"{kind} at byte {offset}") for link in links if link]
        _refuse_circles(path, following)
        for offset, kind in seen.items():
            if kind == "CG":
                _check_record(file, path, size, offset)
    if "HD" not in seen.values():
        raise Refusal(f"{path}: has no header block (##HD) at byte 64; copy the file again")


def _check_record(file: BinaryIO, path: Path, size: int, group: int) -> None:
    """Refuse a channel whose bytes lie outside the record of its group: a library would read beyond its memory."""
    _, links, length = _block(file, path, size, group, "the file header")
    at = group + 24 + 8 * len(links)
    if len(links) < 2 or length < 24 + 8 * len(links) + GROUP_DATA.size:
        raise Refusal(f"{path}: channel group at byte {group} is too short: the file is damaged; copy it again")
    file.seek(at)
    _, _, flags, _, _, record, invalid = GROUP_DATA.unpack(file.read(GROUP_DATA.size))
    waiting, passed = [links[1]], set()
    while waiting:
        offset = waiting.pop()
        if not offset or offset in passed or flags & VARIABLE_LENGTH:
            continue
        passed.add(offset)
        kind, links, length = _block(file, path, size, offset, f"channel group at byte {group}")
        if kind != "CN":
            continue  # an array: it lies inside the channel that names it
        if len(links) < 2 or length < 24 + 8 * len(links) + CHANNEL_DATA.size:
            raise Refusal(f"{path}: channel at byte {offset} is too short: the file is damaged; copy it again")
        file.seek(offset + 24 + 8 * len(links))
        _, _, _, first_bit, first, bits = CHANNEL_DATA.unpack(file.read(CHANNEL_DATA.size))
        if first + (first_bit + bits + 7) // 8 > record + invalid:
            raise Refusal(
                f"{path}: channel at byte {offset} takes {bits} bits from byte {first} of a record of {record}: "
                "the file is damaged; copy it again"
            )
        waiting += links[:2]


def _refuse_circles(path: Path, following: dict[int, int]) -> None:
    """Refuse a chain of blocks that comes back to one it has passed; each block has at most one that follows."""
    ends: set[int] = set()
    for start in following:
        passed: set[int] = set()
        at = start
        while at in following and at not in ends:
            if at in passed:
                raise Refusal(f"{path}: the chain of blocks at byte {at} runs in a circle: the file is damaged")
            passed.add(at)
            at = following[at]
        ends |= passed


def _block(file: BinaryIO, path: Path, size: int, offset: int, origin: str) -> tuple[str, tuple[int, ...], int]:
    if offset % 8 or offset < 64 or offset + 24 > size:
        raise Refusal(
            f"{path}: {origin} links to byte {offset}, the file has {size}: it is cut or damaged; copy it again"
        )
    file.seek(offset)
    mark, kind, _, length, n_links = struct.unpack("<2s2sIQQ", file.read(24))
    if mark != b"##" or not kind.isalnum():
        raise Refusal(
            f"{path}: {origin} links to byte {offset}, where no block begins: the file is damaged; copy it again"
        )
    name = kind.decode("ascii")
    if length < 24 + 8 * n_links or offset + length > size:
        raise Refusal(
            f"{path}: block {name} at byte {offset} is {length} bytes long, the file has {size}: it is cut; copy it "
            "again"
        )
    links = struct.unpack(f"<{n_links}Q", file.read(8 * n_links))
    return name, links, length


def _check_compressed(file: BinaryIO, path: Path, offset: int, length: int) -> None:
    """Unpack a DZ block in pieces; its Adler-32 tells every flipped byte."""
    file.seek(offset + 24)
    _, _, _, _, original, packed = DZ_HEAD.unpack(file.read(DZ_HEAD.size))
    where = f"{path}: compressed block at byte {offset}"
    if packed > length - 24 - DZ_HEAD.size:
        raise Refusal(f"{where} states {packed} bytes of data in {length}: the file is damaged; copy it again")
    total = checked_size(file, packed, where)
    if total != original:
        raise Refusal(f"{where} unpacks to {total} bytes, {original} are stated: the file is damaged; copy it again")

"""MDF 4 (Vector, ETAS, IPEmotion) with asammdf.

asammdf is asked only after the skeleton of the file was checked, since a broken one can crash the process; it decodes
into arrays up to a size, beyond it in pieces. Every block begins with ``##``, a two-letter kind, its length and its
links (ASAM MDF 4.1, "Block structure"). All links that the header reaches are followed; a link that leads out of the
file or to something else is refused.
"""

from __future__ import annotations

import logging
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.raw import (
    IN_MEMORY_BYTES,
    ArraySource,
    CallSource,
    FileChannel,
    RawFile,
    checked_size,
    refusing,
)
from camtorque.ingest.stored import Stored, chosen, listing_of, read_stored
from camtorque.records import Refusal, SampleSource

MAX_BLOCKS = 2_000_000
CHAINED = ("DG", "CG", "CN", "DL", "FH", "AT", "EV", "CH")
"""Kinds whose first link is the next block of the same kind."""
GROUP_DATA = struct.Struct("<QQHHIII")
CHANNEL_DATA = struct.Struct("<BBBBII")
VARIABLE_LENGTH = 1
"""Flag of a channel group that holds signals of changing length."""
DZ_HEAD = struct.Struct("<2sBBIQQ")
Block = tuple[str, tuple[int, ...], int]
"""Kind, links and length of a block."""


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read channels of an MDF 4 file with the time base of their group."""
    with _opened(path) as mdf:
        held = _held(mdf)

        def beside(group: str, number: int, name: str) -> Stored:
            # groups may have one name, or none, and each has a channel "time"
            return _stored(path, mdf, *chosen(path, [row for row in held if row[2][1] == number], group, name))

        def find(group: str, name: str) -> Stored:
            place = chosen(path, held, group, name)
            return replace(_stored(path, mdf, *place), beside=partial(beside, *place[:2]))

        return read_stored(path, "MDF 4", specs, find)


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the channels that hold numbers, rates as the times of their group say."""
    found: list[FileChannel] = []
    with _opened(path) as mdf:
        for _, _, (group, number, index) in _held(mdf):
            if mdf.groups[number].channel_group.cycles_nr and index != mdf.masters_db.get(number):
                with suppress(Refusal):
                    found += listing_of([_stored(path, mdf, group, number, index)])
    return tuple(found)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    library = _library()
    _check(path)
    with refusing(path, "MDF 4"), library.MDF(path) as mdf:
        yield mdf


def _held(mdf: Any) -> list[tuple[list[str], str, tuple[str, int, int]]]:
    """Return the names of its group and the name of each channel, and by what `_stored` finds it.

    A group is named by its acquisition name and by what stands as text in its comment.
    """
    found = []
    for number, group in enumerate(mdf.groups):
        comment = re.sub(r"<[^>]*>", " ", str(group.channel_group.comment or "")).split()
        names = [name for name in (str(group.channel_group.acq_name or ""), " ".join(comment)) if name] or [""]
        found += [(names, channel.name, (names[0], number, index)) for index, channel in enumerate(group.channels)]
    return found


def _stored(path: Path, mdf: Any, group: str, number: int, index: int) -> Stored:
    """Return a channel with the times of its group."""
    channel, cycles = mdf.groups[number].channels[index], int(mdf.groups[number].channel_group.cycles_nr)
    times, source = _sources(path, mdf, number, index, cycles)
    begun = mdf.header.start_time
    stamp = (begun if begun.tzinfo else begun.replace(tzinfo=UTC)).timestamp()
    unit = str(channel.unit or getattr(channel.conversion, "unit", "") or "")
    return Stored(group, channel.name, unit, source, times=times, dates=((0, stamp),), declared=cycles)


def _library() -> Any:
    import asammdf

    # what the library would write to standard error is a refusal here
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    asammdf.set_global_option("raise_on_multiple_occurrences", True)
    return asammdf


def _sources(path: Path, mdf: Any, group: int, index: int, cycles: int) -> tuple[SampleSource, SampleSource]:
    """Return times and samples."""
    if not cycles:
        return ArraySource(np.empty(0)), ArraySource(np.empty(0))
    if cycles * 16 <= IN_MEMORY_BYTES:
        signal = mdf.get(group=group, index=index, ignore_invalidation_bits=True)
        _refuse_text(path, signal.samples)
        return ArraySource(signal.timestamps), ArraySource(_without_invalid(signal.samples, signal.invalidation_bits))
    library = _library()

    def samples(start: int, stop: int) -> np.ndarray:
        with library.MDF(path) as again:
            piece = again.get(
                group=group, index=index, record_offset=start, record_count=stop - start, samples_only=True,
                ignore_invalidation_bits=True,
            )  # fmt: skip
            return _without_invalid(*piece)

    def times(start: int, stop: int) -> np.ndarray:
        with library.MDF(path) as again:
            return again.get_master(group, record_offset=start, record_count=stop - start)

    _refuse_text(path, samples(0, 1))
    return CallSource(cycles, times, path, "MDF 4"), CallSource(cycles, samples, path, "MDF 4")


def _without_invalid(samples: np.ndarray, invalid: Any) -> np.ndarray:
    """Return samples with nan for those that the logger marks as invalid."""
    return samples if invalid is None or not np.any(invalid) else np.where(np.asarray(invalid), np.nan, samples)


def _refuse_text(path: Path, samples: np.ndarray) -> None:
    if samples.ndim != 1 or samples.dtype.kind not in "fiu":
        raise Refusal(
            f"{path}: a channel holds {samples.dtype} of shape {samples.shape}, expected one number per sample"
        )


def _check(path: Path) -> None:
    """Refuse an MDF 4 file that is unfinished, cut, or whose links or compressed blocks are broken."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(64)
        if head.startswith(b"UnFinMF"):
            raise Refusal(f"{path}: its logger never finished it (UnFinMF); finalise it with the logger's software")
        if len(head) < 64 or not head[8:9].isdigit():
            raise Refusal(f"{path}: the first 64 bytes are not an MDF 4 identification; copy the file again")
        seen: dict[int, Block] = {}
        waiting = [(64, "the file header")]
        while waiting:
            offset, origin = waiting.pop()
            if offset in seen:
                continue
            kind, links, length = seen[offset] = _block(file, path, size, offset, origin)
            if len(seen) > MAX_BLOCKS:
                raise Refusal(f"{path}: more than {MAX_BLOCKS} blocks; the links of the file run in circles")
            if kind == "DZ":
                _check_compressed(file, path, offset, length)
            waiting += [(link, f"{kind} at byte {offset}") for link in links if link]
        _refuse_circles(path, seen)
        for offset, (kind, _, _) in seen.items():
            if kind == "CG":
                _check_record(file, path, seen, offset)
    if all(kind != "HD" for kind, _, _ in seen.values()):
        raise Refusal(f"{path}: has no header block (##HD) at byte 64; copy the file again")


def _check_record(file: BinaryIO, path: Path, seen: dict[int, Block], group: int) -> None:
    """Refuse a channel whose bytes lie outside the record of its group: a library would read beyond its memory."""
    _, links, length = seen[group]
    if len(links) < 2 or length < 24 + 8 * len(links) + GROUP_DATA.size:
        raise Refusal(f"{path}: channel group at byte {group} is too short: the file is damaged; copy it again")
    file.seek(group + 24 + 8 * len(links))
    _, _, flags, _, _, record, invalid = GROUP_DATA.unpack(file.read(GROUP_DATA.size))
    waiting, passed = [links[1]], set()
    while waiting:
        offset = waiting.pop()
        if not offset or offset in passed or flags & VARIABLE_LENGTH:
            continue
        passed.add(offset)
        kind, links, length = seen[offset]
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


def _refuse_circles(path: Path, seen: dict[int, Block]) -> None:
    """Refuse a chain of blocks that comes back to one it has passed; each block has at most one that follows."""
    following = {at: links[0] for at, (kind, links, _) in seen.items() if kind in CHAINED and links and links[0]}
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


def _block(file: BinaryIO, path: Path, size: int, offset: int, origin: str) -> Block:
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

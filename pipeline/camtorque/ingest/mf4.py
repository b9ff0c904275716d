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
from contextlib import suppress
from datetime import UTC
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.listing import usual_rate
from camtorque.ingest.raw import (
    IN_MEMORY_BYTES,
    ArraySource,
    CallSource,
    FileChannel,
    RawChannel,
    RawFile,
    missing_samples,
    read_each,
    refusing,
)
from camtorque.ingest.stamps import read_stamps
from camtorque.ingest.zlib_check import checked_size
from camtorque.records import Finding, Refusal, SampleSource
from camtorque.units import did_you_mean

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
    library = _library()
    _check(path)
    with refusing(path, "MDF 4"), library.MDF(path) as mdf:
        begun = mdf.header.start_time
        stamp = (begun if begun.tzinfo else begun.replace(tzinfo=UTC)).timestamp()
        return read_each(path, "MDF 4", specs, lambda spec: _channel(mdf, path, spec, stamp))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the channels that hold numbers, rates as the times of their group say."""
    library = _library()
    _check(path)
    found = []
    with refusing(path, "MDF 4"), library.MDF(path) as mdf:
        for number, group in enumerate(mdf.groups):
            cycles = int(group.channel_group.cycles_nr)
            master = mdf.masters_db.get(number)
            for index, channel in enumerate(group.channels):
                if index == master or not cycles:
                    continue
                with suppress(Refusal):
                    times, source = _sources(path, mdf, number, index, cycles)
                    name = _group_names(group.channel_group)[0]
                    rate = usual_rate(times)
                    found.append(FileChannel(name, channel.name, _unit(channel), source.n_samples, rate, "", source))
    return tuple(found)


def _unit(block: Any) -> str:
    return str(block.unit or getattr(block.conversion, "unit", "") or "")


def _library() -> Any:
    import asammdf

    # what the library would write to standard error is a refusal here
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    asammdf.set_global_option("raise_on_multiple_occurrences", True)
    return asammdf


def _channel(mdf: Any, path: Path, spec: ChannelSpec, stamp: float) -> tuple[RawChannel, tuple[Finding, ...]]:
    group, index = _find(mdf, path, spec)
    cycles = int(mdf.groups[group].channel_group.cycles_nr)
    where = f"{path.name} {spec.group}/{spec.channel}"
    if cycles == 0:
        raise Refusal(f"{path}: channel {spec.channel!r} in group {spec.group!r} holds no samples")
    times, source = _sources(path, mdf, group, index, cycles)
    stamps = read_stamps(times, spec.sample_rate, where)
    raw = stamps.channel(spec.channel, _unit(mdf.groups[group].channels[index]), source, stamp)
    return raw, (*missing_samples(source.n_samples, cycles, where), *stamps.findings)


def _find(mdf: Any, path: Path, spec: ChannelSpec) -> tuple[int, int]:
    """Return group and channel index by the group's acquisition name and the channel's name."""
    names, found = [], []
    for number, group in enumerate(mdf.groups):
        acquisitions = _group_names(group.channel_group)
        for index, channel in enumerate(group.channels):
            names.append(f"{acquisitions[0]}/{channel.name}")
            if channel.name == spec.channel and spec.group in ("", *acquisitions):
                found.append((number, index))
    key = f"{spec.group}/{spec.channel}"
    if not found:
        raise Refusal(f"{path}: no channel {key!r}{did_you_mean(key, tuple(names))}; there are {', '.join(names[:12])}")
    if len(found) > 1:
        raise Refusal(f"{path}: {len(found)} channels are named {key!r}; name the group in recording.toml")
    return found[0]


def _group_names(group: Any) -> list[str]:
    """Return the names of a channel group: acquisition name, else what stands as text in its comment."""
    comment = re.sub(r"<[^>]*>", " ", str(group.comment or ""))
    return [name for name in (str(group.acq_name or ""), " ".join(comment.split())) if name] or [""]


def _sources(path: Path, mdf: Any, group: int, index: int, cycles: int) -> tuple[SampleSource, SampleSource]:
    """Return times and samples."""
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

"""TDMS (LabVIEW, DIAdem) with npTDMS: metadata by the library, plain samples straight from the file.

A TDMS file is a chain of segments, each with a lead-in of 28 bytes that states its length: a cut or a broken link shows
there, before the library is asked (NI, "TDMS File Format Internal Structure").
"""

from __future__ import annotations

import logging
import math
import struct
from collections.abc import Container, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from nptdms import TdmsChannel, TdmsFile
from nptdms.log import log_manager
from nptdms.reader import TdmsReader
from nptdms.scaling import get_scaling
from nptdms.timestamp import TdmsTimestamp

from camtorque.config import ChannelSpec
from camtorque.ingest.columns import time_beside
from camtorque.ingest.raw import CallSource, FileChannel, FileSource, Piece, RawFile, refusing
from camtorque.ingest.stored import Stored, chosen, listing_of, read_stored, unused_scales
from camtorque.records import Finding, Refusal, SampleSource

LEAD_IN = 28
INTERLEAVED, BIG_ENDIAN, DAQMX = 1 << 5, 1 << 6, 1 << 7
MOST_SEGMENTS = 100_000
"""A logger that writes ten times a second makes this many in three hours; reading more takes minutes."""
UNKNOWN_LENGTH = 0xFFFFFFFFFFFFFFFF
KINDS = "fiuM"
"""Numbers, and stamps of time, which are read in seconds since 1970."""
SCALE_COUNT = "NI_Number_Of_Scales"
MOST_SCALES = 12
"""A chain of raw count, volts, bridge and unit has four; each may be computed from two others."""


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read channels of a TDMS file; each may have its own rate."""
    # what the library would write to standard error about a cut file is a finding here
    log_manager.set_level(logging.CRITICAL)
    findings = check_segments(path)
    with refusing(path, "TDMS"):
        file = TdmsFile.open(path)
    with file:
        begun = _stated_starts(path) if len(file._reader._segments or ()) > 1 else {}  # noqa: SLF001
        held = [((group.name,), channel.name, channel) for group in file.groups() for channel in group.channels()]

        def find(group: str, name: str) -> Stored:
            channel = chosen(path, held, group, name)
            item = _stored(file, path, channel, begun)
            if channel.dtype.kind in "iu" and (unused := unused_scales(channel.properties, channel.dtype)):
                raise Refusal(
                    f"{path}: channel {name!r} holds {channel.dtype} and the property {unused}, which is not applied: "
                    "write the values scaled, or with a linear scale as NI loggers do"
                )
            if findings and not item.source.n_samples:
                raise Refusal(f"{path}: channel {name!r} in group {item.group!r} holds no samples; the file is cut: "
                              "copy it from the logger again")  # fmt: skip
            return item

        found = read_stored(path, "TDMS", specs, find)
    return RawFile(found.channels, (*findings, *found.findings))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the channels that hold numbers."""
    log_manager.set_level(logging.CRITICAL)
    check_segments(path)
    with refusing(path, "TDMS"), TdmsFile.open(path) as file:
        held = [channel for group in file.groups() for channel in group.channels()]
        numbers = [channel for channel in held if len(channel) and channel.dtype.kind in KINDS]
        return listing_of([_stored(file, path, channel, {}) for channel in numbers])


def _stored(file: TdmsFile, path: Path, channel: TdmsChannel, begun: Mapping[str, list[tuple[int, float]]]) -> Stored:
    """Return a channel; ``begun`` are the segments that state when it begins, where several may do so."""
    source, properties = _source(file, channel, path), channel.properties
    step = float(properties["wf_increment"]) if "wf_increment" in properties else None
    rate = None if step is None else 1.0 / step if step else math.inf
    start = float(properties["wf_start_offset"]) if "wf_start_offset" in properties else None
    date, begins = _epoch(properties.get("wf_start_time")), begun.get(channel.path)
    dates = _dates(file, channel, begins) if begins else () if date is None else ((0, date),)
    beside = partial(_time_beside, file, channel, path) if step is None else None
    return Stored(channel.group_name, channel.name, _unit(channel), source, rate, start,
                  time_beside=beside, dates=dates, first_dated=True,
                  declared=int(properties.get("wf_samples", 0)))  # fmt: skip


def _unit(channel: TdmsChannel) -> str:
    if channel.dtype.kind == "M":
        return "s"
    return str(channel.properties.get("unit_string", channel.properties.get("NI_UnitDescription", "")))


def check_segments(path: Path) -> tuple[Finding, ...]:
    """Follow the chain of segments to the end of the file: a broken chain is refused, cut data are a finding."""
    size, position, number = path.stat().st_size, 0, 0
    with path.open("rb") as file:
        while position < size:
            file.seek(position)
            lead = file.read(LEAD_IN)
            number += 1
            if number > MOST_SEGMENTS:
                raise Refusal(
                    f"{path}: more than {MOST_SEGMENTS} segments in {size} bytes; defragment the file "
                    "(TDMS Defragment in LabVIEW or DIAdem) and use that"
                )
            if len(lead) < LEAD_IN or lead[:4] != b"TDSm":
                raise Refusal(
                    f"{path}: segment {number} at byte {position} has no lead-in: the file is cut or damaged there; "
                    "copy it from the logger again"
                )
            toc = struct.unpack("<i", lead[4:8])[0]
            _, length, raw = struct.unpack((">" if toc & BIG_ENDIAN else "<") + "iQQ", lead[8:])
            if length == UNKNOWN_LENGTH:
                return (_cut(path, number, "was never closed by its logger"),)
            if position + LEAD_IN + raw > size:
                raise Refusal(
                    f"{path}: ends inside the description of segment {number}: the file is cut; copy it again"
                )
            position += LEAD_IN + length
    if position > size:
        return (_cut(path, number, f"ends {position - size} bytes before segment {number} does"),)
    return ()


def _cut(path: Path, number: int, what: str) -> Finding:
    return Finding(
        "file_truncated", "error", f"the file {what}; what is there is used", f"{path.name} segment {number}"
    )


class _StartReader(TdmsReader):
    """Notes which segments state when a channel begins; what the library keeps is what the last one states."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.begun: dict[str, list[tuple[int, float]]] = {}

    def _update_object_properties(self, properties: Any) -> None:
        for path, items in (properties or {}).items():
            stamp, begun = _epoch(dict(items).get("wf_start_time")), self.begun.setdefault(path, [])
            if stamp is not None and (not begun or stamp != begun[-1][1]):  # most writers state the first one again
                begun.append((len(self._segments), stamp))
        super()._update_object_properties(properties)


def _stated_starts(path: Path) -> dict[str, list[tuple[int, float]]]:
    """Return the segments that state when a channel begins, with that date: path of the channel -> (number, date)."""
    with refusing(path, "TDMS"), closing(_StartReader(path)) as reader:
        reader.read_metadata()
        return reader.begun


def _dates(file: TdmsFile, channel: TdmsChannel, begun: list[tuple[int, float]]) -> tuple[tuple[int, float], ...]:
    """Return the samples that segments which state a date begin with, and those dates."""
    counts = [
        sum(item.number_values for item in segment.ordered_objects if item.has_data and item.path == channel.path)
        * segment.num_chunks
        for segment in file._reader._segments  # noqa: SLF001
    ]
    first = np.r_[0, np.cumsum(counts)].astype(np.int64)
    return tuple((int(first[number]), date) for number, date in begun)


def _time_beside(file: TdmsFile, channel: TdmsChannel, path: Path, taken: Container[str]) -> str:
    group = file[channel.group_name]
    same = [item.name for item in group.channels() if len(item) == len(channel) and item.dtype.kind in KINDS]
    return time_beside(same, taken, lambda name: _source(file, group[name], path), channel.name)


def _epoch(stamp: Any) -> float | None:
    if isinstance(stamp, TdmsTimestamp):
        stamp = stamp.as_datetime64("ns")
    return None if stamp is None else float(np.datetime64(stamp, "ns").astype(np.int64)) * 1e-9


def _source(file: TdmsFile, channel: TdmsChannel, path: Path) -> SampleSource:
    _refuse_many_scales(file, channel, path)
    scaling = get_scaling(channel.properties, file[channel.group_name].properties, file.properties)
    if scaling is None and int(channel.properties.get(SCALE_COUNT, 0)) > 0:
        raise Refusal(f"{path}: channel {channel.name!r} has a scale of an unknown kind; export it scaled")
    pieces = _pieces(file, channel.path)
    if pieces is None:

        def by_library(start: int, stop: int) -> np.ndarray:
            with TdmsFile.open(path) as again:
                samples = again[channel.group_name][channel.name].read_data(start, stop - start)
            return samples.astype("M8[ns]").astype(np.int64) * 1e-9 if samples.dtype.kind == "M" else samples

        return CallSource(len(channel), by_library, path, "TDMS")
    # the library's scales expect an object with the raw values in .data
    scale = None if scaling is None else lambda raw: scaling.scale(SimpleNamespace(data=raw, scaler_data=None))
    if scale is not None:
        with refusing(path, "TDMS", f"scale of {channel.name!r}"):  # one that points to itself ends here
            scale(np.zeros(1))
    return FileSource(path, pieces, scale)


def _refuse_many_scales(file: TdmsFile, channel: TdmsChannel, path: Path) -> None:
    for properties in (channel.properties, file[channel.group_name].properties, file.properties):
        count = properties.get(SCALE_COUNT, 0)
        if not isinstance(count, (int, np.integer)) or not 0 <= count <= MOST_SCALES:
            raise Refusal(
                f"{path}: channel {channel.name!r} states {count!r:.40} scales, expected at most {MOST_SCALES}; "
                "the file is damaged, export it scaled"
            )


def _pieces(file: TdmsFile, channel_path: str) -> tuple[Piece, ...] | None:
    """Return where the samples lie in the file, or None where only the library can tell (DAQmx, a cut chunk)."""
    # The library reads whole chunks, which is the whole file for a one-chunk log; its segment table is not public.
    segments = file._reader._segments  # noqa: SLF001
    pieces: list[Piece] = []
    for segment in segments or ():
        if segment.toc_mask & DAQMX or segment.final_chunk_lengths_override is not None:
            return None
        objects = [item for item in segment.ordered_objects if item.has_data]
        mine = next((number for number, item in enumerate(objects) if item.path == channel_path), None)
        if mine is None:
            continue
        if any(getattr(item.data_type, "nptype", None) is None for item in objects):
            return None
        order = ">" if segment.toc_mask & BIG_ENDIAN else "<"
        kinds = [np.dtype(item.data_type.nptype).newbyteorder(order) for item in objects]
        widths = [kind.itemsize for kind in kinds]
        sizes = [item.number_values * width for item, width in zip(objects, widths, strict=True)]
        woven, kind, count, chunk = segment.toc_mask & INTERLEAVED, kinds[mine], objects[mine].number_values, sum(sizes)
        begin = segment.data_position + sum((widths if woven else sizes)[:mine])
        stride = sum(widths) if woven else kind.itemsize
        first = pieces[-1].first + pieces[-1].n_samples if pieces else 0
        pieces += [Piece(first + n * count, count, begin + n * chunk, kind, stride) for n in range(segment.num_chunks)]
    return tuple(pieces)

"""TDMS (LabVIEW, DIAdem) with npTDMS: metadata by the library, plain samples straight from the file.

A TDMS file is a chain of segments, each with a lead-in of 28 bytes that states its length: a cut or a broken link shows
there, before the library is asked (NI, "TDMS File Format Internal Structure").
"""

from __future__ import annotations

import logging
import struct
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from nptdms import TdmsChannel, TdmsFile
from nptdms.log import log_manager
from nptdms.reader import TdmsReader
from nptdms.scaling import get_scaling
from nptdms.timestamp import TdmsTimestamp
from numpy.typing import NDArray

from camtorque.config import ChannelSpec
from camtorque.ingest.columns import time_beside, times_beside
from camtorque.ingest.header import time_unit
from camtorque.ingest.listing import with_times
from camtorque.ingest.raw import (
    CallSource,
    FileChannel,
    FileSource,
    Piece,
    RawChannel,
    RawFile,
    missing_samples,
    read_each,
    refusing,
)
from camtorque.ingest.stamps import agreed_rate, break_findings
from camtorque.records import Array, Finding, Refusal, SampleSource
from camtorque.units import did_you_mean

LEAD_IN = 28
LEAST_PAUSE = 0.05
"""Starts of segments that leave the time of the samples before by less are those of a loop that reads blocks [s]."""
INTERLEAVED, BIG_ENDIAN, DAQMX = 1 << 5, 1 << 6, 1 << 7
MOST_SEGMENTS = 100_000
"""A logger that writes ten times a second makes this many in three hours; reading more takes minutes."""
UNKNOWN_LENGTH = 0xFFFFFFFFFFFFFFFF
MOST_SHOWN = 12
"""Channels that a refusal lists."""
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
        found = read_each(path, "TDMS", specs, lambda spec: _channel(file, path, spec, specs, begun, bool(findings)))
    return RawFile(found.channels, (*findings, *found.findings))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the channels that hold numbers."""
    log_manager.set_level(logging.CRITICAL)
    check_segments(path)
    found = []
    with refusing(path, "TDMS"), TdmsFile.open(path) as file:
        for group in file.groups():
            for channel in group.channels():
                if not len(channel) or channel.dtype.kind not in "fiu":
                    continue
                step = channel.properties.get("wf_increment")
                unit = _unit(channel)
                source = _source(file, channel, path)
                rate = 1.0 / float(step) if step else None
                found.append(FileChannel(group.name, channel.name, unit, source.n_samples, rate, "", source))
    return with_times(found)


def _unit(channel: TdmsChannel) -> str:
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


def _channel(
    file: TdmsFile,
    path: Path,
    spec: ChannelSpec,
    specs: tuple[ChannelSpec, ...],
    begun: dict[str, list[tuple[int, float]]],
    is_cut: bool,
) -> tuple[RawChannel, list[Finding]]:
    channel = _find(file, path, spec.group, spec.channel)
    where = f"{path.name} {spec.group}/{spec.channel}"
    source = _source(file, channel, path)
    if not source.n_samples:
        why = "the file is cut: copy it from the logger again" if is_cut else "the logger wrote none: record it again"
        raise Refusal(f"{path}: channel {spec.channel!r} in group {spec.group!r} holds no samples; {why}")
    properties = channel.properties
    findings = list(missing_samples(source.n_samples, int(properties.get("wf_samples", 0)), where))
    rate = spec.sample_rate
    time_channel = spec.time_channel or ("" if "wf_increment" in properties else _times(file, channel, path, specs))
    if time_channel:
        times = _find(file, path, channel.group_name, time_channel)
        if len(times) != source.n_samples:
            raise Refusal(f"{where}: {len(times)} times in {time_channel!r} for {source.n_samples} samples")
        told = time_unit(time_channel, _unit(times))
        stamps, day = times_beside(_source(file, times, path), told, spec, where)
        return stamps.channel(spec.channel, _unit(channel), source, day), [*findings, *stamps.findings]
    if "wf_increment" in properties:
        increment = float(properties["wf_increment"])
        if not increment > 0.0:
            raise Refusal(
                f"{path} {spec.group}/{spec.channel}: wf_increment is {increment!r}, expected a time step > 0 s"
            )
        rate, more = agreed_rate(1.0 / increment, spec.sample_rate, where, "wf_increment says")
        findings += more
    start = properties.get("wf_start_offset", spec.start_time or 0.0)
    stamp, index, size = _epoch(properties.get("wf_start_time")), np.empty(0, dtype=np.int64), np.empty(0)
    if begun.get(channel.path):
        stamp, index, size = _pauses(file, channel, begun[channel.path], rate)
        findings += break_findings(index, size, 1.0 / rate, where)
    breaks = tuple(index.tolist()), tuple(size.tolist())
    return RawChannel(spec.channel, _unit(channel), source, float(start), rate, stamp, *breaks), findings


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


def _pauses(
    file: TdmsFile, channel: TdmsChannel, begun: list[tuple[int, float]], rate: float
) -> tuple[float, NDArray[np.int64], Array]:
    """Return the date of the first sample, the samples behind pauses, and these [s]: logs may have been appended."""
    counts = [
        sum(item.number_values for item in segment.ordered_objects if item.has_data and item.path == channel.path)
        * segment.num_chunks
        for segment in file._reader._segments  # noqa: SLF001
    ]
    first = np.r_[0, np.cumsum(counts)].astype(np.int64)
    at = first[[number for number, _ in begun]]
    zero = np.array([stamp for _, stamp in begun]) - at / rate
    late = np.diff(zero)
    paused = np.flatnonzero((np.abs(late) > LEAST_PAUSE) & (at[1:] > 0) & (at[1:] < first[-1]))
    return float(zero[0]), at[1:][paused], late[paused]


def _times(file: TdmsFile, channel: TdmsChannel, path: Path, specs: tuple[ChannelSpec, ...]) -> str:
    """Return the name of the times beside a channel in its group, "" where there are none."""
    group = file[channel.group_name]
    taken = {spec.channel for spec in specs if spec.group in ("", channel.group_name)}
    same = [item.name for item in group.channels() if len(item) == len(channel) and item.dtype.kind in "fiu"]
    return time_beside(same, taken, lambda name: _source(file, group[name], path))


def _find(file: TdmsFile, path: Path, group: str, name: str) -> TdmsChannel:
    """Return a channel of a group, or the only one of that name where no group is named."""
    groups = [item.name for item in file.groups()]
    if group and group not in groups:
        hint = did_you_mean(group, groups)
        raise Refusal(f"{path}: no group {group!r}{hint}; the file has {', '.join(groups) or 'none'}")
    places = [(place, channel.name) for place in ([group] if group else groups) for channel in file[place].channels()]
    holding = [place for place, other in places if other == name]
    if len(holding) > 1:
        raise Refusal(f"{path}: {name!r} is in the groups {', '.join(holding)}; name one as group in recording.toml")
    if not holding:
        names = [other for _, other in places]
        shown = ", ".join(names if group else map("/".join, places[:MOST_SHOWN])) or "none"
        where = f"group {group!r}" if group else "any group"
        raise Refusal(f"{path}: no channel {name!r} in {where}{did_you_mean(name, names)}; there are {shown}")
    return file[holding[0]][name]


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
                return again[channel.group_name][channel.name].read_data(start, stop - start)

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
        widths = [getattr(item.data_type, "nptype", None) for item in objects]
        mine = [number for number, item in enumerate(objects) if item.path == channel_path]
        if not mine:
            continue
        if any(width is None for width in widths):
            return None
        order = ">" if segment.toc_mask & BIG_ENDIAN else "<"
        pieces += _pieces_of(segment, objects, mine[0], order, pieces[-1].first + pieces[-1].n_samples if pieces else 0)
    return tuple(pieces)


def _pieces_of(segment: Any, objects: list[Any], mine: int, order: str, first: int) -> list[Piece]:
    kinds = [np.dtype(item.data_type.nptype).newbyteorder(order) for item in objects]
    sizes = [item.number_values * kind.itemsize for item, kind in zip(objects, kinds, strict=True)]
    chunk, kind, count = sum(sizes), kinds[mine], objects[mine].number_values
    if segment.toc_mask & INTERLEAVED:
        stride = sum(k.itemsize for k in kinds)
        before = sum(k.itemsize for k in kinds[:mine])
    else:
        stride, before = kind.itemsize, sum(sizes[:mine])
    begin = segment.data_position + before
    return [Piece(first + n * count, count, begin + n * chunk, kind, stride) for n in range(segment.num_chunks)]

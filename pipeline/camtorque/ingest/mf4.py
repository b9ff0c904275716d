"""MDF 4 (Vector, ETAS, IPEmotion) with asammdf.

asammdf is asked only after the skeleton of the file was checked; it decodes into arrays up to a size, beyond it in
pieces.
"""

from __future__ import annotations

import logging
import re
from contextlib import suppress
from datetime import UTC
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.listing import usual_rate
from camtorque.ingest.mf4_structure import check_mf4
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
from camtorque.records import Finding, Refusal, SampleSource
from camtorque.units import did_you_mean


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read channels of an MDF 4 file with the time base of their group."""
    library = _library()
    check_mf4(path)
    with refusing(path, "MDF 4"), library.MDF(path) as mdf:
        begun = mdf.header.start_time
        stamp = (begun if begun.tzinfo else begun.replace(tzinfo=UTC)).timestamp()
        return read_each(path, "MDF 4", specs, lambda spec: _channel(mdf, path, spec, stamp))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the channels that hold numbers, rates as the times of their group say."""
    library = _library()
    check_mf4(path)
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

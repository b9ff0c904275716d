"""HDF5 with h5py; MAT v7.3 is HDF5 and goes the same way.

The rate stands in an attribute of the data set, its group or the file, or the times in a data set of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.columns import with_times
from camtorque.ingest.hdf5_heaps import check_heaps
from camtorque.ingest.raw import CallSource, FileChannel, RawChannel, RawFile, refusing
from camtorque.ingest.timebase import agreed_rate, time_base
from camtorque.ingest.zlib_check import refuse_bomb
from camtorque.records import Finding, Refusal
from camtorque.units import did_you_mean, unit_factor

RATE_NAMES = ("sample_rate_hz", "sampling_rate_hz", "sample_rate", "sampling_rate", "rate_hz", "fs_hz", "fs")
STEP_NAMES = ("wf_increment", "time_step_s", "dt_s", "dt")
START_NAMES = ("t0_s", "start_time_s", "wf_start_offset", "t0")
UNIT_NAMES = ("unit", "units", "unit_string")
MOST_LISTED = 1000
STAMP_NAMES = ("start_time", "wf_start_time", "date_time")


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read channels of an HDF5 file in slices."""
    check_heaps(path)
    channels, findings = [], []
    with refusing(path, "HDF5"), h5py.File(path, "r") as file:
        for spec in specs:
            with refusing(path, "HDF5", f"{spec.group}/{spec.channel}"):
                channel, more = _channel(file, path, spec)
            channels.append(channel)
            findings += more
    return RawFile(tuple(channels), tuple(findings))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the data sets that hold one number per sample, rates as their attributes or times say."""
    check_heaps(path)
    found: list[FileChannel] = []
    with refusing(path, "HDF5"), h5py.File(path, "r") as file:
        names: list[str] = []
        file.visititems(lambda k, v: names.append(k) if isinstance(v, h5py.Dataset) else None)
        for name in names[:MOST_LISTED]:
            data = file[name]
            group, _, last = name.rpartition("/")
            if data.dtype.kind not in "fiu" or sum(size != 1 for size in data.shape) != 1:
                continue
            attributes = _attributes(data)
            rate, step = _first(attributes, RATE_NAMES), _first(attributes, STEP_NAMES)
            known = float(rate) if rate is not None else 1.0 / float(step) if step else None
            unit = str(_first(attributes, UNIT_NAMES) or "")
            source = _source(path, data)
            found.append(FileChannel(group, last, unit, source.n_samples, known, "", source))
    return with_times(found)


def _channel(file: h5py.File, path: Path, spec: ChannelSpec) -> tuple[RawChannel, list[Finding]]:
    data = _find(file, path, spec.group, spec.channel)
    where = f"{path.name} {spec.group}/{spec.channel}"
    source = _source(path, data)
    if source.n_samples == 0:
        raise Refusal(f"{path}: data set {data.name} holds no samples")
    attributes = _attributes(data)
    unit = str(_first(attributes, UNIT_NAMES) or "")
    stamp = _epoch(_first(attributes, STAMP_NAMES))
    if spec.time_channel:
        times = _find(file, path, spec.group, spec.time_channel)
        time_source = _source(path, times)
        _same_length(path, times, time_source.n_samples, source.n_samples)
        factor = unit_factor(str(_first(dict(times.attrs), UNIT_NAMES) or "s"), "time", f"{path.name} {times.name}")
        base = time_base(time_source, spec.sample_rate, where, to_seconds=factor)
        raw = RawChannel(spec.channel, unit, source, base.start, base.rate, stamp, base.breaks, base.break_steps)
        return raw, list(base.findings)
    rate, findings = _declared_rate(attributes, spec, where)
    start = _first(attributes, START_NAMES)
    start = float(start) if start is not None else float(spec.start_time or 0.0)
    return RawChannel(spec.channel, unit, source, start, rate, stamp), findings


def _declared_rate(attributes: Mapping[str, Any], spec: ChannelSpec, where: str) -> tuple[float, list[Finding]]:
    rate, step = _first(attributes, RATE_NAMES), _first(attributes, STEP_NAMES)
    if rate is None and step is None:
        return spec.sample_rate, []
    value = float(rate) if rate is not None else 1.0 / float(step)
    if not (np.isfinite(value) and value > 0.0):
        raise Refusal(f"{where}: the sampling rate in the file is {value!r} Hz, expected a number > 0")
    agreed, findings = agreed_rate(value, spec.sample_rate, where, 1e-9, "the attribute in the file says")
    return agreed, list(findings)


def _find(file: h5py.File, path: Path, group: str, name: str) -> h5py.Dataset:
    key = f"{group}/{name}".strip("/")
    item = file.get(key)
    if isinstance(item, h5py.Dataset):
        return item
    names: list[str] = []
    file.visititems(lambda k, v: names.append(k) if isinstance(v, h5py.Dataset) else None)
    shown = ", ".join(names[:12]) or "none"
    raise Refusal(f"{path}: no data set {key!r}{did_you_mean(key, tuple(names))}; there are {shown}")


def _source(path: Path, data: h5py.Dataset) -> CallSource:
    if data.dtype.kind not in "fiu":
        raise Refusal(f"{path}: data set {data.name} holds {data.dtype}, expected numbers")
    _refuse_unstored(path, data)
    long = [axis for axis, size in enumerate(data.shape) if size != 1]
    if len(long) > 1 or not data.shape:
        raise Refusal(f"{path}: data set {data.name} has shape {data.shape}, expected one row of samples")
    key, axis, shape = data.name, (long[0] if long else 0), data.shape

    def call(start: int, stop: int) -> np.ndarray:
        place = tuple(slice(start, stop) if number == axis else 0 for number in range(len(shape)))
        with h5py.File(path, "r") as file:
            return file[key][place]

    return CallSource(int(shape[axis]), call, path, "HDF5")


def _refuse_unstored(path: Path, data: h5py.Dataset) -> None:
    """Refuse a data set that declares samples which the file does not store: nothing was ever written there."""
    declared, stored = int(data.size) * data.dtype.itemsize, int(data.id.get_storage_size())
    if declared and not stored:
        raise Refusal(f"{path}: data set {data.name} declares {data.size} samples, the file stores none of them")
    refuse_bomb(declared, stored, f"{path}: data set {data.name}")
    if data.chunks is not None and declared:
        _check_chunks(path, data)


def _check_chunks(path: Path, data: h5py.Dataset) -> None:
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
    expected = int(np.prod([-(-a // b) for a, b in zip(data.shape, data.chunks, strict=True)]))
    if len(seen) != expected:
        raise Refusal(
            f"{path}: data set {data.name} has {len(seen)} of its {expected} blocks; the others were never written: "
            "export what is there"
        )


def _same_length(path: Path, times: h5py.Dataset, n_times: int, n_samples: int) -> None:
    if n_times != n_samples:
        raise Refusal(f"{path}: {n_times} times in {times.name} for {n_samples} samples: the file is cut or mixed up")


def _attributes(data: h5py.Dataset) -> dict[str, Any]:
    """Return attributes of file, groups and data set, the nearest last."""
    found: dict[str, Any] = dict(data.file.attrs)
    parent, chain = data.parent, []
    while parent.name != "/":
        chain.append(dict(parent.attrs))
        parent = parent.parent
    for attributes in [*reversed(chain), dict(data.attrs)]:
        found |= attributes
    return found


def _first(attributes: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    for name in names:
        if name in attributes:
            value = attributes[name]
            return value.decode() if isinstance(value, bytes) else value
    return None


def _epoch(text: Any) -> float | None:
    if not isinstance(text, str):
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()

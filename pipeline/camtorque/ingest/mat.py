"""MATLAB files: v5 to v7.2 with scipy, v7.3 (which is HDF5) with h5py.

``channel`` is a variable, or a field of the struct that ``group`` names; ``time_channel`` likewise. Without times the
declared rate holds.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, whosmat

from camtorque.config import ChannelSpec
from camtorque.ingest import hdf5
from camtorque.ingest.columns import with_times
from camtorque.ingest.formats import first_bytes, is_hdf5
from camtorque.ingest.raw import ArraySource, FileChannel, RawChannel, RawFile, refusing
from camtorque.ingest.timebase import time_base
from camtorque.ingest.zlib_check import checked_size
from camtorque.records import Finding, Refusal
from camtorque.units import did_you_mean

HEAD = 128
COMPRESSED, MATRIX = 15, 14


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read variables of a MATLAB file."""
    if is_hdf5(first_bytes(path)):
        return hdf5.read(path, specs, hint)
    check_mat(path)
    names = {spec.group or spec.channel for spec in specs}
    names |= {spec.group or spec.time_channel for spec in specs if spec.time_channel}
    with refusing(path, "MATLAB v5"):
        variables = loadmat(str(path), variable_names=sorted(names), squeeze_me=False, struct_as_record=True)
    channels, findings = [], []
    for spec in specs:
        channel, more = _channel(path, variables, spec)
        channels.append(channel)
        findings += more
    return RawFile(tuple(channels), tuple(findings))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the variables, and the fields of structs, that hold one number per sample."""
    if is_hdf5(first_bytes(path)):
        return hdf5.channels(path)
    check_mat(path)
    with refusing(path, "MATLAB v5"):
        variables = loadmat(str(path), squeeze_me=False, struct_as_record=True)
    found: list[FileChannel] = []
    for name, value in variables.items():
        fields = getattr(getattr(value, "dtype", None), "names", None) or ()
        if name.startswith("__"):
            continue
        members = [(name, field, value[field].ravel()[0]) for field in fields if value.size] or [("", name, value)]
        for group, member, array in members:
            samples = np.asarray(array)
            if samples.dtype.kind in "fiu" and 1 < samples.size == max(samples.shape):
                source = ArraySource(samples.ravel())
                found.append(FileChannel(group, member, "", source.n_samples, None, "", source))
    return with_times(found)


def check_mat(path: Path) -> None:
    """Follow the elements of a v5 file to its end; unpack the compressed ones for their checksum."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(HEAD)
        mark = head[126:128]
        if len(head) < HEAD or mark not in (b"IM", b"MI"):
            raise Refusal(f"{path}: the first {HEAD} bytes are not a MATLAB v5 header; save the file again")
        order = "<" if mark == b"IM" else ">"
        position = HEAD
        while position < size:
            file.seek(position)
            tag = file.read(8)
            kind, length = struct.unpack(order + "II", tag) if len(tag) == 8 else (0, 0)
            if kind not in (COMPRESSED, MATRIX) or position + 8 + length > size:
                raise Refusal(
                    f"{path}: the variable at byte {position} is no whole MATLAB element, the file has {size} bytes: "
                    "it is "
                    "cut or damaged; save it again"
                )
            if kind == COMPRESSED:
                checked_size(file, length, f"{path}: compressed variable at byte {position}")
            position += 8 + length


def _channel(path: Path, variables: dict[str, Any], spec: ChannelSpec) -> tuple[RawChannel, list[Finding]]:
    where = f"{path.name} {spec.group}.{spec.channel}".replace(" .", " ")
    samples = _numbers(path, variables, spec.group, spec.channel)
    source = ArraySource(samples)
    if not spec.time_channel:
        start = spec.start_time if spec.start_time is not None else 0.0
        return RawChannel(spec.channel, "", source, start, spec.sample_rate), []
    times = _numbers(path, variables, spec.group, spec.time_channel)
    if times.size != samples.size:
        raise Refusal(f"{where}: {times.size} times for {samples.size} samples; save both from one recording")
    base = time_base(ArraySource(times), spec.sample_rate, where)
    raw = RawChannel(spec.channel, "", source, base.start, base.rate, None, base.breaks, base.break_steps)
    return raw, list(base.findings)


def _numbers(path: Path, variables: dict[str, Any], group: str, name: str) -> np.ndarray:
    own = {key: value for key, value in variables.items() if not key.startswith("__")}
    value = own.get(group or name)
    if group and value is not None:
        fields = value.dtype.names or ()
        if name not in fields:
            hint = did_you_mean(name, fields)
            raise Refusal(
                f"{path}: struct {group!r} has no field {name!r}{hint}; there are {', '.join(fields) or 'none'}"
            )
        value = value[name].ravel()[0] if value.size else None
    if value is None:
        names = _variable_names(path)
        hint = did_you_mean(group or name, names)
        raise Refusal(f"{path}: no variable {group or name!r}{hint}; there are {', '.join(names) or 'none'}")
    array = np.asarray(value)
    if array.dtype.kind not in "fiu" or array.size != max(array.shape, default=0) or not array.size:
        raise Refusal(f"{path}: {name!r} is {array.dtype} of shape {array.shape}, expected one row of numbers")
    return array.ravel()


def _variable_names(path: Path) -> tuple[str, ...]:
    with refusing(path, "MATLAB v5"):
        return tuple(name for name, _, _ in whosmat(str(path)))

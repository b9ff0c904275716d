"""MATLAB files: v5 to v7.2 with scipy, v7.3 (which is HDF5) with h5py.

``channel`` is a variable, or a field of the struct that ``group`` names (``rec.Torque`` for one within another);
``time_channel`` likewise. Without times a rate beside the channel (``fs``, ``SampleRate``) or the declared one holds.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, whosmat
from scipy.io.matlab import MatlabOpaque

from camtorque.config import ChannelSpec
from camtorque.ingest import hdf5
from camtorque.ingest.columns import with_times
from camtorque.ingest.formats import first_bytes, is_hdf5
from camtorque.ingest.header import time_unit
from camtorque.ingest.raw import ArraySource, FileChannel, RawChannel, RawFile, read_each, refusing
from camtorque.ingest.stamps import agreed_rate, read_stamps
from camtorque.ingest.zlib_check import checked_size
from camtorque.records import Finding, Refusal
from camtorque.units import did_you_mean, unit_factor

HEAD = 128
COMPRESSED, MATRIX = 15, 14


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read variables of a MATLAB file."""
    if is_hdf5(first_bytes(path)):
        return hdf5.read(path, specs, hint)
    check_mat(path)
    names = {(spec.group or spec.channel).partition(".")[0] for spec in specs}
    names |= {(spec.group or spec.time_channel).partition(".")[0] for spec in specs if spec.time_channel}
    with refusing(path, "MATLAB v5"):
        variables = loadmat(str(path), variable_names=sorted(names), squeeze_me=False, struct_as_record=True)
    members = _members(variables)
    return read_each(path, "MATLAB v5", specs, lambda spec: _channel(path, members, spec))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the variables, and the fields of structs, that hold one number per sample."""
    if is_hdf5(first_bytes(path)):
        return hdf5.channels(path)
    check_mat(path)
    with refusing(path, "MATLAB v5"):
        variables = loadmat(str(path), squeeze_me=False, struct_as_record=True)
    members = _members(variables)
    found: list[FileChannel] = []
    for (group, member), value in members.items():
        samples = np.asarray(value)
        if samples.dtype.kind in hdf5.KINDS and 1 < samples.size == max(samples.shape):
            source, beside = ArraySource(samples.ravel()), _beside(members, group)
            rate, unit = beside.get("rate"), str(beside.get("unit", ""))
            found.append(FileChannel(group, member, unit, source.n_samples, rate, "", source))
    if not found:
        raise Refusal(f"{path}: holds no variable of one number per sample; {_kinds(variables)}")
    return with_times(found)


def _members(variables: Mapping[str, Any]) -> dict[tuple[str, str], Any]:
    """Return (struct, name) -> value of variables and fields of structs, however deep: ("rec.Torque", "Data").

    Columns of a matrix are fields of it: ("Data", "column 2").
    """
    found: dict[tuple[str, str], Any] = {}

    def add(group: str, name: str, value: Any) -> None:
        fields = getattr(getattr(value, "dtype", None), "names", None) or ()
        if not fields or isinstance(value, MatlabOpaque):
            found[group, name] = value
            matrix = np.squeeze(value) if isinstance(value, np.ndarray) else np.empty(0)
            columns = hdf5.columns_of(matrix) if matrix.dtype.kind in hdf5.KINDS else ()
            place = f"{group}.{name}".strip(".")
            for number, column in enumerate(columns):
                found[place, column] = np.take(matrix, number, int(np.argmin(matrix.shape)))
            return
        inner = f"{group}.{name}".strip(".")
        for number, item in enumerate(value.ravel(), start=1):
            place = inner if value.size == 1 else f"{inner}({number})"
            for field in fields:
                add(place, field, item[field])

    for name, value in variables.items():
        if not name.startswith("__"):
            add("", name, value)
    return found


def _beside(members: Mapping[tuple[str, str], Any], group: str) -> dict[str, Any]:
    """Return rate and unit that stand beside a channel in its struct (or, the rate, beside all variables)."""
    told: dict[str, Any] = {}
    for place in dict.fromkeys(("", group)):
        for (other, name), value in members.items():
            array, plain = np.asarray(value), re.sub(r"[ _]", "", name).lower()
            if other != place or array.size != 1:
                continue
            if plain in hdf5.RATE_NAMES and array.dtype.kind in "fiu" and float(array.ravel()[0]) > 0.0:
                told["rate"] = float(array.ravel()[0])
            if plain in hdf5.UNIT_NAMES and place and array.dtype.kind == "U":
                told["unit"] = str(array.ravel()[0])
    return told


def _kinds(variables: Mapping[str, Any]) -> str:
    """Say what the variables are and how to store them."""
    own = {name: value for name, value in variables.items() if not name.startswith("__")}
    if any(isinstance(value, MatlabOpaque) for value in variables.values()):
        return hdf5.MATLAB_OBJECT.format(", ".join(name for name in own) or "a variable")
    shown = ", ".join(f"{name} {np.asarray(value).shape}" for name, value in list(own.items())[:5]) or "it is empty"
    return f"{shown}; store each channel as a variable or as a column of one, such as torque = Data(:,2)"


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


def _channel(path: Path, members: Mapping[tuple[str, str], Any], spec: ChannelSpec) -> tuple[RawChannel, list[Finding]]:
    where = f"{path.name} {spec.group}.{spec.channel}".replace(" .", " ")
    samples = _numbers(path, members, spec.group, spec.channel)
    source, beside = ArraySource(samples), _beside(members, spec.group)
    unit = str(beside.get("unit", ""))
    if not spec.time_channel:
        start = spec.start_time if spec.start_time is not None else 0.0
        rate, findings = agreed_rate(
            beside.get("rate", spec.sample_rate), spec.sample_rate, where, 1e-9, "the file says"
        )
        return RawChannel(spec.channel, unit, source, start, rate), list(findings)
    times = _numbers(path, members, spec.group, spec.time_channel)
    if times.size != samples.size:
        raise Refusal(f"{where}: {times.size} times for {samples.size} samples; save both from one recording")
    factor = unit_factor(time_unit(spec.time_channel) or "s", "time", where)
    stamps = read_stamps(ArraySource(times), spec.sample_rate, where, to_seconds=factor)
    return stamps.channel(spec.channel, unit, source), list(stamps.findings)


def _numbers(path: Path, members: Mapping[tuple[str, str], Any], group: str, name: str) -> np.ndarray:
    value = members.get((group, name))
    if value is None:
        fields = [field for place, field in members if place == group and group]
        if fields:
            hint = did_you_mean(name, fields)
            raise Refusal(f"{path}: struct {group!r} has no field {name!r}{hint}; there are {', '.join(fields)}")
        names = _variable_names(path)
        hint = did_you_mean(group or name, names)
        raise Refusal(f"{path}: no variable {group or name!r}{hint}; there are {', '.join(names) or 'none'}")
    array = np.asarray(value)
    if array.dtype.kind not in hdf5.KINDS or array.size != max(array.shape, default=0) or not array.size:
        matrix = f"{group}.{name}".strip(".")
        columns = [field for place, field in members if place == matrix]
        hint = f"; name a column of it: group = {matrix!r}, channel = {columns[0]!r}" if columns else ""
        raise Refusal(f"{path}: {name!r} is {array.dtype} of shape {array.shape}, expected one row of numbers{hint}")
    return array.ravel()


def _variable_names(path: Path) -> tuple[str, ...]:
    with refusing(path, "MATLAB v5"):
        return tuple(name for name, _, _ in whosmat(str(path)))

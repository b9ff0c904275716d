"""Arrays by name, as MATLAB and NumPy store them -> channels: variables, fields of structs, columns of matrices.

``channel`` is a variable, or a field of the struct (column of the matrix) that ``group`` names; ``time_channel``
likewise. Without it a rate beside the channel (``fs``, ``SampleRate``) holds, else times beside it (``t``, ``Time``),
else the declared rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest import hdf5
from camtorque.ingest.columns import time_beside, times_beside
from camtorque.ingest.header import time_unit
from camtorque.ingest.listing import with_times
from camtorque.ingest.raw import ArraySource, FileChannel, RawChannel
from camtorque.ingest.stamps import agreed_rate
from camtorque.records import Finding, Refusal
from camtorque.units import did_you_mean

Members = Mapping[tuple[str, str], Any]
"""(struct, name) -> value."""


def listed(members: Members) -> tuple[FileChannel, ...]:
    """Return the members that hold one number per sample."""
    found: list[FileChannel] = []
    for (group, member), value in members.items():
        samples = np.asarray(value)
        if samples.dtype.kind in hdf5.KINDS and 1 < samples.size == max(samples.shape):
            source, near = ArraySource(samples.ravel()), beside(members, group)
            unit, rate = near.get("unit", ""), near.get("rate")
            found.append(FileChannel(group, member, unit, source.n_samples, rate, "", source))
    return with_times(found)


def members_of(variables: Mapping[str, Any]) -> dict[tuple[str, str], Any]:
    """Return (struct, name) -> value of variables and fields of structs, however deep: ("rec.Torque", "Data").

    Columns of a matrix are fields of it: ("Data", "column 2").
    """
    found: dict[tuple[str, str], Any] = {}

    def add(group: str, name: str, value: Any) -> None:
        fields = getattr(getattr(value, "dtype", None), "names", None) or ()
        inner = f"{group}.{name}".strip(".")
        if not fields:
            found[group, name] = value
            matrix = np.squeeze(value) if isinstance(value, np.ndarray) else np.empty(0)
            columns = hdf5.columns_of(matrix) if matrix.dtype.kind in hdf5.KINDS else ()
            for number, column in enumerate(columns):
                found[inner, column] = np.take(matrix, number, int(np.argmin(matrix.shape)))
            return
        for number, item in enumerate(value.ravel(), start=1):
            place = inner if value.size == 1 else f"{inner}({number})"
            for field in fields:
                add(place, field, item[field])

    for name, value in variables.items():
        if not name.startswith("__"):
            add("", name, value)
    return found


def beside(members: Members, group: str) -> dict[str, Any]:
    """Return rate and unit stored beside a channel in its struct (or, the rate, beside all variables)."""
    found: dict[str, Any] = {}
    for place in dict.fromkeys(("", group)):
        for (other, name), value in members.items():
            array = np.asarray(value)
            if other != place or array.size != 1:
                continue
            kind, only = array.dtype.kind, array.ravel()[0]
            if is_rate_name(name) and kind in "fiu" and only > 0:
                found["rate"] = float(only)
            if hdf5.plain(name) in hdf5.UNIT_NAMES and place and kind == "U":
                found["unit"] = str(only)
    return found


def is_rate_name(name: str) -> bool:
    """Tell a variable that by its name holds a sampling rate."""
    return hdf5.plain(name) in hdf5.RATE_NAMES


def channel_of(
    path: Path, members: Members, spec: ChannelSpec, names: tuple[str, ...], specs: tuple[ChannelSpec, ...]
) -> tuple[RawChannel, tuple[Finding, ...]]:
    """Return a channel; ``names`` are the variables of the file, ``specs`` all that is read of it.

    Raises
    ------
    Refusal : no such variable or field, one that is no row of numbers, or times of another length
    """
    where = f"{path.name} {spec.group}.{spec.channel}".replace(" .", " ")
    samples = _numbers(path, members, (spec.group, spec.channel), names)
    source, near = ArraySource(samples), beside(members, spec.group)
    unit = near.get("unit", "")
    time_channel = spec.time_channel or ("" if "rate" in near else _times(members, spec, samples.size, specs))
    if not time_channel:
        rate, findings = agreed_rate(near.get("rate", spec.sample_rate), spec.sample_rate, where, "the file says")
        return RawChannel(spec.channel, unit, source, spec.start_time or 0.0, rate), findings
    times = _numbers(path, members, (spec.group, time_channel), names)
    if times.size != samples.size:
        raise Refusal(f"{where}: {times.size} times for {samples.size} samples; save both from one recording")
    stamps, stamp = times_beside(ArraySource(times), time_unit(time_channel), spec, where)
    return stamps.channel(spec.channel, unit, source, stamp), stamps.findings


def _times(members: Members, spec: ChannelSpec, n_samples: int, specs: tuple[ChannelSpec, ...]) -> str:
    """Return the name of the times that stand beside a channel, "" where there are none."""
    same = {
        name: value
        for (group, name), value in members.items()
        if group == spec.group and np.size(value) == n_samples and np.asarray(value).dtype.kind in hdf5.KINDS
    }
    taken = {other.channel for other in specs if other.group == spec.group}
    return time_beside(same, taken, lambda name: ArraySource(np.asarray(same[name]).ravel()))


def _numbers(path: Path, members: Members, place: tuple[str, str], names: tuple[str, ...]) -> np.ndarray:
    (group, name), value = place, members.get(place)
    if value is None:
        fields = [field for other, field in members if other == group and group]
        if fields:
            hint = did_you_mean(name, fields)
            raise Refusal(f"{path}: struct {group!r} has no field {name!r}{hint}; there are {', '.join(fields)}")
        hint = did_you_mean(group or name, names)
        raise Refusal(f"{path}: no variable {group or name!r}{hint}; there are {', '.join(names) or 'none'}")
    array = np.asarray(value)
    if array.dtype.kind not in hdf5.KINDS or array.size != max(array.shape, default=0) or not array.size:
        matrix = f"{group}.{name}".strip(".")
        columns = [field for other, field in members if other == matrix]
        hint = f"; name a column of it: group = {matrix!r}, channel = {columns[0]!r}" if columns else ""
        raise Refusal(f"{path}: {name!r} is {array.dtype} of shape {array.shape}, expected one row of numbers{hint}")
    return array.ravel()

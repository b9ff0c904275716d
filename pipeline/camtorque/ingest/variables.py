"""Arrays by name, as MATLAB and NumPy store them -> channels: variables, fields of structs, columns of matrices.

``channel`` is a variable, or a field of the struct (column of the matrix) that ``group`` names; ``time_channel``
likewise. Without it a rate beside the channel (``fs``, ``SampleRate``) holds, else times beside it (``t``, ``Time``),
else the declared rate.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest import hdf5
from camtorque.ingest.columns import time_beside
from camtorque.ingest.raw import ArraySource, FileChannel, RawFile
from camtorque.ingest.stored import Stored, listing_of, plain, read_stored
from camtorque.records import Refusal
from camtorque.units import did_you_mean

Members = Mapping[tuple[str, str], np.ndarray]
"""(struct, name) -> values."""


def read_variables(
    path: Path, kind: str, variables: Mapping[str, Any], names: tuple[str, ...], specs: tuple[ChannelSpec, ...]
) -> RawFile:
    """Return the channels that a recording names; ``names`` are all variables of the file, read or not."""
    members = members_of(variables)

    def beside(group: str, name: str) -> Stored:
        return Stored(group, name, "", ArraySource(_numbers(path, members, (group, name), names)))

    def find(group: str, name: str) -> Stored:
        item = _stored(members, group, name, _numbers(path, members, (group, name), names))
        return replace(item, beside=partial(beside, group))

    return read_stored(path, kind, specs, find)


def listed(variables: Mapping[str, Any]) -> tuple[FileChannel, ...]:
    """Return the variables and their members that hold one number per sample."""
    members = members_of(variables)
    return listing_of(
        _stored(members, group, name, samples.ravel())
        for (group, name), samples in members.items()
        if samples.dtype.kind in hdf5.KINDS and 1 < samples.size == max(samples.shape)
    )


def _stored(members: Members, group: str, name: str, samples: np.ndarray) -> Stored:
    """Return a channel with the rate and the unit that stand beside it."""
    near = beside(members, group)

    def times(taken: Container[str]) -> str:
        same = {
            other: ArraySource(values.ravel())
            for (place, other), values in members.items()
            if place == group and values.size == samples.size and values.dtype.kind in hdf5.KINDS
        }
        return time_beside(same, taken, same.__getitem__, name)

    start, date, findings = hdf5.begun_at(near.get("start"), f"{group}.{name}".strip("."))
    return Stored(
        group, name, near.get("unit", ""), ArraySource(samples), near.get("rate"), start, time_beside=times,
        dates=() if date is None else ((0, date),), findings=findings,
    )  # fmt: skip


def members_of(variables: Mapping[str, Any]) -> dict[tuple[str, str], np.ndarray]:
    """Return (struct, name) -> values of variables and fields of structs, however deep: ("rec.Torque", "Data").

    Columns of a matrix are fields of it: ("Data", "column 2").
    """
    found: dict[tuple[str, str], np.ndarray] = {}

    def add(group: str, name: str, value: Any) -> None:
        array, inner = np.asarray(value), f"{group}.{name}".strip(".")
        for number, item in enumerate(array.ravel() if array.dtype.names else (), start=1):
            place = inner if array.size == 1 else f"{inner}({number})"
            for field in array.dtype.names or ():
                add(place, field, item[field])
        if not array.dtype.names:
            found[group, name] = array
            matrix = np.squeeze(array)
            for number, column in enumerate(hdf5.columns_of(matrix) if matrix.dtype.kind in hdf5.KINDS else ()):
                found[inner, column] = np.take(matrix, number, int(np.argmin(matrix.shape)))

    for name, value in variables.items():
        if not name.startswith("__"):
            add("", name, value)
    return found


def beside(members: Members, group: str) -> dict[str, Any]:
    """Return rate, unit and start stored beside a channel in its struct (or, the rate, beside all variables)."""
    found: dict[str, Any] = {}
    for place in dict.fromkeys(("", group)):
        for (other, name), array in members.items():
            if other != place or array.size != 1:
                continue
            kind, only, known_by = array.dtype.kind, array.ravel()[0], plain(name)
            if is_rate_name(name) and kind in "fiu" and only > 0:
                found["rate"] = float(only) if known_by in hdf5.RATE_NAMES else 1.0 / float(only)
            if known_by in (*hdf5.START_NAMES, *hdf5.STAMP_NAMES) and place and kind in "fiuU":
                found["start"] = only.item()
            if known_by in hdf5.UNIT_NAMES and place and kind == "U":
                found["unit"] = str(only)
    return found


def is_rate_name(name: str) -> bool:
    """Tell a variable that by its name holds a sampling rate, or the time from sample to sample [s]."""
    return plain(name) in (*hdf5.RATE_NAMES, *hdf5.STEP_NAMES)


def _numbers(path: Path, members: Members, place: tuple[str, str], names: tuple[str, ...]) -> np.ndarray:
    (group, name), array = place, members.get(place)
    if array is None:
        fields = [field for other, field in members if other == group and group]
        if fields:
            hint = did_you_mean(name, fields)
            raise Refusal(f"{path}: struct {group!r} has no field {name!r}{hint}; there are {', '.join(fields)}")
        array_of = [other for other, _ in members if other.startswith(f"{group}(")] if group else []
        if array_of:
            shown = ", ".join(dict.fromkeys(array_of))
            raise Refusal(f"{path}: {group!r} is an array of structs; name one of {shown} as group")
        hint = did_you_mean(group or name, names)
        raise Refusal(f"{path}: no variable {group or name!r}{hint}; there are {', '.join(names) or 'none'}")
    if array.dtype.kind not in hdf5.KINDS or array.size != max(array.shape, default=0) or not array.size:
        matrix = f"{group}.{name}".strip(".")
        columns = [field for other, field in members if other == matrix]
        hint = f"; name a column of it: group = {matrix!r}, channel = {columns[0]!r}" if columns else ""
        raise Refusal(f"{path}: {name!r} is {array.dtype} of shape {array.shape}, expected one row of numbers{hint}")
    return array.ravel()

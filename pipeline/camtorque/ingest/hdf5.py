"""HDF5 with h5py; MAT v7.3 is HDF5 and goes the same way.

The rate is an attribute of the data set, its group or the file; or the times are a data set of their own.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.cells import seconds_of_date
from camtorque.ingest.columns import time_beside
from camtorque.ingest.hdf5_heaps import check_chunks, check_heaps
from camtorque.ingest.header import column_number, numbered_name
from camtorque.ingest.raw import CallSource, FileChannel, RawFile, refuse_bomb, refusing
from camtorque.ingest.stamps import date_of
from camtorque.ingest.stored import Stored, listing_of, plain, read_stored, unused_scales
from camtorque.records import Finding, Refusal
from camtorque.units import did_you_mean, unit_factor

RATE_NAMES = ("sampleratehz", "samplingratehz", "samplerate", "samplingrate", "samplingfrequency", "samplefrequency",
              "samplingfreq", "ratehz", "fshz", "fs", "abtastrate", "abtastfrequenz", "messrate")  # fmt: skip
STEP_NAMES = ("wfincrement", "timesteps", "dts", "dt", "ts", "deltat", "tinterval", "sampleinterval",
              "samplinginterval", "abtastintervall")  # fmt: skip
START_NAMES = ("t0s", "starttimes", "wfstartoffset", "t0", "tstart")
COLUMN_NAMES = ("columns", "columnnames", "names", "channels", "channelnames", "fields", "labels")
UNIT_NAMES = ("unit", "units", "unitstring", "einheit")
"""Attributes in small letters without blanks and underscores."""
MOST_COLUMNS = 64
"""A matrix of more columns, or of as many columns as rows, is no log of channels."""
MATLAB_OBJECT = (
    "{} is a MATLAB object (a table, timetable or timeseries), which only MATLAB reads: save its columns there as "
    "variables; a timetable: T = timetable2table(TT); T.(1) = seconds(T.(1) - T.(1)(1)); s = table2struct(T, "
    "'ToScalar', true); save('run.mat', '-struct', 's'); a timeseries: t = TS.Time; torque = squeeze(TS.Data); "
    "save('run.mat', 't', 'torque')"
)
OBJECT_MARK = "MATLAB_object_decode"
"""Attribute of what MATLAB alone can decode."""
KINDS = "fiub"
"""Numbers, and levels that are true or false."""
STAMP_NAMES = ("starttime", "wfstarttime", "datetime", "start")
LATEST_START = 1.0e6
"""A number below is a start in seconds, not a date [s]."""


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read channels of an HDF5 file in slices."""
    check_heaps(path)
    with refusing(path, "HDF5"), h5py.File(path, "r") as file:

        def beside(group: str, name: str) -> Stored:
            data, field = _find(file, path, group, name)
            return _stored(path, data, field, (group, name), data.attrs)  # a group states the unit of what is measured

        def find(group: str, name: str) -> Stored:
            data, field = _find(file, path, group, name)
            item = _stored(path, data, field, (group, name), _attributes(data, _rates_in(data.parent)))
            findings = () if field else _scale_findings(path, data)
            return replace(item, beside=partial(beside, group), findings=(*item.findings, *findings))

        return read_stored(path, "HDF5", specs, find)


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the data sets that hold one number per sample, rates as their attributes or times say."""
    check_heaps(path)
    found: list[Stored] = []
    with refusing(path, "HDF5"), h5py.File(path, "r") as file:
        names = _data_sets(file)
        rates_in = cache(lambda group: _rates_in(file[group]))  # once a group of maybe thousands
        for name in names:
            data = file[name]
            if name.startswith("#") or OBJECT_MARK in data.attrs:
                continue  # MATLAB keeps objects below names that begin so
            if sum(size != 1 for size in data.shape) != 1 and not columns_of(data):
                continue
            group, _, last = name.rpartition("/")
            attributes = _attributes(data, rates_in(group or "/"))
            for field in _fields(data) or ([""] if data.dtype.kind in KINDS else []):
                found.append(_stored(path, data, field, (name, field) if field else (group, last), attributes))
        if not found:
            raise Refusal(f"{path}: holds no data set of one number per sample; {_kinds(file, names)}")
        return listing_of(found)


def _stored(
    path: Path, data: h5py.Dataset, field: str, place: tuple[str, str], attributes: Mapping[str, Any]
) -> Stored:
    """Return a channel at a place of the file, with what the attributes say of it."""
    rate, step, start = (_stated(path, data, attributes, names) for names in (RATE_NAMES, STEP_NAMES, START_NAMES))
    if rate is None and step is not None:
        rate = 1.0 / step if step else math.inf
    moment, date, findings = begun_at(_first(attributes, STAMP_NAMES), f"{path.name} {data.name}")
    return Stored(
        *place, _unit(attributes, data, field), _source(path, data, field), rate, moment if start is None else start,
        dates=() if date is None else ((0, date),),
        time_beside=partial(_time_beside, path, data, field, place[1]), findings=findings,
    )  # fmt: skip


def _stated(path: Path, data: h5py.Dataset, attributes: Mapping[str, Any], names: tuple[str, ...]) -> float | None:
    """Return the number that an attribute of one of some names states, None where there is none."""
    value = _first(attributes, names)
    try:
        number, _, unit = str(value).strip().partition(" ")
        kind = "frequency" if names is RATE_NAMES else "time"
        factor = unit_factor(unit.strip(), kind, data.name) if unit else 1.0
        return None if value is None else float(number) * factor
    except (Refusal, ValueError):
        named = ", ".join(name for name in attributes if plain(name) in names)
        raise Refusal(
            f"{path}: data set {data.name}: the attribute {named} is {value!r:.40}, expected a number in Hz or s; "
            "correct it or take it out"
        ) from None


def _fields(data: h5py.Dataset) -> list[str]:
    """Return the fields of a table, or the columns of a matrix, that hold numbers."""
    if data.dtype.names:
        return [name for name in data.dtype.names if data.dtype[name].kind in KINDS]
    return [name for name in columns_of(data) if data.dtype.kind in KINDS]


def columns_of(data: Any) -> tuple[str, ...]:
    """Return the names of a matrix' columns, along its short axis: as an attribute names them, else by their place."""
    shape = [size for size in data.shape if size != 1]
    if len(shape) != 2 or data.dtype.names or not min(shape) <= MOST_COLUMNS < max(shape):
        return ()
    texts = _texts(next((v for k, v in getattr(data, "attrs", {}).items() if plain(k) in COLUMN_NAMES), ()))
    if len(set(texts)) == min(shape) and all(isinstance(item, str) and item for item in texts):
        return tuple(texts)
    return tuple(map(numbered_name, range(min(shape))))


def _texts(value: Any) -> list[Any]:
    """Return the values of an attribute, texts decoded."""
    return [item.decode() if isinstance(item, bytes) else item for item in np.asarray(value).ravel().tolist()]


def _column(columns: tuple[str, ...], field: str) -> int:
    """Return the place of a column that is named, or counted ("column 2"); 0 where there is none to choose."""
    return columns.index(field) if field in columns else column_number(field) or 0


def _unit(attributes: Mapping[str, Any], data: h5py.Dataset, field: str) -> str:
    """Return the unit of a data set, or of its column where an attribute has one for each; "" where none is stated."""
    columns = data.dtype.names or columns_of(data)
    stated = _first(attributes, UNIT_NAMES)
    texts = _texts("" if stated is None else stated)
    if field:
        number = _column(columns, field)
        texts = texts[number : number + 1] if len(texts) == len(columns) > 1 else []
    return str(texts[0]) if len(texts) == 1 else ""


def _kinds(file: h5py.File, names: list[str]) -> str:
    """Say what data sets there are and how to store them."""
    objects = [name for name, item in file.items() if OBJECT_MARK in item.attrs]
    if objects:
        return MATLAB_OBJECT.format(", ".join(objects[:5]))
    linked: list[str] = []
    file.visititems_links(lambda _, link: linked.append(link.filename) if isinstance(link, h5py.ExternalLink) else None)
    if linked and not names:
        return f"it has links to {', '.join(dict.fromkeys(linked))}: name such a file in its place"
    refers = [name for name in names if file[name].dtype.kind == "O"]
    if refers and any(name.startswith("#") for name in names):  # where MATLAB keeps what they refer to
        return f"{', '.join(refers[:5])}: an array of structs, or of cells; store each channel as a variable of its own"
    shown = ", ".join(f"{name} {file[name].shape}" for name in names[:5]) or "it is empty"
    return f"{shown}; store each channel as a data set of its own, a field of a compound one or a column of a matrix"


def _time_beside(path: Path, data: h5py.Dataset, field: str, name: str, taken: Container[str]) -> str:
    if field:
        return time_beside(_fields(data), taken, lambda other: _source(path, data, other), field)
    sets = {other: item for other, item in data.parent.items() if isinstance(item, h5py.Dataset)}
    same = [other for other, item in sets.items() if item.size == data.size and item.dtype.kind in KINDS]
    group, part, own = name.rpartition("/")  # a recording may name a path within the group
    found = time_beside(same, taken, lambda other: _source(path, sets[other], ""), own)
    return found and f"{group}{part}{found}"


def _find(file: h5py.File, path: Path, group: str, name: str) -> tuple[h5py.Dataset, str]:
    """Return a data set, and the field or column where ``group`` names a compound one or a matrix ("" otherwise)."""
    key = f"{group}/{name}".strip("/")
    for named in filter(None, (key, group)):
        if isinstance(file.get(named), h5py.Dataset) and OBJECT_MARK in file[named].attrs:
            raise Refusal(f"{path}: {MATLAB_OBJECT.format(named)}")
    table = file.get(group) if group else None
    if isinstance(table, h5py.Dataset):
        columns = table.dtype.names or columns_of(table)
        place = column_number(name)
        if name in columns or (columns and not table.dtype.names and place is not None and place < len(columns)):
            return table, name
        held = ", ".join(columns)
        raise Refusal(
            f"{path}: {group!r} has no column {name!r}{did_you_mean(name, columns)}; there are {held or 'none'}"
        )
    item = file.get(key)
    if isinstance(item, h5py.Dataset) and item.file.id != file.id:
        raise Refusal(
            f"{path}: {key!r} is a link to {item.name} of another file; name that one in recording.toml: "
            f"file = {Path(item.file.filename).name!r}, channel = {item.name.lstrip('/')!r}"
        )
    if isinstance(item, h5py.Dataset):
        return item, ""
    names = _data_sets(file)
    shown = ", ".join(names[:12]) or "none"
    raise Refusal(f"{path}: no data set {key!r}{did_you_mean(key, tuple(names))}; there are {shown}")


def _data_sets(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    return names


def _source(path: Path, data: h5py.Dataset, field: str) -> CallSource:
    columns = () if data.dtype.names else columns_of(data)
    if (data.dtype[field] if field and not columns else data.dtype).kind not in KINDS:
        raise Refusal(f"{path}: data set {data.name} holds {data.dtype}, expected numbers")
    _refuse_unstored(path, data)
    long = [axis for axis, size in enumerate(data.shape) if size != 1]
    if columns and field:
        long.sort(key=lambda axis: -data.shape[axis])
    elif len(long) > 1 or not data.shape:
        hint = f"; name a column of it: group = {data.name.strip('/')!r}, channel = {columns[0]!r}" if columns else ""
        raise Refusal(f"{path}: data set {data.name} has shape {data.shape}, expected one row of samples{hint}")
    number = _column(columns, field)
    factor, offset = _scale(data)
    is_scaled, blank = (factor, offset) != (1.0, 0.0), _blank(data)
    key, axis, shape = data.name, (long[0] if long else 0), data.shape

    def call(start: int, stop: int) -> np.ndarray:
        other = long[1] if len(long) > 1 else -1
        place = tuple(slice(start, stop) if n == axis else number if n == other else 0 for n in range(len(shape)))
        with h5py.File(path, "r") as file:
            samples = file[key][place]
        if field and not columns:
            return np.asarray(samples[field])
        scaled = samples * factor + offset if is_scaled else samples
        return np.where(np.isin(samples, blank), np.nan, scaled) if blank else scaled

    return CallSource(int(shape[axis]), call, path, "HDF5")


def _refuse_unstored(path: Path, data: h5py.Dataset) -> None:
    """Refuse a data set that declares samples which the file does not store: nothing was ever written there."""
    declared, stored = int(data.size) * data.dtype.itemsize, int(data.id.get_storage_size())
    if declared and not stored:
        raise Refusal(f"{path}: data set {data.name} declares {data.size} samples, the file stores none of them")
    refuse_bomb(declared, stored, f"{path}: data set {data.name}")
    if data.chunks is not None and declared:
        check_chunks(path, data)


def _rates_in(group: h5py.Group) -> dict[str, Any]:
    """Return the rates that a group holds as data sets of one number."""
    sets = {name: group[name] for name in group if plain(name) in RATE_NAMES}
    return {name: item[()] for name, item in sets.items() if isinstance(item, h5py.Dataset) and item.size == 1}


def _attributes(data: h5py.Dataset, beside: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes of file, groups and data set, the nearest last; ``beside``: the rates of its own group."""
    found = dict(beside)
    chain = [data]
    while chain[-1].parent.name != "/":
        chain.append(chain[-1].parent)
    for item in reversed(chain):
        found |= dict(item.attrs)
    return dict(data.file.attrs) | found


def _first(attributes: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    known = {plain(name): value for name, value in attributes.items()}
    value = next((known[name] for name in names if name in known), None)
    value = value.ravel()[0] if isinstance(value, np.ndarray) and value.size == 1 else value
    return value.decode() if isinstance(value, bytes) else value


def _scale_findings(path: Path, data: h5py.Dataset) -> tuple[Finding, ...]:
    """Tell attributes that look like a scale and follow no convention: nobody says whether they are applied already.

    Raises
    ------
    Refusal : beside whole numbers, which are hardly scaled
    """
    unused = unused_scales(data.attrs, data.dtype)
    if not unused:
        return ()
    text = (
        f"data set {data.name} holds {data.dtype} and the attribute {unused}, which is not applied: write the values "
        "scaled, or name it scale_factor (and add_offset)"
    )
    if data.dtype.kind in "iu":
        raise Refusal(f"{path}: {text}")
    return (Finding("scale_not_applied", "warning", text, path.name),)


def _scale(data: h5py.Dataset) -> tuple[float, float]:
    """Return factor and offset by the attributes of the CF conventions (netCDF), 1 and 0 where there are none."""
    factor, offset = (
        np.ravel(data.attrs.get(name, usual))[0] for name, usual in (("scale_factor", 1), ("add_offset", 0))
    )
    return float(factor), float(offset)


def _blank(data: h5py.Dataset) -> list[float]:
    """Return the stored values that stand for missing samples by the CF conventions."""
    values = (
        value for name in ("_FillValue", "missing_value") for value in np.ravel(data.attrs.get(name, ())).tolist()
    )
    return [value for value in values if isinstance(value, int | float)]


def begun_at(value: Any, where: str) -> tuple[float | None, float | None, tuple[Finding, ...]]:
    """Return the start [s] or the date [s since 1970] that an attribute states, and a warning where it is neither."""
    try:
        if isinstance(value, str):
            return None, seconds_of_date(value), ()
        number = math.nan if value is None else float(value)
    except (TypeError, ValueError):
        number = math.inf
    date = next((found for scale in (1.0, 1e3, 1e6, 1e9) if (found := date_of(number / scale))), None)
    if date is not None or value is None:
        return None, date, ()
    if abs(number) < LATEST_START:
        return number, None, ()
    text = f"{value!r:.40} is said to be its start, expected a date as 2025-10-01T10:00:00 or seconds; it is not used"
    return None, None, (Finding("start_not_read", "warning", text, where),)

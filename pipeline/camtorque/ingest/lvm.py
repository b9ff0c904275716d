"""LabVIEW measurement files (.lvm): a header that states separator, decimal sign, units and step, then columns.

NI, "Specification for the LabVIEW Measurement File": two blocks that end in ``***End_of_Header***``, the second one per
segment of data. A file of several segments is refused: its rows do not share one time.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from camtorque.config import ChannelSpec
from camtorque.ingest.cells import header_date
from camtorque.ingest.csv_layout import SNIFF_BYTES, CsvLayout, encoding_of, sniff, text_pieces
from camtorque.ingest.csv_log import channels_of, read_table
from camtorque.ingest.header import is_number
from camtorque.ingest.raw import FileChannel, RawFile, missing_samples
from camtorque.records import Refusal

END = "***End_of_Header***"
TIME = "X_Value"
"""Name of a column of times."""
CLOCK = ("Date", "Time")
"""Keys of a segment's start, 2024/05/01 and 12:03:04.123456."""
UNITS = {"volts": "V", "volt": "V", "seconds": "s", "newton-meters": "N m", "pascals": "Pa", "degrees celsius": "degC"}
"""LabVIEW writes units out."""


Segment = dict[str, list[str]]
"""The header of one segment: key -> fields, one per channel, empty ones between."""


def _shared(segment: Segment, key: str, path: Path) -> float | None:
    """Return a number that all channels share, None where the key is not there."""
    found = {field.replace(",", ".") for field in segment.get(key, []) if field}
    if len(found) > 1 and len({float(field) for field in found if is_number(field)}) != 1:
        raise Refusal(f"{path}: {key} differs between channels ({', '.join(sorted(found))}); export them apart")
    return _largest(segment, key, path) if found else None


def _largest(segment: Segment, key: str, path: Path) -> float:
    """Return the largest number of the channels, 0 where the key is not there."""
    fields = [field for field in segment.get(key, []) if field]
    try:
        return max((float(field.replace(",", ".")) for field in fields), default=0.0)
    except ValueError as error:
        raise Refusal(f"{path}: {key} is {fields[0]!r:.40}, expected a number") from error


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read columns of a LabVIEW measurement file."""
    segment = _segment(path)
    result = read_table(path, _layout(path, segment, tuple(spec.channel for spec in specs)), specs, hint)
    found = max(channel.source.n_samples for channel in result.channels)
    missing = missing_samples(found, _largest(segment, "Samples", path), path.name)
    return RawFile(result.channels, (*result.findings, *missing))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the columns of a LabVIEW measurement file."""
    return channels_of(path, _layout(path, _segment(path), ()))


def _date(segment: Segment) -> float | None:
    """Return when all channels began [s since 1970], None where nothing says so, or they began apart."""
    days, clocks = (filter(None, segment.get(key, [])) for key in CLOCK)
    begun = {f"start {day} {clock}" for day, clock in zip(days, clocks, strict=False)}
    return header_date(list(begun)) if len(begun) == 1 else None


def _layout(path: Path, segment: Segment, wanted: tuple[str, ...]) -> CsvLayout:
    layout = sniff(path, wanted or (TIME,))
    # a column of times comes before all channels or before each of them, whether it is filled or not
    times = [number for number, name in enumerate(layout.names) if name == TIME]
    labels = [UNITS.get(unit.lower(), unit) for unit in segment.get("Y_Unit_Label", [])]
    others = [number for number in range(layout.n_columns) if number not in times]
    # the key stands below the first time, so that each label stands above its column
    aligned = [labels[number - 1] if 0 < number <= len(labels) else "" for number in others]
    stated = aligned if 0 in times and sum(map(bool, aligned)) == sum(map(bool, labels)) else list(filter(None, labels))
    units = dict.fromkeys(times, "s") | dict(zip(others, stated, strict=False))
    if not any(stated):
        units |= {number: layout.units[number] for number in others}
    found = tuple(units.get(number, "") for number in range(layout.n_columns))
    layout = replace(layout, units=found, surplus=(), header_date=_date(segment))
    if any(layout.first_row[number] for number in times):
        return replace(layout, header_rate=None)
    step, start = (_shared(segment, key, path) for key in ("Delta_X", "X0"))
    names = tuple("" if number in times else name for number, name in enumerate(layout.names))
    return replace(layout, names=names, header_rate=1.0 / step if step else None, start=start)


def _segment(path: Path) -> Segment:
    text, ends, cut = "", 0, ""
    for number, piece in enumerate(text_pieces(path, SNIFF_BYTES)):
        shown = piece.decode(encoding_of(piece), errors="replace")
        joined = cut + shown  # the border of two pieces may cut a mark
        ends, cut = ends + joined.count(END), joined[1 - len(END) :]
        text += shown if number == 0 else ""
    if ends != 2:
        raise Refusal(
            f"{path}: holds {max(ends - 1, 0)} segments of data, expected one; write one file per measurement, "
            "or export the segment as CSV"
        )
    lines = text.partition(END)[2].partition(END)[0].splitlines()
    separator = "," if "\tComma" in text or "Separator,Comma" in text else "\t"
    rows = [[field.strip() for field in line.split(separator)] for line in lines]
    return {row[0]: row[1:] for row in rows if row and row[0]}

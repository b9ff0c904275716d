"""Parquet and Feather (Arrow) with pyarrow, an optional extra: columns by name, units from the field's metadata.

pyarrow makes room for whatever a file states: what it claims to unpack to is looked at before anything is unpacked. Of
the page headers of Parquet (thrift, compact protocol; parquet-format, "PageHeader") the sizes and the number of values
are read, and held against the footer. Arrow unpacks each buffer to the size that its first eight bytes claim; where the
buffers lie is stated in the flatbuffer of the batch's message (format/Message.fbs of Arrow), of which four fields are
read.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.cells import LEVELS
from camtorque.ingest.columns import columns_of, raw_file
from camtorque.ingest.csv_layout import CsvLayout
from camtorque.ingest.header import name_and_unit
from camtorque.ingest.listing import listed
from camtorque.ingest.raw import ArraySource, FileChannel, RawFile, refuse_bomb, refusing
from camtorque.records import Refusal, SampleSource, require
from camtorque.units import UNITS, is_known_unit

UNIT_KEYS = (b"unit", b"units")
ROWS_OF_NAMES = re.compile(r"^\('(?P<name>[^']+)', '(?P<unit>[^']*)'\)$")
"""A column of pandas with a row of names and one of units."""
HEAD_BYTES = 4096
"""A page header with its statistics is smaller."""
UNPACKED, PACKED, DATA, DATA_2, COUNT = 2, 3, 5, 8, 1
"""Fields of PageHeader, and of its data page headers."""
STRUCT, LISTS, TEXT, FIXED = 12, (9, 10), 8, {1: 0, 2: 0, 3: 1, 7: 8}
"""Kinds of fields in the compact protocol; true, false, byte and double with their bytes."""
FIRST_MESSAGE = 8
"""Bytes of the magic before it."""
HEADER, BUFFERS, COMPRESSION, DICTIONARY_DATA = 2, 2, 3, 1
"""Places of fields: header of Message; buffers and compression of RecordBatch; data of DictionaryBatch."""


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read columns of a Parquet or Feather file."""
    layout, schema = _layout(path)
    _refuse_no_numbers(path, layout, schema, specs)
    wanted = {number for place in columns_of(path, layout, specs) for number in place if number is not None}
    return raw_file(path, layout, _sources(path, schema, sorted(wanted)), specs)


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the columns of numbers and levels."""
    layout, schema = _layout(path)
    return listed(path, layout, _sources(path, schema, [n for n, name in enumerate(layout.names) if name]))


def _library(path: Path) -> Any:
    require(("pyarrow",), f"{path}: reading Parquet or Feather", "tables")
    import pyarrow.feather
    import pyarrow.parquet

    return pyarrow


def _is_parquet(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4) == b"PAR1"


def _layout(path: Path) -> tuple[CsvLayout, Any]:
    """Return the layout of a file that unpacks to no more than it states, and its schema."""
    library = _library(path)
    with refusing(path, "Parquet or Feather"):
        if _is_parquet(path):
            with library.parquet.ParquetFile(path) as file:
                schema, rows = file.schema_arrow, file.metadata.num_rows
                refuse_bomb(8 * rows * max(len(schema), 1), path.stat().st_size, f"{path}: {rows} rows")
                refuse_lying_pages(path, file.metadata)
                texts = _texts(library, schema)
                levels = _levels(texts, islice(file.iter_batches(1, columns=texts), 1))
        else:
            refuse_feather_bomb(path, library)
            with library.memory_map(str(path)) as memory:
                file = library.ipc.open_file(memory)
                schema = file.schema
                levels = _levels(_texts(library, schema), map(file.get_batch, range(min(file.num_record_batches, 1))))
    names, units, first = [], [], []
    kinds = library.types
    for item in schema:
        tests = (kinds.is_floating, kinds.is_integer, kinds.is_boolean, kinds.is_decimal)
        number = any(test(item.type) for test in tests)
        stamp, span = kinds.is_timestamp(item.type), kinds.is_duration(item.type)
        name, unit = _name_and_unit(item.name)
        stated = next((item.metadata[key].decode() for key in UNIT_KEYS if key in (item.metadata or {})), unit)
        names.append(name if number or stamp or span or item.name in levels else "")
        units.append("s" if span else "" if stamp else stated)
        first.append("2000-01-01T00:00:00" if stamp else "0")
    return CsvLayout("", "", ".", 0, 0, tuple(names), tuple(units), tuple(first), None), schema


def _name_and_unit(column: str) -> tuple[str, str]:
    """Return name and unit of a column, of one with both in rows of their own, or of one that brackets are all of."""
    if (match := ROWS_OF_NAMES.match(column)) and is_known_unit(match["unit"]):
        return match["name"], match["unit"]
    name, unit = name_and_unit(column)
    return (name, unit) if name else (column, "")


def _is_text(kinds: Any, found: Any) -> bool:
    held = found.value_type if kinds.is_dictionary(found) else found
    return bool(kinds.is_string(held) or kinds.is_large_string(held))


def _texts(library: Any, schema: Any) -> list[str]:
    return [item.name for item in schema if _is_text(library.types, item.type) and schema.names.count(item.name) == 1]


def _levels(texts: list[str], rows: Iterable[Any]) -> set[str]:
    """Return the columns of texts, pandas' categories among them, whose first one is a number or a word for a level."""
    first = [row for row in rows if row.num_rows] if texts else []
    return {name for row in first for name in texts if _level(row.column(name)[0].as_py()) is not None}


def _level(word: str | None) -> float | None:
    """Return the number that a text is, as databases export it, or the level that a word names."""
    if word is None:
        return None
    try:
        return float(word)
    except ValueError:
        return LEVELS.get(word.strip().lower())


def _refuse_no_numbers(path: Path, layout: CsvLayout, schema: Any, specs: tuple[ChannelSpec, ...]) -> None:
    """Refuse a channel whose column is there and holds texts, or what else is no number."""
    absent = {spec.channel for spec in specs} - set(layout.names)
    for item, name in zip(schema, layout.names, strict=True):
        if item.name in absent and not name:
            raise Refusal(
                f"{path}: column {item.name!r} holds {item.type}, expected numbers or a level in the first row "
                f"({', '.join(LEVELS)}): convert them, in pandas by df[{item.name!r}].astype(float) or, if they are "
                f"other words, df[{item.name!r}].astype(str).map({{'open': 1.0, 'shut': 0.0}})"
            )


def _sources(path: Path, schema: Any, wanted: list[int]) -> dict[int, SampleSource]:
    library = _library(path)
    with refusing(path, "Parquet or Feather"):
        columns = _columns(path, library, schema.names, wanted)
        return {number: ArraySource(_numbers(library, columns[number])) for number in wanted}


def _columns(path: Path, library: Any, names: list[str], wanted: list[int]) -> dict[int, Any]:
    """Return columns by their place, since several may share a name."""
    if _is_parquet(path):
        chosen = list(dict.fromkeys(names[number] for number in wanted))
        options = {"page_checksum_verification": True, "read_dictionary": chosen}
        with library.parquet.ParquetFile(path, **options) as file:
            table = file.read(columns=chosen)
        places = [number for name in chosen for number, other in enumerate(names) if other == name]
        return dict(zip(places, table.columns, strict=True))
    with library.memory_map(str(path)) as memory:
        options = library.ipc.IpcReadOptions(included_fields=wanted)
        table = library.ipc.open_file(memory, options=options).read_all()
    table.validate(full=True)  # a torn header states missing values whose marks lie beyond the file
    return dict(zip(sorted(wanted), table.columns, strict=True))


def _numbers(library: Any, column: Any) -> np.ndarray:
    """Return a column as numbers: a date as seconds since 1970, a duration in seconds, no value or level as nan."""
    if _is_text(library.types, column.type):
        words = column.dictionary_encode().combine_chunks()
        levels = np.array([*map(_level, words.dictionary.to_pylist()), None], dtype=np.float64)
        return levels[words.indices.cast(library.int64()).fill_null(-1).to_numpy()]
    if library.types.is_timestamp(column.type) or library.types.is_duration(column.type):
        return column.cast(library.int64()).to_numpy().astype(np.float64) * UNITS["time"][column.type.unit]
    if library.types.is_decimal(column.type):
        column = column.cast(library.float64())
    return column.to_numpy().astype(np.float64)


def refuse_lying_pages(path: Path, metadata: Any) -> None:
    """Refuse a file whose pages unpack to a bomb, or hold another number of values than its footer states."""
    size, total = path.stat().st_size, 0
    with path.open("rb") as file:
        for number in range(metadata.num_row_groups):
            group = metadata.row_group(number)
            for column_number in range(group.num_columns):
                column, values = group.column(column_number), 0
                for unpacked, count in _pages(path, file, column, size):
                    total, values = total + unpacked, values + count
                    refuse_bomb(total, size, f"{path}: column {column.path_in_schema}")
                repeated = metadata.schema.column(column_number).max_repetition_level > 0
                if values != column.num_values or (values != group.num_rows and not repeated):
                    raise Refusal(
                        f"{path}: the footer states {group.num_rows} rows, the pages of column "
                        f"{column.path_in_schema} {values}; the file is damaged, export it again"
                    )


def _pages(path: Path, file: BinaryIO, column: Any, size: int) -> Iterator[tuple[int, int]]:
    """Yield unpacked size and number of values of each page of a column."""
    starts = [column.data_page_offset, column.dictionary_page_offset or 0]
    position = min(start for start in starts if start > 0)
    end = position + column.total_compressed_size
    while position < end:
        file.seek(position)
        head = file.read(HEAD_BYTES)
        try:
            fields, used = _thrift(head, 0)
            packed, unpacked = fields[PACKED], fields[UNPACKED]
            count = next((fields[kind][COUNT] for kind in (DATA, DATA_2) if kind in fields), 0)
        except (KeyError, IndexError, TypeError) as error:
            raise Refusal(f"{path}: the page at byte {position} has no header; the file is damaged") from error
        if packed < 0 or unpacked < 0 or position + used + packed > size:
            raise Refusal(f"{path}: the page at byte {position} states {packed} bytes of {size}; the file is damaged")
        yield unpacked, count
        position += used + packed


def _thrift(data: bytes, at: int, depth: int = 0) -> tuple[dict[int, Any], int]:
    """Return the fields of a struct and where it ends."""
    fields: dict[int, Any] = {}
    number = 0
    while data[at]:
        step, kind = data[at] >> 4, data[at] & 15
        at += 1
        if not step:
            number, at = _zigzag(data, at)
        number += step
        fields[number], at = _thrift_field(data, at, kind, depth)
    return fields, at + 1


def _thrift_field(data: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    if kind in FIXED:
        return None, at + FIXED[kind]
    if kind == TEXT:
        length, at = _varint(data, at)
        return None, at + length
    if kind == STRUCT and depth < 4:
        return _thrift(data, at, depth + 1)
    if kind in LISTS:
        raise TypeError("a page header holds no lists")
    return _zigzag(data, at)


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while data[at] & 128 and shift < 63:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
    return value | data[at] << shift, at + 1


def _zigzag(data: bytes, at: int) -> tuple[int, int]:
    value, at = _varint(data, at)
    return (value >> 1) ^ -(value & 1), at


def refuse_feather_bomb(path: Path, library: Any) -> None:
    """Refuse a Feather file whose batches claim to unpack to what no signal packs from; ``library`` is pyarrow."""
    size, total, batches = path.stat().st_size, 0, 0
    with library.memory_map(str(path)) as memory:
        listed = library.ipc.open_file(memory).num_record_batches
        memory.seek(FIRST_MESSAGE)
        for message in library.ipc.MessageReader.open_stream(memory):
            if message.type in ("record batch", "dictionary batch"):
                batches += message.type == "record batch"
                total += _unpacked(message)
                refuse_bomb(total, size, f"{path}: batch {batches}")
    if listed > batches:
        raise Refusal(f"{path}: its index lists {listed} batches, found {batches}; export the log again")


def _unpacked(message: Any) -> int:
    data, body = message.metadata.to_pybytes(), message.body
    batch = _child(data, struct.unpack_from("<I", data, 0)[0], HEADER)
    if message.type == "dictionary batch":
        batch = _child(data, batch, DICTIONARY_DATA)
    start = _child(data, batch, BUFFERS)
    count = struct.unpack_from("<I", data, start)[0]
    places = [struct.unpack_from("<qq", data, start + 4 + 16 * k) for k in range(count)]
    if not _place(data, batch, COMPRESSION):
        return sum(length for _, length in places)
    claims = [struct.unpack_from("<q", body, offset)[0] if length >= 8 else 0 for offset, length in places]
    # -1 marks a buffer that was left as it is
    return sum(claim if claim >= 0 else length for claim, (_, length) in zip(claims, places, strict=True))


def _place(data: bytes, table: int, place: int) -> int:
    """Return where a field of a flatbuffer table lies, 0 where it is not there."""
    layout = table - struct.unpack_from("<i", data, table)[0]
    end = struct.unpack_from("<H", data, layout)[0]
    at = 4 + 2 * place
    offset = struct.unpack_from("<H", data, layout + at)[0] if at < end else 0
    return table + offset if offset else 0


def _child(data: bytes, table: int, place: int) -> int:
    """Return where the table or vector that a field refers to begins."""
    at = _place(data, table, place)
    if not at:
        raise ValueError("a batch without its header")
    return int(at + struct.unpack_from("<I", data, at)[0])

"""What the pages of a Parquet file claim to unpack to, held against its footer before anything is unpacked.

pyarrow makes room for whatever a page header states, and the footer may say something else. Of a header (thrift,
compact protocol; parquet-format, "PageHeader") the sizes and the number of values are read.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from camtorque.ingest.zlib_check import refuse_bomb
from camtorque.records import Refusal

HEAD_BYTES = 4096
"""A page header with its statistics is smaller."""
UNPACKED, PACKED, DATA, DATA_2, COUNT = 2, 3, 5, 8, 1
"""Fields of PageHeader, and of its data page headers."""
STRUCT, LISTS, TEXT, DOUBLE, BOOLS, BYTE = 12, (9, 10), 8, 7, (1, 2), 3
"""Kinds of fields in the compact protocol."""


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
            fields, used = _struct(head, 0)
            packed, unpacked = fields[PACKED], fields[UNPACKED]
            count = next((fields[kind][COUNT] for kind in (DATA, DATA_2) if kind in fields), 0)
        except (KeyError, IndexError, TypeError) as error:
            raise Refusal(f"{path}: the page at byte {position} has no header; the file is damaged") from error
        if packed < 0 or unpacked < 0 or position + used + packed > size:
            raise Refusal(f"{path}: the page at byte {position} states {packed} bytes of {size}; the file is damaged")
        yield unpacked, count
        position += used + packed


def _struct(data: bytes, at: int, depth: int = 0) -> tuple[dict[int, Any], int]:
    """Return the fields of a struct and where it ends."""
    fields: dict[int, Any] = {}
    number = 0
    while data[at]:
        step, kind = data[at] >> 4, data[at] & 15
        at += 1
        if not step:
            number, at = _zigzag(data, at)
        number += step
        fields[number], at = _field(data, at, kind, depth)
    return fields, at + 1


def _field(data: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    if kind in BOOLS:
        return None, at
    if kind in (BYTE, DOUBLE):
        return None, at + (1 if kind == BYTE else 8)
    if kind == TEXT:
        length, at = _number(data, at)
        return None, at + length
    if kind == STRUCT and depth < 4:
        return _struct(data, at, depth + 1)
    if kind in LISTS:
        raise TypeError("a page header holds no lists")
    return _zigzag(data, at)


def _number(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while data[at] & 128 and shift < 63:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
    return value | data[at] << shift, at + 1


def _zigzag(data: bytes, at: int) -> tuple[int, int]:
    value, at = _number(data, at)
    return (value >> 1) ^ -(value & 1), at

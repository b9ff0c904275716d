"""Small tables of the calibration folder: comment lines, one header line, columns of numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camtorque.ingest.csv_layout import HEAD_BYTES, split_row, utf16
from camtorque.ingest.xlsx import table_rows
from camtorque.records import Array, Refusal
from camtorque.units import is_known_unit

LARGEST_FILE = 4 * 2**20
"""Ten columns of 36 000 rows [bytes]."""


@dataclass(frozen=True)
class SmallTable:
    """Columns by name, comment text, the number of decimals written in each column, units of a unit row."""

    path: Path
    columns: dict[str, Array]
    comment: str
    decimals: dict[str, int]
    units: dict[str, str]


def read_small_table(path: Path, what: str) -> SmallTable:
    """Read a table: text with comma, semicolon or tab, decimal point or comma; or the only sheet of a workbook.

    Names stand above the numbers, units in a row between them or at the end of the names.
    """
    head = _checked_head(path, what)
    comment, rows = _workbook_rows(path) if head.startswith(b"PK\x03\x04") else _text_rows(path)
    units = rows[1][1] if len(rows) > 1 and any(map(is_known_unit, rows[1][1])) else []
    body = rows[2:] if units else rows[1:]
    if not rows or not body:
        raise Refusal(f"{path}: {what} with {len(body)} rows; expected a header line and rows of numbers")
    names = [field.strip() for field in rows[0][1]]
    if len(set(names)) != len(names):
        raise Refusal(f"{path}: two columns have one name, the header says {', '.join(names)}; rename one")
    values, decimals = [], dict.fromkeys(names, 0)
    for number, fields in body:
        values.append(_numbers(path, number, fields, len(names)))
        for name, field in zip(names, fields, strict=True):
            decimals[name] = max(decimals[name], len(field.partition(".")[2]))
    columns = dict(zip(names, np.array(values).T, strict=True))
    return SmallTable(path, columns, comment, decimals, dict(zip(names, units, strict=False)))


def read_comment(path: Path, what: str) -> str:
    """Return what a table says of itself, without looking at its numbers."""
    head = _checked_head(path, what)
    return _workbook_rows(path)[0] if head.startswith(b"PK\x03\x04") else _comment(_text(path).splitlines())


def _comment(lines: list[str]) -> str:
    return " ".join(line.lstrip("#% ") for line in lines if line.startswith(("#", "%")))


def _text_rows(path: Path) -> tuple[str, list[tuple[int, list[str]]]]:
    """Return the comment, and number and fields of each row of a text."""
    lines = _text(path).splitlines()
    comment = _comment(lines)
    rows = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.startswith(("#", "%"))]
    if not rows:
        return comment, []
    separator = max(";\t,", key=rows[0][1].count)
    split = [(number, split_row(line, separator)) for number, line in rows]
    if separator != ",":
        split[1:] = [(number, [field.replace(",", ".") for field in fields]) for number, fields in split[1:]]
    return comment, split


def _workbook_rows(path: Path) -> tuple[str, list[tuple[int, list[str]]]]:
    """Return the rows of a workbook's only sheet; those above the names, with one cell alone, are the comment."""
    rows = list(enumerate(table_rows(path), start=1))
    first = next((n for n, (_, fields) in enumerate(rows) if sum(map(bool, fields)) > 1), len(rows))
    comment = " ".join(field for _, fields in rows[:first] for field in fields if field)
    return comment, rows[first:]


def _checked_head(path: Path, what: str) -> bytes:
    """Return the first bytes of a table that is there and no larger than a table is."""
    try:
        if not path.is_file():
            raise Refusal(f"{path}: no such file; expected {what} (paths are relative to the file that names it)")
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise Refusal(f"{path}: {size} bytes, {what} has at most {LARGEST_FILE}; is it the right file?")
        with path.open("rb") as file:
            return file.read(8)
    except (OSError, ValueError) as error:
        raise Refusal(f"{str(path)[:200]}: cannot be read ({getattr(error, 'strerror', error)})") from error


def _text(path: Path) -> str:
    data = path.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("utf-16" if utf16(data[:HEAD_BYTES]) else "latin-1", errors="replace")


def _numbers(path: Path, number: int, fields: list[str], expected: int) -> list[float]:
    try:
        values = [float(field) for field in fields]
    except ValueError as error:
        raise Refusal(f"{path} line {number}: {' | '.join(fields)!r:.80} is not a row of numbers") from error
    if len(values) != expected or not all(map(math.isfinite, values)):
        raise Refusal(f"{path} line {number}: {len(values)} finite numbers expected: {expected}, one per column")
    return values

"""Small tables of the calibration folder: comment lines, one header line, columns of numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camtorque.config.absent import no_file, what_is_beside
from camtorque.ingest.csv_layout import HEAD_BYTES, wide_codec
from camtorque.ingest.csv_table import grouped, split_row
from camtorque.ingest.formats import UNREADABLE, ZIP_MAGIC
from camtorque.ingest.header import is_number, name_and_unit
from camtorque.ingest.xlsx import table_rows
from camtorque.records import Array, Refusal
from camtorque.units import did_you_mean, is_known_unit

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

    def column(self, name: str) -> Array:
        """Return a column, or refuse with the names that there are."""
        if name not in self.columns:
            names = tuple(self.columns)
            what = name.rpartition("_")[0]
            same = next((other for other in names if what and other.rpartition("_")[0] == what), "")
            hint = f", convert the values of {same!r}" if same else did_you_mean(name, names)
            raise Refusal(f"{self.path}: no column {name!r}{hint}; there are {', '.join(names)}")
        return self.columns[name]


def read_small_table(path: Path, what: str) -> SmallTable:
    """Read a table: text with comma, semicolon, tab, bar or blanks, decimal point or comma; or a sheet of a workbook.

    Names stand above the numbers, units in a row between them, in brackets or at the end of the names. What stands
    above the names is the comment; a column without a number in its first row is left out.
    """
    comment, rows = commented_rows(path, what)
    first = next((n for n, (_, fields) in enumerate(rows) if n and sum(map(is_number, fields)) > 1), len(rows))
    units = rows[first - 1][1] if first > 1 and any(map(is_known_unit, rows[first - 1][1])) else []
    header = first - 1 - bool(units)
    if first == len(rows):
        header, units = 0, []
    body = rows[first:] if first < len(rows) else rows[1:]
    if not rows or not body:
        raise Refusal(f"{path}: {what} with {len(body)} rows; expected a header line and rows of numbers")
    comment = " ".join([comment, *(" ".join(fields) for _, fields in rows[:header])]).strip()
    fields = [field.strip() for field in rows[header][1]]
    kept = [n for n, field in enumerate(fields) if n >= len(body[0][1]) or not (_is_text(body[0][1][n]) or not field)]
    names, given = _names(path, fields, units)
    values, decimals = [], dict.fromkeys((names[n] for n in kept), 0)
    for number, row in body:
        row = row[: len(fields)] if not any(row[len(fields) :]) else row
        chosen = [row[n] for n in kept] if len(row) == len(fields) else row
        values.append(_numbers(path, number, chosen, len(kept)))
        for name, field in zip(decimals, chosen, strict=True):
            decimals[name] = max(decimals[name], len(field.partition(".")[2]))
    columns = dict(zip(decimals, np.array(values).T, strict=True))
    return SmallTable(path, columns, comment, decimals, given)


def _is_text(field: str) -> bool:
    """Tell a field that is empty or a word without digits, as remarks are: a damaged number is none."""
    return not any(letter.isdigit() for letter in field)


def _names(path: Path, fields: list[str], units: list[str]) -> tuple[list[str], dict[str, str]]:
    """Return the names of the columns and the units that stand in brackets or in a row of their own."""
    plain = [name_and_unit(field) for field in fields]
    names = [name for name, _ in plain]
    given_names = [name for name in names if name]
    if len(set(given_names)) != len(given_names):
        raise Refusal(f"{path}: two columns have one name, the header says {', '.join(names)}; rename one")
    below = (units + [""] * len(names))[: len(names)]
    return names, {name: unit or row for (name, unit), row in zip(plain, below, strict=True) if unit or row}


def _text_rows(path: Path) -> tuple[str, list[tuple[int, list[str]]]]:
    """Return the comment, and number and fields of each row of a text."""
    lines = _text(path).splitlines()
    comment = " ".join(line.lstrip("#% ") for line in lines if line.startswith(("#", "%")))
    rows = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.startswith(("#", "%"))]
    if not rows:
        return comment, []
    separator = _separator(rows[len(rows) // 2][1])
    split = [(number, split_row(line, separator)) for number, line in rows]
    parting = next((sign for sign in ".," if grouped([fields for _, fields in split[1:]], sign)), None)
    # a comma that is left within a field is a decimal sign
    signs = str.maketrans({",": "."} | ({parting: ""} if parting else {}))
    split[1:] = [(number, [field.translate(signs) for field in fields]) for number, fields in split[1:]]
    return comment, [(number, fields) for number, fields in split if any(fields)]


def _separator(line: str) -> str:
    """Return what separates the fields of a line; commas beside semicolons, tabs or bars are decimal signs."""
    for separator in ";\t|":
        fields = split_row(line, separator)
        if len(fields) > 1 and all(is_number(field) or _is_text(field) for field in fields):
            return separator
    found = max(";\t|,", key=line.count)
    return found if line.count(found) else " "


def _workbook_rows(path: Path) -> tuple[str, list[tuple[int, list[str]]]]:
    """Return the rows of a workbook's only sheet; those above the names, with one cell alone, are the comment."""
    rows = list(enumerate(table_rows(path), start=1))
    first = next((n for n, (_, fields) in enumerate(rows) if sum(map(bool, fields)) > 1), len(rows))
    comment = " ".join(field for _, fields in rows[:first] for field in fields if field)
    return comment, rows[first:]


def commented_rows(path: Path, what: str) -> tuple[str, list[tuple[int, list[str]]]]:
    """Return what a table says of itself and its rows; it has to be there and no larger than a table is."""
    try:
        if not path.is_file():
            raise Refusal(
                f"{path}: {no_file(path)}; expected {what} (paths are relative to the file that names it)"
                f"{what_is_beside(path)}"
            )
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise Refusal(f"{path}: {size} bytes, {what} has at most {LARGEST_FILE}; is it the right file?")
        with path.open("rb") as file:
            head = file.read(8)
        if UNREADABLE["gzip"](head):
            raise Refusal(f"{path}: the content is gzip, expected {what} as text or a workbook: unpack it")
    except (OSError, ValueError) as error:
        raise Refusal(f"{str(path)[:200]}: cannot be read ({getattr(error, 'strerror', error)})") from error
    return _workbook_rows(path) if head.startswith(ZIP_MAGIC) else _text_rows(path)


def _text(path: Path) -> str:
    data = path.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode(wide_codec(data[:HEAD_BYTES]) or "latin-1", errors="replace").lstrip("\ufeff")


def _numbers(path: Path, number: int, fields: list[str], expected: int) -> list[float]:
    try:
        values = [float(field) for field in fields]
    except ValueError as error:
        raise Refusal(
            f"{path} line {number}: {' | '.join(fields)!r:.80} is not a row of numbers, expected one in each column; "
            "complete the row or take it out"
        ) from error
    finite = sum(map(math.isfinite, values))
    if not len(values) == finite == expected:
        raise Refusal(
            f"{path} line {number}: found {len(values)} fields, {finite} of them finite numbers, expected {expected} "
            "of these, one per column; complete the row or take it out"
        )
    return values

"""Excel workbooks (.xlsx) with openpyxl, an optional extra: a log as columns of a sheet, or a small table.

``group`` names the sheet; a workbook of one sheet needs none. The names stand in a row above the numbers, units in
brackets or in a row of their own.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import UTC, date, datetime, time, timedelta
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.config.tables import Problems
from camtorque.ingest.cells import LEVELS, is_stamp, unwrapped
from camtorque.ingest.columns import columns_of, raw_file
from camtorque.ingest.csv_layout import CsvLayout
from camtorque.ingest.header import is_number, names_in, names_of
from camtorque.ingest.listing import listed
from camtorque.ingest.raw import ArraySource, FileChannel, RawChannel, RawFile, refuse_bomb, refusing
from camtorque.records import Finding, Refusal, SampleSource, require

HEADER_ROWS = 200
MOST_COLUMNS = 256
"""A sheet may claim 16 384 columns whatever it holds."""
CONVERT = "convert them to numbers in Excel"
Row = tuple[Any, ...]


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read columns of a sheet."""
    problems, found, findings = Problems(), dict[ChannelSpec, RawChannel](), list[Finding]()
    for group in sorted({spec.group for spec in specs}):
        with problems.collecting():
            mine = tuple(spec for spec in specs if spec.group == group)
            rows = _sheet(path, group)
            layout = _layout(path, rows, tuple(spec.channel for spec in mine))
            wanted = {number for place in columns_of(path, layout, mine) for number in place if number is not None}
            _refuse_other_header(path, rows, layout)
            result = raw_file(path, layout, _sources(path, rows, layout, sorted(wanted)), mine)
            found |= dict(zip(mine, result.channels, strict=True))
            findings += result.findings
    problems.raise_any()
    return RawFile(tuple(found[spec] for spec in specs), tuple(findings))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the columns of the sheets."""
    found: list[FileChannel] = []
    for name in sheet_names(path):
        rows = _sheet(path, name)
        if len(rows) > 2:
            layout = _layout(path, rows, ())
            time = layout.time_column("")
            sources = _sources(path, rows, layout, [n for n, item in enumerate(layout.names) if item or n == time])
            found += [replace(channel, group=name) for channel in listed(path, layout, sources)]
    return tuple(found)


def table_rows(path: Path) -> list[list[str]]:
    """Return the rows of the only sheet that holds a table as text, for a small table such as a lift table."""
    sheets = {name: _sheet(path, name) for name in sheet_names(path)}
    tables = [name for name, rows in sheets.items() if sum(sum(map(_is_number, row)) > 1 for row in rows) > 1]
    if len(tables) > 1:
        raise Refusal(f"{path}: {len(tables)} sheets hold numbers ({', '.join(tables)}); leave one in the workbook")
    rows = sheets[tables[0]] if tables else next(iter(sheets.values()))
    return [[_text(cell) for cell in row] for row in rows if any(cell is not None for cell in row)]


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    """Give a workbook whose file is closed whatever is wrong with it."""
    require(("openpyxl",), f"{path}: reading Excel workbooks", "tables")
    library = import_module("openpyxl")
    with refusing(path, "Excel workbook"), zipfile.ZipFile(path) as parts:
        unpacked = sum(part.file_size for part in parts.infolist())
    refuse_bomb(unpacked, path.stat().st_size, f"{path}")
    with path.open("rb") as stream:
        with refusing(path, "Excel workbook"):
            book = library.load_workbook(stream, read_only=True, data_only=True, keep_links=False)
        with closing(book):
            yield book


def sheet_names(path: Path) -> list[str]:
    """Return the names of the sheets."""
    with _open(path) as book:
        return list(book.sheetnames)


def _sheet(path: Path, name: str) -> list[Row]:
    """Return the rows of a sheet, cut behind its last column that holds anything in the first rows."""
    with _open(path) as book:
        names = [sheet for sheet in book.sheetnames if not name or sheet == name]
        if len(names) != 1:
            what = f"{len(names)} sheets; name one as group in recording.toml" if names else f"no sheet {name!r}"
            raise Refusal(f"{path}: {what}; there are {', '.join(book.sheetnames)}")
        with refusing(path, "Excel workbook", name):
            sheet = book[names[0]]
            head = list(islice(sheet.iter_rows(max_col=MOST_COLUMNS, values_only=True), HEADER_ROWS))
            filled = [n for row in head for n, cell in enumerate(row) if cell is not None]
            width = max(filled, default=-1) + 1
            return list(sheet.iter_rows(max_col=max(width, 1), values_only=True))


def _is_number(cell: Any) -> bool:
    return isinstance(cell, (int, float, datetime, time)) and not isinstance(cell, bool)


def _layout(path: Path, rows: list[Row], wanted: tuple[str, ...]) -> CsvLayout:
    first = _below_names(rows, wanted)
    if first is None:
        texts = any(sum(is_number(cell) for cell in row if isinstance(cell, str)) > 1 for row in rows)
        hint = f"; its numbers are stored as text: {CONVERT}" if texts else ""
        raise Refusal(f"{path}: the sheet holds no row of numbers, expected names above rows of numbers{hint}")
    header = [[_text(cell) for cell in row] for row in rows[:first]]
    names, units, _ = names_of(path, header, [_text(cell) for cell in rows[first]], wanted)
    return CsvLayout("", "", ".", first, first, names, units, tuple(_text(cell) for cell in rows[first]), None)


def _below_names(rows: list[Row], wanted: tuple[str, ...]) -> int | None:
    """Return the first row of numbers, without those above a line of names: settings, serial numbers of sensors."""
    data = [_is_data(row) for row in rows[:HEADER_ROWS]]
    first = next((n for n, row in enumerate(rows) if _is_data(row)), None)
    if any(names_in(filter(None, map(_text, row))) & set(wanted) for row in rows[:first]):
        return first  # what stands below is of the log
    for n in range(first or 0, len(data) if first is not None else 0):
        texts = _texts(rows[n])
        is_names = 1 < len(texts) == _filled(rows[n]) and (not wanted or bool(names_in(texts) & set(wanted)))
        if is_names and sum(data[n:]) > sum(data[:n]):
            first = n + data[n:].index(True)
    return first


def _refuse_other_header(path: Path, rows: list[Row], layout: CsvLayout) -> None:
    """Refuse rows of texts that name the columns anew, where rows of numbers stand below."""
    first = layout.data_offset
    for n, row in enumerate(rows[first:], start=first):
        if all(cell is None or isinstance(cell, str) for cell in row) and row not in rows[:first]:
            is_names = 1 < len(_texts(row)) == _filled(row) and names_in(_texts(row)) & set(layout.names)
            if is_names and any(_is_data(below) and not _texts(below) for below in rows[n + 1 :]):
                raise Refusal(f"{path} row {n + 1}: repeats the header in another order, or with other names, so that "
                              "the columns below it are others; split the sheet there")  # fmt: skip


def _texts(row: Row) -> list[str]:
    """Return the cells that are texts, neither times nor levels."""
    return [cell for cell in row if isinstance(cell, str) and not _is_reading(cell)]


def _is_data(row: Row) -> bool:
    """Tell a row of numbers; stamps and levels that are texts count beside them."""
    numbers = sum(map(_is_number, row))
    texts = sum(isinstance(cell, (bool, timedelta)) or (isinstance(cell, str) and _is_reading(cell)) for cell in row)
    return numbers > 0 and (numbers + texts) * 2 > _filled(row)


def _is_reading(text: str) -> bool:
    return text.strip().lower() in LEVELS or is_stamp(text.strip())


def _filled(row: Row) -> int:
    return sum(cell is not None for cell in row)


def _text(cell: Any) -> str:
    if isinstance(cell, datetime):
        return cell.isoformat()
    if isinstance(cell, timedelta):
        return f"{int(cell.total_seconds() // 3600)}:{datetime.min + cell % timedelta(hours=1):%M:%S.%f}"
    return "" if cell is None else str(cell).strip()


def _sources(path: Path, rows: list[Row], layout: CsvLayout, wanted: list[int]) -> dict[int, SampleSource]:
    body = rows[layout.data_offset :]
    while body and not _filled(body[-1]):
        body.pop()
    for number in wanted:
        texts = [row[number] for row in body if isinstance(row[number], str) and is_number(row[number])]
        if 2 * len(texts) > len(body):
            raise Refusal(f"{path}: found the numbers of column {layout.names[number]!r} stored as text, such as "
                          f"{texts[0]!r}, expected numbers: {CONVERT}")  # fmt: skip
    return {number: ArraySource(_column([row[number] for row in body], layout.stamp_kind(number))) for number in wanted}


def _column(cells: list[Any], kind: str) -> np.ndarray:
    """Return a column as numbers; stamps may be texts in some cells or in all."""
    values = np.array([_number(cell) for cell in cells])
    texts = [number for number, cell in enumerate(cells) if isinstance(cell, str)] if kind not in ("", "date") else []
    if texts:
        # pandas costs half a second, which a lift table need not pay
        parser = import_module("camtorque.ingest.stamp_texts")
        values[texts] = parser.seconds_of_texts([cells[number] for number in texts], kind)
    return unwrapped(values, kind)


def _number(cell: Any) -> float:
    """Return a cell as a number: a date in seconds since 1970, times in seconds, levels as 0 and 1, text as nan."""
    if isinstance(cell, datetime):
        return cell.replace(tzinfo=UTC).timestamp()
    if isinstance(cell, time):
        return 3600.0 * cell.hour + 60.0 * cell.minute + cell.second + 1e-6 * cell.microsecond
    if isinstance(cell, timedelta):
        return cell.total_seconds()
    if isinstance(cell, str):
        return LEVELS.get(cell.strip().lower(), float("nan"))
    if isinstance(cell, date) or not isinstance(cell, (int, float)):
        return float("nan")
    return float(cell)

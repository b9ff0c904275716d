"""Small tables of the calibration folder: comment lines, one header line, columns of numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camtorque.ingest.csv_layout import split_row
from camtorque.records import Array, Refusal

LARGEST_FILE = 4 * 2**20
"""Ten columns of 36 000 rows [bytes]."""


@dataclass(frozen=True)
class SmallTable:
    """Columns by name, comment text, and the number of decimals written in each column."""

    path: Path
    columns: dict[str, Array]
    comment: str
    decimals: dict[str, int]


def read_small_table(path: Path, what: str) -> SmallTable:
    """Read a table with comma, semicolon or tab, decimal point or (not with commas between columns) decimal comma."""
    lines = _text(path, what).splitlines()
    comment = " ".join(line.lstrip("#% ") for line in lines if line.startswith(("#", "%")))
    rows = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.startswith(("#", "%"))]
    if len(rows) < 2:
        raise Refusal(f"{path}: {what} with {max(len(rows) - 1, 0)} rows; expected a header line and rows of numbers")
    separator = max(";\t,", key=rows[0][1].count)
    names = split_row(rows[0][1], separator)
    values, decimals = [], dict.fromkeys(names, 0)
    for number, line in rows[1:]:
        fields = [f.replace(",", ".") if separator != "," else f for f in split_row(line, separator)]
        values.append(_numbers(path, number, fields, len(names)))
        for name, field in zip(names, fields, strict=True):
            decimals[name] = max(decimals[name], len(field.partition(".")[2]))
    return SmallTable(path, dict(zip(names, np.array(values).T, strict=True)), comment, decimals)


def _text(path: Path, what: str) -> str:
    try:
        if not path.is_file():
            raise Refusal(f"{path}: no such file; expected {what} (paths are relative to the file that names it)")
        if path.stat().st_size > LARGEST_FILE:
            raise Refusal(
                f"{path}: {path.stat().st_size} bytes, {what} has at most {LARGEST_FILE}; is it the right file?"
            )
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        raise Refusal(f"{str(path)[:200]}: cannot be read ({getattr(error, 'strerror', error)})") from error
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _numbers(path: Path, number: int, fields: list[str], expected: int) -> list[float]:
    try:
        values = [float(field) for field in fields]
    except ValueError as error:
        raise Refusal(f"{path} line {number}: {' | '.join(fields)!r:.80} is not a row of numbers") from error
    if len(values) != expected or not np.all(np.isfinite(values)):
        raise Refusal(f"{path} line {number}: {len(values)} finite numbers expected: {expected}, one per column")
    return values

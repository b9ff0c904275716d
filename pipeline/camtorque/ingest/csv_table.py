"""Where the table of a text begins and what parts it: separator, decimal sign, sign of thousands, rows of numbers."""

from __future__ import annotations

import csv
import math
import re
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from camtorque.ingest.cells import NUMBER, PARTING, THOUSANDS, is_stamp, is_value, is_word
from camtorque.records import Refusal
from camtorque.units import is_known_unit

SNIFF_LINES = 300
"""Lines that tell the layout where they hold any row of numbers."""
SEPARATORS = (";", "\t", "|", ",", " ")
MANY_ROWS = 0.5
"""Share of the lines from which a table of numbers alone needs no look for columns of words."""
EVEN = 0.1
"""A step that differs from the one before by less than this part goes on evenly."""
ODD_NUMBERS = {
    "write the exponent with E in the place of D": re.compile(r"^[+-]?\d*[.,]\d*[dD][+-]?\d+$"),
    "write the unit once, in the header": re.compile(r"^[+-]?\d+([.,]\d+)?([eE][+-]?\d+)? ?[a-zA-Zµ°%][\w./°³*]*$"),
}
"""What to do about numbers as Fortran writes them, and about cells with their unit -> how such a cell looks."""
SIGN_BLANK = re.compile(r"(?<![^\s,;|\"])([+-]) +(?=[\d.])")
"""A sign and blanks before a number, as some loggers write columns of one width."""
NAMES = {";": "semicolon", "\t": "tab", "|": "vertical bar", ",": "comma", " ": "blank"}


def split_row(line: str, separator: str) -> list[str]:
    """Return the fields of a row; blanks separate in any number, quotes hold a separator together."""
    line = line.replace("\N{MINUS SIGN}", "-")
    if separator == " ":
        return line.split()
    if "+ " in line or "- " in line:
        line = SIGN_BLANK.sub(r"\1", line)
    if line.count('"') >= 2:
        with suppress(csv.Error):  # bytes that are no text: the layout is refused for what it lacks
            fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
            return [field.strip().strip('"') for field in fields]
    return [field.strip().strip('"') for field in line.split(separator)]


@dataclass(frozen=True)
class Table:
    """Where the numbers of a text stand.

    Attributes
    ----------
    thousands : sign between thousands, "" for none
    first : number of the first line of numbers
    usual : number of the first line whose blank cells are blank in the rows below, too
    words : columns that hold words, as alarms and remarks, or keys of the file beside its first rows
    """

    separator: str
    decimal: str
    thousands: str
    first: int
    usual: int
    words: frozenset[int] = frozenset()


def find_table(path: Path, lines: list[str], has_more: bool) -> Table:
    """Return the table that explains most lines; ``has_more``: the file goes on below them.

    Raises
    ------
    Refusal : no line is a row of numbers
    """
    found = _best_table(lines[:SNIFF_LINES]) or _best_table(lines)
    if found is None or found[0] < MANY_ROWS * len(lines[:SNIFF_LINES]):
        found = _best_table(lines[:SNIFF_LINES], with_words=True) or found
    if found is None:
        what = "a header but no row of numbers" if any(line.strip() for line in lines) else "blank lines only"
        if len(lines) == 1 and _best_table(lines[0].split("\r")[:SNIFF_LINES]):
            what = "no line end but CR alone, as a CSV for Macintosh has: export with LF or CR LF"
        if odd := _odd_numbers(lines[:SNIFF_LINES]) or _odd_field(lines[:SNIFF_LINES]):
            what += odd
        elif has_more and len(lines) > 1:
            what += f" in its first {len(lines)} lines, none is looked for below: shorten what stands above the numbers"
        raise Refusal(
            f"{path}: holds {what}; expected columns of numbers separated by one of {', '.join(NAMES.values())}"
        )
    return _with_rows_above(_with_thousands(found[1], lines), lines)


def _with_thousands(table: Table, lines: list[str]) -> Table:
    """Tell points or commas that part thousands from decimal ones: a number shows both alike."""
    rows = [split_row(line, table.separator) for line in lines[table.first :]]
    for sign, decimal in ((".", ","), (",", ".")):
        if not table.thousands and table.decimal in (sign, ",") and grouped(rows, sign):
            return replace(table, decimal=decimal, thousands=sign)
    return table


def _with_rows_above(table: Table, lines: list[str]) -> Table:
    """Take in rows above the first one whose blank cells hold keys of the file: their times go on evenly."""
    usual = split_row(lines[table.usual], table.separator)
    beside = frozenset(column for column, field in enumerate(usual) if not field)
    clock = _clock_of(table, [split_row(line, table.separator) for line in lines[table.usual : table.usual + 3]])
    first = table.first
    while beside and clock is not None and first > 0:
        fields, below = (split_row(line, table.separator) for line in lines[first - 1 : first + 1])
        if len(fields) != len(usual) or not all(
            bool(field) and is_value(field, table.decimal, table.thousands)
            for column, field in enumerate(fields)
            if column not in beside
        ):
            break
        step = _number(below[clock[0]], table.decimal) - _number(fields[clock[0]], table.decimal)
        if not abs(step - clock[1]) < EVEN * clock[1]:
            break
        first -= 1
    if first == table.first:
        return table
    rows = [split_row(line, table.separator) for line in lines[table.usual :]]
    full = [row for row in rows if len(row) == len(usual)]
    words = {column for column in beside if not any(NUMBER.match(row[column].replace(",", ".")) for row in full)}
    return replace(table, first=first, words=table.words | words)


def _clock_of(table: Table, rows: list[list[str]]) -> tuple[int, float] | None:
    """Return the first column that rises evenly from row to row, and its step; None where there is none."""
    if len(rows) < 3 or len({len(row) for row in rows}) > 1:
        return None
    for column, fields in enumerate(zip(*rows, strict=True)):
        one, two, three = (_number(field, table.decimal) for field in fields)
        if two - one > 0.0 and abs(three - 2.0 * two + one) < EVEN * (two - one):
            return column, two - one
    return None


def _number(field: str, decimal: str) -> float:
    """Return a number, nan for any other field."""
    plain = field.replace(decimal, ".")
    return float(plain) if NUMBER.match(plain) else math.nan


def _odd_numbers(lines: list[str]) -> str:
    """Name the way in which a line's numbers are written where it is none that is read; "" where there is no such."""
    for number, line in enumerate(lines, start=1):
        for separator in SEPARATORS:
            fields = list(filter(None, split_row(line, separator)))
            for ask, pattern in ODD_NUMBERS.items():
                odd = [field for field in fields if pattern.match(field)]
                if len(odd) > 1 and all(field in odd or is_stamp(field) for field in fields):
                    return f" (line {number} has {odd[-1][:40]!r}: {ask})"
    return ""


def _odd_field(lines: list[str]) -> str:
    """Name the field that keeps a line from being numbers, where most of its fields are; "" where there is none."""
    for number, line in enumerate(lines, start=1):
        for separator in SEPARATORS:
            fields = list(filter(None, split_row(line, separator)))
            odd = [field for field in fields if not is_value(field, ".") and not is_value(field, ",")]
            is_text = all(field.isprintable() and not is_known_unit(field) for field in odd)
            if is_text and 0 < 2 * len(odd) <= len(fields):
                return f" (line {number} has {odd[0][:40]!r}, which is no number or time that is known)"
    return ""


def grouped(rows: list[list[str]], sign: str = ".") -> bool:
    """Tell points that part thousands: all stand before three digits, and numbers without one show that they are none.

    They do where they stand in the same column, or where a comma in another one stands as none between thousands does.
    """
    shown = THOUSANDS[sign].match
    parted = [field for row in rows for field in row if sign in field and not is_stamp(field)]
    if not parted or not all(map(shown, parted)):
        return False
    other = "," if sign == "." else "."
    numbers = (field for row in rows for field in row if other in field and sign not in field and not is_stamp(field))
    if any(NUMBER.match(field.replace(",", ".")) and not THOUSANDS[other].match(field) for field in numbers):
        return True
    columns = zip(*(row for row in rows if len(row) == len(rows[0])), strict=True)
    return any(0 < sum(bool(shown(field)) for field in column) < sum(map(bool, column)) for column in columns)


def _best_table(lines: list[str], *, with_words: bool = False) -> tuple[int, Table] | None:
    """Return how many rows the best table has, and the table; None where no line is a row."""
    best: tuple[tuple[int, int], Table] | None = None
    quoted = any('"' in line for line in lines)
    parting = [sign for sign in PARTING if any(re.search(rf"\d{sign}\d{{3}}", line) for line in lines)]
    for separator in SEPARATORS:
        rows = [split_row(line, separator) for line in lines]
        words = _columns_of_words(rows) if with_words else frozenset[int]()
        if with_words and not words:
            continue
        # a comma that separates is no decimal sign, unless quotes hold the fields together
        signs = [(".", ""), (",", ""), (",", "."), (".", ",")] if separator != "," or quoted else [(".", "")]
        signs += [(decimal, sign) for decimal in {sign for sign, _ in signs} for sign in parting if separator != " "]
        for decimal, thousands in signs:
            counts = [is_row(row, decimal, thousands, words) for row in rows]
            widths = [count for count in counts if count]
            if not widths:
                continue
            usual = max(set(widths), key=widths.count)
            score, first = (widths.count(usual), usual), counts.index(usual)
            if best is None or score > best[0]:
                best = score, Table(separator, decimal, thousands, first, first, words)
    return (best[0][0], best[1]) if best is not None else None


def is_row(fields: list[str], decimal: str, thousands: str, words: frozenset[int]) -> int:
    """Return the number of fields of a data row, 0 for any other line; columns of words may hold any word."""
    numbers = [field for column, field in enumerate(fields) if column not in words]
    none = [field for field in numbers if is_word(field)]
    if len(none) == sum(map(bool, numbers)):
        return 0
    return len(fields) if all(field in none or is_value(field, decimal, thousands) for field in numbers) else 0


def _columns_of_words(rows: list[list[str]]) -> frozenset[int]:
    """Return the columns that hold words without a digit in each of the last rows, beside at least two others."""
    rows = [row for row in rows if any(row)]
    last = rows[len(rows) // 2 :]
    width = len(last[0]) if last else 0
    if any(len(row) != width for row in last):
        return frozenset()
    columns = enumerate(zip(*last, strict=True))
    found = frozenset(column for column, fields in columns if all(_is_plain_word(field) for field in fields))
    return found if width - len(found) > 1 else frozenset()


def _is_plain_word(field: str) -> bool:
    """Tell a word that is neither a number, a time nor damage of one; "" is none, nor a separator."""
    is_text = any(map(str.isalpha, field)) and not any(map(str.isdigit, field))
    return is_text and not is_word(field) and not is_value(field, ".")

"""What a CSV or ASCII log looks like: encoding, separator, decimal sign, header lines, names, units, first data row."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from camtorque.ingest.cells import LEVELS, STAMPS, day_of, header_date, is_value, is_word
from camtorque.ingest.csv_table import NAMES, SNIFF_LINES, Table, find_table, is_row, split_row
from camtorque.ingest.header import MAYBE_TIME, TIME_NAME, column_number, header_rate, is_time_unit, names_in, names_of
from camtorque.records import Finding

SNIFF_BYTES = 1 << 18
BLANK_SEPARATED = re.compile(r"[^\s\[(]\S*(?:\s+[\[(][^\])]*[\])])?|\S+")
"""A name with its unit in brackets, or one word."""
HEAD_BYTES = 4096
MARKS = {b"\xff\xfe\x00\x00": "utf-32-le", b"\x00\x00\xfe\xff": "utf-32-be", b"\xff\xfe": "utf-16-le",
         b"\xfe\xff": "utf-16-be"}  # fmt: skip
"""How a text of more than one byte a character begins."""
FRACTIONS = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "millisecond": 1e-3, "milliseconds": 1e-3}
"""Name or unit of a column behind a stamp in whole seconds that holds their fraction -> seconds."""
WHOLE = re.compile(r":\d\d( ?[AaPp][Mm])?$")
COMMENT = "#%!'\""
MARKED, WORD = ("#", "%"), re.compile(r"[^\W\d_]{2,}")
"""How a remark among the rows begins, and a word in it."""


@dataclass(frozen=True)
class CsvLayout:
    """How to read one file.

    Attributes
    ----------
    data_offset : byte at which the first data row begins
    header_lines : lines before it
    names, units : one per column, units "" where the file says nothing
    first_row : fields of the first data row
    surplus : names that the header has beyond the columns, at its end
    header_rate : sampling rate in the header [Hz], None where there is none
    header_date : date of the start in the header [s since 1970], None where there is none
    thousands : sign between thousands, "" for none
    repeated : lines of the header, which some loggers write anew before each block
    words : numbers of the columns that hold words
    day_first : dates with slashes have their day first, as rows far below say
    spaced : a blank line stands behind each row
    """

    encoding: str
    separator: str
    decimal: str
    data_offset: int
    header_lines: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    first_row: tuple[str, ...]
    header_rate: float | None
    surplus: tuple[str, ...] = ()
    start: float | None = None
    header_date: float | None = None
    thousands: str = ""
    repeated: frozenset[str] = frozenset()
    words: frozenset[int] = frozenset()
    day_first: bool = False
    spaced: bool = False

    @property
    def n_columns(self) -> int:
        """Number of columns."""
        return len(self.names)

    def place(self, name: str) -> int | None:
        """Return the number of a column by its name, or by ``column 3``; None where there is none."""
        if name in self.names:
            return self.names.index(name)
        number = column_number(name)
        return number if number is not None and number < self.n_columns else None

    def time_column(self, declared: str, channels: tuple[str, ...] = (), column: int | None = None) -> int | None:
        """Return the column that holds the time: the declared one, else the one named so, of its unit, of dates.

        Where several do, as in files of pairs, it is the nearest to the left of ``column``.
        """
        if declared:
            return self.place(declared)
        free = [number for number, name in enumerate(self.names) if name not in channels and number not in self.words]
        timed = [number for number in free if is_time_unit(self.units[number]) and self.first_row[number]]
        for found in (
            [number for number in free if TIME_NAME.match(self.names[number])],
            timed if 0 in timed else [],
            [number for number in free if MAYBE_TIME.match(self.names[number])],
        ):
            if found:
                left = [number for number in found if column is not None and number < column]
                return left[-1] if left else found[0]
        dated = [number for number in free if self.stamp_kind(number) not in ("", "date")]
        return dated[0] if len(dated) == 1 else None

    def has_levels(self, column: int) -> bool:
        """Tell a column of words for two levels."""
        return self.first_row[column].lower() in LEVELS

    def date_of(self, column: int) -> float | None:
        """Return the day of the date in the column beside a time of day [s since 1970], None where none stands there.

        A date with slashes has its month first, as with a time behind it.
        """
        for beside in (column - 1, column + 1):
            if 0 <= beside < self.n_columns and self.stamp_kind(beside) == "date":
                return day_of(self.first_row[beside])
        return None

    def fraction_of(self, column: int) -> tuple[int, float] | None:
        """Return the column behind a stamp in whole seconds that holds their fraction, and its unit [s]."""
        beside = column + 1
        whole = self.stamp_kind(column) not in ("", "date", "seconds", "minutes")
        if not whole or beside >= self.n_columns or not WHOLE.search(self.first_row[column]):
            return None
        words = (self.names[beside].lower(), self.units[beside])
        return next(((beside, FRACTIONS[word]) for word in words if word in FRACTIONS), None)

    def stamp_kind(self, column: int | None) -> str:
        """Return the key of `STAMPS` that a column's first field is, "" for a number."""
        field = self.first_row[column] if column is not None else ""
        kind = next((kind for kind, pattern in STAMPS.items() if pattern.match(field)), "")
        return "day first" if kind == "slashes" and self.day_first else kind


def sniff(path: Path, wanted: tuple[str, ...]) -> CsvLayout:
    """Find out the layout of a file; ``wanted`` are names that one header line has to hold."""
    # UTF-16 and 32 come out smaller, and without its mark
    head = b"".join(islice(text_pieces(path, SNIFF_BYTES), 3))[:SNIFF_BYTES]
    encoding = encoding_of(head)
    raw_lines = head.split(b"\n")
    has_more = len(head) == SNIFF_BYTES
    if has_more:
        raw_lines = raw_lines[:-1] or raw_lines
    lines = [line.decode(encoding, errors="replace").rstrip("\r") for line in raw_lines]
    table = _below_names(lines, find_table(path, lines, has_more), wanted)
    header = lines[: table.first]
    body = [split_row(line, table.separator) for line in lines[table.usual : table.usual + SNIFF_LINES]]
    row = [field * (column not in table.words) for column, field in enumerate(_first_fields(body))]
    rows = [_header_fields(line, table.separator, len(row)) for line in header]
    names, units, surplus = names_of(path, rows, row, wanted)
    return CsvLayout(
        encoding=encoding,
        separator=table.separator,
        decimal=table.decimal,
        data_offset=sum(len(line) + 1 for line in raw_lines[: table.first]),
        header_lines=table.first,
        names=names,
        units=units,
        first_row=tuple(row),
        header_rate=header_rate(lines[: table.usual], table.separator),
        header_date=header_date(lines[: table.usual]),
        surplus=surplus,
        thousands=table.thousands,
        repeated=frozenset(line for line in header if line.strip() and not _width(table, line)),
        words=table.words,
        spaced=_is_spaced(lines[table.first : table.first + SNIFF_LINES]),
    )


def _is_spaced(lines: list[str]) -> bool:
    """Tell rows with a blank line behind each."""
    return len(lines) > 3 and all(map(str.strip, lines[::2])) and not any(map(str.strip, lines[1::2]))


def _first_fields(rows: list[list[str]]) -> list[str]:
    """Return the first row, with the first value below in place of a word for none."""
    first = list(rows[0])
    for column in (column for column, field in enumerate(first) if is_word(field)):
        below = (row[column] for row in rows if len(row) == len(first) and not is_word(row[column]))
        first[column] = next(filter(None, below), first[column])
    return first


def _header_fields(line: str, separator: str, n_columns: int) -> list[str]:
    """Return the fields of a line above the data, where single quotes count as double ones.

    Between blanks a unit in brackets belongs to the name before it, and where two blanks part the columns one does not.
    """
    if re.match(r"^'.*'$", line.strip()):
        line = line.replace("'", '"')
    line = line.lstrip("\ufeff")
    if line[:1] in COMMENT or (line[:1] == ";" and separator != ";"):
        line = line.lstrip(COMMENT.replace('"', "") + ";")
        _, key, rest = line.partition(": ")  # "Channels: AI0, AI1"
        line = rest if key and len(split_row(rest, separator)) == n_columns else line
    if separator != " " or '"' in line:
        return split_row(line, separator)
    wide = re.split(r"\s{2,}|\t", line.strip())
    return wide if len(wide) == n_columns else BLANK_SEPARATED.findall(line)


def text_pieces(path: Path, size: int) -> Iterator[bytes]:
    """Yield a text file in pieces of about ``size`` bytes; UTF-16 and 32 come out as UTF-8."""
    with path.open("rb") as file:
        wide = wide_codec(file.read(HEAD_BYTES))
        file.seek(0)
        if not wide:
            while piece := file.read(size):
                yield piece
            return
        decoder = codecs.getincrementaldecoder(wide)(errors="replace")
        while piece := file.read(size):
            yield decoder.decode(piece).lstrip("\ufeff").encode("utf-8")


def wide_codec(head: bytes) -> str:
    """Return the codec of a text of two or four bytes a character: by its mark, or every second zero; "" for others."""
    if marked := next((codec for mark, codec in MARKS.items() if head.startswith(mark)), ""):
        return marked
    if len(head) >= 8 and not any(head[1:64:2]) and all(head[0:64:2]):
        return "utf-16-le"
    return "utf-16-be" if len(head) >= 8 and not any(head[0:64:2]) and all(head[1:64:2]) else ""


def encoding_of(head: bytes) -> str:
    """Return the codec of the beginning of a text."""
    if head.startswith(b"\xef\xbb\xbf"):
        return "utf-8-sig"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # a character may be cut at the end of the stretch
        return "utf-8"
    except UnicodeDecodeError:
        return "cp1252" if not set(head) & {0x81, 0x8D, 0x8F, 0x90, 0x9D} else "latin-1"


def _width(table: Table, line: str) -> int:
    """Return the number of fields of a row of the table, 0 for any other line."""
    return is_row(split_row(line, table.separator), table.decimal, table.thousands, table.words)


def _below_names(lines: list[str], table: Table, wanted: tuple[str, ...]) -> Table:
    """Return the table without rows of numbers above its line of names: settings, serial numbers of sensors.

    A line of names is one of distinct texts, of which one is ``wanted`` where any is, above most of the rows. Rows
    below another line with a wanted name are of the log.
    """
    first = table.first
    lines = lines[: first + SNIFF_LINES]
    widths = [_width(table, line) for line in lines]
    usual = widths[first]
    above = [_header_fields(line, table.separator, usual) for line in lines[:first]]
    heads = [sorted(fields) for fields in above]
    if any(names_in(fields) & set(wanted) for fields in above):
        return table
    for number in range(first, len(lines)):
        if usual == 1 or 2 * widths[:number].count(usual) > widths.count(usual):
            break
        fields = _header_fields(lines[number], table.separator, usual)
        texts = set(_texts(fields, table))
        is_new = len(texts) == usual == len(fields) and sorted(fields) not in heads
        if is_new and (not wanted or names_in(fields) & set(wanted)):
            first = widths.index(usual, number)
            return replace(table, first=first, usual=first)
    return table


def _texts(fields: list[str], of: Table | CsvLayout) -> list[str]:
    """Return the fields that are neither values of a table nor words for none."""
    return [field for field in fields if not is_word(field) and not is_value(field, of.decimal, of.thousands)]


def is_other_header(fields: list[str], layout: CsvLayout) -> bool:
    """Tell a line among the rows that names the columns anew: texts alone, one of them the name of a column."""
    texts = _texts(fields, layout)
    return 1 < len(texts) == layout.n_columns == len(fields) and bool(names_in(texts) & set(layout.names))


def fields_of(text: str, layout: CsvLayout) -> list[str]:
    """Return the fields of a line, without what a separator at its end parts off."""
    fields = split_row(text, layout.separator)
    while layout.separator != " " and len(fields) == layout.n_columns + 1 and not fields[-1]:
        fields.pop()
    return fields


def is_sound_row(fields: list[str], layout: CsvLayout) -> bool:
    """Tell a row with a value in each column."""
    return is_row(fields, layout.decimal, layout.thousands, layout.words) == layout.n_columns


def is_remark(text: str, fields: list[str], layout: CsvLayout) -> bool:
    """Tell a line of another number of fields that is no row: a marker, an event, a line of a footer."""
    if len(fields) == layout.n_columns or not text.isprintable():
        return False
    words = WORD.findall(text)
    return bool(words) and (
        text.lstrip()[:1] in MARKED or (len(words) > 1 and len(_texts(fields, layout)) == len(fields))
    )


def layout_findings(layout: CsvLayout, hint: str, where: str) -> list[Finding]:
    """Tell a hint that does not fit, a header that is too long, blank lines, marks between thousands."""
    words, told = hint.lower(), {}
    separators = {name for name in NAMES.values() if re.search(rf"(?<!decimal ){name}", words)}
    decimals = {sign for word, sign in (("decimal point", "."), ("decimal comma", ",")) if word in words}
    if (separators and NAMES[layout.separator] not in separators) or (decimals and layout.decimal not in decimals):
        found = f"{NAMES[layout.separator]}, decimal {'comma' if layout.decimal == ',' else 'point'}"
        told["csv_dialect_differs"] = f"csv_dialect says {hint!r}, the file is {found}; the file decides"
    if layout.surplus:
        told["csv_header_longer"] = (
            f"the header has {len(layout.surplus)} more name(s) than the rows have fields; the last, "
            f"{', '.join(layout.surplus)}, are taken for empty"
        )
    if layout.spaced:
        told["csv_spaced"] = "a blank line stands behind each row and is left out; numbers of lines do not count them"
    if layout.thousands:
        sign = "a blank" if layout.thousands.isspace() else repr(layout.thousands)
        told["csv_thousands"] = f"{sign} stands between thousands (1{layout.thousands}234 is 1234) and is left out"
    return [Finding(code, "warning", text, where) for code, text in told.items()]

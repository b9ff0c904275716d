"""What a CSV or ASCII log looks like: encoding, separator, decimal sign, header lines, names, units, first data row."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from camtorque.records import Finding, Refusal
from camtorque.units import is_known_unit

SNIFF_BYTES = 1 << 18
SNIFF_LINES = 300
"""Lines that tell the layout where they hold any row of numbers."""
SEPARATORS = (";", "\t", ",", " ")
NAMES = {";": "semicolon", "\t": "tab", ",": "comma", " ": "blank"}
HEAD_BYTES = 4096
UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
COMMENT = "#%!'\""
STAMPS: dict[str, re.Pattern[str]] = {
    "iso": re.compile(r"^\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d([.,]\d+)?(Z|[+-]\d\d:?\d\d)?$"),
    "day first": re.compile(r"^\d{1,2}[.]\d{1,2}[.]\d{4}[ T]+\d\d:\d\d:\d\d([.,]\d+)?$"),
    "slashes": re.compile(r"^\d{1,2}/\d{1,2}/\d{4}[ T]+\d\d:\d\d:\d\d([.,]\d+)?$"),
    "clock": re.compile(r"^\d{1,2}:\d\d:\d\d([.,]\d+)?$"),
    "date": re.compile(r"^\d{4}-\d\d-\d\d$|^\d{1,2}[./]\d{1,2}[./]\d{4}$"),
}
"""Kinds of date and time; a date alone is a column that is skipped."""
NUMBER = re.compile(r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf)$", re.IGNORECASE)
RATE = re.compile(r"(\d[\d.,]*)\W{0,3}(hz|khz|1/s)\b", re.IGNORECASE)
RATE_WORDS = re.compile(r"rate|freq|abtast|sampl", re.IGNORECASE)
TIME_NAME = re.compile(
    r"^(time|zeit|timestamp|time.?stamp|zeitstempel|date.?time|temps|tiempo|x_value|elapsed.?time|time.axis)$",
    re.IGNORECASE,
)
MAYBE_TIME = re.compile(r"^(t|x)$", re.IGNORECASE)
"""Time, unless a column is named outright so, or the recording takes it for a channel."""
BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]$")
SLASH = re.compile(r"^(?P<name>.*\S)\s*/\s+(?P<unit>\S.*)$")


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

    @property
    def n_columns(self) -> int:
        """Number of columns."""
        return len(self.names)

    def time_column(self, declared: str, channels: tuple[str, ...] = ()) -> int | None:
        """Return the column that holds the time: the declared one, else the one named so, else the one of dates."""
        if declared:
            return self.names.index(declared) if declared in self.names else None
        free = [number for number, name in enumerate(self.names) if name not in channels]
        for pattern in (TIME_NAME, MAYBE_TIME):
            found = [number for number in free if pattern.match(self.names[number])]
            if found:
                return found[0]
        dated = [number for number in free if self.stamp_kind(number) not in ("", "date")]
        return dated[0] if len(dated) == 1 else None

    def stamp_kind(self, column: int | None) -> str:
        """Return the key of `STAMPS` that a column's first field is, "" for a number."""
        field = self.first_row[column] if column is not None else ""
        return next((kind for kind, pattern in STAMPS.items() if pattern.match(field)), "")


def split_row(line: str, separator: str) -> list[str]:
    """Return the fields of a row; blanks separate in any number."""
    if separator == " ":
        return line.split()
    return [field.strip().strip('"') for field in line.split(separator)]


def sniff(path: Path, wanted: tuple[str, ...]) -> CsvLayout:
    """Find out the layout of a file; ``wanted`` are names that one header line has to hold."""
    head = b""
    for piece in text_pieces(path, SNIFF_BYTES):
        head += piece
        if len(head) >= SNIFF_BYTES:
            break
    head = head[:SNIFF_BYTES]
    encoding = encoding_of(head)
    raw_lines = head.split(b"\n")
    if len(head) == SNIFF_BYTES:
        raw_lines = raw_lines[:-1]
    lines = [line.decode(encoding, errors="replace").rstrip("\r") for line in raw_lines]
    separator, decimal, n_columns, first = _table(path, lines)
    offset = sum(len(line) + 1 for line in raw_lines[:first])
    header = lines[:first]
    rows = [
        split_row(line.lstrip("\ufeff").lstrip(COMMENT) if line[:1] in COMMENT else line, separator) for line in header
    ]
    names, units, surplus = names_of(path, rows, n_columns, wanted)
    row = split_row(lines[first], separator)
    return CsvLayout(
        encoding=encoding,
        separator=separator,
        decimal=decimal,
        data_offset=offset,
        header_lines=first,
        names=names,
        units=units,
        first_row=tuple(row),
        header_rate=_header_rate(header),
        surplus=surplus,
    )


def text_pieces(path: Path, size: int) -> Iterator[bytes]:
    """Yield a text file in pieces of about ``size`` bytes; UTF-16 comes out as UTF-8."""
    with path.open("rb") as file:
        wide = utf16(file.read(HEAD_BYTES))
        file.seek(0)
        if not wide:
            while piece := file.read(size):
                yield piece
            return
        decoder = codecs.getincrementaldecoder(wide)(errors="replace")
        while piece := file.read(size):
            yield decoder.decode(piece).lstrip("\ufeff").encode("utf-8")


def utf16(head: bytes) -> str:
    """Return the name of the UTF-16 codec of a text, "" where it is another: by its mark, or zeros in every second."""
    if head.startswith(UTF16_MARKS):
        return "utf-16-le" if head.startswith(b"\xff\xfe") else "utf-16-be"
    if len(head) >= 8 and not any(head[1:64:2]) and all(head[0:64:2]):
        return "utf-16-le"
    return "utf-16-be" if len(head) >= 8 and not any(head[0:64:2]) and all(head[1:64:2]) else ""


def encoding_of(head: bytes) -> str:
    """Return the codec of the beginning of a text."""
    if head.startswith(b"\xef\xbb\xbf"):
        return "utf-8-sig"
    try:
        # a character may be cut at the end of the sniffed stretch
        head[: max(len(head) - 4, 0)].decode("utf-8")
        return "utf-8"
    except UnicodeDecodeError:
        return "cp1252" if not set(head) & {0x81, 0x8D, 0x8F, 0x90, 0x9D} else "latin-1"


def _is_value(field: str, decimal: str) -> bool:
    text = field.replace(",", ".") if decimal == "," else field
    return not field or bool(NUMBER.match(text)) or any(pattern.match(field) for pattern in STAMPS.values())


def _is_row(line: str, separator: str, decimal: str) -> int:
    """Return the number of fields of a data row, 0 for any other line."""
    fields = split_row(line, separator)
    if not any(fields) or not all(_is_value(field, decimal) for field in fields):
        return 0
    return len(fields)


def _table(path: Path, lines: list[str]) -> tuple[str, str, int, int]:
    """Return separator, decimal sign, columns and the first data row: the reading that explains most lines."""
    found = _best_table(lines[:SNIFF_LINES]) or _best_table(lines)
    if found is None:
        what = "a header but no row of numbers" if any(line.strip() for line in lines) else "blank lines only"
        raise Refusal(f"{path}: holds {what}; expected columns of numbers separated by comma, semicolon, tab or blanks")
    return found


def _best_table(lines: list[str]) -> tuple[str, str, int, int] | None:
    best: tuple[int, int, str, str, int] | None = None
    for separator in SEPARATORS:
        for decimal in (".", ",") if separator != "," else (".",):
            counts = [_is_row(line, separator, decimal) for line in lines]
            widths = [count for count in counts if count]
            if not widths:
                continue
            usual = max(set(widths), key=widths.count)
            score = (widths.count(usual), usual)
            if best is None or score > best[:2]:
                best = (*score, separator, decimal, counts.index(usual))
    if best is None:
        return None
    _, usual, separator, decimal, first = best
    return separator, decimal, usual, first


def names_of(
    path: Path, rows: list[list[str]], n_columns: int, wanted: tuple[str, ...]
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return names, units, and names beyond the columns from the rows above the data.

    The row of names is the one that holds the wanted names; where none are wanted, the one with the most text.

    Raises
    ------
    Refusal : no row has a name for each column, or none holds a wanted name
    """
    candidates = []
    for number, row in enumerate(rows):
        row, beyond = row[:n_columns], tuple(field for field in row[n_columns:] if field)
        if len(row) != n_columns or set(beyond) & set(wanted):
            continue
        plain = [name_and_unit(field) for field in row]
        hits = len({name for name, _ in plain} & set(wanted)) + len(set(row) & set(wanted))
        if not wanted:
            hits = sum(bool(field) and not is_known_unit(field) and not _is_value(field, ",") for field in row)
        candidates.append((hits - len(beyond), number, row, plain, beyond))
    if not candidates:
        raise Refusal(
            f"{path}: no header line has {n_columns} names for the {n_columns} columns of numbers; channels are found "
            "by name, add a line with the names"
        )
    hits, number, row, plain, beyond = max(candidates, key=lambda item: (item[0], -item[1] if wanted else item[1]))
    if hits + len(beyond) <= 0:
        shown = ", ".join(" | ".join(candidate[2]) for candidate in candidates[:3])
        raise Refusal(f"{path}: no column named {', '.join(map(repr, wanted))}; the header says {shown}")
    names = tuple(field if field in wanted else name for field, (name, _) in zip(row, plain, strict=True))
    units = tuple(unit for _, unit in plain)
    for other in rows[number + 1 :]:
        # a line of units stands below the names
        if len(other) == n_columns and not any(units) and any(is_known_unit(field) for field in other):
            units = tuple(field.strip("[]() ") for field in other)
    return names, units, beyond


def name_and_unit(field: str) -> tuple[str, str]:
    """Return name and unit of a header field; the unit stands in brackets, or behind a slash if it is a known one."""
    match = BRACKETS.match(field)
    if match is None:
        match = SLASH.match(field)
        match = match if match and is_known_unit(match["unit"]) else None
    return (match["name"], match["unit"]) if match else (field, "")


def _header_rate(header: list[str]) -> float | None:
    for line in header:
        match = RATE.search(line.replace(";", " ").replace("\t", " "))
        if match and RATE_WORDS.search(line):
            text = match[1].strip(".,")
            value = float(text.replace(",", ".")) if text.count(",") + text.count(".") <= 1 else 0.0
            return value * (1000.0 if match[2].lower() == "khz" else 1.0) or None
    return None


def hint_findings(layout: CsvLayout, hint: str, where: str) -> tuple[Finding, ...]:
    """Hold the bench's hint about the dialect against the file; the file decides."""
    words = hint.lower()
    separators = {name for name in NAMES.values() if re.search(rf"(?<!decimal ){name}", words)}
    decimals = {sign for word, sign in (("decimal point", "."), ("decimal comma", ",")) if word in words}
    told = f"{NAMES[layout.separator]}, decimal {'comma' if layout.decimal == ',' else 'point'}"
    wrong = (separators and NAMES[layout.separator] not in separators) or (decimals and layout.decimal not in decimals)
    if not wrong:
        return ()
    text = f"csv_dialect says {hint!r}, the file is {told}; the file decides"
    return (Finding("csv_dialect_differs", "warning", text, where),)


def surplus_findings(layout: CsvLayout, where: str) -> tuple[Finding, ...]:
    """Tell a header that has more names than the rows have fields."""
    if not layout.surplus:
        return ()
    text = (
        f"the header has {len(layout.surplus)} more name(s) than the rows have fields; the last, "
        f"{', '.join(layout.surplus)}, are taken for empty"
    )
    return (Finding("csv_header_longer", "warning", text, where),)

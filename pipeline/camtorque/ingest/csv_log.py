"""CSV and ASCII logs with the C parser of pandas, in blocks, so that a file may be larger than memory.

A block whose rows, separators and numbers are all in order is taken as pandas parses it. Any other block is looked at
line by line: a damaged row becomes missing samples and is counted, it never shifts the rows after it.
"""

from __future__ import annotations

import io
import math
import re
import tempfile
import weakref
from bisect import bisect_left
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pandas as pd

from camtorque.config import ChannelSpec
from camtorque.ingest.cells import LEVELS, MISSING, NO_VALUE, NUMBER, OVERRANGE, PARTING, THOUSANDS, unwrapped
from camtorque.ingest.columns import columns_of, raw_file
from camtorque.ingest.csv_damage import Damage, bare_findings, damage_findings, tail_findings
from camtorque.ingest.csv_layout import (
    CsvLayout,
    fields_of,
    is_other_header,
    is_remark,
    is_sound_row,
    layout_findings,
    sniff,
    text_pieces,
)
from camtorque.ingest.csv_table import split_row
from camtorque.ingest.listing import listed
from camtorque.ingest.raw import IN_MEMORY_BYTES, ArraySource, FileChannel, PairSource, RawFile, read_into, refusing
from camtorque.ingest.stamp_texts import kind_of_dates, seconds_of, seconds_of_texts
from camtorque.ingest.table_rows import is_fraction, rows_without_time
from camtorque.records import Array, Finding, Refusal, SampleSource

BLOCK_BYTES = 8 * 2**20
LONGEST_LINE = 2**20
"""A row of a thousand columns has 20 kilobytes [bytes]."""
BLANK_LINES = re.compile(rb"^[ \t\r]*\n", re.MULTILINE)
ALIKE_ROWS = 100
"""Rows before the last one that show whether its last field can lack digits: of a column that leaves out zeros at the
end every tenth field is shorter."""


TextRow = tuple[int, list[float], list[str]]
"""Line of a row, its numbers, its texts of date and time."""


@dataclass(frozen=True)
class CachedSource:
    """A column on disk as float64, in a temporary file that goes with the source."""

    file: BinaryIO
    n_samples: int
    path: Path

    def __post_init__(self) -> None:
        weakref.finalize(self, self.file.close)

    def read(self, start: int, stop: int) -> Array:
        """Return raw samples ``[start, stop)``."""
        start, stop, _ = slice(start, stop).indices(self.n_samples)
        values = np.empty(max(stop - start, 0))
        self.file.seek(8 * start)
        read_into(self.file, values, self.path)
        return values


def read(path: Path, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read columns of a CSV or ASCII file."""
    return read_table(path, sniff(path, tuple(spec.channel for spec in specs)), specs, hint)


def read_table(path: Path, layout: CsvLayout, specs: tuple[ChannelSpec, ...], hint: str) -> RawFile:
    """Read columns of a text file whose layout is known."""
    places = columns_of(path, layout, specs)
    times = {time for _, time in places if time is not None}
    beside = {part[0] for time in times if (part := layout.fraction_of(time))}
    with refusing(path, "CSV"):
        table = _parsed(path, layout, sorted({*(column for column, _ in places), *times, *beside}), times)
    result = raw_file(path, layout, _with_fractions(layout, table.sources, times), specs)
    notes = layout_findings(table.layout, hint, path.name)
    return RawFile(result.channels, (*notes, *table.findings, *result.findings))


def channels(path: Path) -> tuple[FileChannel, ...]:
    """List the columns of a CSV or ASCII file."""
    return channels_of(path, sniff(path, ()))


def channels_of(path: Path, layout: CsvLayout) -> tuple[FileChannel, ...]:
    """List the columns of a text whose layout is known."""
    every = [column for column in range(layout.n_columns) if column not in layout.words]
    times = {time for column in every if (time := layout.time_column("", (), column)) is not None}
    with refusing(path, "CSV"):
        table = _parsed(path, layout, every, times)
    return listed(path, layout, _with_fractions(layout, table.sources, times))


def _with_fractions(layout: CsvLayout, sources: Mapping[int, SampleSource], times: set[int]) -> dict[int, SampleSource]:
    """Return the columns, where fractions of seconds that stand beside a time are part of it."""
    found = dict(sources)
    for time in times:
        column, unit = layout.fraction_of(time) or (-1, 0.0)
        if column in found and is_fraction(found[column], unit):
            found[time] = PairSource(sources[time], found.pop(column), partial(_with_part, unit))
    return found


def _with_part(unit: float, whole: Array, part: Array) -> Array:
    return whole + unit * part


@dataclass(frozen=True)
class Parsed:
    """Columns of a text, by number, as its layout turned out to be, and what is wrong with rows and cells."""

    sources: dict[int, SampleSource]
    layout: CsvLayout
    findings: tuple[Finding, ...]


def _parsed(path: Path, layout: CsvLayout, wanted: list[int], times: set[int]) -> Parsed:
    """Parse the wanted columns, once more where a row below the lines that told the layout has it otherwise."""
    damage = Damage()
    sources, tail = _columns(path, layout, wanted, times, damage)
    if damage.parting:
        return _parsed(path, replace(layout, thousands=damage.parting), wanted, times)
    if damage.day_first:
        return _parsed(path, replace(layout, day_first=True), wanted, times)
    return Parsed(sources, layout, (*damage_findings(damage, path.name), *tail))


def _columns(
    path: Path, layout: CsvLayout, wanted: list[int], times: set[int], damage: Damage
) -> tuple[dict[int, SampleSource], list[Finding]]:
    """Parse the wanted columns, into memory or, for a large file, into temporary files."""
    in_memory = path.stat().st_size <= IN_MEMORY_BYTES
    parts: dict[int, list[Array]] = {column: [] for column in wanted}
    files = {} if in_memory else {column: tempfile.TemporaryFile() for column in wanted}  # noqa: SIM115
    stamps = {column: kind for column in wanted if column in times and (kind := layout.stamp_kind(column))}
    last = dict.fromkeys(stamps, np.nan)
    count, line, tail, ended = 0, layout.header_lines + 1, b"", [np.empty(0) for _ in wanted]
    for block, is_cut in _blocks(path, layout):
        if is_cut:
            block, tail = b"", block
        before = dict(stamps)
        values = parse_block(block, layout, wanted, stamps, damage, line)
        damage.day_first |= count > 0 and stamps != before
        if damage.reordered:
            raise Refusal(
                f"{path} line {damage.reordered}: repeats the header in another order, or with other names, so that "
                "the columns below it are others; split the file there"
            )
        line += block.count(b"\n")
        count, ended = count + len(values[0]), values if len(values[0]) else ended
        for column, part in zip(wanted, values, strict=True):
            if column in stamps:
                part = unwrapped(part, stamps[column], last[column])
                last[column] = next((stamp for stamp in part[::-1] if np.isfinite(stamp)), last[column])
            files[column].write(part.tobytes()) if files else parts[column].append(part)
    bare = 0 if times else damage.bare_rows(ended, line)
    count, findings = count - bare, [*bare_findings(bare, path), *tail_findings(tail, path, line, layout)]
    if count <= 0:
        raise Refusal(f"{path}: holds a header but no complete row of numbers; the file is cut or was never filled")
    sources: dict[int, SampleSource] = {column: CachedSource(file, count, path) for column, file in files.items()}
    sources |= {column: ArraySource(np.concatenate(part)[:count]) for column, part in parts.items() if not files}
    damage.end_at(line - 1 - min((rows_without_time(sources[column])[1] for column in times), default=bare))
    return sources, findings


def _blocks(path: Path, layout: CsvLayout) -> Iterator[tuple[bytes, bool]]:
    """Yield blocks of whole lines, at the end what follows the last line end: whether it may be cut."""
    rest, before, skip = b"", b"", layout.data_offset
    for piece in text_pieces(path, BLOCK_BYTES):
        whole, newline, rest = (rest + piece[skip:]).rpartition(b"\n")
        whole = BLANK_LINES.sub(b"", whole + newline) if layout.spaced else whole + newline
        skip = max(skip - len(piece), 0)
        if len(rest) > LONGEST_LINE:
            raise Refusal(
                f"{path}: a line of more than {LONGEST_LINE} bytes begins with {rest[:30]!r}; no row of a log is so "
                "long: the file is damaged or no table"
            )
        if whole:
            before = (before + whole[-LONGEST_LINE:])[-LONGEST_LINE:]
            yield whole, False
    is_whole = is_whole_row(rest, before, layout)
    yield (rest + b"\n" if is_whole else rest), not is_whole


def is_whole_row(row: bytes, before: bytes, layout: CsvLayout) -> bool:
    """Tell whether a row without a line end lacks no digit: it ends in as many as each of many rows before it does."""
    rows = before.decode(layout.encoding, errors="replace").split("\n")[-ALIKE_ROWS - 1 : -1]
    shapes = {_shape(text, layout) for text in (*rows, row.decode(layout.encoding, errors="replace"))}
    return bool(row) and len(rows) == ALIKE_ROWS and len(shapes) == 1


def _shape(row: str, layout: CsvLayout) -> tuple[int, bool, int]:
    """Return the number of fields of a row, whether the last has a decimal mark, and its length beyond that."""
    row = row.rstrip("\r")
    *_, last = row.split(None if layout.separator == " " else layout.separator) or [""]
    _, mark, decimals = last.rpartition(layout.decimal)
    return len(split_row(row, layout.separator)), bool(mark), len(decimals.strip(" +-"))


def parse_block(
    block: bytes, layout: CsvLayout, wanted: list[int], stamps: dict[int, str], damage: Damage, line: int
) -> list[Array]:
    """Return one array per wanted column; ``stamps``: columns of date and time -> key of `STAMPS`, put right."""
    if not block:
        return [np.empty(0) for _ in wanted]
    rows = block.count(b"\n")
    if _each_whole(block, rows, layout) and block.count(b'"') == 0 and not layout.thousands:
        try:
            frame = _parse_fast(block, layout, wanted, stamps)
        except (ValueError, OverflowError):
            frame = None
        if frame is not None and len(frame) == rows and (np.abs(frame.to_numpy()) < NO_VALUE).all():
            damage.reordered = damage.reordered or damage.renamed
            return [frame[column].to_numpy() for column in wanted]
    return _parse_lines(block, layout, wanted, stamps, damage, line)


def _each_whole(block: bytes, rows: int, layout: CsvLayout) -> bool:
    """Tell whether each row has as many fields as there are columns: pandas passes over one too many of few columns."""
    if layout.separator == " ":
        return all(len(row.split()) == layout.n_columns for row in block.split(b"\n")[:-1])
    mark = layout.separator.encode()
    others = bytes(set(range(256)) - set(mark + b"\n"))
    return block.translate(None, others) == ((layout.n_columns - 1) * mark + b"\n") * rows


def _parse_fast(block: bytes, layout: CsvLayout, wanted: list[int], stamps: dict[int, str]) -> pd.DataFrame:
    levels = [column for column in wanted if layout.has_levels(column)]
    frame = pd.read_csv(
        io.BytesIO(block),
        sep=r"\s+" if layout.separator == " " else layout.separator,
        decimal=layout.decimal,
        header=None,
        names=range(layout.n_columns),
        usecols=wanted,
        dtype={column: str if column in stamps or column in levels else np.float64 for column in wanted},
        engine="c",
        quoting=3,
        index_col=False,
        skip_blank_lines=False,
        encoding="latin-1",
    )
    for column, kind in stamps.items():
        stamps[column] = kind_of_dates(frame[column], kind)
        frame[column] = seconds_of(frame[column], stamps[column])
    for column in levels:
        frame[column] = frame[column].str.strip().str.lower().map(LEVELS)
    return frame


def _parse_lines(
    block: bytes, layout: CsvLayout, wanted: list[int], stamps: dict[int, str], damage: Damage, first: int
) -> list[Array]:
    """Parse line by line; a damaged row or cell is nan and counted, two rows run together are two."""
    rows, remarks = list[TextRow](), list[int]()
    blank, heads = 0, [sorted(split_row(head, layout.separator)) for head in layout.repeated]
    for line, text in enumerate(block[:-1].decode(layout.encoding, errors="replace").split("\n"), start=first):
        text = text.rstrip("\r")
        if text in layout.repeated:
            damage.headers += 1
            del rows[len(rows) - blank :]  # lines before it that hold nothing part the blocks
            while damage.rows and damage.rows[-1] >= line - blank:
                damage.rows.pop()
            blank = 0
            continue
        blank = blank + 1 if not text.strip() else 0
        fields = fields_of(text, layout)
        is_sound = is_sound_row(fields, layout)
        if fields[1:] and sorted(fields) in heads:
            damage.reordered = damage.reordered or line
        elif damage.renamed and is_sound:
            damage.reordered = damage.reordered or damage.renamed
        if is_sound and remarks:
            damage.remarks.extend(remarks)
            _leave_out(rows, remarks)
        if len(fields) != layout.n_columns:
            (remarks if is_remark(text, fields, layout) else damage.rows).append(line)
            rows += [(line, [np.nan] * len(wanted), [""] * len(stamps))] * _rows_lost(fields, layout)
        else:
            values = [np.nan if c in stamps else _cell(fields[c], layout, c, damage, line) for c in wanted]
            rows.append((line, values, [fields[column] for column in stamps]))
            if all(map(math.isnan, values)) and is_other_header(fields, layout):
                damage.renamed = damage.renamed or line
    damage.rows.extend(remarks)  # below the last row: below the table
    return _columns_of(rows, wanted, stamps, damage)


def _columns_of(rows: list[TextRow], wanted: list[int], stamps: dict[int, str], damage: Damage) -> list[Array]:
    """Return the columns of parsed rows; dates and times are still texts in these."""
    columns = list(np.array([values for _, values, _ in rows]).T.copy())
    for place, (column, kind) in enumerate(stamps.items() if rows else ()):
        texts = [texts[place] for _, _, texts in rows]
        stamps[column] = kind_of_dates(pd.Series(texts, dtype=str), kind)
        columns[wanted.index(column)] = seconds = seconds_of_texts(texts, stamps[column])
        damage.cells.extend(rows[n][0] for n in np.flatnonzero(np.isnan(seconds)) if texts[n].lower() not in MISSING)
    return columns or [np.empty(0) for _ in wanted]


def _leave_out(rows: list[TextRow], lines: list[int]) -> None:
    """Take the rows of some lines, and these lines, out of their lists."""
    below = bisect_left(rows, lines[0], key=itemgetter(0))
    rows[below:] = [row for row in rows[below:] if row[0] not in lines]
    lines.clear()


def _rows_lost(fields: list[str], layout: CsvLayout) -> int:
    return 2 if len(fields) in (2 * layout.n_columns - 1, 2 * layout.n_columns) else 1


def _cell(text: str, layout: CsvLayout, column: int, damage: Damage, line: int) -> float:
    if text.lower() in LEVELS and layout.has_levels(column):
        return LEVELS[text.lower()]
    for sign in layout.thousands or PARTING:
        if sign in text and THOUSANDS[sign].match(text):
            text = text.replace(sign, "")
    plain = text.replace(layout.decimal, ".") if layout.decimal != "." else text
    # 1.012 among decimal commas, in a column whose first number has no point, may be 1012
    unsure = layout.decimal == "," and "." not in layout.first_row[column] and THOUSANDS["."].match(text)
    is_number = NUMBER.match(plain) and not unsure
    if is_number and not abs(float(plain)) >= NO_VALUE:
        return float(plain)
    if plain.lower() in MISSING or is_number or OVERRANGE.match(text):
        damage.overrange += plain.lower() not in MISSING and plain.lower() != "nan"
    else:
        damage.cells.append(line)
        other = "," if layout.decimal == "." else "."
        if not layout.thousands and layout.decimal in text and THOUSANDS[other].match(text):
            damage.parting = other
    return np.nan

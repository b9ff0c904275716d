"""What is damaged in a CSV or ASCII log: rows, cells, headers that stand there again; and how it is told."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from camtorque.ingest.csv_layout import CsvLayout, fields_of, is_remark, is_sound_row
from camtorque.records import Array, Finding, Mask
from camtorque.units import counted


@dataclass
class Damage:
    """What was wrong with rows and cells: their lines, or how many there are; lines that are remarks and no rows.

    Attributes
    ----------
    renamed : line that names the columns anew, 0 for none; nothing is wrong unless rows follow
    reordered : line of a header that is another one, or in another order, and has rows below
    parting : sign between thousands of a cell, "" where none has one
    day_first : whether dates with slashes turn out to have their day first below rows that were read with the month
    """

    rows: array[int] = field(default_factory=lambda: array("q"))
    remarks: array[int] = field(default_factory=lambda: array("q"))
    cells: array[int] = field(default_factory=lambda: array("q"))
    overrange: int = 0
    headers: int = 0
    renamed: int = 0
    reordered: int = 0
    parting: str = ""
    day_first: bool = False

    def end_at(self, line: int) -> None:
        """Forget what lies below a line: no part of the table."""
        self.rows, self.cells = (array("q", [at for at in lines if at <= line]) for lines in (self.rows, self.cells))

    def bare_rows(self, ended: list[Array], line: int) -> int:
        """Return how many rows at the end hold no number in any column and are damaged: lines below the table."""
        numbers: Mask = np.asarray(np.any(np.isfinite(ended), axis=0))
        bare = int(np.argmax(numbers[::-1])) if numbers.any() else 0
        return bare if any(at >= line - bare for lines in (self.rows, self.cells) for at in lines) else 0


def _at(lines: array[int]) -> str:
    return f"(line {', '.join(map(str, lines[:5]))}{', ...' if len(lines) > 5 else ''})"


def damage_findings(damage: Damage, where: str) -> list[Finding]:
    """Tell damaged rows and cells, values beyond the range, headers that stand there again."""
    rows = (
        (len(damage.rows), "csv_rows_damaged", "error",
         f"row has the wrong number of fields and is read as missing samples {_at(damage.rows)}",
         f"rows have the wrong number of fields and are read as missing samples {_at(damage.rows)}"),
        (len(damage.cells), "csv_cells_damaged", "error",
         f"cell is not a number and is read as a missing sample {_at(damage.cells)}",
         f"cells are not numbers and are read as missing samples {_at(damage.cells)}"),
        (damage.overrange, "csv_overrange", "warning",
         "cell says that the value is beyond the logger's range; it is a missing sample",
         "cells say that the value is beyond the logger's range; they are missing samples"),
        (len(damage.remarks), "csv_remarks", "info",
         f"line among the rows is a remark and is left out {_at(damage.remarks)}",
         f"lines among the rows are remarks and are left out {_at(damage.remarks)}"),
        (damage.headers, "csv_header_repeated", "warning",
         "line repeats the header and is left out", "lines repeat the header and are left out"),
    )  # fmt: skip
    return [
        Finding(code, severity, counted(count, one, many), where) for count, code, severity, one, many in rows if count
    ]


def bare_findings(bare: int, path: Path) -> list[Finding]:
    """Tell rows at the end that hold no number."""
    text = counted(bare, "row at the end holds no number; it is left out",
                   "rows at the end hold no number; they are left out")  # fmt: skip
    return [Finding("rows_without_numbers", "warning", text, path.name)] if bare else []


def tail_findings(tail: bytes, path: Path, line: int, layout: CsvLayout) -> list[Finding]:
    """Tell a last row without a line end: one that lacks fields is cut, of another the last number may lack digits."""
    text = tail.decode(layout.encoding, errors="replace").strip()
    fields = fields_of(text, layout)
    if not tail or is_remark(text, fields, layout):
        return []
    if is_sound_row(fields, layout) and (fields[-1] or not layout.first_row[-1]):
        text = f"the last row (line {line}) has no line end and is not used: its last number may lack digits"
        return [Finding("csv_no_line_end", "info", text, path.name)]
    text = (
        f"the file ends inside line {line} without a line end; that row is not used, the file may be cut: copy it again"
    )
    return [Finding("csv_cut_row", "error", text, path.name)]

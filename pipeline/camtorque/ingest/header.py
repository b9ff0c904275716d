"""What the lines above the numbers say: names, units, sampling rate; of texts, spreadsheets and columnar files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from camtorque.records import Refusal
from camtorque.units import is_known_unit, tidy_unit, unit_kind

TIME_WORDS = (
    r"time|zeit|uhrzeit|timestamp|time.?stamp|zeitstempel|date.?time|temps|tiempo|x.?(value|axis|achse)|"
    r"elapsed.?time|time.axis|rel\w*.?time|zeitkanal"
)
TIME_NAME = re.compile(rf"^({TIME_WORDS}|t(?=[ _.-]))([ _.-](?P<unit>s|sec|ms|us|µs|ns))?$", re.IGNORECASE)
MAYBE_TIME = re.compile(r"^(t|x)$", re.IGNORECASE)
"""Time, unless a column is named outright so, or the recording takes it for a channel."""
TIME_OF = re.compile(r"time_|_time", re.IGNORECASE)
BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]$")
INNER_BRACKETS = re.compile(r"^(?P<name>.*?)\s*\((?P<unit>[^()]*\([^()]*\))\)$")
SQUARE_BRACKETS = re.compile(r"^(?P<name>.*?)\s*\[(?P<unit>[^\[\]]*)\]$")
"""p [bar(a)]"""
IN_UNIT = re.compile(r"^(?P<name>.*?)\s*\bin (?P<unit>\S+)$")
"""Torque in Nm, C1 in V, in s."""
SLASH = re.compile(r"^(?P<name>.*\S)\s*/\s+(?P<unit>\S.*)$")
TIGHT_SLASH = re.compile(r"^(?P<name>[^\d/]+)/(?P<unit>[^/]+)$")
RATE_KEY = re.compile(
    r"(?<![a-z])(sampl\w*[ _-]*(rate|freq\w*)|abtast(rate|freq\w*)|messrate|scan[ _-]*rate|acquisition[ _-]*rate|"
    r"(fs|sr)(?=\s*[=:;,\t\[(]))(?![a-z])",
    re.IGNORECASE,
)
STEP_KEY = re.compile(
    r"(?<![a-z])(sampl\w*[ _-]*(interval|period|time)|abtast(intervall|zeit|periode)|time[ _-]*(step|increment)|"
    r"dt|delta[ _-]?t|hresolution|tinc|xinc|ts(?=\s*[=:;,\t\[(]))(?![a-z])",
    re.IGNORECASE,
)
INCREMENT = re.compile(r"increment", re.IGNORECASE)
"""Of a name that stands over the step of the time."""
PER_SECOND = re.compile(r"(?P<number>[\d.,]+(e[+-]?\d+)?)\s*(?P<unit>[kM]?(S/s|Sa/s|sps))\b", re.IGNORECASE)
VALUE = re.compile(
    r"^(?P<before>[^\d+-]{0,30}?)(?<![a-z])(?P<number>\d[\d.,]*(?:e[+-]?\d+)?)\s*(?P<unit>[a-zµμ]*(?:/s)?)",
    re.IGNORECASE,
)
"""A number and its unit, not one within the name of an amplifier."""
RATES = {"": 1.0, "hz": 1.0, "khz": 1e3, "mhz": 1e6, "1/s": 1.0, "s/s": 1.0, "sa/s": 1.0, "sps": 1.0, "ks/s": 1e3,
         "ksa/s": 1e3, "ksps": 1e3, "ms/s": 1e6, "msa/s": 1e6, "msps": 1e6}  # fmt: skip
"""Spelling of a unit of rates, in small letters -> factor to Hz."""
STEPS = {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
NEXT_FIELD = re.compile(r"(?<=\d{4}),|,(?!\d{3}(?!\d))")
NO_UNITS = ("value", "sequence", "sample", "samples", "point", "points", "index", "unit", "units",
            "einheit", "einheiten")  # fmt: skip
"""Words in the place of a unit that are none: where a column counts, or the key of the row of units."""
KEYED = re.compile(r"^[A-Za-z][\w ]*: *[+-]?[\d.]+(e[+-]?\d+)?$", re.IGNORECASE)
"""CH1:0.00000, a setting and no name."""
COUNTS = re.compile(r"^(no|nr|num|number|index|idx|sample|record|rn|row|#|tracename)\.?$", re.IGNORECASE)
"""What stands over a count of rows, which an export may leave out, or is the key of a row of names."""
ROWS_OF_A_WORD = 3
"""Rows in a row that hold one word beside numbers, from which on they are no header."""
AMBIGUOUS = re.compile(r"^\d{1,3}[.,]\d{3}$")
"""Twenty thousand or twenty: 20,000 and 20.000 mean either, by country."""
NUMBERED = re.compile(r"^column (?P<number>[1-9]\d{0,3})$")
"""A column by its place, counted from 1, where no name tells it."""


def column_number(name: str) -> int | None:
    """Return which column ``column 3`` means, counted from 0; None for any other name."""
    match = NUMBERED.match(name)
    return int(match["number"]) - 1 if match else None


def numbered_name(number: int) -> str:
    """Return the name of a column that has none, or shares it; ``number`` counts from 0."""
    return f"column {number + 1}"


def is_number(field: str) -> bool:
    """Tell a field that is a number, with decimal point or comma."""
    try:
        float(field.replace(",", "."))
    except ValueError:
        return False
    return True


def name_and_unit(field: str) -> tuple[str, str]:
    """Return name and unit of a header field; the unit stands in brackets, or behind a slash if it is a known one."""
    for pattern in (INNER_BRACKETS, SQUARE_BRACKETS, BRACKETS):
        if match := pattern.match(field):
            return match["name"], match["unit"]
    if unit := time_unit(field):
        return field, unit
    if (match := IN_UNIT.match(field)) and is_known_unit(match["unit"]):
        return match["name"], match["unit"]
    for pattern in (SLASH, TIGHT_SLASH):
        match = pattern.match(field)
        if match and is_known_unit(match["unit"]) and (pattern is SLASH or _divides(match["name"], match["unit"])):
            return match["name"].strip(), match["unit"]
    return field, ""


def _divides(name: str, unit: str) -> bool:
    """Tell ``p/bar`` (a quantity over its unit) from ``km/h`` (a unit)."""
    is_time = unit_kind(unit) == "time"
    return not is_known_unit(name) and (not is_time or is_time_name(name))


def time_unit(name: str, stated: str = "") -> str:
    """Return the unit of a time column: the stated one, else the one that ends its name (time_ms), else "".

    By the conventions of netCDF (CF) an origin may stand behind it: "ns since 1970-01-01".
    """
    match = TIME_NAME.match(name)
    return stated.partition(" since ")[0] or ((match["unit"] or "").lower() if match else "")


def is_time_name(name: str) -> bool:
    """Tell a name that times have, or may have."""
    return bool(TIME_NAME.match(name) or MAYBE_TIME.match(name))


def timed_by_name(name: str) -> str:
    """Return the channel whose times a name says it holds, as Data1_time_Torque and Torque_time; else the name."""
    return TIME_OF.sub("", name, 1)


def is_time_unit(unit: str) -> bool:
    """Tell a unit of seconds or their parts, as a time column has it."""
    return tidy_unit(unit) in ("s", "ms", "us", "ns")


@dataclass(frozen=True)
class HeaderRow:
    """A row above the data that may hold the names.

    Attributes
    ----------
    number : of the row
    hits : counts fields that are wanted names; where none are wanted, different fields with text, 0 beside settings
    fields : one per column; plain : name and unit of each
    beyond : names beyond the columns
    """

    number: int
    hits: int
    fields: list[str]
    plain: list[tuple[str, str]]
    beyond: tuple[str, ...]


def _header_rows(rows: list[list[str]], first: list[str], wanted: tuple[str, ...]) -> list[HeaderRow]:
    """Return the rows that have a field for each column; see `names_of`."""
    n_columns = len(first)
    least = max((n + 1 for n, field in enumerate(first) if field), default=n_columns)
    found = []
    for number, row in enumerate(rows):
        beyond = tuple(field for field in row[n_columns:] if field)
        keyed = len(row) == 2 and row[0].endswith(":") and not row[1].endswith(":")  # a setting: "Type:" before "raw"
        if len(row) < least or names_in(beyond) & set(wanted) or not any(row) or keyed:
            continue
        row = (row + [""] * n_columns)[:n_columns]
        plain = [name_and_unit(field) for field in row]
        # of rows with as many wanted names the one that has them without units
        hits = (len(wanted) + 1) * len(names_in(row) & set(wanted)) + len(set(row) & set(wanted))
        named = 0 if any(map(_is_setting, row)) else len(set(filter(_is_text, row)))
        found.append(HeaderRow(number, hits if wanted else named, row, plain, beyond))
    return found


def _is_setting(field: str) -> bool:
    """Tell a value that no name is: a broken number, or one behind a key."""
    return bool(KEYED.match(field)) or (is_number(field) and not field.strip("+-").isdigit())


def names_in(fields: Iterable[str]) -> set[str]:
    """Return fields of a header, and their names without units."""
    return {name for field in fields for name in (field, name_and_unit(field)[0])}


def _refuse_other_count(path: Path, rows: list[list[str]], n_columns: int, wanted: tuple[str, ...]) -> None:
    """Refuse wanted names beyond the columns, where which has none is a guess, and commas of two kinds.

    Where commas separate columns and mark decimals every number falls in two.
    """
    longer = next((row for row in rows if names_in(row[n_columns:]) & set(wanted)), None)
    if longer:
        raise Refusal(
            f"{path}: the header has {len(longer)} names ({', '.join(longer)}) for {n_columns} columns of numbers, and "
            "which of them has none cannot be told; correct the header, or name columns by their place: channel = "
            f"{numbered_name(0)!r} to {numbered_name(n_columns - 1)!r}"
        )
    named = next((row for row in rows if 2 * len(row) == n_columns and all(map(_is_text, row))), None)
    if named:
        raise Refusal(
            f"{path}: found {n_columns} columns of numbers under {len(named)} names ({', '.join(named[:3])}, ...): the "
            "comma seems to mark decimals and to separate columns; export with a semicolon or tab between columns, or "
            "with a decimal point"
        )


def _refuse_rows_of_a_word(path: Path, rows: list[list[str]], n_columns: int) -> None:
    """Refuse rows above the first one of numbers that hold the same word again and again: they are of the log."""
    words = [
        tuple(dict.fromkeys(field for field in row if not is_number(field))) if len(row) == n_columns else ()
        for row in rows[-ROWS_OF_A_WORD:]
    ]
    if len(words) == ROWS_OF_A_WORD and len(set(words)) == 1 and len(words[0]) == 1 and words[0][0]:
        raise Refusal(
            f"{path}: the lines above the first one of numbers all hold {words[0][0]!r}, which is no number and no "
            "known word for a missing one; write NaN there, or leave the cell empty: a log that begins later is "
            "moved in time"
        )


def names_of(
    path: Path, rows: list[list[str]], first: list[str], wanted: tuple[str, ...]
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return names, units, and names beyond the columns from the rows above the data.

    The row of names is the one that holds the wanted names; where none are wanted, the one above a row of units, else
    the one with the most text. Without any such row the columns are ``column 1``, ``column 2``, ...

    Parameters
    ----------
    first : fields of the first row of numbers; a header row may be shorter by what is empty at its end

    Raises
    ------
    Refusal : no row has a name for each column, or none holds a wanted name
    """
    n_columns = len(first)
    _refuse_rows_of_a_word(path, rows, n_columns)
    wanted = tuple(name for name in wanted if column_number(name) is None)
    candidates = _header_rows(rows, first, wanted)
    if not candidates:
        if not wanted:
            return tuple(map(numbered_name, range(n_columns))), ("",) * n_columns, ()
        _refuse_other_count(path, rows, n_columns, wanted)
        raise Refusal(
            f"{path}: no header line has {n_columns} names for the {n_columns} columns of numbers; add a line with the "
            f"names, or name columns by their place: channel = {numbered_name(0)!r} to {numbered_name(n_columns - 1)!r}"
        )
    below = [row.number for row in candidates if _is_unit_row(row.fields, first)]
    named = [row for row in candidates if below and row.number < below[0] and row.hits > 0]
    chosen = max(
        named if named and not wanted else candidates,
        key=lambda row: (row.hits - len(row.beyond), -row.number if wanted else row.number),
    )
    # of names beyond the columns the first may stand over none: one that counts rows, or where the last has a unit
    counted = COUNTS.match(chosen.fields[0]) or any(name_and_unit(field)[1] for field in chosen.beyond)
    if not wanted and (not chosen.hits or (chosen.beyond and counted)):
        numbered = [numbered_name(n) for n in range(n_columns)]
        chosen = replace(chosen, number=-1, fields=numbered, plain=[(name, "") for name in numbered])
    elif not chosen.hits:
        shown = ", ".join(" | ".join(row.fields) for row in candidates[:3])
        raise Refusal(f"{path}: no column named {', '.join(map(repr, wanted))}; the header says {shown}")
    pairs = zip(chosen.fields, chosen.plain, strict=True)
    names = tuple(field if field in wanted else name for field, (name, _) in pairs)
    names = tuple(name or _name_in_another_row(candidates, n) for n, name in enumerate(names))
    units = tuple(unit for _, unit in chosen.plain)
    for row in candidates:
        # a line of units stands below the names
        later = row.number > chosen.number
        if later and not any(map(is_known_unit, units)) and any(map(is_known_unit, row.fields)):
            units = tuple(field.strip("[]() ") for field in row.fields)
    beyond = tuple(field for field in chosen.beyond if not (STEP_KEY.match(field) or INCREMENT.match(field)))
    return names, tuple("" if unit.lower() in NO_UNITS else unit for unit in units), beyond


def _name_in_another_row(rows: list[HeaderRow], column: int) -> str:
    """Return the name of a column whose own row has none: below a group that several columns share; "" without any."""
    return next((row.plain[column][0] for row in rows if _is_text(row.fields[column])), "")


def _is_text(field: str) -> bool:
    return bool(field) and not is_known_unit(field) and not is_number(field)


def _is_unit_row(row: list[str], first: list[str]) -> bool:
    """Tell a row of units; a column that is empty below may hold its key, such as "VUnit"."""
    filled = [field for field, below in zip(row, first, strict=True) if below and field.strip("[]()- ")]
    known = sum(is_known_unit(field) or field.lower() in NO_UNITS for field in filled)
    return len(filled) > 1 and is_known_unit(filled[0]) and known * 2 > len(filled)


def header_rate(header: list[str], separator: str) -> float | None:
    """Return the sampling rate that a header states [Hz]: as a rate, or as a step; None where none, or two readings."""
    for line in (*header, *_named_above(header, separator)):
        text = line.replace('"', " ")
        if separator == ",":  # parts fields, unless it stands between thousands
            text = NEXT_FIELD.sub(" ", text)
        for key, units, inverse in ((RATE_KEY, RATES, False), (STEP_KEY, STEPS, True)):
            found = key.search(text)
            match = VALUE.match(text[found.end() :]) if found else None
            value = _value(match["number"], _unit(match, units), units) if match else None
            if value:
                return 1.0 / value if inverse else value
        if match := PER_SECOND.search(text):
            return _value(match["number"], match["unit"].lower(), RATES)
    return None


def _named_above(header: list[str], separator: str) -> Iterator[str]:
    """Yield the step of the time that stands below its name in the next line of the header."""
    for names, values in pairwise(line.split(separator) for line in header):
        for name, value in zip(names, values, strict=False):
            if is_number(value) and INCREMENT.fullmatch(name.strip(' "')):
                yield f"dt {value}"


def _unit(match: re.Match[str], units: dict[str, float]) -> str:
    """Return the unit behind a number, else the one between key and number."""
    before = re.findall(r"[a-zµμ1]+(?:/s)?", match["before"].lower())
    known = [unit for unit in (match["unit"].lower(), *before) if unit and unit in units]
    return known[0] if known else ""


def _value(number: str, unit: str, units: dict[str, float]) -> float | None:
    text = number.rstrip(".,")
    if AMBIGUOUS.match(text) or text.count(",") + text.count(".") > 1 or unit not in units:
        return None
    return float(text.replace(",", ".")) * units[unit] or None

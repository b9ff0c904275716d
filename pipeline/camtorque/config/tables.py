"""A TOML file -> values by their `Key`: type, unit and band checked; every problem is collected."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import date, datetime, time
from pathlib import Path
from typing import Any

from camtorque.config.absent import no_file, what_is_beside
from camtorque.config.keys import UNKNOWN, Key, TableSchema
from camtorque.records import CONTROL, Refusal
from camtorque.units import did_you_mean, expected_one_of

LARGEST_FILE = 512 * 1024
"""A bench file has a few kilobytes; beyond this the parser itself could take minutes [bytes]."""
LONGEST_KEY = 100
"""Parts of a dotted key: each costs the parser as much as all before it."""
LONGEST_TEXT = 4096
MOST_LISTED = 8
"""Problems of a file that a refusal names."""
DECIMAL_COMMA = re.compile(r"[\w.\- ]+=\s*[+-]?[\d.']*\d,\d+([eE][+-]?\d+)?\s*(#.*)?")
OTHER_SCHEMA = re.compile(r"(camtorque-[a-z]+|fip-bench-recording)/\d+")
TOML_SLIPS = {
    "Cannot overwrite|Cannot declare .* twice": "it is given twice: remove one",
    r"Unescaped|escape": "a path has / between its folders, or stands in single quotes",
    "[\u201c\u201d\u201e]": 'write straight quotes "',
    r": [\w-]+\s*=\s*[+-]?\d[\d.]*\s*[^\W\d]": "write the number alone: the name of the key says the unit",
    r"Invalid value.*: [\w-]+\s*=\s*[^\W\d]": 'text stands in quotes, as in edge = "rising"; true and false do not',
}
"""What the reader says, or the line holds -> what to do."""
BETWEEN_KEYS = re.compile(r"[,=\[\]{}#]")


class Refusals(Refusal):
    """Several reasons at once; the message is the first and how many follow, or many where no command lists them."""

    def __init__(self, problems: tuple[str, ...], listed: bool = True) -> None:
        named, hint = (1, "; 'camtorque check' lists them all") if listed else (MOST_LISTED, "")
        more = len(problems) - named
        tail = f" (and {more} more{hint})" if more > 0 else ""
        super().__init__("; also ".join(problems[:named]) + tail)
        self.problems, self.listed = problems, listed

    def __reduce__(self) -> tuple[type[Refusals], tuple[tuple[str, ...], bool]]:
        """Return how to pickle the refusal, so that it comes back complete from a worker process."""
        return Refusals, (self.problems, self.listed)


@dataclass
class Problems:
    """The refusals of one file, raised together."""

    texts: list[str] = field(default_factory=list)

    @contextmanager
    def collecting(self) -> Iterator[None]:
        """Note a refusal and go on."""
        try:
            yield
        except Refusal as refusal:
            self.texts += refusal.problems if isinstance(refusal, Refusals) else (str(refusal),)

    def raise_any(self, listed: bool = True) -> None:
        """Refuse where anything was noted; ``listed`` by `camtorque check`, as is what is wrong with a recording."""
        if self.texts:
            raise Refusals(tuple(dict.fromkeys(self.texts)), listed)


def read_toml(file: Path, expected: str) -> tuple[str, dict[str, Any]]:
    """Return the text and the tables of a TOML file; ``expected`` ends the refusal of a missing file."""
    text = _text(file, expected)
    if not text.strip():
        raise Refusal(f"{file}: is empty; {expected}")
    _refuse_long_keys(file, text)
    try:
        return text, tomllib.loads(text)
    except RecursionError as error:
        raise Refusal(f"{file}: tables or lists are nested too deep; a bench file has two levels") from error
    except ValueError as error:  # TOMLDecodeError, and integers of thousands of digits
        said = " ".join(str(error).partition("; use sys.")[0].split())[:200]
        number, line = _named_line(text, said)
        if DECIMAL_COMMA.fullmatch(line):
            raise Refusal(
                f"{file} line {number}: found {line[:80]!r}, a number with a decimal comma; expected a decimal "
                "point and no sign between thousands: write 1234.5"
            ) from error
        hint = next((f"; {hint}" for sign, hint in TOML_SLIPS.items() if re.search(sign, f"{said}: {line}")), "")
        raise Refusal(f"{file}: is not valid TOML: {said}{f': {line[:80]!r}' if number else ''}{hint}") from error


def _named_line(text: str, said: str) -> tuple[int, str]:
    """Return number and text of the line that a message of the TOML reader names, 0 and "" where it names none."""
    found, lines = re.search(r"at line (\d+)", said), text.split("\n")
    number = int(found[1]) if found and int(found[1]) <= len(lines) else 0
    return (number, lines[number - 1].strip()) if number else (0, "")


def read_schema(file: Path, schema: str, expected: str) -> tuple[str, Table]:
    """Return the text and the whole of a TOML file, which has to be of a schema; ``expected`` as for `read_toml`."""
    text, values = read_toml(file, expected)
    if (found := values.get("schema")) != schema:
        other = (kind := OTHER_SCHEMA.fullmatch(str(found)[:80])) and kind[1] != schema.partition("/")[0]
        anew = f'write schema = "{schema}" at the top'
        ask = "this is a file of another kind: name one with that schema" if other else anew
        said = "is missing" if found is None else f"is {found!r:.80}"
        raise Refusal(f"{file}: schema {said}, expected {schema!r}; {ask}")
    return text, Table(values, file, "")


def _text(file: Path, expected: str) -> str:
    try:
        if not file.is_file():
            raise Refusal(f"{file}: {no_file(file)}; {expected}{what_is_beside(file, toml=True)}")
        if (size := file.stat().st_size) > LARGEST_FILE:
            raise Refusal(f"{file}: has {size} bytes, a TOML file of a bench has at most {LARGEST_FILE}; {expected}")
        return file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Refusal(
            f"{file}: byte {error.start} is not UTF-8, TOML has to be UTF-8; save the file as UTF-8"
        ) from error
    except (OSError, ValueError) as error:
        raise Refusal(f"{str(file)[:200]}: cannot be read ({getattr(error, 'strerror', error)})") from error


def _refuse_long_keys(file: Path, text: str) -> None:
    for number, line in enumerate(text.splitlines(), start=1):
        for part in BETWEEN_KEYS.split(line) if line.count(".") > LONGEST_KEY else ():
            if part.count(".") > LONGEST_KEY:
                raise Refusal(f"{file} line {number}: a key of {part.count('.') + 1} parts; expected at most two")


@dataclass(frozen=True)
class Table:
    """One TOML table with its file and header, for refusals that say where."""

    values: Mapping[str, Any]
    file: Path
    header: str

    def where(self, key: str) -> str:
        """Return file, table and key as text."""
        return f"{self.file} {self.header} {key}".replace("  ", " ")

    def has(self, key: str) -> bool:
        """Tell whether the key is given."""
        return key in self.values

    def only(self, known: Sequence[str]) -> None:
        """Refuse a key that is not one of some."""
        for key in self.values:
            if key not in known:
                where = f"{self.file} {self.header or 'top'}"
                raise Refusal(f"{where}: unknown key {key[:80]!r}{expected_one_of(key, tuple(known))}")

    def value(self, key: Key, known: Sequence[str] = ()) -> Any:
        """Return the value of a key in SI, its default where it is left out and may be.

        ``known`` keys are not taken for a misspelt one.

        Raises
        ------
        Refusal : missing, of another type, or outside its band
        """
        if key.name not in self.values:
            if not key.required:
                return key.default
            hint = did_you_mean(key.name, [k for k in self.values if k not in known], "is it")
            raise Refusal(f"{self.where(key.name)}: this key is missing{hint}; {key.meaning}")
        if self.values[key.name] == UNKNOWN:
            raise Refusal(f"{self.where(key.name)}: is still {UNKNOWN!r}; {key.meaning}")
        return PARSERS[key.kind](self, key, self.values[key.name])

    def table(self, name: str, optional: bool = False) -> Table:
        """Return the table below this one."""
        header = f"{self.header[:-1]}.{name}]" if self.header else f"[{name}]"
        value = self.values.get(name, {}) if optional else self.values.get(name)
        if value is None:
            raise Refusal(f"{self.file}: the table {header} is missing{did_you_mean(name, [*self.values], 'is it')}")
        if not isinstance(value, dict):
            raise Refusal(f"{self.file} {name}: found {_shown(value)}, expected a table {header}")
        return Table(value, self.file, header)

    def tables(self, name: str) -> list[Table]:
        """Return the tables of an array of tables, at least one."""
        value = self.values.get(name, [])
        if not isinstance(value, list) or not value or not all(isinstance(item, dict) for item in value):
            hint = "" if name in self.values else did_you_mean(name, [*self.values], "is it")
            raise Refusal(f"{self.file}: expected at least one [[{name}]] table, found {_shown(value)}{hint}")
        return [Table(item, self.file, f"[[{name}]] no. {number}") for number, item in enumerate(value, start=1)]


def read_keys(table: Table, schema: TableSchema, problems: Problems) -> dict[str, Any]:
    """Return attribute -> value for every used key of a schema; what is wrong is noted in ``problems`` and left out."""
    values = {}
    for key in schema.keys:
        with problems.collecting():
            value = table.value(key, schema.names)
            if key.used:
                values[key.attribute] = value
    return values


def read_closed(table: Table, schema: TableSchema, *others: str) -> dict[str, Any]:
    """Return attribute -> value of a table that holds the keys of a schema, perhaps ``others``, and no more.

    Raises
    ------
    Refusals : all that is wrong
    """
    problems = Problems()
    with problems.collecting():
        table.only((*schema.names, *others))
    values = read_keys(table, schema, problems)
    problems.raise_any(listed=False)
    return values


def _shown(value: Any) -> str:
    try:
        text = f"the date or time {value}" if isinstance(value, date | time) else repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def _number(table: Table, key: Key, value: Any) -> float:
    return key.si(_in_band(table, key, value))


def _in_band(table: Table, key: Key, value: Any) -> Any:
    band = key.band
    assert band is not None  # every number has one
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise Refusal(f"{table.where(key.name)}: found {_shown(value)}, expected a number")
    if not band.holds(value):
        unit = f" {key.unit.replace('_per_', '/').replace('_', ' ')}" if key.unit else ""
        slip = key.slip(value) if abs(value) < 1e300 and math.isfinite(value) else ""
        raise Refusal(
            f"{table.where(key.name)}: found {_shown(value)}, expected a number from {band}{unit} ({band.reason}){slip}"
        )
    return value


def _whole(table: Table, key: Key, value: Any) -> int:
    number = _in_band(table, key, value)
    if number != int(number):
        raise Refusal(f"{table.where(key.name)}: found {_shown(value)}, expected a whole number")
    return int(number)


def _numbers(table: Table, key: Key, value: Any) -> tuple[float, ...]:
    if not isinstance(value, list) or not 0 < len(value) <= 100:
        raise Refusal(f"{table.where(key.name)}: found {_shown(value)}, expected a list of numbers")
    return tuple(_number(table, key, item) for item in value)


def _pair(table: Table, key: Key, value: Any) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != 2:
        raise Refusal(f"{table.where(key.name)}: found {_shown(value)}, expected two numbers in brackets")
    return _numbers(table, key, value)


def _flag(table: Table, key: Key, value: Any) -> bool:
    if not isinstance(value, bool):
        raise Refusal(f"{table.where(key.name)}: found {_shown(value)}, expected true or false")
    return value


def _text_value(table: Table, key: Key, value: Any) -> str:
    if not isinstance(value, str):
        raise Refusal(f"{table.where(key.name)}: found {_shown(value)}, expected text in quotes")
    if key.required and not value.strip():
        raise Refusal(f"{table.where(key.name)}: is blank, expected text; {key.meaning}")
    if len(value) > LONGEST_TEXT:
        raise Refusal(f"{table.where(key.name)}: has {len(value)} characters, expected at most {LONGEST_TEXT}")
    if any(CONTROL.search(line) for line in value.splitlines()):
        raise Refusal(f"{table.where(key.name)}: found {_shown(value)}, which holds control characters; remove them")
    return value


def _path(table: Table, key: Key, value: Any) -> Path:
    text = _text_value(table, key, value)
    if not text.strip() or max(map(len, Path(text).parts), default=0) > 255:
        raise Refusal(f"{table.where(key.name)}: found {_shown(value)}, expected the path of a file")
    return Path(table.file.parent / text)


def _choice(table: Table, key: Key, value: Any) -> Any:
    word = _text_value(table, key, value)
    chosen = word if word in key.choices else word.lower()
    if chosen not in key.choices:
        hint = did_you_mean(word, tuple(key.choices))
        raise Refusal(f"{table.where(key.name)}: found {_shown(word)}, expected one of {', '.join(key.choices)}{hint}")
    return key.choices[chosen]


def _date(table: Table, key: Key, value: Any) -> date:
    if isinstance(value, datetime):
        return value.date()
    if isinstance(value, date):
        return value
    try:
        return datetime.fromisoformat(str(value)).date()
    except ValueError as error:
        raise Refusal(f"{table.where(key.name)}: found {_shown(value)}, expected a date like 2025-01-31") from error


PARSERS = {
    "number": _number,
    "whole": _whole,
    "numbers": _numbers,
    "pair": _pair,
    "flag": _flag,
    "text": _text_value,
    "path": _path,
    "choice": _choice,
    "date": _date,
}
"""Kind of a key -> what reads it."""

"""Checked access to a TOML table: a value comes out with type and limits checked, or is refused with its place."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from camtorque.records import Refusal
from camtorque.units import did_you_mean


def read_toml(file: Path, expected: str) -> tuple[str, dict[str, Any]]:
    """Return the text and the tables of a TOML file; ``expected`` ends the refusal of a missing file."""
    if not file.is_file():
        raise Refusal(f"{file}: no such file; {expected}")
    try:
        text = file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Refusal(
            f"{file}: byte {error.start} is not UTF-8, TOML has to be UTF-8; save the file as UTF-8"
        ) from error
    except OSError as error:
        raise Refusal(f"{file}: cannot be read ({error.strerror})") from error
    if not text.strip():
        raise Refusal(f"{file}: is empty; {expected}")
    try:
        return text, tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise Refusal(f"{file}: is not valid TOML: {error}") from error


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

    def _get(self, key: str) -> Any:
        if key not in self.values:
            hint = did_you_mean(key, tuple(self.values))
            raise Refusal(f"{self.where(key)}: this key is missing{hint.replace('did you mean', 'is it')}")
        return self.values[key]

    def text(self, key: str, default: str | None = None) -> str:
        """Return a string; without ``default`` the key is required and may not be blank."""
        if default is not None and key not in self.values:
            return default
        value = self._get(key)
        if not isinstance(value, str):
            raise Refusal(f"{self.where(key)}: found {value!r}, expected text in quotes")
        if default is None and not value.strip():
            raise Refusal(f"{self.where(key)}: is blank, expected text")
        return value

    def path(self, key: str) -> Path:
        """Return a path relative to the file."""
        return Path(self.file.parent / self.text(key))

    def choice(self, key: str, allowed: tuple[str, ...], lower: bool = False) -> str:
        """Return one of the allowed words."""
        value = self.text(key)
        value = value.lower() if lower else value
        if value not in allowed:
            hint = did_you_mean(value, allowed)
            raise Refusal(f"{self.where(key)}: found {value!r}, expected one of {', '.join(allowed)}{hint}")
        return value

    def number(
        self,
        key: str,
        *,
        default: float | None = None,
        above: float = -math.inf,
        least: float = -math.inf,
        below: float = math.inf,
    ) -> float:
        """Return a finite number with ``above < value < below`` and ``value >= least``."""
        if default is not None and key not in self.values:
            return default
        value = self._get(key)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise Refusal(f"{self.where(key)}: found {value!r}, expected a number")
        if not math.isfinite(value) or value <= above or value < least or value >= below:
            limits = [(">", above), (">=", least), ("<", below)]
            rule = " and ".join(f"{sign} {limit:g}" for sign, limit in limits if math.isfinite(limit)) or "finite"
            raise Refusal(f"{self.where(key)}: found {value!r}, expected a number {rule}")
        return float(value)

    def optional_number(self, key: str, *, above: float = -math.inf, least: float = -math.inf) -> float | None:
        """Return a number, or None where the key is not given."""
        return self.number(key, above=above, least=least) if key in self.values else None

    def integer(self, key: str, *, default: int | None = None, least: int) -> int:
        """Return a whole number."""
        value = self.number(key, default=default, least=least)
        if value != int(value):
            raise Refusal(f"{self.where(key)}: found {value!r}, expected a whole number")
        return int(value)

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            raise Refusal(f"{self.where(key)}: found {value!r}, expected true or false")
        return value

    def table(self, key: str, optional: bool = False) -> Table:
        """Return the table below this one."""
        header = f"{self.header[:-1]}.{key}]" if self.header else f"[{key}]"
        value = self.values.get(key, {}) if optional else self.values.get(key)
        if value is None:
            hint = did_you_mean(key, tuple(self.values))
            raise Refusal(f"{self.file}: the table {header} is missing{hint.replace('did you mean', 'is it')}")
        if not isinstance(value, dict):
            raise Refusal(f"{self.file} {key}: found {value!r}, expected a table {header}")
        return Table(value, self.file, header)

    def tables(self, key: str) -> list[Table]:
        """Return the tables of an array of tables, at least one."""
        value = self.values.get(key, [])
        if not isinstance(value, list) or not value or not all(isinstance(item, dict) for item in value):
            raise Refusal(f"{self.file}: expected at least one [[{key}]] table, found {value!r:.60}")
        return [Table(item, self.file, f"[[{key}]] no. {number}") for number, item in enumerate(value, start=1)]

    def keys_of_tables(self) -> tuple[str, ...]:
        """Return the keys of this table, each of which has to be a table."""
        return tuple(self.values)

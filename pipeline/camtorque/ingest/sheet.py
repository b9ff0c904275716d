"""The sheet of a sensor: a file of its own, or its keys right in the recording's ``[sensors.*]`` table."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from camtorque.config import SensorRef
from camtorque.config.recording import unknown_keys
from camtorque.config.schemas import SHEET, SHEET_KEYS
from camtorque.config.tables import Problems, Table, read_keys, read_toml
from camtorque.records import Finding, Refusal

DEFAULTS = {key.attribute: key.default for key in SHEET_KEYS}
PERCENT = re.compile(r"(\d{1,9}(?:\.\d{1,9})?)\s*%")
ORDER = re.compile(
    r"(\d{1,2}) ?(?:st|nd|rd|th|\.)?[- ]?(?:order|pol|ordnung)|(?:order|ordnung)[ :=]*(\d{1,2})", re.IGNORECASE
)
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
KINDS = {"bessel": 0.866, "butterworth": 0.7071}
"""Damping ratio of a low-pass of second order by the kind that a sheet names."""


@dataclass(frozen=True)
class Sheet:
    """What a sheet says: attribute -> value, with `camtorque.config.schemas.SHEET_KEYS`; ``where`` begins a refusal.

    ``certificate`` is None where the sensitivity is stated or the logger has scaled already.
    """

    values: Mapping[str, Any]
    where: str
    serial: str
    certificate: Path | None
    files: tuple[Path, ...]
    findings: tuple[Finding, ...]

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    def percent(self, name: str) -> float | None:
        """Return the percentage in a note, None where it holds none."""
        found = PERCENT.search(self.values[name])
        return float(found[1]) if found else None

    def accuracy(self) -> float | None:
        """Return the stated accuracy as a share of the range, None where none is stated."""
        for name in ("accuracy_percent_fs", "accuracy_class"):
            if self.values[name] is not None:
                return self.values[name] / 100.0
        return None

    @property
    def place(self) -> str:
        """Name of its file, for findings."""
        return self.files[0].name if self.files else self.where

    @property
    def filter_order(self) -> int:
        """Order of the low-pass as the sheet names it, 0 where it does not."""
        named = self.values["filter"].lower()
        for number, word in enumerate(ORDINALS, 1):
            named = named.replace(f"{word}-order", f"{number}-order").replace(f"{word} order", f"{number}-order")
        found = ORDER.search(named)
        return int(found[1] or found[2]) if found and self.values["cutoff_hz"] is not None else 0

    @property
    def filter_damping(self) -> float:
        """Damping ratio of the kind of low-pass that the sheet names, nan where it names none."""
        named = self.values["filter"].lower()
        return next((ratio for kind, ratio in KINDS.items() if kind in named), math.nan)


def read_sheet(reference: SensorRef) -> Sheet:
    """Return the sheet that a recording names or states.

    Raises
    ------
    Refusal : no such file, a wrong key, another serial or quantity than the recording's, or sheet and keys together
    """
    if reference.calibration_path is None:
        where = f"[sensors.{reference.quantity}]"
        serial = reference.serial or f"{reference.quantity} sensor"
        return Sheet({**DEFAULTS, **reference.sheet}, where, serial, None, (), ())
    stated = [name for name, value in reference.sheet.items() if value != DEFAULTS[name]]
    path = reference.calibration_path
    if stated:
        raise Refusal(
            f"[sensors.{reference.quantity}] {stated[0]}: is given beside the sheet {path}; write it into the sheet, "
            "or leave calibration out and give all of the sheet here"
        )
    _, values = read_toml(path, f"[sensors.{reference.quantity}] names it as the sheet of its sensor")
    table = Table(values, path, "").table("sensor")
    problems = Problems()
    read = read_keys(table, SHEET, problems)
    problems.raise_any()
    serial, quantity = read.pop("serial"), read.pop("quantity")
    if reference.serial and serial != reference.serial:
        raise Refusal(f"{path}: is the sheet of {serial}, [sensors.{reference.quantity}] has {reference.serial}")
    if quantity != reference.quantity:
        raise Refusal(f"{path}: quantity is {quantity!r}, but recording.toml names it for {reference.quantity!r}")
    certificate = read.pop("certificate")
    files = (path,) if certificate is None else (path, certificate)
    findings = tuple(unknown_keys(table.values, SHEET.names, path.name))
    return Sheet(read, f"{path} [sensor]", serial, certificate, files, findings)

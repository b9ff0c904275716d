"""What every room uses: read-only arrays, an estimate, and the two ways of saying that something is wrong."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Integers = NDArray[np.int64]
SEVERITIES = ("info", "warning", "error")
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Characters that move a cursor, colour a terminal or turn the direction of a text."""


def printable(text: str) -> str:
    """Return a text that may come from a stranger's file with its control characters written out."""
    return CONTROL.sub(lambda found: " " if found[0].isspace() else ascii(found[0])[1:-1], text)


class Refusal(Exception):
    """The input cannot be used; the message says what was found, what was expected, where and what to do.

    The command line prints it as one line on standard error and exits with status 2.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def require(packages: tuple[str, ...], what: str, extra: str) -> None:
    """Refuse a choice whose optional packages are not installed, naming the extra that brings them."""
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        raise Refusal(
            f"{what}: found no package {', '.join(missing)}, expected the extra {extra!r}; "
            f"pip install 'camtorque[{extra}]'"
        )


@dataclass(frozen=True)
class Finding:
    """Something the user has to know about usable data.

    Attributes
    ----------
    code : short identifier such as ``pressure_clipped``
    severity : one of ``info``, ``warning``, ``error``
    text : one sentence a test engineer understands
    where : file, channel, sample or cycle
    """

    code: str
    severity: str
    text: str
    where: str = ""

    def __post_init__(self) -> None:
        if self.severity not in SEVERITIES:
            raise ValueError(f"severity is {self.severity!r}, expected one of {SEVERITIES}")
        for name in ("text", "where"):
            object.__setattr__(self, name, printable(getattr(self, name)))


class ReadOnly:
    """A frozen dataclass whose arrays, and those in its dictionaries, cannot be written once it is made."""

    def __post_init__(self) -> None:
        for value in vars(self).values():
            for array in value.values() if isinstance(value, Mapping) else (value,):
                if isinstance(array, np.ndarray):
                    array.setflags(write=False)


@dataclass(frozen=True)
class Estimate:
    """A value with its standard uncertainty, in the unit of the quantity that it belongs to."""

    value: float
    stderr: float
    nominal: float = float("nan")
    stderr_statistical: float = float("nan")

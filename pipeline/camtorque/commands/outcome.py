"""What a command hands to the command line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

Tell = Callable[[str], None]
"""Takes one line of progress."""


@dataclass(frozen=True)
class Outcome:
    """What a command found.

    Attributes
    ----------
    text : for a person at a terminal
    document : the same for a program (`--json`); empty where the command has none
    status : exit status
    stream : text and document of things that are told as they happen, before ``text``
    """

    text: str
    document: Mapping[str, Any]
    status: int = 0
    stream: Iterable[tuple[str, Mapping[str, Any]]] = ()

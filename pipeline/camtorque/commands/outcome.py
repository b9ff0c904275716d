"""What a command hands to the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
    """

    text: str
    document: Mapping[str, Any]
    status: int = 0

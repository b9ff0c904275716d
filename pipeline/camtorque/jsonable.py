"""JSON-ready values of any record, texts without control characters, and the time."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""Control characters of terminals and signs that turn the direction of writing; tab and new line stay."""


def clean(text: str) -> str:
    """Return a text without control characters and marks of writing direction; lost bytes are escaped."""
    return UNPRINTABLE.sub("\ufffd", text.replace("\r\n", "\n").encode("utf-8", "backslashreplace").decode("utf-8"))


def jsonable(value: Any) -> Any:
    """Return JSON-ready values: numpy to Python, tuples to lists, numbers that are not finite to None, texts clean."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [jsonable(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return clean(str(value)) if isinstance(value, Path | str) else value


def now() -> str:
    """Return the time as ISO-8601 with zone."""
    return datetime.now(UTC).astimezone().isoformat(timespec="seconds")

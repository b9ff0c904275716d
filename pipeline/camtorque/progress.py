"""Progress of a long job, for a person who waits."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

Progress = Callable[[str], None]
"""Takes one line."""
T = TypeVar("T")


def silent(text: str) -> None:
    """Say nothing."""


def duration_text(seconds: float) -> str:
    """Return a remaining time in words."""
    if seconds < 90.0:
        return f"about {max(seconds, 1.0):.0f} s"
    return f"about {seconds / 60.0:.0f} min" if seconds < 5400.0 else f"about {seconds / 3600.0:.1f} h"


def announced(items: Mapping[str, T], progress: Progress) -> Iterator[T]:
    """Yield items by name, telling before each which it is and, after the first, how long the rest will take."""
    start = time.perf_counter()
    for number, (name, item) in enumerate(items.items()):
        left = (time.perf_counter() - start) / number * (len(items) - number) if number else None
        progress(f"{name}, {number + 1} of {len(items)}" + ("" if left is None else f", {duration_text(left)} left"))
        yield item

"""Folders at or below one that hold a file; symbolic links are followed, loops refused."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from camtorque.hashes import real_path
from camtorque.records import Refusal


def files_below(folder: Path, name: str, closed: list[Path] | None = None) -> list[Path]:
    """Return the files of a name in and below a folder, in order; one that several links lead to once.

    Folders that cannot be looked into are added to ``closed``.

    Raises
    ------
    Refusal : a link leads back to a folder above it; a folder cannot be looked into, and there is no ``closed``
    """
    first: dict[Path, Path] = {}
    shut: list[Path] = []
    for path in sorted(walk(folder, name, shut)) if folder.is_dir() else []:
        first.setdefault(real_path(path), path / name)
    if closed is not None:
        closed += shut
    elif shut:
        raise Refusal("; also ".join(f"{path}: {why_closed(path, name)}" for path in sorted(shut)))
    return list(first.values())


def why_closed(folder: Path, name: str) -> str:
    """Return why a folder cannot be looked into for files of a name, and what to do."""
    if folder.is_symlink():
        return f"is a link that leads nowhere: each {name} behind it is missed; mount or correct what it names"
    return f"may not be read: each {name} in it is missed; correct its rights"


def walk(folder: Path, name: str, closed: list[Path], above: tuple[tuple[int, int], ...] = ()) -> Iterator[Path]:
    """Yield the folders that hold a file of a name; hidden ones may be half-written and are passed over.

    Folders below that may not be read, and links that lead nowhere, are added to ``closed``.
    """
    status = folder.stat()
    own = (status.st_dev, status.st_ino)
    if own in above:
        raise Refusal(f"{folder}: found a link that leads back to a folder above it, expected no loop; remove the link")
    try:
        entries = os.scandir(folder)
    except PermissionError:
        if not above:
            raise
        closed.append(folder)
        return
    with entries:
        for entry in entries:
            if entry.name == name:
                yield folder
            elif entry.name.startswith("."):
                continue
            elif Path(entry).is_dir():  # a link to itself is none
                yield from walk(folder / entry.name, name, closed, (*above, own))
            elif entry.is_symlink() and not Path(entry).exists():
                closed.append(folder / entry.name)

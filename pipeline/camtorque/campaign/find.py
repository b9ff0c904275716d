"""Recordings at or below a folder; symbolic links are followed, loops refused."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from camtorque.config.schemas import RECORDING_FILE
from camtorque.hashes import real_path
from camtorque.records import Finding, Refusal


def search(folder: Path) -> tuple[dict[str, Path], tuple[Finding, ...]]:
    """Return every recording at or below a folder by its relative path.

    There is a finding for each further link to one, and for each folder below that may not be read.

    Raises
    ------
    Refusal : the folder is missing or holds no recording; a link leads back to a folder above it; one below the folder
        is called as the folder itself, which is a recording, too
    """
    if not folder.is_dir():
        raise Refusal(f"{folder}: found no such folder, expected one with recordings below it; check the path")
    names: dict[str, Path] = {}
    closed: list[Path] = []
    first: dict[Path, str] = {}
    found = sorted(_walk(folder, (), closed))
    findings = [
        Finding(
            "folder_unreadable", "warning", "may not be read: recordings in it are missed; correct its rights", str(p)
        )
        for p in closed
    ]
    for path in found:
        name = path.relative_to(folder).as_posix()
        name = real_path(folder).name if name == "." else name
        known = first.setdefault(real_path(path), name)
        if known != name:
            text = f"{name} is the recording {known} under another name; it counts once"
            findings.append(Finding("linked_twice", "info", text, str(path)))
        elif name in names:
            raise Refusal(f"{path}: found another recording called {name}, {names[name]}; rename one of the folders")
        else:
            names[name] = path
    if not names:
        raise Refusal(f"{folder}: found no {RECORDING_FILE} at or below it, expected one per recording; check the path")
    return names, tuple(findings)


def _walk(folder: Path, above: tuple[tuple[int, int], ...], closed: list[Path]) -> Iterator[Path]:
    """Yield the folders that hold a recording; hidden ones may be half-written and are passed over.

    Folders below that may not be read are added to ``closed``.
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
            if entry.name == RECORDING_FILE:
                yield folder
            elif not entry.name.startswith(".") and Path(entry).is_dir():  # a link to itself is none
                yield from _walk(folder / entry.name, (*above, own), closed)

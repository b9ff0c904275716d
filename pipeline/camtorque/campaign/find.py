"""Recordings at or below a folder; symbolic links are followed, loops refused."""

from __future__ import annotations

from pathlib import Path

from camtorque.config.schemas import RECORDING_FILE
from camtorque.hashes import real_path
from camtorque.process.folders import walk, why_closed
from camtorque.records import Finding, Refusal


def search(folder: Path) -> tuple[dict[str, Path], tuple[Finding, ...]]:
    """Return every recording at or below a folder by its relative path.

    There is a finding for each further link to one, each folder below that may not be read, each link to nothing.

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
    found = sorted(walk(folder, RECORDING_FILE, closed))
    findings = [Finding("folder_unreadable", "warning", why_closed(path, RECORDING_FILE), str(path)) for path in closed]
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
        shut = "".join(f"; {finding.where} {finding.text}" for finding in findings)
        todo = shut or "; check the path"
        raise Refusal(f"{folder}: found no {RECORDING_FILE} at or below it, expected one per recording{todo}")
    return names, tuple(findings)

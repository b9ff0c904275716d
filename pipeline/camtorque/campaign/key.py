"""What a result depends on, as one hash: inputs, configuration, options and the code itself."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from functools import cache
from pathlib import Path

from camtorque.config.recording import load_recording_config
from camtorque.config.schemas import RECORDING_FILE
from camtorque.hashes import file_digest
from camtorque.ingest.sheet import read_sheet
from camtorque.records import Refusal
from camtorque.run import RunOptions
from camtorque.version import __version__

LENGTH = 32
"""Hex digits of a key: 128 bits."""


@cache
def code_digest() -> str:
    """Return the hash of the version and of every source file of this package: an edited law is another result."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256(__version__.encode())
    for file in sorted(package.rglob("*.py")):
        digest.update(file.relative_to(package).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def recording_key(name: str, path: Path, options: RunOptions) -> str:
    """Return the key of one recording's result."""
    content = {
        "name": name,
        "code": code_digest(),
        "options": asdict(options),
        "inputs": [[file.name, _digest(file)] for file in input_paths(path)],
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()[:LENGTH]


def input_paths(path: Path) -> tuple[Path, ...]:
    """Return the files that a recording names, whether they exist or not: configuration, sheets, cam table, logs.

    A configuration that cannot be used names itself alone.
    """
    try:
        config = load_recording_config(path)
    except Refusal:
        return (path / RECORDING_FILE if path.is_dir() else path,)
    files = [config.path, *(() if config.pump_sheet is None else (config.pump_sheet.cam_table_path,))]
    for reference in config.sensors.values():
        try:
            files += read_sheet(reference).files
        except Refusal:
            files += [path for path in (reference.calibration_path,) if path is not None]
    return tuple(dict.fromkeys([*files, *(spec.path for spec in config.channels)]))


def _digest(file: Path) -> str:
    """Return the SHA-256 of a file, or why it cannot be read: another reason is another key."""
    try:
        return file_digest(file)
    except OSError as error:
        return f"cannot be read: {error.strerror}"

"""SHA-256 of the files that were read."""

from __future__ import annotations

import hashlib
from pathlib import Path

from pipeline.records import InputFile, Refusal


def hash_file(path: Path) -> InputFile:
    """Return the file with its SHA-256, read in pieces."""
    try:
        with path.open("rb") as file:
            return InputFile(path, hashlib.file_digest(file, "sha256").hexdigest())
    except OSError as error:
        raise Refusal(f"{path}: cannot be read ({error.strerror})") from error

"""SHA-256 of files, and where they are."""

from __future__ import annotations

import errno
import hashlib
import os
from functools import partial
from pathlib import Path

from camtorque.records import InputFile, Refusal


def input_file(path: Path) -> InputFile:
    """Return the file with a SHA-256 that is taken when asked for, and only of the file as it is now."""
    try:
        return InputFile(path, partial(_hash, path, _state(path)))
    except OSError as error:
        raise Refusal(f"{path}: cannot be read ({error.strerror})") from error


def input_files(*paths: Path | None) -> tuple[InputFile, ...]:
    """Return those of some files that there are, each once, as `input_file` does."""
    return tuple(input_file(path) for path in dict.fromkeys(paths) if path is not None)


def real_path(path: Path) -> Path:
    """Return a path without links; a circle of links stays, for which `Path.resolve` has an error of its own."""
    return Path(os.path.realpath(path))


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file in hex.

    Raises
    ------
    OSError : it cannot be read, or is a pipe or device, which would be waited for without end
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "no regular file", str(path))
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _state(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_size, status.st_mtime_ns


def _hash(path: Path, state: tuple[int, int]) -> str:
    try:
        digest = file_digest(path)
        if _state(path) == state:
            return digest
    except OSError as error:
        raise Refusal(f"{path}: cannot be read again for its SHA-256 ({error.strerror})") from error
    raise Refusal(f"{path}: was changed while it was used; run again when nothing writes to it")

"""Writable places for the caches of numba (which else does not load) and of matplotlib (which else warns).

Numba keeps a compiled function until its own file changes, whatever becomes of what it calls: after an update a solver
would go on with the laws of the version before. What is kept counts for the sources of all compiled functions here.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from functools import cache
from pathlib import Path

PLACES = {"NUMBA_CACHE_DIR": "numba", "MPLCONFIGDIR": "matplotlib"}
"""Environment variable -> folder below the private one."""

COMPILED_IN = (".", "align", "design", "fit", "laws", "mechanism", "signal", "studies")
"""Rooms that have compiled functions, or constants of theirs, as the top has units: not all, so that a page may change
without a quarter of a minute of compiling."""
SOURCES = "camtorque.sources"
"""File beside compiled functions that tells which sources they were made from."""


@cache
def sources(package: Path) -> str:
    """Return a hash of all sources that compiled functions are made from."""
    found = hashlib.sha256()
    for room in COMPILED_IN:
        for path in sorted((package / room).glob("*.py")):
            found.update(path.name.encode())
            found.update(path.read_bytes())
    return found.hexdigest()


@cache
def made_from(package: Path, folder: Path) -> bool:
    """Tell whether the compiled functions that numba keeps in a folder are of these sources; delete all if not.

    False where they can be neither trusted nor deleted.
    """
    told, expected = folder / SOURCES, sources(package)
    try:
        if told.is_file() and told.read_text(encoding="ascii", errors="replace") == expected:
            return True
        for kept in folder.glob("*.nb[ci]"):
            kept.unlink(missing_ok=True)
        told.write_text(expected, encoding="ascii")
    except OSError:
        return False
    return True


def find_caches(package: Path) -> None:
    """Point the caches to a private temporary folder where neither ``package`` nor the home folder can be written."""
    if _home_is_writable():
        return
    private = _private_folder()
    for name, folder in PLACES.items():
        beside = name == "NUMBA_CACHE_DIR" and os.access(package, os.W_OK)
        if private is not None and name not in os.environ and not beside:
            (private / folder).mkdir(exist_ok=True)
            os.environ[name] = str(private / folder)


def _home_is_writable() -> bool:
    """Tell whether the folders of the user's cache and settings can be written, made where they are missing."""
    try:
        home = Path.home()
        for variable, name in (("XDG_CACHE_HOME", ".cache"), ("XDG_CONFIG_HOME", ".config")):
            folder = Path(os.environ.get(variable) or home / name)
            folder.mkdir(parents=True, exist_ok=True)
            if not os.access(folder, os.W_OK | os.X_OK):
                return False
    except (OSError, RuntimeError):
        return False
    return True


def _private_folder() -> Path | None:
    """Return a temporary folder that nobody else can write: cached functions are code; None without any."""
    try:
        folder = Path(tempfile.gettempdir()) / f"camtorque-caches-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        own = not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & 0o077)
        return folder if own and not folder.is_symlink() else Path(tempfile.mkdtemp(prefix="camtorque-caches-"))
    except OSError:
        return None

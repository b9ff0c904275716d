"""What to say of a file that is not there: why, and which one may be meant."""

from __future__ import annotations

import os
import sys
from collections.abc import Collection
from pathlib import Path

from camtorque.units import did_you_mean, first_of

MOST_LISTED = 8
"""Files of a folder that a refusal names."""


def no_file(path: Path) -> str:
    """Return what is wrong with a path that is no file, in words."""
    try:
        os.fsencode(path)
    except UnicodeEncodeError:
        return (
            f"cannot be looked for: this system takes names of files in {sys.getfilesystemencoding()} alone; set "
            "LC_ALL=C.UTF-8 or PYTHONUTF8=1, or give the file a plain name"
        )
    if path.exists():
        return "is a folder" if path.is_dir() else "is a pipe or a device"
    return "is a symbolic link that leads nowhere" if path.is_symlink() else "no such file"


def what_is_beside(path: Path, *, toml: bool = False, used: Collection[Path] = ()) -> str:
    """Return the file that the path of a missing log or table may mean, as a question, or what the folder holds.

    ``toml``: a TOML file is missing, and only such are looked for; ``used`` files are named elsewhere, and not meant.
    """
    folder = path if path.is_dir() else path.parent
    if path.exists() and folder != path:
        return ""
    if "\\" in path.name:
        return "; its name holds a backslash: write / between folders"
    if not folder.is_dir():
        return f"; there is no folder {path.parent}"
    found = (item for item in folder.iterdir() if item.is_file() and (item.suffix == ".toml") is toml)
    names = tuple(sorted(item.name for item in found))
    nothing = "no TOML file" if toml else "no log or table"
    held = f"holds {first_of(names, MOST_LISTED) or nothing}"
    if folder == path:
        return f"; it {held}"
    free = tuple(name for name in names if folder / name not in used)
    return did_you_mean(path.name, free) or ("" if toml and not names else f"; its folder {held}")

"""Output folders: written under a temporary name beside the target, then renamed; nothing half-written."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from camtorque.records import Refusal

MARKERS = ("result.json", "campaign.json", "align.json", "predict.json")
"""A folder that holds one of these with a schema of this product may be replaced."""


def check_output(target: Path) -> None:
    """Refuse a target that holds anything but an earlier output of this command.

    Raises
    ------
    Refusal : the target is a file, or a folder with other things in it
    """
    if target.is_file():
        raise Refusal(f"--out {target}: found a file, expected a folder; choose another name")
    if target.is_dir() and any(target.iterdir()) and not _is_own(target):
        raise Refusal(
            f"--out {target}: found a folder with other files in it, expected a new one or an earlier report; "
            "choose another name"
        )
    check_writable(target)


def check_writable(target: Path) -> None:
    """Refuse a folder that cannot be written, before anything is computed for it.

    Raises
    ------
    Refusal : the nearest folder that exists is a file or may not be written to
    """
    above = target.resolve()
    while not above.exists():
        above = above.parent
    if not above.is_dir():
        raise Refusal(f"--out {target}: found a file {above} on the way, expected folders; choose another name")
    if not os.access(above, os.W_OK | os.X_OK):
        raise Refusal(f"--out {target}: found that {above} cannot be written to, expected a folder of yours")


def _is_own(folder: Path) -> bool:
    for name in MARKERS:
        try:
            schema = json.loads((folder / name).read_text(encoding="utf-8"))["schema"]
        except (OSError, ValueError, KeyError, TypeError):
            continue
        if str(schema).startswith("camtorque."):
            return True
    return False


@contextmanager
def output_folder(target: Path) -> Iterator[Path]:
    """Give a temporary folder that takes the place of the target when the block ends without an error.

    Parameters
    ----------
    target : the folder to be written; an earlier output of this command is replaced

    Raises
    ------
    Refusal : see `check_output`
    """
    check_output(target)
    target = target.resolve()
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f".{target.name}.partial-{os.getpid()}")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    try:
        yield partial
        _replace(partial, target)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _replace(partial: Path, target: Path) -> None:
    """Rename the finished folder; an earlier one stays aside until the new one is in place."""
    if not target.exists():
        partial.rename(target)
        return
    earlier = target.with_name(f".{target.name}.earlier-{os.getpid()}")
    target.rename(earlier)
    try:
        partial.rename(target)
    except OSError:
        earlier.rename(target)
        raise
    shutil.rmtree(earlier, ignore_errors=True)

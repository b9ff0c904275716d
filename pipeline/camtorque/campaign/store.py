"""The folder of one recording's result: written whole or not at all, remembered, read back for the joint fit."""

from __future__ import annotations

import io
import json
import os
import pickle
import shutil
import zlib
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

from camtorque.fit.joint_input import JointInput
from camtorque.jsonable import now
from camtorque.process.stopping import before_leaving
from camtorque.records import Refusal
from camtorque.report.bundle import CampaignEntry
from camtorque.report.files import write_json
from camtorque.report.folder import LOCK, check_writable, locked
from camtorque.results import CAMPAIGN, ENTRY, ENTRY_SCHEMA

JOINT = "joint.bin"
MARK = ".camtorque-campaign"
"""File that makes a folder the output of campaigns; the one that writes the index holds its lock."""
FOREIGN_CLASSES = {
    ("builtins", "dict"), ("pathlib", "PosixPath"), ("pathlib", "WindowsPath"),
    ("pathlib._local", "PosixPath"), ("pathlib._local", "WindowsPath"),  # Python 3.13
    ("numpy", "dtype"), ("numpy", "ndarray"), ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"), ("numpy._core.numeric", "_frombuffer"),
}  # fmt: skip
"""What the joint fit's input may hold beside records of this package."""
NO_PICKLE = (pickle.UnpicklingError, EOFError, AttributeError, ImportError, TypeError)
"""What reading a damaged one raises, or one that another version wrote."""


@contextmanager
def campaign_folder(out: Path) -> Iterator[Path]:
    """Give the folder of the results below ``out``, for one campaign at a time; what killed workers left is removed.

    Where nothing was finished in a new one, no folder is left.

    Raises
    ------
    Refusal : ``out`` holds something else or cannot be written; another campaign is writing there
    """
    first = not (out / MARK).exists()
    new = [folder for folder in (out, *out.parents) if not folder.exists()]
    runs = prepare_folder(out)
    lock = os.open(out / MARK, os.O_RDWR)
    try:
        if not locked(lock):
            raise Refusal(f"--out {out}: another campaign is writing there; wait for its end or choose another name")
        clear_partials(runs)
        try:
            with before_leaving(lambda: clear_partials(runs)):
                yield runs
        finally:
            clear_partials(runs)
    finally:
        os.close(lock)
        if first:
            _remove_empty(out, new)


def _remove_empty(out: Path, new: Sequence[Path]) -> None:
    """Remove the folders that were made for a campaign of which nothing was finished."""
    with suppress(OSError):  # of one that is not empty
        (out / "runs").rmdir()
        (out / MARK).unlink()
        for folder in new:
            folder.rmdir()


def prepare_folder(out: Path) -> Path:
    """Make ``out`` the output of a campaign and return its folder of results.

    Raises
    ------
    Refusal : ``out`` holds something else or cannot be written
    """
    check_writable(out)
    if out.is_dir() and any(out.iterdir()) and not ((out / MARK).exists() or (out / CAMPAIGN).exists()):
        raise Refusal(
            f"--out {out}: found a folder with other files in it, expected a new one or an earlier campaign; "
            "choose another name"
        )
    runs = out / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    (out / MARK).touch()
    return runs


def clear_partials(runs: Path) -> None:
    """Remove what killed workers left half-written; what a living one writes is locked and stays."""
    for partial in runs.glob(".*.partial"):
        with suppress(OSError):
            lock = os.open(partial / LOCK, os.O_RDWR | os.O_CREAT)
            try:
                if locked(lock):
                    shutil.rmtree(partial, ignore_errors=True)
            finally:
                os.close(lock)


def removed(runs: Path, kept: Collection[str]) -> tuple[int, int]:
    """Remove the folders of finished recordings but those of some keys; return how many and their bytes.

    A folder is hidden first: what a kill leaves of it is cleared like any other partial one.
    """
    count, size = 0, 0
    for folder in runs.iterdir():
        if folder.name in kept or folder.name.startswith(".") or not (folder / ENTRY).is_file():
            continue
        count, size = count + 1, size + sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        partial = folder.rename(runs / f".{folder.name}.partial")
        shutil.rmtree(partial)
    return count, size


def write_entry(folder: Path, entry: CampaignEntry) -> None:
    """Remember what became of a recording."""
    write_json(folder / ENTRY, {"schema": ENTRY_SCHEMA, "created": now(), **asdict(entry)})


def read_entry(folder: Path) -> CampaignEntry | None:
    """Return what became of a recording, None where it was not finished.

    Raises
    ------
    Refusal : what was kept of it is damaged
    """
    try:
        content = json.loads((folder / ENTRY).read_text(encoding="utf-8"))
        return CampaignEntry(**{key: value for key, value in content.items() if key not in ("schema", "created")})
    except FileNotFoundError:
        return None
    except (ValueError, TypeError, AttributeError) as error:
        raise Refusal(f"{folder / ENTRY}: is damaged ({error}); delete {folder} and run again") from error


def write_joint_input(folder: Path, item: JointInput) -> None:
    """Keep what the joint fit needs of a recording."""
    stream = io.BytesIO()
    _Writer(stream, protocol=5).dump(item)
    (folder / JOINT).write_bytes(zlib.compress(stream.getbuffer()))


def read_joint_input(folder: Path) -> JointInput:
    """Return a recording's input of the joint fit; only records of this package and numbers are accepted.

    Raises
    ------
    Refusal : the file is missing, damaged or holds anything else
    """
    path = folder / JOINT
    try:
        return _RecordsOnly(io.BytesIO(zlib.decompress(path.read_bytes()))).load()
    except (*NO_PICKLE, OSError, ValueError, zlib.error) as error:
        raise Refusal(f"{path}: cannot be used ({error}); delete {folder} and run again") from error


class _Writer(pickle.Pickler):
    """Writes read-only views of dictionaries as dictionaries: the views cannot be written."""

    def reducer_override(self, value: Any) -> Any:
        """Return how a value is made again."""
        return (dict, (dict(value),)) if isinstance(value, MappingProxyType) else NotImplemented


class _RecordsOnly(pickle.Unpickler):
    """Reads back records: a class of this package, or one of `FOREIGN_CLASSES`; no function can be called."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class that may be made."""
        if (module, name) in FOREIGN_CLASSES:
            return super().find_class(module, name)
        if module.startswith("camtorque.") and "." not in name:
            found = super().find_class(module, name)
            if isinstance(found, type) and found.__module__ == module:
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is no record")

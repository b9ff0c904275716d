"""Output folders: written under a temporary name beside the target, then renamed; nothing half-written.

The temporary folder carries a lock that ends with its process: a second run into the same target is refused, what a
killed run left is cleared away by the next one.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from camtorque.hashes import real_path
from camtorque.process.stopping import before_leaving
from camtorque.process.system import described
from camtorque.records import Refusal
from camtorque.report.files import unlisted_files, visible_files, write_checksums, write_crate
from camtorque.units import first_of

try:
    import fcntl
except ImportError:  # not on Windows: two runs into one folder are then not kept apart
    fcntl = None  # type: ignore[assignment]

MARKERS = ("result.json", "align.json", "predict.json", "design.json", "compare.json", "plan.json", "entry.json")
"""A folder that holds one of these with a schema of this product may be replaced."""
LEAST_SPACE = 20_000_000
"""Free bytes below which nothing is begun: a report needs a few megabytes, twice for a moment."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
LOCK = ".lock"
LONGEST_NAME = 200
"""Bytes of a file name beyond which a hidden neighbour of that name could be too long for the disk."""


class CannotWrite(Refusal):
    """The output is full, read-only or gone."""


class Busy(Refusal):
    """Another process is writing the same output."""


def check_output(target: Path, marker: str) -> None:
    """Refuse a target that holds anything but an earlier output of this command, which ``marker`` of `MARKERS` tells.

    Raises
    ------
    Refusal : the target is a file, a folder with other things in it, or one that cannot be replaced as a whole
    """
    whole = real_path(target)  # `missing/../folder` is a folder, which the path as it stands does not show
    if whole.is_file():
        raise Refusal(f"output {target}: found a file, expected a folder; choose another name")
    if whole.is_mount() or whole == Path.cwd():
        kind = "the place of a disk" if whole.is_mount() else "the folder in which the command runs"
        raise Refusal(
            f"output {target}: found {kind}, expected a folder that can be replaced as a whole; choose one inside it, "
            f"such as {target / 'report'}"
        )
    there = [path.name for path in _marker_paths(whole) if path.is_file()]
    own = any(str(document_of(whole / name).get("schema", "")).startswith("camtorque.") for name in there)
    if whole.is_dir() and any(whole.iterdir()) and not own:
        damaged = first_of(there, 3)
        what = f"{damaged} that is damaged or another program's" if damaged else "a folder with other files in it"
        raise Refusal(
            f"output {target}: found {what}, expected a new folder or an earlier report; choose another name"
            f"{', or delete it if it is a damaged report' if damaged else ''}"
        )
    if there and marker not in there:
        raise Refusal(
            f"output {target}: found a report of another command ({there[0]}), expected a new folder or one with "
            f"{marker}; choose another name"
        )
    if whole.is_dir() and (more := unlisted_files(whole)):
        named = first_of(more, 3)
        raise Refusal(
            f"output {target}: found {named} beside an earlier report, which would be lost, expected files of the "
            "report alone; move them away or choose another name"
        )
    check_writable(target)


def check_writable(target: Path) -> None:
    """Refuse a folder that cannot be written, before anything is computed for it.

    Raises
    ------
    Refusal : the nearest folder that exists is a file or may not be written to
    """
    above = real_path(target)
    while not above.exists():
        if above.is_symlink():
            raise Refusal(f"output {target}: found links in a circle at {above}, expected folders; choose another name")
        above = above.parent
    if not above.is_dir():
        raise Refusal(f"output {target}: found a file {above} on the way, expected folders; choose another name")
    if not os.access(above, os.W_OK | os.X_OK):
        raise Refusal(f"output {target}: found that {above} cannot be written to, expected a folder of yours")


def _marker_paths(folder: Path) -> list[Path]:
    return [folder / name for name in MARKERS]


def document_of(path: Path) -> dict[str, Any]:
    """Return the content of a JSON file, empty where there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


@contextmanager
def output_folder(target: Path, marker: str) -> Iterator[Path]:
    """Give a temporary folder that takes the place of the target, or of its earlier output, when the block ends well.

    ``marker`` is the file of `MARKERS` that is going to be written.

    Raises
    ------
    Refusal : see `check_output`; another run writes there; the place cannot be written, is full or went away
    """
    check_output(target, marker)
    with _written_beside(target, real_path(target)) as partial:
        yield partial
        seal(partial, target.name)
        check_output(target, marker)  # again: a file that somebody saved there since would be lost
        _replace(partial, real_path(target))


def seal(folder: Path, name: str) -> None:
    """Write where a finished folder came from, and the SHA-256 of all its files."""
    doc = next((doc for doc in map(document_of, _marker_paths(folder)) if "inputs" in doc and "created" in doc), None)
    if doc is not None:
        write_crate(folder, doc, name)
    write_checksums(folder, visible_files(folder))


@contextmanager
def output_files(target: Path) -> Iterator[Path]:
    """Give a temporary folder whose files, each as a whole, are moved into the target when the block ends well.

    For outputs that share a folder with others, such as the charts of two studies or the page of a campaign.

    Raises
    ------
    Refusal : another run writes there; the place cannot be written, is full or went away
    """
    # inside a folder that is there: beside it may be another disk, or not one's own
    whole = real_path(target)
    with _written_beside(target, whole / "files" if whole.is_dir() else whole) as partial:
        yield partial
        for file in sorted(partial.rglob("*")):
            if file.is_file() and file.name != LOCK:
                moved = whole / file.relative_to(partial)
                moved.parent.mkdir(parents=True, exist_ok=True)
                os.replace(file, moved)


@contextmanager
def _written_beside(target: Path, place: Path) -> Iterator[Path]:
    """Give an empty hidden neighbour of a place that is gone after the block, with the parents made for it."""
    partial = hidden(place, "partial")
    made: list[Path] = []

    def remove_parents() -> None:
        for folder in reversed(made):
            with suppress(OSError):
                folder.rmdir()  # only where it is empty: nothing was written

    try:
        made += _made_parents(partial.parent)
        _need_space(target, partial.parent)
        lock = _claimed(target, partial)
        try:
            restore_earlier(real_path(target))  # only now: it may be aside because another run is about to end
            with before_leaving(remove_parents), before_leaving(lambda: shutil.rmtree(partial, ignore_errors=True)):
                yield partial
        finally:
            os.close(lock)
            shutil.rmtree(partial, ignore_errors=True)
    except (OSError, RuntimeError) as error:  # HDF5 tells of a full disk by a RuntimeError
        if not is_about(error, partial):
            raise
        raise CannotWrite(cannot_write(f"output {target}", error)) from error
    finally:
        remove_parents()


def is_about(error: Exception, partial: Path) -> bool:
    """Tell whether an error belongs to what was written, not to a file that was read."""
    place = getattr(error, "filename", None)
    named = str(partial) in str(error) or (place is not None and str(partial).startswith(str(place)))
    return named or getattr(error, "errno", None) in FULL


def reserve(path: Path, size: int) -> None:
    """Make sure that the disk takes a file of ``size`` bytes: HDF5 cannot recover from a write that failed.

    Raises
    ------
    OSError : disk, quota or largest size of a file are too small
    """
    with path.open("wb") as file:
        try:
            os.posix_fallocate(file.fileno(), 0, size)
        except AttributeError:
            return  # not on every system
        except OSError as error:
            if error.errno in FULL:
                raise


def cannot_write(what: str, error: Exception) -> str:
    """Return one line on an error of the system while ``what`` (an option and its path) was written."""
    if isinstance(error, FileNotFoundError):
        return f"{what}: the folder that was being written went away; run again when nothing removes it"
    reason, advice = described(error)
    return f"{what}: cannot be written ({reason}); {advice}; an earlier report there is kept"


def hidden(target: Path, kind: str) -> Path:
    """Return the hidden neighbour of a target: ``partial`` is being written, ``earlier`` waits to be replaced."""
    name = os.fsencode(target.name)
    stem = target.name if len(name) <= LONGEST_NAME else hashlib.sha256(name).hexdigest()
    return target.with_name(f".{stem}.{kind}")


def restore_earlier(target: Path) -> None:
    """Put back a result that a run killed between two renames left aside, or clear away what it did not clear."""
    earlier = hidden(target, "earlier")
    if earlier.is_dir() and not target.exists():
        earlier.rename(target)
    shutil.rmtree(earlier, ignore_errors=True)


def _made_parents(folder: Path) -> list[Path]:
    """Make a folder with its parents; return those that were missing, outermost first."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()][::-1]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def _need_space(target: Path, folder: Path) -> None:
    total, _, free = shutil.disk_usage(folder)
    if not total:  # such as /proc and /sys
        raise CannotWrite(f"output {target}: {folder} is no place on a disk; choose another place")
    if free < LEAST_SPACE:
        raise CannotWrite(
            f"output {target}: found {free / 1e6:.1f} MB of free space, expected at least {LEAST_SPACE / 1e6:.0f} MB; "
            "free some space and run again"
        )


def _claimed(target: Path, partial: Path) -> int:
    """Return the lock of the temporary folder, which is empty then.

    Raises
    ------
    Refusal : another process holds it
    """
    while True:
        partial.mkdir(exist_ok=True)
        try:
            lock = os.open(partial / LOCK, os.O_RDWR | os.O_CREAT, 0o600)
        except FileNotFoundError:
            continue  # the run that held it has just finished
        if not locked(lock):
            os.close(lock)
            raise Busy(f"output {target}: another run is writing there; wait for its end or choose another name")
        if _is_file(lock, partial / LOCK):
            break
        os.close(lock)
    emptied(partial)
    return lock


def emptied(folder: Path) -> None:
    """Remove everything in a temporary folder but its lock."""
    for left in folder.iterdir():
        if left.name != LOCK:
            shutil.rmtree(left) if left.is_dir() and not left.is_symlink() else left.unlink()


def locked(descriptor: int) -> bool:
    """Take the lock of an open file, which ends with the process; False where another process has it."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True  # a file system without locks: better to write than to refuse for ever
    return True


def _is_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except OSError:
        return False


def _replace(partial: Path, target: Path) -> None:
    """Rename the finished folder; an earlier one stays aside until the new one is in place."""
    earlier = hidden(target, "earlier")
    if target.exists():
        target.rename(earlier)
    try:
        partial.rename(target)
    except BaseException:
        if earlier.exists():
            earlier.rename(target)
        raise
    # only now: without its lock the folder would be cleared by the next run
    (target / LOCK).unlink()
    shutil.rmtree(earlier, ignore_errors=True)

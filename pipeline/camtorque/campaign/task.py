"""One recording: what its result depends on, as one hash, and the unit of work.

Remembered results are handed back, the others computed and written whole.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from camtorque.campaign.store import read_entry, write_entry, write_joint_input
from camtorque.config.recording import load_recording_config
from camtorque.config.schemas import RECORDING_FILE
from camtorque.fit.joint_input import joint_input
from camtorque.hashes import file_digest
from camtorque.ingest.sheet import read_sheet
from camtorque.process.second_process import second_process
from camtorque.process.stopping import was_stopped
from camtorque.records import Refusal
from camtorque.report.bundle import OF_RECORDING, OF_RESULT, THUMBNAIL, CampaignEntry
from camtorque.report.curve_figures import thumbnail
from camtorque.report.folder import Busy, CannotWrite, emptied, is_about, output_folder
from camtorque.report.write import write_run
from camtorque.run import RunOptions, analyse
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


@dataclass(frozen=True)
class Task:
    """One recording of a campaign: its name, where it is read, the folder of all results, the user's choices.

    ``helped``: a core is idle beside its worker, and may do half of the work
    """

    name: str
    path: Path
    runs: Path
    options: RunOptions
    retry_failed: bool = False
    helped: bool = False


def run_task(task: Task) -> CampaignEntry:
    """Return what became of a recording: as remembered, or computed now and written.

    A refusal is remembered; what may be over next time (no memory, an unreadable file) is not.

    Raises
    ------
    CannotWrite : the output is full or went away, which no other recording would survive either
    """
    folder = task.runs / recording_key(task.name, task.path, task.options)
    try:
        known = read_entry(folder)
        if known is not None and (known.status == "ok" or not task.retry_failed):
            return known
        with output_folder(folder, "entry.json") as partial:
            return _done(task, folder.name, partial)
    except Busy:
        return refused(task.name, "another process is computing it; run again after its end")
    except CannotWrite:
        raise
    except Refusal as refusal:  # of what is kept in its folder
        return refused(task.name, str(refusal))
    except (OSError, MemoryError) as error:
        return refused(task.name, f"{type(error).__name__}: {error}; run again")


def refused(name: str, error: str, key: str = "") -> CampaignEntry:
    """Return the entry of a recording that could not be used."""
    return CampaignEntry(name, "", "refused", error, {}, folder=f"runs/{key}" if key else "")


def _done(task: Task, key: str, folder: Path) -> CampaignEntry:
    """Write the report of one recording, or why there is none."""
    try:
        entry = _reported(task, key, folder)
    except CannotWrite:
        raise
    except Refusal as refusal:
        entry = refused(task.name, str(refusal), key)
    except (OSError, MemoryError):
        raise
    except Exception as error:  # one broken recording must not stop a campaign of hundreds
        if is_about(error, folder) or was_stopped():
            raise
        entry = refused(task.name, f"unexpected {type(error).__name__}: {error}", key)
    if entry.status != "ok":
        emptied(folder)
    write_entry(folder, entry)
    return entry


def _reported(task: Task, key: str, folder: Path) -> CampaignEntry:
    with second_process(task.helped):
        result, prepared = analyse(task.path, task.options)
    doc = write_run(result, folder)
    recording = doc["recording"]
    summary = {name: recording[name] for name in OF_RECORDING} | {name: doc[name] for name in OF_RESULT}
    summary["verdict"] = doc["verdict"]["level"]
    write_joint_input(folder, joint_input(prepared))
    (folder / THUMBNAIL).write_text(thumbnail(result), encoding="utf-8")
    return CampaignEntry(task.name, recording["name"], "ok", "", summary, f"runs/{key}")

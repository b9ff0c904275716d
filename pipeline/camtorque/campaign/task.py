"""One recording: the unit of work. Remembered results are handed back, the others computed and written whole."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from camtorque.campaign.key import recording_key
from camtorque.campaign.store import read_entry, write_entry, write_prepared
from camtorque.fit import Prepared
from camtorque.records import Array, CamCycles, Recording, Refusal
from camtorque.report import CampaignEntry, output_folder, thumbnail, write_run
from camtorque.report.folder import Busy, CannotWrite, emptied, is_about
from camtorque.run import RunOptions, analyse
from camtorque.stopping import was_stopped

SUMMARY_KEYS = ("metrics", "effects", "losses", "chamber", "forces")


@dataclass(frozen=True)
class Task:
    """One recording of a campaign: its name, where it is read, the folder of all results, the user's choices."""

    name: str
    path: Path
    runs: Path
    options: RunOptions
    retry_failed: bool = False


@dataclass(frozen=True)
class SamplesLeftBehind:
    """Stands for the samples of a channel where only its calibration is still needed."""

    n_samples: int

    def read(self, start: int, stop: int) -> Array:
        """Refuse: the samples stayed in the worker that aligned them."""
        raise ValueError("the samples of this channel were left behind after the alignment")


def run_task(task: Task) -> CampaignEntry:
    """Return what became of a recording: as remembered, or computed now and written.

    A refusal is remembered; what may be over next time (no memory, an unreadable file) is not.

    Raises
    ------
    CannotWrite : the output is full or went away, which no other recording would survive either
    """
    folder = task.runs / recording_key(task.name, task.path, task.options)
    known = read_entry(folder)
    if known is not None and (known.status == "ok" or not task.retry_failed):
        return known
    try:
        with output_folder(folder) as partial:
            return _done(task, folder.name, partial)
    except Busy:
        return refused(task.name, "another process is computing it; run again after its end")
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
    return replace(entry, thumbnail="")


def _reported(task: Task, key: str, folder: Path) -> CampaignEntry:
    result, prepared = analyse(task.path, task.options)
    doc = write_run(result, folder)
    recording = doc["recording"]
    summary = {name: recording[name] for name in ("speed_rpm", "cycles_found", "cycles_used")}
    summary |= {name: doc[name] for name in SUMMARY_KEYS}
    write_prepared(folder, without_cycles(prepared))
    return CampaignEntry(task.name, recording["name"], "ok", "", summary, thumbnail(result), f"runs/{key}")


def without_cycles(prepared: Prepared) -> Prepared:
    """Return what the joint fit needs of a recording: no samples, no single cycle, the best minimum alone."""
    return replace(
        prepared, recording=without_samples(prepared.recording), cycles=mean_cycle(prepared.cycles),
        candidates=prepared.candidates[:1],
    )  # fmt: skip


def mean_cycle(cycles: CamCycles) -> CamCycles:
    """Return the cycles with their mean alone: a joint fit of hundreds of recordings needs no single cycle."""
    torque = None if cycles.torque is None else np.mean(cycles.torque, axis=0)[None]
    return replace(
        cycles, torque=torque, pressure=np.mean(cycles.pressure, axis=0)[None], speed=np.array([cycles.mean_speed]),
        index=cycles.index[:1], held_out=np.zeros(1, dtype=bool),
    )  # fmt: skip


def without_samples(recording: Recording) -> Recording:
    """Return a recording that can be stored: calibration kept, samples left behind."""
    channels = tuple(replace(c, source=SamplesLeftBehind(c.n_samples)) for c in recording.channels)
    inputs = tuple(replace(item, digest=item.sha256) for item in recording.inputs)
    return replace(recording, channels=channels, inputs=inputs)

"""Many recordings: the flow of `run` mapped over worker processes, then one joint fit."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.fit import CampaignFit, FitOptions, Prepared, fit_joint
from camtorque.records import Array, CamCycles, Finding, Recording, Refusal
from camtorque.report import (
    CampaignEntry,
    CampaignResult,
    output_folder,
    thumbnail,
    write_campaign,
    write_run,
)
from camtorque.run import Progress, RunOptions, analyse, now, silent
from camtorque.stopping import end_workers
from camtorque.threads import on_one_thread

CONFIG_NAME = "recording.toml"
SUMMARY_KEYS = ("metrics", "effects", "losses", "chamber", "forces")


@dataclass(frozen=True)
class SamplesLeftBehind:
    """Stands for the samples of a channel where only its calibration is still needed."""

    n_samples: int

    def read(self, start: int, stop: int) -> Array:
        """Refuse: the samples stayed in the worker that aligned them."""
        raise ValueError("the samples of this channel were left behind after the alignment")


def find_recordings(folder: Path) -> dict[str, Path]:
    """Return every recording at or below a folder, by its path relative to it.

    Raises
    ------
    Refusal : the folder is missing or holds no recording
    """
    if not folder.is_dir():
        raise Refusal(f"{folder}: found no such folder, expected one with recordings below it; check the path")
    found = {path.parent.relative_to(folder).as_posix(): path.parent for path in sorted(folder.rglob(CONFIG_NAME))}
    if not found:
        raise Refusal(f"{folder}: found no {CONFIG_NAME} at or below it, expected one per recording; check the path")
    return {folder.resolve().name if name == "." else name: path for name, path in found.items()}


def run_one(name: str, path: Path, folder: Path, options: RunOptions) -> tuple[CampaignEntry, Prepared | None]:
    """Write the report of one recording; a refusal becomes an entry with its reason.

    Parameters
    ----------
    name : the recording's name in the campaign
    path, folder : where it is read and where its report is written
    """
    try:
        result, prepared = analyse(path, options)
        folder.mkdir(parents=True)
        doc = write_run(result, folder)
    except Refusal as refusal:
        return CampaignEntry(name, "", "refused", str(refusal), {}), None
    except Exception as error:  # one broken recording must not stop a campaign of hundreds
        return CampaignEntry(name, "", "refused", f"unexpected {type(error).__name__}: {error}", {}), None
    recording = doc["recording"]
    summary = {key: recording[key] for key in ("speed_rpm", "cycles_found", "cycles_used")}
    summary |= {key: doc[key] for key in SUMMARY_KEYS}
    entry = CampaignEntry(name, recording["name"], "ok", "", summary, thumbnail(result))
    compact = replace(prepared, recording=without_samples(prepared.recording), cycles=mean_cycle(prepared.cycles))
    return entry, compact


def mean_cycle(cycles: CamCycles) -> CamCycles:
    """Return the cycles with their mean alone: a joint fit of hundreds of recordings needs no single cycle."""
    torque = None if cycles.torque is None else np.mean(cycles.torque, axis=0)[None]
    return replace(
        cycles, torque=torque, pressure=np.mean(cycles.pressure, axis=0)[None], speed=np.array([cycles.mean_speed]),
        index=cycles.index[:1], held_out=np.zeros(1, dtype=bool),
    )  # fmt: skip


def without_samples(recording: Recording) -> Recording:
    """Return a recording that can be sent between processes: calibration kept, samples left behind."""
    channels = tuple(replace(c, source=SamplesLeftBehind(c.n_samples)) for c in recording.channels)
    inputs = tuple(replace(item, digest=item.sha256) for item in recording.inputs)
    return replace(recording, channels=channels, inputs=inputs)


def run_campaign(
    folder: Path, out: Path, options: RunOptions | None = None, workers: int | None = None, progress: Progress = silent
) -> dict[str, Any]:
    """Write a report of every recording below a folder, the joint fit, and return the content of campaign.json.

    Parameters
    ----------
    folder, out : where recordings are looked for and what is written
    options : choices of the user, the same for all
    workers : processes; None for as many as the machine has processors

    Raises
    ------
    Refusal : there is no recording, or ``out`` holds something else; a refused recording does not stop the others
    """
    options = options or RunOptions()
    found = find_recordings(folder)
    start = time.perf_counter()
    with output_folder(out) as partial:
        done = dict(_mapped(found, partial, options, workers or os.cpu_count() or 1, progress))
        entries, usable = _in_order(found, done)
        mapped = time.perf_counter() - start
        progress(f"joint fit of {len(usable)} recordings")
        joint, findings = _joint(usable, options.fit)
        total = time.perf_counter() - start
        timing = {"recordings": mapped, "joint": total - mapped, "total": total}
        return write_campaign(CampaignResult(entries, joint, findings, timing, now()), partial)


Outcome = tuple[CampaignEntry, Prepared | None]


def _mapped(
    found: dict[str, Path], out: Path, options: RunOptions, workers: int, progress: Progress
) -> Iterator[tuple[str, Outcome]]:
    """Yield each recording's outcome as it is done."""
    if min(workers, len(found)) == 1:
        for name, path in found.items():
            outcome = run_one(name, path, out / name, options)
            progress(f"{name}: {outcome[0].status}")
            yield name, outcome
        return
    # fresh processes: threads of numerical libraries do not survive a fork
    with ProcessPoolExecutor(min(workers, len(found)), multiprocessing.get_context("spawn")) as pool:
        jobs = {pool.submit(run_one, name, path, out / name, options): name for name, path in found.items()}
        try:
            for job in as_completed(jobs):
                outcome = _outcome(job, jobs[job])
                progress(f"{jobs[job]}: {outcome[0].status}")
                yield jobs[job], outcome
        except BaseException:
            end_workers()
            raise


def _outcome(job: Future[Outcome], name: str) -> Outcome:
    error = job.exception()
    if error is None:
        return job.result()
    text = f"unexpected {type(error).__name__}: {error}"
    return CampaignEntry(name, "", "refused", text, {}), None


def _in_order(found: dict[str, Path], done: dict[str, Outcome]) -> tuple[tuple[CampaignEntry, ...], list[Prepared]]:
    """Return entries and usable recordings in the order of their names, whichever was done first."""
    outcomes = [done[name] for name in found]
    return tuple(entry for entry, _ in outcomes), [prepared for _, prepared in outcomes if prepared is not None]


@on_one_thread
def _joint(usable: Sequence[Prepared], options: FitOptions) -> tuple[CampaignFit | None, tuple[Finding, ...]]:
    """Return the joint fit; recordings of different pumps or names that repeat cannot be fitted together."""
    if len(usable) < 2:
        text = f"{len(usable)} usable recordings, a joint fit needs at least 2"
        return None, (Finding("no_joint_fit", "warning", text),)
    pumps = sorted({item.recording.config.pump_id for item in usable})
    names = [item.recording.config.id for item in usable]
    if len(pumps) > 1 or len(set(names)) < len(names):
        what = f"pumps {', '.join(pumps)}" if len(pumps) > 1 else f"recording ids that repeat among {', '.join(names)}"
        text = f"no joint fit: found {what}, expected one pump and one id per recording"
        return None, (Finding("no_joint_fit", "warning", text),)
    try:
        return fit_joint(usable, options), ()
    except Refusal as refusal:
        return None, (Finding("no_joint_fit", "warning", str(refusal)),)

"""The flow of a campaign: find, map over workers, fit jointly where the recordings allow it, write the index."""

from __future__ import annotations

import json
import os
import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from camtorque.campaign.cluster import on_cluster_file, on_scheduler
from camtorque.campaign.find import search
from camtorque.campaign.store import campaign_folder, prepare_folder, read_entry, read_joint_input, removed
from camtorque.campaign.task import Task, recording_key, refused, run_task
from camtorque.config.schemas import RECORDING_FILE
from camtorque.fit.joint import CampaignFit, fit_joint
from camtorque.fit.joint_input import FittedAlone, HeldOnce, JointInput
from camtorque.hashes import real_path
from camtorque.ingest.stated import DIMENSIONS, MOST_NAMED, difference_findings, differences
from camtorque.jsonable import now
from camtorque.process.threads import on_one_thread, processors
from camtorque.process.workers import Lost, on_processes
from camtorque.progress import Progress, duration_text, silent
from camtorque.records import Finding, Refusal
from camtorque.report.bundle import CampaignEntry, CampaignResult
from camtorque.report.campaign_page import write_campaign
from camtorque.report.files import SUMS, listed_files, visible_files, write_checksums
from camtorque.report.fit_file import NAME as FIT_NAME
from camtorque.report.folder import output_files
from camtorque.results import CAMPAIGN
from camtorque.run import RunOptions
from camtorque.units import counted, did_you_mean, first_of

HASHING_THREADS = 4
OWN_FIGURE = re.compile(r"figures/[^/]+\.svg")
"""As an index names the figures of a campaign, which are not the same from run to run."""


@dataclass(frozen=True)
class CampaignOptions:
    """How a campaign is computed, see docs/campaigns.md; nothing of it changes a number.

    ``workers`` of this machine are as many as there are processors for this one where it is None; a ``scheduler`` or a
    ``cluster`` file names others instead.
    """

    workers: int | None = None
    scheduler: str = ""
    cluster: Path | None = None
    retry_failed: bool = False

    @property
    def processes(self) -> int:
        """Processes of this machine."""
        return self.workers or processors()


def run_campaign(
    folder: Path, out: Path, options: RunOptions | None = None, how: CampaignOptions | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:  # fmt: skip
    """Write a report of every recording below a folder, the joint fit, and return the content of campaign.json.

    What an earlier campaign into ``out`` finished from the same inputs, with the same options and the same code, is
    not computed again; what this one finishes stays, however it ends.

    Raises
    ------
    Refusal : there is no recording, or ``out`` holds something else or is full; a refused recording does not stop
        the others
    """
    options, how = options or RunOptions(), how or CampaignOptions()
    found, findings = search(folder)
    start = time.perf_counter()
    with campaign_folder(out) as runs:
        tasks = [Task(name, path, runs, options, how.retry_failed) for name, path in found.items()]
        done = dict(_mapped(tasks, how, progress))
        entries = [done[name] for name in found]
        mapped = time.perf_counter() - start
        usable = usable_folders(out, entries)
        progress(f"joint fit of {len(usable)} recordings")
        names = {out / entry.folder: entry.name for entry in entries}
        joint, more = joint_fit(
            len(usable), lambda k: read_joint_input(usable[k]), how.processes, [names[folder] for folder in usable]
        )
        total = time.perf_counter() - start
        timing = {"recordings": mapped, "joint": total - mapped, "total": total}
        return _write_index(out, CampaignResult(tuple(entries), joint, (*findings, *more), timing, now()))


def usable_folders(out: Path, entries: Sequence[CampaignEntry]) -> list[Path]:
    """Return the folders that a joint fit reads, by the recordings' ids: other folder names change no digit."""
    return [out / entry.folder for entry in sorted(entries, key=lambda one: one.id) if entry.status == "ok"]


def run_only(name: str, folder: Path, out: Path, options: RunOptions, retry_failed: bool = False) -> CampaignEntry:
    """Compute one recording of a campaign in this process, without an index: several of them may run at a time.

    Raises
    ------
    Refusal : there is no recording of that name; ``out`` holds something else or is full
    """
    # its name is part of its key: "a/", as a shell completes it, is the recording "a", and one outside is none
    name = os.path.normpath(name) if name else name
    name = real_path(folder).name if name == os.curdir else name
    below = bool(name) and not any(part.startswith((".", os.sep)) for part in Path(name).parts)
    places = [*([folder / name] if below else []), *([folder] if name == real_path(folder).name else [])]
    path = next((place for place in places if (place / RECORDING_FILE).is_file()), None)
    if path is None:
        names = list(search(folder)[0])
        asked, hint = name or "''", did_you_mean(name, names)
        raise Refusal(
            f"--only {asked}: found no such recording{hint}, expected one of {first_of(names, 5)}; see --list"
        )
    return run_task(Task(name, path, prepare_folder(out), options, retry_failed))


def list_recordings(folder: Path, out: Path, options: RunOptions) -> list[dict[str, str]]:
    """Return name, status (``ok``, ``refused``, ``open``) and key of every recording, in the order of their names."""
    found, _ = search(folder)

    def row(item: tuple[str, Path]) -> dict[str, str]:
        key = recording_key(*item, options)
        try:
            entry = read_entry(out / "runs" / key)
        except Refusal as refusal:  # as the campaign makes one of it
            entry = refused(item[0], str(refusal))
        return {"name": item[0], "status": "open" if entry is None else entry.status, "key": key}

    with ThreadPoolExecutor(HASHING_THREADS) as threads:
        return list(threads.map(row, found.items()))


def prune(folder: Path, out: Path, options: RunOptions) -> dict[str, int]:
    """Remove results of older inputs, options and code; return how many folders are kept, removed, and bytes freed.

    What the present inputs, options and code would use stays, and what campaign.json refers to.

    Raises
    ------
    Refusal : ``out`` is no campaign; a campaign is writing there; everything would go
    """
    if not (out / "runs").is_dir():
        raise Refusal(f"--prune: found no {out / 'runs'}, expected the output of an earlier campaign; check --out")
    with campaign_folder(out) as runs:
        present = {path.name for path in runs.iterdir() if not path.name.startswith(".")}
        kept = {row["key"] for row in list_recordings(folder, out, options)} | _referred(out)
        if present and not kept & present:
            raise Refusal(
                f"--prune: none of the {len(present)} results in {runs} belongs to the recordings below {folder} with "
                "these options and this version; delete the folder by hand if none is wanted"
            )
        count, size = removed(runs, kept)
        return {"kept": len(present) - count, "removed": count, "bytes": size}


def _referred(out: Path) -> set[str]:
    """Return the keys of the results that the written index links to."""
    try:
        doc = json.loads((out / CAMPAIGN).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return set()
    except ValueError as error:
        raise Refusal(f"{out / 'campaign.json'}: is damaged ({error}); run the campaign again first") from error
    return {Path(row["folder"]).name for row in doc["recordings"] if row["folder"]}


def _mapped(tasks: Sequence[Task], how: CampaignOptions, progress: Progress) -> Iterator[tuple[str, CampaignEntry]]:
    """Yield each recording's entry as it is done, and tell how far the campaign is."""
    start, n_refused = time.perf_counter(), 0
    for n_done, (task, entry) in enumerate(_outcomes(tasks, how, progress), 1):
        if isinstance(entry, Lost):
            entry = refused(task.name, "two workers died on it (killed, or out of memory); run it alone by --only")
        n_refused += entry.status != "ok"
        left = (time.perf_counter() - start) / n_done * (len(tasks) - n_done)
        text = f"{n_done} of {len(tasks)} done, {n_refused} refused, {duration_text(left)} left"
        progress(f"{text} ({task.name}: {entry.status})")
        yield task.name, entry


def _outcomes(
    tasks: Sequence[Task], how: CampaignOptions, progress: Progress
) -> Iterator[tuple[Task, CampaignEntry | Lost]]:
    if how.scheduler:
        return on_scheduler(run_task, tasks, how.scheduler, progress)
    if how.cluster is not None:
        return on_cluster_file(run_task, tasks, how.cluster, progress)
    return on_processes(run_task, with_help(tasks, how.processes), min(how.processes, len(tasks)))


def with_help(tasks: Sequence[Task], workers: int) -> list[Task]:
    """Return tasks of which those of the last round use the workers that have none."""
    last = len(tasks) % workers
    first = len(tasks) - last
    return [replace(task, helped=0 <= k - first < workers - last) for k, task in enumerate(tasks)]


def _write_index(out: Path, result: CampaignResult) -> dict[str, Any]:
    """Write page, document and figures of the campaign; each file is replaced as a whole, what is none any more goes.

    A joint fit of recordings that are no longer there would be taken for one of those that are.
    """
    # an index of an earlier version listed whatever lay beside it, files of the user too
    earlier = {name for name in listed_files(out) if name == FIT_NAME or OWN_FIGURE.fullmatch(name)}
    with output_files(out) as scratch:
        doc = write_campaign(result, scratch, out)
        written = {path.relative_to(scratch).as_posix() for path in visible_files(scratch)}
    for name in earlier - written:
        (out / name).unlink(missing_ok=True)
    own = [out / name for name in written]
    write_checksums(out, [*own, *(out / entry.folder / SUMS for entry in result.entries if entry.folder)])
    return doc


@on_one_thread
def joint_fit(
    count: int, read: Callable[[int], JointInput], threads: int, folders: Sequence[str] = ()
) -> tuple[CampaignFit | None, tuple[Finding, ...]]:
    """Return the joint fit; recordings of different pumps or groups, or of ids that repeat, cannot be fitted together.

    ``read`` gives what it needs of one of ``count`` usable recordings; nothing is held of those that cannot be fitted
    together. As many as ``threads`` are worked at side by side. ``folders`` tell recordings of one id apart.
    """
    if count < 2:
        return _none(f"{counted(count, 'usable recording', 'usable recordings')}, a joint fit needs at least 2")
    held, known = HeldOnce(), list[FittedAlone]()
    pumps: dict[str, list[str]] = {}
    same: dict[bytes, list[str]] = {}
    for item in map(read, range(count)):
        pumps.setdefault(item.pump_id, []).append(item.name)
        same.setdefault(item.measured.tobytes(), []).append(item.name)
        if len(pumps) > 1:
            known.clear()
        else:
            known.append(held(item))
    apart = differences(dict(zip(_told_apart(known, folders), (item.stated for item in known), strict=True)))
    mixed = _mixed(pumps)
    if mixed:
        return _none(f"no joint fit: {mixed}", *difference_findings(apart))
    pump = "; ".join(f"{name} {text}" for name, text in apart.items() if name in DIMENSIONS)
    if pump:
        return _none(f"no joint fit: found {pump}, expected the dimensions of one pump; correct the wrong one")
    try:
        return fit_joint(known, read, threads), (*difference_findings(apart), *_repeated(same.values()))
    except Refusal as refusal:
        return _none(str(refusal), *difference_findings(apart))


def _told_apart(known: Sequence[FittedAlone], folders: Sequence[str]) -> list[str]:
    """Return the names of recordings, those that repeat with their folders, or their numbers where there are none."""
    often = Counter(item.name for item in known)
    places = folders or [str(number) for number in range(1, len(known) + 1)]
    return [
        item.name if often[item.name] == 1 else f"{item.name} ({place})"
        for item, place in zip(known, places, strict=False)
    ]


def _mixed(pumps: Mapping[str, Sequence[str]]) -> str:
    """Return why recordings cannot be fitted together and what to do, all of it; empty where they can."""
    times = Counter(name for names in pumps.values() for name in names)
    repeated = sorted(name for name, number in times.items() if number > 1)
    found, todo = [], []
    if len(pumps) > 1:
        whose = [f"{pump} ({first_of(names, MOST_NAMED)})" for pump, names in sorted(pumps.items())]
        found.append(f"pumps {', '.join(whose)}")
        todo.append("run a campaign of each pump or group by itself")
    if repeated:
        found.append(f"recording ids that repeat: {', '.join(repeated)}")
        todo.append("leave out what was copied, give every other recording an id of its own in [recording]")
    expected = "expected one pump, one group and one id per recording"
    return f"found {' and '.join(found)}, {expected}; {'; '.join(todo)}" if found else ""


def _repeated(same: Iterable[Sequence[str]]) -> tuple[Finding, ...]:
    """Return a warning on recordings that hold the same cycles under several ids."""
    return tuple(
        Finding("recording_repeated", "warning", f"{' and '.join(names)} hold the same cycles: what one tells counts "
                "more than once, intervals are too narrow and each is predicted from itself; leave the copies out")
        for names in same if len(names) > 1
    )  # fmt: skip


def _none(text: str, *more: Finding) -> tuple[None, tuple[Finding, ...]]:
    return None, (Finding("no_joint_fit", "warning", text), *more)

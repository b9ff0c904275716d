"""Dask: workers of a running scheduler, or asked of a batch system."""

from __future__ import annotations

import shlex
import signal
import subprocess
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from camtorque.campaign.task import code_digest
from camtorque.config.keys import Band, Key, TableSchema
from camtorque.config.schemas import words
from camtorque.config.tables import Table, read_closed, read_toml
from camtorque.process.stopping import SIGNALS, before_leaving
from camtorque.process.workers import Lost
from camtorque.progress import duration_text
from camtorque.records import Refusal, require

T = TypeVar("T")
R = TypeVar("R")

SETTINGS = {
    "distributed.scheduler.allowed-failures": 0,  # a task whose worker died is tried again here, alone
    "distributed.scheduler.worker-ttl": None,  # a long call of compiled code is no sign of death
}
BATCH_SYSTEMS = {
    "slurm": "SLURMCluster", "pbs": "PBSCluster", "lsf": "LSFCluster", "sge": "SGECluster",
    "htcondor": "HTCondorCluster",
}  # fmt: skip
"""Kind of a cluster file -> class of dask-jobqueue."""
ANY_PORT = ":0"
"""Dashboards at a port that is free: a second campaign on this machine must not be in the way of the first."""
CLUSTER_FILE = TableSchema("", "workers of a batch system", (
    Key("kind", "choice", "the batch system", choices=words(*BATCH_SYSTEMS)),
    Key("jobs", "whole", "jobs to ask for, one worker each", band=Band(1, 100_000, "no batch system holds more")),
))  # fmt: skip
"""Beside its table [options], which belongs to the batch system."""
WAIT_FOR_SCHEDULER = 10.0
WAIT_FOR_WORKERS = 60.0
TELL_EVERY = 60.0
CANCEL_WITHIN = 1.0
"""Seconds."""


def on_scheduler(
    call: Callable[[T], R], items: Iterable[T], address: str, tell: Callable[[str], None]
) -> Iterator[tuple[T, R | Lost]]:
    """Yield each item with its result as it is done, on the workers of a running scheduler.

    Raises
    ------
    Refusal : the scheduler does not answer, has no workers, or they run another version of this package
    """
    with _quiet() as distributed:
        try:
            client = distributed.Client(address, timeout=WAIT_FOR_SCHEDULER)
        except (OSError, ValueError) as error:
            raise Refusal(
                f"--scheduler {address}: found no scheduler that answers, expected one started by `dask scheduler`, "
                "such as tcp://host:8786; check address and firewall"
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=WAIT_FOR_WORKERS)
            except TimeoutError as error:
                raise Refusal(
                    f"--scheduler {address}: found no worker, expected at least one; start `dask worker {address} "
                    "--nthreads 1` where the recordings can be read"
                ) from error
            _need_same_code(client, f"--scheduler {address}")
            with _reported_while_alone(client, tell, lambda: f"start `dask worker {address} --nthreads 1`"):
                yield from _results(client, call, items)


def on_cluster_file(
    call: Callable[[T], R], items: Iterable[T], file: Path, tell: Callable[[str], None]
) -> Iterator[tuple[T, R | Lost]]:
    """Yield each item with its result as it is done, on workers that a batch system starts.

    Raises
    ------
    Refusal : the file cannot be used, or the package or the batch system is missing
    """
    kind, jobs, options = read_cluster_file(file)
    with _quiet("dask_jobqueue") as distributed:
        dask_jobqueue = _batch_systems()
        try:
            usual = {"processes": 1, "cores": 1, "scheduler_options": {"dashboard_address": ANY_PORT}}
            cluster = getattr(dask_jobqueue, BATCH_SYSTEMS[kind])(**{**usual, **options})
            cluster.scale(jobs=jobs)
        except (OSError, TypeError, ValueError, RuntimeError) as error:
            raise Refusal(f"--cluster {file}: {kind} refused it ({' '.join(str(error).split())}); see docs") from error
        with before_leaving(lambda: _cancel(cluster)), cluster, distributed.Client(cluster) as client:
            tell(f"{jobs} jobs are asked of {kind}; the first worker may take its time")
            with _reported_while_alone(client, tell, lambda: _where_to_look(cluster, kind)):
                client.wait_for_workers(1)
                _need_same_code(client, f"--cluster {file}")
                yield from _results(client, call, items)


def _batch_systems() -> Any:
    """Return dask-jobqueue with the handling of signals as it was: the package takes Ctrl-C for itself on import."""
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    import dask_jobqueue

    for number, handler in handlers.items():
        signal.signal(number, handler)
    return dask_jobqueue


def read_cluster_file(file: Path) -> tuple[str, int, dict[str, Any]]:
    """Return kind, number of jobs and the batch system's own options.

    Raises
    ------
    Refusal : what is wrong in the file
    """
    root = Table(read_toml(file, "a cluster file, see docs/campaigns.md")[1], file, "")
    values = read_closed(root, CLUSTER_FILE, "options")
    return values["kind"], values["jobs"], dict(root.table("options", optional=True).values)


@contextmanager
def _quiet(*more: str) -> Iterator[Any]:
    """Give the package, its settings made and its log silent: what matters is reported by the campaign.

    Raises
    ------
    Refusal : it, or one of ``more``, is not installed
    """
    require(("distributed", *more), "campaign", "cluster")
    import dask

    with dask.config.set({**SETTINGS, "logging": {"distributed": "critical"}}):
        import distributed

        yield distributed


def _need_same_code(client: Any, what: str) -> None:
    """Refuse workers whose results would have other keys, and perhaps other numbers."""
    other = [worker for worker, digest in client.run(code_digest).items() if digest != code_digest()]
    if other:
        raise Refusal(f"{what}: found another version of camtorque on {', '.join(other)}, expected the same everywhere")


@contextmanager
def _reported_while_alone(client: Any, tell: Callable[[str], None], advice: Callable[[], str]) -> Iterator[None]:
    """Report every minute without a worker, before the first and after the last: nobody else sees a job die at once."""
    ended = threading.Event()

    def watch() -> None:
        alone = 0.0
        while not ended.wait(TELL_EVERY):
            with suppress(OSError, RuntimeError, TimeoutError):  # the client is closing
                alone = 0.0 if client.nthreads() else alone + TELL_EVERY
                if alone:
                    tell(f"no worker for {duration_text(alone)}, waiting; {advice()}; Ctrl-C keeps what is finished")

    threading.Thread(target=watch, daemon=True, name="worker watch").start()
    try:
        yield
    finally:
        ended.set()


def _jobs(cluster: Any) -> list[Any]:
    """Return the jobs that the batch system has taken."""
    return [job for job in list(cluster.workers.values()) if getattr(job, "job_id", None)]


def _where_to_look(cluster: Any, kind: str) -> str:
    """Return how many jobs there are and where the log of one that died stands."""
    jobs = _jobs(cluster)
    numbers = ", ".join(str(job.job_id) for job in jobs[:3]) + (", ..." if len(jobs) > 3 else "")
    folder = next((job.log_directory for job in jobs if job.log_directory), None)
    log = f"in {folder}" if folder else f"where {kind} writes it, mostly in {Path.cwd()} (`log_directory` in [options])"
    return f"{len(jobs)} jobs taken by {kind} ({numbers}): see its queue, and the log of a job that ended {log}"


def _cancel(cluster: Any) -> None:
    """Take the jobs back at once: a stopped process has no time for the cluster's own way."""
    jobs = _jobs(cluster)
    if jobs:
        with suppress(OSError, subprocess.SubprocessError):
            command = [*shlex.split(jobs[0].cancel_command), *(str(job.job_id) for job in jobs)]
            subprocess.run(command, timeout=CANCEL_WITHIN, capture_output=True, check=False)


def _results(client: Any, call: Callable[[T], R], items: Iterable[T]) -> Iterator[tuple[T, R | Lost]]:
    """Yield results as they are done; a few more tasks than workers are under way, so that memory stays flat.

    A worker that dies takes tasks with it that only waited there. All of them are tried again in the end, one at a
    time, so that the guilty one is named and no other.
    """
    import distributed

    waiting, suspects = iter(items), list[T]()
    running: dict[Any, T] = {}
    done = distributed.as_completed()

    def fill() -> None:
        room = 2 * max(1, sum(client.nthreads().values())) - len(running)
        for _, item in zip(range(room), waiting, strict=False):
            future = client.submit(call, item, pure=False)
            running[future] = item
            done.add(future)

    fill()
    for future in done:
        item = running.pop(future)
        fill()
        if isinstance(future.exception(), distributed.KilledWorker):
            suspects.append(item)
        else:
            yield item, future.result()
        future.release()
    for item in suspects:
        future = client.submit(call, item, pure=False)
        yield item, Lost() if isinstance(future.exception(), distributed.KilledWorker) else future.result()

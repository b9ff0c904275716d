"""Engines: every item once, a worker that dies takes at most its own item with it, one line where none can be had."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import campaign_words
import pytest
from campaign_cases import STOPPED, make
from camtorque.campaign import cluster
from camtorque.campaign.flow import CampaignOptions, with_help
from camtorque.campaign.task import Task
from camtorque.process.workers import Lost, on_processes
from camtorque.records import Refusal, base
from camtorque.run import RunOptions


def on_a_scheduler(call: Callable[[str], Any], items: list[str], workers: int) -> Iterator[tuple[str, Any]]:
    """Have items done by the workers of a scheduler of this machine."""
    distributed = pytest.importorskip("distributed")
    import dask

    # the cluster gives a worker up that is just being started anew so long after an earlier death of it
    patient = dask.config.set({"distributed.deploy.lost-worker-timeout": "1 hour"})
    cluster_of = partial(distributed.LocalCluster, threads_per_worker=1, dashboard_address=":0", silence_logs=50)
    with patient, cluster_of(workers) as running:
        yield from cluster.on_scheduler(call, items, running.scheduler_address, print)
        with distributed.Client(running, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=200)  # one that is just started anew cannot be stopped


ENGINES = {"processes": on_processes, "dask": on_a_scheduler}


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest) -> Callable[..., Iterator[tuple[str, Any]]]:
    """Each way to have items done."""
    return ENGINES[request.param]


@pytest.fixture(autouse=True)
def usual_port_is_taken() -> Iterator[None]:
    """Hold the port of a dashboard, as another campaign on this machine would."""
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with suppress(OSError):  # somebody else has it
            taken.bind(("", 8787))
            taken.listen()
        yield


def test_a_dead_worker_costs_at_most_its_own_item(engine: Callable[..., Any], tmp_path: Path) -> None:
    words = [f"say {k}" for k in range(8)]
    deadly, once = f"die\n{tmp_path / 'a'}", f"once\n{tmp_path / 'b'}"
    done = dict(engine(campaign_words.sleepy, [*words[:4], deadly, once, *words[4:]], 2))
    assert done.pop(deadly) == Lost()
    assert done.pop(once) == "once", "one death is forgiven"
    assert done == {word: word for word in words}


def test_an_error_ends_the_workers(engine: Callable[..., Any]) -> None:
    with pytest.raises(ValueError, match="odd"):
        list(engine(campaign_words.sleepy, ["say 1", "fail odd", "sleep 60", "sleep 60"], 2))
    for child in multiprocessing.active_children():
        for _ in range(300):  # the executor's thread may reap it first: a join then returns too early
            child.join(0.1)
            if child.exitcode is not None:
                break
            time.sleep(0.1)
        assert child.exitcode is not None


def test_items_are_taken_as_workers_become_free() -> None:
    taken = []

    def items() -> Iterator[str]:
        for k in range(6):
            taken.append(k)
            yield f"say {k}"

    results = on_processes(campaign_words.sleepy, items(), 2)
    next(results)
    assert len(taken) <= 4, "a campaign of a hundred thousand must not be held in memory"
    assert len(list(results)) == 5


@pytest.mark.parametrize(("workers", "helped"), [
    (1, [False] * 5), (2, [False] * 4 + [True]), (3, [False] * 3 + [True, False]), (5, [False] * 5), (16, [True] * 5),
])  # fmt: skip
def test_recordings_of_the_last_round_use_idle_workers(workers: int, helped: list[bool]) -> None:
    tasks = [Task(str(k), Path(), Path(), RunOptions()) for k in range(5)]
    assert [task.helped for task in with_help(tasks, workers)] == helped


def test_workers_are_as_many_as_this_process_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {5})
    assert CampaignOptions().processes == 1, "a batch system gives one of many"
    assert CampaignOptions(workers=3).processes == 3


def test_a_running_scheduler_is_used() -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=":0", protocol="tcp") as running:
        done = dict(cluster.on_scheduler(campaign_words.sleepy, ["say 1", "say 2"], running.scheduler_address, print))
    assert done == {"say 1": "say 1", "say 2": "say 2"}


def test_workers_of_another_version_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    client = type("Client", (), {"run": lambda self, call: {"tcp://w1": "other"}})()
    with pytest.raises(Refusal, match="another version of camtorque on tcp://w1"):
        cluster._need_same_code(client, "--scheduler x")


def test_a_scheduler_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setattr(cluster, "WAIT_FOR_SCHEDULER", 0.5)
    with pytest.raises(Refusal, match="found no scheduler that answers"):
        list(cluster.on_scheduler(campaign_words.sleepy, ["say"], "tcp://127.0.0.1:9", print))
    with pytest.raises(Refusal, match="found no scheduler that answers"):
        list(cluster.on_scheduler(campaign_words.sleepy, ["say"], "nonsense://x", print))


def test_the_extra_is_named_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(base, "find_spec", lambda name: None)
    with pytest.raises(Refusal, match=r"pip install 'camtorque\[cluster\]'"):
        list(cluster.on_scheduler(campaign_words.sleepy, ["say"], "tcp://127.0.0.1:9", print))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kind = 'slurm'\njob = 3", "jobs: this key is missing, is it 'job'"),
        ("kind = 'slurm'\njobs = 3\nqueue = 1", "unknown key 'queue', expected one of kind, jobs, options"),
        ("kind = 'cron'\njobs = 3", "kind: found 'cron', expected one of slurm, pbs, lsf"),
        ("kind = 'pbs'", "jobs: this key is missing"),
        ("kind = 'pbs'\njobs = true", "jobs: found True, expected a number"),
        ("kind = 'pbs'\njobs = 3\noptions = 1", "options: found 1, expected a table"),
        ("kind = ", "not valid TOML"),
    ],
)
def test_a_cluster_file_that_cannot_be_used(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "cluster.toml"
    file.write_text(text)
    with pytest.raises(Refusal, match=message):
        cluster.read_cluster_file(file)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a half-made cluster of that package
def test_an_option_that_the_batch_system_does_not_know(tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue")
    file = tmp_path / "cluster.toml"
    file.write_text("kind = 'slurm'\njobs = 1\n[options]\nmemory = '1GB'\nlanes = 3")
    with pytest.raises(Refusal, match=r"slurm refused it .*lanes"):
        list(cluster.on_cluster_file(campaign_words.sleepy, ["say"], file, lambda text: None))


# like the real one it copies the job, for the file of the caller may go before the job starts
SBATCH = """#!/bin/sh
[ "$1" = --parsable ] && shift
cp "$1" "{job}"
{start}
echo 42
"""
STARTS = 'sh "{job}" >"{log}" 2>&1 & echo $! >> "{jobs}"'
SCANCEL = """#!/bin/sh
echo "$@" >> "{cancelled}"
kill $(cat "{jobs}")
"""


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], Path]:
    """Put a batch system into the path; the cluster file is given back."""
    pytest.importorskip("dask_jobqueue")
    places = {name: tmp_path / name for name in ("job", "jobs", "log", "cancelled")}

    def put(starts: bool) -> Path:
        start = STARTS.format(**places) if starts else "true"
        for name, text in (("sbatch", SBATCH.format(start=start, **places)), ("scancel", SCANCEL.format(**places))):
            (tmp_path / name).write_text(text)
            (tmp_path / name).chmod(0o700)
        monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
        paths = [os.environ.get("PYTHONPATH", ""), str(Path(__file__).parent)]
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
        file = tmp_path / "cluster.toml"
        file.write_text("kind = 'slurm'\njobs = 1\n[options]\nmemory = '1GB'\ninterface = 'lo'\n")
        return file

    return put


def test_jobs_of_a_batch_system_do_the_work(slurm: Callable[[bool], Path]) -> None:
    told: list[str] = []
    done = dict(cluster.on_cluster_file(campaign_words.sleepy, ["say 1", "say 2"], slurm(True), told.append))
    assert done == {"say 1": "say 1", "say 2": "say 2"}
    assert "1 jobs are asked of slurm" in told[0]


def test_a_wait_for_workers_is_told(slurm: Callable[[bool], Path], monkeypatch: pytest.MonkeyPatch) -> None:
    file, told = slurm(False), []
    monkeypatch.setattr(cluster, "TELL_EVERY", 0.5)

    def tell(text: str) -> None:
        told.append(text)
        if len(told) == 3:  # the user has read it twice and starts the job
            places = {name: file.parent / name for name in ("job", "jobs", "log")}
            subprocess.run(["sh", "-c", STARTS.format(**places)], check=True)

    done = dict(cluster.on_cluster_file(campaign_words.sleepy, ["say 1"], file, tell))
    assert done == {"say 1": "say 1"}
    assert "no worker for about 1 s, waiting; 1 jobs taken by slurm (42): see its queue" in told[1]
    assert f"mostly in {Path.cwd()}" in told[1]


def test_ctrl_c_ends_the_wait_for_workers_and_takes_the_jobs_back(
    slurm: Callable[[bool], Path], tmp_path: Path
) -> None:
    file, raw, out = slurm(False), make(tmp_path / "raw", a="say"), tmp_path / "out"
    command = [sys.executable, str(Path(__file__).with_name("campaign_cases.py")), "campaign", str(raw)]
    process = subprocess.Popen([*command, "--out", str(out), "--cluster", str(file)], stderr=subprocess.PIPE, text=True)
    while not (tmp_path / "job").exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (130, STOPPED)
    assert "42" in (tmp_path / "cancelled").read_text().split()

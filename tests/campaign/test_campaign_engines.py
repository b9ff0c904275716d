"""Engines: every item once, a worker that dies takes at most its own item with it, one line where none can be had."""

from __future__ import annotations

import multiprocessing
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import campaign_words
import pytest
from camtorque.campaign import cluster
from camtorque.records import Refusal
from camtorque.workers import Lost, on_processes

ENGINES = {"processes": on_processes, "dask": cluster.on_local_cluster}


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest) -> Callable[..., Iterator[tuple[str, Any]]]:
    """Each way to have items done on this machine."""
    if request.param == "dask":
        pytest.importorskip("dask_jobqueue")
    return ENGINES[request.param]


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
        child.join(30)
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


def test_a_running_scheduler_is_used() -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None, protocol="tcp") as running:
        done = dict(cluster.on_scheduler(campaign_words.sleepy, ["say 1", "say 2"], running.scheduler_address))
    assert done == {"say 1": "say 1", "say 2": "say 2"}


def test_workers_of_another_version_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    client = type("Client", (), {"run": lambda self, call: {"tcp://w1": "other"}})()
    with pytest.raises(Refusal, match="another version of camtorque on tcp://w1"):
        cluster._need_same_code(client, "--scheduler x")


def test_a_scheduler_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setattr(cluster, "WAIT_FOR_SCHEDULER", 0.5)
    with pytest.raises(Refusal, match="found no scheduler that answers"):
        list(cluster.on_scheduler(campaign_words.sleepy, ["say"], "tcp://127.0.0.1:9"))
    with pytest.raises(Refusal, match="found no scheduler that answers"):
        list(cluster.on_scheduler(campaign_words.sleepy, ["say"], "nonsense://x"))


def test_the_extra_is_named_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "find_spec", lambda name: None)
    with pytest.raises(Refusal, match=r"pip install 'camtorque\[cluster\]'"):
        list(cluster.on_scheduler(campaign_words.sleepy, ["say"], "tcp://127.0.0.1:9"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kind = 'slurm'\njob = 3", "found 'job', expected kind, jobs, options, did you mean 'jobs'"),
        ("kind = 'cron'\njobs = 3", "kind is 'cron', expected one of slurm, pbs, lsf"),
        ("kind = 'pbs'", "jobs is None, expected a whole number"),
        ("kind = 'pbs'\njobs = true", "jobs is True, expected a whole number"),
        ("kind = 'pbs'\njobs = 3\noptions = 1", "options is 1, expected a table"),
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
sh "{job}" >"{log}" 2>&1 &
echo $! >> "{jobs}"
echo 42
"""


def test_jobs_of_a_batch_system_do_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("dask_jobqueue")
    for name, text in (("sbatch", SBATCH), ("scancel", "#!/bin/sh\nkill $(cat {jobs})\n")):
        script = tmp_path / name
        script.write_text(text.format(**{name: tmp_path / name for name in ("job", "jobs", "log")}))
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([os.environ.get("PYTHONPATH", ""), str(Path(__file__).parent)]))
    file = tmp_path / "cluster.toml"
    file.write_text("kind = 'slurm'\njobs = 1\n[options]\nmemory = '1GB'\ninterface = 'lo'\n")
    told: list[str] = []
    done = dict(cluster.on_cluster_file(campaign_words.sleepy, ["say 1", "say 2"], file, told.append))
    assert done == {"say 1": "say 1", "say 2": "say 2"}
    assert "1 jobs are asked of slurm" in told[0]

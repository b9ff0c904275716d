"""A campaign that is stopped or killed at any moment keeps what it finished, leaves no process and goes on."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from campaign_cases import STOPPED, make

SCRIPT = Path(__file__).with_name("campaign_cases.py")
LIMIT = 90
"""Seconds after which a process that should have ended counts as hanging."""


def start(raw: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    command = [sys.executable, str(SCRIPT), "campaign", str(raw), "--out", str(out), "--workers", "2", *more]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def finished(out: Path) -> dict[str, int]:
    """Name and time of writing of every finished recording."""
    entries = (out / "runs").glob("[!.]*/entry.json")  # a hidden folder is not finished yet
    return {json.loads(path.read_text())["name"]: path.stat().st_mtime_ns for path in entries}


def wait_until_some_are_done(out: Path, process: subprocess.Popen[str], count: int) -> None:
    for _ in range(LIMIT * 20):
        if len(finished(out)) >= count:
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    raise AssertionError("nothing was finished")


def nobody_is_left(session: int) -> bool:
    """Tell whether the whole session of a process has ended; its workers may take a moment after a kill."""
    for _ in range(200):
        try:
            os.killpg(session, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stopped_campaign(tmp_path: Path, number: signal.Signals, status: int) -> None:
    raw, out = make(tmp_path / "raw", a="say", b="refuse it", c="sleep 600", d="sleep 600", e="say"), tmp_path / "out"
    process = start(raw, out)
    wait_until_some_are_done(out, process, 2)
    before = finished(out)
    process.send_signal(number)
    printed, errors = process.communicate(timeout=LIMIT)
    assert (process.returncode, printed, errors) == (status, "", STOPPED)
    assert nobody_is_left(process.pid)
    assert sorted(path.name for path in out.iterdir()) == [".camtorque-campaign", "runs"]
    assert not list((out / "runs").glob(".*"))
    make(raw, c="say", d="say")
    process = start(raw, out)
    _, errors = process.communicate(timeout=LIMIT)
    assert (process.returncode, errors) == (1, "")
    assert before.items() <= finished(out).items(), "what was finished is not computed again"
    assert set(finished(out)) == set("abcde")


def test_a_campaign_killed_at_random_moments_ends_whole(tmp_path: Path) -> None:
    raw = make(tmp_path / "raw", **{f"r{k}": "sleep 0.3" for k in range(12)})
    out = tmp_path / "out"
    chance = random.Random(1)
    for _ in range(2):
        process = start(raw, out)
        time.sleep(chance.uniform(1.0, 5.0))
        os.kill(process.pid, signal.SIGKILL)
        process.communicate(timeout=LIMIT)
        assert nobody_is_left(process.pid)
        for folder in (out / "runs").glob("[!.]*"):
            assert {path.name for path in folder.iterdir()} >= {"entry.json", "joint.bin", "result.json", "figures"}
    before = finished(out)
    process = start(raw, out)
    _, errors = process.communicate(timeout=LIMIT)
    assert (process.returncode, errors) == (0, "")
    assert before.items() <= finished(out).items()
    assert len(finished(out)) == 12
    assert not list((out / "runs").glob(".*"))


def test_killed_workers_are_named(tmp_path: Path) -> None:
    raw, out = make(tmp_path / "raw", a="die", b="once", c="say", d="say", e="say"), tmp_path / "out"
    process = start(raw, out)
    printed, errors = process.communicate(timeout=LIMIT)
    assert (process.returncode, errors) == (1, "")
    rows = {row["name"]: row for row in json.loads((out / "campaign.json").read_text())["recordings"]}
    assert {name: row["status"] for name, row in rows.items()} == {"a": "refused", **dict.fromkeys("bcde", "ok")}
    assert "two workers died on it" in rows["a"]["error"]
    assert "two workers died on it" in printed

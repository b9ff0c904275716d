"""Kills `run` and `campaign` (signal 9) at random moments and looks at what they leave.

    python benchmarks/kill_often.py --run 25 --campaign 25

The analysis is a stored result (see campaign_size.py), so that most kills fall where something is written. After every
kill each output is whole or absent, an earlier one is as it was or replaced by a whole one, and nothing that was
finished is computed again; the same command then ends well and leaves nothing beside its output.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from campaign_size import PAUSE, generate, no_joint_fit, prepare_result, stand_in, stand_in_analysis
from camtorque import run
from camtorque.campaign import CampaignOptions, flow, run_campaign
from camtorque.campaign.store import JOINT
from camtorque.report.files import verify
from camtorque.run import RunOptions, run_recording

RECORDINGS = 40
WHOLE = {"entry.json", JOINT, "result.json", "SHA256SUMS"}


def killed(command: list[str], delay: float, whole_group: bool, begun: Callable[[], bool] = lambda: True) -> bool:
    """Start a command and kill it some time after it has begun its work; False where it ended before."""
    process = subprocess.Popen(command, start_new_session=True)
    while not begun() and process.poll() is None:
        time.sleep(0.01)
    try:
        assert process.wait(delay) == 0
        return False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL) if whole_group else process.kill()
        process.wait()
        return True


def finished(out: Path) -> list[Path]:
    """Return the folders of finished recordings."""
    return list((out / "runs").glob("[!.]*"))


def kill_campaigns(times: int, folder: Path, chance: random.Random) -> str:
    """Kill campaigns a moment after one more recording was finished; half of the kills leave the workers alive."""
    kills, rounds, looked = 0, 0, 0
    while kills < times:
        rounds += 1
        raw, out = generate(folder / f"raw{rounds}", RECORDINGS), folder / f"campaign{rounds}"
        command = [sys.executable, __file__, "--child", str(raw), str(out)]
        kept: dict[Path, int] = {}

        def one_more(out: Path = out, kept: dict[Path, int] = kept) -> bool:
            return len(finished(out)) > len(kept)

        while kills < times and killed(command, chance.uniform(0.0, 3.0), chance.random() < 0.5, one_more):
            kills += 1
            for done in finished(out):
                assert {path.name for path in done.iterdir()} >= WHOLE, done
                assert not verify(done)[1], done
                stamp = (done / JOINT).stat().st_mtime_ns
                assert kept.setdefault(done, stamp) == stamp, f"{done} was computed again"
                looked += 1
        subprocess.run(command, check=True)
        assert not verify(out)[1]
        assert len(finished(out)) == RECORDINGS
        assert not list((out / "runs").glob(".*"))
    return f"campaign: {kills} kills over {rounds} campaigns of {RECORDINGS}, {looked} finished folders looked at"


def kill_runs(times: int, folder: Path, chance: random.Random) -> str:
    """Kill runs into a new folder and over an earlier report, by turns, mostly towards their end, where they write."""
    raw, counts = generate(folder / "raw", 1) / "r000000", {"nothing": 0, "the earlier report": 0, "a whole new one": 0}
    place, kept = folder / "reports", folder / "kept"
    out = place / "out"
    command = [sys.executable, __file__, "--child", str(raw), str(out), "--single"]
    started = time.monotonic()
    subprocess.run(command, check=True)
    lasts = time.monotonic() - started
    shutil.copytree(out, kept)
    earlier, kills = (kept / "result.json").read_bytes(), 0
    while kills < times:
        shutil.rmtree(out, ignore_errors=True)
        if kills % 2:
            shutil.copytree(kept, out)
        if not killed(command, lasts * chance.triangular(0.1, 1.2, 0.9), True):
            assert [path.name for path in place.iterdir()] == ["out"], list(place.iterdir())
            continue
        kills += 1
        if not out.exists():
            assert kills % 2, "an earlier report is gone"
            counts["nothing"] += 1
            continue
        assert not verify(out)[1]
        counts["the earlier report" if (out / "result.json").read_bytes() == earlier else "a whole new one"] += 1
    subprocess.run(command, check=True)
    assert [path.name for path in place.iterdir()] == ["out"]
    assert not verify(out)[1]
    return f"run: {kills} kills; found after them: " + ", ".join(f"{name} {count}" for name, count in counts.items())


def child(raw: Path, out: Path, single: bool) -> None:
    """Do what is killed."""
    if single:
        run.analyse = stand_in_analysis  # type: ignore[assignment]
        run_recording(raw, out)
        return
    flow.run_task, flow.joint_fit = stand_in, no_joint_fit  # type: ignore[assignment]
    run_campaign(raw, out, RunOptions(), CampaignOptions(2))


def main() -> None:
    """Kill, look, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--run", type=int, default=0, metavar="N")
    parser.add_argument("--campaign", type=int, default=0, metavar="N")
    parser.add_argument("--child", nargs=2, type=Path, metavar=("RAW", "OUT"))
    parser.add_argument("--single", action="store_true")
    arguments = parser.parse_args()
    if arguments.child:
        raw, out = arguments.child
        child(raw, out, arguments.single)
        return
    chance = random.Random(7)
    os.environ[PAUSE] = "0.2"
    with tempfile.TemporaryDirectory(prefix=".kill_often-") as name:
        prepare_result(Path(name), bare=False)
        if arguments.run:
            print(kill_runs(arguments.run, Path(name), chance), flush=True)
        if arguments.campaign:
            print(kill_campaigns(arguments.campaign, Path(name), chance), flush=True)


if __name__ == "__main__":
    main()

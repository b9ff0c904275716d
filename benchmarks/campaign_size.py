"""What a campaign costs per recording as it grows.

    python benchmarks/campaign_size.py --count 100 1000 --write docs/campaign_size.md

One example is computed once; every generated recording then hands back that result under its own name, so that what is
measured is everything around the analysis: finding, hashing, workers, writing the report, remembering, the index. With
``--bare`` no report is written either.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import pickle
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from camtorque.campaign import CampaignOptions, flow, run_campaign, task
from camtorque.fit.joint_input import HeldOnce, JointInput, joint_input
from camtorque.records import Finding, Recording
from camtorque.report.files import write_json
from camtorque.run import RunOptions, analyse

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "raw_examples" / "A_1250rpm"
RESULT, BARE, PAUSE = "CAMPAIGN_SIZE_RESULT", "CAMPAIGN_SIZE_BARE", "CAMPAIGN_SIZE_PAUSE"


def generate(folder: Path, count: int) -> Path:
    """Write recordings that share the sheets and the log of the example, each with its own name."""
    text = (EXAMPLE / "recording.toml").read_text(encoding="utf-8")
    sheets, log = EXAMPLE.parents[1] / "calibration", next(EXAMPLE.glob("*.csv"))
    text = text.replace("../../calibration", str(sheets)).replace("../calibration", str(sheets))
    for k in range(count):
        place = folder / f"r{k:06d}"
        place.mkdir(parents=True)
        (place / "recording.toml").write_text(text.replace('"A_1250rpm"', f'"r{k:06d}"', 1), encoding="utf-8")
        os.link(log, place / log.name)
    return folder


@cache
def known() -> tuple[Any, Any]:
    """Return the result that every recording gets."""
    return pickle.loads(Path(os.environ[RESULT]).read_bytes())


def stand_in_analysis(path: Path, options: RunOptions, *told: Any) -> tuple[Any, Any]:
    """Return the known result under the recording's own name."""
    time.sleep(float(os.environ.get(PAUSE, "0")))
    result, prepared = known()
    config = replace(result.recording.config, id=path.name)
    recording = replace(result.recording, config=config)
    return replace(result, recording=recording), replace(prepared, data=replace(prepared.data, name=path.name))


def without_samples(recording: Recording) -> Recording:
    """Return a recording that can be stored: calibration kept, samples left behind."""
    channels = tuple(
        replace(channel, source=SimpleNamespace(n_samples=channel.n_samples)) for channel in recording.channels
    )
    inputs = tuple(replace(item, digest=item.sha256) for item in recording.inputs)
    return replace(recording, channels=channels, inputs=inputs)


def bare_report(result: Any, folder: Path) -> Mapping[str, Any]:
    """Write result.json alone."""
    doc = json.loads(Path(os.environ[BARE]).read_text(encoding="utf-8"))
    doc["recording"]["name"] = result.recording.config.id
    write_json(folder / "result.json", doc)
    return doc


def stand_in(item: task.Task) -> Any:
    """Do one recording with the stand-ins, in a worker."""
    task.analyse = stand_in_analysis  # type: ignore[assignment]
    task.joint_input = lambda item: item  # type: ignore[assignment, return-value]
    if BARE in os.environ:
        task.write_run = bare_report  # type: ignore[assignment]
    done = task.run_task(item)
    Path(os.environ[RESULT]).with_name(f"peak-{os.getpid()}").write_text(str(peak_mb()), encoding="utf-8")
    return done


def prepare_result(folder: Path, bare: bool) -> None:
    """Compute the example once."""
    result, prepared = analyse(EXAMPLE, RunOptions())
    light = replace(result, recording=without_samples(result.recording))
    (folder / "result").write_bytes(pickle.dumps((light, joint_input(prepared))))
    os.environ[RESULT] = str(folder / "result")
    if bare:
        (folder / "report").mkdir()
        task.write_run(result, folder / "report")
        os.environ[BARE] = str(folder / "report" / "result.json")


def no_joint_fit(
    count: int, read: Callable[[int], JointInput], threads: int, folders: object
) -> tuple[None, tuple[Finding, ...]]:
    """Read and hold of every recording what a joint fit does, fit nothing."""
    known = list(map(HeldOnce(), map(read, range(count))))
    return None, (Finding("joint", "info", f"{len(known)} inputs"),)


def peak_mb() -> float:
    """Return the largest resident size of this process [MB], not that of its parent before it was started."""
    text = Path("/proc/self/status").read_text(encoding="utf-8")
    return float(text.split("VmHWM:")[1].split()[0]) / 1024.0


def children() -> float:
    """Return the processor time of the workers that have ended [s]."""
    now = os.times()
    return now.children_user + now.children_system


def measure(count: int, folder: Path, how: CampaignOptions) -> str:
    """Return a line of the table: a campaign of so many recordings, computed and then found done."""
    raw, out = generate(folder / f"raw{count}", count), folder / f"out{count}"
    work, own, started = children(), time.process_time(), time.perf_counter()
    doc = run_campaign(raw, out, RunOptions(), how)
    wall, own = time.perf_counter() - started, time.process_time() - own
    while len(multiprocessing.active_children()):
        time.sleep(0.1)
    work = children() - work
    assert doc["n_refused"] == 0, doc["recordings"][0]
    worker = max(float(path.read_text()) for path in folder.glob("peak-*"))
    size = sum(path.stat().st_size for path in (out / "runs").rglob("*") if path.is_file())
    page = (out / "campaign.html").stat().st_size
    return (
        f"| {count} | {1e3 * wall / count:.0f} | {1e3 * work / count:.0f} | {1e3 * own / count:.0f} | "
        f"{size / count / 1e6:.2f} | {page / 1e6:.2f} | {peak_mb():.0f} | {worker:.0f} |"
    )


HEAD = (
    "| recordings | wall, each [ms] | processor of workers, each [ms] | processor of the parent, each [ms] "
    "| disk, each [MB] | page [MB] | peak of the parent [MB] | peak of a worker [MB] |",
    "|---|---|---|---|---|---|---|---|",
)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, nargs="+", required=True)
    parser.add_argument("--bare", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    flow.run_task, flow.joint_fit = stand_in, no_joint_fit  # type: ignore[assignment]
    how = CampaignOptions(arguments.workers)
    with tempfile.TemporaryDirectory(dir=ROOT.parent, prefix=".campaign_size-") as name:
        prepare_result(Path(name), arguments.bare)
        lines = list(HEAD)
        for count in arguments.count:
            lines.append(measure(count, Path(name), how))
            print(lines[-1], flush=True)
    print("\n".join(lines))
    if arguments.write:
        arguments.write.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""What the joint fit, the index and the page of a campaign cost as it grows: really computed, not from constants.

    python benchmarks/joint_size.py --count 100 300 1000

A campaign of a few recordings is computed once. Its finished results then stand for as many as are wanted, each under
its own name and hash: the recordings repeat, every fifth is the same. Files are links; what names the recording is
written anew. The campaign finds all of them done: measured are hashing, reading back, joint fit, index and page.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from camtorque.campaign import CampaignOptions, flow, run_campaign
from camtorque.campaign.find import search
from camtorque.campaign.store import (
    ENTRY,
    JOINT,
    read_entry,
    read_joint_input,
    write_entry,
    write_joint_input,
)
from camtorque.campaign.task import recording_key
from camtorque.config.schemas import RECORDING_FILE
from camtorque.run import RunOptions

ROOT = Path(__file__).resolve().parents[1]
OPTIONS = RunOptions()
HEAD = (
    "| recordings | joint fit, processor [s] | each [s] | parent around it, each [ms] | workers, each [ms] "
    "| page and tables, each [ms] | wall [s] | peak [MB] | page [MB] | campaign.json [MB] | fit.json [MB] |",
    "|---|---|---|---|---|---|---|---|---|---|---|",
)


def copied(place: Path, name: str, target: Path) -> Path:
    """Return a recording like another of its folder's depth, under another name: logs and sheets are the same files."""
    target.mkdir(parents=True)
    text = (place / RECORDING_FILE).read_text(encoding="utf-8")
    text = text.replace(f'id = "{place.name}"', f'id = "{name}"', 1).replace('"../', f'"{place.parent}/')
    assert f'id = "{name}"' in text
    (target / RECORDING_FILE).write_text(text, encoding="utf-8")
    for file in place.iterdir():
        if file.name != RECORDING_FILE:
            (target / file.name).symlink_to(file.resolve())
    return target


def finished(base: Path, name: str, folder: Path) -> None:
    """Put a finished result into place under another name."""
    folder.mkdir(parents=True)
    for file in base.rglob("*"):
        target = folder / file.relative_to(base)
        if file.is_dir():
            target.mkdir(exist_ok=True)
        elif file.name not in (ENTRY, JOINT):
            os.link(file, target)
    item, entry = read_joint_input(base), read_entry(base)
    assert entry is not None
    write_joint_input(folder, replace(item, data=replace(item.data, name=name)))
    write_entry(folder, replace(entry, name=name, id=name, folder=f"runs/{folder.name}"))


def grown(source: Path, base: Path, folder: Path, count: int) -> tuple[Path, Path]:
    """Return recordings and the output of a campaign of so many, in which all are finished."""
    raw, out = folder / f"raw{count}", folder / f"out{count}"
    places = sorted(search(source)[0].items())
    known = {name: base / "runs" / recording_key(name, path, OPTIONS) for name, path in places}
    for k in range(count):
        like, path = places[k % len(places)]
        name = f"r{k:06d}"
        key = recording_key(name, copied(path, name, raw / name), OPTIONS)
        finished(known[like], name, out / "runs" / key)
    (out / "campaign.json").write_text('{"recordings": []}', encoding="utf-8")
    return raw, out


def timed(function: Callable[..., Any], into: dict[str, float], name: str) -> Callable[..., Any]:
    """Return a function that tells its processor time, threads included."""

    def call(*arguments: Any) -> Any:
        start = time.process_time()
        result = function(*arguments)
        into[name] = time.process_time() - start
        return result

    return call


def measure(raw: Path, out: Path, workers: int) -> dict[str, float]:
    """Return the costs [s], [MB] of a campaign all of whose recordings are finished."""
    cost: dict[str, float] = {}
    flow.joint_fit = timed(flow.joint_fit, cost, "joint")
    flow.write_campaign = timed(flow.write_campaign, cost, "index")
    start, began = time.process_time(), time.perf_counter()
    doc = run_campaign(raw, out, OPTIONS, CampaignOptions(workers))
    cost["wall"] = time.perf_counter() - began
    cost["parent"] = time.process_time() - start - cost["joint"] - cost["index"]
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cost["workers"] = used.ru_utime + used.ru_stime
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    cost["peak"] = float(status.split("VmHWM:")[1].split()[0]) / 1024.0  # that of resource is the parent's, if larger
    assert doc["n_refused"] == 0
    assert doc["shared_parameters"], doc["findings"]
    return cost | {name: (out / name).stat().st_size / 1e6 for name in ("campaign.html", "campaign.json", "fit.json")}


def line(count: int, cost: dict[str, float]) -> str:
    """Return a row of the table."""
    parent, workers, index = (1e3 * cost[name] / count for name in ("parent", "workers", "index"))
    return (
        f"| {count} | {cost['joint']:.0f} | {cost['joint'] / count:.2f} | {parent:.1f} | {workers:.0f} | {index:.1f} | "
        f"{cost['wall']:.0f} | {cost['peak']:.0f} | {cost['campaign.html']:.2f} | "
        f"{cost['campaign.json']:.2f} | {cost['fit.json']:.2f} |"
    )


def main() -> None:
    """Measure each size in a process of its own, print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, nargs="+", default=[100, 300, 1000])
    parser.add_argument("--source", type=Path, default=ROOT / "raw_examples", help="recordings of one pump")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--base", type=Path, help="output of an earlier campaign of --source by this code")
    parser.add_argument("--measure", type=Path, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        raw, out = arguments.measure
        print(json.dumps(measure(raw, out, arguments.workers)))
        return
    print("\n".join(HEAD), flush=True)
    with tempfile.TemporaryDirectory(dir=(arguments.base or ROOT).parent, prefix=".joint_size-") as name:
        folder = Path(name)
        base = arguments.base or folder / "base"
        run_campaign(arguments.source, base, OPTIONS, CampaignOptions(arguments.workers))
        for count in arguments.count:
            raw, out = grown(arguments.source, base, folder, count)
            command = [sys.executable, __file__, "--workers", str(arguments.workers), "--measure", str(raw), str(out)]
            told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            print(line(count, json.loads(told)), flush=True)


if __name__ == "__main__":
    main()

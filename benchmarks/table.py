"""What camtorque costs, row by row as ratios with named peers, all in one run.

    python benchmarks/table.py [--long] [--campaign] [--rounds N] [--write FILE]

Commands are whole processes: processor time (user and system), wall time and peak memory are those of a child, least of
the rounds after a first one that compiles. ``--long`` adds recordings of one and ten minutes (0.8 GB on disk for a
while), ``--campaign`` the five examples with their joint fit, and the joint fit of twelve recordings: the examples
repeated, whose single fits are there. The fit itself: `benchmarks/speed.py --peers`.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from ingest_align import timed, write_recording
from joint_size import grown
from long_recording import write_long
from mechanism_speed import candidates as mechanism_candidates
from mechanism_speed import time_all
from numpy.typing import NDArray

matplotlib.use("svg")
import matplotlib.pyplot as plt
from camtorque.api import align, read
from camtorque.report.write import write_run
from camtorque.run import RunOptions, analyse

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "raw_examples" / "A_1000rpm"
SCRIPT, USAGE, JOINT_SIZE = (Path(__file__).with_name(f"{name}.py") for name in ("usual_script", "usage", "joint_size"))
LIBRARIES = "import numpy, scipy.interpolate, numba, h5py, jinja2"
HEAD = (
    "| work | processor | wall | peak memory | wanted | peer | its processor | ratio |\n"
    "|---|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True)
class Cost:
    """Of one process or call: wall and processor time [s], peak memory [MB] (nan for a call)."""

    wall: float
    processor: float
    megabytes: float = float("nan")


def process(*command: object) -> Cost:
    """Return the cost of a child process, which has to succeed."""
    found = subprocess.run(
        [sys.executable, USAGE, sys.executable, *map(str, command)], stdout=subprocess.PIPE, text=True, check=True,
        env={name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"},
    )  # fmt: skip
    return Cost(**json.loads(found.stdout))


def call(action: Callable[[], object]) -> Cost:
    """Return the cost of a call."""
    wall, processor = time.perf_counter(), time.process_time()
    action()
    return Cost(time.perf_counter() - wall, time.process_time() - processor)


def least(measure: Callable[[], Cost], rounds: int) -> Cost:
    """Return the cheapest of some rounds after a first one."""
    measure()
    return min((measure() for _ in range(rounds)), key=lambda cost: cost.processor)


def row(work: str, own: Cost, wanted: str, peer: str = "", other: Cost | None = None) -> str:
    """Return one line of the table."""
    memory = "" if np.isnan(own.megabytes) else f"{own.megabytes:.0f} MB"
    versus = f"{other.processor:.3g} s | {own.processor / other.processor:.2g}" if other else " | "
    return f"| {work} | {own.processor:.3g} s | {own.wall:.3g} s | {memory} | {wanted} | {peer} | {versus} |"


def command_rows(scratch: Path, rounds: int) -> Iterator[str]:
    """Yield the commands on the example of 3 s against the usual script, and what importing costs."""

    def command(*arguments: object) -> Cost:
        return least(lambda: process("-m", "camtorque.cli", *arguments), rounds)

    def python(*arguments: object) -> Cost:
        return least(lambda: process(*arguments), rounds)

    script = python(SCRIPT, next(EXAMPLE.glob("*.tdms")), "Prox_Trigger")
    peer = "npTDMS and pandas groupby: mean cycles alone"
    yield row("`--help`", command("--help"), "0.1 s", "python, nothing imported", python("-c", "pass"))
    yield row(
        "import of all that `run` needs", python("-c", "import camtorque.commands.run"), "0.6 s",
        "numpy, scipy.interpolate, numba, h5py, jinja2", python("-c", LIBRARIES),
    )  # fmt: skip
    yield row("`check`, 3 s", command("check", EXAMPLE), "0.4 s", peer, script)
    yield row("`align`, 3 s", command("align", EXAMPLE, "--out", scratch / "a"), "0.8 s", peer, script)
    yield row("`run`, 3 s", command("run", EXAMPLE, "--out", scratch / "r"), "5 s", peer, script)


def usual_figures(folder: Path, count: int) -> None:
    """Draw as many figures with matplotlib, three curves and a band each."""
    angle = np.linspace(0.0, 360.0, 3600)
    for k in range(count):
        figure, axes = plt.subplots(figsize=(8.0, 4.0))
        for phase in range(3):
            axes.plot(angle, np.sin(np.radians(angle + 30.0 * phase)))
        axes.fill_between(angle, -0.1, 0.1, alpha=0.3)
        figure.savefig(folder / f"{k}.svg")
        plt.close(figure)


def report_rows(scratch: Path, rounds: int) -> Iterator[str]:
    """Yield writing the report against matplotlib, which draws as many figures and writes nothing else."""
    result, _ = analyse(EXAMPLE, RunOptions())
    folder = scratch / "report"

    def written() -> None:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        write_run(result, folder)

    own = least(lambda: call(written), rounds)
    count = len(list((folder / "figures").glob("*.svg")))
    other = least(lambda: call(lambda: usual_figures(scratch, count)), 1)
    yield row("report, all figures and files", own, "1 s", f"matplotlib, {count} plain figures as SVG", other)


def long_rows(scratch: Path, seconds: float, wanted: tuple[str, str], with_peer: bool) -> Iterator[str]:
    """Yield aligning and running a long recording against the usual script."""
    folder = write_long(scratch / f"long{seconds:.0f}", seconds)
    size = f"{seconds / 60.0:.0f} min, {1e-6 * (folder / 'log.tdms').stat().st_size:.0f} MB"
    peer, script = "", None
    if with_peer:
        peer, script = "npTDMS and pandas groupby", process(SCRIPT, folder / "log.tdms", "trigger")
        peer += f" ({script.megabytes:.0f} MB)"
    for command, target in zip(("align", "run"), wanted, strict=True):
        out = scratch / "out"
        cost = process("-m", "camtorque.cli", command, folder, "--out", out)
        shutil.rmtree(out)
        yield row(f"`{command}`, {size}", cost, target, peer, script)
    shutil.rmtree(folder)


def reading_rows(scratch: Path) -> Iterator[str]:
    """Yield reading and aligning of 144 MB against loading the same numbers, in turn."""
    folder = write_recording(scratch / "minute", 60.0)
    arrays = scratch / "minute.npy"
    np.save(arrays, np.random.default_rng(1).standard_normal((3, 6_000_000)))
    costs = timed({"load": lambda: np.load(arrays), "own": lambda: align(read(folder))}, 9)
    own, load = (Cost(*costs[name]) for name in ("own", "load"))
    yield row("read and align 144 MB, compiled", own, "ratio 2", f"np.load ({load.wall:.3g} s wall)", load)
    shutil.rmtree(folder)


def mechanism_rows() -> Iterator[str]:
    """Yield the eight outputs of the mechanism against a copy; nanoseconds per sample, least of the rounds."""
    names = {
        "closed form, compiled, all 8": "1.1", "closed, kinematics included, one cycle": "15",
        "recursion, kinematics included, one cycle": "",
    }  # fmt: skip
    copy = "copy, 1 array to 8"
    found = {name: item for name, item in mechanism_candidates(500, 3600).items() if name in {copy, *names}}
    times: dict[str, NDArray[np.float64]] = time_all(found, 9)
    base = float(times[copy].min())
    for name, wanted in names.items():
        own = float(times[name].min())
        yield f"| eight outputs: {name} | {own:.3g} ns | | | {wanted} | {copy} | {base:.3g} ns | {own / base:.3g} |"


def campaign_rows(scratch: Path) -> Iterator[str]:
    """Yield the five examples with their joint fit, and the joint fit of twelve recordings that are all fitted."""
    out = scratch / "campaign"
    cost = process("-m", "camtorque.cli", "campaign", ROOT / "raw_examples", "--workers", "2", "--out", out)
    yield row("`campaign`, five examples, two workers", cost, "20 s wall")
    twelve = grown(ROOT / "raw_examples", out, scratch, 12)
    cost = process(JOINT_SIZE, "--measure", *twelve, "--workers", "2")
    yield row("joint fit of 12 with left-out predictions, imports and pages included", cost, "10 s wall")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--long", action="store_true", help="recordings of one and ten minutes")
    parser.add_argument("--campaign", action="store_true", help="the five examples with their joint fit")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    lines = [f"{platform.machine()}, Python {platform.python_version()}, {os.cpu_count()} processors, load "
             f"{os.getloadavg()[1]:.1f} when it began", "", HEAD]  # fmt: skip
    print("\n".join(lines), flush=True)
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        parts = [command_rows(scratch, options.rounds), report_rows(scratch, options.rounds)]
        parts += [reading_rows(scratch), mechanism_rows()]
        if options.long:
            parts.append(long_rows(scratch, 60.0, ("", "5 s, 500 MB"), True))
            parts.append(long_rows(scratch, 600.0, ("", "12 s, 600 MB"), False))
        if options.campaign:
            parts.append(campaign_rows(scratch))
        for part in parts:
            for line in part:
                print(line, flush=True)
                lines.append(line)
    if options.write:
        options.write.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

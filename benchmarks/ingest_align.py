"""Reading and aligning a long TDMS recording, as ratios to np.load of the same numbers, all in one run; writes a table.

    python benchmarks/ingest_align.py [--quick] [--out docs]

A 60 s recording of three channels at 100 kHz (144 MB of doubles) is written once. The candidates are timed in turn,
round by round, with the file in the page cache; the least of the rounds is given, processor time beside wall time,
which a busy machine spoils. The compiled pass of resampling is taken, as in every run. Memory is the peak resident
size of a child process above what its imports took.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numba  # noqa: F401  the compiled pass is taken where it is loaded
import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "align"))
from align_truth import PRESSURE_GAIN, TORQUE_GAIN, Rig, pressure_of, torque_of, trigger_volts
from camtorque.align import align
from camtorque.hashes import input_file
from camtorque.ingest import read_recording
from camtorque.process.threads import on_one_thread
from usual_script import mean_cycles

ROOT = Path(__file__).resolve().parents[1]
RATE = 100_000.0
N_THETA = 3600
ROW_MB = N_THETA * 2 * 8e-6
"""Torque and pressure of one cycle."""
PIECE = 10.0
"""Seconds written at a time."""
CHANNELS = ("torque", "pressure", "trigger")


def rig_signals(begin: float, end: float) -> list[np.ndarray]:
    """Volts of the three channels between two times."""
    rig = Rig(duration=end)
    rng = np.random.default_rng(int(begin))
    t = np.arange(round(begin * RATE), round(end * RATE)) / RATE
    torque = torque_of(rig.shaft.angle(t - rig.torque_delay)) + 0.3 * rng.standard_normal(t.size)
    pressure = pressure_of(rig.shaft.angle(t - rig.pressure_delay)) + 1e5 * rng.standard_normal(t.size)
    pulses = rig.pulse_times()
    pulses = pulses[(pulses > begin - 0.2) & (pulses < end + 0.2)]
    trigger = trigger_volts(rig, t, pulses, rig.pulse_rad / rig.shaft.speed) + 0.03 * rng.standard_normal(t.size)
    return [torque / TORQUE_GAIN, pressure / PRESSURE_GAIN, trigger]


def write_recording(folder: Path, seconds: float) -> Path:
    """Write a bench folder with one TDMS file, in pieces."""
    folder.mkdir(parents=True)
    with TdmsWriter(folder / "log.tdms") as writer:
        for begin in np.arange(0.0, seconds, PIECE):
            parts = rig_signals(begin, min(begin + PIECE, seconds))
            properties = {"wf_increment": 1.0 / RATE, "wf_start_offset": 0.0, "unit_string": "V"}
            writer.write_segment(
                [ChannelObject("Main", name, part, properties) for name, part in zip(CHANNELS, parts, strict=True)]
            )
    text = (ROOT / "raw_examples" / "A_1000rpm" / "recording.toml").read_text()
    head = (
        text[: text.index("[[channels]]")]
        .replace("1000.0", "500.0")
        .replace("../../calibration", str(ROOT / "calibration"))
    )
    table = '[[channels]]\nquantity = "{0}"\nfile = "log.tdms"\ngroup = "Main"\nchannel = "{0}"\nunit = "V"\n'
    table += 'logger = "DAQ1"\nsample_rate_hz = 100000.0\nsensor = "{1}"\n\n'
    serials = ("T22-40117", "K4067-40117", "PROX-01")
    tables = "".join(table.format(name, serial) for name, serial in zip(CHANNELS, serials, strict=True))
    (folder / "recording.toml").write_text(head + tables)
    return folder


def interpolating_script(path: Path) -> int:
    """Read, find edges, interpolate every cycle: what a bench engineer writes. Returns the number of cycles."""
    frame = TdmsFile.read(path)["Main"].as_dataframe()
    time_axis = np.arange(len(frame)) / RATE
    volts = frame["trigger"].to_numpy()
    edges = time_axis[1:][(volts[1:] > 2.5) & (volts[:-1] <= 2.5)]
    theta = np.arange(N_THETA) / N_THETA
    bounds = np.searchsorted(time_axis, edges)
    for quantity in ("torque", "pressure"):
        values = frame[quantity].to_numpy()
        rows = []
        for k in range(edges.size - 1):
            part = slice(bounds[k] - 1, bounds[k + 1] + 1)
            rows.append(np.interp(edges[k] + theta * (edges[k + 1] - edges[k]), time_axis[part], values[part]))
    return len(rows)


def candidates(folder: Path, arrays: Path) -> dict:
    recording, aligned = read_recording(folder), on_one_thread(align)  # as the command and the public face do
    return {
        "np.load of the same numbers": lambda: np.load(arrays),
        "SHA-256 of the file": lambda: input_file(folder / "log.tdms").sha256,
        "read_recording": lambda: read_recording(folder),
        "align (reads the samples)": lambda: aligned(recording),
        "read_recording and align": lambda: aligned(read_recording(folder)),
        "usual script: npTDMS, np.interp per cycle": lambda: interpolating_script(folder / "log.tdms"),
        "usual script: npTDMS, pandas groupby": lambda: mean_cycles(folder / "log.tdms", "trigger"),
    }


def timed(jobs: dict, rounds: int) -> dict[str, tuple[float, float]]:
    """Least wall and processor time of each job, in turn; compiled and in the page cache before."""
    for name, job in jobs.items():
        if not name.startswith("usual script: npTDMS, pandas"):
            job()
    costs: dict[str, list[tuple[float, float]]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            wall, processor = time.perf_counter(), time.process_time()
            job()
            costs[name].append((time.perf_counter() - wall, time.process_time() - processor))
    return {name: tuple(np.min(values, axis=0)) for name, values in costs.items()}


def _status(key: str) -> float:
    """Return a figure of this process [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) / 1024.0


def child(folder: Path) -> None:
    """Read and align; print the peak memory above what imports and compiled code take [MB]."""
    align(read_recording(ROOT / "raw_examples" / "A_1000rpm"))
    Path("/proc/self/clear_refs").write_text("5")  # sets the peak back to what is resident now
    before, anonymous = _status("VmRSS"), _status("RssAnon")
    cycles = align(read_recording(folder))
    kept = _status("RssAnon") - anonymous
    print(json.dumps({"mb": _status("VmHWM") - before, "kept_mb": kept, "cycles": int(cycles.index.size)}))


def memory(folder: Path) -> dict:
    command = [sys.executable, __file__, "--child", str(folder)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])


def report(costs: dict[str, tuple[float, float]], sizes: dict[str, dict], minutes: list[float]) -> str:
    walls, processors = costs["np.load of the same numbers"]
    lines = [
        "# Speed and memory of reading and aligning",
        "",
        "Written by `python benchmarks/ingest_align.py`: 60 s, three channels, 100 kHz, TDMS, 144 MB of doubles; file",
        f"in the page cache, least of interleaved rounds, {platform.machine()}, Python {platform.python_version()}, "
        f"numpy {np.__version__}; {os.cpu_count()} processors, {os.getloadavg()[1]:.1f} processes running beside",
        "and with it (an idle machine has 1.0).",
        "",
        "| what | processor, s | ratio to np.load | wall, s | ratio |",
        "|---|---|---|---|---|",
        *(
            f"| {name} | {processor:.3f} | {processor / processors:.2f} | {wall:.3f} | {wall / walls:.2f} |"
            for name, (wall, processor) in costs.items()
        ),
        "",
        "| recording | peak above the imports, MB | kept, MB | samples as doubles, MB | aligned arrays, MB | cycles |",
        "|---|---|---|---|---|---|",
        *(
            f"| {name} | {size['mb']:.0f} | {size['kept_mb']:.0f} | {144 * m:.0f} | {size['cycles'] * ROW_MB:.0f} | "
            f"{size['cycles']} |"
            for (name, size), m in zip(sizes.items(), minutes, strict=True)
        ),
        "",
        "The SHA-256 of a file is taken when the report asks for it, after the alignment: it has its own row. Peak",
        "memory counts the pages of arrays on disk that the system keeps mapped; it can drop them at any time.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="three rounds, no 10 minute recording")
    parser.add_argument("--out", type=Path, default=ROOT / "docs")
    parser.add_argument("--child", type=Path)
    options = parser.parse_args()
    if options.child:
        child(options.child)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        minute = write_recording(folder / "minute", 60.0)
        np.save(folder / "minute.npy", np.array(rig_signals(0.0, 60.0)))
        costs = timed(candidates(minute, folder / "minute.npy"), 3 if options.quick else 7)
        sizes = {"1 min": memory(minute)}
        minutes = [1.0]
        if not options.quick:
            long = write_recording(folder / "long", 600.0)
            sizes["10 min"] = memory(long)
            minutes.append(10.0)
    text = report(costs, sizes, minutes)
    (options.out / "ingest_align_speed.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()

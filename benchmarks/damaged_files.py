"""Cut files and flipped bytes: what does the product say? Each mutation is read in a bounded child process of its own.

A mutation is *flagged* when the recording is refused or a finding appears that the clean file does not have, *harmless*
when everything read is bit for bit that of the clean file, *small* when it differs by less than 0.1 % of the channel's
range, and *silent* when it differs by more and nothing was said. A child that dies by a
signal is a crash, one that exceeds the time a hang, any exception but `Refusal` is foreign.

    python benchmarks/damaged_files.py --n 300 --write docs/damaged_files.md
"""

from __future__ import annotations

import argparse
import multiprocessing as mp
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from camtorque.ingest import read_recording, summarise
from camtorque.records import Refusal
from damaged.build import MAT, PLANS, UNCOMPRESSED, log_file, mat73
from damaged.logs import Log, Plan, clean_log, write_folder

SECONDS = 20.0
"""A child that takes longer is a hang."""
SMALL = 1.0e-3
"""Largest change of a sample, as a part of its channel's range, that no check of samples can tell from noise."""
OUTCOMES = ("flagged", "harmless", "small", "silent", "crash", "hang", "foreign")


def small_log() -> Log:
    return clean_log(rate=5000.0, revolutions=12.0)


def _single(plan: Plan) -> Callable[[Path], Path]:
    return lambda folder: write_folder(folder, [small_log()], plan)


def _companions(folder: Path) -> Path:
    """Three CSV logs on one time base; the torque log is the one that is damaged."""
    log = small_log()
    parts = [replace(log, logger=quantity.upper(), volts={quantity: volts}) for quantity, volts in log.volts.items()]
    return write_folder(folder, parts, replace(PLANS["csv"], clock="synchronised"))


TARGETS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "CSV": (_single(PLANS["csv"]), "pandas CSV: 300 / 142"),
    "CSV with declared duration": (
        _single(replace(PLANS["csv"], channel_lines="duration_s = 1.2\n")),
        "pandas CSV: 300 / 142",
    ),
    "CSV with companions": (_companions, "pandas CSV: 300 / 142"),
    "TDMS": (_single(PLANS["tdms"]), "npTDMS: 281-300 / 250-294"),
    "MF4 deflate": (_single(PLANS["mf4"]), "asammdf: 0 / 4-20, 1 crash"),
    "MF4 plain": (_single(UNCOMPRESSED["mf4"]), "asammdf: 0 / 4-20, 1 crash"),
    "HDF5 fletcher32 + gzip": (_single(PLANS["hdf5"]), "h5py fletcher32: 0 / 0"),
    "HDF5 contiguous": (_single(UNCOMPRESSED["hdf5"]), "h5py contiguous: 0 / 297"),
    "MAT v5 compressed": (_single(MAT), ""),
    "MAT v5 plain": (_single(UNCOMPRESSED["mat"]), "loadmat v5: 0 / 298"),
    "MAT v7.3": (mat73(), ""),
    "NumPy archive": (_single(PLANS["numpy"]), ""),
    "catman": (_single(PLANS["catman"]), "apread: 59 / 57"),
    "Excel": (_single(PLANS["xlsx"]), ""),
    "Parquet with page checksums": (_single(PLANS["parquet"]), ""),
    "LabVIEW text": (_single(PLANS["lvm"]), ""),
}
"""Name -> (writer of the clean recording, the peers' silent truncations / silent flips of 300 each)."""


@dataclass(frozen=True)
class Reading:
    """What reading a folder came to: outcome, findings, what was read or its change."""

    kind: str
    codes: frozenset[tuple[str, str, str]] = frozenset()
    values: tuple[np.ndarray, ...] = ()
    change: float = 0.0
    text: str = ""


def read_all(folder: Path) -> Reading:
    """Read a recording as a run and a check do, and keep every value that goes on from here."""
    try:
        summary = summarise(read_recording(folder))
        recording = read_recording(folder)
        values = []
        for channel in recording.channels:
            values.append(np.array([channel.start_time, channel.sample_rate, channel.sign, channel.scale]))
            values.append(channel.read())
    except Refusal as refusal:
        return Reading("refused", text=str(refusal))
    except BaseException as error:
        return Reading("foreign", text=f"{type(error).__name__}: {error}")
    codes = frozenset((finding.code, finding.text, finding.where) for finding in summary.findings)
    return Reading("read", codes, tuple(values))


def change_of(clean: tuple[np.ndarray, ...], read: tuple[np.ndarray, ...]) -> float:
    """Return the largest change of a sample over the range of its channel; inf for a change of shape or time base."""
    largest = 0.0
    for number, (before, after) in enumerate(zip(clean, read, strict=True)):
        if before.shape != after.shape or (number % 2 == 0 and not np.array_equal(before, after)):
            return float("inf")
        if number % 2:
            largest = max(largest, float(np.max(np.abs(after - before)) / np.ptp(before)))
    return largest


def _child(folder: Path, pipe: Connection, clean: tuple[np.ndarray, ...]) -> None:
    warnings.simplefilter("ignore")
    reading = read_all(folder)
    if clean and reading.kind == "read":
        reading = replace(reading, values=(), change=change_of(clean, reading.values))
    pipe.send(reading)
    pipe.close()


def bounded_read(folder: Path, clean: tuple[np.ndarray, ...] = ()) -> Reading:
    """Read in a child process; a death or a delay of the child is an outcome."""
    mine, theirs = mp.Pipe(duplex=False)
    child = mp.get_context("fork").Process(target=_child, args=(folder, theirs, clean), daemon=True)
    child.start()
    theirs.close()
    try:
        if not mine.poll(SECONDS):
            return Reading("hang")
        return mine.recv()
    except EOFError:
        child.join(SECONDS)
        return Reading("crash", text=f"exit code {child.exitcode}")
    finally:
        if child.is_alive():
            child.join(1.0)
        if child.is_alive():
            child.kill()
        child.join()


def judge(clean: Reading, mutated: Reading) -> str:
    """Return one of `OUTCOMES`."""
    if mutated.kind in ("hang", "crash", "foreign"):
        return mutated.kind
    if mutated.kind == "refused" or mutated.codes - clean.codes:
        return "flagged"
    if mutated.change == 0.0:
        return "harmless"
    return "small" if mutated.change < SMALL else "silent"


def mutate(data: bytes, kind: str, rng: np.random.Generator) -> tuple[bytes, str]:
    """Return mutated bytes and a note of what was done."""
    place = int(rng.integers(0, len(data)))
    if kind == "truncation":
        return data[:place], f"cut after {place} of {len(data)} bytes"
    flipped = bytearray(data)
    mask = int(rng.integers(1, 256))
    flipped[place] ^= mask
    return bytes(flipped), f"byte {place} of {len(data)} xor {mask:#04x}"


def run_target(name: str, n: int, seed: int, root: Path) -> tuple[dict[str, Counter], list[str]]:
    """Mutate one kind of file ``n`` times each way; return counts by mutation and notes on what was not flagged."""
    folder = TARGETS[name][0](root / "clean")
    target = folder / "TORQUE.csv" if name == "CSV with companions" else log_file(folder)
    data, clean = target.read_bytes(), bounded_read(folder)
    if clean.kind != "read":
        raise RuntimeError(f"{name}: the clean recording is {clean.kind}: {clean.text}")
    rng = np.random.default_rng(seed)
    counts: dict[str, Counter] = {"truncation": Counter(), "flip": Counter()}
    notes = []

    def one(job: tuple[str, int, bytes, str]) -> tuple[str, str, Reading, str]:
        kind, number, mutated, note = job
        copy = root / f"{kind}{number}"
        shutil.copytree(folder, copy)
        (copy / target.name).write_bytes(mutated)
        reading = bounded_read(copy, clean.values)
        shutil.rmtree(copy)
        return kind, judge(clean, reading), reading, note

    jobs = [(kind, number, *mutate(data, kind, rng)) for kind in counts for number in range(n)]
    with ThreadPoolExecutor(2) as pool:
        for kind, outcome, reading, note in pool.map(one, jobs):
            counts[kind][outcome] += 1
            if outcome not in ("flagged", "harmless", "small"):
                notes.append(f"{name}: {kind} {outcome}: {note} change {reading.change:.2g} {reading.text}")
    return counts, notes


def table(results: dict[str, dict[str, Counter]], n: int) -> str:
    """Return the table in Markdown, the peers' silent counts beside ours."""
    lines = [
        "| file | cuts flagged | cuts harmless | cuts silent | flips flagged | flips harmless | flips small "
        "| flips silent "
        "| crashes | hangs | foreign exceptions | peers: silent cuts / flips of 300 |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, counts in results.items():
        cut, flip = counts["truncation"], counts["flip"]
        both = cut + flip
        cells = [
            cut["flagged"],
            cut["harmless"],
            cut["small"] + cut["silent"],
            flip["flagged"],
            flip["harmless"],
            flip["small"],
        ]
        cells += [flip["silent"]]
        cells += [both["crash"], both["hang"], both["foreign"]]
        lines.append(f"| {name} | " + " | ".join(map(str, cells)) + f" | {TARGETS[name][1]} |")
    return "\n".join(lines) + f"\n\n{n} cuts and {n} flipped bytes per line.\n"


HEAD = """# Damaged files

Made by `python benchmarks/damaged_files.py --n {n} --write docs/damaged_files.md`. Each mutation is read as a
check does, in a child process of its own with a limit of {seconds:g} s. *Flagged*: refused, or a finding that the clean
file does not have. *Harmless*: all that was read is bit for bit that of the clean file. *Small*: a sample changed by
less than 0.1 % of its channel's range, which no look at samples can tell from noise. *Silent*: it differs by more and
nothing was said.
The peers' column gives silent truncations / silent flips of 300 each of the bare reader library.

"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=300, help="mutations of each kind per format")
    parser.add_argument("--only", default="", help="formats whose name contains this")
    parser.add_argument("--seed", type=int, default=20250312)
    parser.add_argument("--write", type=Path, help="write the table to this Markdown file")
    options = parser.parse_args()
    results, notes = {}, []
    for name in TARGETS:
        if options.only not in name:
            continue
        began = time.perf_counter()
        with tempfile.TemporaryDirectory() as root:
            results[name], more = run_target(name, options.n, options.seed, Path(root))
        notes += more
        print(f"{name}: {time.perf_counter() - began:.0f} s", file=sys.stderr)
    text = table(results, options.n)
    print(text)
    for note in notes:
        print(note, file=sys.stderr)
    if options.write:
        options.write.write_text(HEAD.format(n=options.n, seconds=SECONDS) + text, encoding="utf-8")


if __name__ == "__main__":
    main()

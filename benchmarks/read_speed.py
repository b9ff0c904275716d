"""Reading 60 s of three channels at 100 kHz (144 MB) from TDMS against `np.load` of the same numbers, in one run.

    python benchmarks/read_speed.py [--seconds 60] [--repeat 5]

Prints the medians of the times, their ratio, and the growth of the largest resident memory when the channels are read
in pieces of one second.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from camtorque.ingest import read_recording
from damaged.logs import Log, Plan, clean_log, write_folder

RATE = 100_000.0


def long_log(seconds: float) -> Log:
    """One second of a clean log, repeated: reading does not care."""
    one = clean_log(rate=RATE, revolutions=10.0)
    volts = {quantity: np.tile(values, round(seconds)) for quantity, values in one.volts.items()}
    return Log(RATE, 0.0, volts, np.arange(next(iter(volts.values())).size) / RATE)


def median_time(action: Callable[[], object], repeat: int) -> float:
    """Return the median time of an action [s]."""
    times = []
    for _ in range(repeat):
        began = time.perf_counter()
        action()
        times.append(time.perf_counter() - began)
    return float(np.median(times))


def in_pieces(folder: Path) -> float:
    """Read every channel in pieces of a second and return a number, so that nothing is left out."""
    total = 0.0
    for channel in read_recording(folder).channels:
        step = round(channel.sample_rate)
        for start in range(0, channel.n_samples, step):
            total += float(channel.source.read(start, min(start + step, channel.n_samples))[0])
    return total


def peak_megabytes() -> float:
    """Return the largest resident memory so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as root:
        folder, store = Path(root) / "log", Path(root) / "log.npy"
        if not _write(folder, store, options.seconds):
            raise SystemExit("the writing process failed")
        before = peak_megabytes()
        pieces = median_time(lambda: in_pieces(folder), options.repeat)
        grown = peak_megabytes() - before
        whole = median_time(
            lambda: [c.source.read(0, c.n_samples) for c in read_recording(folder).channels], options.repeat
        )
        load = median_time(lambda: np.load(store), options.repeat)
        size = store.stat().st_size / 1e6
    print(f"{size:.0f} MB; np.load {load:.4f} s; whole channels {whole:.4f} s ({whole / load:.2f} x);")
    print(f"in pieces of a second {pieces:.4f} s ({pieces / load:.2f} x), memory grew by {grown:.1f} MB")


def _write(folder: Path, store: Path, seconds: float) -> bool:
    """Write in a process of its own, whose memory does not count."""
    import multiprocessing as mp

    writer = mp.get_context("fork").Process(target=_write_here, args=(folder, store, seconds))
    writer.start()
    writer.join()
    return writer.exitcode == 0


def _write_here(folder: Path, store: Path, seconds: float) -> None:
    log = long_log(seconds)
    write_folder(folder, [log], Plan("tdms"))
    np.save(store, np.array(list(log.volts.values())))


if __name__ == "__main__":
    main()

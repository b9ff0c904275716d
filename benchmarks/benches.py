"""What several benchmarks share: a simulated bench run from files, jobs in threads, rows as CSV, texts as files.

Imported first, it puts `tests`, where the simulated rigs are, onto the path.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
from camtorque.finished_fit import Rig
from camtorque.fit.single import Prepared
from rigs.rig import RigRun
from rigs.truth import RigTruth, change
from rigs.write import write_recording

MISS_COST = 2.0 / 0.05
Job = TypeVar("Job")
Result = TypeVar("Result")


def plain_parser(text: str | None) -> argparse.ArgumentParser:
    """Return a parser that prints the text of a benchmark as it is written."""
    return argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)


def bench_parser(text: str | None) -> argparse.ArgumentParser:
    """Return a parser with the options of benchmarks that run simulated benches from files."""
    made = plain_parser(text)
    made.add_argument("--draws", type=int, default=2, help="rigs of each kind")
    made.add_argument("--first", type=int, default=0, help="number of the first draw")
    made.add_argument("--cycles", type=int, default=20, help="revolutions of each recording")
    made.add_argument("--workers", type=int, default=1)
    made.add_argument("--write", type=Path)
    return made


def outcomes(action: Callable[[Job], Result], jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, Result]]:
    """Yield jobs in order with what came of each; as many at once as workers."""
    with ThreadPoolExecutor(workers) as pool:
        yield from zip(jobs, pool.map(action, jobs), strict=True)


def run_from_files(run: RigRun, place: Path, bench: tuple[str, str], seed: int) -> tuple[str, dict[str, Any]]:
    """Write a run as a bench (format, loggers) leaves it and let `camtorque run` write to ``place / "out"``.

    Return its last words with an empty result where it refused.
    """
    write_recording(run, place / run.truth.name, *bench, seed=seed)
    command = ["run", str(place / run.truth.name), "--out", str(place / "out"), "--quiet"]
    done = subprocess.run(
        [sys.executable, "-m", "camtorque.cli", *command], capture_output=True, text=True, check=False
    )
    written = place / "out" / "result.json"
    if not written.exists():
        return done.stderr.strip()[-200:] or f"exit status {done.returncode}", {}
    return "", json.loads(written.read_text(encoding="utf-8"))


def rig_of(item: Prepared) -> Rig:
    """Return the sheets of a recording as a prediction takes them."""
    config = item.recording.config
    return Rig(config.pump, item.recording.cam_table, config.rotation, config.trigger.nominal_angle)


def as_declared(truth: RigTruth) -> RigTruth:
    """Return a rig whose sensors err as their sheets say: certificates and standstill readings narrow what is drawn."""
    torque, pressure = truth.torque_sensor, truth.pressure_sensor
    return change(
        truth, torque_sensor__gain_error=0.4 * torque.gain_error, pressure_sensor__gain_error=0.5 * pressure.gain_error,
        torque_sensor__zero_residual=0.25 * torque.zero_residual,
        pressure_sensor__zero_residual=0.25 * pressure.zero_residual,
    )  # fmt: skip


def interval_table(found: Mapping[str, Sequence[tuple[float, float, float, float]]]) -> list[str]:
    """Return a line a parameter from its (true, stated value, low, high) on each rig.

    The interval score of a 95 % interval is its width plus 40 times the distance by which it misses (Gneiting &
    Raftery, J. Am. Stat. Assoc. 102 (2007)): wide intervals and false ones both cost.
    """
    lines = [
        "| parameter | rigs | covered | median error | median half width | mean interval score |",
        "|---|---|---|---|---|---|",
    ]
    for name, rows in found.items():
        true, value, low, high = np.array(rows).T
        missed = np.maximum(low - true, 0.0) + np.maximum(true - high, 0.0)
        lines.append(
            f"| {name} | {value.size} | {int(np.sum(missed == 0.0))} | {np.median(np.abs(value - true)):.3g} | "
            f"{0.5 * np.median(high - low):.3g} | {np.mean(high - low + MISS_COST * missed):.3g} |"
        )
    return lines


def write_rows(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows as CSV, the names of the first as its head."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def tell(text: str, path: Path | None) -> None:
    """Print a text and write it where a file is named."""
    print(text)
    if path:
        path.write_text(text, encoding="utf-8")

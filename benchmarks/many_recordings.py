"""What a step of the joint fit costs with 5 to 500 recordings.

    python benchmarks/many_recordings.py --write docs/many_recordings.md

The recordings of a folder are repeated under other names; every repeat has its own parameters. Measured are the making
of one recording's summary, the elimination of its own parameters, and the step of the shared ones, once through the
summaries and once through the whole matrix of all parameters (up to 100 recordings).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from camtorque.fit.joint import joint_start
from camtorque.fit.many import layout, reduced, shared_step, summarise
from camtorque.fit.problem import FIT_EFFECTS, FitData, build_problem
from camtorque.run import RunOptions, align, prepare, read_recording, rigid_torque

COUNTS = (5, 20, 100, 500)
LARGEST_WHOLE = 100
REPEATS = 3


def timed(call: Callable[[], object]) -> float:
    """Return the least wall time of some repeats [s]."""
    best = np.inf
    for _ in range(REPEATS):
        started = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - started)
    return float(best)


def row_of(items: list[FitData], count: int) -> str:
    """Return the line of one number of recordings."""
    data = [replace(items[k % len(items)], name=f"run{k}") for k in range(count)]
    problem = build_problem(data, tuple(name for name in FIT_EFFECTS if name not in ("coupling", "spring")))
    places = layout(problem)
    x = np.r_[problem.start(), np.zeros(len(problem.linear) + problem.n_lift)]
    values = np.clip(x, places.lower, places.upper)
    some = range(min(count, 10))
    summaries = [summarise(problem, places, values, k) for k in some]
    making = timed(lambda: [summarise(problem, places, values, k) for k in some]) / len(some)
    taking = timed(lambda: [reduced(s, places, values, k, 0.01) for k, s in enumerate(summaries)]) / len(some)
    parts = [reduced(s, places, values, k, 0.01) for k, s in enumerate(summaries)]
    matrix = sum(p.matrix for p in parts) * (count / len(some))
    vector = sum(p.vector for p in parts) * (count / len(some))
    step = timed(lambda: shared_step(matrix, vector, places, values, 0.01))
    whole = "-"
    if count <= LARGEST_WHOLE:
        system = np.eye(values.size) + 1e-3
        whole = f"{1e3 * timed(lambda: np.linalg.solve(system, values)):.1f}"
    return f"| {count} | {values.size} | {1e3 * making:.1f} | {1e3 * taking:.2f} | {1e3 * step:.1f} | {whole} |"


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("raw_examples"))
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    items = []
    for path in sorted(arguments.folder.glob("*/recording.toml")):
        recording = read_recording(path)
        cycles = align(recording, RunOptions().align)
        items.append(prepare(recording, cycles, rigid_torque(recording, cycles)).data)
    items = joint_start(items)
    rows = [row_of(items, count) for count in COUNTS]
    text = "\n".join([
        "# The joint fit of many recordings", "", "`python benchmarks/many_recordings.py`", "",
        "| recordings | parameters | summary, each [ms] | own parameters, each [ms] | shared step [ms] | "
        "whole matrix, solve alone [ms] |", "|---|---|---|---|---|---|", *rows, "",
    ])  # fmt: skip
    print(text)
    if arguments.write:
        arguments.write.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

"""Cold starts of the joint fit, drawn from the priors, and how many end in the same minimum.

    python benchmarks/cold_starts.py --starts 50 --write docs/cold_starts.md

Every start draws all non-linear parameters from their priors (a log-uniform factor of two about the start where there
is none), within their bounds. The ends of delivery come from the line pressure's event, with 2 degrees of scatter.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from pipeline.fit.events import delivery_event
from pipeline.fit.joint import joint_start
from pipeline.fit.problem import FIT_EFFECTS, Problem, build_problem
from pipeline.fit.solve import solve
from pipeline.run import RunOptions, align, prepare, read_recording, rigid_torque
from pipeline.units import DEGREE

SAME = 1.0e-6


def drawn(problem: Problem, generator: np.random.Generator) -> np.ndarray:
    """Return a start of the non-linear parameters."""
    values = []
    for slot in problem.nonlinear:
        row = slot.row
        if row.name == "end_of_delivery":
            value = delivery_event(problem.data[slot.recording]) + 2.0 * DEGREE * generator.standard_normal()
        elif row.prior is not None:
            value = row.prior[0] + row.prior[1] * generator.standard_normal()
        else:
            value = row.start * 2.0 ** generator.uniform(-1.0, 1.0)
        values.append(np.clip(value, row.lower, row.upper))
    return np.array(values)


def main() -> None:
    """Run the starts and print, or write, what they reach."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("raw_examples"))
    parser.add_argument("--starts", type=int, default=50)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    items = []
    for path in sorted(arguments.folder.glob("*/recording.toml")):
        recording = read_recording(path)
        cycles = align(recording, RunOptions().align)
        items.append(prepare(recording, cycles, rigid_torque(recording, cycles)).data)
    effects = tuple(name for name in FIT_EFFECTS if name not in ("coupling", "spring"))
    problem = build_problem(joint_start(items), effects)
    generator = np.random.default_rng(0)
    started, found = time.perf_counter(), []
    for _ in range(arguments.starts):
        solution = solve(problem, drawn(problem, generator), max_iterations=120)
        found.append((solution.chi_square, solution.iterations, solution.converged))
    best = min(chi for chi, _, _ in found)
    relative = np.array([chi / best - 1.0 for chi, _, _ in found])
    rows = [
        f"| {limit:g} | {int(np.sum(relative <= limit))} of {relative.size} |" for limit in (SAME, 1e-4, 1e-2, 1e-1)
    ]
    text = "\n".join([
        "# Cold starts of the joint fit", "",
        f"`python benchmarks/cold_starts.py --starts {arguments.starts}`: five recordings, effects",
        f"{', '.join(effects)}.",
        f"Least chi-square {best:.6g}; {time.perf_counter() - started:.0f} s.", "",
        "| chi-square above the least by at most | starts |", "|---|---|", *rows, "",
    ])  # fmt: skip
    print(text)
    if arguments.write:
        arguments.write.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

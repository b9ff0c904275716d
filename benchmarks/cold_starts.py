"""Cold starts of the joint fit, drawn from the priors, and how many end in the same minimum.

    python benchmarks/cold_starts.py --starts 50 --write docs/cold_starts.md

Every start draws all non-linear parameters of all recordings: from the prior where there is one, else over a factor of
four about the row's start, ends of delivery over the whole rising flank. From there on it is the product that works:
`find_start` for each recording, then `solve_joint`. `find_start` scans the end of delivery, the dead volume and the
drive; the other parameters start as drawn.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from camtorque.fit.joint import solve_joint
from camtorque.fit.prepare import with_rows
from camtorque.fit.problem import FIT_EFFECTS, FitData, Problem
from camtorque.fit.solve import Solution
from camtorque.fit.starts import find_start, rising_angles
from camtorque.fit.uncertainty import covariance, parameter_names, parameter_values
from camtorque.run import RunOptions, align, prepare, read_recording, rigid_torque

SAME = 1.0e-6
EFFECTS = tuple(name for name in FIT_EFFECTS if name not in ("coupling", "spring"))
"""What the ladder keeps of the five examples."""


def drawn(items: Sequence[FitData], generator: np.random.Generator) -> list[FitData]:
    """Return the recordings with starts drawn from the priors; shared parameters are drawn once."""
    shared: dict[str, float] = {}
    result = []
    for item in items:
        changes = {}
        for name, row in item.rows.items():
            if row.is_linear:
                continue
            value = shared.get(name, _draw(item, name, generator))
            if row.role == "shared":
                shared[name] = value
            changes[name] = {"start": float(np.clip(value, row.lower, row.upper))}
        result.append(with_rows(item, changes))
    return result


def _draw(item: FitData, name: str, generator: np.random.Generator) -> float:
    row = item.rows[name]
    if name in ("end_of_delivery", "spill_lift"):
        angles, lifts = rising_angles(item, (float(generator.uniform(0.2, 0.98)),))
        return float((lifts if name == "spill_lift" else angles)[0])
    if row.prior is not None:
        return row.prior[0] + row.prior[1] * float(generator.standard_normal())
    return row.start * 2.0 ** float(generator.uniform(-1.0, 1.0))


def weak_directions(problem: Problem, solution: Solution, count: int = 3) -> list[str]:
    """Return the directions that the data tell least, as parameters with their shares."""
    names = parameter_names(problem)
    gram = solution.data_hessian[: len(names), : len(names)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-30))
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    rows = []
    for value, vector in zip(values[:count], vectors.T[:count], strict=True):
        top = np.argsort(-np.abs(vector))[:4]
        parts = ", ".join(f"{names[j]} {vector[j]:+.2f}" for j in top)
        rows.append(f"eigenvalue {value:.1e}: {parts}")
    return rows


def main() -> None:
    """Fit from every start, count where they end, print, write."""
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
    generator = np.random.default_rng(0)
    started, found = time.perf_counter(), []
    for k in range(arguments.starts):
        starts = [find_start(item).data for item in drawn(items, generator)]
        problem, solution = solve_joint(starts, EFFECTS)
        found.append((solution.chi_square, solution.converged, problem, solution))
        print(k, f"{solution.chi_square:.7g}", solution.converged, [s.delivery for s in starts], flush=True)
    seconds = (time.perf_counter() - started) / arguments.starts
    text = report(found, arguments.starts, seconds)
    print(text)
    if arguments.write:
        arguments.write.write_text(text, encoding="utf-8")


def report(found: list[tuple[float, bool, Problem, Solution]], count: int, seconds: float) -> str:
    """Return the page: chi-squares, largest differences in standard errors, weak directions."""
    least = min(found, key=lambda row: row[0])
    relative = np.array([row[0] / least[0] - 1.0 for row in found])
    problem, solution = least[2], least[3]
    deviation = np.sqrt(np.maximum(np.diag(covariance(problem, solution).matrix), 0.0))
    best = parameter_values(problem, solution)
    same = [row for row, above in zip(found, relative, strict=True) if above <= SAME]
    worst = np.max([np.abs(parameter_values(row[2], row[3]) - best) for row in same], axis=0)
    ratio = worst / np.where(deviation > 0.0, deviation, np.inf)
    k = int(np.argmax(ratio))
    limits = (SAME, 1e-4, 1e-2, 1e-1)
    return "\n".join([
        "# Cold starts of the joint fit", "",
        f"`python benchmarks/cold_starts.py --starts {count}`: five recordings, effects {', '.join(EFFECTS)}.",
        f"Least chi-square {least[0]:.7g}; {seconds:.1f} s per start. {sum(row[1] for row in found)} of {count} ends",
        "call themselves converged.", "",
        "| chi-square above the least by at most | starts |", "|---|---|",
        *[f"| {limit:g} | {int(np.sum(relative <= limit))} of {count} |" for limit in limits], "",
        f"Among those within {SAME:g} the parameters differ by at most {ratio[k]:.1e} standard errors "
        f"({parameter_names(problem)[k]}).", "",
        "Directions that the data tell least (correlation form; priors hold them):", "",
        *[f"- {row}" for row in weak_directions(problem, solution)], "",
        "A start draws every non-linear parameter from its prior (a factor of four where there is none; ends of",
        "delivery over the whole rising flank) and then goes the product's way: each recording scans its end of",
        "delivery, dead volume and drive, sweeps parameter by parameter where the residual stays poor, and the joint",
        "fit tries the neighbouring valleys of drive and valve (`fit/starts.py`).", "",
    ])  # fmt: skip


if __name__ == "__main__":
    main()

"""Accuracy of the search against its cost: what every move finds, and what another minute would.

    python benchmarks/search_cost.py RECORDING... [--workers 2] [--write docs/search_cost_figures.md --chart FILE.svg]

Each recording is searched with its hops between minima going on far beyond where a run ends them; the least chi-square
of all is the best minimum known. A recording is found once its chi-square is below 1.5 times that plus 20. Minima are
those on the fine grid, judged on both halves of the cycles, before the valley is walked. Processor time of one thread.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from benches import plain_parser, tell
from camtorque.align import AlignOptions, align
from camtorque.fit.minima import Halves
from camtorque.fit.prepare import fit_data, mean_cycles, other_half
from camtorque.fit.problem import STRUCTURES
from camtorque.fit.search import DOUBTFUL, HOPS, stages
from camtorque.ingest import read_recording
from camtorque.mechanism.lift_laws import spectral_law

LONG = 24
FOUND_TIMES, FOUND_PLUS = 1.5, 20.0
HELPED = 0.9
TRIGGER = "trigger_offset"


@dataclass(frozen=True)
class Stage:
    """What was done, processor time since the start [s], least chi-square and its trigger angle [deg]."""

    name: str
    seconds: float
    chi_square: float
    trigger: float


def searched(folder: Path) -> list[Stage]:
    """Return the stages of the search of one recording."""
    recording = read_recording(folder)
    cycles = align(recording, AlignOptions())
    means = mean_cycles(cycles)
    law = spectral_law(recording.cam_table)
    data = fit_data(recording, cycles, law, means)
    halves = Halves(data, other_half(data, means))
    next(stages(halves, tuple(STRUCTURES)))  # loads what is compiled
    began = time.process_time()
    result = []
    for name, found in stages(halves, tuple(STRUCTURES), ((DOUBTFUL, LONG),)):
        if found.best is not None:
            angle = float(np.degrees(found.best[1].data.rows[TRIGGER].start))
            result.append(Stage(name, time.process_time() - began, found.value, angle))
    return result


def default_end(path: Sequence[Stage]) -> int:
    """Return the place of the stage at which a run ends the search."""
    hops = 0
    for place, stage in enumerate(path[:-1]):
        hops += 2 * (stage.name == "hops")
        if path[place + 1].name == "hops" and not any(stage.chi_square > above and hops < most for above, most in HOPS):
            return place
    return len(path) - 1


def found(stage: Stage, path: Sequence[Stage]) -> bool:
    """Return whether a stage has a minimum that counts as the best one known."""
    return stage.chi_square < FOUND_TIMES * path[-1].chi_square + FOUND_PLUS


def off(stage: Stage, path: Sequence[Stage]) -> float:
    """Return how far the trigger angle is from that of the best minimum known [deg]."""
    return abs(stage.trigger - path[-1].trigger)


def summary(paths: Sequence[Sequence[Stage]]) -> str:
    """Return the table of what ends where."""
    lines = [
        "| search ends after | processor time, mean, s | found | chi-square against the best known, geometric mean "
        "| trigger off that of the best known, 90th percentile / worst, deg |",
        "|---|---|---|---|---|",
    ]
    ends = {
        "first starts": [0 for _ in paths],
        "the end of delivery scanned": [max(_last(path, ("first starts", "end of delivery")), 0) for path in paths],
        "all moves": [max(k for k, stage in enumerate(path) if stage.name != "hops") for path in paths],
        "hops, as a run ends them": [default_end(path) for path in paths],
        f"{LONG} hops": [len(path) - 1 for path in paths],
    }
    for name, places in ends.items():
        at = [path[k] for path, k in zip(paths, places, strict=True)]
        ratio = np.exp(np.mean([np.log(s.chi_square / p[-1].chi_square) for s, p in zip(at, paths, strict=True)]))
        away = [off(s, p) for s, p in zip(at, paths, strict=True)]
        count = sum(found(s, p) for s, p in zip(at, paths, strict=True))
        lines.append(
            f"| {name} | {np.mean([s.seconds for s in at]):.1f} | {count} of {len(paths)} | {ratio:.2f} "
            f"| {np.percentile(away, 90):.2f} / {max(away):.2f} |"
        )
    return "\n".join(lines) + "\n"


def _last(path: Sequence[Stage], names: tuple[str, ...]) -> int:
    """Return the last place of the first stages that have these names."""
    return next((k for k, stage in enumerate(path) if stage.name not in names), len(path)) - 1


def moves(paths: Sequence[Sequence[Stage]]) -> str:
    """Return the table of what each move brings."""
    made, helped, cost = Counter[str](), Counter[str](), Counter[str]()
    for path in paths:
        run = path[: default_end(path) + 1]
        made[run[0].name] += 1
        cost[run[0].name] += run[0].seconds  # type: ignore[assignment]
        for before, after in pairwise(run):
            made[after.name] += 1
            helped[after.name] += after.chi_square < HELPED * before.chi_square
            cost[after.name] += after.seconds - before.seconds  # type: ignore[assignment]
    lines = ["| move | made | chi-square fell by a tenth | processor time each, s |", "|---|---|---|---|"]
    lines += [f"| {name} | {made[name]} | {helped.get(name, '-')} | {cost[name] / made[name]:.2f} |" for name in made]
    return "\n".join(lines) + "\n"


def chart(paths: Sequence[Sequence[Stage]], file: Path) -> None:
    """Draw share found and distance of the trigger angle over the processor time that is spent."""
    budgets = np.geomspace(0.3, max(path[-1].seconds for path in paths), 60)
    at = [[max((s for s in path if s.seconds <= t), key=lambda s: s.seconds, default=None) for path in paths]
          for t in budgets]  # fmt: skip
    share = [100.0 * np.mean([s is not None and found(s, p) for s, p in zip(row, paths, strict=True)]) for row in at]
    away = [np.percentile([off(s, p) if s else np.inf for s, p in zip(row, paths, strict=True)], 90) for row in at]
    figure, axes = plt.subplots(2, 1, figsize=(7.0, 5.6), sharex=True, layout="constrained")
    axes[0].step(budgets, share, where="post", color="tab:blue")
    axes[0].set(ylabel="recordings found [%]", ylim=(0.0, 103.0))
    axes[1].step(budgets, away, where="post", color="tab:red")
    axes[1].set(yscale="log", ylabel="trigger angle off the best\nminimum, 90th percentile [deg]",
                xlabel="processor time spent on a recording [s]", xscale="log")  # fmt: skip
    usual = float(np.mean([path[default_end(path)].seconds for path in paths]))
    for axis in axes:
        axis.axvline(usual, color="0.4", linestyle="--", linewidth=1.0)
        axis.grid(alpha=0.3, which="both")
    axes[0].annotate("a run ends its search (mean)", (usual, 30.0), xytext=(6.0, 0.0), textcoords="offset points",
                     color="0.3", fontsize=9)  # fmt: skip
    figure.savefig(file)


def main() -> None:
    """Search the recordings and print, or write, tables and chart."""
    parser = plain_parser(__doc__)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--chart", type=Path)
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.workers) as pool:
        paths = []
        for folder, path in zip(arguments.recordings, pool.map(searched, arguments.recordings), strict=True):
            print(folder.name, *(f"{s.name} {s.seconds:.1f}s {s.chi_square:.0f}" for s in path), sep=" | ", flush=True)
            paths.append(path)
    tell(summary(paths) + "\n" + moves(paths), arguments.write)
    if arguments.chart:
        chart(paths, arguments.chart)


if __name__ == "__main__":
    main()

"""Where does the answer fail? One property of drive, load or transducer after another, far beyond what is usual.

Two simulated benches (`tests/rigs`: a delivery that ends by a land, one that ends by spill), as files, `camtorque run`
with defaults; one property at a time is set to each of its levels. A cell is *right* where every run of it holds the
true trigger angle in its 95 % interval and the chamber pressure within two standard deviations at nine tenths of the
loaded angles; *told* where a run that does not is refused, called unexplained or one to look closer at; else *wrong*.

    python benchmarks/answer_map.py --workers 2 --write docs/answer_map_figures.md --chart docs/answer_map.svg
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from benches import as_declared, bench_parser, outcomes, tell
from coverage import Outcome, covers, outcome_of
from rigs.families import FAMILIES
from rigs.rig import simulate
from rigs.truth import BAR, DEGREE, change

ENDS = ("closed_volume", "spill")
SPEED, LOAD, CYCLES = "speed", "load", "cycles"
USUAL = {SPEED: 700.0, LOAD: 0.75}
"""Running of every run but where it is the property that is varied [rpm, -]."""
ELECTRONICS = 0.225e-3
"""Delay of the torque transducer beside its low-pass [s]."""
INSIDE = 90.0
"""Least share of the loaded angles within two standard deviations [%]."""
COLOURS = {"right": "#b7dfc0", "told": "#f4e3a1", "wrong": "#eeb1aa"}


@dataclass(frozen=True)
class Varied:
    """A property, the unit that its levels are written in, and its levels in that unit."""

    label: str
    path: str
    per_unit: float
    levels: tuple[float, ...]


VARIED: dict[str, tuple[Varied, ...]] = {
    "drive": (
        Varied("inertia of the drive, kg m^2", "driveline__drive_inertia", 1.0, (0.003, 0.01, 0.03, 0.3, 3.0)),
        Varied("stiffness of the shaft, N m/rad", "driveline__shaft_stiffness", 1.0, (150, 400, 1000, 4000, 20000)),
        Varied("damping of the shaft, N m s/rad", "driveline__shaft_damping", 1.0, (0.01, 0.1, 0.9, 1.8, 2.7)),
        Varied("stiffness of a coupling, N m/rad", "driveline__coupling_stiffness", 1.0, (50, 150, 500, 2000, 10000)),
        Varied("bandwidth of the control, Hz", "driveline__control_bandwidth_hz", 1.0, (0.3, 1.5, 15.0, 40.0)),
        Varied("torque ripple of order 6, N m", "driveline__drive_ripple", 1.0, (0.5, 5.0, 30.0)),
    ),
    "load": (
        Varied("speed, rpm", SPEED, 1.0, (80, 200, 600, 2000, 3000)),
        Varied("load, share", LOAD, 1.0, (0.0, 0.1, 0.5, 0.95, 1.2)),
        Varied("scatter of the end of delivery, deg", "scatter__end_angle", DEGREE, (0.0, 0.3, 1.0, 2.0)),
        Varied("feed pressure, bar", "chamber__feed_pressure", BAR, (0.5, 5.0, 12.0, 30.0)),
        Varied("dead volume, mm^3", "chamber__dead_volume", 1e-9, (800, 3000, 12000, 30000)),
        Varied("leakage, 1e-14 m^3/(s Pa)", "chamber__leak", 1e-14, (0.1, 5.0, 20.0, 80.0)),
        Varied("revolutions", CYCLES, 1.0, (4, 8, 60)),
    ),
    "transducers": (
        Varied("torque: low-pass, Hz", "torque_sensor__cutoff_hz", 1.0, (50, 100, 300, 1000, 3000)),
        Varied("torque: delay beyond the sheet's, %", "torque_sensor__delay_error", 0.01, (0, 5, 20, 40)),
        Varied("torque: gain beyond the certificate's, %", "torque_sensor__gain_error", 0.01, (0, 0.3, 1, 3)),
        Varied("torque: zero beside the standstill's, N m", "torque_sensor__zero_residual", 1.0, (0, 0.2, 0.8, 3)),
        Varied("torque: noise, N m", "torque_sensor__noise", 1.0, (0.02, 0.5, 2.0, 8.0)),
        Varied("torque: hysteresis, N m", "torque_sensor__hysteresis", 1.0, (0.05, 0.15, 0.5, 1.0, 1.5)),
        Varied(
            "torque: crosstalk of bending, 1e-6 m", "torque_sensor__bending_crosstalk", 1e-6, (100, 300, 1000, 3000)
        ),
        Varied("pressure: gain beyond the certificate's, %", "pressure_sensor__gain_error", 0.01, (0, 0.3, 1, 3)),
        Varied("pressure: delay, as declared, us", "pressure_sensor__delay", 1e-6, (4, 60, 200, 1000)),
        Varied("pressure: noise, bar", "pressure_sensor__noise", BAR, (0.1, 2.0, 8.0, 30.0)),
        Varied("trigger: mounted beside its angle, deg", "trigger__angle_offset", DEGREE, (0, 1.4, 3.0, 6.0)),
        Varied("trigger: switches later than the sheet's, us", "trigger__delay_error", 1e-6, (0, 10, 40, 80, 150)),
        Varied("trigger: jitter, us", "trigger__jitter", 1e-6, (0.3, 10, 30, 100)),
    ),
}
"""What is varied, by the part of the bench that it belongs to."""


def one_run(varied: Varied, level: float, end: str) -> Outcome:
    """Return what `camtorque run` says of one bench with one property at one level."""
    truth = change(as_declared(FAMILIES[end](np.random.default_rng(5000))), name="bench")
    running = {**USUAL, CYCLES: 20}
    if varied.path in running:
        running[varied.path] = level
    else:
        truth = change(truth, **{varied.path: level * varied.per_unit})
    sensor = truth.torque_sensor
    truth = change(truth, torque_sensor__delay=ELECTRONICS + sensor.damping / (np.pi * sensor.cutoff_hz))
    run = simulate(truth, running[SPEED], running[LOAD], n_cycles=int(running[CYCLES]), seed=1, step=1e-5)
    return outcome_of(run, running[LOAD], end, ("tdms", "single"), 1)


def verdict(found: Outcome) -> str:
    """Return whether an outcome is right, told not to be, or wrong."""
    right = bool(found.rows) and covers(*found.rows["trigger_offset"]) and found.chamber_inside >= INSIDE
    return "right" if right else "wrong" if found.status == "good" else "told"


def worst(cell: Sequence[Outcome]) -> str:
    """Return the verdict of a cell."""
    found = {verdict(outcome) for outcome in cell}
    return next(name for name in ("wrong", "told", "right") if name in found)


def words(cell: Sequence[Outcome]) -> str:
    """Return the trigger's errors and the chamber's largest rms of a cell, or that it was refused."""
    errors = [f"{outcome.trigger_error:+.2f}" if outcome.rows else "refused" for outcome in cell]
    return f"{' '.join(errors)} / {max((o.chamber_rms for o in cell if o.rows), default=np.nan):.1f}"


Cells = dict[tuple[Varied, float], list[Outcome]]


def table(cells: Cells) -> str:
    """Return a line a property."""
    lines = ["| property | level: verdict (trigger off, deg, by a land and by spill / chamber rms, %) |", "|---|---|"]
    for varied in dict.fromkeys(varied for varied, _ in cells):
        told = [f"{level:g}: **{worst(cells[varied, level])}** ({words(cells[varied, level])})"
                for level in varied.levels]  # fmt: skip
        lines.append(f"| {varied.label} | {'; '.join(told)} |")
    counted = [worst(cell) for cell in cells.values()]
    sums = ", ".join(f"{counted.count(name)} {name}" for name in COLOURS)
    refusals = sorted({o.status for cell in cells.values() for o in cell if not o.rows})
    return "\n".join([*lines, "", f"{len(counted)} cells: {sums}.", *(f"- {text}" for text in refusals)]) + "\n"


def draw(cells: Cells, path: Path) -> None:
    """Draw a row a property, a box a level."""
    rows = list(dict.fromkeys(varied for varied, _ in cells))
    figure, axes = plt.subplots(figsize=(10.0, 0.34 * len(rows) + 0.8))
    for row, varied in enumerate(rows):
        for column, level in enumerate(varied.levels):
            cell = cells[varied, level]
            axes.add_patch(plt.Rectangle((column, row), 0.96, 0.9, color=COLOURS[worst(cell)]))
            axes.text(column + 0.48, row + 0.3, f"{level:g}", ha="center", va="center", fontsize=8, weight="bold")
            axes.text(column + 0.48, row + 0.68, words(cell), ha="center", va="center", fontsize=6)
    axes.set_xlim(0.0, 5.0)
    axes.set_ylim(len(rows), 0.0)
    axes.set_yticks([row + 0.45 for row in range(len(rows))], [varied.label for varied in rows], fontsize=8)
    axes.set_xticks([])
    axes.set_title("level; trigger off by land and by spill [deg] / chamber rms [%]", fontsize=8)
    handles = [plt.Rectangle((0, 0), 1, 1, color=colour) for colour in COLOURS.values()]
    axes.legend(handles, COLOURS, ncol=3, loc="upper center", bbox_to_anchor=(0.5, -0.005), fontsize=8, frameon=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    figure.tight_layout()
    mpl.rcParams["svg.fonttype"] = "none"
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def main() -> None:
    """Run all cells, print or write the table, draw the map."""
    parser = bench_parser(__doc__)
    parser.add_argument("--parts", nargs="+", default=list(VARIED), choices=list(VARIED))
    parser.add_argument("--chart", type=Path)
    arguments = parser.parse_args()
    jobs = [(varied, level, end) for part in arguments.parts for varied in VARIED[part] for level in varied.levels
            for end in ENDS]  # fmt: skip
    cells: Cells = {}
    for (varied, level, end), outcome in outcomes(lambda job: one_run(*job), jobs, arguments.workers):
        cells.setdefault((varied, level), []).append(outcome)
        print(varied.label, level, end, verdict(outcome), outcome.status, words([outcome]), flush=True)
    tell(table(cells), arguments.write)
    if arguments.chart:
        draw(cells, arguments.chart)


if __name__ == "__main__":
    main()

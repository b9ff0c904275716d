"""Cost of the rigid solution per sample, as ratios to a plain copy, all in one run; writes a table and a chart.

    python benchmarks/mechanism_speed.py [--quick] [--out docs]

The yardstick is a compiled copy that reads one array and writes eight (one thread, preallocated, warm), since eight
outputs have to be written whatever computes them. Candidates are timed in turn, round by round; the least time of each
is compared.
"""

from __future__ import annotations

import argparse
import importlib.util
import platform
import sys
import time
from functools import partial
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numba import njit

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "mechanism"))
from camtorque.mechanism.elastic import solve_elastic
from camtorque.mechanism.mounting import Mounting, PumpUnit
from camtorque.mechanism.shaft import METHODS, solve_shaft
from camtorque.mechanism.torque import closed_form_tables
from engine_cases import ENGINES, Sample
from mechanism_cases import analytic_law, paper_pump
from mechanism_pass import cycle_rows, evaluate_cycles

MODULES = {"pinocchio": "pinocchio", "mujoco": "mujoco"}
PUMP_COUNTS = (1, 2, 4, 8, 16, 32, 64)
MOST_PUMPS = {"denoc": 16}
"""Left out beyond: dense shaft matrices of 64 lobes take seconds."""


@njit(cache=True)
def copy_one_to_eight(source, target):
    for cycle in range(source.shape[0]):
        row = source[cycle]
        a, b, c, d = target[0, cycle], target[1, cycle], target[2, cycle], target[3, cycle]
        e, f, g, h = target[4, cycle], target[5, cycle], target[6, cycle], target[7, cycle]
        for i in range(source.shape[1]):
            value = row[i]
            a[i] = value
            b[i] = value
            c[i] = value
            d[i] = value
            e[i] = value
            f[i] = value
            g[i] = value
            h[i] = value


def numpy_tables(tables, pressure, speed, out):
    names = ("torque", "contact_normal", "contact_tangential", "bearing_x", "bearing_y", "guide", "guide_moment")
    for row, name in enumerate(names):
        out[row] = tables.evaluate(name, pressure, speed[:, None])
    out[7] = tables.hertz_factor * np.sqrt(np.maximum(out[1], 0.0))


def per_method(method, units, theta, pressure, speed):
    for row, value in zip(pressure, speed, strict=True):
        solve_shaft(units, theta, row, value, method=method)


def engine_loop(engine, samples, mounting, pump):
    solver = ENGINES[engine](pump, mounting)

    def run():
        for sample in samples:
            solver.solve(sample, mounting)

    return run


def pinocchio_batch(pump, mounting, count):
    """Inverse dynamics alone, compiled loop over samples, one thread."""
    solver = ENGINES["pinocchio"](pump, mounting)
    pool = solver.pin.ModelPool(solver.model, 1)
    position, rate, change = np.random.default_rng(1).random((3, 3, count))
    out = np.zeros((3, count))
    return lambda: solver.pin.rneaInParallel(1, pool, position, rate, change, out)


def mujoco_inverse(pump, mounting, count):
    """Inverse dynamics alone, called from Python."""
    solver = ENGINES["mujoco"](pump, mounting)

    def run():
        for _ in range(count):
            solver.mujoco.mj_inverse(solver.model, solver.data)

    return run


ALONE = {
    "pinocchio": (pinocchio_batch, "pinocchio, rnea alone, compiled batch"),
    "mujoco": (mujoco_inverse, "mujoco, mj_inverse alone, from Python"),
}


def candidates(cycles, size):
    """Return name -> (function, samples per call)."""
    random = np.random.default_rng(0)
    theta = np.arange(size) * (2.0 * np.pi / size)
    pressure = random.uniform(0.0, 6e7, (cycles, size))
    speed = random.uniform(30.0, 120.0, cycles)
    pump, law, mounting = paper_pump(follower_offset=2e-3), analytic_law(), Mounting(guide_height=0.06)
    tables = closed_form_tables(pump, law, theta, mounting)
    rows, constants = cycle_rows(tables), tables.constants
    out = np.zeros((8, cycles, size))
    units = [PumpUnit(pump, law, mounting=mounting)]
    few = 2
    found = {
        "copy, 1 array to 8": (lambda: copy_one_to_eight(pressure, out), cycles * size),
        "closed form, compiled, all 8": (
            lambda: evaluate_cycles(rows, constants, pressure, speed, out),
            cycles * size,
        ),
        "closed form, numpy, all 8": (lambda: numpy_tables(tables, pressure, speed, out), cycles * size),
    }
    for method in METHODS:
        found[f"{method}, kinematics included, one cycle"] = (
            partial(per_method, method, units, theta, pressure[:few], speed[:few]),
            few * size,
        )
    angles = theta[:: max(1, size // 300)]
    samples = [Sample(pump, law, mounting, angle, 3e7, 50.0, 0.0) for angle in angles]
    for engine in ENGINES:
        if importlib.util.find_spec(MODULES[engine]) is not None:
            found[f"{engine}, with reactions, from Python"] = (
                engine_loop(engine, samples, mounting, pump),
                len(samples),
            )
            alone, name = ALONE[engine]
            found[name] = (alone(pump, mounting, size), size)
    return found


def time_all(found, rounds):
    """Return name -> ns per sample of every round; the candidates take turns so that the machine's mood hits all."""
    for function, _ in found.values():
        function()
    times: dict[str, list[float]] = {name: [] for name in found}
    for _ in range(rounds):
        for name, (function, count) in found.items():
            start = time.perf_counter()
            function()
            times[name].append(1e9 * (time.perf_counter() - start) / count)
    return {name: np.array(values) for name, values in times.items()}


def elastic(units, theta):
    """Solve with torsional springs; their stiffness grows with the number so that the whole shaft stays as stiff."""
    count = len(units)
    load = np.full((count, theta.size), 3e6)
    solve_elastic(units, load, 50.0, np.full(count, 1e5 * count), np.full(count, 2.0 * count))


def cost_of_pumps(size, rounds):
    """Return method -> us per shaft solution for each number of pumps."""
    law, theta = analytic_law(), np.arange(size) * (2.0 * np.pi / size)
    pressure = np.full(size, 3e7)
    cost: dict[str, list[float]] = {method: [] for method in (*METHODS, "elastic shaft")}
    for count in PUMP_COUNTS:
        units = [PumpUnit(paper_pump(), law, 2.0 * np.pi * k / count) for k in range(count)]
        for method, values in cost.items():
            if count > MOST_PUMPS.get(method, PUMP_COUNTS[-1]):
                continue
            best = []
            for _ in range(rounds):
                start = time.perf_counter()
                if method == "elastic shaft":
                    elastic(units, theta)
                else:
                    solve_shaft(units, theta, pressure, 50.0, method=method)
                best.append(1e6 * (time.perf_counter() - start))
            values.append(min(best))
    return cost


def table(times, cost, size):
    """Return the page as Markdown."""
    floor = times["copy, 1 array to 8"]
    lines = [
        "| candidate | ns per sample, least of the rounds (median) | ratio of the least to that of the copy |",
        "|---|---|---|",
    ]
    for name, values in times.items():
        ratio = values.min() / floor.min()
        lines.append(f"| {name} | {values.min():.3g} ({np.median(values):.3g}) | {ratio:.3g} |")
    lines += [
        "",
        f"Pumps on one rigid shaft, us per solution of {size} angles (least of the rounds), and per pump:",
        "",
    ]
    lines += ["| pumps | " + " | ".join(cost) + " |", "|---" * (len(cost) + 1) + "|"]
    for i, count in enumerate(PUMP_COUNTS):
        cells = [f"{v[i]:.0f} ({v[i] / count:.0f})" if i < len(v) else "-" for v in cost.values()]
        lines.append(f"| {count} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def chart(times, cost, path):
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.8), constrained_layout=True)
    floor = times["copy, 1 array to 8"]
    names = list(times)[::-1]
    left.barh(names, [times[name].min() / floor.min() for name in names], color="tab:blue")
    left.set_xscale("log")
    left.set_xlabel("time per sample / copy of 1 array to 8")
    left.axvline(1.1, color="tab:red", lw=1.0)
    for method, values in cost.items():
        right.loglog(PUMP_COUNTS[: len(values)], values, "o-", label=method)
    right.set_xlabel("pumps on one shaft")
    right.set_ylabel("time of a solution [us]")
    right.legend()
    figure.savefig(path, dpi=90)


PAGE = """# Speed of the mechanism

Remade by `python benchmarks/mechanism_speed.py --out docs`: one run, one thread, candidates in turn. {cycles} cycles of
{size} angles, each with its own pressure and speed; all eight outputs (torque, contact normal and tangential, bearing x
and y, guide force and moment, Hertz stress). {machine}.

{table}

![cost](mechanism_speed.png)

- The compiled closed form is bound by memory: it writes what the copy writes. The target is 1.1 times the copy.
  No command takes that pass (`benchmarks/mechanism_pass.py`): they solve the closed form with its kinematics included.
- "Kinematics included, one cycle" is a call of `solve_shaft` from the lift law on, with its checks, eleven outputs and
  fresh memory for them; the target is 15 times the copy.
- Recursion, closed form and elastic shaft (fixed-point iteration to 1e-12, whole-shaft stiffness kept) grow in
  proportion to the number of pumps. The matrices of `denoc` also grow with the square of it; they are there to be read,
  not to be fast.
- Pinocchio and MuJoCo get motion and contact point prepared beforehand and give no Hertz stress. "From Python" is the
  whole cut-joint solution as a Python user writes it; "alone" is their inverse dynamics only, without the contact, the
  multipliers and the reactions.
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer cycles and rounds")
    parser.add_argument("--out", type=Path, help="folder for mechanism_speed.md and .png")
    options = parser.parse_args()
    cycles, rounds, size = (50, 3, 3600) if options.quick else (1000, 9, 3600)
    times = time_all(candidates(cycles, size), rounds)
    cost = cost_of_pumps(720, 5)
    text = table(times, cost, 720)
    print(text)
    if options.out is not None:
        machine = f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}"
        page = PAGE.format(cycles=cycles, size=size, machine=machine, table=text)
        (options.out / "mechanism_speed.md").write_text(page)
        chart(times, cost, options.out / "mechanism_speed.png")


if __name__ == "__main__":
    main()

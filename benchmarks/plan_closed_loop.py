"""`camtorque plan` in closed loop on a simulated rig against a factorial plan: runs until a number is known.

    python benchmarks/plan_closed_loop.py OUT.csv [--family closed_volume] [--seed 5] [--target bulk_modulus]

Both start with the same two recordings. One plan makes the run that `plan` proposes first, fits all together and asks
again; the other makes the corners of speed and load in turn. Each stops when the standard error of the number is the
wanted share of what it was. A line per run: standard error, and whether the truth lies inside the 95 % interval.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from benches import plain_parser, rig_of, write_rows
from camtorque.fit import Prepared, joint_input, prepare
from camtorque.fit.ends import Curve
from camtorque.fit.forecast import FittedAt, KnownFit
from camtorque.fit.joint import joint_fit_of, solve_joint
from camtorque.fit.planning import plan, point_of
from camtorque.plan import SPEED_FACTORS
from camtorque.predict_from import chain_of
from camtorque.units import RPM
from compare_twins import compared_side, recorded
from rigs.families import FAMILIES
from rigs.truth import RigTruth

MIDDLE, LOADS = 700.0, (0.6, 0.8)
START = ((0.9, 0.6), (1.1, 0.8))
"""Share of the middle speed, and load, of the recordings that both plans start with."""
CORNERS = ((0.7, 0.6), (1.45, 0.8), (0.7, 0.8), (1.45, 0.6))
MOST = 4
DURATION = 4.0
"""What the simulated runs last [s]."""
TRUE = {
    "bulk_modulus": lambda truth: truth.fluid.modulus, "dead_volume": lambda truth: truth.chamber.dead_volume,
    "leakage": lambda truth: truth.chamber.leak, "feed_pressure": lambda truth: truth.chamber.feed_pressure,
}  # fmt: skip


@dataclass
class Bench:
    """A simulated rig and the recordings made on it."""

    truth: RigTruth
    seed: int
    made: list[tuple[Prepared, float]] = field(default_factory=list)

    def record(self, share: float, load: float) -> None:
        """Make a recording at a share of the middle speed and a load."""
        number = len(self.made)
        run = recorded(self.truth, MIDDLE * share, load, 100 * self.seed + number + int(1000 * share * load))
        side = compared_side(run, run, f"run{number}")
        self.made.append((prepare(side.recording, side.cycles, side.rigid), load))

    def fitted(self) -> KnownFit:
        """Return the joint fit of all recordings."""
        inputs = [joint_input(item) for item, _ in self.made]
        problem, solution = solve_joint(inputs)
        fit = joint_fit_of(inputs, problem, solution)
        recordings = tuple(
            FittedAt(item.data.name, item.cycles.mean_speed, data.structure, 0.002, False)
            for (item, _), data in zip(self.made, problem.data, strict=True)
        )
        return KnownFit(tuple(slot.name for slot in problem.slots), solution.z, fit.covariance.matrix, recordings)


def proposed(bench: Bench, known: KnownFit, target: str, wanted: float) -> tuple[float, float] | None:
    """Return share of the middle speed and load of the run that `plan` proposes first, None where it proposes none."""
    points, loads = [], {}
    for item, load in bench.made[:2]:
        curve = Curve(item.cycles.theta, item.means.pressure_all, item.cycles.mean_speed)
        source = next(one for one in known.recordings if one.id == item.data.name)
        scatter = float(np.sqrt(np.mean(item.means.torque_std**2)))
        loads[source.id] = load
        for share in SPEED_FACTORS:
            points.append(
                point_of(known, chain_of(rig_of(item), MIDDLE * share * RPM, curve), source, source.id, scatter)
            )
    gradient = np.eye(len(known.names))[known.names.index(target)]
    steps = [step for step in plan(known, gradient, wanted, points, (DURATION,)) if not step.offer.tooth]
    if not steps:
        return None
    offer = steps[0].offer
    return offer.speed / RPM / MIDDLE, loads[offer.load]


def rows_of(name: str, bench: Bench, target: str, factor: float) -> Iterator[dict[str, object]]:
    """Make one plan's runs until the number is known as wanted, a row after each."""
    wanted, corners = 0.0, list(CORNERS)
    for made in range(MOST + 1):
        known = bench.fitted()
        k = known.names.index(target)
        std, true = float(np.sqrt(known.covariance[k, k])), float(TRUE[target](bench.truth))
        wanted = wanted or factor * std
        last = bench.made[-1]
        yield {
            "plan": name, "runs": made, "rpm": round(last[0].cycles.mean_speed / RPM), "load": last[1],
            "stderr": std, "wanted": wanted, "error": float(known.values[k]) - true,
            "inside": abs(known.values[k] - true) < 1.96 * std,
        }  # fmt: skip
        if std <= wanted:
            return
        point = proposed(bench, known, target, wanted) if name == "plan" else corners[made % len(corners)]
        if point is None:
            return
        bench.record(*point)


def closed_loop(truth: RigTruth, seed: int, target: str, factor: float) -> Sequence[dict[str, object]]:
    """Return the rows of both plans."""
    start = Bench(truth, seed)
    for share, load in START:
        start.record(share, load)
    rows = []
    for name in ("plan", "factorial"):
        for row in rows_of(name, Bench(truth, seed, list(start.made)), target, factor):
            rows.append(row)
            print(row, flush=True)
    return rows


def main() -> None:
    """Write one line per run."""
    parser = plain_parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--family", default="closed_volume")
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--target", default="bulk_modulus", choices=sorted(TRUE))
    parser.add_argument("--factor", type=float, default=0.6)
    chosen = parser.parse_args()
    truth = FAMILIES[chosen.family](np.random.default_rng(chosen.seed))
    rows = closed_loop(truth, chosen.seed, chosen.target, chosen.factor)
    write_rows(chosen.out, rows)


if __name__ == "__main__":
    main()

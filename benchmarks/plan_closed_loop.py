"""`camtorque plan` in closed loop on simulated rigs against a factorial plan over speed and load.

    python benchmarks/plan_closed_loop.py OUT.csv [--rig closed_volume:5 soft_driveline:7] [--target leakage ...]

Both start with the same two recordings and choose from the same speeds and loads; every run lasts the same and costs
one setting of the bench. The plan makes the run that `plan` proposes first (no second tooth), fits all together and
asks again. The factorial plan makes the four corners; as their order is nobody's choice, its numbers are means over
all 24. Wanted is what all four corners reach. A line per number and count of runs: standard error as a share of that
of the two recordings, and whether the truth lies inside the 95 % interval.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from benches import plain_parser, rig_of, write_rows
from camtorque.finished_fit import chain_of
from camtorque.fit.joint import joint_fit_of, solve_joint
from camtorque.fit.joint_input import JointInput, joint_input
from camtorque.fit.known_ends import Curve
from camtorque.fit.known_fit import FittedAt, KnownFit, drawn_about
from camtorque.fit.planning import Measuring, Offer, TargetQuantity, operating_point, plan
from camtorque.fit.single import FittedParameters, Prepared, prepare
from camtorque.plan import SPEED_FACTORS
from camtorque.units import RPM
from compare_twins import compared_side, recorded
from rigs.families import FAMILIES
from rigs.truth import RigTruth

Run = tuple[float, float]
"""Speed as a share of the middle one, and load."""
Runs = tuple[Run, ...]
MIDDLE, LOADS = 700.0, (0.6, 0.8)
START: Runs = ((0.9, 0.6), (1.1, 0.8))
CORNERS: Runs = ((0.7, 0.6), (0.7, 0.8), (1.45, 0.6), (1.45, 0.8))
DURATION = 4.0
"""What the simulated runs last [s]."""
AS_GOOD = 1.05
"""Standard error, as a multiple of that of the whole factorial, that counts as reached."""
TRUE = {
    "leakage": lambda truth: truth.chamber.leak, "feed_pressure": lambda truth: truth.chamber.feed_pressure,
    "trigger_offset": lambda truth: truth.trigger.angle_offset,
    "shaft_viscous": lambda truth: truth.friction.shaft_viscous,
    "bulk_modulus": lambda truth: truth.fluid.modulus, "dead_volume": lambda truth: truth.chamber.dead_volume,
}  # fmt: skip
TARGETS = ("leakage", "feed_pressure", "trigger_offset", "shaft_viscous")


@dataclass
class Bench:
    """A simulated rig; every run and every joint fit is made once."""

    truth: RigTruth
    seed: int
    made: dict[tuple[Run, int], tuple[Prepared, JointInput]] = field(default_factory=dict)
    fits: dict[Runs, tuple[KnownFit, FittedParameters]] = field(default_factory=dict)

    def recorded(self, run: Run, repeat: int) -> tuple[Prepared, JointInput]:
        """Return a recording; one that is made again has its own noise."""
        if (run, repeat) not in self.made:
            share, load = run
            seed = 10000 * self.seed + int(1000 * share) + int(100 * load) + 7 * repeat
            simulated = recorded(self.truth, MIDDLE * share, load, seed)
            side = compared_side(simulated, simulated, f"run_{share}_{load}_{repeat}")
            prepared = prepare(side.recording, side.cycles, side.rigid)
            self.made[run, repeat] = prepared, joint_input(prepared)
        return self.made[run, repeat]

    def fitted(self, added: Runs) -> tuple[KnownFit, FittedParameters]:
        """Return the joint fit of the first two and some added recordings, and what it states of the first."""
        key = tuple(sorted(added))
        if key not in self.fits:
            runs = (*START, *key)
            pairs = [self.recorded(run, runs[:k].count(run)) for k, run in enumerate(runs)]
            inputs = [item for _, item in pairs]
            problem, solution = solve_joint(inputs)
            fit = joint_fit_of(inputs, problem, solution)
            recordings = tuple(
                FittedAt(one.recording.config.id, one.cycles.mean_speed, data.structure, 0.002, False)
                for (one, _), data in zip(pairs, problem.data, strict=True)
            )
            names = problem.names
            known = KnownFit(names, solution.z, fit.covariance.arrow, recordings)
            self.fits[key] = known, fit.recording(0)
        return self.fits[key]

    def known(self, added: Runs, target: str) -> tuple[float, bool]:
        """Return the standard error of a number [SI], and whether its 95 % interval holds the truth."""
        _, stated = self.fitted(added)
        k = stated.problem.names.index(target)
        std = float(stated.std[k])
        return std, bool(abs(stated.solution.z[k] - TRUE[target](self.truth)) < 1.96 * std)


def proposed(bench: Bench, added: Runs, target: str) -> Run | None:
    """Return the run that `plan` proposes first, None where it proposes none."""
    known, points, fitted, loads = bench.fitted(added)[0], [], [], {}
    number = TargetQuantity(np.eye(len(known.names))[known.names.index(target)], within=known.within)
    drawn = tuple(drawn_about(known, number.deviation(known.matrix)))
    for run in START:
        item, _ = bench.recorded(run, 0)
        curve = Curve(item.cycles.theta, item.means.pressure_all, item.cycles.mean_speed)
        source = next(one for one in known.recordings if one.id == item.recording.config.id)
        assert item.cycles.torque is not None
        scatter = float(np.sqrt(np.mean(np.var(item.cycles.torque, axis=0, ddof=1))))
        own = {
            name: row.prior[1] for name, row in item.candidates[0].data.rows.items() if row.role == "own" and row.prior
        }
        loads[source.id] = run[1]
        basis, measuring = item.candidates[0].data.lift_basis, Measuring(scatter, own)
        made, *chains = (
            chain_of(rig_of(item), speed, curve, source.structure)
            for speed in (item.cycles.mean_speed, *(MIDDLE * share * RPM for share in SPEED_FACTORS))
        )
        fitted.append(Offer(operating_point(known, made, source, source.id, measuring, basis), DURATION, False))
        points += [operating_point(known, at, source, source.id, measuring, basis, drawn) for at in chains]
    steps = plan(known, number, 0.0, points, (DURATION,), (False,), fitted)
    if not steps:
        return None
    offer = steps[0].offer
    return round(offer.point.speed / RPM / MIDDLE, 3), loads[offer.point.load]


def planned(bench: Bench, target: str) -> Runs:
    """Return the runs that the plan makes one after the other, as many as the factorial at most."""
    added: Runs = ()
    while len(added) < len(CORNERS):
        run = proposed(bench, added, target)
        if run is None:
            break
        added = (*added, run)
    return added


def rows_of(bench: Bench, rig: str, target: str) -> list[dict[str, object]]:
    """Return what plan and factorial know of a number after each run."""
    first, _ = bench.known((), target)
    chosen = planned(bench, target)
    rows = []
    for count in range(1, len(CORNERS) + 1):
        sets = list(itertools.combinations(CORNERS, count))
        corner = [bench.known(part, target) for part in sets]
        row: dict[str, object] = {
            "rig": rig, "number": target, "runs": count,
            "factorial": round(float(np.mean([std for std, _ in corner])) / first, 3),
            "factorial_best": round(min(std for std, _ in corner) / first, 3),
            "factorial_inside": f"{sum(inside for _, inside in corner)}/{len(corner)}",
            "plan": None, "plan_inside": None, "rpm": None, "load": None,
        }  # fmt: skip
        if count <= len(chosen):
            std, inside = bench.known(chosen[:count], target)
            share, load = chosen[count - 1]
            row |= {"plan": round(std / first, 3), "plan_inside": inside, "rpm": round(MIDDLE * share), "load": load}
        rows.append(row)
        print(row, flush=True)
    return rows


def runs_to_target(bench: Bench, target: str) -> Mapping[str, object]:
    """Return after how many runs each knows the number as well as the whole factorial, one that never does: none."""
    wanted = AS_GOOD * bench.known(CORNERS, target)[0]

    def first(order: Sequence[Run]) -> int | None:
        counts = range(len(order) + 1)
        return next((k for k in counts if bench.known(tuple(order[:k]), target)[0] <= wanted), None)

    corners = [first(order) for order in itertools.permutations(CORNERS)]
    known = [k for k in corners if k is not None]
    return {"number": target, "plan": first(planned(bench, target)), "factorial": round(float(np.mean(known)), 2),
            "factorial_least": min(known)}  # fmt: skip


def main() -> None:
    """Write a line per number and count of runs, print after how many runs each is as good as the whole factorial."""
    parser = plain_parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rig", nargs="+", default=["closed_volume:5", "soft_driveline:7"], help="FAMILY:SEED")
    parser.add_argument("--target", nargs="+", default=TARGETS, choices=sorted(TRUE))
    chosen = parser.parse_args()
    rows: list[dict[str, object]] = []
    for rig in chosen.rig:
        family, seed = rig.split(":")
        bench = Bench(FAMILIES[family](np.random.default_rng(int(seed))), int(seed))
        for target in chosen.target:
            rows += rows_of(bench, rig, target)
            print(rig, runs_to_target(bench, target), flush=True)
        write_rows(chosen.out, rows)


if __name__ == "__main__":
    main()

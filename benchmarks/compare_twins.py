"""Comparisons on simulated twins: detection of known changes, false alarms, and "not changed" said of a real change.

    python benchmarks/compare_twins.py OUT.csv [--rigs 6] [--first 0] [--family closed_volume ...] [--change clear1 ...]

Each rig is recorded before, twice again, and after known changes; every recording has its own noise, speed, load and
zero drift. One line per comparison; the table at the end counts them by the end of delivery. ``said_not_changed`` names
what was told as not changed although its true change is above the smallest one that was stated.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from benches import plain_parser, write_rows
from camtorque.compare import compare_prepared
from camtorque.fit.prepare import mean_cycles
from camtorque.fit.single import Prepared, prepare
from camtorque.fit.valleys import NO_VALLEY
from camtorque.laws import ROWS
from camtorque.mechanism.lift_laws import lift_law
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.solve import solve_rigid
from rig_bridge import cycles_of, recording_of
from rigs.families import FAMILIES
from rigs.rig import RigRun, simulate
from rigs.truth import DEGREE, RigTruth, change

CYCLES = 40
FRICTION = ("bearing_arm", "pin_arm", "guide_friction", "shaft_drag", "shaft_viscous", "plunger_viscous", "friction",
            "damping", "packing_force", "packing_friction")  # fmt: skip
EXPECTED: dict[str, tuple[str, ...]] = {
    "again1": (), "again2": (), "clear05": ("leakage",), "clear1": ("leakage",), "clear2": ("leakage",),
    "preload": ("spring_preload_error", "spring"),
    "trigger": ("trigger_offset",), "friction": FRICTION,
    "warm": ("leakage", "bulk_modulus", "shaft_viscous", "plunger_viscous", "damping", "friction"),
    "rate": ("spring_stiffness_error", "spring"),
}  # fmt: skip
"""Change -> names of which one has to be told."""
CLEARANCE = 4.0
WIDER = {"clear05": 0.5, "clear1": 1.0, "clear2": 2.0}
"""Clearance before, and change -> by how much it grows [um]."""
LEAST_LEAK = 5e-15
OTHER_SPRING = {"preload": ("spring_preload", -6.0), "rate": ("spring_stiffness", -6.0)}
"""Change -> what of the spring it is of, and how large it is [%]."""


def changed(truth: RigTruth, kind: str) -> RigTruth:
    """Return a rig after a known change."""
    friction, chamber = truth.friction, truth.chamber
    if kind in WIDER:
        return change(truth, chamber__leak=chamber.leak * (1.0 + WIDER[kind] / CLEARANCE) ** 3)
    if kind in OTHER_SPRING:
        name, percent = OTHER_SPRING[kind]
        return change(truth, **{f"pump__{name}": (1.0 + 0.01 * percent) * getattr(truth.pump, name)})
    if kind == "trigger":
        return change(truth, trigger__angle_offset=truth.trigger.angle_offset + 0.3 * DEGREE)
    if kind == "friction":
        names = ("bearing_mu", "bearing_mu_static", "pin_mu", "guide_mu", "seal_force", "drag_torque")
        return change(truth, **{f"friction__{name}": 1.25 * getattr(friction, name) for name in names})
    if kind == "warm":
        thin = {"plunger_viscous": 0.88 * friction.plunger_viscous, "shaft_viscous": 0.88 * friction.shaft_viscous}
        return change(truth, chamber__leak=chamber.leak / 0.88, fluid__modulus=0.98 * truth.fluid.modulus,
                      **{f"friction__{name}": value for name, value in thin.items()})  # fmt: skip
    return truth


def recorded(truth: RigTruth, speed: float, load: float, seed: int) -> RigRun:
    """Return a run with its own noise, set speed, load and zero drift."""
    rng = np.random.default_rng(seed)
    drift = truth.torque_sensor.zero_residual + 0.03 * rng.standard_normal()
    moved = change(truth, torque_sensor__zero_residual=drift)
    return simulate(moved, speed * (1.0 + 0.001 * rng.standard_normal()), load * (1.0 + 0.01 * rng.standard_normal()),
                    CYCLES, seed, step=1e-5, record_deg=0.15)  # fmt: skip


def compared_side(run: RigRun, sheet: RigRun, kind: str) -> Prepared:
    """Return a run with its means; sheets and lift table are those of the first recording."""
    recording, cycles = recording_of(sheet, kind), cycles_of(run)
    config = recording.config
    rigid = solve_rigid(
        config.pump, lift_law(recording.cam_table), cycles.theta, np.mean(cycles.pressure, axis=0), cycles.mean_speed,
        mounting=Mounting(rotation=config.rotation),
    )  # fmt: skip
    return Prepared(recording, cycles, rigid, mean_cycles(cycles), (), NO_VALLEY, np.zeros(0))


def true_changes(kind: str, truth: RigTruth) -> dict[str, float]:
    """Return by how much those parameters really change whose size is known, in the units of the report."""
    leak = (changed(truth, kind).chamber.leak - truth.chamber.leak) / ROWS["leakage"].per_unit
    known = {"leakage": leak, "trigger_offset": 0.3}
    known |= {f"{name}_error": percent for name, percent in OTHER_SPRING.values()}
    return {name: known[name] for name in EXPECTED[kind] if name in known}


def judged(kind: str, told: set[str]) -> str:
    """Return the verdict on one comparison."""
    if not EXPECTED[kind]:
        return "false alarm" if told else "right"
    if not told & set(EXPECTED[kind]):
        return "missed" if not told else "misnamed"
    return "found"


def rig_rows(family: str, seed: int, kinds: Sequence[str]) -> list[dict[str, object]]:
    """Return the comparisons of one rig after some changes; which others are made does not alter a recording."""
    rng = np.random.default_rng(1000 + seed)
    truth = FAMILIES[family](rng)
    truth = change(truth, chamber__leak=max(truth.chamber.leak, LEAST_LEAK) * CLEARANCE / 3.0)
    speed, load = float(rng.uniform(450.0, 1100.0)), float(rng.uniform(0.55, 0.9))
    sheet = recorded(truth, speed, load, 10 * seed)
    side = compared_side(sheet, sheet, "before")
    start = time.perf_counter()
    before = prepare(side.recording, side.cycles, side.rigid)
    fitting = time.perf_counter() - start
    rows = []
    for place, kind in enumerate(EXPECTED):
        if kind not in kinds:
            continue
        start = time.perf_counter()
        after = compared_side(recorded(changed(truth, kind), speed, load, 10 * seed + place + 1), sheet, kind)
        found = compare_prepared(before, after)
        told = {row.name for row in (*found.parameters, *found.losses) if row.verdict == "changed"}
        true = true_changes(kind, truth)
        parameters = {row.name: row for row in found.parameters}
        wrong = [name for name, size in true.items() if (row := parameters.get(name)) is not None
                 and row.verdict == "not changed" and abs(size) > row.smallest_change]  # fmt: skip
        rows.append({
            "family": family, "end": truth.chamber.end, "seed": seed, "rpm": round(speed), "change": kind,
            "structure": before.candidates[0].data.structure,
            "result": judged(kind, told), "told": " ".join(sorted(told)), "events": "+".join(found.found.best),
            "probability": round(found.found.probabilities[0], 3), "inflation": round(found.found.inflation[1], 2),
            "said_not_changed": " ".join(wrong),
            "true_leakage": round(true.get("leakage", 0.0), 3),
            "smallest_leakage": round(parameters["leakage"].smallest_change, 3), "fit_s": round(fitting, 1),
            "compare_s": round(time.perf_counter() - start, 1),
        })  # fmt: skip
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Write one line per comparison and print the counts."""
    parser = plain_parser(__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, default=6)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--family", nargs="+", default=["closed_volume", "spill", "other_geometry", "soft_driveline"])
    parser.add_argument("--change", nargs="+", choices=EXPECTED, default=list(EXPECTED))
    chosen = parser.parse_args()
    rows: list[dict[str, object]] = []
    for seed in range(chosen.first, chosen.first + chosen.rigs):
        rows += rig_rows(chosen.family[seed % len(chosen.family)], seed, chosen.change)
        write_rows(chosen.out, rows)
    for end in sorted({str(row["end"]) for row in rows}):
        for kind in chosen.change:
            results = [row["result"] for row in rows if row["change"] == kind and row["end"] == end]
            print(f"{end:8}{kind:10}" + ", ".join(f"{results.count(name)} {name}" for name in dict.fromkeys(results)))


if __name__ == "__main__":
    main()

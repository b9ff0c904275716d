"""Do the stated intervals cover the truth? Simulated benches in, as files; what `camtorque run` states out.

The rigs (`tests/rigs`) are stepped in time by code that shares nothing with the package. Each is written as a bench
leaves it (format and loggers in turn), run with `camtorque run` and its defaults, and its `result.json` and
`cycles.h5` are held against the truth. Parameters at a bound count like all others. Families whose name starts with
``foreign`` obey a law that the fit lacks.

    python benchmarks/coverage.py --draws 2 --families closed_volume spill foreign_leak --write docs/coverage_figures.md
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from benches import as_declared, bench_parser, interval_table, outcomes, run_from_files, tell
from camtorque.report.verdict import verdict
from rigs.families import FAMILIES
from rigs.rig import RigRun, end_angle, lift_of, simulate
from rigs.truth import RigTruth, change

DEFAULT = (
    "closed_volume", "spill", "plain", "plain_spill", "other_geometry", "negative_rotation", "stiff_driveline",
    "soft_driveline", "foreign_valve_mass", "foreign_yielding_drive", "foreign_crosstalk", "foreign_hysteresis",
    "foreign_leak",
)  # fmt: skip
BENCHES = (("tdms", "single"), ("csv", "independent"), ("hdf5", "synchronised"))
LOADED_SHARE = 0.3
LEAK_PRESSURE = 500e5
CURVES = ("true_angle", "chamber_pressure", "chamber_pressure_std")
SIMULTANEOUS = 3.1
"""A band holds all of some 25 independent loaded angles at once with 95 % if none is this many std off."""


@dataclass(frozen=True)
class Outcome:
    """One rig: its family, what the command said, and what it stated against what is true."""

    family: str
    status: str
    seconds: float
    rows: dict[str, tuple[float, float, float, float]] = field(default_factory=dict)
    trigger_error: float = float("nan")
    held_out: float = float("nan")
    chamber_inside: float = float("nan")
    chamber_rms: float = float("nan")
    chamber_worst: float = float("nan")


def true_values(truth: RigTruth, load: float) -> dict[str, float]:
    """Return the true parameters in the units of the report, where the rig has the parameter."""
    line, chamber, fluid, rub = truth.driveline, truth.chamber, truth.fluid, truth.friction
    ends = end_angle(truth, load)
    values = {
        "trigger_offset": np.rad2deg(truth.trigger.angle_offset),
        "dead_volume": 1e9 * chamber.dead_volume, "bulk_modulus": fluid.modulus / 1e9,
        "bulk_modulus_slope": fluid.slope, "feed_pressure": chamber.feed_pressure / 1e5,
        "port_closing_lift": 1e3 * float(lift_of(truth, np.array([chamber.port_close_angle]))[0]),
        "leakage": 1e14 * chamber.leak * (1.0 + chamber.leak_growth * LEAK_PRESSURE) ** 3,
        "bearing_arm": 1e6 * rub.bearing_mu * rub.bearing_radius, "pin_arm": 1e6 * rub.pin_mu * rub.pin_radius,
        "guide_friction": rub.guide_mu * rub.guide_lever, "packing_force": rub.seal_force,
        "plunger_viscous": rub.plunger_viscous, "shaft_drag": rub.drag_torque, "shaft_viscous": rub.shaft_viscous,
        "spring_stiffness_error": 100.0 * truth.pump.spring_stiffness_error,
        "cam_side_inertia": 1e6 * (line.camshaft_inertia + truth.pump.cam_inertia),
        "drive_admittance": 1.0 / line.drive_inertia,
        "delay_error": 1e6 * truth.torque_sensor.delay_error * truth.torque_sensor.delay,
        "torque_zero": truth.torque_sensor.zero_residual,
        "pressure_zero": truth.pressure_sensor.zero_residual / 1e5,
        "gain_error": 100.0 * truth.torque_sensor.gain_error,
    }  # fmt: skip
    values["shaft_compliance"] = 1e6 / line.shaft_stiffness
    values["shaft_damping"] = line.shaft_damping
    if np.isfinite(line.coupling_stiffness):
        values["coupling_compliance"] = 1e6 / line.coupling_stiffness
    if chamber.end == "spill":
        values["spill_lift"] = 1e3 * float(lift_of(truth, np.array([ends]))[0])
    else:
        values["end_of_delivery"] = float(np.rad2deg(ends + chamber.close_width))
    return values


def one_rig(family: str, draw: int, cycles: int) -> Outcome:
    """Return what one rig shows."""
    rng = np.random.default_rng([4000 + draw, sorted(FAMILIES).index(family)])
    truth = change(as_declared(FAMILIES[family](rng)), name=f"{family}_{draw}")
    speed, load = float(rng.uniform(400.0, 1300.0)), float(rng.uniform(0.55, 0.95))
    run = simulate(truth, speed, load, n_cycles=cycles, seed=draw, step=1e-5)
    return outcome_of(run, load, family, BENCHES[draw % len(BENCHES)], draw)


def outcome_of(run: RigRun, load: float, family: str, bench: tuple[str, str], seed: int) -> Outcome:
    """Return what `camtorque run` makes of a run, written as a bench (format, loggers) leaves it."""
    with tempfile.TemporaryDirectory() as temporary:
        began = time.perf_counter()
        refused, result = run_from_files(run, Path(temporary), bench, seed)
        seconds = time.perf_counter() - began
        if refused:
            return Outcome(family, refused, seconds)
        with h5py.File(Path(temporary) / "out" / "cycles.h5") as file:
            curves = {name: file["model"][name][:] for name in CURVES if name in file["model"]}
    return compared(family, run, load, seconds, result, curves)


def compared(family: str, run: RigRun, load: float, seconds: float, result: dict, curves: dict) -> Outcome:
    """Return what a result states against the truth of its rig."""
    known = result["parameters"]
    rows = {}
    for name, true in true_values(run.truth, load).items():
        stated = known.get(name)
        if stated and stated["ci95"] and None not in stated["ci95"]:
            rows[name] = (true, stated["value"], *stated["ci95"])
    trigger = rows.get("trigger_offset", (np.nan, np.nan))
    values = {
        "trigger_error": trigger[1] - trigger[0],
        "held_out": result["metrics"]["fitted_held_out_cycles"]["rms_percent_of_peak"],
    }
    if "chamber_pressure" in curves:
        true = run.true_cycles("chamber_pressure", 3600).mean(axis=0)
        at = np.interp(curves["true_angle"], 2 * np.pi * np.arange(3600) / 3600, true, period=2 * np.pi)
        error, peak = curves["chamber_pressure"] - at, float(true.max())
        loaded = at > LOADED_SHARE * peak
        z = np.abs(error[loaded]) / curves["chamber_pressure_std"][loaded]
        values.update(
            chamber_inside=100.0 * float(np.mean(z < 2.0)), chamber_worst=float(z.max()),
            chamber_rms=100.0 * float(np.sqrt(np.mean(error**2))) / peak,
        )  # fmt: skip
    return Outcome(family, verdict(result)["level"], seconds, rows, **values)


def family_lines(rigs: list[Outcome]) -> list[str]:
    """Return a line a family."""
    lines = [
        "| family | rigs | unexplained | refused | parameters covered | trigger covered | median trigger error, deg | "
        "held-out RMS, % of peak | chamber RMS, % | loaded angles inside 2 std | all at once |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for family in dict.fromkeys(outcome.family for outcome in rigs):
        group = [outcome for outcome in rigs if outcome.family == family]
        done = [outcome for outcome in group if outcome.rows]
        told = sum(outcome.status == "unexplained" for outcome in done)
        inside = [covers(*row) for outcome in done for row in outcome.rows.values()]
        triggers = [covers(*outcome.rows["trigger_offset"]) for outcome in done if "trigger_offset" in outcome.rows]
        every = sum(outcome.chamber_worst < SIMULTANEOUS for outcome in done)
        lines.append(
            f"| {family} | {len(group)} | {told} | {len(group) - len(done)} | {sum(inside)}/{len(inside)} | "
            f"{sum(triggers)}/{len(triggers)} | {median(abs(o.trigger_error) for o in done):.3f} | "
            f"{median(o.held_out for o in done):.3f} | {median(o.chamber_rms for o in done):.2f} | "
            f"{median(o.chamber_inside for o in done):.0f} % | {every}/{len(done)} |"
        )
    return lines


def covers(true: float, _: float, low: float, high: float) -> bool:
    """Return whether an interval holds the true value."""
    return low <= true <= high


def median(values: object) -> float:
    """Return the median, nan where there is nothing."""
    found = [value for value in values if np.isfinite(value)]  # type: ignore[attr-defined]
    return float(np.median(found)) if found else float("nan")


def main() -> None:
    """Run the rigs and print, or write, the tables."""
    parser = bench_parser(__doc__)
    parser.add_argument("--families", nargs="+", default=list(DEFAULT), choices=sorted(FAMILIES))
    arguments = parser.parse_args()
    draws = range(arguments.first, arguments.first + arguments.draws)
    jobs = [(family, draw, arguments.cycles) for draw in draws for family in arguments.families]
    rigs = []
    for (family, draw, _), rig in outcomes(lambda job: one_rig(*job), jobs, arguments.workers):
        rigs.append(rig)
        missed = ", ".join(name for name, row in rig.rows.items() if not covers(*row))
        said = f"{rig.status}, {rig.seconds:.0f} s, trigger {rig.trigger_error:+.3f} deg, chamber "
        said += f"{rig.chamber_inside:.0f} % inside 2 std, missed {missed or 'nothing'}"
        print(f"{family} {draw}: {said}", flush=True)
    rigs.sort(key=lambda rig: arguments.families.index(rig.family))
    names = dict.fromkeys(name for rig in rigs for name in rig.rows)
    intervals = {name: [rig.rows[name] for rig in rigs if name in rig.rows] for name in names}
    tell("\n".join([*family_lines(rigs), "", *interval_table(intervals)]) + "\n", arguments.write)


if __name__ == "__main__":
    main()

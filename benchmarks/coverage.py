"""Do the stated intervals cover the truth? Simulated rigs in, parameters and intervals out.

The rigs (tests/rigs) are stepped in time by code that shares nothing with the fit. Per family: share of rigs whose true
value lies in the 95 % interval (statistical and total), median of stated over actual error, error of trigger angle,
chamber pressure and shaft torque. Families whose name starts with ``foreign`` obey a law that the fit lacks.

    python benchmarks/coverage.py --rigs 40 --families closed_volume plain foreign_leak --write docs/coverage.md
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "fit")]

from camtorque.fit import FitOptions, fit_prepared  # noqa: E402
from camtorque.fit.problem import FIT_EFFECTS  # noqa: E402
from camtorque.fit.result import fitted_torque  # noqa: E402
from camtorque.laws.chamber import LEAK_PRESSURE  # noqa: E402
from rig_prepared import prepared_run  # noqa: E402
from rigs.cycles import as_cycles  # noqa: E402
from rigs.families import FAMILIES  # noqa: E402
from rigs.rig import lift_of, simulate  # noqa: E402

DEFAULT_FAMILIES = ("closed_volume", "plain", "spill", "plain_spill", "foreign_leak", "foreign_valve_mass")
CHAIN = tuple(name for name in FIT_EFFECTS if name not in ("controller", "coupling"))
Z95 = 1.96


def truths(truth) -> dict[str, float]:  # type: ignore[no-untyped-def]
    """Return the true values in the units of the report."""
    line, chamber, fluid = truth.driveline, truth.chamber, truth.fluid
    closing = float(lift_of(truth, np.array([chamber.port_close_angle]))[0])
    return {
        "trigger_offset": np.rad2deg(truth.trigger.angle_offset),
        "shaft_compliance": 1e6 / line.shaft_stiffness,
        "shaft_damping": line.shaft_damping,
        "cam_side_inertia": 1e6 * (line.camshaft_inertia + truth.pump.cam_inertia),
        "drive_admittance": 1.0 / line.drive_inertia,
        "dead_volume": 1e9 * chamber.dead_volume,
        "bulk_modulus": fluid.modulus / 1e9,
        "port_closing_lift": 1e3 * closing,
        "leakage": 1e14 * chamber.leak * (1.0 + chamber.leak_growth * LEAK_PRESSURE) ** 3,
        "delay_error": 1e6 * truth.torque_sensor.delay_error * truth.torque_sensor.delay,
        "torque_zero": truth.torque_sensor.zero_residual,
    }


def one_rig(job: tuple[str, int]) -> dict[str, object]:
    """Return what one rig shows: (truth, value, statistical, total) per parameter, and the errors of the curves."""
    family, seed = job
    rng = np.random.default_rng(1000 + seed)
    truth = FAMILIES[family](rng)
    speed = float(rng.uniform(400.0, 1300.0))
    run = simulate(truth, speed_rpm=speed, load=float(rng.uniform(0.55, 0.95)), n_cycles=20, seed=seed, step=1e-5)
    prepared = prepared_run(run)
    fit = fit_prepared(prepared, FitOptions(effects=CHAIN, use_ladder=False, checks=False))
    fitted = fitted_torque(fit, 0, prepared.recording, prepared.cycles, prepared.rigid, prepared.means)
    known = {p.name: p for p in fitted.parameters}
    rows = {
        name: (value, known[name].value, known[name].stderr_statistical, known[name].stderr, known[name].at_bound)
        for name, value in truths(truth).items()
        if name in known
    }
    true_angle = as_cycles(run)["true_angle"].mean(axis=0)
    chamber = run.true_cycles("chamber_pressure", 3600).mean(axis=0)
    model = np.interp(2 * np.pi * np.arange(3600) / 3600, fitted.true_angle, fitted.chamber_pressure, period=2 * np.pi)
    peak = float(np.max(chamber))
    stated = fitted.chamber_peak
    return {
        "family": family,
        "rms": fitted.metrics["fitted_held_out_cycles"].rms_percent_of_peak,
        "rows": rows,
        "angle_deg": float(np.rad2deg(np.sqrt(np.mean((fitted.true_angle - true_angle) ** 2)))),
        "chamber_percent": 100.0 * float(np.sqrt(np.mean((model - chamber) ** 2)) / peak),
        "chamber_peak": (peak, stated.value, stated.stderr) if stated else None,
    }


def summary(family: str, results: list[dict]) -> list[str]:
    """Return the lines of the table of one family."""
    lines = [
        f"\n### {family}: {len(results)} rigs\n",
        f"held-out RMS median {np.median([r['rms'] for r in results]):.3f} % of peak; cam angle rms median "
        f"{np.median([r['angle_deg'] for r in results]):.3f} deg; chamber pressure rms median "
        f"{np.median([r['chamber_percent'] for r in results]):.2f} % of its peak\n",
        "| parameter | rigs | statistical 95 % covers | total 95 % covers | stated / actual error | median error |",
        "|---|---|---|---|---|---|",
    ]
    for name in results[0]["rows"]:
        data = np.array([r["rows"][name] for r in results if name in r["rows"]], dtype=float)
        data = data[data[:, 4] == 0.0]
        if data.shape[0] < 3:
            continue
        error = np.abs(data[:, 1] - data[:, 0])
        statistical = 100.0 * np.mean(error <= Z95 * data[:, 2])
        total = 100.0 * np.mean(error <= Z95 * data[:, 3])
        ratio = np.median(data[:, 3] / np.maximum(error, 1e-12))
        lines.append(
            f"| {name} | {data.shape[0]} | {statistical:.0f} % | {total:.0f} % | {ratio:.1f} | {np.median(error):.3g} |"
        )
    return lines


def main() -> None:
    """Run the rigs and print, or write, the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=30)
    parser.add_argument("--families", nargs="+", default=list(DEFAULT_FAMILIES), choices=sorted(FAMILIES))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    started = time.perf_counter()
    jobs = [(family, seed) for family in arguments.families for seed in range(arguments.rigs)]
    with ProcessPoolExecutor(arguments.workers) as pool:
        results = list(pool.map(one_rig, jobs))
    lines = ["# Coverage of the stated intervals", "", (__doc__ or "").split("\n\n")[1].replace("\n", " "), ""]
    lines.append(f"Command: `python benchmarks/coverage.py --rigs {arguments.rigs}`.")
    for family in arguments.families:
        lines += summary(family, [r for r in results if r["family"] == family])
    text = "\n".join(lines) + "\n"
    print(text, f"{time.perf_counter() - started:.0f} s")
    if arguments.write:
        arguments.write.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

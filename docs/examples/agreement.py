"""Agreement of the rigid solution with independent solutions; prints the tables of docs/agreement.md.

python docs/examples/agreement.py      (engines of the extra ``validation`` that are missing are left out)
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "mechanism"))
import exudyn_case
from camtorque.mechanism.mounting import Mounting, PumpUnit
from camtorque.mechanism.shaft import METHODS, ShaftForces, solve_shaft
from engine_cases import COMPARED, ENGINES, agreement
from mechanism_cases import Motion, analytic_law, motion, newton_euler, paper_pump

LAW = analytic_law()
SIZE = 200
GRAVITY = (2.0, -9.81)
SHARES = np.array([1.0, 0.4, 0.7])


def scene(offset: float, varying: bool, pumps: int) -> tuple[list[PumpUnit], Motion]:
    """Return pumps on a shaft and their motion."""
    mounting = Mounting(gravity=GRAVITY, spring_mass=0.03, guide_height=0.05)
    units = [PumpUnit(paper_pump(follower_offset=offset), LAW, 2.1 * k, mounting) for k in range(pumps)]
    run = motion(varying, SIZE)
    return units, Motion(run.theta, run.pressure * SHARES[:pumps, None], run.speed, run.acceleration)


def difference(ours: ShaftForces, theirs: list[dict[str, np.ndarray]]) -> dict[str, float]:
    """Return max difference / max value per output; the tangential force on the scale of the normal one."""
    found = {}
    for name in COMPARED:
        scale = "contact_normal" if name == "contact_tangential" else name
        worst = max(np.max(np.abs(a[name] - b[name])) for a, b in zip(ours.outputs, theirs, strict=True))
        found[name] = float(worst / max(np.max(np.abs(b[scale])) for b in theirs))
    return found


def from_scratch(units: list[PumpUnit], run: Motion) -> list[dict[str, np.ndarray]]:
    """Return the solution of nine free-body equations per sample."""
    solved = []
    for unit, pressure in zip(units, run.pressure, strict=True):
        samples = zip(run.theta - unit.phase, pressure, run.speed, run.acceleration, strict=True)
        rows = [newton_euler(unit.pump, LAW, unit.mounting, *sample) for sample in samples]
        solved.append({name: np.array([row[name] for row in rows]) for name in COMPARED})
    return solved


def inverse_dynamics_rows() -> None:
    """Print closed form against every method that gets the same motion."""
    print("| solution | case | " + " | ".join(COMPARED) + " |")
    print("|---" * (len(COMPARED) + 2) + "|")
    engines = [name for name in ENGINES if importlib.util.find_spec(name) is not None]
    for offset in (0.0, 5e-3):
        for varying in (False, True):
            for pumps in (1, 3):
                units, run = scene(offset, varying, pumps)
                motion_of = (run.theta, run.pressure, run.speed, run.acceleration)
                ours = solve_shaft(units, *motion_of)
                found = {m: difference(ours, list(solve_shaft(units, *motion_of, method=m).outputs)) for m in METHODS}
                del found["closed"]
                found["Newton-Euler from scratch"] = difference(ours, from_scratch(units, run))
                found |= {name: agreement(name, units, run, ours) for name in engines}
                speed = "varying" if varying else "constant"
                case = f"e = {1e3 * offset:.0f} mm, {speed} speed, {pumps} pump{'s' if pumps > 1 else ''}"
                for name, row in found.items():
                    print(f"| {name} | {case} | " + " | ".join(f"{row[output]:.1e}" for output in COMPARED) + " |")


def integration_rows() -> None:
    """Print closed form against Exudyn's time integration."""
    if importlib.util.find_spec("exudyn") is None:
        return
    print("\n| case | steps per revolution | torque | guide | contact_y |")
    print("|---|---|---|---|---|")
    for offset in (0.0, 5e-3):
        for ripple in (0.0, 0.02):
            for steps in (360, 720, 1440, 3600):
                pump = paper_pump(follower_offset=offset, roller_inertia=0.0)
                drive, time, theirs = exudyn_case.integrate(pump, LAW, ripple, steps)
                angle = drive.angle(time)
                load = exudyn_case.pressure_over(angle)
                ours = solve_shaft([PumpUnit(pump, LAW)], angle, load, drive.rate(time), drive.rate_change(time))
                late = time > time[-1] / 72.0
                row = [
                    np.max(np.abs(theirs[n] - ours.outputs[0][n])[late]) / np.max(np.abs(ours.outputs[0][n]))
                    for n in ("torque", "guide", "contact_y")
                ]
                speed = "varying" if ripple else "constant"
                print(
                    f"| e = {1e3 * offset:.0f} mm, {speed} speed | {steps} | "
                    + " | ".join(f"{v:.1e}" for v in row)
                    + " |"
                )


def main() -> None:
    """Print both tables."""
    inverse_dynamics_rows()
    integration_rows()


if __name__ == "__main__":
    main()

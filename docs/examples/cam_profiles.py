"""Cam profiles and follower offsets compared at equal delivery; prints the tables of docs/cam_profiles.md.

python docs/examples/cam_profiles.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from camtorque.config import PumpData
from camtorque.config_pump import load_pump_config
from camtorque.mechanism import CamLaw, closed_form_tables, quintic_law, solve_rigid
from camtorque.mechanism.cam import TURN
from camtorque.mechanism.sections import FLANKS, dwell, flank, section_law, tangent_sections
from camtorque.records import Array, CamTable
from camtorque.units import BAR, DEGREE, RPM

ROOT = Path(__file__).resolve().parents[2]
THETA = np.arange(7200) * (TURN / 7200)
LIFT = 8.0e-3
PORT_CLOSES, SPILL, RAMP = 1.5e-3, 4.5e-3, 0.3e-3
"""Lifts between which the plunger delivers, and over which the pressure comes and goes [m]."""
PEAK = 600.0 * BAR
SPEED = 500.0 * RPM
GUIDE_FRICTION = 0.1


def law_of(kind: str) -> CamLaw:
    """Return a lobe with rise 60, dwell 20, fall 55 degrees; a tangent cam takes the angles that it needs."""
    if kind == "tangent":
        sections = tangent_sections(0.020, 0.008, LIFT, 5.0e-3)
        return section_law([*sections, dwell(TURN - sum(section.angle for section in sections))])
    rise, top, fall = 60.0 * DEGREE, 20.0 * DEGREE, 55.0 * DEGREE
    return section_law([flank(kind, rise, LIFT), dwell(top), flank(kind, fall, -LIFT), dwell(TURN - rise - top - fall)])


def law_with_shifted_follower(law: CamLaw, pump: PumpData, offset: float) -> CamLaw:
    """Return the lift that a cam ground for an on-axis follower gives to a follower shifted by ``offset``.

    The roller centre at distance r from the cam axis passes x = e when the shaft has turned asin(e / r) less, at the
    height sqrt(r^2 - e^2).
    """
    base = pump.base_circle_radius + pump.roller_radius
    distance = base + law.evaluate(THETA)
    angle = THETA - np.arcsin(offset / distance) + np.arcsin(offset / base)
    lift = np.sqrt(distance**2 - offset**2) - np.sqrt(base**2 - offset**2)
    return quintic_law(CamTable(angle, lift, 0.0))


def pressure_of(law: CamLaw) -> Array:
    """Return the pressure as a function of lift on the rise: the same stroke and delivery for every cam."""
    lift, velocity, _ = law.derivatives(THETA, 2)
    up = np.clip((lift - PORT_CLOSES) / RAMP, 0.0, 1.0)
    down = np.clip((SPILL + RAMP - lift) / RAMP, 0.0, 1.0)
    return PEAK * np.where(velocity > 0.0, np.minimum(up, down), 0.0)


def figures(pump: PumpData, law: CamLaw) -> dict[str, float]:
    """Return the figures by which cams are compared."""
    pressure = pressure_of(law)
    solved = solve_rigid(pump, law, THETA, pressure, SPEED)
    tables = closed_form_tables(pump, law, THETA)
    path, forces = tables.kinematics, solved.forces
    rub = GUIDE_FRICTION * np.abs(forces.guide * path.velocity)
    return {
        "peak torque [N m]": float(np.max(solved.torque)),
        "delivery [mm^3]": 1e9 * float(pump.plunger_area * (SPILL - PORT_CLOSES)),
        "work [J/rev]": float(np.mean(solved.torque) * TURN),
        "peak Hertz [GPa]": float(np.nanmax(forces.hertz)) / 1e9,
        "pressure angle rise [deg]": float(np.max(path.pressure_angle)) / DEGREE,
        "fall [deg]": float(np.min(path.pressure_angle)) / DEGREE,
        "peak contact [N]": float(np.max(forces.contact_normal)),
        "peak guide [N]": float(np.max(np.abs(forces.guide))),
        "guide friction at 0.1 [N m]": float(np.max(rub)),
        "least convex radius [mm]": 1e3 / float(np.max(path.surface_curvature)),
        "jump, dry [rpm]": tables.jump().speed / RPM,
    }


def print_table(first: str, rows: dict[str, dict[str, float]]) -> None:
    """Print rows as Markdown."""
    names = list(next(iter(rows.values())))
    print(f"| {first} | " + " | ".join(names) + " |")
    print("|---" * (len(names) + 1) + "|")
    for label, row in rows.items():
        print(f"| {label} | " + " | ".join(f"{value:.4g}" for value in row.values()) + " |")
    print()


def main() -> None:
    """Print the three tables."""
    pump = load_pump_config(ROOT / "calibration" / "paper_pump.toml").pump
    print("profiles")
    print_table("profile", {kind: figures(pump, law_of(kind)) for kind in (*FLANKS, "tangent")})
    law = law_of("polynomial_4567")
    offsets = (-6.0, -3.0, 0.0, 3.0, 6.0, 9.0)
    print("same lift law, cam ground anew for each offset")
    print_table("offset [mm]", {f"{e:+.0f}": figures(replace(pump, follower_offset=1e-3 * e), law) for e in offsets})
    print("same cam, follower shifted")
    shifted = {}
    for e in offsets:
        moved = replace(pump, follower_offset=1e-3 * e)
        shifted[f"{e:+.0f}"] = figures(moved, law_with_shifted_follower(law, pump, 1e-3 * e))
    print_table("offset [mm]", shifted)


if __name__ == "__main__":
    main()

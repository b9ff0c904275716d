"""What the rounding of a lift table costs, by method; prints the table of docs/lift_laws.md.

python docs/examples/lift_tables.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from camtorque.config.pump import load_pump_config
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.lift_laws import LIFT_METHODS, lift_law
from camtorque.mechanism.sections import dwell, flank, section_law
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import CamTable
from camtorque.units import BAR, DEGREE, RPM, TURN

ROOT = Path(__file__).resolve().parents[2]
THETA = np.arange(3600) * (TURN / 3600)
PRESSURE = 600.0 * BAR * np.exp(-(((THETA - 30.0 * DEGREE) / (8.0 * DEGREE)) ** 2))
SPEED = 500.0 * RPM
DWELLS = ((THETA > 68 * DEGREE) & (THETA < 72 * DEGREE)) | ((THETA > 150 * DEGREE) & (THETA < 345 * DEGREE))


def exact_law(kind: str) -> CamLaw:
    """Return rise 60, dwell 20, return 55 degrees, 8 mm."""
    rest = 225.0 * DEGREE
    rise, fall = flank(kind, 60.0 * DEGREE, 8e-3), flank(kind, 55.0 * DEGREE, -8e-3)
    return section_law([rise, dwell(20.0 * DEGREE), fall, dwell(rest)])


def main() -> None:
    """Print the errors of torque, slope, acceleration, curvature and Hertz stress."""
    pump = load_pump_config(ROOT / "calibration" / "paper_pump.toml").pump
    print(
        "| lift | rounded to | method | y [um] | y' [%] | y'' [%] | torque [N m] | contact [N] | "
        "least convex radius [mm] (exact) | Hertz [GPa] | y' in the dwells [um/deg] |"
    )
    print("|---" * 11 + "|")
    angles = np.arange(360) * DEGREE
    for kind in ("polynomial_4567", "cycloidal", "modified_sine"):
        exact = closed_form_tables(pump, exact_law(kind), THETA)
        for microns in (0.1, 1.0, 10.0):
            step = 1e-6 * microns
            table = CamTable(angles, np.round(exact_law(kind).evaluate(angles) / step) * step, step)
            for method in LIFT_METHODS:
                ours = closed_form_tables(pump, lift_law(table, method), THETA)
                cells = []
                for name in ("lift", "velocity", "acceleration"):
                    a, b = getattr(ours.kinematics, name), getattr(exact.kinematics, name)
                    scale = 1e6 if name == "lift" else 100.0 / np.max(np.abs(b))
                    cells.append(scale * np.max(np.abs(a - b)))
                for name in ("torque", "contact_normal"):
                    both = [t.evaluate(name, PRESSURE, SPEED) for t in (ours, exact)]
                    cells.append(np.max(np.abs(both[0] - both[1])))
                radius = [1e3 / np.max(t.kinematics.surface_curvature[~t.kinematics.undercut]) for t in (ours, exact)]
                stress = [t.hertz(PRESSURE, SPEED) / 1e9 for t in (ours, exact)]
                lost = int(np.sum(ours.kinematics.undercut))
                worst = np.nanmax(np.abs(stress[0] - stress[1]))
                flat = np.max(np.abs(ours.kinematics.velocity[DWELLS])) * 1e6 * DEGREE
                note = f" (+{lost} undercut)" if lost else ""
                print(
                    f"| {kind} | {microns:g} um | {method} | "
                    + " | ".join(f"{v:.3g}" for v in cells)
                    + f" | {radius[0]:.2f} ({radius[1]:.2f}) | {worst:.3g}{note} | {flat:.2g} |"
                )


if __name__ == "__main__":
    main()

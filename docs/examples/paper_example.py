"""The pump of the paper as a worked example: its figures 3, 4, 6 and 7 with our numbers.

python docs/examples/paper_example.py      writes docs/paper_*.png and prints the table of docs/paper_example.md
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from camtorque.config.pump import load_pump_config
from camtorque.ingest.pump_file import read_pressure_curve
from camtorque.mechanism.predict import Prediction, predict, sweep_rows
from camtorque.units import BAR, DEGREE, RPM

ROOT = Path(__file__).resolve().parents[2]
STYLE = {"figsize": (7.0, 3.2), "constrained_layout": True}


def _save(figure: plt.Figure, name: str) -> None:
    figure.savefig(ROOT / "docs" / name, dpi=75)
    plt.close(figure)


def figure_3(prediction: Prediction) -> None:
    """Lift and velocity of the cam."""
    figure, axis = plt.subplots(**STYLE)
    path, angle = prediction.kinematics, prediction.theta / DEGREE
    axis.plot(angle, 1e3 * path.lift, label="lift y [mm]")
    axis.plot(angle, 1e3 * path.velocity, label="velocity y' [mm/rad]")
    axis.set(xlabel="cam angle [deg]", xlim=(0, 360), title="Figure 3: lift and velocity")
    axis.legend()
    _save(figure, "paper_figure_3.png")


def figure_4(prediction: Prediction) -> None:
    """Pressure over cam angle."""
    figure, axis = plt.subplots(**STYLE)
    axis.plot(prediction.theta / DEGREE, prediction.pressure / BAR)
    axis.set(xlabel="cam angle [deg]", ylabel="pressure [bar]", xlim=(0, 180), title="Figure 4: pressure")
    _save(figure, "paper_figure_4.png")


def figure_6(prediction: Prediction) -> None:
    """Driving torque over the rise and the return."""
    figure, axis = plt.subplots(**STYLE)
    angle = prediction.theta / DEGREE
    axis.plot(angle, prediction.pumps[0].torque, "k", label="driving torque")
    for cause in ("pressure", "spring", "inertia_follower"):
        axis.plot(angle, prediction.pumps[0].by_cause[cause], lw=1.0, label=cause)
    axis.set(xlabel="cam angle [deg]", ylabel="torque [N m]", xlim=(0, 150), title="Figure 6: driving torque, 500 rpm")
    axis.legend()
    _save(figure, "paper_figure_6.png")


def figure_7(prediction: Prediction) -> None:
    """Hertz stress and reactions of the camshaft bearing."""
    figure, (left, right) = plt.subplots(1, 2, **STYLE)
    angle, forces = prediction.theta / DEGREE, prediction.pumps[0].forces
    left.plot(angle, forces.hertz / 1e9)
    left.set(xlabel="cam angle [deg]", ylabel="p0 [GPa]", xlim=(0, 180), title="Figure 7(a): Hertz stress")
    right.plot(angle, forces.bearing_x, label="along X1")
    right.plot(angle, forces.bearing_y, label="along Y1")
    right.set(xlabel="cam angle [deg]", ylabel="force [N]", xlim=(0, 180), title="Figure 7(b): bearing")
    right.legend()
    _save(figure, "paper_figure_7.png")


def main() -> None:
    """Write the figures and print the numbers."""
    curve = read_pressure_curve(ROOT / "calibration" / "paper_pressure.csv")
    prediction = predict(load_pump_config(ROOT / "calibration" / "paper_pump.toml"), [500.0 * RPM], curve)
    for figure in (figure_3, figure_4, figure_6, figure_7):
        figure(prediction)
    path = prediction.kinematics
    for name, value in sweep_rows(prediction)[0].items():
        print(f"| {name} | {value if isinstance(value, bool) else f'{value:.4g}'} |")
    print(
        f"| pressure angle, greatest and least [deg] | {np.max(path.pressure_angle) / DEGREE:.2f}, "
        f"{np.min(path.pressure_angle) / DEGREE:.2f} |"
    )
    print(
        f"| jump speed, with and without pressure [rpm] | {prediction.jump.speed / RPM:.0f}, "
        f"{prediction.jump_without_pressure.speed / RPM:.0f} |"
    )


if __name__ == "__main__":
    main()

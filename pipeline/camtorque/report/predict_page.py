"""A prediction as one self-contained HTML page: what was asked, the sweep, findings, and curves over cam angle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.mechanism.predict import Prediction, prediction_document, sweep_rows
from camtorque.report.chart import CAM_ANGLE, CYCLE, DASHES, HALF, WIDE, Curves, Line, Panel, phases, strokes
from camtorque.report.files import write_json, write_page
from camtorque.report.folder import output_folder
from camtorque.report.numbers import significant, with_decimals, words
from camtorque.report.page import drawing_of, render
from camtorque.units import BAR, DEGREE, RPM

SWEEP = {
    "speed_rpm": "speed [rpm]",
    "shaft_torque_max_nm": "shaft torque, largest [N m]",
    "shaft_torque_min_nm": "shaft torque, smallest [N m]",
    "shaft_torque_mean_nm": "shaft torque, mean [N m]",
    "pump_torque_max_nm": "torque of the first pump, largest [N m]",
    "pump_torque_max_deg": "at cam angle [deg]",
    "contact_normal_max_n": "contact force, largest [N]",
    "bearing_max_n": "bearing reaction, largest [N]",
    "guide_max_n": "guide force, largest [N]",
    "hertz_max_gpa": "Hertz pressure, largest [GPa]",
    "hertz_max_deg": "at cam angle [deg]",
    "shear_max_gpa": "shear stress below the surface, largest [GPa]",
    "shear_depth_um": "its depth [µm]",
    "rolling_speed_max_m_per_s": "rolling speed, largest [m/s]",
    "roller_speed_max_rpm": "roller speed, largest [rpm]",
    "contact_lost": "contact lost",
}
"""Key of a row of the sweep -> what the page calls it."""


NOISE_DECIMALS = 9
"""Decimals of any number of the sweep beyond which there is rounding alone: the mean torque of a dry pump is none."""
MOST_NAMED = 3
"""Speeds beyond which the headline names the worst one only."""


def _line(label: str, values: np.ndarray, place: int) -> Line:
    return Line(label, values, CYCLE[place % len(CYCLE)], dash=DASHES[(place // len(CYCLE)) % len(DASHES)])


def _by_speed(prediction: Prediction, curves: Any) -> tuple[Line, ...]:
    return tuple(
        _line(f"{significant(speed / RPM, 4)} rpm", values, k)
        for k, (speed, values) in enumerate(zip(prediction.speeds, curves, strict=True))
    )


def _panels(prediction: Prediction) -> dict[str, tuple[Panel, ...]]:
    """Return what each of `FIGURES` shows."""
    path, last = prediction.kinematics, prediction.pumps[-1]
    causes = {words(name): values for name, values in last.by_cause.items() if np.any(values != 0.0)}
    forces = {"contact": last.forces.contact_normal / 1e3, "bearing, across": last.forces.bearing_x / 1e3,
              "bearing, along": last.forces.bearing_y / 1e3, "guide": last.forces.guide / 1e3}  # fmt: skip
    by_cause, by_joint = (
        tuple(_line(label, values, k) for k, (label, values) in enumerate(rows.items())) for rows in (causes, forces)
    )
    hertz = _by_speed(prediction, [pump.forces.hertz / 1e9 for pump in prediction.pumps])
    return {
        "torque": (Panel("drive torque [N m]", _by_speed(prediction, prediction.shaft_torque)),),
        "cam": (
            Panel("pressure [bar]", (Line("pressure", prediction.pressure / BAR, "measured"),), height=110.0),
            Panel("lift [mm]", (Line("lift", 1e3 * path.lift, "c2"),), height=80.0),
            Panel("velocity [mm/rad]", (Line("velocity", 1e3 * path.velocity, "c1"),), height=80.0),
            Panel("pressure angle [deg]", (Line("pressure angle", path.pressure_angle / DEGREE, "c6"),), height=80.0),
        ),
        "causes": (Panel("torque by cause [N m]", by_cause, height=180.0),),
        "forces": (Panel("force [kN]", by_joint, height=180.0),),
        "hertz": (Panel("Hertz pressure [GPa]", hertz, height=160.0),),
    }


FIGURES: dict[str, tuple[str, bool]] = {
    "torque": ("Drive torque", True),
    "cam": ("Cam and load", True),
    "causes": ("Torque{of} by cause, at the last speed", False),
    "forces": ("Forces{of}, at the last speed", False),
    "hertz": ("Hertz pressure{of}", True),
}
"""Name -> title, whether it is wide; ``of`` says whose it is where there are several pumps."""


def chart_of(name: str, prediction: Prediction) -> Curves:
    """Return one of `FIGURES` over cam angle."""
    wide = FIGURES[name][1]
    spans = strokes(prediction.theta, prediction.kinematics.lift) if wide else ()
    width = WIDE if wide else HALF
    return Curves(prediction.theta / DEGREE, CAM_ANGLE, _panels(prediction)[name], spans=spans, width=width)


def _cell(key: str, value: float | bool) -> str:
    """Return a number with four digits, an angle with one decimal, or yes or no."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return with_decimals(value, 1) if key.endswith("_deg") else significant(round(value, NOISE_DECIMALS) + 0.0, 4)


def contact_text(prediction: Prediction) -> str:
    """Return the sentence on contact loss."""
    loss = prediction.jump
    if not np.isfinite(loss.speed):
        return "The follower stays on the cam at every speed."
    return (
        f"The follower leaves the cam from {loss.speed / RPM:.0f} rpm on, first at {loss.theta / DEGREE:.1f} degrees."
    )


def peak_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the largest torque and Hertz pressure of every speed, at most three of them."""
    shown = rows if len(rows) <= MOST_NAMED else [max(rows, key=lambda row: row["shaft_torque_max_nm"])]
    return "; ".join(
        f"{significant(row['shaft_torque_max_nm'])} N m at {significant(row['speed_rpm'], 4)} rpm (Hertz pressure "
        f"{significant(row['hertz_max_gpa'])} GPa)" for row in shown
    ) + "."  # fmt: skip


def prediction_page(prediction: Prediction, title: str) -> str:
    """Return the page as HTML."""
    rows = sweep_rows(prediction)
    of = " of the first pump" if prediction.on_shaft > 1 else ""
    drawings = [
        drawing_of(name, chart_of(name, prediction), heading.format(of=of), wide=wide)
        for name, (heading, wide) in FIGURES.items()
    ]
    steep, back = (value / DEGREE for value in prediction.flat_pressure_angles)
    return render(
        "predict.html", drawings, phases(prediction.theta, prediction.kinematics.lift), title=title,
        findings=prediction.findings, contact=contact_text(prediction), steep=steep, back=-back,
        rough=not prediction.friction.none, peaks=peak_text(rows),
        sweep=[(SWEEP[key], [_cell(key, row[key]) for row in rows]) for key in rows[0]],
        lost=any(row["contact_lost"] for row in rows),
    )  # fmt: skip


def write_prediction(prediction: Prediction, inputs: list[dict[str, str]], title: str, target: Path) -> None:
    """Write predict.json and predict.html of a pump; ``target`` appears whole or not at all."""
    with output_folder(target, "predict.json") as folder:
        write_page(folder / "predict.html", prediction_page(prediction, title))
        write_json(folder / "predict.json", {**prediction_document(prediction), "inputs": inputs})

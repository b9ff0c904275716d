"""What closes the gap between the rigid model and the measurement: the share of each cause on both strokes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from camtorque.fit.derived import ANGLE, CHAMBER, line_pressure_torque
from camtorque.fit.residual import parts_of_gap
from camtorque.records import Array
from camtorque.report.bundle import RunResult

RESIDUAL = "residual"
STRETCHES = ("forward", "return_stroke", "return_minimum")
"""Mean over the loaded part of the forward stroke, over the return stroke, where the measured torque is least there."""
MEANINGS = {
    ANGLE: "line pressure at the true cam angle: trigger angle, twist, speed within the revolution",
    CHAMBER: "chamber pressure instead of line pressure, and the transducer's response to it",
    "lift_table": "lift within the rounding of its table",
    "torque_zero": "zero of the transducer within its prior",
    "drive_ripple": "teeth or poles of the drive, the same all around",
    RESIDUAL: "left over by the fitted model",
}
"""What a row means where its name alone does not say it."""
INSIDE = {
    ANGLE: "chamber pressure at the true cam angle: trigger angle, twist, speed within the revolution",
    CHAMBER: "the transducer's response to it",
}
"""The same where the pressure is measured in the chamber."""


@dataclass(frozen=True)
class GapShare:
    """Part of one cause in measured minus rigid torque over the `STRETCHES`, (3,) [N m].

    ``stderr`` : (3,) standard uncertainties, None of what is left over
    """

    cause: str
    meaning: str
    parts: tuple[float, float, float]
    stderr: Array | None


def gap_curves(result: RunResult) -> dict[str, Array]:
    """Return cause -> (n_theta,) [N m]; they sum to the mean of all used cycles minus the rigid torque.

    Pressure is split by its two reasons: that of the line at the true cam angle, and what the chamber's has beside it.
    """
    assert result.cycles.torque is not None
    fitted, rigid = result.fitted.by_cause, _grouped(result.rigid.by_cause, result.fitted.by_cause)
    none = np.zeros_like(result.rigid.torque)
    curves = {
        name: fitted.get(name, none) - rigid.get(name, none)
        for name in dict.fromkeys((*fitted, *rigid))
        if name != "pressure"
    }
    force = result.cycles.mean_pressure * result.recording.config.pump.plunger_area
    angle = line_pressure_torque(result.rigid, result.fitted.true_angle, force) - force * result.rigid.lift_velocity
    pressure = fitted.get("pressure", none) - rigid.get("pressure", none)
    residual = result.cycles.mean_torque - result.fitted.torque
    return {CHAMBER: pressure - angle, ANGLE: angle, **curves, RESIDUAL: residual}


def _grouped(causes: Mapping[str, Array], names: Mapping[str, Array]) -> dict[str, Array]:
    """Return the rigid causes under the names of the fitted model: ``inertia_cam`` belongs to ``inertia``."""
    grouped: dict[str, Array] = {}
    for name, values in causes.items():
        stem = name.split("_")[0]
        key = stem if stem in names else name
        grouped[key] = grouped[key] + values if key in grouped else values
    return grouped


def gap_shares(result: RunResult) -> tuple[GapShare, ...]:
    """Return the share of each cause, the largest first, the residual last; causes that are zero are left out."""
    assert result.cycles.torque is not None
    meanings = MEANINGS | INSIDE if result.recording.config.measures_chamber else MEANINGS
    forward, fall, lowest = parts_of_gap(result.rigid, result.cycles.mean_torque)
    rows = [
        GapShare(
            name, meanings.get(name, ""),
            (float(np.mean(curve[forward])), float(np.mean(curve[fall])), float(curve[lowest])),
            result.fitted.gap_stderr.get(name),
        )
        for name, curve in gap_curves(result).items()
        if name == RESIDUAL or np.any(curve != 0.0)
    ]  # fmt: skip
    return tuple(sorted(rows, key=lambda row: (row.cause == RESIDUAL, -abs(row.parts[0]) - abs(row.parts[2]))))

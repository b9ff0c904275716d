"""Measured torque against the rigid model's where the line pressure loads the cam most: is it this pump and one run.

While the valve delivers, the plunger carries at least the line pressure and friction adds to it, so the measured
torque lies above the rigid one: 1.01 to 1.67 times in 44 recordings of 28 simulated pumps of other makers.
"""

from __future__ import annotations

import math

import numpy as np

from camtorque.config import PumpData
from camtorque.records import CamCycles, Finding, RigidTorque

LOADED_SHARE = 0.7
"""Share of the largest rigid torque above which an angle counts."""
USUAL = (0.95, 1.9)
"""Measured over rigid torque that is no finding; 28 pumps gave 1.01 to 1.67."""
LEAST_TOLD = 0.2
"""Ratio below which no plunger would explain it: what rings or is of another run has no diameter."""
BY_PRESSURE = 0.5
"""Share of the rigid torque that pressure has to make; below it the spring is compared, not the pump."""


def load_ratio(cycles: CamCycles, rigid: RigidTorque) -> float:
    """Return mean measured over mean rigid torque at the loaded angles, nan where pressure hardly loads the cam."""
    if cycles.torque is None:
        return math.nan
    loaded = rigid.torque > LOADED_SHARE * np.max(rigid.torque)
    modelled = float(np.mean(rigid.torque[loaded]))
    if not modelled > 0.0 or np.mean(rigid.by_cause["pressure"][loaded]) < BY_PRESSURE * modelled:
        return math.nan
    return float(np.mean(cycles.mean_torque[loaded])) / modelled


def load_findings(cycles: CamCycles, rigid: RigidTorque, pump: PumpData) -> tuple[Finding, ...]:
    """Return a warning where torque and pressure cannot well be of this pump and of one run."""
    ratio = load_ratio(cycles, rigid)
    if not math.isfinite(ratio) or USUAL[0] <= ratio <= USUAL[1]:
        return ()
    diameter = f"{1e3 * pump.plunger_diameter:g} mm"
    if ratio > LEAST_TOLD:
        diameter += f", {1e3 * pump.plunger_diameter * math.sqrt(ratio / 1.15):.2g} mm would be usual"
    side = "friction adds to it, and the chamber while it delivers" if ratio < USUAL[0] else "no friction adds so much"
    text = (
        f"where the line pressure loads the cam most the measured torque is {ratio:.2f} of the rigid model's, sound "
        f"pumps have 1.0 to 1.7 ({side}): check plunger_diameter_m ({diameter}), the lift "
        "table, nominal_angle_deg, both sensitivities, and that the logs are of one run"
    )
    return (Finding("torque_against_model", "warning", text, "[pump]"),)

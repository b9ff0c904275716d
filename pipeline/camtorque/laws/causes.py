"""What each cause contributes: torque over angle as the transducer sees it, and work per revolution."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camtorque.laws.chain import (
    LINEAR_NAMES,
    ChainInput,
    ChainOutput,
    contact_load,
    filtered,
    mechanical_torque,
    transfer,
)
from camtorque.records import Array

CAUSES = (
    "pressure", "spring", "inertia", "guide_friction", "bearing_friction", "pin_friction", "shaft_drag",
    "shaft_viscous", "plunger_viscous", "lift_table",
)  # fmt: skip
LOSS_GROUPS: dict[str, tuple[str, ...]] = {
    "pressure": ("pressure",),
    "friction": ("guide_friction", "bearing_friction", "pin_friction", "shaft_drag"),
    "damping": ("shaft_viscous", "plunger_viscous"),
    "spring": ("spring",),
    "inertia": ("inertia",),
    "lift_table": ("lift_table",),
}
"""Group of the energy balance -> causes."""


def cam_torques(
    data: ChainInput, values: Mapping[str, float], output: ChainOutput, coefficients: Array
) -> dict[str, Array]:
    """Return the torque on the cam by cause, before shaft and sensor; each (n,) [N m].

    ``coefficients`` are those of the linear columns of the chain.
    """
    pump, motion = data.pump, output.motion
    y, slope, curve = motion.lift[:3]
    rates = (motion.rate, motion.second)
    mu = values["guide_friction"]
    _, columns = mechanical_torque(data, motion.lift[:3], rates, output.pressure, mu)
    parts = {name: c * column for name, c, column in zip(LINEAR_NAMES, coefficients, columns, strict=False)}
    frictionless = contact_load(data, motion.lift[:3], rates, output.pressure, 0.0)
    whole, _ = mechanical_torque(data, motion.lift[:3], rates, output.pressure, 0.0)
    axial_inertia = pump.follower_mass * (curve * motion.rate**2 + slope * motion.second)
    roller = whole - frictionless * slope
    lift_table = np.zeros_like(y)
    if data.lift_basis is not None:
        lift_table = output.load * data.lift_basis.correction(motion.theta, coefficients[len(LINEAR_NAMES) :], 1)
    return {
        "pressure": slope * pump.plunger_area * output.pressure,
        "spring": slope * (pump.spring_preload + pump.spring_stiffness * y)
        + parts["spring_stiffness_error"] + parts["spring_preload_error"],
        "inertia": slope * axial_inertia + roller,
        "guide_friction": (output.load - frictionless) * slope,
        "bearing_friction": parts["bearing_arm"],
        "pin_friction": parts["pin_arm"],
        "shaft_drag": parts["shaft_drag"],
        "shaft_viscous": parts["shaft_viscous"],
        "plunger_viscous": parts["plunger_viscous"],
        "lift_table": lift_table,
    }  # fmt: skip


def measured_torques(
    data: ChainInput, values: Mapping[str, float], torques: Mapping[str, Array], zero: float
) -> dict[str, Array]:
    """Return the same behind shaft and sensor, with the torque zero; they sum to the model of the measured torque."""
    shaft, measured, _ = transfer(data, values, data.theta.size)
    gain = 1.0 + values["gain_error"]
    result = {name: filtered(torque, shaft * measured) * gain for name, torque in torques.items()}
    result["torque_zero"] = np.full(data.theta.size, zero)
    return result


def work_per_revolution(data: ChainInput, output: ChainOutput, torques: Mapping[str, Array]) -> dict[str, float]:
    """Return the work of each group over the true cam angle [J per revolution]."""
    advance = output.motion.rate / data.speed * (2.0 * np.pi / data.theta.size)
    work = {name: float(np.sum(torque * advance)) for name, torque in torques.items()}
    groups = {group: sum(work[name] for name in names) for group, names in LOSS_GROUPS.items()}
    return {**groups, "driveline": _driveline_loss(data, output)}


def _driveline_loss(data: ChainInput, output: ChainOutput) -> float:
    """Return the work that shaft and coupling damping take between drive and cam [J per revolution].

    Twist and drive turn the cam against the uniform angle by psi: the torque does the work ``-T dpsi`` on them.
    """
    swing = output.motion.rate / data.speed - 1.0
    return -float(np.sum(data.shaft_torque * swing)) * 2.0 * np.pi / data.theta.size

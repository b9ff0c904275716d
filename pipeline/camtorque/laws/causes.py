"""The model's torque by cause: which law takes how much, on the cam and in the measured signal, and its work."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camtorque.laws import GROUPS, LINEAR_NAMES, ON_BRIDGE, ON_CONTACT, cause_of, ripple
from camtorque.laws.chain import ON_CAM, ChainInput, ChainOutput, drive_response, filtered, transfer
from camtorque.laws.torque import cam_torque
from camtorque.mechanism.friction import guide_gain, sliding_sign
from camtorque.mechanism.kinematics import path_at
from camtorque.records import Array

CAUSES = ("pressure", "spring", "inertia", "guide_friction", *dict.fromkeys(
    cause_of(name) for name in LINEAR_NAMES if cause_of(name) not in ("spring", "inertia")), "lift_table")  # fmt: skip
"""Causes of torque on the cam, and of what the bridge feels beside it; they sum to the model."""
ON_BRIDGE_ALONE = {cause_of(name) for name, bridge in zip(LINEAR_NAMES, ON_BRIDGE, strict=True) if bridge}
"""Causes that load no shaft and do no work."""
LOSS_GROUPS: dict[str, tuple[str, ...]] = {
    "pressure": ("pressure",),
    **{loss: tuple(dict.fromkeys(cause_of(name) for name in names)) for loss, names in GROUPS.items()},
    "inertia": ("inertia",),
    "lift_table": ("lift_table",),
}
"""Group of the energy balance -> causes, by the law that each belongs to."""


def cam_torques(
    data: ChainInput, values: Mapping[str, float], output: ChainOutput, coefficients: Array, lift_slope: Array
) -> tuple[dict[str, Array], Array]:
    """Return the torque on the cam by cause, before shaft and sensor, and the plunger's force; each (n,) [N m], [N].

    The force is what packing, damping and the spring's errors push against the lift along the plunger; a packing in
    which the plunger stands pushes either way (`held_by_packing`).

    Parameters
    ----------
    coefficients : (17,) of the linear columns of the chain
    lift_slope : (n,) slope of the lift correction [m/rad]
    """
    pump, motion = data.pump, output.motion
    y, slope, curve = motion.lift[:3]
    # without the arms each column is the torque of its own cause; bearings and pin rub under the plunger's forces, too
    linear = np.where(ON_CONTACT, 0.0, coefficients[:ON_CAM])
    state = (motion.theta, motion.lift, motion.rate, motion.second, output.pressure, linear, False)
    whole, columns, _, load, _, force = cam_torque(data.constants, values["guide_friction"], *state)
    smooth, *_ = cam_torque(data.constants, 0.0, *state)
    parts = dict.fromkeys(CAUSES, np.zeros_like(y))
    for k, name in enumerate(LINEAR_NAMES):
        parts[cause_of(name)] = parts[cause_of(name)] + coefficients[k] * columns[:, k]
    axial_inertia = pump.follower_mass * (curve * motion.rate**2 + slope * motion.second)
    parts["pressure"] = slope * pump.plunger_area * output.pressure
    parts["spring"] = parts["spring"] + slope * (pump.spring_preload + pump.spring_stiffness * y)
    parts["inertia"] = parts["inertia"] + slope * axial_inertia
    parts["guide_friction"] = whole - smooth
    parts["lift_table"] = load * lift_slope
    return parts, force - sliding_sign(slope) * held_by_packing(data, output, coefficients)


def held_by_packing(data: ChainInput, output: ChainOutput, coefficients: Array) -> Array:
    """Return what the packing may push either way, (n,) [N]: its friction where the plunger stands, else 0.

    Where a cam is round its table still has slopes, whose signs are those of its error and no direction of sliding.
    """
    force, share = (coefficients[LINEAR_NAMES.index(name)] for name in ("packing_force", "packing_friction"))
    friction = force + share * data.pump.plunger_area * output.pressure
    return np.where(data.law.is_round(output.motion.lift[1]), friction, 0.0)


def contact_load(
    data: ChainInput, values: Mapping[str, float], output: ChainOutput, coefficients: Array, force: Array
) -> tuple[Array, Array, Array]:
    """Return the contact force along the follower and normal to the cam, and what friction may add to that or take.

    Each (n,) [N]. ``force`` is the plunger's (n,), which the guide raises too; ``coefficients`` as in `cam_torques`.
    Where the follower stands the friction of packing and guide is what may be added either way.
    """
    pump, lift, mu = data.constants, output.motion.lift, values["guide_friction"]
    _, tangent, secant, *_ = path_at(*lift[:3], pump.base, pump.offset, pump.radius)
    stands, sliding = data.law.is_round(lift[1]), guide_gain(tangent, lift[1], mu)
    gain = np.where(stands, 1.0, sliding)
    along = output.load * (gain / sliding) + force * gain
    held = held_by_packing(data, output, coefficients) + np.where(stands, mu * np.abs(tangent * along), 0.0)
    return along, along * secant, held * secant


def measured_torques(
    data: ChainInput, values: Mapping[str, float], torques: Mapping[str, Array], coefficients: Array
) -> dict[str, Array]:
    """Return the same behind shaft and sensor, with what is in the signal alone; they sum to the model.

    ``coefficients`` as in `cam_torques`.
    """
    shaft, measured, *_ = transfer(data, values, data.theta.size)
    gain = 1.0 + values["gain_error"]
    result = {
        name: filtered(torque, measured if name in ON_BRIDGE_ALONE else shaft * measured) * gain
        for name, torque in torques.items()
    }
    zero, *ripples = coefficients[ON_CAM:].tolist()
    result["torque_zero"] = np.full(data.theta.size, zero)
    if data.ripple_order:
        result["drive_ripple"] = ripple.waves(data.ripple_order, data.theta) @ np.array(ripples)
    return result


def filtered_out_torque(data: ChainInput, values: Mapping[str, float], torques: Mapping[str, Array]) -> Array:
    """Return the torque of the shaft less what the transducer's low-pass shows of it, (n,) [N m].

    The twist is rebuilt from the measured torque; where the load changes faster than the low-pass follows, this much
    has to be added.
    """
    total = np.sum([part for name, part in torques.items() if name not in ON_BRIDGE_ALONE], axis=0)
    shaft, measured, *_ = transfer(data, values, data.theta.size)
    return filtered(total, shaft * (1.0 - measured))


def work_per_revolution(
    data: ChainInput, values: Mapping[str, float], output: ChainOutput, torques: Mapping[str, Array]
) -> dict[str, float]:
    """Return the work of each group over the true cam angle [J per revolution].

    That of the driveline is what the torque does on all that turns the cam against the uniform angle, -T dpsi.
    """
    advance = output.motion.rate / data.speed
    work = {name: float(2.0 * np.pi * np.mean(torque * advance)) for name, torque in torques.items()}
    groups = {group: sum(work[name] for name in names) for group, names in LOSS_GROUPS.items()}
    driveline = -2.0 * np.pi * float(np.mean(data.shaft_torque * (advance - 1.0)))
    return {**groups, "driveline": driveline + drive_work(data, values)}


def drive_work(data: ChainInput, values: Mapping[str, float]) -> float:
    """Return the work of the torque on the swing of the transducer's drive side, T dpsi_drive [J per revolution].

    Mean torque times 2 pi is the work past a transducer that turns evenly. Where drive and coupling give way under load
    it is less by this, which nothing between transducer and cam takes. By Parseval, with psi_k = -C_k T_k of the two.
    What a wheel told of the swing is taken for the drive's: it does not say which part of the driveline gives way.
    """
    alone = dict.fromkeys(("shaft_compliance", "half_inertia"), 0.0)
    rolled = data.twist.spectrum
    torque = np.fft.rfft(data.shaft_torque)[: rolled.size]
    yielding = drive_response(data, {**values, **alone}, tangents=False)[: rolled.size, 0]
    swing = -1j * np.arange(rolled.size) * rolled * yielding
    told = 0.0 if data.swing is None else 2.0 * np.pi * float(np.mean(data.shaft_torque * data.told[1]))
    return told + 4.0 * np.pi / data.theta.size**2 * float(np.sum((np.conj(torque) * swing).real))

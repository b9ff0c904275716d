"""What the rigid model leaves out: one file per law, equations and parameter rows side by side."""

from __future__ import annotations

from camtorque.laws import (
    bridge,
    chamber,
    damping,
    driveline,
    follower,
    friction,
    packing,
    ripple,
    roller,
    sensor,
    spring,
)
from camtorque.laws.rows import Law, ParameterRow

LAWS: dict[str, Law] = {
    "chamber": Law(chamber.ROWS),
    "friction": friction.LAW,
    "damping": damping.LAW,
    "spring": spring.LAW,
    "packing": packing.LAW,
    "roller": roller.LAW,
    "bridge": bridge.LAW,
    "driveline": Law(driveline.ROWS),
    "coupling": Law(driveline.COUPLING_ROWS),
    "follower": Law(follower.ROWS),
    "sensor": Law(sensor.ROWS),
    "ripple": Law(ripple.ROWS),
}
"""Name -> law; the lift correction has coefficients instead of named rows."""

ROWS: dict[str, ParameterRow] = {row.name: row for law in LAWS.values() for row in law.rows}
"""Every named parameter."""
STATED_NAMES: tuple[str, ...] = (*ROWS, *driveline.FOLLOWING)
"""Every parameter that a result may state: fitted, or what follows from these."""
LAW_OF: dict[str, str] = {row.name: name for name, law in LAWS.items() for row in law.rows}
"""Parameter -> law."""
LINEAR_NAMES: tuple[str, ...] = tuple(name for law in LAWS.values() for name in law.linear)
"""Parameters that the torque before the sensor is linear in, in the order of their columns."""
ON_BRIDGE: tuple[bool, ...] = tuple(law.on_bridge for law in LAWS.values() for _ in law.linear)
"""Whether each of `LINEAR_NAMES` acts on the transducer's bridge alone."""
ON_CONTACT: tuple[bool, ...] = tuple(name in law.on_contact for law in LAWS.values() for name in law.linear)
"""Whether each of `LINEAR_NAMES` is an arm on which the contact load rubs."""
GROUPS: dict[str, tuple[str, ...]] = {
    loss: tuple(row.name for law in LAWS.values() if law.loss == loss for row in law.rows)
    for loss in dict.fromkeys(law.loss for law in LAWS.values() if law.loss)
}
"""Group of the energy balance -> parameters of its laws."""
LOSSES = {loss: names for loss, names in GROUPS.items() if all(ROWS[name].lower == 0.0 for name in names)}
"""The groups that vanish with their parameters."""


def cause_of(parameter: str) -> str:
    """Return the cause of torque that a parameter of a loss scales."""
    return LAWS[LAW_OF[parameter]].causes.get(parameter, parameter)

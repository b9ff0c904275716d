"""The closed form for many cycles in one compiled pass: eight outputs at the speed of memory.

Where the tables are made once, the outputs of an angle share four numbers, and everything else follows from these by
arithmetic: writing the results is what takes the time. (With nine rows, reading the tables from the second-level cache
cost 0.3 of the copy more, with six 0.1; two cycles per pass, or tiles of the angle, cost more still.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.compiled import njit
from camtorque.mechanism.friction import guide_gain
from camtorque.mechanism.torque import ClosedForm, Constants, joint_forces
from camtorque.records import Array, ReadOnly

CYCLE_OUTPUTS = (
    "torque",
    "contact_normal",
    "contact_tangential",
    "bearing_x",
    "bearing_y",
    "guide",
    "guide_moment",
    "hertz",
)
"""Rows of the result, in this order."""


@dataclass(frozen=True)
class CycleTables(ReadOnly):
    """What the compiled pass reads.

    Attributes
    ----------
    rows : (4, n_theta) lift, y'', tan phi, Hertz factor
    gain : (n_theta,) of the contact load by guide friction; None without friction
    constants : of the closed form
    """

    rows: Array
    gain: Array | None
    constants: Constants


def cycle_tables(tables: ClosedForm) -> CycleTables:
    """Return what the compiled pass reads from the tables of a pump."""
    path, c = tables.kinematics, tables.constants
    rows = np.stack([path.lift, path.acceleration, path.tan_pressure_angle, tables.hertz_factor])
    gain = None if tables.friction.none else guide_gain(path.tan_pressure_angle, path.velocity, c.guide_friction)
    return CycleTables(rows, gain, c)


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def _tabulated(rows, gain, c, pressure, speed, out):  # type: ignore[no-untyped-def]
    lift, curve, tangent, factor = rows[0], rows[1], rows[2], rows[3]
    at_rest, arm = c.preload + c.weight, c.pin_arm / c.radius
    for cycle in range(pressure.shape[0]):
        squared = speed[cycle] * speed[cycle]
        inertia, spin = c.mass * squared, -c.roller_inertia / (c.radius * c.radius) * squared
        load = pressure[cycle]
        torque, normal, tangential = out[0, cycle], out[1, cycle], out[2, cycle]
        bearing_x, bearing_y, guide = out[3, cycle], out[4, cycle], out[5, cycle]
        moment, hertz = out[6, cycle], out[7, cycle]
        for i in range(load.size):
            tan = tangent[i]
            sec = np.sqrt(1.0 + tan * tan)
            height = c.base + lift[i]
            # y' = e + s tan phi, and q' = -(y' + tan phi y'') cos phi / r_r
            slope = c.offset + height * tan
            along = at_rest + c.stiffness * lift[i] + c.area * load[i] + inertia * curve[i]
            across = spin * (slope + tan * curve[i]) / sec
            if gain is not None:
                along = along * gain[i]
                across = across - arm * sec * along
            values = joint_forces(c, 1.0, along, across, 0.0, 0.0, height, slope, tan, sec)
            torque[i] = values[0]
            normal[i] = values[1]
            tangential[i] = values[2]
            bearing_x[i] = values[5]
            bearing_y[i] = values[6]
            guide[i] = values[7]
            moment[i] = values[8]
            hertz[i] = factor[i] * np.sqrt(max(values[1], 0.0))


def evaluate_cycles(tables: CycleTables, pressure: Array, speed: Array, out: Array | None = None) -> Array:
    """Return all outputs of many cycles at constant speed within each.

    Parameters
    ----------
    pressure : (n_cycles, n_theta) [Pa]
    speed : (n_cycles,) [rad/s]
    out : (8, n_cycles, n_theta) to write into; made when None

    Returns
    -------
    (8, n_cycles, n_theta) in the order of `CYCLE_OUTPUTS`; ``contact_normal`` keeps its sign where contact is lost
    """
    n_theta = tables.rows.shape[1]
    if pressure.ndim != 2 or pressure.shape[1] != n_theta or speed.shape != (pressure.shape[0],):
        raise ValueError(f"cycles: pressure {pressure.shape}, speed {speed.shape}; tables have {n_theta} angles")
    shape = (len(CYCLE_OUTPUTS), *pressure.shape)
    result = np.empty(shape) if out is None else out
    if result.shape != shape:
        raise ValueError(f"cycles: out has shape {result.shape}, expected {shape}")
    _tabulated(tables.rows, tables.gain, tables.constants, pressure, speed, result)
    return result

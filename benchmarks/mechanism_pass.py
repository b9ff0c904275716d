"""The closed form over many cycles from tables that are made once: what `mechanism_speed` holds against the copy."""

from __future__ import annotations

import numpy as np
from camtorque.compiled import njit
from camtorque.mechanism.torque import ClosedForm, joint_forces
from camtorque.records import Array


def cycle_rows(tables: ClosedForm) -> Array:
    """Return the rows that `evaluate_cycles` reads, (4, n_theta): lift, y'', tan phi and the Hertz factor."""
    path = tables.kinematics
    return np.stack([path.lift, path.acceleration, path.tan_pressure_angle, tables.hertz_factor])


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def evaluate_cycles(rows, c, pressure, speed, out):  # type: ignore[no-untyped-def]
    """Write the outputs of a frictionless pump over many cycles of constant speed, at the speed of memory.

    Where the tables are made once, the outputs of an angle share four numbers, and everything else follows from these
    by arithmetic: writing the results is what takes the time. (With nine rows, reading the tables from the second-level
    cache cost 0.3 of the copy more, with six 0.1; two cycles per pass, or tiles of the angle, cost more still.)

    Parameters
    ----------
    rows, c : of `cycle_rows`; constants of the closed form
    pressure, speed : (n_cycles, n_theta) [Pa], (n_cycles,) [rad/s]
    out : (8, n_cycles, n_theta) torque, contact force normal and tangential, bearing along x and y, guide force and
        moment, Hertz pressure; the normal force keeps its sign where contact is lost
    """
    lift, curve, tangent, factor = rows[0], rows[1], rows[2], rows[3]
    at_rest = c.preload + c.weight
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
            values = joint_forces(c, 1.0, along, across, 0.0, 0.0, height, slope, tan, sec)
            torque[i] = values[0]
            normal[i] = values[1]
            tangential[i] = values[2]
            bearing_x[i] = values[5]
            bearing_y[i] = values[6]
            guide[i] = values[7]
            moment[i] = values[8]
            hertz[i] = factor[i] * np.sqrt(max(values[1], 0.0))

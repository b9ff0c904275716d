"""The closed form for many cycles in one compiled pass: eight outputs at the speed of memory.

Each output of `closed_form` needs up to four table rows; written out, they share six numbers per angle, and the other
lengths follow from these by a multiplication. A sample costs some twenty multiplications and one root; writing the
results is what takes the time. (With nine rows, reading the tables from the second-level cache cost 0.3 of the copy
more; two cycles per pass, or tiles of the angle, cost more still: docs/mechanism_speed.md.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from camtorque.config import PumpData
from camtorque.mechanism.closed_form import ClosedForm
from camtorque.mechanism.kinematics import base_height
from camtorque.mechanism.mounting import moving_mass
from camtorque.records import Array, freeze_arrays

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
class CycleTables:
    """What the compiled pass reads.

    Attributes
    ----------
    rows : (6, n_theta) lift, inertia forces m y'' of follower and I_r q' / r_r of roller per omega^2, tan phi, sec phi,
        Hertz factor
    constants : plunger area, force at zero lift, spring rate, s at zero lift, offset in the running frame, roller
        radius, height of the guide point (nan: the roller centre), sign of rotation, forces of gravity on bearing x,
        bearing y and guide
    """

    rows: Array
    constants: tuple[float, ...]

    def __post_init__(self) -> None:
        freeze_arrays(self)


def cycle_tables(pump: PumpData, tables: ClosedForm) -> CycleTables:
    """Return what the compiled pass reads from the tables of a pump."""
    path, mounting = tables.kinematics, tables.mounting
    mass, (gravity_x, gravity_y) = moving_mass(pump, mounting), mounting.gravity
    rows = np.stack(
        [
            path.lift,
            tables.outputs["contact_y"][2],
            tables.outputs["contact_tangential"][2],
            path.tan_pressure_angle,
            path.pitch_arc / path.centre_height,
            tables.hertz_factor,
        ]
    )
    constants = (
        pump.plunger_area,
        pump.spring_preload - mass * gravity_y,
        pump.spring_stiffness,
        base_height(pump),
        path.offset,
        pump.roller_radius,
        np.nan if mounting.guide_height is None else mounting.guide_height,
        float(mounting.rotation),
        -pump.cam_mass * gravity_x,
        -pump.cam_mass * gravity_y,
        -mass * gravity_x,
    )
    return CycleTables(rows, tuple(float(value) for value in constants))


@njit(cache=True, fastmath={"contract", "nsz"})
def _evaluate(rows, constants, pressure, speed, out):  # type: ignore[no-untyped-def]
    lift, inertia, roller, tangent, secant, factor = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    area, at_rest, stiffness, base, offset, radius, guide_height, turn, weight_x, weight_y, weight_guide = constants
    # about the roller centre the lever is (s - s): the same loop with both factors 0
    to_guide, from_axis = (0.0, 0.0) if np.isnan(guide_height) else (guide_height, 1.0)
    for cycle in range(pressure.shape[0]):
        squared = speed[cycle] * speed[cycle]
        load = pressure[cycle]
        torque, normal, tangential = out[0, cycle], out[1, cycle], out[2, cycle]
        bearing_x, bearing_y, guide = out[3, cycle], out[4, cycle], out[5, cycle]
        moment, hertz = out[6, cycle], out[7, cycle]
        for i in range(load.size):
            along = at_rest + stiffness * lift[i] + area * load[i] + inertia[i] * squared
            across = roller[i] * squared
            height = base + lift[i]
            force = along * secant[i] - across * tangent[i]
            side = turn * (across * secant[i] - along * tangent[i])
            reaction = weight_guide - side
            # y' = e + s tan phi, and the roller's share of the torque is F_t (r_r - L) with L = s sec phi
            torque[i] = along * (offset + height * tangent[i]) + across * (radius - height * secant[i])
            normal[i] = force
            tangential[i] = across
            bearing_x[i] = side + weight_x
            bearing_y[i] = along + weight_y
            guide[i] = reaction
            moment[i] = (to_guide - from_axis * height) * reaction
            hertz[i] = factor[i] * np.sqrt(max(force, 0.0))


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
    _evaluate(tables.rows, tables.constants, pressure, speed, result)
    return result

"""The closed form for many cycles in one compiled pass: eight outputs at the speed of memory.

Each output of `closed_form` needs up to four table rows; written out, they share nine numbers per angle, so that a
sample costs some twenty multiplications and one root, and writing the results is what takes the time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from pipeline.config import PumpData
from pipeline.mechanism.closed_form import ClosedForm
from pipeline.mechanism.mounting import moving_mass
from pipeline.records import Array, freeze_arrays

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
    rows : (9, n_theta) force at rest, its inertia and the roller's moment part per omega^2, y', q r_r, tan phi,
        sec phi, -lever of the guide moment, Hertz factor
    plunger_area : [m^2]
    turn : sign of rotation
    bearing_weight_x, bearing_weight_y, guide_weight : forces of gravity to add [N]
    """

    rows: Array
    plunger_area: float
    turn: float
    bearing_weight_x: float
    bearing_weight_y: float
    guide_weight: float

    def __post_init__(self) -> None:
        freeze_arrays(self)


def cycle_tables(pump: PumpData, tables: ClosedForm) -> CycleTables:
    """Return the rows of the compiled pass from the tables of a pump."""
    path, mounting = tables.kinematics, tables.mounting
    along, tangential = tables.outputs["contact_y"], tables.outputs["contact_tangential"]
    height = path.centre_height if mounting.guide_height is None else mounting.guide_height
    rows = np.stack(
        [
            along[0],
            along[2],
            tangential[2],
            path.velocity,
            path.roller_ratio * pump.roller_radius,
            path.tan_pressure_angle,
            path.pitch_arc / path.centre_height,
            height - path.centre_height,
            tables.hertz_factor,
        ]
    )
    gravity_x, gravity_y = mounting.gravity
    return CycleTables(
        rows=rows,
        plunger_area=pump.plunger_area,
        turn=float(mounting.rotation),
        bearing_weight_x=-pump.cam_mass * gravity_x,
        bearing_weight_y=-pump.cam_mass * gravity_y,
        guide_weight=-moving_mass(pump, mounting) * gravity_x,
    )


@njit(cache=True, fastmath={"contract", "nsz"})
def _evaluate(rows, area, turn, weight_x, weight_y, weight_guide, pressure, speed, out):  # type: ignore[no-untyped-def]
    at_rest, inertia, roller, velocity, ratio, tangent, secant, lever, factor = (
        rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6], rows[7], rows[8],
    )  # fmt: skip
    for cycle in range(pressure.shape[0]):
        squared = speed[cycle] * speed[cycle]
        load = pressure[cycle]
        torque, normal, tangential = out[0, cycle], out[1, cycle], out[2, cycle]
        bearing_x, bearing_y, guide = out[3, cycle], out[4, cycle], out[5, cycle]
        moment, hertz = out[6, cycle], out[7, cycle]
        for i in range(pressure.shape[1]):
            along = at_rest[i] + area * load[i] + inertia[i] * squared
            across = roller[i] * squared
            force = along * secant[i] - across * tangent[i]
            side = turn * (across * secant[i] - along * tangent[i])
            reaction = weight_guide - side
            torque[i] = along * velocity[i] + across * ratio[i]
            normal[i] = force
            tangential[i] = across
            bearing_x[i] = side + weight_x
            bearing_y[i] = along + weight_y
            guide[i] = reaction
            moment[i] = lever[i] * reaction
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
    _evaluate(
        tables.rows,
        tables.plunger_area,
        tables.turn,
        tables.bearing_weight_x,
        tables.bearing_weight_y,
        tables.guide_weight,
        pressure,
        speed,
        result,
    )
    return result

"""One pump, solved: `RigidTorque` and `Forces` from pressure and speed over cam angle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camtorque.config import PumpData
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.contact import SHEAR_DEPTH, SHEAR_VALUE, half_width, hertz_pressure, pulls
from camtorque.mechanism.flight import fly, is_revolution
from camtorque.mechanism.friction import NO_FRICTION, Friction
from camtorque.mechanism.mounting import NO_GRAVITY, Mounting, PumpUnit
from camtorque.mechanism.shaft import prescribed_motion, solve_shaft
from camtorque.mechanism.torque import ClosedForm, closed_form_tables
from camtorque.records import Array, Flight, Forces, Mask, RigidTorque


def solve_rigid(
    pump: PumpData,
    law: CamLaw,
    theta: Array,
    pressure: Array,
    speed: Array | float,
    acceleration: Array | float | None = None,
    *,
    method: str = "closed",
    mounting: Mounting = NO_GRAVITY,
    friction: Friction = NO_FRICTION,
) -> RigidTorque:
    """Return torque by cause and all forces of one rigid pump.

    Parameters
    ----------
    theta : (n_theta,) cam angle, any spacing [rad]
    pressure : (n_theta,) on the plunger, gauge [Pa]
    speed : scalar or (n_theta,) [rad/s]
    acceleration : scalar or (n_theta,) [rad/s^2]; None where the speed is constant within the revolution
    method : one of `METHODS`: the same numbers at different cost
    mounting : direction of running, gravity, guide point
    friction : of guide, bearings and pin; the source paper has none

    Raises
    ------
    Refusal : see `solve_shaft`; impossible offset

    Notes
    -----
    Where the balance asks the cam to pull, the follower leaves it: ``contact_lost`` is set, and over a whole revolution
    it is followed through the air until it lands (`flight`): the torque is that of the cam alone, contact forces and
    Hertz stress read 0, bearing and guide carry weight alone. On angles that are no revolution nothing tells when it
    lands: the torque reads nan where the cam would have to pull.
    """
    tables = closed_form_tables(pump, law, theta, mounting, friction)
    run = prescribed_motion(1, theta, pressure, speed, acceleration)
    if method == "closed":
        outputs = tables.all_outputs(run.pressure[0], run.speed, run.acceleration)
    else:
        unit = PumpUnit(pump, law, mounting=mounting, friction=friction)
        outputs = dict(solve_shaft([unit], theta, pressure, run.speed, run.acceleration, method=method).outputs[0])
    causes = tables.torque_by_cause(run.pressure[0], run.speed, run.acceleration)
    lost = pulls(outputs["contact_normal"])
    flights: tuple[Flight, ...] = ()
    if np.any(lost):
        flown = is_revolution(run.theta)
        if flown:
            motion = (run.speed, run.acceleration)
            flights, airborne = fly(pump, law, run.theta, run.pressure[0], motion, mounting)
            lost = lost | airborne
        causes = _without_contact(causes, outputs, lost, flown)
    return RigidTorque(
        theta=tables.kinematics.theta,
        torque=outputs["torque"],
        by_cause=causes,
        forces=_forces(pump, tables, outputs),
        lift=tables.kinematics.lift,
        lift_velocity=tables.kinematics.velocity,
        lift_acceleration=tables.kinematics.acceleration,
        contact_lost=bool(np.any(lost)),
        flights=flights,
    )


def _without_contact(
    causes: Mapping[str, Array], outputs: dict[str, Array], lost: Mask, flown: bool
) -> dict[str, Array]:
    """Return the causes, nothing but the cam's own inertia where contact is lost; writes torque and contact force."""
    kept = {name: np.where(lost, 0.0, values) for name, values in causes.items()}
    kept["inertia_cam"] = causes["inertia_cam"]
    outputs["torque"] = np.where(lost, causes["inertia_cam"] if flown else np.nan, outputs["torque"])
    outputs["contact_normal"] = np.where(lost, 0.0, outputs["contact_normal"])
    return kept


def forces_of(
    pump: PumpData, tables: ClosedForm, pressure: Array, speed: Array | float, acceleration: Array | float = 0.0
) -> Forces:
    """Return all forces of the rigid pump from its tables, each (n_theta,)."""
    return _forces(pump, tables, tables.all_outputs(pressure, speed, acceleration))


def _forces(pump: PumpData, tables: ClosedForm, outputs: Mapping[str, Array]) -> Forces:
    """Return the record; no contact force, and none passed on, where the cam would have to pull."""
    normal = np.maximum(outputs["contact_normal"], 0.0)
    none = normal <= 0.0
    lost_x, lost_y = (np.where(none, outputs[name], 0.0) for name in ("contact_x", "contact_y"))
    lever = tables.constants.lever * (tables.kinematics.centre_height - tables.constants.guide_height)
    hertz = hertz_pressure(tables.hertz_factor, normal)
    return Forces(
        contact_normal=normal,
        contact_tangential=np.where(none, 0.0, outputs["contact_tangential"]),
        bearing_x=outputs["bearing_x"] - lost_x,
        bearing_y=outputs["bearing_y"] - lost_y,
        guide=outputs["guide"] + lost_x,
        guide_moment=outputs["guide_moment"] - lever * lost_x,
        hertz=hertz,
        hertz_shear_max=SHEAR_VALUE * hertz,
        hertz_shear_depth=SHEAR_DEPTH * half_width(pump, hertz, tables.kinematics.relative_radius),
    )

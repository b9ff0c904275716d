"""What `mechanism` hands on: torque by cause and forces of the rigid pump."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from camtorque.records.base import Array, ReadOnly


@dataclass(frozen=True)
class Forces(ReadOnly):
    """Forces over the angle grid, each (n_theta,).

    contact_normal, contact_tangential, bearing_x, bearing_y, guide [N]; guide_moment [N m] about the guide's height,
    about the roller centre where none is given; hertz [Pa]; hertz_shear_max [Pa] and hertz_shear_depth [m] below the
    surface.
    """

    contact_normal: Array
    contact_tangential: Array
    bearing_x: Array
    bearing_y: Array
    guide: Array
    guide_moment: Array
    hertz: Array
    hertz_shear_max: Array
    hertz_shear_depth: Array


@dataclass(frozen=True)
class Flight:
    """One flight: angles of take-off and landing [rad], speed against the cam [m/s] and impulse of landing [N s]."""

    start: float
    landing: float
    speed: float
    impulse: float


@dataclass(frozen=True)
class RigidTorque(ReadOnly):
    """The rigid DeNOC solution on the angle grid.

    Attributes
    ----------
    torque : (n_theta,) driving torque [N m]
    by_cause : name -> (n_theta,) torque of pressure, spring, inertia, ... ; they sum to ``torque``
    forces : contact, joint forces and Hertz stress
    lift, lift_velocity, lift_acceleration : (n_theta,) y [m], y' [m/rad], y'' [m/rad^2]
    contact_lost : True where the follower leaves the cam anywhere
    flights : of the follower over a whole revolution
    """

    theta: Array
    torque: Array
    by_cause: Mapping[str, Array]
    forces: Forces
    lift: Array
    lift_velocity: Array
    lift_acceleration: Array
    contact_lost: bool
    flights: tuple[Flight, ...] = ()

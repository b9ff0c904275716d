"""The same mechanism by recursion: one sweep outward for the motion, one inward for the forces, O(n) in the links.

No matrix is formed: N_l and N_d are applied link by link (Saha 1999), and in the plane a wrench has the entries
(n_z, f_x, f_y). Sub-system II is swept from the roller to the guide, sub-system I from the last lobe to the drive end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.config import PumpData
from camtorque.mechanism.kinematics import Kinematics
from camtorque.mechanism.mounting import Mounting, assumed_roller, moving_mass
from camtorque.records import Array


@dataclass(frozen=True)
class FollowerSweep:
    """Forces of sub-system II in the running frame, each (n_theta,) [N]."""

    lambda_x: Array
    lambda_y: Array
    tangential: Array
    normal: Array
    pin_x: Array
    pin_y: Array
    guide_x: Array


def sweep_follower(
    pump: PumpData, path: Kinematics, force_along: Array, speed: Array, acceleration: Array, mounting: Mounting
) -> FollowerSweep:
    """Return the forces of one pump's follower and roller.

    Parameters
    ----------
    force_along : (n_theta,) spring and fluid force along Y1, negative when it presses the roller on the cam [N]
    speed, acceleration : (n_theta,) of the cam [rad/s, rad/s^2]
    """
    roller = assumed_roller(pump)
    gravity_x, gravity_y = mounting.rotation * mounting.gravity[0], mounting.gravity[1]
    # outward: follower, then roller
    follower_rise = path.acceleration * speed**2 + path.velocity * acceleration
    roller_spin = path.roller_ratio_slope * speed**2 + path.roller_ratio * acceleration
    # inward: the roller's moment about O2 gives the tangential force, the sum along Y1 the normal force
    tangential = roller.inertia * roller_spin / pump.roller_radius
    roller_y = roller.mass * (follower_rise - gravity_y)
    follower_y = (moving_mass(pump, mounting) - roller.mass) * (follower_rise - gravity_y) - force_along
    cosine = path.centre_height / path.pitch_arc
    sine = cosine * path.tan_pressure_angle
    normal = (roller_y + follower_y - tangential * sine) / cosine
    lambda_x = tangential * cosine - normal * sine
    lambda_y = normal * cosine + tangential * sine
    pin_x = -lambda_x - roller.mass * gravity_x
    pin_y = roller_y - lambda_y
    guide_x = pin_x - (moving_mass(pump, mounting) - roller.mass) * gravity_x
    return FollowerSweep(lambda_x, lambda_y, tangential, normal, pin_x, pin_y, guide_x)


def sweep_camshaft(
    pumps: list[PumpData], paths: list[Kinematics], sweeps: list[FollowerSweep], acceleration: Array
) -> Array:
    """Return the torque in the shaft before each lobe, drive end first, (n_pumps, n_theta) [N m]."""
    torque = np.zeros((len(pumps), paths[0].theta.size))
    carried = np.zeros(paths[0].theta.size)
    for i in range(len(pumps) - 1, -1, -1):
        contact_x, contact_y = paths[i].contact_point
        moment = contact_x * sweeps[i].lambda_y - contact_y * sweeps[i].lambda_x
        carried = carried + pumps[i].cam_inertia * acceleration + moment
        torque[i] = carried
    return torque

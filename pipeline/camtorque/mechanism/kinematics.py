"""Kinematics of cam and roller follower over cam angle, and a flat check of the pressure angle.

In the frame that runs with the cam (X1 turned over for negative rotation) with e the offset towards +X1::

    s = sqrt((r_b + r_r)^2 - e^2) + y        distance O1-O2 along Y1
    tan(phi) = (y' - e) / s                  pressure angle
    L = sqrt(s^2 + (y' - e)^2)               arc of the pitch curve per radian
    n = (-sin phi, cos phi), t = (cos phi, sin phi), Q = O2 - r_r n
    omega_2 = omega (1 - L / r_r)            pure rolling
    kappa = (s^2 + (y' - e)(2 y' - e) - s y'') / L^3

Paper Section 2.1 (after Sundarraman and Saha); curvature by differentiating O2 = (e, s) in the cam's frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from camtorque.compiled import elementwise
from camtorque.config import PumpData
from camtorque.mechanism.cam import CamLaw
from camtorque.records import Array, Mask, ReadOnly, Refusal
from camtorque.units import angle_grid


@dataclass(frozen=True)
class Kinematics(ReadOnly):
    """Positions and their derivatives with respect to cam angle, each (n_theta,), in the frame that runs with the cam.

    Attributes
    ----------
    theta : cam angle, any spacing [rad]
    lift, velocity, acceleration : y [m], y' [m/rad], y'' [m/rad^2]
    centre_height : s [m]
    pitch_arc : L [m/rad]
    tan_pressure_angle : tan(phi), positive where the cam pushes the follower towards -X1
    roller_ratio, roller_ratio_slope : omega_2 / omega, and its derivative [1/rad]
    pitch_curvature : kappa of the path of the roller centre, positive where convex [1/m]
    relative_radius : R of the Hertz contact, 1/R = 1/rho_cam + 1/r_r; negative where undercut [m]
    offset : e towards +X1 in this frame [m]
    """

    theta: Array
    lift: Array
    velocity: Array
    acceleration: Array
    centre_height: Array
    pitch_arc: Array
    tan_pressure_angle: Array
    roller_ratio: Array
    roller_ratio_slope: Array
    pitch_curvature: Array
    relative_radius: Array
    offset: float
    roller_radius: float

    @property
    def pressure_angle(self) -> Array:
        """Angle phi between follower axis and contact normal [rad]."""
        return np.arctan(self.tan_pressure_angle)

    @property
    def surface_curvature(self) -> Array:
        """Curvature 1/rho_cam of the cam surface [1/m]: positive convex, negative on a concave flank."""
        return self.pitch_curvature / (1.0 - self.roller_radius * self.pitch_curvature)

    @property
    def concave(self) -> Mask:
        """Where the cam surface is hollow: the roller has to be smaller than its radius."""
        return self.pitch_curvature < 0.0

    @property
    def undercut(self) -> Mask:
        """Where the pitch curve bends tighter than the roller, so that no cam can drive this lift."""
        return self.relative_radius <= 0.0

    @property
    def surface_arc(self) -> Array:
        """Length of cam surface that passes the contact per radian [m/rad]; times omega it is the rolling speed."""
        return self.pitch_arc * (1.0 - self.roller_radius * self.pitch_curvature)

    @property
    def contact_point(self) -> tuple[Array, Array]:
        """Contact point Q along X1 and Y1 [m]."""
        cosine = self.centre_height / self.pitch_arc
        sine = cosine * self.tan_pressure_angle
        return self.offset + self.roller_radius * sine, self.centre_height - self.roller_radius * cosine


def base_height(pump: PumpData) -> float:
    """Return s on the base circle, sqrt((r_b + r_r)^2 - e^2) [m].

    Raises
    ------
    Refusal : the offset is not smaller than the distance between the centres
    """
    distance = pump.base_circle_radius + pump.roller_radius
    if not abs(pump.follower_offset) < distance:
        raise Refusal(
            f"pump: follower offset {pump.follower_offset} m, expected less than the {distance} m between cam and "
            "roller centre on the base circle; check the sheet"
        )
    return float(np.sqrt(distance**2 - pump.follower_offset**2))


@elementwise(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def path_at(y, slope, curve, base, offset, radius):  # type: ignore[no-untyped-def]
    """Return s, tan phi, 1 / cos phi, q = 1 - L / r_r, q' and kappa at one cam angle from y, y', y''."""
    height = base + y
    lever = slope - offset
    arc = np.sqrt(height * height + lever * lever)
    curvature = (height * height + lever * (2.0 * slope - offset) - height * curve) / (arc * arc * arc)
    ratio_slope = -(height * slope + lever * curve) / (arc * radius)
    return height, lever / height, arc / height, 1.0 - arc / radius, ratio_slope, curvature


def kinematics(pump: PumpData, law: CamLaw, theta: Array, rotation: int = 1) -> Kinematics:
    """Return the kinematics of a pump at any cam angles.

    Parameters
    ----------
    theta : (n_theta,) any spacing [rad]
    rotation : +1 or -1; turning the shaft the other way mirrors the offset

    Raises
    ------
    Refusal : offset too large
    """
    angle = np.array(theta, dtype=np.float64)
    offset, radius = rotation * pump.follower_offset, pump.roller_radius
    lift = law.derivatives(angle, 2)
    height, tangent, secant, ratio, ratio_slope, curvature = path_at(*lift, base_height(pump), offset, radius)
    return Kinematics(
        theta=angle,
        lift=lift[0],
        velocity=lift[1],
        acceleration=lift[2],
        centre_height=height,
        pitch_arc=height * secant,
        tan_pressure_angle=tangent,
        roller_ratio=ratio,
        roller_ratio_slope=ratio_slope,
        pitch_curvature=curvature,
        relative_radius=radius * (1.0 - radius * curvature),
        offset=offset,
        roller_radius=radius,
    )


def flat_pressure_angle(pump: PumpData, law: CamLaw, rotation: int) -> tuple[float, float]:
    """Return bounds on the greatest and least pressure angle from the extreme velocity and the base height alone [rad].

    The flat check of a drawing: tan(phi) = (y'_max - e) / s_0 with the rise as if it lay on the base circle. It can
    only overstate the angle, since s >= s_0; beside an offset beyond the velocity the full lift bounds it instead.
    """
    velocity = law.evaluate(angle_grid(3600), 1)
    steep, back = np.array([velocity.max(), velocity.min()]) - rotation * pump.follower_offset
    low = base_height(pump)
    high = low + law.lift
    steep, back = steep / (low if steep > 0.0 else high), back / (low if back < 0.0 else high)
    return float(np.arctan(steep)), float(np.arctan(back))

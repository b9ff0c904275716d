"""The closed form of the mechanics, friction included: one compiled function that everything else calls.

Solved by hand from sub-system II, then I (paper Section 2.1), with q = 1 - L / r_r::

    lambda_y = (m (y'' omega^2 + y' alpha) + f_s0 + k y + A p - m g_y) / (1 - mu_g |tan phi| sign y')
    F_t      = (I_r omega_2' - a_pin lambda_y / cos phi) / r_r,     omega_2' = q' omega^2 + q alpha
    F_n      = (lambda_y - F_t sin phi) / cos phi
    lambda_x = -F_n sin phi + F_t cos phi
    tau      = I_c alpha + lambda_y y' + F_t r_r q + a_bearing lambda_y / cos phi

The loads that friction is in proportion to are those of lambda_y alone: the side force ``lambda_y |tan phi|`` on the
guide and ``lambda_y / cos phi`` on bearings and pin (the roller's inertia and the weights add a thousandth). While the
roller rests on the cam every output is then exactly ``x0 + x1 p + x2 omega^2 + x3 alpha``: a table made once serves
every cycle, speed and load.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from camtorque.compiled import elementwise, njit
from camtorque.config import PumpData
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.contact import ContactLoss, hertz_factor, hertz_pressure, jump_speed
from camtorque.mechanism.friction import NO_FRICTION, Friction, guide_gain, guide_share, refuse_jammed
from camtorque.mechanism.kinematics import Kinematics, base_height, kinematics, path_at
from camtorque.mechanism.mounting import NO_GRAVITY, Mounting, assumed_roller, moving_mass
from camtorque.records import Array, ReadOnly

OUTPUTS = (
    "torque",
    "contact_normal",
    "contact_tangential",
    "contact_x",
    "contact_y",
    "bearing_x",
    "bearing_y",
    "guide",
    "guide_moment",
    "pin_x",
    "pin_y",
)
"""What the closed form gives, in this order; signs in `ClosedForm`."""


class Constants(NamedTuple):
    """The numbers of a pump as the compiled functions read them; weights are what gravity puts on each joint."""

    area: float
    preload: float
    weight: float
    stiffness: float
    mass: float
    cam_inertia: float
    roller_inertia: float
    roller_mass: float
    base: float
    offset: float
    radius: float
    turn: float
    lever: float
    guide_height: float
    weight_bearing_x: float
    weight_bearing_y: float
    weight_guide: float
    weight_pin_x: float
    weight_pin_y: float
    guide_friction: float
    bearing_arm: float
    pin_arm: float


def constants_of(pump: PumpData, mounting: Mounting, friction: Friction) -> Constants:
    """Return the numbers of a pump; the offset is that of the frame that runs with the cam.

    Raises
    ------
    Refusal : the offset is not smaller than the distance between the centres
    """
    roller, mass, (gravity_x, gravity_y) = assumed_roller(pump), moving_mass(pump, mounting), mounting.gravity
    height = mounting.guide_height
    return Constants(
        area=float(pump.plunger_area),
        preload=float(pump.spring_preload),
        weight=float(-mass * gravity_y),
        stiffness=float(pump.spring_stiffness),
        mass=float(mass),
        cam_inertia=float(pump.cam_inertia),
        roller_inertia=roller.inertia,
        roller_mass=roller.mass,
        base=base_height(pump),
        offset=float(mounting.rotation * pump.follower_offset),
        radius=float(pump.roller_radius),
        turn=float(mounting.rotation),
        lever=0.0 if height is None else 1.0,
        guide_height=0.0 if height is None else float(height),
        weight_bearing_x=float(-pump.cam_mass * gravity_x),
        weight_bearing_y=float(-pump.cam_mass * gravity_y),
        weight_guide=float(-mass * gravity_x),
        weight_pin_x=float(-roller.mass * gravity_x),
        weight_pin_y=float(-roller.mass * gravity_y),
        guide_friction=float(friction.guide),
        bearing_arm=float(friction.bearing_arm),
        pin_arm=float(friction.pin_arm),
    )


@elementwise(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def axial_force(c, one, load, rise, y):  # type: ignore[no-untyped-def]
    """Return what spring, weight, pressure and the acceleration ``rise`` [m/s^2] put on the follower [N]."""
    return one * (c.preload + c.weight + c.stiffness * y) + c.area * load + c.mass * rise


@elementwise(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def joint_forces(c, one, along, across, rise, alpha, height, slope, tangent, secant):  # type: ignore[no-untyped-def]
    """Return all of `OUTPUTS` from lambda_y and F_t; ``one`` is 0 where the factor of a load is wanted, not a force."""
    contact_x = c.turn * (across * secant - along * tangent)
    guide = one * c.weight_guide - contact_x
    rubbing = along * c.bearing_arm * secant
    # F_t r_r q = F_t (r_r - L) with L = s / cos phi
    contact = along * slope + across * (c.radius - height * secant)
    torque = c.cam_inertia * alpha + contact + rubbing
    return (
        torque,
        along * secant - across * tangent,
        across,
        contact_x,
        along,
        contact_x + one * c.weight_bearing_x,
        along + one * c.weight_bearing_y,
        guide,
        (c.guide_height - height) * c.lever * guide,
        one * c.weight_pin_x - contact_x,
        c.roller_mass * rise + one * c.weight_pin_y - along,
    )


@elementwise(cache=True, error_model="numpy", fastmath={"contract", "nsz"})
def solve_angle(c, one, load, squared, alpha, y, slope, curve, path):  # type: ignore[no-untyped-def]
    """Return all of `OUTPUTS` at one cam angle; linear in (one, pressure, omega^2, alpha)."""
    height, tangent, secant, ratio, ratio_slope, _ = path
    rise = curve * squared + slope * alpha
    along = axial_force(c, one, load, rise, y) * guide_gain(tangent, slope, c.guide_friction)
    spin = ratio_slope * squared + ratio * alpha
    across = (c.roller_inertia * spin - c.pin_arm * secant * along) / c.radius
    return joint_forces(c, one, along, across, rise, alpha, height, slope, tangent, secant)


@njit(cache=True, error_model="numpy")
def _store(out, i, v):  # type: ignore[no-untyped-def]
    """Write all outputs of one angle; a loop over the tuple would keep the compiler from solving several at once."""
    out[0, i], out[1, i], out[2, i], out[3, i], out[4, i], out[5, i] = v[0], v[1], v[2], v[3], v[4], v[5]
    out[6, i], out[7, i], out[8, i], out[9, i], out[10, i] = v[6], v[7], v[8], v[9], v[10]


@njit(cache=True, error_model="numpy")
def _outputs(c, lift, pressure, speed, acceleration, out):  # type: ignore[no-untyped-def]
    """Write all of `OUTPUTS` (11, n) from the lift with two derivatives (3, n) and loads (n,)."""
    for i in range(pressure.size):
        y, slope, curve = lift[0, i], lift[1, i], lift[2, i]
        path = path_at(y, slope, curve, c.base, c.offset, c.radius)
        squared = speed[i] * speed[i]
        v = solve_angle(c, 1.0, pressure[i], squared, acceleration[i], y, slope, curve, path)
        _store(out, i, v)


def _tables(c: Constants, lift: Array) -> Array:
    """Return the factors of 1, p, omega^2 and alpha in all of `OUTPUTS`, (11, 4, n), from the lift (3, n)."""
    path, out = path_at(*lift, c.base, c.offset, c.radius), np.empty((len(OUTPUTS), 4, lift.shape[1]))
    for k, unit in enumerate(np.eye(4)):
        for row, values in zip(out[:, k], solve_angle(c, *unit, *lift, path), strict=True):
            row[:] = values
    return out


@dataclass(frozen=True)
class ClosedForm(ReadOnly):
    """The closed form of one pump tabulated on one set of cam angles.

    Attributes
    ----------
    outputs : name of `OUTPUTS` -> (4, n_theta) factors of 1, pressure [Pa], omega^2 [rad^2/s^2], alpha [rad/s^2].
        ``contact_normal``, ``contact_tangential`` act on the roller along n and t of the running frame (see
        `kinematics`). All others are along X1 and Y1 in space: ``contact_x``, ``contact_y`` on the roller (the Lagrange
        multipliers), ``bearing_*`` of the bearing on the camshaft, ``guide`` of the guide on the follower along X1,
        ``guide_moment`` on the follower about the point of `Mounting.guide_height` (counter-clockwise), ``pin_*`` of
        the follower on the roller.
    hertz_factor : (n_theta,) p0 = hertz_factor * sqrt(contact_normal) [Pa/sqrt(N)]
    constants : what the compiled functions read
    """

    kinematics: Kinematics
    outputs: Mapping[str, Array]
    hertz_factor: Array
    constants: Constants

    def torque_by_cause(self, pressure: Array, speed: Array | float, acceleration: Array | float) -> dict[str, Array]:
        """Return the torque of each cause, and of each friction that there is [N m]; they sum to the torque."""
        c, path, load = self.constants, self.kinematics, self.outputs["contact_y"]
        y1, zero = path.velocity, np.zeros_like(path.lift)
        ratio, slope = path.roller_ratio, path.roller_ratio_slope
        spring = y1 * (c.preload + c.stiffness * path.lift)
        rows = {
            "pressure": (zero, y1 * c.area, zero, zero),
            "spring": (spring, zero, zero, zero),
            "inertia_follower": (zero, zero, c.mass * y1 * path.acceleration, c.mass * y1 * y1),
            "inertia_cam": (zero, zero, zero, zero + c.cam_inertia),
            "inertia_roller": (zero, zero, c.roller_inertia * ratio * slope, c.roller_inertia * ratio * ratio),
            "gravity": (c.weight * y1, zero, zero, zero),
        }
        causes = {name: np.stack(row) for name, row in rows.items()}
        if max(c.guide_friction, c.bearing_arm, c.pin_arm) > 0.0:
            normal = load * path.pitch_arc / path.centre_height
            causes["guide_friction"] = c.guide_friction * guide_share(path.tan_pressure_angle, y1) * load * y1
            causes["bearing_friction"] = c.bearing_arm * normal
            causes["pin_friction"] = -c.pin_arm * normal * ratio
        return {name: combine(table, pressure, speed, acceleration) for name, table in causes.items()}

    def evaluate(self, name: str, pressure: Array, speed: Array | float, acceleration: Array | float = 0.0) -> Array:
        """Return one output; arguments broadcast against (n_theta,), so (n_cycles, n_theta) and (n_cycles, 1) do."""
        return combine(self.outputs[name], pressure, speed, acceleration)

    def all_outputs(self, pressure: Array, speed: Array | float, acceleration: Array | float) -> dict[str, Array]:
        """Return every output by name."""
        return {name: self.evaluate(name, pressure, speed, acceleration) for name in self.outputs}

    def hertz(self, pressure: Array, speed: Array | float) -> Array:
        """Return the greatest Hertz pressure at constant speed [Pa], 0 without contact, nan where undercut."""
        return hertz_pressure(self.hertz_factor, self.evaluate("contact_normal", pressure, speed))

    def jump(self, pressure: Array | float = 0.0) -> ContactLoss:
        """Return the lowest constant speed at which the follower leaves the cam under this pressure."""
        table = self.outputs["contact_normal"]
        return jump_speed(self.kinematics.theta, table[0] + table[1] * pressure, table[2])


def combine(table: Array, pressure: Array, speed: Array | float, acceleration: Array | float) -> Array:
    """Return x0 + x1 p + x2 omega^2 + x3 alpha."""
    return table[0] + table[1] * pressure + table[2] * np.square(speed) + table[3] * acceleration


def closed_form_tables(
    pump: PumpData, law: CamLaw, theta: Array, mounting: Mounting = NO_GRAVITY, friction: Friction = NO_FRICTION
) -> ClosedForm:
    """Return the tables of a pump at any cam angles.

    Parameters
    ----------
    theta : (n_theta,) cam angle, any spacing, any range [rad]
    mounting : direction of running, gravity, guide point; positive rotation without gravity where none is given

    Raises
    ------
    Refusal : offset too large, or a guide friction that jams the follower
    """
    path = kinematics(pump, law, theta, mounting.rotation)
    refuse_jammed(path, friction)
    constants = constants_of(pump, mounting, friction)
    out = _tables(constants, np.stack([path.lift, path.velocity, path.acceleration]))
    factor = hertz_factor(pump, path.relative_radius)
    outputs = dict(zip(OUTPUTS, out, strict=True))
    return ClosedForm(path, outputs, factor, constants)


def solve_lift(constants: Constants, lift: Array, pressure: Array, speed: Array, acceleration: Array) -> Array:
    """Return all of `OUTPUTS` where the lift is known, (11, n); no tables in between.

    Parameters
    ----------
    lift : (3, n) lift with its first two derivatives [m/rad^k]
    pressure, speed, acceleration : (n,) [Pa, rad/s, rad/s^2]
    """
    out = np.empty((len(OUTPUTS), lift.shape[1]))
    # a value that is repeated by a stride of zero would be read one at a time
    load, rate, change = (np.ascontiguousarray(row) for row in (pressure, speed, acceleration))
    _outputs(constants, lift, load, rate, change, out)
    return out

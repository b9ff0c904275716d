"""The rigid solution tabulated over cam angle: every output is exactly x0 + x1 p + x2 omega^2 + x3 alpha.

The kinematics depend on cam angle alone and the equations of motion are linear in pressure, omega^2 and alpha, so that
a table made once serves every cycle, speed and load. Solved by hand from sub-system II, then I (paper Section 2.1)::

    lambda_y = m (y'' omega^2 + y' alpha) + f_s0 + k y + A p - m g_y
    F_t      = I_r omega_2' / r_r,           omega_2' = q' omega^2 + q alpha,  q = 1 - L / r_r
    F_n      = (lambda_y - F_t sin phi) / cos phi
    lambda_x = -F_n sin phi + F_t cos phi
    tau      = I_c alpha + lambda_y y' + I_r omega_2' q
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from camtorque.config import PumpData
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.contact import ContactLoss, hertz_factor, hertz_pressure, jump_speed
from camtorque.mechanism.kinematics import Kinematics, kinematics
from camtorque.mechanism.mounting import Mounting, Roller, assumed_roller, moving_mass
from camtorque.records import Array, freeze_arrays

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
"""What a table holds; signs in `ClosedForm`."""
CAUSES = ("pressure", "spring", "inertia_follower", "inertia_cam", "inertia_roller", "gravity")


@dataclass(frozen=True)
class ClosedForm:
    """The tables of one pump on one set of cam angles.

    Attributes
    ----------
    outputs : name of `OUTPUTS` -> (4, n_theta) factors of 1, pressure [Pa], omega^2 [rad^2/s^2], alpha [rad/s^2].
        ``contact_normal``, ``contact_tangential`` act on the roller along n and t of the running frame (see
        `kinematics`). All others are along X1 and Y1 in space: ``contact_x``, ``contact_y`` on the roller (the Lagrange
        multipliers), ``bearing_*`` of the bearing on the camshaft, ``guide`` of the guide on the follower along X1,
        ``guide_moment`` on the follower about the point of `Mounting.guide_height` (counter-clockwise), ``pin_*`` of
        the follower on the roller.
    causes : name of `CAUSES` -> (4, n_theta) factors of its share of the torque
    hertz_factor : (n_theta,) p0 = hertz_factor * sqrt(contact_normal) [Pa/sqrt(N)]
    """

    kinematics: Kinematics
    outputs: Mapping[str, Array]
    causes: Mapping[str, Array]
    hertz_factor: Array
    roller: Roller
    mounting: Mounting

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def theta(self) -> Array:
        """Cam angles of the tables [rad]."""
        return self.kinematics.theta

    def evaluate(self, name: str, pressure: Array, speed: Array | float, acceleration: Array | float = 0.0) -> Array:
        """Return one output; arguments broadcast against (n_theta,), so (n_cycles, n_theta) and (n_cycles, 1) do."""
        return combine(self.outputs[name], pressure, speed, acceleration)

    def all_outputs(self, pressure: Array, speed: Array | float, acceleration: Array | float = 0.0) -> dict[str, Array]:
        """Return every output by name."""
        return {name: self.evaluate(name, pressure, speed, acceleration) for name in self.outputs}

    def torque_by_cause(
        self, pressure: Array, speed: Array | float, acceleration: Array | float = 0.0
    ) -> dict[str, Array]:
        """Return the share of each cause in the torque [N m]; they sum to the torque."""
        return {name: combine(table, pressure, speed, acceleration) for name, table in self.causes.items()}

    def hertz(self, pressure: Array, speed: Array | float, acceleration: Array | float = 0.0) -> Array:
        """Return the greatest Hertz pressure [Pa], 0 without contact, nan where undercut."""
        return hertz_pressure(self.hertz_factor, self.evaluate("contact_normal", pressure, speed, acceleration))

    def jump(self, pressure: Array | float = 0.0) -> ContactLoss:
        """Return the lowest constant speed at which the follower leaves the cam under this pressure."""
        table = self.outputs["contact_normal"]
        return jump_speed(self.theta, table[0] + table[1] * pressure, table[2])


def combine(table: Array, pressure: Array, speed: Array | float, acceleration: Array | float) -> Array:
    """Return x0 + x1 p + x2 omega^2 + x3 alpha."""
    return table[0] + table[1] * pressure + table[2] * np.square(speed) + table[3] * acceleration


def _causes(pump: PumpData, path: Kinematics, mounting: Mounting, roller: Roller) -> dict[str, Array]:
    """Return the torque tables by cause, tau = sum of cause."""
    mass, y1, zero = moving_mass(pump, mounting), path.velocity, np.zeros_like(path.lift)
    spring = y1 * (pump.spring_preload + pump.spring_stiffness * path.lift)
    ratio, slope = path.roller_ratio, path.roller_ratio_slope
    rows = {
        "pressure": (zero, y1 * pump.plunger_area, zero, zero),
        "spring": (spring, zero, zero, zero),
        "inertia_follower": (zero, zero, mass * y1 * path.acceleration, mass * y1 * y1),
        "inertia_cam": (zero, zero, zero, zero + pump.cam_inertia),
        "inertia_roller": (zero, zero, roller.inertia * ratio * slope, roller.inertia * ratio * ratio),
        "gravity": (-mass * mounting.gravity[1] * y1, zero, zero, zero),
    }
    return {name: np.stack(row) for name, row in rows.items()}


def sum_of(tables: Mapping[str, Array]) -> Array:
    """Return the sum of tables (pairwise by hand: a reduction over a stack costs several times as much)."""
    total = np.zeros_like(next(iter(tables.values())))
    for table in tables.values():
        total += table
    return total


def _multipliers(pump: PumpData, path: Kinematics, mounting: Mounting, roller: Roller) -> tuple[Array, Array]:
    """Return the tables of lambda_y and of the tangential force."""
    mass, zero = moving_mass(pump, mounting), np.zeros_like(path.lift)
    at_rest = pump.spring_preload + pump.spring_stiffness * path.lift - mass * mounting.gravity[1]
    along = np.stack([at_rest, zero + pump.plunger_area, mass * path.acceleration, mass * path.velocity])
    turning = roller.inertia / pump.roller_radius
    return along, np.stack([zero, zero, turning * path.roller_ratio_slope, turning * path.roller_ratio])


def _constant(table: Array, value: float) -> Array:
    """Return a table with a constant added to its part at rest."""
    if value == 0.0:
        return table
    shifted = table.copy()
    shifted[0] += value
    return shifted


def _outputs(pump: PumpData, path: Kinematics, mounting: Mounting, roller: Roller, torque: Array) -> dict[str, Array]:
    """Return the tables of all outputs; X1 is turned back into space by the sign of rotation."""
    turn, (gravity_x, gravity_y) = mounting.rotation, mounting.gravity
    mass, secant = moving_mass(pump, mounting), path.pitch_arc / path.centre_height
    along, tangential = _multipliers(pump, path, mounting, roller)
    contact_x = turn * (tangential * secant - along * path.tan_pressure_angle)
    guide = _constant(-contact_x, -mass * gravity_x)
    lever = 0.0 if mounting.guide_height is None else path.centre_height - mounting.guide_height
    roller_inertia = np.stack(
        [
            np.zeros_like(path.lift),
            np.zeros_like(path.lift),
            roller.mass * path.acceleration,
            roller.mass * path.velocity,
        ]
    )
    return {
        "torque": torque,
        "contact_normal": along * secant - tangential * path.tan_pressure_angle,
        "contact_tangential": tangential,
        "contact_x": contact_x,
        "contact_y": along,
        "bearing_x": _constant(contact_x, -pump.cam_mass * gravity_x),
        "bearing_y": _constant(along, -pump.cam_mass * gravity_y),
        "guide": guide,
        "guide_moment": -lever * guide,
        "pin_x": _constant(-contact_x, -roller.mass * gravity_x),
        "pin_y": _constant(roller_inertia - along, -roller.mass * gravity_y),
    }


def closed_form_tables(pump: PumpData, law: CamLaw, theta: Array, mounting: Mounting | None = None) -> ClosedForm:
    """Return the tables of a pump at any cam angles.

    Parameters
    ----------
    theta : (n_theta,) cam angle, any spacing, any range [rad]
    mounting : direction of running, gravity, guide point; positive rotation without gravity when None
    """
    mounting = Mounting() if mounting is None else mounting
    roller = assumed_roller(pump)
    path = kinematics(pump, law, theta, mounting.rotation)
    causes = _causes(pump, path, mounting, roller)
    outputs = _outputs(pump, path, mounting, roller, sum_of(causes))
    return ClosedForm(path, outputs, causes, hertz_factor(pump, path.relative_radius), roller, mounting)

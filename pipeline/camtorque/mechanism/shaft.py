"""Several pumps on one rigid shaft by each of `METHODS`; one pump is a shaft with one lobe."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from camtorque.mechanism import denoc
from camtorque.mechanism.friction import refuse_jammed
from camtorque.mechanism.kinematics import Kinematics, kinematics
from camtorque.mechanism.mounting import PumpUnit, assumed_roller, moving_mass
from camtorque.mechanism.torque import OUTPUTS, constants_of, solve_lift
from camtorque.records import Array, ReadOnly, Refusal


@dataclass(frozen=True)
class ShaftMotion:
    """Prescribed motion and load: theta (n_theta,), pressure (n_pumps, n_theta), speed and acceleration (n_theta,)."""

    theta: Array
    pressure: Array
    speed: Array
    acceleration: Array


@dataclass(frozen=True)
class ShaftForces(ReadOnly):
    """The solution of a shaft.

    Attributes
    ----------
    torque : (n_theta,) at the drive end [N m]
    section_torque : (n_pumps, n_theta) in the shaft just before each lobe, drive end first [N m]
    outputs : per pump, name of `torque.OUTPUTS` -> (n_theta,); its ``torque`` is the share of that lobe
    """

    torque: Array
    section_torque: Array
    outputs: tuple[Mapping[str, Array], ...]


Units = Sequence[PumpUnit]
FollowerForces = dict[str, Array]
"""Forces of sub-system II by the names of `torque.OUTPUTS`, in the running frame, each (n_theta,) [N]."""
ACROSS = ("contact_x", "pin_x", "guide")
"""Those of them that lie along X1, which turns over with the direction of running."""


def _paths(units: Units, motion: ShaftMotion) -> list[Kinematics]:
    """Return the kinematics of every pump at its own cam angle, theta - phase."""
    return [kinematics(u.pump, u.law, motion.theta - u.phase, u.mounting.rotation) for u in units]


def _force_along(unit: PumpUnit, path: Kinematics, pressure: Array) -> Array:
    """Return spring and fluid force along Y1 on the follower, -(f_s0 + k y + A p) [N]."""
    pump = unit.pump
    return -(pump.spring_preload + pump.spring_stiffness * path.lift + pump.plunger_area * pressure)


def _in_space(unit: PumpUnit, path: Kinematics, forces: FollowerForces, torque: Array) -> dict[str, Array]:
    """Return all outputs in space from the torque and the forces in the running frame."""
    mounting, height = unit.mounting, unit.mounting.guide_height
    found = {name: mounting.rotation * force if name in ACROSS else force for name, force in forces.items()}
    weight_x, weight_y = (unit.pump.cam_mass * gravity for gravity in mounting.gravity)
    return {
        **found,
        "torque": torque,
        "bearing_x": found["contact_x"] - weight_x,
        "bearing_y": found["contact_y"] - weight_y,
        "guide_moment": -(0.0 if height is None else path.centre_height - height) * found["guide"],
    }


def solve_by_matrix(units: Units, motion: ShaftMotion) -> ShaftForces:
    """Solve sub-system II of every pump, then I, with the matrices of `denoc`."""
    paths = _paths(units, motion)
    sweeps = [_matrix_follower(u, path, p, motion) for u, path, p in zip(units, paths, motion.pressure, strict=True)]
    chain = denoc.camshaft_chain([unit.pump for unit in units])
    # a rigid shaft: joint 1 turns, the joints between the lobes stand still
    rate, change = np.zeros((2, motion.theta.size, len(units)))
    rate[:, 0], change[:, 0] = motion.speed, motion.acceleration
    applied = np.zeros((motion.theta.size, 6 * len(units)))
    for i, (path, sweep) in enumerate(zip(paths, sweeps, strict=True)):
        arm = _planar(*path.contact_point)
        applied[:, 6 * i : 6 * i + 6] = denoc.point_force(arm, -_planar(sweep["contact_x"], sweep["contact_y"]))
    inertia = denoc.inertia_wrench(chain, rate, change)
    section = ((inertia - applied) @ chain.complement).T
    return _assemble(units, paths, sweeps, section)


def _matrix_follower(unit: PumpUnit, path: Kinematics, pressure: Array, motion: ShaftMotion) -> FollowerForces:
    """Return the forces of sub-system II from the two Lagrange multipliers and the free bodies."""
    chain = denoc.follower_chain(unit.pump, unit.mounting)
    inertia = denoc.inertia_wrench(chain, *denoc.follower_rates(path, motion.speed, motion.acceleration))
    gravity = np.array([unit.mounting.rotation * unit.mounting.gravity[0], unit.mounting.gravity[1], 0.0])
    external = denoc.external_wrench(chain, _force_along(unit, path, pressure), gravity)
    contact_x, contact_y = path.contact_point
    basis = denoc.cut_wrench_basis(_planar(contact_x - path.offset, contact_y - path.centre_height))
    multipliers = denoc.lagrange_multipliers(chain, inertia, external, basis)
    cut = (basis @ multipliers[:, :, None])[:, :, 0]
    reaction = denoc.joint_reactions(chain, inertia, external + cut)
    cosine = path.centre_height / path.pitch_arc
    sine = cosine * path.tan_pressure_angle
    lambda_x, lambda_y = multipliers.T
    return {
        "contact_x": lambda_x,
        "contact_y": lambda_y,
        "contact_tangential": lambda_x * cosine + lambda_y * sine,
        "contact_normal": lambda_y * cosine - lambda_x * sine,
        "pin_x": reaction[:, 1, 3],
        "pin_y": reaction[:, 1, 4],
        "guide": reaction[:, 0, 3],
    }


def _planar(x: Array, y: Array) -> Array:
    """Return (n_theta, 3) vectors in the plane."""
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def solve_by_recursion(units: Units, motion: ShaftMotion) -> ShaftForces:
    """Solve every pump by one sweep outward for the motion and one inward for the forces, O(n) in the links.

    No matrix is formed: N_l and N_d are applied link by link (Saha 1999), and in the plane a wrench has the entries
    (n_z, f_x, f_y). Sub-system II is swept from the roller to the guide, sub-system I from the last lobe to the drive
    end; cost grows with the number of pumps, not with its square.
    """
    paths = _paths(units, motion)
    sweeps = [_sweep_follower(u, path, p, motion) for u, path, p in zip(units, paths, motion.pressure, strict=True)]
    section, carried = np.zeros((len(units), motion.theta.size)), np.zeros(motion.theta.size)
    for i in range(len(units) - 1, -1, -1):
        contact_x, contact_y = paths[i].contact_point
        moment = contact_x * sweeps[i]["contact_y"] - contact_y * sweeps[i]["contact_x"]
        carried = carried + units[i].pump.cam_inertia * motion.acceleration + moment
        section[i] = carried
    return _assemble(units, paths, sweeps, section)


def _sweep_follower(unit: PumpUnit, path: Kinematics, pressure: Array, motion: ShaftMotion) -> FollowerForces:
    """Return the forces of sub-system II link by link."""
    pump, roller = unit.pump, assumed_roller(unit.pump)
    gravity_x, gravity_y = unit.mounting.rotation * unit.mounting.gravity[0], unit.mounting.gravity[1]
    # outward: follower, then roller
    follower_rise, roller_spin = denoc.follower_rates(path, motion.speed, motion.acceleration)[1].T
    # inward: the roller's moment about O2 gives the tangential force, the sum along Y1 the normal force
    tangential = roller.inertia * roller_spin / pump.roller_radius
    alone = moving_mass(pump, unit.mounting) - roller.mass
    roller_y = roller.mass * (follower_rise - gravity_y)
    follower_y = alone * (follower_rise - gravity_y) - _force_along(unit, path, pressure)
    cosine = path.centre_height / path.pitch_arc
    sine = cosine * path.tan_pressure_angle
    normal = (roller_y + follower_y - tangential * sine) / cosine
    lambda_x = tangential * cosine - normal * sine
    lambda_y = normal * cosine + tangential * sine
    pin_x = -lambda_x - roller.mass * gravity_x
    return {
        "contact_x": lambda_x, "contact_y": lambda_y, "contact_tangential": tangential, "contact_normal": normal,
        "pin_x": pin_x, "pin_y": roller_y - lambda_y, "guide": pin_x - alone * gravity_x,
    }  # fmt: skip


def _assemble(units: Units, paths: list[Kinematics], sweeps: list[FollowerForces], section: Array) -> ShaftForces:
    """Return the record; the share of a lobe is the step of the shaft torque across it."""
    share = section - np.concatenate([section[1:], np.zeros((1, section.shape[1]))])
    return ShaftForces(section[0], section, tuple(map(_in_space, units, paths, sweeps, share)))


def solve_closed(units: Units, motion: ShaftMotion) -> ShaftForces:
    """Solve every pump by the closed form, the only method that knows friction."""
    outputs = []
    for unit, pressure in zip(units, motion.pressure, strict=True):
        angle = motion.theta - unit.phase
        if unit.friction.guide > 0.0:
            refuse_jammed(kinematics(unit.pump, unit.law, angle, unit.mounting.rotation), unit.friction)
        lift = unit.law.compiled_derivatives(angle, 2)
        constants = constants_of(unit.pump, unit.mounting, unit.friction)
        solved = solve_lift(constants, lift, pressure, motion.speed, motion.acceleration)
        outputs.append(dict(zip(OUTPUTS, solved, strict=True)))
    section = np.cumsum([out["torque"] for out in outputs][::-1], axis=0)[::-1]
    return ShaftForces(section[0], section, tuple(outputs))


METHODS: dict[str, Callable[[Units, ShaftMotion], ShaftForces]] = {
    "closed": solve_closed,
    "recursion": solve_by_recursion,
    "denoc": solve_by_matrix,
}
"""Three ways to the same numbers: the closed form that everything else uses, the recursion over the links, and the
matrices of the source paper (docs/mechanism_speed.md). The latter two are frictionless, as the paper is."""


def solve_shaft(
    units: Units,
    theta: Array,
    pressure: Array,
    speed: Array | float,
    acceleration: Array | float | None = None,
    *,
    method: str = "closed",
) -> ShaftForces:
    """Return torque and forces of several pumps on one rigid shaft.

    Parameters
    ----------
    units : pumps from the drive end outward
    theta : (n_theta,) shaft angle, any spacing [rad]
    pressure : broadcast to (n_pumps, n_theta); row i over shaft angle on the plunger of pump i, gauge [Pa]
    speed : (n_theta,) or scalar [rad/s]
    acceleration : (n_theta,) or scalar [rad/s^2]; None only where the speed is constant within the revolution

    Raises
    ------
    Refusal : unknown method, no pump, friction with a frictionless method, a follower that jams, or a varying speed
        without its acceleration
    """
    if method not in METHODS:
        raise Refusal(f"mechanism: method {method!r} is unknown, expected one of {', '.join(METHODS)}")
    if method != "closed" and not all(unit.friction.none for unit in units):
        raise Refusal(f"mechanism: method {method!r} is frictionless, found friction; use 'closed', or leave it out")
    if len(units) == 0:
        raise Refusal("mechanism: a shaft without pumps, expected at least one; name the pumps on the shaft")
    return METHODS[method](units, prescribed_motion(len(units), theta, pressure, speed, acceleration))


def prescribed_motion(
    pumps: int, theta: Array, pressure: Array, speed: Array | float, acceleration: Array | float | None
) -> ShaftMotion:
    """Return motion and load on the angles; refuses a varying speed without its acceleration (see `solve_shaft`)."""
    angle = np.asarray(theta, dtype=np.float64)
    rate = np.broadcast_to(np.asarray(speed, dtype=np.float64), angle.shape)
    if acceleration is None and np.ptp(rate) > 0.0:
        raise Refusal(
            f"mechanism: speed varies from {rate.min():.6g} to {rate.max():.6g} rad/s without an acceleration; "
            "give it (omega d omega / d theta), or one constant speed"
        )
    change = np.broadcast_to(np.asarray(0.0 if acceleration is None else acceleration), angle.shape)
    load = np.broadcast_to(np.asarray(pressure, dtype=np.float64), (pumps, angle.size))
    return ShaftMotion(angle, load, rate, change)

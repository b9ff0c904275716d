"""Chart 2: inverse dynamics of one pump by the package's methods and by the engines of the ``validation`` extra."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from camtorque.mechanism.cam import by_pieces
from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.shaft import METHODS, solve_shaft
from camtorque.mechanism.torque import ClosedForm, closed_form_tables
from camtorque.records import Array
from camtorque.studies.case import SPEED, peak_error, study_law, study_pressure, study_pump
from camtorque.studies.table import Chart, Choice, measured
from camtorque.units import angle_grid

ANGLES = 3600
CYCLES = 50
ENGINE_ANGLES = 300
LEAST = 1.0e-17
DEFAULT = "closed"
"""What commands solve with; tables that are made once are the floor under it, and serve no command."""

MUJOCO_XML = """<mujoco><compiler inertiafromgeom="false"/><option gravity="0 0 0"><flag contact="disable"/></option>
<worldbody><body><joint type="hinge" axis="0 0 1"/>
<inertial pos="0 0 0" mass="{cam_mass!r}" diaginertia="{cam!r} {cam!r} {cam!r}"/></body>
<body><joint type="slide" axis="0 1 0"/><inertial pos="0 0 0" mass="{rest!r}" diaginertia="1e-6 1e-6 1e-6"/>
<body><joint type="hinge" axis="0 0 1"/>
<inertial pos="0 0 0" mass="{roller!r}" diaginertia="{spin!r} {spin!r} {spin!r}"/></body></body>
</worldbody></mujoco>"""


def extended_torque(theta: Array) -> Array:
    """Return the torque in extended precision, from the polynomials of the law and the equations of the closed form."""
    law, pump = study_law(), study_pump()
    wide = np.longdouble
    piece = np.clip(np.searchsorted(law.knots, theta, side="right") - 1, 0, law.knots.size - 2)
    local = theta.astype(wide) - law.knots.astype(wide)[piece]
    y, y1, y2 = by_pieces(law.coefficients.astype(wide)[:, piece], local, 2)
    offset, radius = wide(pump.follower_offset), wide(pump.roller_radius)
    s = np.sqrt(wide(pump.base_circle_radius + pump.roller_radius) ** 2 - offset**2) + y
    arc = np.sqrt(s * s + (y1 - offset) ** 2)
    ratio, slope = 1 - arc / radius, -(s * y1 + (y1 - offset) * y2) / arc / radius
    squared = wide(SPEED) ** 2
    axial = wide(pump.spring_preload) + wide(pump.spring_stiffness) * y
    axial = (
        axial + wide(pump.plunger_area) * study_pressure(theta).astype(wide) + wide(pump.follower_mass) * y2 * squared
    )
    return axial * y1 + wide(pump.roller_inertia or 0.0) * slope * ratio * squared


def joint_motion(theta: Array) -> tuple[ClosedForm, Array, Array, Array]:
    """Return tables, and position, rate and change of cam, follower and roller, (n, 3) each, at constant speed."""
    tables = closed_form_tables(study_pump(), study_law(), theta)
    path, one = tables.kinematics, np.ones_like(theta)
    position = np.column_stack([theta, path.centre_height, 0.0 * theta])
    rate = SPEED * np.column_stack([one, path.velocity, path.roller_ratio])
    change = SPEED**2 * np.column_stack([0.0 * one, path.acceleration, path.roller_ratio_slope])
    return tables, position, rate, change


def torque_by_cut(tables: ClosedForm, inverse: Array, pressure: Array) -> Array:
    """Return the torque from an engine's generalised forces (n, 3): multipliers from follower and roller, then cam."""
    pump, path = study_pump(), tables.kinematics
    contact_x, contact_y = path.contact_point
    arm_x, arm_y = contact_x - path.offset, contact_y - path.centre_height
    along = inverse[:, 1] + pump.spring_preload + pump.spring_stiffness * path.lift + pump.plunger_area * pressure
    across = (arm_x * along - inverse[:, 2]) / arm_y
    return inverse[:, 0] + contact_x * along - contact_y * across


def _pinocchio(position: Array, rate: Array, change: Array) -> Callable[[], Array]:
    import pinocchio as pin

    pump = study_pump()
    model: Any = pin.Model()
    cam = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "cam")
    follower = model.addJoint(0, pin.JointModelPY(), pin.SE3.Identity(), "follower")
    roller = model.addJoint(follower, pin.JointModelRZ(), pin.SE3.Identity(), "roller")
    mass, spin = pump.roller_mass or 0.0, pump.roller_inertia or 0.0
    bodies = ((cam, pump.cam_mass, pump.cam_inertia), (follower, pump.follower_mass - mass, 1e-6), (roller, mass, spin))
    for joint, weight, inertia in bodies:
        body = pin.Inertia(weight, np.zeros(3), inertia * np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    model.gravity.linear = np.zeros(3)
    data = model.createData()

    def run() -> Array:
        rows = zip(position, rate, change, strict=True)
        return np.array([pin.rnea(model, data, q, v, a).copy() for q, v, a in rows])

    return run


def _mujoco(position: Array, rate: Array, change: Array) -> Callable[[], Array]:
    import mujoco

    pump = study_pump()
    mass, spin = pump.roller_mass or 0.0, pump.roller_inertia or 0.0
    text = MUJOCO_XML.format(
        cam_mass=pump.cam_mass, cam=pump.cam_inertia, rest=pump.follower_mass - mass, roller=mass, spin=spin
    )
    model: Any = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)

    def run() -> Array:
        found = []
        for q, v, a in zip(position, rate, change, strict=True):
            data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
            mujoco.mj_inverse(model, data)
            found.append(data.qfrc_inverse.copy())
        return np.array(found)

    return run


ENGINES: dict[str, tuple[str, Callable[[Array, Array, Array], Callable[[], Array]]]] = {
    "Pinocchio rnea": ("pinocchio", _pinocchio),
    "MuJoCo mj_inverse": ("mujoco", _mujoco),
}
"""Engine -> module and builder; those not installed are left out."""


def own_choices(cycles: int, exact: Array) -> list[Choice]:
    """Return the package's ways to the torque; those that no command takes are no candidates for the front."""
    theta = angle_grid(ANGLES)
    pressure, unit = study_pressure(theta), PumpUnit(study_pump(), study_law())
    tables = closed_form_tables(unit.pump, unit.law, theta)
    rows, speeds = np.tile(pressure, (cycles, 1)), np.full(cycles, SPEED)
    single = tables.outputs["torque"].astype(np.float32)
    rows_single, squared = rows.astype(np.float32), np.float32(SPEED**2)

    def torque_by(method: str) -> Array:
        return solve_shaft([unit], theta, study_pressure(theta), SPEED, method=method).torque

    def choice(name: str, run: Callable[[], Array], solved: int, all_forces: bool) -> Choice:
        error = max(peak_error(run(), exact), LEAST)
        return Choice(name, "", error, run, solved * ANGLES, name == DEFAULT, all_forces)

    return [
        *(choice(method, partial(torque_by, method), 1, True) for method in METHODS),
        choice("tables, numpy, torque alone, float64", lambda: tables.evaluate("torque", rows, speeds[:, None])[0],
               cycles, False),
        choice("tables, numpy, torque alone, float32",
               lambda: (single[0] + single[1] * rows_single + single[2] * squared)[0], cycles, False),
    ]  # fmt: skip


def engine_choices(exact: Array) -> list[Choice]:
    """Return the engines that are installed, at every so many angles."""
    every = ANGLES // ENGINE_ANGLES
    theta = angle_grid(ANGLES)[::every]
    tables, *motion = joint_motion(theta)
    choices = []
    for name, (module, builder) in ENGINES.items():
        if importlib.util.find_spec(module) is not None:
            run = builder(*motion)
            torque = torque_by_cut(tables, run(), study_pressure(theta))
            error = float(np.max(np.abs(torque - exact[::every]))) / float(np.max(np.abs(exact)))
            choices.append(Choice(name, "", max(error, LEAST), run, theta.size, candidate=False))
    return choices


def dynamics_chart(quick: bool) -> Chart:
    """Return torque error against time per angle."""
    exact = extended_torque(angle_grid(ANGLES))
    choices = own_choices(10 if quick else CYCLES, exact) + engine_choices(exact)
    points = measured(choices, 2 if quick else 7)
    note = (
        "reference: extended precision; the front is that of solutions with all forces and motion included (engines "
        "give generalised forces only, called from Python; their motion comes prepared, as that of the tables does)"
    )
    return Chart("dynamics", "Inverse dynamics", "torque error / peak", "time per cam angle [s]", points, note)

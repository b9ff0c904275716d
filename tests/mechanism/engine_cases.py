"""The mechanism cut at the contact, in general multibody engines: motion and contact point from outside, forces theirs.

The engines get bodies, joints, the joint motion and the place of the contact. From their inverse dynamics and their
Jacobians of the contact point follow the two multipliers (sub-system II) and the torque (sub-system I); from their
joint forces the reactions. Several pumps are solved one by one, with their share of the torque summed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mechanism_cases import STEP, contact_geometry, lift_series

COMPARED = ("torque", "contact_normal", "contact_tangential", "bearing_x", "bearing_y", "guide", "pin_x", "pin_y")


class Sample:
    """Joint motion, contact point and loads at one angle, in the frame that runs with the cam."""

    def __init__(self, pump, law, mounting, theta, pressure, speed, acceleration):
        centre, normal, ratio = contact_geometry(pump, law, mounting, theta)
        lift, velocity, change = (f(0.0) for f in lift_series(law, theta))
        self.centre, self.normal = centre(0.0), normal(0.0)
        self.tangent = np.array([self.normal[1], -self.normal[0]])
        self.contact = self.centre - pump.roller_radius * self.normal
        slope = np.imag(ratio(1j * STEP)) / STEP
        self.position = np.array([theta, self.centre[1], 0.3])
        self.rate = speed * np.array([1.0, velocity, ratio(0.0)])
        self.change = acceleration * np.array([1.0, velocity, ratio(0.0)]) + speed**2 * np.array([0.0, change, slope])
        self.axial = -(pump.spring_preload + pump.spring_stiffness * lift + pump.plunger_area * pressure)
        self.gravity = np.array([mounting.rotation * mounting.gravity[0], mounting.gravity[1], 0.0])


def cut_joint(sample, inverse, cam_jacobian, roller_jacobian):
    """Return multipliers along X1 and Y1 and the torque from an engine's generalised forces and contact Jacobians."""
    right = inverse[1:] - np.array([sample.axial, 0.0])
    multipliers = np.linalg.solve(roller_jacobian[:2, 1:].T, right)
    return multipliers, inverse[0] + cam_jacobian[:2, 0] @ multipliers


def named(sample, mounting, multipliers, torque, bearing, guide, pin):
    """Return the outputs in space."""
    turn = mounting.rotation
    return {
        "torque": torque,
        "contact_normal": multipliers @ sample.normal,
        "contact_tangential": multipliers @ sample.tangent,
        "bearing_x": turn * bearing[0],
        "bearing_y": bearing[1],
        "guide": turn * guide[0],
        "pin_x": turn * pin[0],
        "pin_y": pin[1],
    }


class PinocchioPump:
    """Recursive Newton-Euler and Jacobians of Pinocchio."""

    def __init__(self, pump, mounting):
        import pinocchio as pin

        self.pin, self.model = pin, pin.Model()
        eye, zero = np.eye(3), np.zeros(3)
        at = pin.SE3(eye, np.array([mounting.rotation * pump.follower_offset, 0.0, 0.0]))
        cam = self.model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "cam")
        follower = self.model.addJoint(0, pin.JointModelPY(), at, "follower")
        roller = self.model.addJoint(follower, pin.JointModelRZ(), pin.SE3.Identity(), "roller")
        moving = pump.follower_mass + mounting.spring_mass / 3.0 - pump.roller_mass
        for joint, mass, inertia in (
            (cam, pump.cam_mass, pump.cam_inertia),
            (follower, moving, 1e-6),
            (roller, pump.roller_mass, pump.roller_inertia),
        ):
            self.model.appendBodyToJoint(joint, pin.Inertia(mass, zero, inertia * eye), pin.SE3.Identity())
        self.data = self.model.createData()

    def _jacobian(self, joint, arm):
        full = self.pin.getJointJacobian(self.model, self.data, joint, self.pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        return full[:3] + np.cross(full[3:].T, arm).T

    def solve(self, sample, mounting):
        pin, model, data = self.pin, self.model, self.data
        model.gravity.linear = sample.gravity
        position = sample.position
        inverse = pin.rnea(model, data, position, sample.rate, sample.change).copy()
        pin.computeJointJacobians(model, data, position)
        point, centre = np.append(sample.contact, 0.0), np.append(sample.centre, 0.0)
        multipliers, torque = cut_joint(sample, inverse, self._jacobian(1, point), self._jacobian(3, point - centre))
        force = np.append(multipliers, 0.0)
        external = pin.StdVec_Force()
        external.append(pin.Force.Zero())
        for joint, load, arm in (
            (1, -force, point),
            (2, np.array([0.0, sample.axial, 0.0]), np.zeros(3)),
            (3, force, point - centre),
        ):
            turned = data.oMi[joint].rotation.T
            external.append(pin.Force(turned @ load, turned @ np.cross(arm, load)))
        pin.rnea(model, data, position, sample.rate, sample.change, external)
        joints = [data.oMi[i].rotation @ data.f[i].linear for i in (1, 2, 3)]
        return named(sample, mounting, multipliers, torque, *joints)


MUJOCO = """
<mujoco>
  <compiler inertiafromgeom="false"/>
  <option gravity="0 0 0"><flag contact="disable" constraint="disable"/></option>
  <worldbody>
    <body name="cam">
      <joint name="cam" type="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="{cam_mass!r}" diaginertia="{cam!r} {cam!r} {cam!r}"/>
    </body>
    <body name="follower" pos="{offset!r} 0 0">
      <joint name="follower" type="slide" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="{moving!r}" diaginertia="1e-6 1e-6 1e-6"/>
      <body name="roller">
        <joint name="roller" type="hinge" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="{roller_mass!r}" diaginertia="{roller!r} {roller!r} {roller!r}"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


class MujocoPump:
    """Inverse dynamics, Jacobians and joint forces of MuJoCo; its equality constraints are soft, hence the cut."""

    def __init__(self, pump, mounting):
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_string(
            MUJOCO.format(
                cam_mass=float(pump.cam_mass),
                cam=float(pump.cam_inertia),
                offset=float(mounting.rotation * pump.follower_offset),
                moving=float(pump.follower_mass + mounting.spring_mass / 3.0 - pump.roller_mass),
                roller_mass=float(pump.roller_mass),
                roller=float(pump.roller_inertia),
            )
        )
        self.data = mujoco.MjData(self.model)

    def _jacobian(self, body, point):
        full = np.zeros((3, 3))
        self.mujoco.mj_jac(self.model, self.data, full, None, point, body)
        return full

    def solve(self, sample, mounting):
        mujoco, model, data = self.mujoco, self.model, self.data
        model.opt.gravity[:] = sample.gravity
        data.qpos[:], data.qvel[:], data.qacc[:] = sample.position, sample.rate, sample.change
        data.xfrc_applied[:] = 0.0
        mujoco.mj_inverse(model, data)
        point, centre = np.append(sample.contact, 0.0), np.append(sample.centre, 0.0)
        inverse = data.qfrc_inverse.copy()
        multipliers, torque = cut_joint(sample, inverse, self._jacobian(1, point), self._jacobian(3, point))
        force = np.append(multipliers, 0.0)
        data.xfrc_applied[1] = np.concatenate([-force, np.cross(point, -force)])
        data.xfrc_applied[2, 1] = sample.axial
        data.xfrc_applied[3] = np.concatenate([force, np.cross(point - centre, force)])
        mujoco.mj_rnePostConstraint(model, data)
        joints = [data.cfrc_int[body, 3:] for body in (1, 2, 3)]
        return named(sample, mounting, multipliers, torque, *joints)


ENGINES: dict[str, Any] = {"pinocchio": PinocchioPump, "mujoco": MujocoPump}


def engine_solution(engine, units, run):
    """Return per pump the outputs of an engine over the samples of a motion, each (n,)."""
    solved = []
    for index, unit in enumerate(units):
        solver = ENGINES[engine](unit.pump, unit.mounting)
        pressure = run.pressure[index]
        rows = [
            solver.solve(Sample(unit.pump, unit.law, unit.mounting, *row), unit.mounting)
            for row in zip(run.theta - unit.phase, pressure, run.speed, run.acceleration, strict=True)
        ]
        solved.append({name: np.array([row[name] for row in rows]) for name in COMPARED})
    return solved


def agreement(engine, units, run, ours):
    """Return max difference / max value per output, over all pumps; tangential on the scale of the normal force."""
    theirs = engine_solution(engine, units, run)
    found = {}
    for name in COMPARED:
        scale_name = "contact_normal" if name == "contact_tangential" else name
        difference = max(np.max(np.abs(a[name] - b[name])) for a, b in zip(ours.outputs, theirs, strict=True))
        found[name] = float(difference / max(np.max(np.abs(b[scale_name])) for b in theirs))
    return found

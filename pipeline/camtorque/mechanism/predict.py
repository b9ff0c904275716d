"""A pump without a recording: torque, forces and Hertz stress over angle, and a sweep over speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from camtorque.config.pump import PressureCurve, PumpConfig, weak_pressure
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.contact import ContactLoss, pulls
from camtorque.mechanism.elastic import contact_forces, solve_elastic
from camtorque.mechanism.flight import Aloft
from camtorque.mechanism.friction import NO_FRICTION, Friction
from camtorque.mechanism.kinematics import Kinematics, flat_pressure_angle
from camtorque.mechanism.lift_laws import lift_law
from camtorque.mechanism.mounting import Mounting, PumpUnit, Roller, assumed_roller
from camtorque.mechanism.predict_findings import (
    cam_findings,
    curve_findings,
    flight_findings,
    load_findings,
    shaft_findings,
    stress_findings,
)
from camtorque.mechanism.sections import FLANKS, Section, dwell, flank, section_law, tangent_sections
from camtorque.mechanism.shaft import solve_shaft
from camtorque.mechanism.solve import solve_rigid
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import Array, Finding, ReadOnly, Refusal, RigidTorque
from camtorque.units import BAR, DEGREE, RPM, TURN, angle_grid

SAMPLES, FEWEST_ANGLES = 3600, 36
KEPT = 720
"""So many samples of a curve go into the document, at least where there are as many."""


@dataclass(frozen=True, repr=False)
class Prediction(ReadOnly):
    """What a pump will do at several speeds.

    Attributes
    ----------
    theta : (n_theta,) shaft angle [rad]
    pressure : (n_theta,) pressure on the plunger of the first pump [Pa]
    speeds : (n_speeds,) [rad/s]
    pumps : per speed, the solution of the first pump
    shaft_torque : (n_speeds, n_theta) at the drive end, all pumps [N m]
    kinematics : of the first pump
    jump, jump_without_pressure : lowest speed at which the follower leaves the cam, with the pressure and without
    flat_pressure_angles : bounds of the flat check [rad]
    roller : as given or assumed
    findings : everything odd about pump file and pressure curve
    friction : of the pump file
    on_shaft : how many pumps the shaft drives
    """

    theta: Array
    pressure: Array
    speeds: Array
    pumps: tuple[RigidTorque, ...]
    shaft_torque: Array
    kinematics: Kinematics
    jump: ContactLoss
    jump_without_pressure: ContactLoss
    flat_pressure_angles: tuple[float, float]
    roller: Roller
    findings: tuple[Finding, ...]
    friction: Friction = NO_FRICTION
    on_shaft: int = 1

    def __repr__(self) -> str:
        speeds = ", ".join(f"{speed * 30.0 / np.pi:.4g}" for speed in self.speeds)
        return f"<Prediction {speeds} rpm, {self.theta.size} angles>"


def cam_of(config: PumpConfig) -> CamLaw:
    """Return the lift law of a pump file, from its table or from its sections."""
    if config.cam_table is not None:
        return lift_law(config.cam_table)
    if not config.sections:
        raise Refusal(f"{config.path}: its lift table has not been read; use camtorque.ingest.pump_file.read_pump")
    sections: list[Section] = []
    for spec in config.sections:
        if spec.kind not in ("dwell", "tangent", *FLANKS):
            known = ", ".join(("dwell", "tangent", *FLANKS))
            raise Refusal(f"{config.path} [[cam.sections]] kind: found {spec.kind!r}, expected one of {known}")
        if spec.kind == "dwell":
            sections.append(dwell(spec.angle))
        elif spec.kind == "tangent":
            pump = config.pump
            if pump.follower_offset != 0.0:
                raise Refusal(
                    f"{config.path} [[cam.sections]] kind: found 'tangent' beside a follower_offset_m of "
                    f"{pump.follower_offset:g}, expected 0: by its lift no flank would be straight and no nose round; "
                    "give the lift that this follower has as a table (cam_table in [pump])"
                )
            sections.extend(tangent_sections(pump.base_circle_radius, pump.roller_radius, spec.rise, spec.nose_radius))
        else:
            sections.append(flank(spec.kind, spec.angle, spec.rise))
    return section_law(sections, config.sections_start)


def mounting_of(config: PumpConfig) -> Mounting:
    """Return direction of running, gravity, spring mass and guide point of a pump file."""
    return Mounting(config.rotation, config.gravity, config.spring_mass, config.guide_height)


def pressure_at(curve: PressureCurve, theta: Array) -> Array:
    """Return the pressure at any cam angles, by periodic monotone cubics: no overshoot where the port opens [Pa].

    The paper uses splines, which undershoot below zero behind a collapse.
    """
    angle = np.concatenate([curve.theta[-2:] - TURN, curve.theta, curve.theta[:2] + TURN])
    pressure = np.concatenate([curve.pressure[-2:], curve.pressure, curve.pressure[:2]])
    return PchipInterpolator(angle, pressure)(curve.theta[0] + np.mod(theta - curve.theta[0], TURN))


def predict(
    config: PumpConfig,
    speeds: Sequence[float] | Array,
    pressure: PressureCurve | None = None,
    *,
    n_theta: int = SAMPLES,
    method: str = "closed",
) -> Prediction:
    """Return torque, forces and Hertz stress of a pump at several speeds.

    Parameters
    ----------
    config : `camtorque.ingest.pump_file.read_pump`
    speeds : cam speeds, positive [rad/s]
    pressure : on the plunger over cam angle, the same at every speed; None for a dry pump (spring and inertia only)
    n_theta : points of the angle grid
    method : one of `shaft.METHODS`

    Raises
    ------
    Refusal : no speed, a speed that is not positive, a grid below 36 points, a cam that cannot be built, friction with
        a frictionless method
    """
    speed = _positive(speeds)
    law, mounting = cam_of(config), mounting_of(config)
    if not (isinstance(n_theta, int) and n_theta >= FEWEST_ANGLES):
        raise Refusal(f"predict: n_theta is {n_theta!r}, expected a whole number of {FEWEST_ANGLES} points or more")
    theta = angle_grid(n_theta)
    friction = Friction(*config.friction)
    units = [PumpUnit(config.pump, law, phase, mounting, friction) for phase in config.phases]
    curve = PressureCurve(np.array([0.0, np.pi]), np.zeros(2)) if pressure is None else pressure
    load = np.stack([pressure_at(curve, theta - phase) for phase in config.phases])
    own = pressure_at(curve, theta)
    tables = closed_form_tables(config.pump, law, theta, mounting, friction)

    def at(value: float) -> tuple[RigidTorque, Array]:
        pump = solve_rigid(config.pump, law, theta, own, value, mounting=mounting, friction=friction, method=method)
        return pump, _shaft_torque(config, units, load, pump, value, method)

    pumps, torque = zip(*(at(value) for value in speed), strict=True)
    roller = assumed_roller(config.pump)
    findings = (
        *curve_findings(pressure), *weak_pressure(config.pump, float(np.max(curve.pressure))),
        *load_findings(theta, own, tables.kinematics.lift),
        *stress_findings(theta, np.stack([pump.forces.hertz for pump in pumps]), speed),
        *cam_findings(tables.kinematics, law, roller, pressure is None), *shaft_findings(config.shaft_stiffness),
        *flight_findings(pumps, speed),
    )  # fmt: skip
    return Prediction(
        theta=theta, pressure=own, speeds=speed, pumps=pumps, shaft_torque=np.stack(torque),
        kinematics=tables.kinematics, jump=tables.jump(own), jump_without_pressure=tables.jump(),
        flat_pressure_angles=flat_pressure_angle(config.pump, law, config.rotation), roller=roller, findings=findings,
        friction=friction, on_shaft=len(units),
    )  # fmt: skip


def _positive(speeds: Sequence[float] | Array) -> Array:
    """Return the speeds as an array; refuses none, and one that is not positive."""
    speed = np.atleast_1d(np.asarray(speeds, dtype=np.float64))
    if speed.size == 0 or not np.all(np.isfinite(speed) & (speed > 0.0)):
        shown = ", ".join(f"{value:.4g}" for value in speed / RPM) or "none"
        raise Refusal(f"predict: found the speeds {shown} rpm, expected at least one positive speed")
    return speed


def _shaft_torque(
    config: PumpConfig, units: list[PumpUnit], load: Array, first: RigidTorque, speed: float, method: str
) -> Array:
    """Return the torque at the drive end [N m]; where the first pump flies, every one does as it does."""
    rigid = np.isinf(config.shaft_stiffness)
    if rigid and not first.contact_lost:
        return solve_shaft(units, first.theta, load, speed, method=method).torque
    if rigid:
        local = first.theta[None, :] - np.array(config.phases)[:, None]
        return np.asarray(np.interp(local, first.theta, first.torque, period=TURN).sum(axis=0), dtype=np.float64)
    if first.contact_lost:
        raise _aloft(config, speed)
    if method != "closed":
        raise Refusal(f"{config.path}: method {method!r} knows rigid shafts only, found a stiffness; use 'closed'")
    stiffness = np.full(len(units), config.shaft_stiffness)
    found = solve_elastic(units, load, speed, stiffness, np.full(len(units), config.shaft_damping))
    if np.any(pulls(contact_forces(units, load, found))):
        raise _aloft(config, speed)
    return found.torque


def _aloft(config: PumpConfig, speed: float) -> Aloft:
    return Aloft(
        f"{config.path} [shaft]: at {speed / RPM:.0f} rpm the follower leaves the cam, and flight on an elastic "
        "shaft is not modelled; predict lower speeds, or leave the stiffness out"
    )


def sweep_rows(prediction: Prediction) -> list[dict[str, Any]]:
    """Return one row of extremes per speed, in border units."""
    path = prediction.kinematics
    return [
        _row(pump, path, torque, float(speed))
        for pump, torque, speed in zip(prediction.pumps, prediction.shaft_torque, prediction.speeds, strict=True)
    ]


def _row(pump: RigidTorque, path: Kinematics, shaft_torque: Array, speed: float) -> dict[str, Any]:
    """Return the extremes of one speed."""
    forces, peak = pump.forces, int(np.argmax(pump.torque))
    strongest = int(np.nanargmax(forces.hertz))
    return {
        "speed_rpm": float(speed / RPM),
        "shaft_torque_max_nm": float(np.max(shaft_torque)),
        "shaft_torque_min_nm": float(np.min(shaft_torque)),
        "shaft_torque_mean_nm": float(np.mean(shaft_torque)),
        "pump_torque_max_nm": float(pump.torque[peak]),
        "pump_torque_max_deg": float(np.rad2deg(pump.theta[peak])),
        "contact_normal_max_n": float(np.max(forces.contact_normal)),
        "bearing_max_n": float(np.max(np.hypot(forces.bearing_x, forces.bearing_y))),
        "guide_max_n": float(np.max(np.abs(forces.guide))),
        "hertz_max_gpa": float(forces.hertz[strongest]) / 1e9,
        "hertz_max_deg": float(np.rad2deg(pump.theta[strongest])),
        "shear_max_gpa": float(forces.hertz_shear_max[strongest]) / 1e9,
        "shear_depth_um": float(forces.hertz_shear_depth[strongest]) * 1e6,
        "rolling_speed_max_m_per_s": float(np.max(np.abs(path.surface_arc))) * speed,
        "roller_speed_max_rpm": float(np.max(np.abs(path.roller_ratio))) * speed / RPM,
        "contact_lost": pump.contact_lost,
    }


def prediction_document(prediction: Prediction) -> dict[str, Any]:
    """Return the prediction as JSON-ready values in border units; a jump that never comes is null."""
    path, roller = prediction.kinematics, prediction.roller
    arms = {"bearing_arm_um": prediction.friction.bearing_arm, "pin_arm_um": prediction.friction.pin_arm}
    return {
        "schema": "camtorque.predict/1",
        "sweep": sweep_rows(prediction),
        "pressure_angle_max_deg": float(np.max(path.pressure_angle)) / DEGREE,
        "pressure_angle_min_deg": float(np.min(path.pressure_angle)) / DEGREE,
        "pressure_angle_flat_check_deg": [value / DEGREE for value in prediction.flat_pressure_angles],
        "surface_radius_min_mm": None if np.any(path.undercut) else 1e3 / float(np.max(path.surface_curvature)),
        "undercut": bool(np.any(path.undercut)),
        "concave": bool(np.any(path.concave)),
        "jump": _jump(prediction.jump),
        "jump_without_pressure": _jump(prediction.jump_without_pressure),
        "roller": {"mass_kg": roller.mass, "inertia_kg_m2": roller.inertia, "assumed": roller.assumed},
        "friction": {"guide": prediction.friction.guide, **{name: 1.0e6 * arm for name, arm in arms.items()}},
        "findings": [asdict(finding) for finding in prediction.findings],
        "curves": _curves(prediction),
    }


def _curves(prediction: Prediction) -> dict[str, Any]:
    """Return the curves over angle, thinned to `KEPT` samples; per speed where they depend on it."""
    path, pumps = prediction.kinematics, prediction.pumps
    names = ("contact_normal", "contact_tangential", "bearing_x", "bearing_y", "guide")
    return {
        "theta_deg": _list(prediction.theta / DEGREE),
        "pressure_bar": _list(prediction.pressure / BAR),
        "lift_mm": _list(1e3 * path.lift),
        "pressure_angle_deg": _list(path.pressure_angle / DEGREE),
        "shaft_torque_nm": [_list(row) for row in prediction.shaft_torque],
        "by_cause_nm": [{name: _list(row) for name, row in pump.by_cause.items()} for pump in pumps],
        **{f"{name}_n": [_list(getattr(pump.forces, name)) for pump in pumps] for name in names},
        "guide_moment_nm": [_list(pump.forces.guide_moment) for pump in pumps],
        "hertz_gpa": [_list(1e-9 * pump.forces.hertz) for pump in pumps],
    }


def _list(values: Array) -> list[float | None]:
    """Return a thinned list with null for what could not be determined (an undercut cam has no Hertz stress)."""
    return [float(value) if np.isfinite(value) else None for value in values[:: max(1, values.size // KEPT)]]


def _jump(loss: ContactLoss) -> dict[str, float] | None:
    """Return jump speed and angle, or None where the follower never leaves the cam."""
    if not np.isfinite(loss.speed):
        return None
    return {"speed_rpm": loss.speed / RPM, "theta_deg": loss.theta / DEGREE}

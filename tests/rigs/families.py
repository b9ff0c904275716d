"""Named families of rigs: each a function (rng) -> `RigTruth` drawn from plausible ranges. `FAMILIES` holds them all.

Widths follow what data sheets and literature leave open: spring rate to a few percent, delay within its tolerance,
gain within its certificate, trigger within its mounting tolerance, liquid within the published spread of diesel.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rigs.truth import BAR, DEGREE, NO_FRICTION, NO_SCATTER, RIGID_DRIVELINE, Cam, RigTruth, TorqueSensor, change

Family = Callable[[np.random.Generator], RigTruth]


def _sensors(rng: np.random.Generator) -> dict:
    """Return sensor and trigger errors inside their sheets' limits."""
    return {
        "trigger__angle_offset": float(np.clip(0.6 * rng.standard_normal(), -1.4, 1.4)) * DEGREE,
        "torque_sensor__volts_per_unit": 0.025 * (1.0 + 0.002 * rng.standard_normal()),
        "torque_sensor__gain_error": 0.0006 * rng.standard_normal(),
        "torque_sensor__zero": rng.uniform(-1.0, 1.0),
        "torque_sensor__zero_residual": 0.04 * rng.standard_normal(),
        "torque_sensor__delay_error": float(np.clip(0.012 * rng.standard_normal(), -0.03, 0.03)),
        "pressure_sensor__volts_per_unit": 0.005 / BAR * (1.0 + 0.001 * rng.standard_normal()),
        "pressure_sensor__gain_error": 0.0008 * rng.standard_normal(),
        "pressure_sensor__zero": rng.uniform(-2.0, 2.0) * 1e5,
        "pressure_sensor__zero_residual": 0.4e5 * rng.standard_normal(),
    }


def _hydraulics(rng: np.random.Generator) -> dict:
    """Return chamber, valve, liquid and line of a small pump; areas and volumes are for an 8 mm plunger."""
    return {
        "pump__roller_inertia": rng.uniform(1.5e-7, 2.5e-7),
        "fluid__modulus": rng.uniform(1.25e9, 1.35e9),
        "fluid__slope": rng.uniform(9.0, 11.0),
        "chamber__dead_volume": rng.uniform(1.8e-6, 3.2e-6),
        "chamber__feed_pressure": rng.uniform(2.0e5, 5.0e5),
        "chamber__port_close_angle": rng.uniform(19.0, 21.0) * DEGREE,
        "chamber__leak": 10.0 ** rng.uniform(-14.5, -13.7),
        "chamber__close_width": rng.uniform(0.5, 1.5) * DEGREE,
        "chamber__spill_area": rng.uniform(1.5e-6, 4.0e-6),
        "chamber__port_area": rng.uniform(2.5e-6, 5.0e-6),
        "valve__opening_pressure": rng.uniform(8.0e5, 20.0e5),
        "valve__full_open_pressure": rng.uniform(35.0e5, 60.0e5),
        "valve__area": rng.uniform(1.6e-6, 3.0e-6),
        "line__length": rng.uniform(0.5, 0.8),
        "line__resistance": rng.uniform(0.2, 0.35),
        "line__end_volume": rng.uniform(0.5e-6, 1.0e-6),
        "line__nozzle_area": rng.uniform(0.036e-6, 0.056e-6),
        "line__needle_open": rng.uniform(220e5, 280e5),
        "line__needle_close": rng.uniform(140e5, 180e5),
    }


def _friction(rng: np.random.Generator) -> dict:
    bearing = rng.uniform(0.006, 0.03)
    return {
        "friction__bearing_mu": bearing,
        "friction__bearing_mu_static": bearing,
        "friction__pin_mu": rng.uniform(0.001, 0.006),
        "friction__guide_mu": rng.uniform(0.01, 0.08),
        "friction__guide_lever": rng.uniform(1.0, 2.0),
        "friction__seal_force": rng.uniform(5.0, 30.0),
        "friction__plunger_viscous": rng.uniform(2.0, 15.0),
        "friction__drag_torque": rng.uniform(0.05, 0.35),
        "friction__shaft_viscous": rng.uniform(0.5e-3, 2.5e-3),
        "pump__spring_stiffness_error": float(np.clip(0.012 * rng.standard_normal(), -0.03, 0.03)),
    }


def _driveline(rng: np.random.Generator) -> dict:
    return {
        "driveline__shaft_stiffness": rng.uniform(4000.0, 9000.0),
        "driveline__shaft_damping": rng.uniform(0.4, 0.9),
        "driveline__drive_inertia": 10.0 ** rng.uniform(-0.5, 0.1),
        "driveline__camshaft_inertia": rng.uniform(0.8e-4, 2.0e-4),
    }


def closed_volume(rng: np.random.Generator) -> RigTruth:
    """A closed-volume pump on a usual bench, every effect present."""
    return change(
        RigTruth(name="closed_volume"), **_sensors(rng), **_hydraulics(rng), **_friction(rng), **_driveline(rng)
    )


def spill(rng: np.random.Generator) -> RigTruth:
    """The same pump with a helix that ends delivery by spill."""
    return change(closed_volume(rng), name="spill", chamber__end="spill")


def plain(rng: np.random.Generator) -> RigTruth:
    """`closed_volume` without seal drag and pin friction: bearing, guide, drag and viscous terms alone."""
    return change(
        closed_volume(rng), name="plain", friction__seal_force=0.0, friction__pin_mu=0.0, friction__guide_lever=1.0
    )


def plain_spill(rng: np.random.Generator) -> RigTruth:
    """`plain` with a spill port."""
    return change(plain(rng), name="plain_spill", chamber__end="spill")


def other_geometry(rng: np.random.Generator) -> RigTruth:
    """10 mm plunger, 10 mm lift, offset follower, larger base circle, modified-sine rise; closed volume or spill."""
    cam = Cam(
        lift=10.0e-3,
        rise_start=2.0 * DEGREE,
        rise_angle=rng.uniform(66.0, 72.0) * DEGREE,
        dwell_angle=rng.uniform(12.0, 20.0) * DEGREE,
        fall_angle=rng.uniform(80.0, 95.0) * DEGREE,
        rise_profile="modified_sine",
        fall_profile="cycloidal",
        fall_skew=rng.uniform(1.0, 1.4),
    )
    base = closed_volume(rng)
    scale = (10.0 / 8.0) ** 2
    return change(
        base,
        name="other_geometry",
        pump__cam=cam,
        pump__base_circle_radius=24.0e-3,
        pump__roller_radius=9.0e-3,
        pump__roller_width=9.0e-3,
        pump__follower_offset=rng.uniform(-4.0e-3, 4.0e-3),
        pump__follower_mass=0.14,
        pump__spring_stiffness=26000.0,
        pump__spring_preload=240.0,
        pump__plunger_diameter=10.0e-3,
        pump__roller_inertia=6.0e-7,
        chamber__dead_volume=scale * 1.3 * base.chamber.dead_volume,
        chamber__end=str(rng.choice(["closed", "spill"])),
        chamber__end_angle_zero_load=36.0 * DEGREE,
        chamber__port_close_angle=rng.uniform(23.0, 25.0) * DEGREE,
        trigger__nominal_angle=24.0 * DEGREE,
        chamber__port_area=6.0e-6,
        valve__area=scale * 1.4 * base.valve.area,
        line__nozzle_area=scale * 1.4 * base.line.nozzle_area,
        line__bore=2.2e-3,
        driveline__shaft_stiffness=2.0 * base.driveline.shaft_stiffness,
    )


def stiff_driveline(rng: np.random.Generator) -> RigTruth:
    """Short thick shaft and a heavy flywheel."""
    return change(
        closed_volume(rng),
        name="stiff_driveline",
        driveline__shaft_stiffness=rng.uniform(14000.0, 20000.0),
        driveline__shaft_damping=rng.uniform(0.8, 1.4),
        driveline__drive_inertia=rng.uniform(1.5, 3.0),
    )


def soft_driveline(rng: np.random.Generator) -> RigTruth:
    """Soft shaft and a light drive: several degrees of ripple and twist."""
    return change(
        closed_volume(rng),
        name="soft_driveline",
        driveline__shaft_stiffness=rng.uniform(2000.0, 3000.0),
        driveline__shaft_damping=rng.uniform(0.3, 0.6),
        driveline__drive_inertia=rng.uniform(0.12, 0.2),
    )


def bare(rng: np.random.Generator) -> RigTruth:
    """No effect at all: pressure read in the chamber, no friction, rigid shaft, constant speed, fast exact sensors."""
    drawn = change(RigTruth(name="bare"), **_hydraulics(rng))
    return change(
        drawn,
        friction=NO_FRICTION,
        driveline=RIGID_DRIVELINE,
        scatter=NO_SCATTER,
        pressure_sensor__at="chamber",
        torque_sensor=TorqueSensor(cutoff_hz=20000.0),
        pressure_sensor__zero=0.5e5,
    )


def friction_only(rng: np.random.Generator) -> RigTruth:
    """`bare` with friction and damping."""
    return change(bare(rng), name="friction_only", **_friction(rng))


def chamber_only(rng: np.random.Generator) -> RigTruth:
    """`bare` with the pressure read in the line."""
    return change(bare(rng), name="chamber_only", pressure_sensor__at="line")


def driveline_only(rng: np.random.Generator) -> RigTruth:
    """`bare` on an elastic driveline with a speed-controlled drive."""
    driveline = RigTruth().driveline
    return change(change(bare(rng), name="driveline_only", driveline=driveline), **_driveline(rng))


def sensor_only(rng: np.random.Generator) -> RigTruth:
    """`bare` with the usual 1 kHz transducer and every sensor and trigger error."""
    return change(change(bare(rng), name="sensor_only", torque_sensor=TorqueSensor()), **_sensors(rng))


def negative_rotation(rng: np.random.Generator) -> RigTruth:
    """Clockwise running with an offset follower: torque reads negative, the offset changes its effect."""
    return change(
        closed_volume(rng), name="negative_rotation", rotation=-1, pump__follower_offset=rng.uniform(2.0e-3, 4.0e-3)
    )


def foreign_valve_mass(rng: np.random.Generator) -> RigTruth:
    """A delivery valve with mass that retracts a volume from the line as it closes."""
    return change(
        closed_volume(rng),
        name="foreign_valve_mass",
        valve__mass_frequency=rng.uniform(700.0, 1500.0),
        valve__mass_damping=rng.uniform(0.3, 0.7),
        valve__unloading_volume=rng.uniform(2.0e-9, 7.0e-9),
    )


def foreign_yielding_drive(rng: np.random.Generator) -> RigTruth:
    """A compliant coupling between the drive and the transducer."""
    return change(
        closed_volume(rng),
        name="foreign_yielding_drive",
        driveline__coupling_stiffness=rng.uniform(1500.0, 4000.0),
        driveline__coupling_damping=rng.uniform(1.0, 3.0),
        driveline__coupling_inertia=rng.uniform(4.0e-3, 12.0e-3),
    )


def foreign_crosstalk(rng: np.random.Generator) -> RigTruth:
    """The transducer feels bearing load and pressure."""
    return change(
        closed_volume(rng),
        name="foreign_crosstalk",
        torque_sensor__bending_crosstalk=rng.uniform(-8.0e-5, 8.0e-5),
        torque_sensor__pressure_crosstalk=rng.uniform(-4.0e-9, 4.0e-9),
    )


def foreign_hysteresis(rng: np.random.Generator) -> RigTruth:
    """Pre-sliding friction in the guide and a transducer with hysteresis."""
    return change(
        closed_volume(rng),
        name="foreign_hysteresis",
        friction__guide_presliding=rng.uniform(0.1e-3, 0.5e-3),
        torque_sensor__hysteresis=rng.uniform(0.05, 0.15),
    )


def foreign_leak(rng: np.random.Generator) -> RigTruth:
    """Clearance that widens with pressure, Stribeck bearing, churning with the square of speed."""
    base = closed_volume(rng)
    return change(
        base,
        name="foreign_leak",
        chamber__leak_growth=rng.uniform(0.4e-8, 1.0e-8),
        friction__bearing_mu_static=1.8 * base.friction.bearing_mu,
        friction__stribeck_speed=rng.uniform(30.0, 60.0),
        friction__churning=rng.uniform(3.0e-6, 1.0e-5),
    )


def turning_bridge(rng: np.random.Generator) -> RigTruth:
    """The transducer's bridge feels the bending that turns through it."""
    return change(
        closed_volume(rng),
        name="turning_bridge",
        torque_sensor__turning_torque=rng.uniform(0.05, 0.15),
        torque_sensor__turning_arm=rng.uniform(1.0e-5, 4.0e-5),
        torque_sensor__turning_phase=rng.uniform(0.0, 2.0 * np.pi),
    )


FAMILIES: dict[str, Family] = {
    "closed_volume": closed_volume,
    "spill": spill,
    "plain": plain,
    "plain_spill": plain_spill,
    "other_geometry": other_geometry,
    "stiff_driveline": stiff_driveline,
    "soft_driveline": soft_driveline,
    "bare": bare,
    "friction_only": friction_only,
    "chamber_only": chamber_only,
    "driveline_only": driveline_only,
    "sensor_only": sensor_only,
    "negative_rotation": negative_rotation,
    "foreign_valve_mass": foreign_valve_mass,
    "foreign_yielding_drive": foreign_yielding_drive,
    "foreign_crosstalk": foreign_crosstalk,
    "foreign_hysteresis": foreign_hysteresis,
    "foreign_leak": foreign_leak,
    "turning_bridge": turning_bridge,
}

FOREIGN = tuple(name for name in FAMILIES if name.startswith("foreign_"))
"""Families with a law that the model under test lacks."""

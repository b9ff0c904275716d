"""`RigTruth` flattened for the compiled loop."""

from typing import NamedTuple

import numpy as np

from rigs.truth import PROFILES, RigTruth

FLOW_COEFFICIENT = 0.7
LAMINAR_PORT = 1.0e5
LAMINAR_SMALL = 2.0e4
SEGMENTS = (0.15, 0.25, 0.3, 0.3)
"""Unequal pipe segments between the lumped resistances, so that no low mode has a flow node at each of them."""
TRANSIT_QUANTUM = 1.0e-5
"""Segment transit times are multiples of this, so that steps that divide it need no interpolation."""


class Constants(NamedTuple):
    """Scalars of one run; names as in `rigs.truth`."""

    # cam
    lift: float
    rise_start: float
    rise_angle: float
    dwell_angle: float
    fall_angle: float
    rise_profile: int
    fall_profile: int
    rise_skew: float
    fall_skew: float
    # mechanism
    centre_distance: float
    offset: float
    roller_radius: float
    roller_inertia: float
    follower_mass: float
    spring_stiffness: float
    spring_preload: float
    plunger_area: float
    # liquid
    density: float
    modulus: float
    slope: float
    floor: float
    floor_density: float
    # chamber
    top_volume: float
    feed_pressure: float
    feed_density: float
    port_close_lift: float
    port_height: float
    port_area: float
    leak: float
    leak_growth: float
    spill: bool
    close_width: float
    spill_area: float
    spill_height: float
    suction_area: float
    # valve
    valve_opening: float
    valve_span: float
    valve_area: float
    valve_frequency: float
    valve_damping: float
    unloading_volume: float
    # line
    waves: bool
    end_volume: float
    nozzle_volume: float
    impedance: float
    resistance: float
    needle_open: float
    needle_close: float
    needle_time: float
    nozzle_area: float
    # friction
    bearing_mu: float
    bearing_mu_static: float
    stribeck_speed: float
    bearing_radius: float
    pin_mu: float
    pin_radius: float
    guide_mu: float
    guide_lever: float
    guide_presliding: float
    seal_force: float
    plunger_viscous: float
    drag_torque: float
    shaft_viscous: float
    churning: float
    smoothing_speed: float
    # driveline
    rigid_shaft: bool
    prescribed: bool
    yielding: bool
    shaft_stiffness: float
    shaft_damping: float
    drive_inertia: float
    shaft_inertia: float
    coupling_stiffness: float
    coupling_damping: float
    coupling_inertia: float
    control_p: float
    control_i: float
    drive_ripple: float
    drive_ripple_order: float


def _hydraulics(truth: RigTruth, port_close_lift: float) -> dict:
    fluid, chamber, valve, line = truth.fluid, truth.chamber, truth.valve, truth.line
    area = truth.pump.plunger_area

    def density(p: float) -> float:
        return fluid.density * (1.0 + fluid.slope * p / fluid.modulus) ** (1.0 / fluid.slope)

    pipe_area = 0.25 * np.pi * line.bore**2
    wave_speed = np.sqrt((fluid.modulus + fluid.slope * 300e5) / fluid.density)
    impedance = fluid.density * wave_speed / pipe_area
    lumped = 0.0 if line.waves else pipe_area * line.length + line.nozzle_volume
    return {
        "plunger_area": area,
        "density": fluid.density,
        "modulus": fluid.modulus,
        "slope": fluid.slope,
        "floor": fluid.floor,
        "floor_density": density(fluid.floor),
        "top_volume": chamber.dead_volume + area * truth.pump.cam.lift,
        "feed_pressure": chamber.feed_pressure,
        "feed_density": density(chamber.feed_pressure),
        "port_close_lift": port_close_lift,
        "port_height": chamber.port_height,
        "port_area": FLOW_COEFFICIENT * chamber.port_area,
        "leak": chamber.leak,
        "leak_growth": chamber.leak_growth,
        "spill": chamber.end == "spill",
        "close_width": chamber.close_width,
        "spill_area": FLOW_COEFFICIENT * chamber.spill_area,
        "spill_height": chamber.spill_height,
        "suction_area": FLOW_COEFFICIENT * chamber.suction_area,
        "valve_opening": valve.opening_pressure,
        "valve_span": valve.full_open_pressure - valve.opening_pressure,
        "valve_area": FLOW_COEFFICIENT * valve.area,
        "valve_frequency": 2.0 * np.pi * valve.mass_frequency,
        "valve_damping": valve.mass_damping,
        "unloading_volume": valve.unloading_volume,
        "waves": line.waves,
        "end_volume": line.end_volume + lumped,
        "nozzle_volume": line.nozzle_volume,
        "impedance": impedance,
        "resistance": line.resistance * impedance / len(SEGMENTS),
        "needle_open": line.needle_open,
        "needle_close": line.needle_close,
        "needle_time": line.needle_time,
        "nozzle_area": line.nozzle_area,
    }


def _mechanics(truth: RigTruth) -> dict:
    pump, drive, friction = truth.pump, truth.driveline, truth.friction
    finite = np.isfinite(drive.drive_inertia)
    omega_c = 2.0 * np.pi * drive.control_bandwidth_hz
    inertia = drive.drive_inertia if finite else 1.0
    names = [
        "bearing_mu",
        "bearing_mu_static",
        "stribeck_speed",
        "bearing_radius",
        "pin_mu",
        "pin_radius",
        "guide_mu",
        "guide_lever",
        "guide_presliding",
        "seal_force",
        "plunger_viscous",
        "drag_torque",
        "shaft_viscous",
        "churning",
        "smoothing_speed",
    ]
    return {
        "centre_distance": float(
            np.sqrt((pump.base_circle_radius + pump.roller_radius) ** 2 - pump.follower_offset**2)
        ),
        "offset": truth.rotation * pump.follower_offset,
        "roller_radius": pump.roller_radius,
        "roller_inertia": pump.roller_inertia,
        "follower_mass": pump.follower_mass,
        "spring_stiffness": pump.spring_stiffness * (1.0 + pump.spring_stiffness_error),
        "spring_preload": pump.spring_preload,
        **{name: getattr(friction, name) for name in names},
        "rigid_shaft": not np.isfinite(drive.shaft_stiffness),
        "prescribed": not finite,
        "yielding": bool(np.isfinite(drive.coupling_stiffness)),
        "shaft_stiffness": drive.shaft_stiffness,
        "shaft_damping": drive.shaft_damping,
        "drive_inertia": inertia,
        "shaft_inertia": drive.camshaft_inertia + pump.cam_inertia,
        "coupling_stiffness": drive.coupling_stiffness,
        "coupling_damping": drive.coupling_damping,
        "coupling_inertia": drive.coupling_inertia,
        "control_p": 1.4 * omega_c * inertia,
        "control_i": omega_c**2 * inertia,
        "drive_ripple": drive.drive_ripple,
        "drive_ripple_order": float(drive.drive_ripple_order),
    }


def flatten(truth: RigTruth, port_close_lift: float) -> Constants:
    """Return the constants of the compiled loop."""
    cam = truth.pump.cam
    values = {
        "lift": cam.lift,
        "rise_start": cam.rise_start,
        "rise_angle": cam.rise_angle,
        "dwell_angle": cam.dwell_angle,
        "fall_angle": cam.fall_angle,
        "rise_profile": PROFILES[cam.rise_profile],
        "fall_profile": PROFILES[cam.fall_profile],
        "rise_skew": cam.rise_skew,
        "fall_skew": cam.fall_skew,
        **_hydraulics(truth, port_close_lift),
        **_mechanics(truth),
    }
    types = Constants.__annotations__  # evaluated classes: this module does not postpone annotations
    return Constants(**{name: types[name](values[name]) for name in Constants._fields})


def segment_transits(truth: RigTruth) -> np.ndarray:
    """Return the wave transit time of each pipe segment [s], rounded to `TRANSIT_QUANTUM`."""
    fluid = truth.fluid
    wave_speed = np.sqrt((fluid.modulus + fluid.slope * 300e5) / fluid.density)
    exact = np.array(SEGMENTS) * truth.line.length / wave_speed
    return np.maximum(np.round(exact / TRANSIT_QUANTUM), 1.0) * TRANSIT_QUANTUM

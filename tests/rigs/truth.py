"""What a simulated rig really is: every parameter of pump, line, driveline, sensors and scatter, SI and radians.

Nothing here is known to the software under test but what `rigs.write` prints on the sheets.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np

DEGREE = np.pi / 180.0
BAR = 1.0e5
RPM = 2.0 * np.pi / 60.0

PROFILES = {"poly4567": 0, "modified_sine": 1, "cycloidal": 2}


@dataclass(frozen=True)
class Cam:
    """Analytic lift law: base circle, rise, top dwell, fall, base circle.

    ``rise_skew``, ``fall_skew`` n warp a flank by x -> 1 - (1 - x)^n: n > 1 puts its steepest part earlier.
    """

    lift: float = 8.0e-3
    rise_start: float = 1.0 * DEGREE
    rise_angle: float = 62.0 * DEGREE
    dwell_angle: float = 27.0 * DEGREE
    fall_angle: float = 73.0 * DEGREE
    rise_profile: str = "poly4567"
    fall_profile: str = "poly4567"
    rise_skew: float = 1.0
    fall_skew: float = 1.5

    def __post_init__(self) -> None:
        if self.rise_start + self.rise_angle + self.dwell_angle + self.fall_angle > 2.0 * np.pi:
            raise ValueError("the lobe is longer than a revolution")


@dataclass(frozen=True)
class Pump:
    """Catalogue values (they go onto the sheet) and what the sheet does not give (roller, lever)."""

    base_circle_radius: float = 20.0e-3
    roller_radius: float = 8.0e-3
    roller_width: float = 5.0e-3
    follower_offset: float = 0.0
    cam_mass: float = 0.25
    cam_inertia: float = 5.0e-5
    follower_mass: float = 0.075
    spring_stiffness: float = 20000.0
    spring_preload: float = 110.0
    plunger_diameter: float = 8.0e-3
    roller_inertia: float = 2.0e-7
    spring_stiffness_error: float = 0.0
    """True rate is sheet rate times (1 + error)."""
    cam: Cam = field(default_factory=Cam)

    @property
    def plunger_area(self) -> float:
        return 0.25 * np.pi * self.plunger_diameter**2


@dataclass(frozen=True)
class Fluid:
    """Barotropic liquid with bulk modulus K = modulus + slope * p (p gauge), cavitating at ``floor``."""

    density: float = 830.0
    modulus: float = 1.30e9
    slope: float = 10.0
    floor: float = -0.9e5


@dataclass(frozen=True)
class Chamber:
    """The space above the plunger and its ports.

    ``dead_volume`` at full lift. The inlet port area falls linearly over ``port_height`` to zero at the lift of
    ``port_close_angle`` on the rise. ``end`` is how delivery ends: ``spill`` (a port whose area opens linearly with
    lift) or ``closed`` (the outlet closes over ``close_width`` and the volume stays trapped). The end is at
    ``end_angle_zero_load + load * end_angle_span``. A suction valve lets oil in through ``suction_area``, none out.
    """

    dead_volume: float = 2.6e-6
    feed_pressure: float = 3.0e5
    port_close_angle: float = 20.2 * DEGREE
    port_height: float = 0.8e-3
    port_area: float = 4.0e-6
    leak: float = 1.0e-14
    """Leakage flow per pressure [m^3/(s Pa)]."""
    leak_growth: float = 0.0
    """Clearance growth per pascal: leakage is multiplied by (1 + growth * p)^3."""
    end: str = "closed"
    end_angle_zero_load: float = 34.0 * DEGREE
    end_angle_span: float = 12.0 * DEGREE
    close_width: float = 1.5 * DEGREE
    spill_area: float = 3.0e-6
    spill_height: float = 0.5e-3
    suction_area: float = 0.0

    def __post_init__(self) -> None:
        if self.end not in ("closed", "spill"):
            raise ValueError(f"end is {self.end!r}, expected closed or spill")


@dataclass(frozen=True)
class Valve:
    """Delivery (check) valve: lift follows the pressure difference beyond the opening pressure until fully open.

    ``mass_frequency`` 0 is the massless valve; otherwise a mass-spring valve of that natural frequency [Hz] that
    retracts ``unloading_volume`` from the line as it closes.
    """

    opening_pressure: float = 12.0e5
    full_open_pressure: float = 45.0e5
    area: float = 3.0e-6
    mass_frequency: float = 0.0
    mass_damping: float = 0.5
    unloading_volume: float = 0.0


@dataclass(frozen=True)
class Line:
    """High-pressure line: volume at the pump end (the sensor sits there), pipe, nozzle volume, injector.

    ``waves`` False lumps the pipe into one volume. ``resistance`` is the loss of the whole pipe over its characteristic
    impedance. The needle opens at ``needle_open`` and closes at ``needle_close``.
    """

    waves: bool = True
    end_volume: float = 0.8e-6
    nozzle_volume: float = 0.5e-6
    length: float = 0.6
    bore: float = 1.8e-3
    resistance: float = 0.25
    needle_open: float = 250.0e5
    needle_close: float = 160.0e5
    needle_time: float = 8.0e-5
    nozzle_area: float = 0.045e-6
    """Effective area of the nozzle holes (flow coefficient included) [m^2]."""


@dataclass(frozen=True)
class Friction:
    """Where the rig rubs. Coulomb terms are smoothed over ``smoothing_speed``."""

    bearing_mu: float = 0.02
    bearing_mu_static: float = 0.02
    stribeck_speed: float = 20.0
    """Shaft speed of the Stribeck fall [rad/s]."""
    bearing_radius: float = 12.5e-3
    pin_mu: float = 0.004
    pin_radius: float = 3.0e-3
    guide_mu: float = 0.02
    guide_lever: float = 1.5
    """Sum of guide reactions over side force (the follower tilts in its bore)."""
    guide_presliding: float = 0.0
    """Dahl pre-sliding length [m]; 0 is plain Coulomb (a foreign law when > 0)."""
    seal_force: float = 15.0
    plunger_viscous: float = 5.0
    drag_torque: float = 0.25
    shaft_viscous: float = 1.5e-3
    churning: float = 0.0
    """Torque per speed squared [N m s^2]."""
    smoothing_speed: float = 2.0e-3


@dataclass(frozen=True)
class Driveline:
    """Drive - (compliant coupling) - transducer - camshaft.

    ``shaft_stiffness`` inf is rigid; ``drive_inertia`` inf turns at the set speed. ``camshaft_inertia`` is the coupling
    half and shaft between transducer and cam, beside the cam itself. ``coupling_stiffness`` finite puts a yielding
    coupling of ``coupling_inertia`` between the drive and the transducer (a foreign law).
    """

    shaft_stiffness: float = 6000.0
    shaft_damping: float = 0.6
    drive_inertia: float = 0.5
    camshaft_inertia: float = 1.2e-4
    coupling_stiffness: float = np.inf
    coupling_damping: float = 0.5
    coupling_inertia: float = 5.0e-3
    control_bandwidth_hz: float = 1.5
    drive_ripple: float = 0.0
    drive_ripple_order: int = 6


@dataclass(frozen=True)
class Trigger:
    """Proximity pulse on the camshaft; the mounted angle is nominal + offset.

    A wheel of ``pulses_per_rev`` pitches lacks its last ``missing_teeth``; its first tooth passes at the trigger angle.
    """

    nominal_angle: float = 20.0 * DEGREE
    angle_offset: float = 0.0
    tolerance: float = 1.5 * DEGREE
    switching_delay: float = 4.0e-5
    delay_error: float = 0.0
    jitter: float = 3.0e-7
    tooth_angle: float = 6.3 * DEGREE
    pulses_per_rev: int = 1
    missing_teeth: int = 0
    pulse_height: float = 5.0


@dataclass(frozen=True)
class TorqueSensor:
    """True gain over certificate gain is 1 + gain_error; zero_residual is what the standstill readings miss [N m]."""

    volts_per_unit: float = 0.025
    gain_error: float = 0.0
    zero: float = 0.3
    zero_residual: float = 0.0
    cutoff_hz: float = 1000.0
    damping: float = np.sqrt(0.5)
    delay: float = 0.45e-3
    """Declared total delay, low-pass included [s]."""
    delay_error: float = 0.0
    """Relative error of the declared total delay."""
    noise: float = 0.06
    ripple: float = 0.03
    ripple_hz: float = 3900.0
    hysteresis: float = 0.0
    """Half width of the reading's hysteresis [N m] (foreign)."""
    pressure_crosstalk: float = 0.0
    """[N m/Pa] (foreign)."""
    bending_crosstalk: float = 0.0
    """[N m/N] of bearing load along the line of action (foreign)."""
    turning_torque: float = 0.0
    turning_arm: float = 0.0
    turning_phase: float = 0.0
    """What the bridge shows as it turns: [N m], [N m/N] of the bearing load, and the cam angle of its maximum [rad]."""


@dataclass(frozen=True)
class PressureSensor:
    """Sensor at the pump end of the ``line``, or in the ``chamber`` itself (a rig with nothing between)."""

    at: str = "line"
    volts_per_unit: float = 0.005 / BAR
    gain_error: float = 0.0
    zero: float = 0.5e5
    zero_residual: float = 0.0
    delay: float = 4.0e-6
    noise: float = 0.25e5


@dataclass(frozen=True)
class Scatter:
    """What differs from cycle to cycle: the angle of the end of delivery, the nozzle, the speed."""

    end_angle: float = 0.03 * DEGREE
    nozzle: float = 0.003
    speed: float = 0.0006
    speed_correlation_s: float = 0.3


@dataclass(frozen=True)
class RigTruth:
    """One rig.

    ``rotation`` -1 turns clockwise: the lift law is along the running direction, the offset stays in space.
    """

    name: str = "rig"
    rotation: int = 1
    pump: Pump = field(default_factory=Pump)
    fluid: Fluid = field(default_factory=Fluid)
    chamber: Chamber = field(default_factory=Chamber)
    valve: Valve = field(default_factory=Valve)
    line: Line = field(default_factory=Line)
    friction: Friction = field(default_factory=Friction)
    driveline: Driveline = field(default_factory=Driveline)
    trigger: Trigger = field(default_factory=Trigger)
    torque_sensor: TorqueSensor = field(default_factory=TorqueSensor)
    pressure_sensor: PressureSensor = field(default_factory=PressureSensor)
    scatter: Scatter = field(default_factory=Scatter)

    def __post_init__(self) -> None:
        if self.rotation not in (1, -1):
            raise ValueError("rotation is +1 or -1")

    @property
    def equivalent_bearing_arm(self) -> float:
        """Friction torque over contact load of bearing and roller pin together, at half lift [m].

        The pin turns L/r_r - 1 times per cam angle, so a fit without a pin finds it in the bearing.
        """
        pump, friction = self.pump, self.friction
        turns = (pump.base_circle_radius + 0.5 * pump.cam.lift) / pump.roller_radius
        return friction.bearing_mu * friction.bearing_radius + friction.pin_mu * friction.pin_radius * turns


def change(truth: RigTruth, **values: object) -> RigTruth:
    """Return a copy with some parameters changed: ``change(rig, friction__guide_mu=0.0, pump__cam__lift=0.01)``."""
    tree: dict[str, object] = {}
    for path, value in values.items():
        node = tree
        *parents, leaf = path.split("__")
        for name in parents:
            node = node.setdefault(name, {})  # type: ignore[assignment]
        node[leaf] = value
    return _replaced(truth, tree)


def _replaced(record, tree):
    known = {item.name for item in fields(record)}
    unknown = set(tree) - known
    if unknown:
        raise KeyError(f"{type(record).__name__} has no {sorted(unknown)}")
    return replace(
        record,
        **{
            name: _replaced(getattr(record, name), value) if isinstance(value, dict) else value
            for name, value in tree.items()
        },
    )


NO_FRICTION = Friction(
    bearing_mu=0.0,
    bearing_mu_static=0.0,
    pin_mu=0.0,
    guide_mu=0.0,
    seal_force=0.0,
    plunger_viscous=0.0,
    drag_torque=0.0,
    shaft_viscous=0.0,
)
RIGID_DRIVELINE = Driveline(shaft_stiffness=np.inf, drive_inertia=np.inf, camshaft_inertia=0.0)
NO_SCATTER = Scatter(end_angle=0.0, nozzle=0.0, speed=0.0)

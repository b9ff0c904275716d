"""TOML at the border -> checked, frozen configuration in SI and radians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.records import Finding, Refusal


@dataclass(frozen=True)
class PumpData:
    """Catalogue values of a pump, SI.

    Attributes
    ----------
    follower_mass : all sliding parts, roller and a third of the spring included [kg]
    roller_mass, roller_inertia : None where the sheet does not give them (literature values are then assumed)
    cam_table_path, cam_table_angle_column, cam_table_lift_column : where the lift table is
    """

    base_circle_radius: float
    roller_radius: float
    roller_width: float
    follower_offset: float
    cam_mass: float
    cam_inertia: float
    follower_mass: float
    spring_stiffness: float
    spring_preload: float
    plunger_diameter: float
    youngs_modulus_cam: float
    youngs_modulus_roller: float
    cam_table_path: Path
    cam_table_angle_column: str
    cam_table_lift_column: str
    poisson_ratio: float = 0.3
    roller_mass: float | None = None
    roller_inertia: float | None = None

    @property
    def plunger_area(self) -> float:
        """Cross-section of the plunger [m^2]."""
        return 0.25 * np.pi * self.plunger_diameter**2


@dataclass(frozen=True)
class TriggerSpec:
    """The proximity trigger, tooth wheel, index or encoder.

    Attributes
    ----------
    nominal_angle : cam angle of the edge [rad]
    installation_tolerance : half width of the mounting tolerance [rad]
    edge : ``rising`` or ``falling``
    pulses_per_rev : teeth, missing teeth counted as if present
    switching_delay : [s]
    missing_teeth : teeth left out at the mark (0 for a plain trigger)
    double_tooth : True where one extra tooth marks the revolution
    sensor : ``digital``, ``inductive`` or ``hall``
    revolutions_per_cycle : turns of the wheel per turn of the cam
    side : ``cam`` or ``motor``: which end of the shaft it sits on
    meaning : what happens at the nominal angle, in the bench's words
    reference : ``index`` where the nominal angle is that of the index channel's pulse, else ""
    """

    nominal_angle: float
    installation_tolerance: float
    edge: str = "rising"
    pulses_per_rev: int = 1
    switching_delay: float = 0.0
    missing_teeth: int = 0
    double_tooth: bool = False
    sensor: str = "digital"
    revolutions_per_cycle: int = 1
    side: str = "cam"
    reference: str = ""
    meaning: str = ""

    @property
    def pulses_per_cycle(self) -> int:
        """Pulses per turn of the cam, missing teeth counted as if present."""
        return self.pulses_per_rev * self.revolutions_per_cycle


@dataclass(frozen=True)
class SensorRef:
    """A sensor as the recording names it: sheet and standstill readings (None where not taken).

    Attributes
    ----------
    calibration_path : its sheet; None where ``sheet`` holds the keys of one, as the recording states them itself
    zero_before_volts, zero_after_volts : standstill readings [V]
    zero_before, zero_after : the same in the unit of the channel, where the logger has scaled
    idle_from, idle_to : a stretch of the recording at standstill [s after the channel's first sample]
    """

    quantity: str
    serial: str
    calibration_path: Path | None
    zero_before_volts: float | None
    zero_after_volts: float | None
    idle_from: float | None = None
    idle_to: float | None = None
    zero_before: float | None = None
    zero_after: float | None = None
    sheet: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class FluidSpec:
    """What the bench says of the fuel; None where it says nothing.

    temperature [K]; bulk_modulus [Pa] at feed pressure and bulk_modulus_slope its rise per rise of pressure [-];
    feed_pressure [Pa, gauge].
    """

    name: str = ""
    temperature: float | None = None
    bulk_modulus: float | None = None
    bulk_modulus_slope: float | None = None
    feed_pressure: float | None = None


@dataclass(frozen=True)
class DriveSpec:
    """What the bench says of the machine that turns the pump; None where it says nothing.

    kind : ``servo``, ``flywheel``, ``induction``, ... or ""; inertia of the drive's side [kg m^2]; speed_loop :
    bandwidth of the speed control [Hz]; shaft_stiffness from drive to cam [N m/rad].
    """

    kind: str = ""
    inertia: float | None = None
    speed_loop: float | None = None
    shaft_stiffness: float | None = None


@dataclass(frozen=True)
class LoggerSpec:
    """A logger: ``clock`` is ``single``, ``synchronised`` or ``independent``."""

    id: str
    clock: str


@dataclass(frozen=True)
class ChannelSpec:
    """One channel by name; ``sample_rate`` [Hz] as the bench file declares it.

    ``time_channel`` names the column or variable that holds its times ("" where the format or its name tells),
    ``supply_channel`` the one with the supply of a bridge [V]; ``start_time`` [s] is that of sample 0 where the file
    has no times; ``duration`` [s] is what the bench ordered.
    """

    quantity: str
    path: Path
    group: str
    channel: str
    unit: str
    logger: str
    sample_rate: float
    sensor: str
    time_channel: str = ""
    supply_channel: str = ""
    start_time: float | None = None
    duration: float | None = None

    @property
    def output_unit(self) -> str:
        """Unit of what the sensor gives: that of the channel, but mV/V where its supply is recorded beside it."""
        return "mV/V" if self.supply_channel else self.unit


@dataclass(frozen=True)
class RecordingConfig:
    """`recording.toml`, checked.

    Attributes
    ----------
    rotation : +1 or -1
    file_format : as the file says it, "" where the content of the logs tells
    pump_sheet : None where the file has no [pump]; read it as ``pump``, which refuses then
    group : recordings of one group are fitted together
    date : of the recording, None where not stated
    text : the file as read
    findings : unknown keys and what was assumed
    """

    path: Path
    text: str
    id: str
    pump_id: str
    nominal_speed: float
    file_format: str
    csv_dialect: str
    rotation: int
    pump_sheet: PumpData | None
    trigger: TriggerSpec
    sensors: Mapping[str, SensorRef]
    loggers: tuple[LoggerSpec, ...]
    channels: tuple[ChannelSpec, ...]
    findings: tuple[Finding, ...] = field(default=())
    group: str = ""
    date: date | None = None
    fluid: FluidSpec = field(default_factory=FluidSpec)
    drive: DriveSpec = field(default_factory=DriveSpec)

    @property
    def pump(self) -> PumpData:
        """The pump's catalogue values; refused where recording.toml states none."""
        if self.pump_sheet is None:
            raise Refusal(f"{self.path}: the table [pump] is missing; the model needs it ('camtorque align' does not)")
        return self.pump_sheet

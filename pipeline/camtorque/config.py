"""TOML at the border -> checked, frozen configuration in SI and radians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from camtorque.records import Finding


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
    """The proximity trigger or tooth wheel.

    Attributes
    ----------
    nominal_angle : cam angle of the edge [rad]
    installation_tolerance : half width of the mounting tolerance [rad]
    edge : ``rising`` or ``falling``
    pulses_per_rev : teeth, missing teeth counted as if present
    missing_teeth : teeth left out at the mark (0 for a plain trigger)
    double_tooth : True where one extra tooth marks the revolution
    level_volts : height of the pulse, not a threshold
    switching_delay : [s]
    """

    nominal_angle: float
    installation_tolerance: float
    edge: str
    pulses_per_rev: int
    level_volts: float
    switching_delay: float
    missing_teeth: int = 0
    double_tooth: bool = False


@dataclass(frozen=True)
class SensorRef:
    """A sensor as the recording names it: sheet and standstill readings [V] (None where not taken).

    ``idle_from``, ``idle_to`` mark a stretch of the recording at standstill [s after the channel's first sample].
    """

    quantity: str
    serial: str
    calibration_path: Path
    zero_before_volts: float | None
    zero_after_volts: float | None
    location: str = ""
    idle_from: float | None = None
    idle_to: float | None = None


@dataclass(frozen=True)
class LoggerSpec:
    """A logger: ``clock`` is ``single``, ``synchronised`` or ``independent``."""

    id: str
    clock: str


@dataclass(frozen=True)
class ChannelSpec:
    """One channel by name; ``sample_rate`` [Hz] as the bench file declares it.

    ``time_channel`` names the column or variable that holds its times ("" where the format or its name tells);
    ``start_time`` [s] is that of sample 0 where the file has no times; ``duration`` [s] is what the bench ordered.
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
    start_time: float | None = None
    duration: float | None = None


@dataclass(frozen=True)
class RecordingConfig:
    """`recording.toml`, checked.

    ``rotation`` is +1 or -1; ``text`` is the file as read; ``findings`` holds the unknown bench keys.
    """

    path: Path
    text: str
    id: str
    pump_id: str
    nominal_speed: float
    file_format: str
    csv_dialect: str
    acquisition: str
    rotation: int
    note: str
    pump: PumpData
    trigger: TriggerSpec
    sensors: Mapping[str, SensorRef]
    loggers: tuple[LoggerSpec, ...]
    channels: tuple[ChannelSpec, ...]
    findings: tuple[Finding, ...] = field(default=())

"""The checked configuration of a recording: a frozen record for each table of recording.toml, in SI and radians.

A field is the key of `camtorque.config.schemas` without its unit, where its meaning and its allowed band stand. Here is
said only what the key does not say.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.records import Finding, Refusal

IN_CHAMBER = re.compile(r"\bchamber\b", re.IGNORECASE)
ELSEWHERE = re.compile(
    r"\b(line|pipe|tube|hose|rail|holder|nozzle|injector|accumulator|gallery|inlet|outlet|suction|spring|from|behind|after|"
    r"downstream|outside|not)\b|\b(valve|injection|spray|combustion|feed|low.?pressure|supply|damping|damper|buffer|"
    r"spill|return|air|cam|climate|test|measuring|meter)[ -]chamber\b",
    re.IGNORECASE,
)
"""Words of a sensor's location by which it sits in the plunger's chamber, and by which it does not: other things than
a pump have chambers, too."""
LENGTH = re.compile(r"(\d+(?:[.,]\d+)?) ?(mm|cm|m)\b")
"""A length in a sensor's location: how far along the line it sits."""
METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


@dataclass(frozen=True)
class PumpData:
    """Catalogue values of a pump; roller mass and inertia are None where literature values are to be assumed."""

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
    cam_table_zero: float = 0.0
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

    ``pulses_per_rev`` counts missing teeth as if present; ``reference`` is ``index`` or ""; ``start_of_lift`` is where
    the lift starts in a table that counts from elsewhere, as ``nominal_angle`` does not.
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
    start_of_lift: float = 0.0

    @property
    def stated_angle(self) -> float:
        """The nominal angle as recording.toml has it, which counts from the zero of the lift table [rad]."""
        return self.nominal_angle + self.start_of_lift

    @property
    def pulses_per_cycle(self) -> int:
        """Pulses per turn of the cam, missing teeth counted as if present."""
        return self.pulses_per_rev * self.revolutions_per_cycle


@dataclass(frozen=True)
class SensorRef:
    """A sensor as the recording names it; standstill readings are None where not taken.

    Attributes
    ----------
    calibration_path : its sheet; None where ``sheet`` holds the keys of one, as the recording states them itself
    zero_before_volts, zero_after_volts : standstill readings [V]
    zero_before, zero_after : the same in the unit of the channel, where the logger has scaled
    idle_from, idle_to : a stretch of the recording at standstill [s after the channel's first sample]
    location : where it sits, in words
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
    location: str = ""

    @property
    def is_in_chamber(self) -> bool:
        """Whether the recording says that it sits in the plunger's chamber, and not in a line from there."""
        return bool(IN_CHAMBER.search(self.location)) and not ELSEWHERE.search(self.location)

    @property
    def distance(self) -> float | None:
        """How far along the line it sits, where its location holds one length [m]."""
        lengths = LENGTH.findall(self.location)
        if len(lengths) != 1 or self.is_in_chamber:
            return None
        number, unit = lengths[0]
        return float(number.replace(",", ".")) * METRES[unit]


@dataclass(frozen=True)
class FluidSpec:
    """What the bench says of the fuel; None where it says nothing."""

    name: str = ""
    temperature: float | None = None
    bulk_modulus: float | None = None
    bulk_modulus_slope: float | None = None
    feed_pressure: float | None = None


@dataclass(frozen=True)
class DriveSpec:
    """What the bench says of the machine that turns the pump; None where it says nothing."""

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
    """One channel by name; ``duration`` is that of the recording where the channel states none."""

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
    pump_sheet : None where the file has no [pump]; read it as ``pump``, which refuses then
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

    @property
    def pump_state(self) -> str:
        """The pump, and the group that the recording names: recordings of one such state may be fitted together."""
        return f"{self.pump_id} ({self.group})" if self.group else self.pump_id

    @property
    def measures_chamber(self) -> bool:
        """Whether the recorded pressure is that on the plunger."""
        return "pressure" in self.sensors and self.sensors["pressure"].is_in_chamber

    @property
    def has_teeth(self) -> bool:
        """Whether more than one pulse tells a turn of the cam, or its angle was recorded."""
        return self.trigger.pulses_per_cycle > 1 or any(channel.quantity == "angle" for channel in self.channels)

    @property
    def own_clocks(self) -> frozenset[str]:
        """The loggers whose clock is their own; all others share one."""
        return frozenset(logger.id for logger in self.loggers if logger.clock == "independent")

    def name_of(self, spec: ChannelSpec) -> str:
        """Return what texts call a channel: with its group where another one of its file has its name."""
        alike = [one for one in self.channels if (one.path, one.channel) == (spec.path, spec.channel)]
        return f"{spec.group}/{spec.channel}" if spec.group and len(alike) > 1 else spec.channel

    def share_clock(self, one: str, other: str) -> bool:
        """Return whether two loggers are one, or on the common clock."""
        return one == other or not self.own_clocks & {one, other}

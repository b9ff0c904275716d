"""Wheels, encoders and counters of every kind, sampled from a known shaft angle by closed formulas.

The angle of the shaft is a formula of time (`align_truth.Shaft`). A digital pick-up is a steep ramp of the angle at
the two edges of each tooth; an inductive one is the rate of a flux that is a sum of bumps, one per tooth, so that a gap
bends the waves beside it; teeth have errors of their own. Nothing here is taken from the aligner.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from align_truth import TWO_PI, Rig, Samples, Shaft, physical_channel, recording_of
from camtorque.align.angle import cam_angle
from camtorque.align.timebase import time_base
from camtorque.records import Channel, Recording


@dataclass(frozen=True)
class Wheel:
    """A wheel on the cam shaft, or on a shaft that turns ``turns`` times as fast."""

    shaft: Shaft = field(default_factory=lambda: Shaft(rpm=600.0, ripple=0.01))
    teeth: int = 60
    missing: int = 2
    turns: int = 1
    kind: str = "digital"
    rate: float = 50e3
    duration: float = 3.0
    error_deg: float = 0.05
    """Standard deviation of the teeth's places on the wheel [degrees of the wheel]."""
    noise: float = 0.02
    flank_rad: float = 0.004
    nominal_deg: float = 20.0
    index: bool = False
    index_at: float = 0.3
    """Where the index pulse rises, in pitches after the tooth of the nominal angle."""
    edge: str = "rising"
    extra: float = 0.0
    """How far before tooth 0 an extra one stands, in pitches; 0 for none."""
    seed: int = 3

    @property
    def errors(self) -> np.ndarray:
        """Places of the teeth against where they should be [rad of the wheel]."""
        return np.radians(self.error_deg) * np.random.default_rng(self.seed).standard_normal(self.teeth)

    @property
    def times(self) -> np.ndarray:
        return np.arange(round(self.duration * self.rate)) / self.rate

    def wheel_angle(self, t: np.ndarray) -> np.ndarray:
        """Angle of the wheel since the tooth of the nominal angle [rad]."""
        return self.turns * (self.shaft.angle(t) - np.radians(self.nominal_deg))

    def true_angle(self, t: np.ndarray) -> np.ndarray:
        return self.shaft.angle(t)


def tooth_distance(wheel: Wheel, angle: np.ndarray, neighbour: int) -> tuple[np.ndarray, np.ndarray]:
    """Angle from a tooth (the nearest one, or a neighbour of it) to each sample, and whether that tooth is there."""
    pitch = TWO_PI / wheel.teeth
    k = np.round(angle / pitch).astype(np.int64) + neighbour
    there = k % wheel.teeth < wheel.teeth - wheel.missing
    return angle - k * pitch - wheel.errors[k % wheel.teeth], there


def wheel_volts(wheel: Wheel) -> np.ndarray:
    angle = wheel.wheel_angle(wheel.times)
    pitch, noise = TWO_PI / wheel.teeth, np.random.default_rng(wheel.seed + 1).standard_normal(angle.size)
    volts = np.zeros(angle.size)
    width = 0.16 * pitch
    for neighbour in (-3, -2, -1, 0, 1, 2, 3):
        distance, there = tooth_distance(wheel, angle, neighbour)
        if wheel.kind == "inductive":
            volts -= there * distance / width**2 * np.exp(-0.5 * (distance / width) ** 2)
        else:
            steep = wheel.flank_rad * pitch
            rise, fall = distance / steep, (distance - 0.4 * pitch) / steep
            volts += there * 5.0 * (np.clip(rise + 0.5, 0.0, 1.0) - np.clip(fall + 0.5, 0.0, 1.0))
    if wheel.extra:
        ahead = (angle + (wheel.extra + 0.2) * pitch) % TWO_PI - 0.2 * pitch
        steep = wheel.flank_rad * pitch
        volts += 5.0 * (np.clip(ahead / steep + 0.5, 0, 1) - np.clip((ahead - 0.15 * pitch) / steep + 0.5, 0, 1))
    if wheel.kind == "inductive":
        speed = np.gradient(angle, wheel.times)
        volts = 0.02 * volts * speed / wheel.teeth
    return volts + wheel.noise * noise


def pulse_channel(wheel: Wheel, quantity: str, volts: np.ndarray) -> Channel:
    return Channel(quantity, "DAQ", Samples(volts), 0.0, wheel.rate, None, Path("DAQ.dat"), quantity)


def index_volts(wheel: Wheel) -> np.ndarray:
    """One pulse per turn of the cam."""
    pitch = TWO_PI / wheel.teeth
    angle = (wheel.wheel_angle(wheel.times) - wheel.index_at * pitch) % (TWO_PI * wheel.turns)
    noise = np.random.default_rng(wheel.seed + 2).standard_normal(angle.size)
    return 5.0 * (angle < 0.8 * pitch) + wheel.noise * noise


def wheel_recording(wheel: Wheel, *pulse_channels: Channel, volts: np.ndarray | None = None) -> Recording:
    """A recording of torque, pressure and the wheel (or the given channels in its place)."""
    rig = Rig(
        shaft=wheel.shaft, duration=wheel.duration, torque_rate=20e3, pressure_rate=20e3, nominal_deg=wheel.nominal_deg,
        switching_delay=0.0, torque_noise=0.3, pressure_noise=1e5, pulses_per_rev=wheel.teeth,
        missing_teeth=wheel.missing,
    )  # fmt: skip
    channels = pulse_channels
    if not channels:
        channels = (pulse_channel(wheel, "trigger", wheel_volts(wheel) if volts is None else volts),)
        channels += (pulse_channel(wheel, "index", index_volts(wheel)),) if wheel.index else ()
    physical = (physical_channel(rig, "torque"), physical_channel(rig, "pressure"))
    recording = recording_of(rig, (*physical, *channels))
    by_index = wheel.index and not wheel.missing
    at_index = np.radians(wheel.index_at * 360.0 / wheel.teeth / wheel.turns) if by_index else 0.0
    trigger = recording.config.trigger
    trigger = replace(
        trigger, nominal_angle=trigger.nominal_angle + at_index, sensor=wheel.kind,
        revolutions_per_cycle=wheel.turns, edge=wheel.edge, double_tooth=bool(wheel.extra),
    )  # fmt: skip
    return replace(recording, config=replace(recording.config, trigger=trigger))


@dataclass(frozen=True)
class Judged:
    """Tooth by tooth: error of the cam angle and what is stated for it [deg]."""

    error: np.ndarray
    stated: np.ndarray

    @property
    def ratio(self) -> float:
        """Stated over actual error."""
        return float(np.sqrt(np.mean(self.stated**2) / np.mean(self.error**2)))


def judged(wheel: Wheel, recording: Recording) -> Judged:
    """Compare the angle of every pulse that was used with the truth."""
    base = time_base(recording, "DAQ")
    angle = cam_angle(base.train, recording.config.trigger, base.pulses_per_cycle, base.places)
    truth = wheel.true_angle(base.train.time)
    error = (angle.angle - truth + np.pi) % TWO_PI - np.pi
    places = base.places
    assert places is not None
    own = base.edge_noise * wheel.shaft.speed
    stated = np.hypot(places.place_std[base.train.step % base.pulses_per_cycle], own)
    stated = np.hypot(stated, base.index_std)
    return Judged(np.degrees(error), np.degrees(stated))


def true_deviation(shaft: Shaft, theta: np.ndarray) -> np.ndarray:
    """Angle ahead of even running, mean free: theta - phi with theta = phi + ripple / order sin(order phi)."""
    phi = theta.copy()
    for _ in range(50):
        phi = theta - shaft.ripple / shaft.order * np.sin(shaft.order * phi)
    return theta - phi

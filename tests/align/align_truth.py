"""Logs made from a known shaft angle, by a method independent of the aligner.

The angle is a closed formula of time; edge times are its roots, sensor signals are closed formulas of the angle at the
delayed time, sampled on each logger's own clock. Nothing is interpolated or resampled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from camtorque.config import LoggerSpec, RecordingConfig, TriggerSpec
from camtorque.records import CamTable, Channel, Recording, SensorCalibration
from camtorque.studies.case import study_pump

TWO_PI = 2.0 * np.pi
TORQUE_GAIN, PRESSURE_GAIN = 40.0, 200.0e5


@dataclass(frozen=True)
class Samples:
    values: np.ndarray

    @property
    def n_samples(self) -> int:
        return self.values.size

    def read(self, start: int, stop: int) -> np.ndarray:
        return self.values[start:stop]


@dataclass(frozen=True)
class Shaft:
    """theta(t) = phi + ripple / order sin(order phi), phi = start + speed t + wander; ``ramp`` is speed per second."""

    rpm: float = 500.0
    start: float = 0.3
    ramp: float = 0.0
    wander: float = 2.0e-4
    wander_hz: float = 0.37
    ripple: float = 0.0
    order: int = 2

    @property
    def speed(self) -> float:
        return self.rpm * TWO_PI / 60.0

    def angle(self, t: np.ndarray) -> np.ndarray:
        slow = self.wander * self.speed / (TWO_PI * self.wander_hz) * np.sin(TWO_PI * self.wander_hz * t)
        faster = 0.4 * self.wander * self.speed / (TWO_PI * 1.7) * np.cos(TWO_PI * 1.7 * t + 0.4)
        phi = self.start + self.speed * t + 0.5 * self.ramp * self.speed * t * t + slow + faster
        return phi + self.ripple / self.order * np.sin(self.order * phi)

    def time_of(self, angle: np.ndarray) -> np.ndarray:
        """Solve angle(t) = angle by the secant method."""
        t = (angle - self.start) / self.speed
        for _ in range(60):
            step = (self.angle(t) - angle) / ((self.angle(t + 1e-6) - self.angle(t - 1e-6)) / 2e-6)
            t = t - step
        return t


def torque_of(theta: np.ndarray) -> np.ndarray:
    """Torque [N m] of the cam angle: rises with the lift, drives the cam on the return, small drag."""
    return 55.0 * _bump(theta, 0.70, 0.30) - 38.0 * _bump(theta, 2.15, 0.33) + 0.8 + 0.3 * np.sin(theta)


def pressure_of(theta: np.ndarray) -> np.ndarray:
    """Line pressure [Pa]: peak during the rise, reflections, a residual on the base circle."""
    return 1e5 * (560.0 * _bump(theta, 0.82, 0.32) + 90.0 * _bump(theta, 1.9, 0.25) + 80.0 + 6.0 * np.cos(3 * theta))


def lift_of(theta: np.ndarray) -> np.ndarray:
    rise = np.clip((theta - 0.05) / 1.25, 0.0, 1.0)
    fall = np.clip((theta - 1.5) / 1.25, 0.0, 1.0)
    return 8e-3 * (_step(rise) - _step(fall))


def _step(u: np.ndarray) -> np.ndarray:
    return u**3 * (10.0 - 15.0 * u + 6.0 * u * u)


def _bump(theta: np.ndarray, centre: float, width: float) -> np.ndarray:
    """Smooth, periodic, close to a Gaussian."""
    return np.exp((np.cos(theta - centre) - 1.0) / width**2)


@dataclass(frozen=True)
class LogClock:
    """t_logger = offset + (1 + skew) t, recording starts at ``begin`` [s of true time]."""

    offset: float = 0.0
    skew: float = 0.0
    begin: float = 0.0

    def true_time(self, n: int, rate: float) -> np.ndarray:
        """True time of each sample; sample i is at begin + i / rate on the logger's own clock."""
        return self.begin + np.arange(n) / rate / (1.0 + self.skew)

    def own(self, t: float) -> float:
        return self.offset + (1.0 + self.skew) * t


@dataclass(frozen=True)
class Rig:
    shaft: Shaft = Shaft()
    duration: float = 4.0
    torque_rate: float = 20000.0
    pressure_rate: float = 50000.0
    trigger_rate: float = 20000.0
    nominal_deg: float = 20.0
    switching_delay: float = 4e-5
    torque_delay: float = 4.5e-4
    pressure_delay: float = 4e-6
    flank: float = 6e-5
    pulse_rad: float = 0.11
    trigger_noise: float = 0.03
    torque_noise: float = 0.0
    pressure_noise: float = 0.0
    edge_jitter: float = 0.0
    clocks: dict[str, LogClock] = field(default_factory=dict)
    clock_kind: str = "single"
    pulses_per_rev: int = 1
    missing_teeth: int = 0
    double_tooth: bool = False
    edge: str = "rising"
    scatter: float = 0.0
    torque_law: Callable[[np.ndarray], np.ndarray] | None = None
    seed: int = 1

    @property
    def rng(self) -> np.random.Generator:
        return np.random.default_rng(self.seed)

    def logger(self, quantity: str) -> str:
        if self.clock_kind == "single":
            return "DAQ"
        return {"torque": "A", "trigger": "A", "pressure": "B", "trigger_b": "B"}[quantity]

    def clock(self, quantity: str) -> LogClock:
        return self.clocks.get(self.logger(quantity), LogClock())

    def pulse_times(self) -> np.ndarray:
        """True times at which the teeth pass (half height, before the switching delay)."""
        pitch = TWO_PI / self.pulses_per_rev
        last = int(self.shaft.angle(np.array([self.duration + 2.0]))[0] / TWO_PI) + 2
        steps = np.arange(-self.pulses_per_rev, last * self.pulses_per_rev)
        if self.missing_teeth:
            steps = steps[steps % self.pulses_per_rev < self.pulses_per_rev - self.missing_teeth]
        angles = np.radians(self.nominal_deg) + steps * pitch
        if self.double_tooth:
            extra = np.radians(self.nominal_deg) + (np.arange(-1, last) * self.pulses_per_rev - 0.5) * pitch
            angles = np.sort(np.r_[angles, extra])
        times = self.shaft.time_of(angles)
        return times + self.edge_jitter * self.rng.standard_normal(times.size)


def trigger_volts(rig: Rig, t: np.ndarray, pulses: np.ndarray, width: np.ndarray | float) -> np.ndarray:
    """5 V pulses over a rest of 0.06 V with straight flanks."""
    begin = pulses + rig.switching_delay
    end = begin + width
    volts = np.full(t.size, 0.06)
    half = 0.5 * rig.flank
    for up, down in zip(begin, end, strict=True):
        i, j = np.searchsorted(t, (up - half, down + half))
        part = t[i:j]
        volts[i:j] += 5.0 * (
            np.clip((part - up) / rig.flank + 0.5, 0, 1) - np.clip((part - down) / rig.flank + 0.5, 0, 1)
        )
    return volts


def calibration(quantity: str, delay: float) -> SensorCalibration:
    torque = quantity == "torque"
    return SensorCalibration(
        serial="S",
        quantity=quantity,
        gain=TORQUE_GAIN if torque else PRESSURE_GAIN,
        gain_relative_std=1e-3,
        zero_volts=0.0,
        zero_std=0.1,
        zero_source="certificate",
        nonlinearity_std=0.01,
        delay=delay,
        delay_std=0.02 * delay,
        cutoff_hz=1000.0,
        filter_order=2,
        range_min=-200.0 if torque else 0.0,
        range_max=200.0 if torque else 2000e5,
        output_min_volts=-5.0 if torque else 0.0,
        output_max_volts=5.0 if torque else 10.0,
    )


def channel(rig: Rig, quantity: str, values: np.ndarray, rate: float, delay: float = 0.0) -> Channel:
    kind = "trigger" if quantity.startswith("trigger") else quantity
    clock = rig.clock(quantity)
    return Channel(
        quantity=kind,
        logger=rig.logger(quantity),
        source=Samples(values),
        start_time=clock.own(clock.begin),
        sample_rate=rate,
        calibration=None if kind == "trigger" else calibration(quantity, delay),
        path=Path(f"{rig.logger(quantity)}.dat"),
        name=quantity,
    )


def sampled(rig: Rig, quantity: str, rate: float) -> np.ndarray:
    """True times of the samples of a channel."""
    return rig.clock(quantity).true_time(round(rig.duration * rate), rate)


def trigger_channel(
    rig: Rig, quantity: str = "trigger", pulses: np.ndarray | None = None, rate: float = 0.0
) -> Channel:
    rate = rate or rig.trigger_rate
    t = sampled(rig, quantity, rate)
    pulses = rig.pulse_times() if pulses is None else pulses
    width = rig.pulse_rad / rig.shaft.speed / rig.pulses_per_rev
    if rig.pulses_per_rev > 1:
        width = 0.2 * TWO_PI / rig.shaft.speed / rig.pulses_per_rev
    noise = rig.trigger_noise * np.random.default_rng(rig.seed + 7 + len(quantity)).standard_normal(t.size)
    return channel(rig, quantity, trigger_volts(rig, t, pulses, width) + noise, rate)


def physical_channel(rig: Rig, quantity: str) -> Channel:
    rate, delay, law, gain, noise = {
        "torque": (rig.torque_rate, rig.torque_delay, rig.torque_law or torque_of, TORQUE_GAIN, rig.torque_noise),
        "pressure": (rig.pressure_rate, rig.pressure_delay, pressure_of, PRESSURE_GAIN, rig.pressure_noise),
    }[quantity]
    t = sampled(rig, quantity, rate)
    theta = rig.shaft.angle(t - delay)
    heights = 1.0 + rig.scatter * rig.rng.standard_normal(int(theta[-1] / TWO_PI) + 2)
    values = law(theta) * heights[np.floor(theta / TWO_PI).astype(int)]
    values = values + noise * np.random.default_rng(rig.seed + len(quantity)).standard_normal(t.size)
    return channel(rig, quantity, values / gain, rate, delay)


def recording_of(rig: Rig, channels: tuple[Channel, ...]) -> Recording:
    grid = np.radians(np.arange(360.0))
    trigger = TriggerSpec(
        nominal_angle=np.radians(rig.nominal_deg), installation_tolerance=np.radians(1.5), edge=rig.edge,
        pulses_per_rev=rig.pulses_per_rev, switching_delay=rig.switching_delay,
        missing_teeth=rig.missing_teeth, double_tooth=rig.double_tooth,
    )  # fmt: skip
    kind = "single" if rig.clock_kind == "single" else rig.clock_kind
    loggers = tuple(LoggerSpec(name, kind) for name in dict.fromkeys(c.logger for c in channels))
    config = RecordingConfig(
        path=Path("recording.toml"), text="", id="synthetic", pump_id="P", nominal_speed=rig.shaft.speed,
        file_format="x", csv_dialect="", rotation=1,
        pump_sheet=replace(study_pump(), follower_offset=0.0), trigger=trigger, sensors={}, loggers=loggers,
        channels=(),
    )  # fmt: skip
    return Recording(config, channels, CamTable(grid, lift_of(grid), 1e-6), (), ())


def make(rig: Rig, pulses: np.ndarray | None = None) -> Recording:
    """Return the recording of a rig; ``pulses`` replaces the true pulse times."""
    channels = [physical_channel(rig, "torque"), physical_channel(rig, "pressure"), trigger_channel(rig, pulses=pulses)]
    if rig.clock_kind == "independent":
        channels.append(trigger_channel(rig, "trigger_b", rate=rig.pressure_rate))
    return recording_of(rig, tuple(channels))


def angle_error_deg(rows: np.ndarray, law, theta: np.ndarray) -> float:
    """Angle [deg] by which the mean cycle lies late, from a least-squares shift against the true law."""
    mean, truth = rows.mean(axis=0), law(theta)
    slope = (law(theta + 1e-5) - law(theta - 1e-5)) / 2e-5
    # mean(theta) = law(theta - shift)
    return float(np.degrees(-(slope @ (mean - truth)) / (slope @ slope)))

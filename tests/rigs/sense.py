"""What the sensors of a rig say: volts on sample times, and the trigger edges, from the true histories."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter, lfilter_zi

from rigs.rig import RigRun

ADC_STEP = 20.0 / 2**16
"""16 bit over +/-10 V [V]."""
EDGE_TIME = 2.0e-5
"""Rise and fall time of the proximity pulse [s]."""
TRIGGER_NOISE = 0.02
HYSTERESIS_SPAN = 10.0
"""Torque over which the reading's hysteresis turns round [N m]."""


@dataclass(frozen=True)
class Signal:
    """Volts sampled at ``start + i / rate`` in true time."""

    start: float
    rate: float
    volts: np.ndarray

    @property
    def times(self) -> np.ndarray:
        """Sample times [s]."""
        return self.start + np.arange(self.volts.size) / self.rate


def _low_pass(values: np.ndarray, step: float, cutoff_hz: float, damping: float) -> np.ndarray:
    """Second-order low-pass with its natural frequency at ``cutoff_hz``, exact for input linear between samples."""
    w = 2.0 * np.pi * cutoff_hz
    numerator, denominator, _ = cont2discrete(([w * w], [1.0, 2.0 * damping * w, w * w]), step, method="foh")
    b = np.squeeze(numerator)
    start = lfilter_zi(b, denominator) * values[0]
    return lfilter(b, denominator, values, zi=start)[0]


def _hysteresis(values: np.ndarray, half_width: float) -> np.ndarray:
    """Rate-independent loop (Dahl): dz = (1 - z sign(dT)) dT / span, added with its half width."""
    z, out = 0.0, np.empty_like(values)
    out[0] = 0.0
    for i, change in enumerate(np.diff(values)):
        z += (1.0 - z * np.sign(change)) * change / HYSTERESIS_SPAN
        z = min(1.0, max(-1.0, z))
        out[i + 1] = z
    return values + half_width * out


def torque_reading(run: RigRun) -> np.ndarray:
    """Return what the transducer gives on ``run.time``, in N m before gain and zero, pure delay not applied."""
    sensor = run.truth.torque_sensor
    torque = run.history["torque"]
    if sensor.hysteresis:
        torque = _hysteresis(torque, sensor.hysteresis)
    torque = torque + sensor.pressure_crosstalk * run.history["line_pressure"]
    torque = torque + sensor.bending_crosstalk * run.history["bearing_along"]
    turning = sensor.turning_torque + sensor.turning_arm * run.history["bearing_along"]
    torque = torque + turning * np.cos(run.history["cam_angle"] - sensor.turning_phase)
    return _low_pass(torque, run.time[1] - run.time[0], sensor.cutoff_hz, sensor.damping)


def pure_torque_delay(run: RigRun) -> float:
    """Return the true total delay less that of the low-pass [s]."""
    sensor = run.truth.torque_sensor
    return sensor.delay * (1.0 + sensor.delay_error) - 2.0 * sensor.damping / (2.0 * np.pi * sensor.cutoff_hz)


def _sample_times(run: RigRun, rate: float, start: float) -> np.ndarray:
    n = int((run.time[-1] - start) * rate)
    return start + np.arange(n) / rate


def _digitise(volts: np.ndarray, quantise: bool) -> np.ndarray:
    return np.round(volts / ADC_STEP) * ADC_STEP if quantise else volts


def torque_signal(
    run: RigRun, rate: float = 20e3, start: float = 0.0, rng: np.random.Generator | None = None, quantise: bool = True
) -> Signal:
    """Return the torque channel in volts; signed in space, so negative rotation turns it. Without ``rng`` no noise."""
    sensor, truth = run.truth.torque_sensor, run.truth
    t = _sample_times(run, rate, start)
    reading = CubicSpline(run.time, torque_reading(run))(np.clip(t - pure_torque_delay(run), 0.0, None))
    value = truth.rotation * (1.0 + sensor.gain_error) * reading + sensor.zero + sensor.zero_residual
    if rng is not None:
        phase = rng.uniform(0.0, 2.0 * np.pi)
        value = value + sensor.noise * rng.standard_normal(t.size)
        value += sensor.ripple * np.sin(2.0 * np.pi * sensor.ripple_hz * t + phase)
    return Signal(start, rate, _digitise(sensor.volts_per_unit * value, quantise and rng is not None))


def pressure_signal(
    run: RigRun, rate: float = 50e3, start: float = 0.0, rng: np.random.Generator | None = None, quantise: bool = True
) -> Signal:
    """Return the line pressure channel in volts. Without ``rng`` no noise."""
    sensor = run.truth.pressure_sensor
    t = _sample_times(run, rate, start)
    reading = np.interp(t - sensor.delay, run.time, run.history[f"{sensor.at}_pressure"])
    value = (1.0 + sensor.gain_error) * reading + sensor.zero + sensor.zero_residual
    if rng is not None:
        value = value + sensor.noise * rng.standard_normal(t.size)
    return Signal(start, rate, _digitise(sensor.volts_per_unit * value, quantise and rng is not None))


def _passes(run: RigRun, tooth: int) -> np.ndarray:
    """Return the times at which a tooth passes the sensor, delay and jitter not yet added."""
    trigger, angle = run.truth.trigger, run.history["cam_angle"]
    turn = 2.0 * np.pi
    first_pass = trigger.nominal_angle + trigger.angle_offset + tooth * turn / trigger.pulses_per_rev
    first = int(np.ceil((angle[0] - first_pass) / turn))
    last = int(np.floor((angle[-1] - first_pass) / turn))
    return np.interp(first_pass + turn * np.arange(first, last + 1), angle, run.time)


def _switched(run: RigRun, passes: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    trigger = run.truth.trigger
    times = passes + trigger.switching_delay + trigger.delay_error
    return times if rng is None else times + trigger.jitter * rng.standard_normal(times.size)


def trigger_edges(run: RigRun, rng: np.random.Generator | None = None) -> np.ndarray:
    """Return when the reference tooth switches, once per revolution (delay and jitter included) [s]."""
    return _switched(run, _passes(run, 0), rng)


def wheel_edges(run: RigRun, rng: np.random.Generator | None = None) -> np.ndarray:
    """Return when every tooth of the wheel switches, in order of time [s]."""
    teeth = range(run.truth.trigger.pulses_per_rev - run.truth.trigger.missing_teeth)
    return _switched(run, np.sort(np.concatenate([_passes(run, tooth) for tooth in teeth])), rng)


def trigger_signal(run: RigRun, rate: float, start: float, edges: np.ndarray, rng: np.random.Generator) -> Signal:
    """Return the trigger channel: pulses from the given rising edges, one tooth wide."""
    trigger = run.truth.trigger
    t = _sample_times(run, rate, start)
    tooth_angle = min(trigger.tooth_angle, np.pi / trigger.pulses_per_rev)
    width = tooth_angle / np.interp(edges, run.time, run.history["cam_speed"])
    rising = np.clip((t - _latest(edges, t)) / EDGE_TIME + 0.5, 0.0, 1.0)
    falling = np.clip((t - _latest(edges + width, t)) / EDGE_TIME + 0.5, 0.0, 1.0)
    n_up = np.searchsorted(edges - EDGE_TIME, t)
    n_down = np.searchsorted(edges + width - EDGE_TIME, t)
    level = np.where(n_up > n_down, rising, 1.0 - falling)
    level = np.where(n_down == 0, np.where(n_up == 0, 0.0, rising), level)
    volts = trigger.pulse_height * level + 0.05 + TRIGGER_NOISE * rng.standard_normal(t.size)
    return Signal(start, rate, _digitise(volts, True))


def _latest(events: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return for each time the latest event that has begun (the first one before all)."""
    return events[np.clip(np.searchsorted(events - EDGE_TIME, t) - 1, 0, events.size - 1)]

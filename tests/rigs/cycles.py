"""`as_cycles`: what a perfect nominal alignment of the sensors' readings gives, without files.

Nominal means: declared delays taken off, the edge of each pulse placed at the nominal trigger angle, angle linear in
time between edges. Trigger offset, delay error, twist and speed ripple stay in the data, as on a bench.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from rigs.rig import RigRun
from rigs.sense import pressure_signal, torque_signal, trigger_edges

TWO_PI = 2.0 * np.pi


def nominal_times(run: RigRun, n_theta: int, edges: np.ndarray) -> np.ndarray:
    """Return (n_edges - 2, n_theta) true times that a once-per-revolution trigger assigns to the angle grid."""
    trigger = run.truth.trigger
    edges = edges - trigger.switching_delay
    theta = TWO_PI * np.arange(n_theta) / n_theta
    before, here, after = edges[:-2, None], edges[1:-1, None], edges[2:, None]
    turn = (theta[None, :] - trigger.nominal_angle) / TWO_PI
    return here + turn * np.where(turn < 0.0, here - before, after - here)


def as_cycles(
    run: RigRun,
    n_theta: int = 3600,
    noise: bool = True,
    seed: int | None = None,
    torque_rate: float = 20e3,
    pressure_rate: float = 50e3,
) -> dict[str, np.ndarray]:
    """Return ``theta`` (n_theta,), ``torque`` and ``pressure`` (n_cycles, n_theta), ``speed`` (n_cycles,), SI.

    Torque and pressure are calibrated by certificate gain and standstill zero only; torque is positive when driving.
    ``true_angle`` (n_cycles, n_theta) is the true cam angle at each grid point, less whole turns (for the tests only).
    """
    truth = run.truth
    rng = np.random.default_rng(run.seed + 7919 if seed is None else seed) if noise else None
    edges = trigger_edges(run, rng)
    times = nominal_times(run, n_theta, edges)
    keep = (times[:, 0] > 0.01) & (times[:, -1] < run.time[-1] - 0.01)
    times = times[keep][: run.n_cycles]

    torque = torque_signal(run, torque_rate, 0.0, rng)
    sensor = truth.torque_sensor
    reading = CubicSpline(torque.times, torque.volts)(times + sensor.delay)
    torque_nm = truth.rotation * (reading / sensor.volts_per_unit - sensor.zero)

    pressure = pressure_signal(run, pressure_rate, 0.0, rng)
    gauge = truth.pressure_sensor
    volts = np.interp(times + gauge.delay, pressure.times, pressure.volts)
    true_angle = np.interp(times, run.time, run.history["cam_angle"])
    step = TWO_PI / n_theta
    return {
        "theta": step * np.arange(n_theta),
        "torque": torque_nm,
        "pressure": volts / gauge.volts_per_unit - gauge.zero,
        "speed": (TWO_PI - step) / (times[:, -1] - times[:, 0]),
        "true_angle": true_angle - TWO_PI * np.floor(true_angle[:, n_theta // 2, None] / TWO_PI),
    }


def mean_cycle(run: RigRun, n_theta: int = 3600, **options) -> dict[str, np.ndarray]:
    """Return the mean over cycles of `as_cycles`, ``torque_std`` and the true mean ``chamber_pressure``."""
    cycles = as_cycles(run, n_theta, **options)
    return {
        "theta": cycles["theta"],
        "torque": cycles["torque"].mean(axis=0),
        "torque_std": cycles["torque"].std(axis=0, ddof=1),
        "pressure": cycles["pressure"].mean(axis=0),
        "speed": cycles["speed"].mean(),
        "chamber_pressure": run.true_cycles("chamber_pressure", n_theta).mean(axis=0),
    }

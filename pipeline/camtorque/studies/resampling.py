"""Chart 4: from samples over time with one pulse per revolution to the mean cycle over cam angle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from camtorque.align.resample import choose_rule, hermite_slopes, interval_polynomials
from camtorque.align.resample_compiled import resample_block
from camtorque.mechanism.periodic import periodic_curve
from camtorque.records import Array
from camtorque.studies.case import SPEED, rms_error, study_law
from camtorque.studies.grid import torque_on
from camtorque.studies.table import Chart, Choice, measured
from camtorque.units import TURN, angle_grid

N_THETA = 3600
DRIFT = 0.02
"""Relative change of the speed over the record."""
NOISE = 0.3
"""Standard deviation of the torque's noise per sample [N m]."""
HALF_WIDTH = 8
"""Half width of the windowed sinc [samples]."""


@dataclass(frozen=True)
class Signal:
    """Samples over time: torque (n,), rate [Hz], pulse times (m,), one per revolution at angle zero."""

    torque: Array
    rate: float
    pulses: Array


def make_signal(cycles: int, rate: float, noise: float, ripple: float) -> Signal:
    """Return a record of the study pump whose speed drifts over the record and ripples twice per revolution.

    ``theta = phi + ripple / 2 sin(2 phi)`` and ``phi`` runs through a parabola of time with relative change `DRIFT`.
    """
    duration = cycles * TURN / SPEED
    time = np.arange(int(duration * rate)) / rate
    phase = SPEED * (time + 0.5 * DRIFT * time**2 / duration)
    theta = phase + 0.5 * ripple * np.sin(2.0 * phase)
    curve = periodic_curve(torque_on(angle_grid(7200), study_law()))
    values = curve(np.mod(theta, TURN)) + noise * np.random.default_rng(4).standard_normal(time.size)
    turns = np.arange(1, int(phase[-1] / TURN))
    # phase at the pulse is 2 pi k, since the ripple vanishes there
    pulses = duration / DRIFT * (np.sqrt(1.0 + 2.0 * DRIFT * turns * TURN / SPEED / duration) - 1.0)
    return Signal(values, rate, pulses)


def _positions(signal: Signal) -> Array:
    """Return sample positions of every grid angle of every complete cycle, speed constant between pulses."""
    start, period = signal.pulses[:-1, None], np.diff(signal.pulses)[:, None]
    return (start + period * (np.arange(N_THETA) / N_THETA)) * signal.rate


def linear(signal: Signal) -> Array:
    """Return the mean cycle by `numpy.interp`."""
    return np.interp(_positions(signal), np.arange(signal.torque.size), signal.torque).mean(axis=0)


def cubic(signal: Signal) -> Array:
    """Return the mean cycle by a cubic spline through all samples."""
    return CubicSpline(np.arange(signal.torque.size), signal.torque)(_positions(signal)).mean(axis=0)


def windowed(signal: Signal) -> Array:
    """Return the mean cycle by a sinc of 16 samples under a Hann window."""
    x = _positions(signal)
    base = np.floor(x).astype(np.int64)
    total = np.zeros_like(x)
    for k in range(1 - HALF_WIDTH, HALF_WIDTH + 1):
        gap = x - (base + k)
        weight = np.sinc(gap) * np.cos(0.5 * np.pi * gap / HALF_WIDTH) ** 2
        total += weight * signal.torque[np.clip(base + k, 0, signal.torque.size - 1)]
    return total.mean(axis=0)


def bin_averaged(signal: Signal) -> Array:
    """Return the mean of all samples whose angle falls into a bin; bins that stay empty are filled linearly."""
    time = np.arange(signal.torque.size) / signal.rate
    inside = (time >= signal.pulses[0]) & (time < signal.pulses[-1])
    turns = np.interp(time[inside], signal.pulses, np.arange(signal.pulses.size))
    place = np.round((turns % 1.0) * N_THETA).astype(np.int64) % N_THETA
    count = np.bincount(place, minlength=N_THETA)
    total = np.bincount(place, weights=signal.torque[inside], minlength=N_THETA)
    filled = np.flatnonzero(count)
    return np.interp(np.arange(N_THETA), filled, total[filled] / count[filled], period=N_THETA)


def product(signal: Signal) -> Array:
    """Return the mean cycle by the package's compiled pass: speed smooth through pulses, rule by sample rate."""
    angle = np.asarray(np.arange(signal.pulses.size) * TURN, dtype=np.float64)
    polynomials = interval_polynomials(
        angle, signal.pulses, *hermite_slopes(angle, signal.pulses, np.zeros(angle.size - 1, dtype=np.bool_))
    )
    cycles = np.arange(signal.pulses.size - 1, dtype=np.float64)
    rows = np.empty((cycles.size, N_THETA))
    rule = choose_rule("auto", signal.rate * TURN / SPEED / N_THETA)
    resample_block(
        signal.torque, signal.rate, np.zeros(cycles.size), cycles, angle, polynomials, rule, (0.0, 1.0), rows
    )
    return rows.mean(axis=0)


RESAMPLERS: dict[str, Callable[[Signal], Array]] = {
    "align (compiled, auto)": product,
    "linear": linear,
    "cubic spline": cubic,
    "windowed sinc": windowed,
    "bin-averaged": bin_averaged,
}
"""Name -> function from signal to mean cycle."""
DEFAULT = "align (compiled, auto)"
SCENES: dict[str, tuple[float, float, float]] = {
    "clean, 20 kHz": (2.0e4, 0.0, 0.0),
    "noise, 20 kHz": (2.0e4, NOISE, 0.0),
    "noise, 100 kHz": (1.0e5, NOISE, 0.0),
    "noise and 1 % ripple, 20 kHz": (2.0e4, NOISE, 0.01),
}
"""Scene -> sample rate [Hz], noise [N m], relative ripple of the speed inside a revolution."""


def resampling_charts(quick: bool) -> tuple[Chart, ...]:
    """Return rms error of the mean cycle against cost per sample, one chart per scene."""
    return tuple(_scene_chart(place, scene, quick) for place, scene in enumerate(SCENES, 1))


def _scene_chart(place: int, scene: str, quick: bool) -> Chart:
    rate, noise, ripple = SCENES[scene]
    exact, cycles = torque_on(angle_grid(N_THETA), study_law()), 30 if quick else 100
    signal = make_signal(cycles, rate, noise, ripple)
    choices = [
        Choice(name, "", rms_error(mean(signal), exact), partial(mean, signal), signal.torque.size, name == DEFAULT)
        for name, mean in RESAMPLERS.items()
    ]
    points = measured(choices, 2 if quick else 5)
    note = (
        f"rms error of the mean of {cycles} cycles over the peak; speed drifts by 2 % over the record; one pulse per "
        "revolution, known exactly: ripple inside a revolution is invisible to it, whatever the interpolation"
    )
    title = f"Trigger and resampling: {scene}"
    return Chart(f"resampling_{place}", title, "rms torque error / peak", "time per sample [s]", points, note)

"""Mains hum on the torque: 50 or 60 Hz that rides on the voltage, whatever the cam does.

Where the speed drifts against the mains, the hum's phase differs from cycle to cycle: it is found by regression of each
cycle's deviation from the mean on sine and cosine of the mains, and it averages out of the mean. Where the speed is an
even fraction of the mains, it stands still on the cam angle and stays in the mean: it is found on the base circle,
where nothing else happens, as a sine of just that frequency.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from camtorque.records import Array, Finding
from camtorque.signal.threshold import Threshold
from camtorque.stacks import pieces
from camtorque.units import DEGREE

MAINS_HZ = (50.0, 60.0)
LOCKED = Threshold(
    0.5, "1", "convention", "Coherence of the mains' phase over the cycles above which the mean keeps the hum."
)
POINTS = 360
"""Bins of a revolution: mains is slow against the grid."""
PIECE = 1024
"""Cycles worked on at a time."""
SIGNIFICANT = Threshold(
    6.0, "1", "statistics", "Standard errors that the amplitude of the mains has to exceed before it is reported."
)
SMALLEST_SHARE = Threshold(
    1.0e-4, "1", "convention", "Smallest amplitude that is worth a line, as a share of the peak torque."
)
MARGIN = 20.0 * DEGREE
"""Base circle that is left out after the lift has ended: what rings there is not hum."""
FEWEST_PERIODS = Threshold(
    1.4, "periods", "statistics",
    "Periods of the mains that the base circle has to hold: fewer are no different from drift."
)  # fmt: skip
OTHERS_HZ = (23.0, 31.0, 39.0, 71.0, 83.0, 97.0)
"""Neighbouring frequencies: a sine of the mains has to leave less over than a sine of any of these."""
STANDS_OUT = Threshold(
    0.9, "1", "simulated rigs",
    "The mains leaves less than this part of what the best neighbouring frequency leaves over."
)  # fmt: skip


LARGE_SHARE = Threshold(
    5.0e-3, "1", "convention",
    "Share of the peak torque from which on hum that stays in the mean cycle spoils what is fitted."
)  # fmt: skip


def hum_findings(
    theta: Array, torque: Array, mean: Array, speed: Array, index: Any, lift: Array
) -> tuple[Finding, ...]:
    """Return the finding about mains hum, if there is any.

    Parameters
    ----------
    theta, lift : (n,) cam angle [rad], lift [m]
    torque, mean : (n_cycles, n) and their mean (n,) [N m]
    speed, index : (n_cycles,) [rad/s], cycle number
    """
    if theta.size < POINTS:
        return ()
    bins, start = _binned(torque), _starts(speed, index)
    peak = float(np.max(np.mean(bins, axis=0)))
    found = []
    for frequency in MAINS_HZ:
        coherence = float(np.abs(np.mean(np.exp(2j * np.pi * frequency * start))))
        if coherence > LOCKED:
            size, stderr = _on_base_circle(frequency, theta, mean, float(np.mean(speed)), idle_points(theta, lift))
        else:
            size, stderr = _over_cycles(frequency, bins, speed, start)
        if size > max(SIGNIFICANT * stderr, SMALLEST_SHARE * peak):
            found.append((size / stderr, frequency, size, stderr, coherence))
    if not found:
        return ()
    _, frequency, size, stderr, coherence = max(found, key=lambda row: row[0])
    stays = coherence > LOCKED
    fate = (
        "the speed is synchronous with the mains, so the hum stays in the mean cycle; earth and shield the cable, or "
        "record at a speed that is no submultiple of the mains frequency"
        if stays
        else f"its phase drifts over the cycles, so {100.0 * coherence:.0f} % of it stay in the mean cycle"
    )
    text = f"{frequency:.0f} Hz hum of {size:.3f} +- {stderr:.3f} N m on the torque: {fate}"
    spoils = stays and size > LARGE_SHARE * peak
    return (Finding("mains_hum", "warning" if spoils else "info", text, "torque"),)


def _starts(speed: Array, index: Any) -> Array:
    """Return the time at which each cycle starts [s]; a cycle that was cut lasts as long as its neighbours."""
    numbers = np.arange(index[0], index[-1] + 1)
    periods = np.interp(numbers, index, 2.0 * np.pi / speed)
    return np.r_[0.0, np.cumsum(periods)][index - index[0]]


def _over_cycles(frequency: float, bins: Array, speed: Array, start: Array) -> tuple[float, float]:
    """Return amplitude and standard error [N m] from the deviations of the cycles from their mean, 0 where none tells.

    Waves of an hour do not stand in memory.
    """
    n = bins.shape[0]
    parts = [slice(first, first + PIECE) for first in range(0, n, PIECE)]
    # the last waves are kept: where there is one part, they are made once
    waves_of = lru_cache(maxsize=1)(
        lambda first: _turning(frequency, speed[first : first + PIECE], start[first : first + PIECE])
    )
    middle = sum(np.sum(waves_of(part.start), axis=0) for part in parts) / n
    mean = np.mean(bins, axis=0)
    pairs, squares = np.zeros((2, n)), np.zeros((2, 2, n))
    for part in parts:
        turning = waves_of(part.start) - middle
        waves, deviation = (turning.real, turning.imag), bins[part] - mean
        for k, wave in enumerate(waves):
            # one cycle carries one independent value of each wave: what else deviates is correlated over its angle
            pairs[k, part] = np.sum(wave * deviation, axis=1)
            squares[k, :, part] = [np.sum(wave * other, axis=1) for other in waves]
    gram = np.sum(squares, axis=2)
    if np.linalg.cond(gram) > 1e6:
        return 0.0, 0.0
    amplitude = np.linalg.solve(gram, np.sum(pairs, axis=1))
    rest = pairs - np.einsum("b,abn->an", amplitude, squares)
    spread = np.sqrt(np.sum(rest**2, axis=1).mean())
    stderr = float(spread / np.sqrt(np.linalg.det(gram)))
    return float(np.hypot(*amplitude)), stderr


def _turning(frequency: float, speed: Array, start: Array) -> Any:
    """Return exp(2 pi i f t) at the middles of the bins of each cycle, (n_cycles, POINTS): a product, no cosines."""
    bin_phase = 2.0 * np.pi * frequency * (2.0 * np.pi / POINTS) / speed
    step = np.repeat(np.exp(1j * bin_phase)[:, None], POINTS, axis=1)
    step[:, 0] = np.exp(1j * (2.0 * np.pi * frequency * start + 0.5 * bin_phase))
    return np.multiply.accumulate(step, axis=1)


def _on_base_circle(frequency: float, theta: Array, mean: Array, speed: float, idle: Any) -> tuple[float, float]:
    """Return the same from the mean cycle where the lift is nil."""
    time = theta[idle] / speed
    if time.size < POINTS // 10 or np.ptp(time) * frequency < FEWEST_PERIODS:
        return 0.0, 0.0
    amplitude, rest = _sine(time, mean[idle], frequency)
    if rest > STANDS_OUT * min(_sine(time, mean[idle], other)[1] for other in OTHERS_HZ):
        return 0.0, 0.0
    # neighbouring points share the low-pass: a tenth of them is independent
    stderr = rest * np.sqrt(2.0 / (0.1 * time.size))
    return amplitude, float(stderr)


def idle_points(theta: Array, lift: Array) -> Any:
    """Return the points without lift behind the last one with lift, from a margin after it on.

    Where the lift lasts to the end of the cycle they are all points without lift.
    """
    still = lift < 1e-3 * np.max(lift)
    turned = np.flatnonzero(~still)
    if turned.size == 0:
        return np.array([], dtype=np.int64)
    first = turned[-1] + 1 if turned[-1] + 1 < theta.size else 0
    return np.flatnonzero(still & (theta >= theta[first] + MARGIN)) if first else np.flatnonzero(still)


def _sine(time: Array, values: Array, frequency: float) -> tuple[float, float]:
    """Return amplitude of a sine beside a straight line, and the rms of the rest."""
    centred = time - np.mean(time)
    phase = 2.0 * np.pi * frequency * time
    design = np.column_stack([np.ones_like(time), centred, np.cos(phase), np.sin(phase)])
    found, *_ = np.linalg.lstsq(design, values, rcond=None)
    return float(np.hypot(found[2], found[3])), float(np.sqrt(np.mean((values - design @ found) ** 2)))


def _binned(torque: Array) -> Array:
    """Return bin means of each cycle, (n_cycles, POINTS)."""
    n = torque.shape[1]
    edges = np.arange(POINTS) * n // POINTS
    sizes, bins = np.diff(np.r_[edges, n]), np.empty((torque.shape[0], POINTS))
    # a product with equal weights, where all bins have as many points: twenty times as fast as a mean over a short axis
    equal = np.full(sizes[0], 1.0 / sizes[0])
    for piece in pieces(torque):
        if n % POINTS:
            bins[piece] = np.add.reduceat(torque[piece], edges, axis=1) / sizes
        else:
            bins[piece] = torque[piece].reshape(-1, POINTS, sizes[0]) @ equal
    return bins

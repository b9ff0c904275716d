"""Sub-sample time of an edge from the samples around it."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from camtorque.records import Array, Integers, Mask
from camtorque.signal.running import running_median
from camtorque.signal.threshold import Threshold

POOLED_EDGES = 9
"""Plateaus are the running median over this many neighbouring edges: it follows slow drift."""
FLANK = (0.05, 0.95)
"""Heights between which a sample counts as lying on the flank."""
SHORT_FLANK = Threshold(
    3.0, "samples", "statistics",
    "A flank of fewer samples is fitted as a ramp; on a longer one linear interpolation is as good."
)  # fmt: skip
LEAST_PAIRS = 5
LEAST_FOR_DENSITY = 30
SAME_DURATION = Threshold(
    0.1, "1", "simulated rigs",
    "Relative spread of the flank's duration over the edges beyond which it is no property of the sensor."
)  # fmt: skip
STEEPEST = 1.0e-3
"""Duration of the flank of a logic-level log, which has no sample on any [samples]."""
RECTANGULAR = 1.0 / np.sqrt(12.0)
"""Standard deviation of an edge that lies anywhere between two samples [samples]."""


@dataclass(frozen=True)
class EdgeSamples:
    """Edges of one polarity, as few samples as their times need; flanks turned so that all rise.

    Attributes
    ----------
    before : (n,) sample index before the half-height crossing
    near : (n, 4) the two samples on either side of the crossing, as parts of the height
    height : (n,) plateau to plateau [V]
    noise : (n,) standard deviation of the voltage on the plateaus [V]
    own_height : (n,) the same height from this edge alone [V]
    """

    before: Integers
    near: Array
    height: Array
    noise: Array
    own_height: Array


def edge_samples(windows: Array, before: Integers) -> EdgeSamples:
    """Normalise rising edges by the plateaus on their two sides.

    Parameters
    ----------
    windows : (n, 2 k) samples around each edge, the edge between columns k - 1 and k; the first and last quarter of a
        window are plateau [V]
    before : (n,) sample index of column k - 1
    """
    n, width = windows.shape
    if not n:
        return EdgeSamples(before, np.empty((0, 4)), np.empty(0), np.empty(0), np.empty(0))
    half, quarter = width // 2, max(1, width // 4)
    low, high = np.median(windows[:, :quarter], axis=1), np.median(windows[:, -quarter:], axis=1)
    noise = 0.5 * (np.std(windows[:, :quarter], axis=1) + np.std(windows[:, -quarter:], axis=1))
    own = high - low
    low, high = running_median(low, POOLED_EDGES), running_median(high, POOLED_EDGES)
    height = high - low
    part = (windows - low[:, None]) / np.where(height > 0.0, height, 1.0)[:, None]
    # the crossing of half height that is nearest to the middle, and two samples on either side of it
    crosses = (part[:, :-1] < 0.5) & (part[:, 1:] >= 0.5)
    column = np.argmin(np.where(crosses, np.abs(np.arange(width - 1) - (half - 1)), width), axis=1)
    near = part[np.arange(n)[:, None], np.clip(column[:, None] + np.arange(-1, 3), 0, width - 1)]
    return EdgeSamples(before - (half - 1) + column, near, height, noise, own)


def joined(parts: list[EdgeSamples]) -> EdgeSamples:
    """Return the edges of all blocks."""
    return EdgeSamples(*(np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(EdgeSamples)))


@dataclass(frozen=True)
class Crossings:
    """Half-height crossings.

    Attributes
    ----------
    position : (n,) [samples], with their fraction
    slope : of the flank [heights per sample]
    blur : standard error from the samples being too few to see the flank [samples]
    """

    position: Array
    slope: float
    blur: float


def crossings(edges: EdgeSamples) -> Crossings:
    """Return the half-height crossings of the edges.

    Linear interpolation between the two samples that straddle half height is exact while both lie on a straight flank;
    where the flank is so short that one of them lies on a plateau it is wrong by up to 1 / (8 D) samples, and the
    crossing is found from the flank's duration D instead. An edge without any sample on its flank lies anywhere within
    the 1 - D samples that are left. A logic-level log has no samples on any flank: its edges are known to one sample.
    """
    slope = np.maximum(edges.near[:, 2] - edges.near[:, 1], 1e-9)
    linear = np.clip((0.5 - edges.near[:, 1]) / slope, 0.0, 1.0)
    duration, duration_std = _flank_duration(edges.near)
    unseen = float(np.mean(~_on_flank(edges.near).any(axis=1)))
    if duration < SHORT_FLANK:
        # a sample at height h puts the crossing h - 1/2 durations away: rms 1 / sqrt(12) over a flank
        blur = RECTANGULAR * np.hypot(np.sqrt(unseen) * max(0.0, 1.0 - duration), duration_std)
        return Crossings(edges.before + _ramp_crossing(edges.near, linear, duration), 1.0 / duration, float(blur))
    usual = float(np.median(slope))
    line_error = usual / 8.0 if usual > 1.0 / SHORT_FLANK else 0.0
    # too few edges to tell the duration: those that show no sample on their flank lie anywhere between two
    return Crossings(edges.before + linear, usual, max(line_error, RECTANGULAR * np.sqrt(unseen)))


def _on_flank(near: Array) -> Mask:
    return (near > FLANK[0]) & (near < FLANK[1])


def _flank_duration(near: Array) -> tuple[float, float]:
    """Return the duration of the whole flank and its standard error in samples, inf where it is not known or not short.

    Two samples of one edge on the flank give its slope; where the flank is shorter than a sample, the part of the edges
    that show a sample on it gives its duration, because edges fall anywhere between the samples.
    """
    flank = _on_flank(near)
    both = flank[:, 1] & flank[:, 2]
    span = FLANK[1] - FLANK[0]
    if both.sum() >= LEAST_PAIRS:
        durations = 1.0 / (near[both, 2] - near[both, 1])
        usual = float(np.median(durations))
        spread = 1.4826 * float(np.median(np.abs(durations - usual)))
        return (usual, spread / np.sqrt(both.sum())) if spread < SAME_DURATION * usual else (np.inf, 0.0)
    shown = flank.sum(axis=1)
    density = float(shown.mean()) / span if shown.size else np.inf
    if near.shape[0] < LEAST_FOR_DENSITY or density >= 1.6:
        return np.inf, 0.0
    return max(density, STEEPEST), float(np.std(shown)) / np.sqrt(shown.size) / span


def _ramp_crossing(near: Array, linear: Array, duration: float) -> Array:
    """Mean over the samples on the flank of where each puts half height; linear where there is none."""
    flank = _on_flank(near)
    places = np.arange(-1, 3) - duration * (near - 0.5)
    count = flank.sum(axis=1)
    mean = np.where(flank, places, 0.0).sum(axis=1) / np.maximum(count, 1)
    return np.where(count > 0, mean, linear)

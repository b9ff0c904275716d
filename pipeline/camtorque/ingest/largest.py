"""The largest values of a log, and whether its sensor is made for them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from camtorque.records import Array, Channel, Finding, Recording, SampleSource, SensorCalibration
from camtorque.signal.running import percentile
from camtorque.units import short

BLOCKS, BLOCK_SAMPLES = 16, 50_000
"""Pieces of a log looked at for its largest values; each holds several revolutions at usual rates."""
MOST_RANKED = 200_000
"""Of these samples, as many are ranked as make the highest 0.1 % a sound choice."""
OVERLOAD = 1.1
"""Share of the nominal range that a sensor is run at by those who know it; its class holds up to 1."""
UNUSED = 0.02
"""Share of it below which no loaded channel stays: 0.24 is the least of 46 recordings."""


def range_findings(sheet: SensorCalibration, peak: float, *, is_loaded: bool) -> list[Finding]:
    """Return a warning where the largest value of a channel does not suit the nominal range that its sheet states."""
    if not peak > 0.0:  # a channel without a number has no range of its own either
        return []
    share = peak / sheet.largest_reading
    if share > OVERLOAD:
        code, why = "beyond_nominal_range", "at most 100 %: accuracy and linearity of the sheet do not hold there"
    elif is_loaded and share < UNUSED:
        code, why = "far_below_nominal_range", f"{100.0 * UNUSED:g} % or more under load: class and noise would hide it"
    else:
        return []
    text = (
        f"the {sheet.quantity} reaches {short(100.0 * share)} % of nominal_range, expected {why}; check nominal_range "
        "and sensitivity"
    )
    return [Finding(code, "warning", text, sheet.serial)]


def largest(channel: Channel) -> float:
    """Return the largest value that is no stray sample: the 99.9th percentile of pieces all over the log.

    It is nan for a channel that never changes: `camtorque check` tells that.
    """
    values = np.abs(channel.from_volts(pieces(channel.read_volts, channel.n_samples)))
    return percentile(values, 99.9) if values.size and np.ptp(values) > 0.0 else math.nan


def marked_missing(recording: Recording) -> str:
    """Name samples that stand at one value, farther from all others than these from each other; "" without such."""
    for channel in (*recording.of("torque")[:1], *recording.of("pressure")[:1]):
        values = pieces(channel.read_volts, channel.n_samples)
        for end in (float(np.min(values)), float(np.max(values))):
            there = values == end
            others = values[~there]
            if there.sum() > 1 and others.size and np.min(np.abs(others - end)) > np.ptp(others):
                return (
                    f"samples of {channel.name!r} stand at exactly {end / channel.scale:g}, far beyond all others: "
                    "where that marks missing samples, leave those out or write nan"
                )
    return ""


def extent(source: SampleSource) -> float:
    """Return how far the samples of a log lie apart, as pieces all over it tell, in its own unit."""
    values = pieces(source.read, source.n_samples)
    return float(np.ptp(values)) if values.size else 0.0


def pieces(read: Callable[[int, int], Array], n_samples: int) -> Array:
    """Return the samples of pieces all over a log that are numbers, as many as make its extremes a sound choice."""
    last = max(n_samples - BLOCK_SAMPLES, 0)
    count = min(BLOCKS, -(-n_samples // BLOCK_SAMPLES))
    starts = np.unique(np.linspace(0, last, count).astype(int))
    every = -(-min(n_samples, BLOCKS * BLOCK_SAMPLES) // MOST_RANKED)
    found: Array = np.concatenate([read(int(s), int(s) + BLOCK_SAMPLES)[::every] for s in starts])
    return found[np.isfinite(found)]

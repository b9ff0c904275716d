"""The largest values of a log, and whether its sensor is made for them."""

from __future__ import annotations

import math

import numpy as np

from camtorque.records import Array, Channel, Finding, Recording
from camtorque.signal.running import percentile

BLOCKS, BLOCK_SAMPLES = 16, 50_000
"""Pieces of a log looked at for its largest values; each holds several revolutions at usual rates."""
MOST_RANKED = 200_000
"""Of these samples, as many are ranked as make the highest 0.1 % a sound choice."""
OVERLOAD = 1.1
"""Share of the nominal range that a sensor is run at by those who know it; its class holds up to 1."""


def overload_findings(recording: Recording) -> list[Finding]:
    """Return a warning for each torque or pressure beyond the nominal range that its sheet states."""
    found = []
    for channel in (*recording.of("torque"), *recording.of("pressure")):
        sheet = channel.calibration
        share = largest(channel) / sheet.largest_reading if sheet is not None else math.nan
        if sheet is not None and share > OVERLOAD:
            text = (
                f"the {channel.quantity} reaches {100.0 * share:.0f} % of nominal_range, expected at "
                "most 100 %: accuracy and linearity of the sheet do not hold there; check nominal_range and sensitivity"
            )
            found.append(Finding("beyond_nominal_range", "warning", text, sheet.serial or channel.name))
    return found


def largest(channel: Channel) -> float:
    """Return the largest value that is no stray sample: the 99.9th percentile of pieces all over the log.

    It is nan for a channel that never changes: `camtorque check` tells that.
    """
    last = max(channel.n_samples - BLOCK_SAMPLES, 0)
    count = min(BLOCKS, -(-channel.n_samples // BLOCK_SAMPLES))
    starts = np.unique(np.linspace(0, last, count).astype(int))
    every = -(-min(channel.n_samples, BLOCKS * BLOCK_SAMPLES) // MOST_RANKED)
    volts: Array = np.concatenate([channel.read_volts(int(s), int(s) + BLOCK_SAMPLES)[::every] for s in starts])
    values = np.abs(channel.from_volts(volts[np.isfinite(volts)]))
    return percentile(values, 99.9) if values.size and np.ptp(values) > 0.0 else math.nan

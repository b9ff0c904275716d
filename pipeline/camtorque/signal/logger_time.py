"""Sample positions and times on a logger's own clock, where the file's time may jump.

A jump forward is a pause of the logger: the samples after it belong to later times. A jump back is a clock that was
set: the samples ran on, and it is left out of the time. Either way the cycle there is cut out.
"""

from __future__ import annotations

import numpy as np

from camtorque.records import Array, Channel


def _pauses(channel: Channel) -> tuple[Array, Array]:
    """Return the samples after each pause and the pauses summed up [s]."""
    steps = np.maximum(np.array(channel.break_steps, dtype=float), 0.0)
    return np.array(channel.breaks, dtype=float), np.cumsum(steps)


def sample_times(channel: Channel, position: Array) -> Array:
    """Return the times of sample positions on the logger's clock [s]."""
    breaks, pauses = _pauses(channel)
    time = channel.start_time + position / channel.sample_rate
    return time + np.r_[0.0, pauses][np.searchsorted(breaks, position, side="right")]


def end_time(channel: Channel) -> float:
    """Return when a channel ends on the logger's clock, one step after its last sample [s]."""
    return float(sample_times(channel, np.array(float(channel.n_samples))))


def sample_positions(channel: Channel, time: Array) -> Array:
    """Return the sample positions of times on the logger's clock; within a pause the position stands still."""
    position = (time - channel.start_time) * channel.sample_rate
    if not channel.breaks:
        return position
    breaks, pauses = _pauses(channel)
    before = np.r_[0.0, pauses[:-1]]
    after_pause = breaks / channel.sample_rate + pauses
    passed = np.searchsorted(after_pause, time - channel.start_time, side="right")
    moved = position - np.r_[0.0, pauses][passed] * channel.sample_rate
    waiting = passed < breaks.size
    limit = breaks[np.minimum(passed, breaks.size - 1)]
    inside = waiting & (position - before[np.minimum(passed, breaks.size - 1)] * channel.sample_rate > limit)
    return np.where(inside, limit, moved)


def pause_intervals(channel: Channel) -> Array:
    """Return (n, 2) begin and end of the jumps on the logger's clock [s]."""
    breaks = np.array(channel.breaks, dtype=float)
    if not breaks.size:
        return np.empty((0, 2))
    return np.column_stack((sample_times(channel, breaks - 1.0), sample_times(channel, breaks)))

"""Turns that no pulse shows: the trigger fell silent while the pump went on, or woke up after it had begun."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from camtorque.align.channels import positions
from camtorque.align.clocks import Clock
from camtorque.align.timebase import TimeBase
from camtorque.records import Channel, Finding
from camtorque.signal.logger_time import end_time
from camtorque.signal.threshold import Count, Threshold

STILL_TURNING = Threshold(
    0.5, "1", "physics",
    "A channel that swings by this share of what it does between the pulses shows that the pump turns."
)  # fmt: skip
SILENT_TURNS = Count(
    2, "turns", "convention", "Turns in a row without a pulse: a shaft that runs out may make one more stroke."
)
LATE = Threshold(0.05, "turns", "convention", "By this much a pulse may be late: a shaft slows down a little first.")


def silence_findings(base: TimeBase, channels: Mapping[str, Channel]) -> tuple[Finding, ...]:
    """Return what is lost before the first or after the last pulse although the pump turned there.

    Parameters
    ----------
    channels : those that follow the cam; the pressure tells, else the torque
    """
    channel, train, n = channels.get("pressure") or channels.get("torque"), base.train, base.pulses_per_cycle
    if channel is None or train.step[-1] - train.step[0] < n:
        return ()
    clock = base.clocks[channel.logger]
    spans = [_span(trigger.channel, base.clocks[logger]) for logger, trigger in base.triggers.items()]
    spans += [_span(one, base.clocks[one.logger]) for one in channels.values()]
    own = _span(channel, clock)
    logged = max(span[0] for span in spans), min(span[1] for span in spans)  # no turn is used that a log lacks
    where = next(iter(base.triggers.values())).channel.where
    found = []
    for name, edge, inside, end in (
        ("begin", train.time[0], train.step[0] + n, logged[0]),
        ("end", train.time[-1], train.step[-1] - n, logged[1]),
    ):
        turn = float(edge - np.interp(inside, train.step, train.time))
        lost = (end - edge) / turn
        if lost > SILENT_TURNS + 1.0 + LATE and _turns(channel, clock, float(edge), turn):
            text = (
                f"the pulses {name} at {edge - own[0]:.2f} s of {own[1] - own[0]:.2f} s, but the {channel.quantity} "
                f"swings {'before' if name == 'begin' else 'on'}: about {lost:.0f} turns are not used; did the sensor "
                "of the pulses or its cable fail there?"
            )
            found.append(Finding("trigger_silent", "warning", text, where))
    return tuple(found)


def _span(channel: Channel, clock: Clock) -> tuple[float, float]:
    """Return begin and end of a channel on the clock of the reference [s]."""
    begin, end = clock.to_reference(np.array([channel.start_time, end_time(channel)]))
    return float(begin), float(end)


def _turns(channel: Channel, clock: Clock, edge: float, turn: float) -> bool:
    """Return whether a channel swings beyond a pulse, ``turn`` [s] away from the others, as it does before it."""

    def swing(start: float) -> float:
        ends = np.sort(positions(channel, clock, np.array([edge + start * turn, edge + (start + 1.0) * turn])))
        first, last = np.clip(ends, 0, channel.n_samples).astype(np.int64)
        values = channel.read(int(first), int(last))
        values = values[np.isfinite(values)]
        return float(np.ptp(values)) if values.size else 0.0

    usual = swing(-1.0)
    return usual > 0.0 and all(swing(1.0 + LATE + k) > STILL_TURNING * usual for k in range(SILENT_TURNS))

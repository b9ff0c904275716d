"""Jumps of a clock inside a recording: found from pulse periods that no shaft can run, and cut there.

A shaft has inertia: one revolution cannot differ from both its neighbours while these agree. Where it does, samples
were lost or a clock was set: the revolution is not used, and the ones beside it are not touched by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from camtorque.align.clocks import Clock
from camtorque.align.pulses import PulseTrain
from camtorque.records import Finding, Recording
from camtorque.signal.logger_time import pause_intervals
from camtorque.signal.threshold import Threshold

LEAST_JUMP = Threshold(
    0.003, "1", "recordings",
    "Relative difference of a period from its neighbours that may be a jump: pumps without a flywheel "
    "change by less from turn to turn."
)  # fmt: skip
NEIGHBOURS_AGREE = Threshold(
    0.25, "1", "convention", "The neighbours differ from each other by less than this part of the jump."
)
TIMES_USUAL = Threshold(
    8.0, "1", "statistics", "And the difference is this many times the usual one from revolution to revolution."
)
EDGE_NOISES = Threshold(
    7.0, "1", "statistics",
    "Difference of neighbouring periods, in standard errors of an edge, that the edges alone can make: "
    "edges known to one sample, q / sqrt(12), move it by up to 2 q."
)  # fmt: skip
TOOTH_NOISES = Threshold(
    10.5, "1", "statistics",
    "The same on a wheel, where each period is held against the usual one of its tooth: that is known to half a "
    "sample, so edges known to one sample move the difference by up to 3 q."
)  # fmt: skip


def mark_jumps(
    train: PulseTrain, clocks: Mapping[str, Clock], recording: Recording, edge_noise: float, n: int
) -> tuple[PulseTrain, tuple[Finding, ...]]:
    """Mark the pulses whose interval holds a jump, of the main trigger, between two clocks or of a file's time.

    ``edge_noise`` [s] is that of one pulse, ``n`` the pulses per turn of the cam.
    """
    jump = _odd_periods(train, n, edge_noise)
    odd = int(jump.sum())
    findings = []
    if odd:
        places = ", ".join(f"{t:.4g} s" for t in train.time[jump][:5])
        text = (
            f"{odd} pulse period{'s differ' if odd > 1 else ' differs'} from both neighbours as no shaft can run: "
            "samples or pulses were lost or the clock set, the cycles there are cut out"
        )
        findings.append(Finding("clock_jump", "warning", text, f"near {places}"))
    for clock in clocks.values():
        for moment in clock.breaks:
            jump[np.clip(np.searchsorted(train.time, moment), 1, jump.size - 1)] = True
    for channel in recording.channels:
        if channel.logger not in clocks:
            continue
        for begin, end in clocks[channel.logger].to_reference(pause_intervals(channel)):
            first, last = np.searchsorted(train.time, (begin, end))
            jump[max(1, first) : last + 1] = True
    return replace(train, jumped=jump), tuple(findings)


def _odd_periods(train: PulseTrain, n: int, edge_noise: float) -> np.ndarray:
    """Flag the pulse at the end of each odd interval; on a wheel, pitch errors repeat and are taken off first."""
    jump = np.zeros(train.time.size, dtype=bool)
    period = np.diff(train.time) / np.maximum(np.diff(train.step), 1)
    if period.size < 5:
        return jump
    quantum = (TOOTH_NOISES if n > 1 else EDGE_NOISES) * edge_noise / np.median(period)
    if n > 1:
        tooth = np.unique(train.step[1:] % n, return_inverse=True)[1]
        period = period / np.array([np.median(period[tooth == k]) for k in range(tooth.max() + 1)])[tooth]
    before, after, here = period[:-2], period[2:], period[1:-1]
    beside = 0.5 * (before + after)
    difference = np.abs(here - beside) / beside
    usual = 1.4826 * np.median(difference)
    agree = np.abs(before - after) / beside < NEIGHBOURS_AGREE * difference
    odd = (difference > max(LEAST_JUMP, TIMES_USUAL * usual, quantum)) & agree
    jump[2:-1] = odd & ~train.broken[2:-1] & ~train.repaired[2:-1]
    return jump

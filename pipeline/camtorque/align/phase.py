"""Which turn of the wheel is which turn of the cam, where the wheel turns several times per cycle and no index tells.

The torque of a pump follows line pressure times lift velocity, and the pressure rises with the lift. So each possible
turn is tried on the mean cycle; the one that fits is taken, and a finding says where none fits clearly better.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camtorque.align.angle import cam_angle
from camtorque.align.channels import Measured, Turns, align_channels
from camtorque.align.options import AlignOptions
from camtorque.align.polarity import INVERTED_CORRELATION, correlation, lift_velocity
from camtorque.align.timebase import TimeBase
from camtorque.records import Array, CamTable, Finding, Recording
from camtorque.signal.threshold import Threshold

COARSE = 720
CLEARER = Threshold(0.2, "1", "simulated rigs", "Correlation by which the best turn has to beat the next.")


def settled_phase(recording: Recording, base: TimeBase, channels: Measured, options: AlignOptions) -> TimeBase:
    """Return the time base with the pulses numbered from the right turn of the wheel, and a finding."""
    spec = recording.config.trigger
    turns = spec.revolutions_per_cycle
    if not base.train.phase_open:
        return base
    scores = np.zeros(turns)
    if recording.lift_table is not None and "pressure" in channels.main:
        scores = _scores(_means(recording, base, channels, options), recording.cam_table, turns)
    order = np.argsort(scores)[::-1]
    best = int(order[0])
    clear = scores[best] > scores[order[1]] + CLEARER
    found = ", ".join(f"{score:.2f}" for score in scores)
    text = (
        f"the wheel turns {turns} times per turn of the cam and no index channel tells which is which: "
        + (f"torque and pressure do (correlations {found})" if clear else f"turn {best + 1} is assumed ({found})")
        + ("" if clear else '; add a channel with quantity = "index", one pulse per turn of the cam')
    )
    finding = Finding("cycle_phase_by_lift" if clear else "cycle_phase_open", "info" if clear else "warning", text)
    step = base.train.step - best * (base.pulses_per_cycle // turns)
    return replace(base, train=replace(base.train, step=step), findings=(*base.findings, finding))


def _means(recording: Recording, base: TimeBase, channels: Measured, options: AlignOptions) -> dict[str, Array]:
    """Return the median cycle of torque and pressure on a coarse grid."""
    angle = cam_angle(base.train, recording.config.trigger, base.pulses_per_cycle, base.places)
    turns = Turns(angle, base.clocks, replace(options, n_theta=COARSE))
    complete = turns.covered(channels.main.values())
    if not complete.any():
        return {}
    aligned = align_channels(channels.main, turns, complete)
    whole = np.all([np.isfinite(item.rows).all(axis=1) for item in aligned.values()], axis=0)
    if not whole.any():
        return {}
    return {quantity: np.median(item.rows[whole], axis=0) for quantity, item in aligned.items()}


def _scores(means: dict[str, Array], table: CamTable, turns: int) -> Array:
    """Return how well the mean cycle follows the lift, for each turn that it may begin with, (turns,).

    A torque that is against the lift where the pressure rises with it is inverted: it is turned later on.
    """
    if "pressure" not in means:
        return np.zeros(turns)
    velocity, line = lift_velocity(table, COARSE), np.maximum(means["pressure"], 0.0)
    # the table read from another turn: what is at theta then was at theta + turn
    read = [np.roll(velocity, turn * COARSE // turns) for turn in range(turns)]
    rises = np.array([correlation(line, np.maximum(slope, 0.0)) for slope in read])
    if "torque" not in means:
        return rises
    drives = np.array([correlation(means["torque"], line * slope) for slope in read])
    likely = np.argsort(rises)[::-1]
    told = rises[likely[0]] > rises[likely[1]] + CLEARER
    return -drives if told and drives[likely[0]] < INVERTED_CORRELATION else drives

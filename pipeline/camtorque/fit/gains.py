"""Gains of the two sensors: what a certificate leaves open is the same in both recordings, a slip of one is not.

A shunt, an amplifier, a range or a scaling that was set anew between two recordings is no change of the pump.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camtorque.fit.prepare import MeanCycles
from camtorque.laws.rows import parameter
from camtorque.records import Array

TORQUE_GAIN, PRESSURE_GAIN = "torque_gain_error", "pressure_gain_error"
GAINS = (TORQUE_GAIN, PRESSURE_GAIN)
GAIN_ROWS = {
    name: parameter(
        name, symbol, "%", 0.01, (0.0, -60.0, 150.0, 0.1), (0.0, 1e-14),
        f"gain of the {sensor} over that of the first recording, less one", "only a difference of two tells it",
    )
    for name, symbol, sensor in ((TORQUE_GAIN, "g_T", "torque transducer"), (PRESSURE_GAIN, "g_p", "pressure sensor"))
}  # fmt: skip
"""Rows of the gains of the second recording; the first has none, which so narrow a prior holds."""
GAIN_CHANGE, GAIN_LEFT = 0.02, 0.02
"""A torque is another one times a gain: this far from 1, but for this share of the squares of their difference."""


def torque_ratio(before: Sequence[MeanCycles], after: Sequence[MeanCycles]) -> float | None:
    """Return torque after over torque before where that is all that differs, at about the same line pressure.

    A pump does not change so: a transducer, its range or its certificate does.
    """
    one, two = (_swings([side.torque_all for side in sides]) for sides in (before, after))
    ratio = float(one @ two / (one @ one))
    left = float(np.sum((two - ratio * one) ** 2) / max(np.sum((two - one) ** 2), 1e-300))
    lines = [[side.pressure_all for side in sides] for sides in (before, after)]
    # a line that keeps its level between strokes is the same by that, whatever the load
    same = all(
        abs(float(first @ second / (first @ first)) - 1.0) < 0.5 * abs(ratio - 1.0)
        for first, second in (map(np.concatenate, lines), map(_swings, lines))
    )
    return ratio if abs(ratio - 1.0) > GAIN_CHANGE and left < GAIN_LEFT and same else None


def _swings(rows: Sequence[Array]) -> Array:
    """Return the rows of several recordings behind one another, each about its median."""
    return np.concatenate([row - np.median(row) for row in rows])

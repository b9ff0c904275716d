"""Pulse train -> cam angle over time on the reference clock, and which cycles lie wholly inside the recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.align.pulses import PulseTrain
from pipeline.align.resample import cycle_times, hermite_slopes
from pipeline.config import TriggerSpec
from pipeline.records import Array

TWO_PI = 2.0 * np.pi
BEYOND = np.pi / 4.0
"""Angle by which a cycle may reach beyond the first or last pulse at the speed of the neighbouring revolution."""


@dataclass(frozen=True)
class CamAngle:
    """Nominal cam angle at pulses and what lies between.

    Attributes
    ----------
    angle, time : (n,) unwrapped cam angle of each pulse [rad] and its time on the reference clock [s]
    left, right : (n - 1,) dt/dtheta at the ends of each interval [s/rad]
    repaired, broken : (n,) of the pulse train
    """

    angle: Array
    time: Array
    left: Array
    right: Array
    repaired: NDArray[np.bool_]
    broken: NDArray[np.bool_]

    def times(self, cycle: int, n_theta: int) -> Array:
        """Return (n_theta + 2,) times of the grid of a cycle, from one step before it to its end."""
        out = np.empty(n_theta + 2)
        step = TWO_PI / n_theta
        cycle_times(self.angle, self.time, self.left, self.right, cycle * TWO_PI - step, step, out)
        return out

    def time_at(self, angle: NDArray[np.floating]) -> Array:
        """Return the times of unwrapped cam angles [s]."""
        out = np.empty(1)
        result = np.empty(angle.size)
        for k, value in enumerate(angle):
            cycle_times(self.angle, self.time, self.left, self.right, float(value), 0.0, out)
            result[k] = out[0]
        return result

    def candidate_cycles(self) -> NDArray[np.int64]:
        """Return the numbers of the cycles whose angle range is covered by pulses."""
        first = int(np.ceil((self.angle[0] - BEYOND) / TWO_PI - 1e-9))
        last = int(np.floor((self.angle[-1] + BEYOND) / TWO_PI + 1e-9))
        return np.arange(first, last, dtype=np.int64)

    def touches(self, cycle: int, flags: NDArray[np.bool_]) -> bool:
        """Tell whether a flagged pulse (or the interval that ends at it) shapes a cycle."""
        begin = max(0, int(np.searchsorted(self.angle, cycle * TWO_PI, side="right")) - 1)
        end = min(self.angle.size - 1, int(np.searchsorted(self.angle, (cycle + 1) * TWO_PI)))
        return bool(flags[begin : end + 1].any())


def cam_angle(train: PulseTrain, spec: TriggerSpec, speed_law: str) -> CamAngle:
    """Return the nominal cam angle: a pulse of step 0 passes at the nominal trigger angle."""
    angle: Array = np.asarray(spec.nominal_angle + train.step * (TWO_PI / spec.pulses_per_rev), dtype=np.float64)
    left, right = hermite_slopes(angle, train.time, speed_law == "smooth")
    return CamAngle(angle, train.time, left, right, train.repaired, train.broken)

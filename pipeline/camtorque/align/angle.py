"""Pulse train -> cam angle over time on the reference clock, and which cycles lie wholly inside the recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from camtorque.align.pulses import PulseTrain
from camtorque.align.resample import fill_times, hermite_slopes, interval_polynomials
from camtorque.config import TriggerSpec
from camtorque.records import Array

TWO_PI = 2.0 * np.pi
BEYOND = np.pi / 4.0
"""Angle by which a cycle may reach beyond the first or last pulse at the speed of the neighbouring revolution."""


@dataclass(frozen=True)
class CamAngle:
    """Nominal cam angle at pulses and what lies between.

    Attributes
    ----------
    angle, time : (n,) unwrapped cam angle of each pulse [rad] and its time on the reference clock [s]
    polynomials : (n - 1, 4) time in powers of the angle since the interval's first pulse
    repaired, broken, jumped : (n,) of the pulse train
    repair_error_deg : expected error of a repaired pulse
    """

    angle: Array
    time: Array
    polynomials: Array
    repaired: NDArray[np.bool_]
    broken: NDArray[np.bool_]
    jumped: NDArray[np.bool_]
    repair_error_deg: float = 0.0

    def time_at(self, angle: NDArray[np.floating]) -> Array:
        """Return the times of unwrapped cam angles [s]."""
        out = np.empty(1)
        result = np.empty(angle.size)
        for k, value in enumerate(angle):
            fill_times(self.angle, self.polynomials, float(value), 1.0, out)
            result[k] = out[0]
        return result

    def candidate_cycles(self) -> NDArray[np.int64]:
        """Return the numbers of the cycles whose angle range is covered by pulses."""
        first = int(np.ceil((self.angle[0] - BEYOND) / TWO_PI - 1e-9))
        last = int(np.floor((self.angle[-1] + BEYOND) / TWO_PI + 1e-9))
        return np.arange(first, last, dtype=np.int64)

    def touched(self, cycles: NDArray[np.int64], flags: NDArray[np.bool_], pulses_before: int = 0) -> NDArray[np.bool_]:
        """Tell which cycles overlap an interval that ends at a flagged pulse.

        With ``pulses_before=1`` the pulse at which a cycle's first interval begins counts too.
        """
        begin = np.searchsorted(self.angle, cycles * TWO_PI + 1e-9) - pulses_before
        end = np.minimum(self.angle.size - 1, np.searchsorted(self.angle, (cycles + 1) * TWO_PI - 1e-9))
        flagged = np.r_[0, np.cumsum(flags)]
        return flagged[end + 1] > flagged[np.clip(begin, 0, end + 1)]


def cam_angle(train: PulseTrain, spec: TriggerSpec, speed_law: str) -> CamAngle:
    """Return the nominal cam angle: a pulse of step 0 passes at the nominal trigger angle."""
    angle: Array = np.asarray(spec.nominal_angle + train.step * (TWO_PI / spec.pulses_per_rev), dtype=np.float64)
    jumped = np.zeros(angle.size, dtype=bool) if train.jumped is None else train.jumped
    left, right = hermite_slopes(angle, train.time, (train.broken | jumped)[1:], speed_law == "smooth")
    polynomials = interval_polynomials(angle, train.time, left, right)
    return CamAngle(angle, train.time, polynomials, train.repaired, train.broken, jumped, 360.0 * train.repair_error)

"""Pulse train -> cam angle over time on the reference clock, and which cycles lie wholly inside the recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from camtorque.align.places import Places
from camtorque.align.pulses import PulseTrain
from camtorque.align.resample import hermite_slopes, interval_polynomials, times_at
from camtorque.config import TriggerSpec
from camtorque.records import Array, Integers, Mask
from camtorque.units import TURN

BEYOND = np.pi / 4.0
"""Angle by which a cycle may reach beyond the first or last pulse at the speed of the neighbouring revolution."""


@dataclass(frozen=True)
class CamAngle:
    """Nominal cam angle at pulses and what lies between.

    Attributes
    ----------
    train : pulses on the reference clock
    angle : (n,) unwrapped cam angle of each [rad]
    polynomials : (n - 1, 4) time in powers of the angle since the interval's first pulse
    zero_step_angle : cam angle of the pulse of step zero [rad]
    nominal : cam angle that is declared of the trigger [rad]
    pulse_angle : cam angle at which the pulse, or the index, of that angle is, as the teeth tell it [rad]
    places : what the turns have in common; None for one pulse per turn, or too few turns
    """

    train: PulseTrain
    angle: Array
    polynomials: Array
    zero_step_angle: float
    nominal: float
    pulse_angle: float
    places: Places | None

    def time_at(self, angle: NDArray[np.floating]) -> Array:
        """Return the times of unwrapped cam angles [s]."""
        return times_at(self.angle, self.polynomials, angle)

    def candidate_cycles(self) -> Integers:
        """Return the numbers of the cycles whose angle range is covered by pulses.

        Those within a jump of a clock are left out: a log that pauses for an hour recorded none of its thousands.
        """
        first = int(np.ceil((self.angle[0] - BEYOND) / TURN - 1e-9))
        last = int(np.floor((self.angle[-1] + BEYOND) / TURN + 1e-9))
        jump = np.flatnonzero(self.train.jumps[1:])
        # a cycle that touches the pulse before or after the jump is one that was recorded in part
        begins = np.floor(self.angle[jump] / TURN + 1e-9).astype(np.int64) + 1
        ends = np.ceil(self.angle[jump + 1] / TURN - 1e-9).astype(np.int64) - 1
        long = ends > begins
        starts, stops = np.r_[first, ends[long]], np.r_[begins[long], last]
        return np.concatenate([np.arange(a, b, dtype=np.int64) for a, b in zip(starts, stops, strict=True)])

    def touched(self, cycles: Integers, flags: Mask, pulses_before: int = 0) -> Mask:
        """Tell which cycles overlap an interval that ends at a flagged pulse.

        With ``pulses_before=1`` the pulse at which a cycle's first interval begins counts too.
        """
        begin = np.searchsorted(self.angle, cycles * TURN + 1e-9) - pulses_before
        end = np.minimum(self.angle.size - 1, np.searchsorted(self.angle, (cycles + 1) * TURN - 1e-9))
        flagged = np.r_[0, np.cumsum(flags)]
        return flagged[end + 1] > flagged[np.clip(begin, 0, end + 1)]


def cam_angle(train: PulseTrain, spec: TriggerSpec, n: int, places: Places | None = None) -> CamAngle:
    """Return the cam angle over time; the nominal angle passes ``train.offset`` steps after the pulse of step zero.

    ``n`` are the pulses per turn of the cam; without ``places`` the teeth are where they should be.
    """
    pitch = TURN / n
    zero = spec.nominal_angle - train.offset * pitch
    place = 0.0 if places is None else places.at(train.offset)[0]
    if train.by_index:
        # the index was placed among teeth that stand elsewhere
        zero -= place
    angle: Array = np.asarray(zero + train.step * pitch, dtype=np.float64)
    if places is not None:
        angle = angle + places.place[train.step % n]
    nominal, pulse = spec.nominal_angle, zero + train.offset * pitch + place
    left, right = hermite_slopes(angle, train.time, (train.broken | train.jumps)[1:])
    return CamAngle(train, angle, interval_polynomials(angle, train.time, left, right), zero, nominal, pulse, places)

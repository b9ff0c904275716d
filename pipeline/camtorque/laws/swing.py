"""What a wheel on the camshaft saw of the cam's swing within a turn.

Shaft, transducer and chamber act over time: where the speed swings by a tenth within a turn, a filter over cam angle is
none. The chain therefore works over the even angle, which is time by the mean speed, as it does after one pulse a turn;
there the wheel says where the cam is. Curves over cam angle come there, and back, on the way of the alignment itself:
what it did between two teeth drops out.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from camtorque.records import Array, ReadOnly
from camtorque.units import TURN, angle_grid, on_grid

FINER = 8
"""Points between which a straight line is drawn, per point of a curve: its orders below a tenth of them keep 0.1 %."""
TOLD = 0.75
"""Share of the orders of a wheel up to which its teeth tell them apart from what is too fast for them."""
LEAST_TOLD = 2
"""Orders from which on what is told is worth more than the twist by the torque: seven teeth. Behind four to six of them
a cam that swings by 5 degrees had a trigger angle off by 0.3 to 2.8 degrees."""
NO_ERRORS = np.zeros((0, 1), dtype=np.complex128)
ROUNDING = 1.0e-9
"""Share of the largest harmonic below which one is rounding."""


@dataclass(frozen=True)
class Swing(ReadOnly):
    """The cam against even running.

    Attributes
    ----------
    lead : (n,) cam angle less the even angle at which the cam passes it, as the alignment has it over cam angle [rad]
    waves : (n,) the same of low orders alone, which a gap in the wheel does not bend [rad]
    order : highest order that is taken as told; the twist is rebuilt above, and all of it at 0, as behind one pulse
    errors : (k, m + 1) harmonics of what the waves may be off by, k errors of one standard deviation each [rad]
    """

    lead: Array
    waves: Array
    order: int
    errors: NDArray[np.complex128] = field(default_factory=lambda: NO_ERRORS)

    def even(self, n: int) -> Array:
        """Return the even angle at each of n cam angles of a revolution, as the alignment has them [rad]."""
        return angle_grid(n) - on_grid(self.lead, n)

    def cam(self, n: int) -> Array:
        """Return the cam angle, as the alignment has it, at each of n even angles of a revolution [rad]."""
        return angle_grid(n) + _over_even(self.lead, n)

    def told(self, n: int) -> Array:
        """Return what is told of the cam angle less the even angle, and two derivatives, over even angle, (3, n)."""
        if not self.order:
            return np.zeros((3, n))
        return self._of_told_orders(_over_even(self.waves, n))

    def told_errors(self, n: int) -> Array:
        """Return what that may be off by, one standard deviation of each error, (3, k, n)."""
        even = angle_grid(self.waves.size) - self.waves
        over = [np.interp(angle_grid(n), even, one, period=TURN) for one in self._over_cam(self.errors)]
        return self._of_told_orders(np.array(over).reshape(-1, n))

    def _of_told_orders(self, values: Array) -> Array:
        """Return the told orders of periodic values (..., n) over even angle, and two derivatives, (3, ..., n)."""
        n = values.shape[-1]
        harmonic = np.arange(n // 2 + 1)
        spectrum = np.where(harmonic <= self.order, np.fft.rfft(values), 0.0)
        return np.fft.irfft([spectrum * (1j * harmonic) ** power for power in range(3)], n)

    def corrected(self, errors: Array) -> Swing:
        """Return the swing as it was where its errors were so many standard deviations, (k,)."""
        if not errors.any():
            return self
        return replace(self, waves=self.waves + self._over_cam(errors @ self.errors))

    def _over_cam(self, harmonics: NDArray[np.complex128]) -> Array:
        """Return waves by their harmonics (..., m + 1) over the cam angles of the swing's own, (..., n)."""
        return np.fft.irfft(harmonics, self.waves.size) * (0.5 * self.waves.size)

    def evened(self, values: Array) -> Array:
        """Return a curve over cam angle (n,) over even angle, (n,)."""
        fine = on_grid(values, FINER * values.size)
        return np.interp(self.cam(values.size), angle_grid(fine.size), fine, period=TURN)


def _over_even(lead: Array, n: int) -> Array:
    """Return how far the cam is ahead over cam angle (m,) at n even angles [rad]."""
    fine = on_grid(lead, max(n, lead.size))
    return np.asarray(np.interp(angle_grid(n), angle_grid(fine.size) - fine, fine, period=TURN))


def swing_of(lead: Array, waves: Array, most: int, errors: NDArray[np.complex128] = NO_ERRORS) -> Swing:
    """Return the swing of a turn by how far the cam is ahead over cam angle, and by the waves of that, (n,) [rad].

    ``errors`` are those of `Swing`, none where they are not known; orders up to ``most`` are taken as told.

    At the pulse of the nominal angle the lead is zero, but for where its tooth is; the waves are zero in the mean.
    """
    spectrum = np.abs(np.fft.rfft(waves))
    highest = int(np.max(np.flatnonzero(spectrum > ROUNDING * np.max(spectrum)), initial=0))
    order = min(int(TOLD * highest), most)
    return Swing(lead, waves + np.mean(lead - waves), order if order >= LEAST_TOLD else 0, errors)

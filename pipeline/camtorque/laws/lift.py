"""Lift table: its rounding and measuring noise enter through the slope times the contact force.

At 1300 bar a slope error of 0.05 mm/rad, half a micrometre over a degree, is 0.3 N m. The correction is a periodic
cubic B-spline over the lifted part of the cam whose coefficients have zero mean and the table's own noise as prior;
B-splines are positive and sum to one, so the correction never exceeds its largest coefficient. It changes the slope
(torque) and leaves volume and inertia alone, where a micrometre is nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from camtorque.compiled import njit
from camtorque.laws.chain import ChainInput, ChainOutput, filtered, transfer
from camtorque.laws.torque import bin_restoring, bin_taps
from camtorque.records import Array, ReadOnly
from camtorque.units import DEGREE

KNOT_STEP = 1.5 * DEGREE
MARGIN = 3.0 * DEGREE
UNIFORM = np.array([[-1.0, 3.0, -3.0, 1.0], [3.0, -6.0, 0.0, 4.0], [-3.0, 3.0, 3.0, 1.0], [1.0, 0.0, 0.0, 0.0]]) / 6.0
"""The four cubic B-splines on equal knots that do not vanish, in powers of the place between two knots."""


@dataclass(frozen=True)
class LiftCorrection(ReadOnly):
    """Basis of the correction.

    Attributes
    ----------
    knots : (n_basis + 4,) [rad], first to last lifted angle with a margin
    prior_std : standard deviation of each coefficient [m]
    """

    knots: Array
    prior_std: float

    @property
    def n_basis(self) -> int:
        """Number of coefficients."""
        return self.knots.size - 4

    def thinned(self) -> LiftCorrection:
        """Return the correction with knots twice as far apart and the same spectral density at low harmonics."""
        step = 2.0 * (self.knots[1] - self.knots[0])
        count = int(np.ceil((self.knots[-1] - self.knots[0]) / step))
        scale = np.sqrt(0.5)
        knots = self.knots[0] + step * np.arange(count + 1)
        return LiftCorrection(knots, self.prior_std * scale)

    def _felt(self, theta: Array, derivative: int) -> tuple[Array, NDArray[np.int64]]:
        """Return the four splines at angles of any revolution, and the place of the first after three more knots."""
        step = self.knots[1] - self.knots[0]
        knot = np.mod(theta - self.knots[0], 2.0 * np.pi) / step
        piece = np.minimum(knot.astype(np.int64), self.knots.size - 2)
        powers = [np.polyval(np.polyder(row, derivative), knot - piece) for row in UNIFORM]
        inside = knot < self.knots.size - 1
        return np.stack(powers, axis=-1) * (inside / step**derivative)[:, None], piece

    def basis(self, theta: Array, derivative: int = 0) -> Array:
        """Return the basis at angles of any revolution, (n, n_basis), per coefficient."""
        felt, piece = self._felt(theta, derivative)
        wide = np.zeros((theta.size, self.n_basis + 6))
        wide[np.arange(theta.size)[:, None], piece[:, None] + np.arange(4)] = felt
        return wide[:, 3:-3]

    def binned_torque(self, theta: Array, load: Array, bins: int) -> Array:
        """Return the torque of each coefficient behind the low-pass of the bins, (bins, n_basis) [N].

        ``theta`` and ``load``: (n,) cam angle and contact force along the lift [rad, N].
        """
        felt, piece = self._felt(theta, 1)
        taps = bin_taps(theta.size // bins)
        return np.asarray(binned_splines(felt * load[:, None], piece, taps, bins, self.n_basis + 6)[:, 3:-3])

    def correction(self, theta: Array, coefficients: Array, derivative: int = 0) -> Array:
        """Return the correction [m] or its derivative at angles (n,) for coefficients (n_basis,)."""
        felt, piece = self._felt(theta, derivative)
        return np.asarray(np.sum(felt * np.pad(coefficients, 3)[piece[:, None] + np.arange(4)], axis=1))


@njit(cache=True, error_model="numpy", nogil=True)
def binned_splines(felt, first, taps, bins, width):  # type: ignore[no-untyped-def]
    """Return splines (n, 4), of which the first stands in column ``first`` (n,), on bins by weights, (bins, width)."""
    n = first.size
    each = n // bins
    reach = (taps.size - each) // 2
    out = np.zeros((bins, width))
    for b in range(bins):
        for t in range(taps.size):
            source = (each * b + t - reach) % n
            for k in range(4):
                out[b, first[source] + k] += taps[t] * felt[source, k]
    return out


def lift_correction(theta: Array, lift: Array, resolution: float, noise_std: float, step: float) -> LiftCorrection:
    """Return the correction basis for a lift given on an angle grid.

    Parameters
    ----------
    theta, lift : (n,) [rad], [m]
    resolution : stated resolution of the table [m]
    noise_std : standard deviation of the table's values about a smooth curve [m]
    step : of the table [rad]

    Notes
    -----
    White noise of the table, at its own step, and white coefficients at `KNOT_STEP` have the same spectral density at
    low harmonics when their variances are as the inverse steps.
    """
    lifted = theta[lift > 2.0 * resolution + 1e-9]
    start, stop = lifted.min() - MARGIN, lifted.max() + MARGIN
    count = int(np.ceil((stop - start) / KNOT_STEP))
    knots = start + (np.arange(count + 7) - 3.0) * KNOT_STEP
    error = max(noise_std, resolution / np.sqrt(12.0))
    prior_std = error * np.sqrt(step / KNOT_STEP)
    return LiftCorrection(knots, prior_std)


def lift_columns(chain: ChainInput, basis: LiftCorrection, output: ChainOutput, values: Mapping[str, float]) -> Array:
    """Return the measured torque of each coefficient of a correction, (bins, n) [N]."""
    columns = basis.binned_torque(output.motion.theta, output.load, chain.bins)
    shaft, measured, *_ = transfer(chain, values, chain.bins)
    behind = shaft * measured * bin_restoring(chain.theta.size // chain.bins, chain.bins)
    return filtered(columns, behind)

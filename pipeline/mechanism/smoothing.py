"""Smoothing of a rounded lift table: how far follows from the resolution that the table states.

The law is the periodic quintic spline with its knots on the table that minimises ``integral (y''')^2`` while its
residual has the standard deviation of the table's error (Reinsch 1967, with the discrepancy principle). An interpolant
turns an error sigma into 5-6 sigma / step^2 of y'': 1 um on a 1 degree table is a quarter of the true acceleration.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline, PPoly
from scipy.sparse.linalg import splu
from scipy.special import comb

from pipeline.records import Array

DEGREE = 5
PENALISED = 3
"""The jerk y''' is penalised: it may jump (cycloidal, modified sine, 3-4-5 cams), y'' may not."""
RESIDUAL_SHARE = 0.9
"""Residual over error: a fit that spends a fifth of its freedom leaves sqrt(1 - 0.2) of the scatter."""
DWELL_WEIGHT = 1.0e6
"""A dwell is flat, not noisy: its lift is held, a thousand times closer than a point of a flank."""
DWELL_POINTS = 8
"""Fewest equal points that make a dwell; on a flank that fine steps would not repeat so often."""
DWELL_MARGIN = 3
"""Points at either end of a dwell that are left free: a flank that starts softly is rounded to the dwell's lift."""
BISECTIONS = 40


def smoothing_spline(theta: Array, lift: Array, resolution: float) -> PPoly:
    """Return the smoothest periodic quintic spline that a table could be a rounding of.

    Parameters
    ----------
    theta, lift : (n + 1,) the table over one revolution, end point repeated [rad, m]
    resolution : step to which the lift is rounded [m]
    """
    basis = _PeriodicBasis(theta)
    spread = table_error(theta, lift[:-1], resolution)
    rounded = spread <= resolution / np.sqrt(12.0)
    held, values = _dwells(lift[:-1], resolution) if rounded else (np.zeros(theta.size - 1, dtype=bool), lift[:-1])
    weight = np.where(held, DWELL_WEIGHT, 1.0)
    if np.all(held):
        return basis.spline(basis.solve(weight, values, 1.0))
    error = RESIDUAL_SHARE * spread
    low, high = -60.0, 30.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        residual = (basis.at_knots @ basis.solve(weight, values, np.exp(middle)) - values)[~held]
        low, high = (middle, high) if np.sqrt(np.mean(residual**2)) < error else (low, middle)
    return basis.spline(basis.solve(weight, values, np.exp(low)))


def table_error(theta: Array, lift: Array, resolution: float) -> float:
    """Return the standard deviation of a table's error: rounding, or its scatter where that is clearly larger.

    ``theta`` repeats its first point one revolution later, ``lift`` does not.

    Rounding gives resolution / sqrt(12). The scatter is read from differences of order 4 to 6, in which the lift
    itself vanishes (median absolute deviation, so that the ends of the flanks do not count); the least of the three
    counts, since what is left of the lift can only add to it. A table of uneven steps is taken at its resolution.
    """
    rounding = float(resolution / np.sqrt(12.0))
    if np.ptp(np.diff(theta)) > 0.01 * np.mean(np.diff(theta)):
        return rounding
    scatter = min(_scatter(lift, order) for order in (4, 5, 6))
    return scatter if scatter > 2.0 * rounding else rounding


def _scatter(lift: Array, order: int) -> float:
    """Return the robust scatter of a periodic table from differences of one order (their noise gain is C(2k, k))."""
    difference = np.diff(np.concatenate([lift, lift[:order]]), order)
    return float(1.4826 * np.median(np.abs(difference)) / np.sqrt(comb(2 * order, order)))


def _dwells(lift: Array, resolution: float) -> tuple[np.ndarray, Array]:
    """Return which points lie inside a dwell, and the lift with every dwell at its mean.

    A dwell is a run that stays within one step of the table, as the rounding of a constant does.
    """
    size = lift.size
    held, values = np.zeros(size, dtype=bool), lift.copy()
    steps = np.abs(np.roll(lift, -1) - lift) > 1.001 * resolution
    start = int(np.argmax(steps)) + 1
    position = start
    while position < start + size:
        stop = position
        low = high = lift[position % size]
        while stop < start + size:
            value = lift[stop % size]
            if max(high, value) - min(low, value) > 1.001 * resolution:
                break
            low, high, stop = min(low, value), max(high, value), stop + 1
        if stop - position >= DWELL_POINTS:
            inside = np.arange(position + DWELL_MARGIN, stop - DWELL_MARGIN) % size
            held[inside] = True
            values[inside] = np.median(lift[inside])
        position = stop
    return held, values


class _PeriodicBasis:
    """Periodic quintic B-splines with knots on the table, and the Gram matrix of their third derivative."""

    def __init__(self, theta: Array) -> None:
        turn = theta[-1] - theta[0]
        count = theta.size - 1
        self.knots = np.concatenate([theta[-DEGREE - 1 : -1] - turn, theta, theta[1 : DEGREE + 1] + turn])
        size = count + DEGREE
        columns = np.arange(size)
        self.fold = sparse.csr_matrix((np.ones(size), (columns, columns % count)), shape=(size, count))
        self.at_knots = (BSpline.design_matrix(theta[:-1], self.knots, DEGREE) @ self.fold).tocsc()
        self.penalty = self._penalty(theta)

    def _penalty(self, theta: Array) -> sparse.csc_matrix:
        """Return the Gram matrix of y''' by Gauss quadrature, exact for its quadratic pieces."""
        nodes, weights = np.polynomial.legendre.leggauss(DEGREE - PENALISED + 1)
        width = np.diff(theta)
        points = (theta[:-1, None] + 0.5 * width[:, None] * (nodes + 1.0)).ravel()
        scale = np.sqrt((0.5 * width[:, None] * weights).ravel())
        jerk, knots = self._derivative()
        design = sparse.diags(scale) @ BSpline.design_matrix(points, knots, DEGREE - PENALISED) @ jerk @ self.fold
        return (design.T @ design).tocsc()

    def _derivative(self) -> tuple[sparse.csr_matrix, Array]:
        """Return the matrix from the coefficients to those of y''', and the knots of its splines (de Boor 1978)."""
        matrix, knots = sparse.identity(self.knots.size - DEGREE - 1, format="csr"), self.knots
        for degree in range(DEGREE, DEGREE - PENALISED, -1):
            rows = matrix.shape[0]
            scale = degree / (knots[degree + 1 : degree + rows] - knots[1:rows])
            matrix, knots = sparse.diags(scale) @ (matrix[1:] - matrix[:-1]), knots[1:-1]
        return matrix, knots

    def solve(self, weight: Array, values: Array, smoothing: float) -> Array:
        """Return the coefficients that minimise sum w (y - values)^2 + smoothing * integral (y''')^2."""
        normal = self.at_knots.T @ sparse.diags(weight)
        return splu((normal @ self.at_knots + smoothing * self.penalty).tocsc()).solve(normal @ values)

    def spline(self, coefficients: Array) -> PPoly:
        """Return the piecewise polynomial of the coefficients."""
        return PPoly.from_spline(BSpline(self.knots, self.fold @ coefficients, DEGREE))

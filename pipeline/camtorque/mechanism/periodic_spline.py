"""Periodic splines through or near a table: B-splines and the cyclic band matrices of their least squares.

In numpy alone: a lift law is made by every command, and importing a library of splines would cost many times what the
law does. B-splines and their derivatives by the recursions of de Boor (A Practical Guide to Splines, 1978).
"""

from __future__ import annotations

import math

import numpy as np

from camtorque.records import Array, Integers

DENSE = 80
"""Unknowns up to which a cyclic band matrix is solved as a whole."""


class PeriodicSplines:
    """Periodic splines of an odd degree over one revolution with the given knots (m + 1,) [rad]."""

    def __init__(self, breaks: Array, degree: int) -> None:
        turn = breaks[-1] - breaks[0]
        self.breaks, self.degree = breaks, degree
        self.knots = np.concatenate([breaks[-degree - 1 : -1] - turn, breaks, breaks[1 : degree + 1] + turn])

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return self.breaks.size - 1

    def rows(self, theta: Array, derivative: int = 0) -> tuple[Array, Integers]:
        """Return the basis functions that do not vanish at angles (n,), and whose they are, (n, degree + 1) each."""
        piece = np.clip(np.searchsorted(self.breaks, theta, "right") - 1, 0, self.count - 1)
        values = np.ones((1, theta.size))
        for degree in range(1, self.degree + 1):
            index = piece + self.degree + np.arange(1 - degree, 1)[:, None]
            left, right = self.knots[index], self.knots[index + degree]
            share, old = values / (right - left), values.shape[0]
            values = np.zeros((old + 1, theta.size))
            if degree <= self.degree - derivative:
                values[:-1] += share * (right - theta)
                values[1:] += share * (theta - left)
            else:
                values[:-1] -= degree * share
                values[1:] += degree * share
        return values.T, (piece[:, None] + np.arange(self.degree + 1)) % self.count

    def at(self, theta: Array, coefficients: Array) -> Array:
        """Return the spline at angles (n,)."""
        values, places = self.rows(theta)
        return np.asarray(np.sum(values * coefficients[places], axis=1))

    def normal(self, theta: Array, weight: Array, derivative: int = 0) -> Array:
        """Return the bands of the sum of weight times the squares of the splines' derivative at angles (n,).

        Band d, of the (degree + 1, m) that are returned, holds the products of coefficients k and k + d.
        """
        values, places = self.rows(theta, derivative)
        bands = np.zeros((self.degree + 1, self.count))
        for first in range(self.degree + 1):
            for other in range(first, self.degree + 1):
                product = weight * values[:, first] * values[:, other]
                bands[other - first] += _sums(places[:, first], product, self.count)
        return bands

    def right_side(self, theta: Array, weighted: Array) -> Array:
        """Return the sum of weighted values (n,) times the splines at their angles, (m,)."""
        values, places = self.rows(theta)
        return _sums(places, weighted[:, None] * values, self.count)

    def pieces(self, coefficients: Array) -> Array:
        """Return the polynomials between the knots, (degree + 1, m), highest power first."""
        powers = []
        for derivative in range(self.degree, -1, -1):
            values, places = self.rows(self.breaks[:-1], derivative)
            powers.append(np.sum(values * coefficients[places], axis=1) / math.factorial(derivative))
        return np.array(powers)


def _sums(places: Integers, values: Array, size: int) -> Array:
    """Return the sum of the values that belong to each place, (size,)."""
    return np.asarray(np.bincount(places.ravel(), values.ravel(), size), dtype=np.float64)


def solve_cyclic(bands: Array, right: Array) -> Array:
    """Return x of ``M x = right`` for a positive definite matrix of cyclic bands, see `PeriodicSplines.normal`.

    A second round takes off what the first one left by rounding, which fine tables with much smoothing need.
    """
    found = _solve_once(bands, right)
    left = right - bands[0] * found
    for k in range(1, bands.shape[0]):
        left -= bands[k] * np.roll(found, -k) + np.roll(bands[k] * found, k)
    return found + _solve_once(bands, left)


def _solve_once(bands: Array, right: Array) -> Array:
    """Return the solution to the rounding of its condition.

    Above `DENSE` unknowns they are cut into stretches that begin with as many edges as there are bands. Between the
    edges the stretches are solved side by side, then the edges from what is left (a Schur complement).
    """
    width, size = bands.shape[0] - 1, right.size
    row = np.broadcast_to(np.arange(size), bands.shape)
    column = (row + np.arange(width + 1)[:, None]) % size
    if size <= DENSE:
        half = _sums(row * size + column, bands, size * size).reshape(size, size)
        return np.asarray(np.linalg.solve(half + half.T - np.diag(bands[0]), right))
    count = round(1.6 * np.sqrt(size / width))  # about the least work for both
    start = np.arange(count + 1) * size // count
    block = int(np.max(np.diff(start)))
    stretch = np.searchsorted(start, np.arange(size), "right") - 1
    local = np.arange(size) - start[stretch]
    within = stretch[row] == stretch[column]
    place = (stretch[row] * block + local[row]) * block + local[column]
    own = _sums(place[within], bands[within], count * block * block).reshape(count, block, block)
    beyond = _sums(place[~within], bands[~within], count * block * block).reshape(count, block, block)
    free = np.ones((count, block))
    free[stretch, local] = 0.0  # shorter stretches are filled up
    diagonal = np.arange(block)
    own = own + np.swapaxes(own, 1, 2)
    own[:, diagonal, diagonal] = 0.5 * own[:, diagonal, diagonal] + free
    known = np.zeros((count, block, 1))
    known[stretch, local, 0] = right
    return _solve_stretches(own, beyond[:, :, :width], known)[stretch, local]


def _solve_stretches(own: Array, beyond: Array, known: Array) -> Array:
    """Return the unknowns (n, m) of n stretches.

    Parameters
    ----------
    own : (n, m, m) matrices; beyond : (n, m, w) their coupling to the edges of the next one; known : (n, m, 1)
    """
    count, _, width = beyond.shape
    side = np.concatenate([own[:, width:, :width], beyond[:, width:]], axis=2)
    inner = np.linalg.solve(own[:, width:, width:], np.concatenate([side, known[:, width:]], axis=2))
    left = np.swapaxes(side, 1, 2) @ inner
    edges = np.arange(count * width).reshape(count, width)
    both = np.concatenate([edges, np.roll(edges, -1, axis=0)], axis=1)
    head, top = np.zeros((count * width, count * width)), known[:, :width].ravel()
    for k in range(count):
        head[np.ix_(edges[k], edges[k])] += own[k, :width, :width]
        head[np.ix_(both[k], both[k])] -= left[k, :, :-1]
        top[both[k]] -= left[k, :, -1]
    found = np.linalg.solve(head, top)
    between = inner[:, :, -1:] - inner[:, :, :-1] @ found[both][:, :, None]
    return np.concatenate([found[edges], between[:, :, 0]], axis=1)

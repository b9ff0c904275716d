"""Smoothing of a rounded lift table: how far follows from the resolution that the table states.

The law is the periodic quintic spline with its knots on the table that minimises ``integral (y''')^2`` while its
residual has the standard deviation of the table's error (Reinsch 1967, with the discrepancy principle). An interpolant
turns an error sigma into 5-6 sigma / step^2 of y'': 1 um on a 1 degree table is a quarter of the true acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.periodic_spline import PeriodicSplines, solve_cyclic
from camtorque.records import Array, CamTable, Refusal
from camtorque.units import TURN, closed

DEGREE = 5
PENALISED = 3
"""The jerk y''' is penalised: it may jump (cycloidal, modified sine, 3-4-5 cams), y'' may not."""
LOBE_NUMBERS = 25
"""How many numbers a smooth lobe of two flanks takes, about: a fit that spends k of n numbers leaves sqrt(1 - k/n) of
the scatter as its residual."""
DWELL_WEIGHT = 1.0e6
"""A dwell is flat, not noisy: its lift is held, a thousand times closer than a point of a flank."""
DWELL_POINTS = 8
"""Fewest equal points that make a dwell; on a flank that fine steps would not repeat so often."""
DWELL_MARGIN = 3
"""Fewest points at either end of a dwell that are left free."""
FAR_STEPS = 8.0
"""How many steps off the dwell a flank is where its start is gauged."""
HALVINGS, MOST_STEPS = 8, 40
CLOSE_ENOUGH = 1.0e-9
"""Share by which the residual may differ from the table's error, and the logarithm of the smoothing from its root."""
CLEARLY_LARGER = 1.4
"""Times the rounding from which a scatter is one: of 1500 rounded lifts of 90 to 1440 rows none reaches 1.3, and a
table whose error is taken a third too small is followed into its noise."""
CLOSEST = 0.4
"""Least distance of knots over the mean step of the table."""


def smoothing_law(table: CamTable) -> CamLaw:
    """Return the smoothest periodic quintic spline that a table could be a rounding of.

    An exact table (resolution 0) calls for `camtorque.mechanism.lift_laws.quintic_law`.

    Raises
    ------
    Refusal : the table's resolution is not positive, so that nothing says how far to smooth
    """
    step = table.resolution
    if not step > 0.0:
        raise Refusal(
            f"lift table: resolution is {step} m, expected a positive step; state the resolution of the table"
        )
    theta, _ = closed(table.theta, table.lift)
    splines = PeriodicSplines(_breaks(theta), DEGREE)
    spread = table_error(table)
    rounded = spread <= step / np.sqrt(12.0)
    held, values = _dwells(theta, table.lift, step) if rounded else (np.zeros(theta.size - 1, dtype=bool), table.lift)
    weight = np.where(held, DWELL_WEIGHT, 1.0)
    normal, right = splines.normal(table.theta, weight), splines.right_side(table.theta, weight * values)
    penalty = splines.normal(*_gauss_points(splines.breaks), PENALISED)

    def smoothed(logarithm: float) -> Array:
        return solve_cyclic(normal + np.exp(logarithm) * penalty, right)

    if np.all(held):
        return CamLaw(splines.breaks, splines.pieces(smoothed(0.0)), spread, TURN / table.theta.size)
    error = spread * np.sqrt(max(1.0 - LOBE_NUMBERS / np.sum(~held), 0.5))

    def excess(logarithm: float) -> float:
        residual = (splines.at(table.theta, smoothed(logarithm)) - values)[~held]
        return float(np.sqrt(np.mean(residual**2))) / error - 1.0

    return CamLaw(splines.breaks, splines.pieces(smoothed(_root(excess, -60.0, 30.0))), spread, TURN / table.theta.size)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where an increasing function passes zero, or the end beyond which it does.

    Halves first, then false position with the value of an end that stays halved (Dowell & Jarratt, BIT 11 (1971)).
    """
    below, above, last = np.nan, np.nan, 0.0
    for step in range(MOST_STEPS):
        middle = 0.5 * (low + high)
        if step >= HALVINGS and below < 0.0 < above:
            middle = (low * above - high * below) / (above - below)
        value = function(middle)
        if value < 0.0:
            low, below, above = middle, value, above * (0.5 if last < 0.0 else 1.0)
        else:
            high, above, below = middle, value, below * (0.5 if last > 0.0 else 1.0)
        last = value
        if min(abs(value), high - low) < CLOSE_ENOUGH:
            return middle
    return low


def _gauss_points(breaks: Array) -> tuple[Array, Array]:
    """Return points between knots and their weights, with which the integral of a square of y''' is exact."""
    nodes, weights = np.polynomial.legendre.leggauss(DEGREE - PENALISED + 1)
    width = np.diff(breaks)[:, None]
    return (breaks[:-1, None] + 0.5 * width * (nodes + 1.0)).ravel(), (0.5 * width * weights).ravel()


def table_error(table: CamTable, clearly: float = CLEARLY_LARGER) -> float:
    """Return the standard deviation of a table's error [m]: rounding, or its scatter where that is clearly larger.

    Rounding gives resolution / sqrt(12). The scatter is read from differences of order 4 to 6, in which the lift
    itself vanishes (median absolute deviation, so that the ends of the flanks do not count); the least of the three
    counts, since what is left of the lift can only add to it. A table of uneven steps is taken at its resolution.
    ``clearly`` : times the rounding from which a scatter counts
    """
    rounding = float(table.resolution / np.sqrt(12.0))
    steps = np.diff(closed(table.theta, table.lift)[0])
    if np.ptp(steps) > 0.01 * np.mean(steps):
        return rounding
    scatter = min(_scatter(table.lift, order) for order in (4, 5, 6))
    return scatter if scatter > clearly * rounding else rounding


def _scatter(lift: Array, order: int) -> float:
    """Return the robust scatter of a periodic table from differences of one order (their noise gain is C(2k, k))."""
    difference = np.diff(np.concatenate([lift, lift[:order]]), order)
    return float(1.4826 * np.median(np.abs(difference)) / np.sqrt(math.comb(2 * order, order)))


def _dwells(theta: Array, lift: Array, resolution: float) -> tuple[np.ndarray, Array]:
    """Return which points lie inside a dwell, and the lift with every dwell at its median.

    A dwell is a run that stays within one step of the table, as the rounding of a constant does. A flank that starts
    softly is rounded to the dwell's lift for a while; `_margin` leaves that part free.
    """
    held, values = np.zeros(lift.size, dtype=bool), lift.copy()
    for start, stop in _runs(lift, resolution):
        if stop - start < DWELL_POINTS:
            continue
        if stop - start == lift.size:
            held[:], values[:] = True, np.median(lift)
            continue
        angle = _unrolled(theta, np.arange(start, stop))
        before, after = (_margin(theta, lift, edge, way, resolution) for edge, way in ((start, -1), (stop - 1, 1)))
        inside = np.arange(start, stop)[(angle >= angle[0] + before) & (angle <= angle[-1] - after)] % lift.size
        held[inside] = True
        values[inside] = np.median(lift[np.arange(start, stop) % lift.size])
    return held, values


def _runs(lift: Array, resolution: float) -> list[tuple[int, int]]:
    """Return the runs of points that stay within one step, as (first, one past the last); indices may pass the end."""
    size, limit = lift.size, 1.001 * resolution
    start = int(np.argmax(np.abs(np.roll(lift, -1) - lift) > limit)) + 1
    runs, position = [], start
    while position < start + size:
        stop, low, high = position, lift[position % size], lift[position % size]
        while stop < start + size:
            low, high = min(low, lift[stop % size]), max(high, lift[stop % size])
            if high - low > limit:
                break
            stop += 1
        runs.append((position, stop))
        position = stop
    return runs


def _unrolled(theta: Array, index: np.ndarray) -> Array:
    """Return the angle of points whose index may lie beyond the table, one revolution on or back."""
    size = theta.size - 1
    return theta[index % size] + (theta[-1] - theta[0]) * (index // size)


def _margin(theta: Array, lift: Array, edge: int, way: int, resolution: float) -> float:
    """Return how far into a dwell, from its edge, the flank may still be rising.

    The flank is off by half a step at the edge and by `FAR_STEPS` + 1/2 steps an angle g further out. If it starts as
    x^p, the part below half a step is as long as 17^(-1/p) / (1 - 17^(-1/p)) g: 1.0 g for p = 4 (4-5-6-7), less for
    steeper starts. So g is left free, and `DWELL_MARGIN` points at least.
    """
    size = lift.size
    off = np.abs(lift[(edge + way * np.arange(size)) % size] - lift[edge % size]) > FAR_STEPS * resolution
    steps = max(int(np.argmax(off)), DWELL_MARGIN)
    ends = _unrolled(theta, np.array([edge, edge + way * steps, edge - way * DWELL_MARGIN]))
    return float(max(abs(ends[1] - ends[0]), abs(ends[2] - ends[0])))


def _breaks(theta: Array) -> Array:
    """Return the angles of the table, thinned to at least `CLOSEST` of the mean step; both ends stay.

    Knots much closer than the table needs make the equations singular to rounding.
    """
    least = CLOSEST * (theta[-1] - theta[0]) / (theta.size - 1)
    kept = [theta[0]]
    for angle in theta[1:-1]:
        if angle - kept[-1] >= least and theta[-1] - angle >= least:
            kept.append(angle)
    return np.array([*kept, theta[-1]])

"""The registry of lift laws: how a table becomes a law. A new law is one function of a table and one line here."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.periodic_spline import PeriodicSplines, solve_cyclic
from camtorque.mechanism.smoothing import smoothing_law
from camtorque.mechanism.spectral import spectral_law
from camtorque.records import CamTable, Refusal
from camtorque.units import closed

LEAST_POINTS = 12
"""Fewer points in a revolution leave a spline of order 6 with a pure guess between them."""


def _interpolant(table: CamTable, degree: int) -> CamLaw:
    """Return the periodic spline through every point; its error is that of rounding to the stated step."""
    theta, _ = closed(table.theta, table.lift)
    splines = PeriodicSplines(theta, degree)
    normal = splines.normal(table.theta, np.ones(table.theta.size))
    coefficients = solve_cyclic(normal, splines.right_side(table.theta, table.lift))
    return CamLaw(theta, splines.pieces(coefficients), float(table.resolution / np.sqrt(12.0)))


def cubic_law(table: CamTable) -> CamLaw:
    """Return the periodic cubic interpolant, the method of the paper (Section 2.1, after Tsay et al.).

    It passes through every point, so the rounding of the table enters y'' with about 6 sigma / step^2.
    """
    return _interpolant(table, 3)


def quintic_law(table: CamTable) -> CamLaw:
    """Return the periodic quintic interpolant: y'' is smooth, and the rounding still enters with 4.8 sigma / step^2."""
    return _interpolant(table, 5)


LIFT_METHODS: dict[str, Callable[[CamTable], CamLaw]] = {
    "smoothing": smoothing_law,
    "spectral": spectral_law,
    "quintic": quintic_law,
    "cubic": cubic_law,
}
"""``smoothing`` is the default for forces and Hertz stress, where y'' counts; ``spectral`` is for the torque of a fit,
where y' counts (docs/lift_laws.md); the other two interpolate, and a rounded table ruins their y''."""


def lift_law(table: CamTable, method: str = "smoothing") -> CamLaw:
    """Return the lift law of a table by one of `LIFT_METHODS`.

    Raises
    ------
    Refusal : unknown method, or a table too short for it
    """
    if method not in LIFT_METHODS:
        raise Refusal(f"lift law: method {method!r} is unknown, expected one of {', '.join(LIFT_METHODS)}")
    if table.theta.size < LEAST_POINTS:
        raise Refusal(
            f"lift table: {table.theta.size} points in one revolution, expected at least {LEAST_POINTS}; measure finer"
        )
    return _law(
        table.theta.astype(np.float64).tobytes(), table.lift.astype(np.float64).tobytes(), table.resolution, method
    )


@lru_cache(maxsize=8)
def _law(theta: bytes, lift: bytes, resolution: float, method: str) -> CamLaw:
    """Return the law of a table; a run asks for the same one before its fit and after it, which takes 0.03 s."""
    return LIFT_METHODS[method](CamTable(np.frombuffer(theta), np.frombuffer(lift), resolution))

"""Ripple: what the measured torque repeats many times a revolution, whatever the cam does.

Teeth of a gear that mesh and poles of a motor that cog swing the torque by their number in a revolution; what of that a
transducer shows, behind its low-pass, is

    T_ripple = R_c cos(n theta) + R_s sin(n theta)

with n the order that the base circle shows (`fit.prepare`), theta the angle of uniform running: a drive
runs evenly against its cam. It does no work.
"""

from __future__ import annotations

import numpy as np

from camtorque.laws.rows import parameter
from camtorque.records import Array

ROWS = (
    parameter("ripple_cosine", "R_c", "N m", 1.0, (0.0, -50.0, 50.0, 0.02), (0.0, 2.0),
            "torque that teeth or poles of the drive repeat, at cam angle 0",
            "gear mesh, cogging and inverters: to a few percent of the nominal torque", "own"),
    parameter("ripple_sine", "R_s", "N m", 1.0, (0.0, -50.0, 50.0, 0.02), (0.0, 2.0),
            "the same a quarter of its wave later", "to a few percent of the nominal torque", "own"),
)  # fmt: skip
NAMES = tuple(row.name for row in ROWS)


def waves(order: int, theta: Array) -> Array:
    """Return the columns of R_c and R_s at angles (n,) [rad], (n, 2)."""
    return np.column_stack([np.cos(order * theta), np.sin(order * theta)])


def binned_waves(order: int, bins: int, n: int) -> Array:
    """Return the means of `waves` over bins of a grid of n angles from 0, (bins, 2); zero where no order was seen."""
    half, point = np.pi / bins, np.pi / n
    centres = np.asarray(2.0 * half * np.arange(bins) + half - point, dtype=np.float64)
    share = np.sin(order * half) / (n / bins * np.sin(order * point)) if order else 0.0
    return np.asarray(share * waves(order, centres))

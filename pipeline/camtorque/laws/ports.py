"""Ports: what plunger and helix cover and uncover, the suction valve, and the root law of the flow through them.

The free area of a port grows with the lift gap to its edge up to its full span::

    A = k h s(gap / h),   s(x) = (1 - q) x + q (3 x^2 - 2 x^3) for 0 < x < 1

between a slot (q = 0, straight) and a round hole (q = 1); all corners are rounded over a few hundredths, so that no
derivative jumps. Flow: ``Q = A sqrt(2/rho) C_d sqrt(p - p_feed)``, a straight line within two bar of zero. A suction
valve lets the same flow in, and none out, where the chamber lies 0.2 bar below the feed: pumps that no plunger edge
fills have one.
"""

from __future__ import annotations

import numpy as np

from camtorque.compiled import njit
from camtorque.laws.rows import parameter

FLUID_DENSITY = 830.0
"""Diesel-like test oil (ISO 4113 is 820-830) [kg/m^3]; only scales the flow coefficients into areas."""
DISCHARGE = 0.7 * np.sqrt(2.0 / FLUID_DENSITY)
"""Flow per area and square root of pressure, Cd sqrt(2/rho) with Cd = 0.7 [m/s/sqrt(Pa)]."""
LAMINAR = 2.0
"""Pressure difference below which the root goes over into a straight line [bar]."""
CORNER = 0.08
"""Share of a port's span over which its corners are rounded."""
SUCTION_OPENS, SUCTION_SOFT = 0.2, 0.2
"""Pressure difference at which a suction valve opens, and half the range over which it does [bar]."""

ROWS = (
    parameter("port_closing_lift", "y_port", "mm", 1.0e-3, (1.4, 0.02, 12.0, 0.05), None,
            "lift at which the plunger closes the inlet port", "end of pre-stroke; nominally at the trigger angle"),
    parameter("port_width", "k_port", "mm", 1.0e-3, (8.0, 0.1, 60.0, 1.5), (12.0, 12.0),
            "port area per lift while the plunger covers it (Cd = 0.7)", "a hole of 2 mm to a groove all round"),
    parameter("port_span", "h_port", "mm", 1.0e-3, (1.5, 0.1, 8.0, 0.3), (1.5, 1.0),
            "lift over which the inlet port closes", "port diameters of 1-4 mm"),
    parameter("port_roundness", "q", "-", 1.0, (0.6, 0.0, 1.5, 0.1), (0.7, 0.5),
            "0 for straight edges of ports and outlet, 1 for round ones", "slots and drilled holes"),
    parameter("feed_pressure", "p_feed", "bar", 1.0e5, (4.0, 0.0, 15.0, 1.0), (4.0, 2.5),
            "gauge pressure in the feed gallery", "gallery pumps, 1-8 bar"),
    parameter("suction_area", "A_suction", "mm^2", 1.0e-6, (0.0, 0.0, 60.0, 0.5), (0.0, 12.0),
            "flow area of a suction valve (Cd = 0.7), 0 where there is none", "seats of 3-8 mm, lifted 0.3-0.8 mm"),
)  # fmt: skip
SPILL_ROWS = (
    parameter("spill_lift", "y_spill", "mm", 1.0e-3, (5.0, 0.05, 30.0, 0.03), None,
            "lift at which the helix uncovers the spill port, and covers it again on the return",
            "depends on the load; fitted", "own"),
    parameter("spill_width", "k_spill", "mm", 1.0e-3, (5.0, 0.05, 60.0, 0.5), (5.0, 4.0),
            "spill area per lift above it (Cd = 0.7)", "port diameters of 2-4 mm", "own"),
    parameter("spill_span", "h_spill", "mm", 1.0e-3, (1.2, 0.1, 8.0, 0.3), (1.2, 0.8),
            "lift over which the spill port opens", "port diameters of 1-4 mm"),
)  # fmt: skip


@njit(cache=True, error_model="numpy", inline="always")
def flow_root(difference):  # type: ignore[no-untyped-def]
    """Return the odd square root, a straight line through zero, and its derivative; pressures in bar."""
    square = np.sqrt(difference * difference + LAMINAR * LAMINAR)
    root = np.sqrt(square)
    return difference / root, 1.0 / root - 0.5 * difference * difference / (square * square * root)


@njit(cache=True, error_model="numpy", inline="always")
def suction_root(difference):  # type: ignore[no-untyped-def]
    """Return the root of the pressure that opens a suction valve, 0 while it is closed, and its derivative; bar."""
    above = difference - SUCTION_OPENS
    if above <= -SUCTION_SOFT:
        return 0.0, 0.0
    if above < SUCTION_SOFT:
        root, root_d = flow_root((above + SUCTION_SOFT) ** 2 / (4.0 * SUCTION_SOFT))
        return root, root_d * 0.5 * (above + SUCTION_SOFT) / SUCTION_SOFT
    return flow_root(above)


@njit(cache=True, error_model="numpy")
def opening(x, roundness):  # type: ignore[no-untyped-def]
    """Return s(x) between 0 and 1 and its derivatives by x and roundness."""
    if x <= -CORNER:
        return 0.0, 0.0, 0.0
    if x >= 1.0 + CORNER:
        return 1.0, 0.0, 0.0
    clip, clip_x = x, 1.0
    if x < CORNER:
        clip, clip_x = (x + CORNER) ** 2 / (4.0 * CORNER), 0.5 * (x + CORNER) / CORNER
    elif x > 1.0 - CORNER:
        clip, clip_x = 1.0 - (1.0 + CORNER - x) ** 2 / (4.0 * CORNER), 0.5 * (1.0 + CORNER - x) / CORNER
    bent = clip * clip * (3.0 - 2.0 * clip)
    value = (1.0 - roundness) * clip + roundness * bent
    if value < 0.0 or value > 1.0:  # at the edges of a port that is rounder than a hole
        return min(max(value, 0.0), 1.0), 0.0, 0.0
    by_clip = 1.0 - roundness + roundness * 6.0 * clip * (1.0 - clip)
    return value, by_clip * clip_x, bent - clip

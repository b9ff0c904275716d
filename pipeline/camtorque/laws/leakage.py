"""Leakage past the plunger, through a clearance that widens (or is pressed narrower) with the pressure.

``Q = g (p - p_feed) ((1 + h p) / (1 + h p_r))**3``, g stated at p_r = 500 bar: a gap leaks with its third power.
"""

from __future__ import annotations

from camtorque.compiled import njit
from camtorque.laws.rows import parameter

LEAK_PRESSURE = 500.0
"""Pressure at which the leakage is stated [bar]."""

ROWS = (
    parameter("leakage", "g", "mm^3/s/bar", 1.0e-14, (0.3, 0.0, 200.0, 0.3), (0.5, 2.0),
            "leakage past the plunger, per pressure at 500 bar", "clearances of 2-6 um: 0.05-0.8, worn ones more"),
    parameter("leak_growth", "h", "1/kbar", 1.0e-8, (0.2, -0.6, 2.0, 0.1), (0.2, 0.5),
            "widening of the plunger's clearance with pressure", "about 1 um per kbar on 2-3 um, either sign"),
)  # fmt: skip


@njit(cache=True, error_model="numpy", inline="always")
def leak_flow(pressure, feed, leak, growth):  # type: ignore[no-untyped-def]
    """Return flow and derivatives by pressure, feed, leak and growth; bar, mm^3/ms, growth per bar."""
    reference = 1.0 + growth * LEAK_PRESSURE
    gap = max(1.0 + growth * pressure, 0.0) / reference
    cubed = gap * gap * gap
    flow = leak * (pressure - feed) * cubed
    steep = 3.0 * leak * (pressure - feed) * gap * gap
    by_pressure = leak * cubed + steep * growth / reference
    by_growth = steep * (pressure - LEAK_PRESSURE) / (reference * reference)
    return flow, by_pressure, -leak * cubed, (pressure - feed) * cubed, by_growth

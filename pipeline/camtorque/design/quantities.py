"""What may be free in a design: one line each; a test holds the table to docs/design.md."""

from __future__ import annotations

from dataclasses import dataclass

from camtorque.units import DEGREE

MILLIMETRE = 1.0e-3


@dataclass(frozen=True)
class Quantity:
    """A free quantity: SI per unit of its name, least value that makes sense in that unit, field of the pump if any."""

    factor: float
    least: float
    field: str = ""


QUANTITIES: dict[str, Quantity] = {
    "base_circle_radius_mm": Quantity(MILLIMETRE, 1e-3, "base_circle_radius"),
    "roller_radius_mm": Quantity(MILLIMETRE, 1e-3, "roller_radius"),
    "roller_width_mm": Quantity(MILLIMETRE, 1e-3, "roller_width"),
    "follower_offset_mm": Quantity(MILLIMETRE, -1e3, "follower_offset"),
    "plunger_diameter_mm": Quantity(MILLIMETRE, 1e-3, "plunger_diameter"),
    "spring_stiffness_N_per_mm": Quantity(1e3, 0.0, "spring_stiffness"),
    "spring_preload_N": Quantity(1.0, 0.0, "spring_preload"),
    "lift_mm": Quantity(MILLIMETRE, 1e-3),
    "rise_deg": Quantity(DEGREE, 1.0),
    "top_dwell_deg": Quantity(DEGREE, 0.0),
    "return_deg": Quantity(DEGREE, 1.0),
}
"""Free quantities of pump and lobe; each further pump on the shaft adds ``phase_2_deg``, ``phase_3_deg``, ..."""

LOBE = ("lift_mm", "rise_deg", "top_dwell_deg", "return_deg")
PUMP_FIELDS = {name: quantity.field for name, quantity in QUANTITIES.items() if quantity.field}
"""Quantity -> field of `camtorque.config.PumpData`."""


def phase_name(number: int) -> str:
    """Return the name of the phase of a pump on the shaft, the first being 1."""
    return f"phase_{number}_deg"

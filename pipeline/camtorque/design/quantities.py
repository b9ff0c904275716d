"""What may be free in a design: name, unit, meaning. One line each; a test holds the table to docs/design.md."""

from __future__ import annotations

from dataclasses import dataclass

from camtorque.units import DEGREE

MILLIMETRE = 1.0e-3


@dataclass(frozen=True)
class Quantity:
    """A free quantity: SI per unit of its name, meaning, least value that makes sense in that unit."""

    factor: float
    meaning: str
    least: float


QUANTITIES: dict[str, Quantity] = {
    "base_circle_radius_mm": Quantity(MILLIMETRE, "radius of the base circle", 1e-3),
    "roller_radius_mm": Quantity(MILLIMETRE, "radius of the roller", 1e-3),
    "roller_width_mm": Quantity(MILLIMETRE, "width of the contact", 1e-3),
    "follower_offset_mm": Quantity(MILLIMETRE, "offset of the follower axis towards X1", -1e3),
    "plunger_diameter_mm": Quantity(MILLIMETRE, "diameter of the plunger", 1e-3),
    "spring_stiffness_N_per_mm": Quantity(1e3, "rate of the spring", 0.0),
    "spring_preload_N": Quantity(1.0, "force of the spring on the base circle", 0.0),
    "lift_mm": Quantity(MILLIMETRE, "lift", 1e-3),
    "rise_deg": Quantity(DEGREE, "angle of the rise", 1.0),
    "top_dwell_deg": Quantity(DEGREE, "angle of the upper dwell", 0.0),
    "return_deg": Quantity(DEGREE, "angle of the return", 1.0),
}
"""Free quantities of pump and lobe; each further pump on the shaft adds ``phase_2_deg``, ``phase_3_deg``, ..."""

LOBE = ("lift_mm", "rise_deg", "top_dwell_deg", "return_deg")
PUMP_FIELDS = {
    "base_circle_radius_mm": "base_circle_radius",
    "roller_radius_mm": "roller_radius",
    "roller_width_mm": "roller_width",
    "follower_offset_mm": "follower_offset",
    "plunger_diameter_mm": "plunger_diameter",
    "spring_stiffness_N_per_mm": "spring_stiffness",
    "spring_preload_N": "spring_preload",
}
"""Quantity -> field of `camtorque.config.PumpData`."""


def phase_name(number: int) -> str:
    """Return the name of the phase of a pump on the shaft, the first being 1."""
    return f"phase_{number}_deg"

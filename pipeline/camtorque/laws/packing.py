"""Packing: friction of the plunger's seal, a constant and a share of the pressure force, against the motion."""

from __future__ import annotations

from camtorque.laws.rows import display

ROWS = (
    display("packing_force", "F_p", "N", 1.0, (0.0, 0.0, 400.0, 5.0), (0.0, 30.0),
            "constant friction of the plunger's packing", "seals and packings of 7-11 mm: 0-60 N", "shared", True),
    display("packing_friction", "f_p", "%", 0.01, (0.0, 0.0, 10.0, 0.3), (0.0, 1.5),
            "friction of the packing as a share of the pressure force", "pressed seals, 0-3 %", "shared", True),
)  # fmt: skip

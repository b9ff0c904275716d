"""Damping: torque in proportion to shaft speed, and force in proportion to plunger speed."""

from __future__ import annotations

from camtorque.laws.rows import display

ROWS = (
    display("shaft_viscous", "c_s", "N m s/rad", 1.0, (0.0, 0.0, 0.1, 0.001), (0.005, 0.01),
            "viscous drag and churning of the shaft", "bearing and seal films, oil bath", "shared", True),
    display("plunger_viscous", "c_p", "N s/m", 1.0, (0.0, 0.0, 600.0, 10.0), (10.0, 25.0),
            "viscous drag of plunger and follower", "shear of a 2-4 um film", "shared", True),
)  # fmt: skip

"""Damping: torque in proportion to shaft speed, and force in proportion to plunger speed."""

from __future__ import annotations

from camtorque.compiled import njit
from camtorque.laws.rows import Law, on_plunger, on_shaft, parameter

ROWS = (
    parameter("shaft_viscous", "c_s", "N m s/rad", 1.0, (0.0, 0.0, 0.1, 0.001), (0.005, 0.01),
            "viscous drag and churning of the shaft", "bearing and seal films, oil bath"),
    parameter("plunger_viscous", "c_p", "N s/m", 1.0, (0.0, 0.0, 600.0, 10.0), (10.0, 25.0),
            "viscous drag of plunger and follower", "shear of a 2-4 um film"),
)  # fmt: skip


@njit
def columns(at):  # type: ignore[no-untyped-def]
    """Return the columns of c_s w and c_p y' w."""
    return on_shaft(at.rate, 0.0, 1.0), on_plunger(at.slope * at.rate, at.curve * at.rate, at.slope, 0.0)


LAW = Law(ROWS, columns, loss="damping")

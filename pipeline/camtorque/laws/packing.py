"""Packing: friction of the plunger's seal, a constant and a share of the pressure force, against the motion."""

from __future__ import annotations

from camtorque.compiled import njit
from camtorque.laws.rows import Law, on_plunger, parameter

ROWS = (
    parameter("packing_force", "F_p", "N", 1.0, (0.0, 0.0, 400.0, 5.0), (0.0, 30.0),
            "constant friction of the plunger's packing", "seals and packings of 7-11 mm: 0-60 N"),
    parameter("packing_friction", "f_p", "%", 0.01, (0.0, 0.0, 10.0, 0.3), (0.0, 1.5),
            "friction of the packing as a share of the pressure force", "pressed seals, 0-3 %"),
)  # fmt: skip


@njit
def columns(at):  # type: ignore[no-untyped-def]
    """Return the columns of F_p sign y' and f_p A p sign y'."""
    load = at.area * at.pressure
    return (
        on_plunger(at.sign, at.sign_by, 0.0, 0.0),
        on_plunger(at.sign * load, at.sign_by * load, 0.0, at.sign * at.area),
    )


LAW = Law(ROWS, columns, {"packing_force": "packing_friction"}, loss="friction")

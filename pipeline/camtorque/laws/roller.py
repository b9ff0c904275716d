"""Roller: it spins up and down with the slope of the cam, and few sheets say how heavy it is.

::

    tau = I_r q (q w' + q' w^2)        q: rate of the roller over that of the cam

At 1900 rpm a roller of four times the disk that its contact width gives takes 0.2 N m on either flank.
"""

from __future__ import annotations

from camtorque.compiled import njit
from camtorque.laws.rows import Law, on_shaft, parameter

ROWS = (
    parameter("roller_inertia", "I_r", "kg mm^2", 1.0e-6, (0.6, 0.0, 50.0, 0.3), (1.2, 1.2),
            "moment of inertia of the roller about its axis",
            "solid disk of the contact's width: half of it where bored, several times that with ring and flanges"),
)  # fmt: skip


@njit
def columns(at):  # type: ignore[no-untyped-def]
    """Return the column of I_r."""
    by_angle = at.spin_by * at.turn + at.spin * at.turn_by
    return (on_shaft(at.spin * at.turn, by_angle, 2.0 * at.spin * at.spin_by * at.rate, at.spin * at.spin),)


LAW = Law(ROWS, columns, {"roller_inertia": "inertia"})

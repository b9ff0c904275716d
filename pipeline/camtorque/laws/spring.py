"""Spring: catalogue values are known to a few percent, and the data may say a little more."""

from __future__ import annotations

from camtorque.compiled import njit
from camtorque.laws.rows import Law, on_plunger, parameter

ROWS = (
    parameter("spring_stiffness_error", "d_k", "%", 0.01, (0.0, -15.0, 15.0, 1.0), (0.0, 2.0),
            "relative error of the spring rate", "catalogue, a few percent"),
    parameter("spring_preload_error", "d_F", "%", 0.01, (0.0, -25.0, 25.0, 2.0), (0.0, 5.0),
            "relative error of the preload", "catalogue, a few percent"),
)  # fmt: skip


@njit
def columns(at):  # type: ignore[no-untyped-def]
    """Return the columns of d_k k y and d_F F_s0."""
    return (
        on_plunger(at.stiffness * at.lift, at.stiffness * at.slope, 0.0, 0.0),
        on_plunger(at.preload, 0.0, 0.0, 0.0),
    )


LAW = Law(ROWS, columns, {row.name: "spring" for row in ROWS}, loss="spring")

"""Friction: forces that oppose sliding and rolling, in proportion to the load on the joint.

* bearing: ``mu r |N|``, N the contact force that the camshaft bearings carry;
* roller pin: ``mu r_pin |N| (L/r_r - 1)``, the roller turns L/r_r - 1 times as fast as the cam; a foot that
  slides on the cam with mu does so by r_r (L/r_r - 1) a radian: the same with mu r_r;
* guide: the side force presses the follower against its guide; the friction feeds back on the contact force,
  ``lambda_y = (F_axial) / (1 - mu |tan phi| sign(y'))``, and the follower jams as ``mu |tan phi| -> 1`` on the rise;
* drag: seals and constant drag of the shaft.

Source: Andersson, Tribology International 40 (2007); bearings 0.001-0.005 rolling, up to 0.05 plain.
"""

from __future__ import annotations

from camtorque.compiled import njit
from camtorque.laws.rows import Law, on_contact, on_shaft, parameter

ROWS = (
    parameter("bearing_arm", "mu r", "um", 1.0e-6, (0.0, 0.0, 2000.0, 30.0), (150.0, 200.0),
            "friction coefficient times radius of the camshaft bearings", "mu 0.002-0.05 on 8-15 mm"),
    parameter("pin_arm", "mu r_pin", "um", 1.0e-6, (0.0, 0.0, 600.0, 5.0), (30.0, 40.0),
            "friction coefficient times radius of the roller's pin", "needles: mu 0.002-0.03 on 2-4 mm"),
    parameter("guide_friction", "mu_g", "-", 1.0, (0.05, 0.0, 0.35, 0.02), (0.06, 0.05),
            "friction coefficient of the follower's guide", "lubricated steel, 0.02-0.12"),
    parameter("shaft_drag", "T_d", "N m", 1.0, (0.0, 0.0, 5.0, 0.05), (0.3, 0.6),
            "constant drag of seals and bearings", "lip seals 0.05-0.2 N m each, preloaded bearings to 1 N m"),
)  # fmt: skip


@njit
def columns(at):  # type: ignore[no-untyped-def]
    """Return the columns of ``mu r``, of ``mu r_pin``, both on the contact load over cos phi, and of the drag."""
    return (
        on_contact(at.lever, at.lever_by),
        on_contact(-at.lever * at.spin, -(at.lever_by * at.spin + at.lever * at.spin_by)),
        on_shaft(1.0, 0.0, 0.0),
    )


LAW = Law(
    ROWS,
    columns,
    {"bearing_arm": "bearing_friction", "pin_arm": "pin_friction"},
    loss="friction",
    nonlinear=("guide_friction",),
    on_contact=("bearing_arm", "pin_arm"),
)

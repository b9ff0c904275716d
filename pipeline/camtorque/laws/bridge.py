"""Bridge: a torque transducer feels a little of the bending that turns through it with the shaft.

The contact load bends the shaft in a plane that stands still; the strain gauges turn. In the shaft's own frame the load
per contact force along the follower is ``(tan phi cos theta - sin theta, -tan phi sin theta - cos theta)``, and the
bridge adds an arm of each to its torque. The arms are crosstalk times the distance between load and gauges.

Source: data sheets of torque transducers: 0.1-1 % of a bending moment.
"""

from __future__ import annotations

from camtorque.compiled import njit
from camtorque.laws.rows import Law, on_contact, on_shaft, parameter

ROWS = (
    parameter("bending_cosine", "a_c", "um", 1.0e-6, (0.0, -1000.0, 1000.0, 10.0), (0.0, 30.0),
            "arm at which the bridge feels the contact load at cam angle 0", "0.1-1 % of 10-30 mm"),
    parameter("bending_sine", "a_s", "um", 1.0e-6, (0.0, -1000.0, 1000.0, 10.0), (0.0, 30.0),
            "arm at which the bridge feels the contact load at cam angle 90 deg", "0.1-1 % of 10-30 mm"),
    parameter("turning_cosine", "T_c", "N m", 1.0, (0.0, -5.0, 5.0, 0.02), (0.0, 0.06),
            "torque that the bridge shows once a revolution, at cam angle 0",
            "weight, belt pull and misalignment: to 0.3 % of the nominal torque"),
    parameter("turning_sine", "T_s", "N m", 1.0, (0.0, -5.0, 5.0, 0.02), (0.0, 0.06),
            "torque that the bridge shows once a revolution, at cam angle 90 deg", "to 0.3 % of the nominal torque"),
)  # fmt: skip


@njit
def columns(at):  # type: ignore[no-untyped-def]
    """Return the columns of a_c and a_s."""
    along, along_by = at.cosine + at.tangent * at.sine, -at.sine + at.tangent * at.cosine + at.tangent_by * at.sine
    across, across_by = at.sine - at.tangent * at.cosine, at.cosine + at.tangent * at.sine - at.tangent_by * at.cosine
    return (
        on_contact(along, along_by), on_contact(across, across_by),
        on_shaft(at.cosine, -at.sine, 0.0), on_shaft(at.sine, at.cosine, 0.0),
    )  # fmt: skip


LAW = Law(ROWS, columns, {row.name: "bridge_bending" for row in ROWS}, on_bridge=True)

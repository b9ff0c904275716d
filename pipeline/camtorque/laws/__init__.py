"""What the rigid model leaves out: one file per law, equations and parameter rows side by side."""

from __future__ import annotations

from camtorque.laws import chamber, damping, driveline, friction, packing, sensor, spring
from camtorque.laws.rows import ParameterRow

LAWS: dict[str, tuple[ParameterRow, ...]] = {
    "chamber": chamber.ROWS,
    "friction": friction.ROWS,
    "packing": packing.ROWS,
    "damping": damping.ROWS,
    "driveline": driveline.ROWS,
    "coupling": driveline.COUPLING_ROWS,
    "sensor": sensor.ROWS,
    "spring": spring.ROWS,
}
"""Law -> its parameter rows; the lift correction has coefficients instead of named rows."""

ROWS: dict[str, ParameterRow] = {row.name: row for rows in LAWS.values() for row in rows}
"""Every named parameter."""
LAW_OF: dict[str, str] = {row.name: law for law, rows in LAWS.items() for row in rows}
"""Parameter -> law."""

"""What the rigid model leaves out: one file per effect, law and parameter rows side by side."""

from __future__ import annotations

from camtorque.laws import chamber, damping, driveline, friction, sensor, spring
from camtorque.laws.rows import ParameterRow

EFFECTS: dict[str, tuple[ParameterRow, ...]] = {
    "chamber": chamber.ROWS,
    "friction": friction.ROWS,
    "damping": damping.ROWS,
    "driveline": driveline.ROWS,
    "controller": driveline.CONTROLLER_ROWS,
    "coupling": driveline.COUPLING_ROWS,
    "sensor": sensor.ROWS,
    "spring": spring.ROWS,
}
"""Effect -> its parameter rows; the lift correction has coefficients instead of named rows."""

ROWS: dict[str, ParameterRow] = {row.name: row for rows in EFFECTS.values() for row in rows}
"""Every named parameter."""
EFFECT_OF: dict[str, str] = {row.name: effect for effect, rows in EFFECTS.items() for row in rows}
"""Parameter -> effect."""

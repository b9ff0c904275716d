"""What a design file may hold: every key outside [free], [aims] and [limits], and the quantities that may be free."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from camtorque.config.keys import Band, Key, TableSchema
from camtorque.config.schemas import CAM_SPEED
from camtorque.config.tables import Table, read_closed
from camtorque.units import DEGREE

DESIGN_SCHEMA = "camtorque-design/1"
ANY_SIZE = Band(-1e12, 1e12, "no response is larger")
LENGTH = Band(0.0, 500.0, "no cam lifts so far")
ERROR_MM = Band(0.0, 5.0, "no shop is off by so much")

TOP = TableSchema("", "a design task", (
    Key("schema", "text", "which schema the file follows"),
    Key("pump", "path", "pump file: first guess of what is free, value of everything else"),
))  # fmt: skip
LIFT = TableSchema("[lift]", "the lobe", (
    Key("degree", "whole", "degree of the B-splines; 2 is piecewise constant acceleration", default=5,
        band=Band(2, 7, "smoother than any shop grinds")),
    Key("pieces", "whole", "polynomial pieces of a B-spline flank", default=8,
        band=Band(3, 60, "finer than a table")),
    Key("lift_mm", "number", "lift", "mm", None, Band(1e-3, 500.0, "no cam lifts so far")),
    Key("rise_deg", "number", "angle of the rise", "deg", None, Band(1.0, 358.0, "less than a turn")),
    Key("top_dwell_deg", "number", "angle of the upper dwell", "deg", None, Band(0.0, 357.0, "less than a turn")),
    Key("return_deg", "number", "angle of the return", "deg", None, Band(1.0, 358.0, "less than a turn")),
))  # fmt: skip
LOAD = TableSchema("[[load]]", "speeds under one pressure over lift", (
    Key("speed_rpm", "numbers", "cam speeds", "rpm", band=CAM_SPEED),
    Key("pressure_bar", "number", "pressure while it delivers", "bar", None, Band(0.0, 10_000.0, "no pump bears more")),
    Key("closes_mm", "number", "lift at which the pressure begins to rise", "mm", 0.0, LENGTH),
    Key("spills_mm", "number", "lift at which it begins to fall", "mm", None, LENGTH),
    Key("ramp_mm", "number", "lift over which it comes and goes", "mm", 3e-4, Band(1e-3, 100.0, "more than nothing")),
    Key("recording", "text", "in their place, with --from: the fitted chamber pressure of this recording; without it "
        "that of the one nearest in speed", default=""),
    Key("pressure_file", "path", "in their place: pressure over cam angle of the pump file's cam, carried by the lift",
        default=None),
), many=True)  # fmt: skip
TOLERANCES = TableSchema("[tolerances]", "half widths of what the shop may be off by", (
    Key("lift_um", "number", "waviness of the ground cam", "um", 0.0, Band(0.0, 1000.0, "no cam is off by so much")),
    Key("follower_offset_mm", "number", "place of the follower", "mm", 0.0, ERROR_MM),
    Key("base_circle_radius_mm", "number", "radius of the cam, lift unchanged", "mm", 0.0, ERROR_MM),
    Key("roller_radius_mm", "number", "radius of the roller, lift unchanged", "mm", 0.0, ERROR_MM),
    Key("plunger_clearance_um", "number", "diametral: the pressure acts on the mean of plunger and bore", "um", 0.0,
        Band(0.0, 500.0, "no plunger is so loose")),
    Key("samples", "whole", "cams that are drawn", default=100, band=Band(10, 10_000, "minutes")),
), required=False)  # fmt: skip
ANSWER = TableSchema("[answer]", "what is wanted", (
    Key("points", "whole", "points of the front, beside the best of each aim; equal and beaten ones are left out",
        default=50, band=Band(2, 1000, "minutes")),
    Key("choose", "text", "`knee`, or the aim whose best design is written out", default="knee"),
    Key("seed", "whole", "of the random starts and of the tolerances", default=0, band=Band(0, 1e9, "any number")),
    Key("starts", "whole", "starts of the search for the best of each aim", default=3, band=Band(1, 100, "minutes")),
), required=False)  # fmt: skip


def read_values(table: Table, schema: TableSchema, *others: str) -> dict[str, Any]:
    """Return key -> value in SI of a table that holds the keys of a schema, perhaps others, and no more."""
    values = read_closed(table, schema, *others)
    return {key.name: values[key.attribute] for key in schema.keys}


MILLIMETRE = 1.0e-3


@dataclass(frozen=True)
class Quantity:
    """A free quantity: SI per unit of its name, least value that makes sense in that unit, field of the pump if any."""

    factor: float
    least: float
    field: str = ""


QUANTITIES: dict[str, Quantity] = {
    "base_circle_radius_mm": Quantity(MILLIMETRE, 1e-3, "base_circle_radius"),
    "roller_radius_mm": Quantity(MILLIMETRE, 1e-3, "roller_radius"),
    "roller_width_mm": Quantity(MILLIMETRE, 1e-3, "roller_width"),
    "follower_offset_mm": Quantity(MILLIMETRE, -1e3, "follower_offset"),
    "plunger_diameter_mm": Quantity(MILLIMETRE, 1e-3, "plunger_diameter"),
    "spring_stiffness_N_per_mm": Quantity(1e3, 0.0, "spring_stiffness"),
    "spring_preload_N": Quantity(1.0, 0.0, "spring_preload"),
    "lift_mm": Quantity(MILLIMETRE, 1e-3),
    "rise_deg": Quantity(DEGREE, 1.0),
    "top_dwell_deg": Quantity(DEGREE, 0.0),
    "return_deg": Quantity(DEGREE, 1.0),
}
"""Free quantities of pump and lobe; each further pump on the shaft adds ``phase_2_deg``, ``phase_3_deg``, ..."""

LOBE = ("lift_mm", "rise_deg", "top_dwell_deg", "return_deg")
PUMP_FIELDS = {name: quantity.field for name, quantity in QUANTITIES.items() if quantity.field}
"""Quantity -> field of `camtorque.config.PumpData`."""


def phase_name(number: int) -> str:
    """Return the name of the phase of a pump on the shaft, the first being 1."""
    return f"phase_{number}_deg"

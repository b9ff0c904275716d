"""The measured lift table of the cam."""

from __future__ import annotations

import re

import numpy as np

from camtorque.config import PumpData
from camtorque.ingest.table_file import SmallTable, read_comment, read_small_table
from camtorque.records import Array, CamTable, Finding, Refusal
from camtorque.units import BORDER_UNITS, did_you_mean, tidy_unit, unit_factor

RESOLUTION = re.compile(r"resolution\s*[:=]?\s*(\d{1,9}(?:\.\d{1,9})?(?:e-?\d{1,2})?)\s*([a-zµμ]{1,9})", re.IGNORECASE)
LEAST_ROWS = 8
FINEST = 1.0e-9
"""A spreadsheet writes sixteen digits whatever was measured [m]."""


def read_cam_table(pump: PumpData) -> tuple[CamTable, tuple[Finding, ...]]:
    """Read the lift table that the pump names.

    Angle and lift carry their units at the end of the column names (``cam_angle_deg``, ``lift_mm``). The resolution is
    that of the comment, else the last decimal written. A repeated end point at one revolution is dropped.

    Raises
    ------
    Refusal
        for a missing file or column, an unknown unit, angles that do not increase or exceed one revolution
    """
    table = read_small_table(pump.cam_table_path, "a lift table")
    theta = _column(table, pump.cam_table_angle_column, "angle")
    lift = _column(table, pump.cam_table_lift_column, "length")
    scale = unit_factor(_unit(table, pump.cam_table_lift_column), "length", str(table.path))
    resolution = _resolution(table, pump.cam_table_lift_column, scale)
    where = table.path.name
    findings = []
    if theta.size > 1 and abs(theta[-1] - theta[0] - 2.0 * np.pi) < 1e-9:
        if abs(lift[-1] - lift[0]) > 2.0 * resolution:
            raise Refusal(f"{table.path}: lift at the end of the revolution differs from its beginning by "
                          f"{1e6 * (lift[-1] - lift[0]):.3g} um; the table does not close")  # fmt: skip
        theta, lift = theta[:-1], lift[:-1]
    _check_angles(table, theta)
    if np.min(lift) < -2.0 * resolution:
        text = f"lift goes down to {1e6 * np.min(lift):.3g} um, below the base circle by more than the resolution"
        findings.append(Finding("lift_negative", "warning", text, where))
    if np.ptp(lift) <= 2.0 * resolution:
        raise Refusal(f"{table.path}: the lift varies by {1e6 * np.ptp(lift):.3g} um only; is the column right?")
    return CamTable(theta, lift, resolution), tuple(findings)


def lift_table_comment(pump: PumpData) -> str:
    """Return what the lift table says of itself above its columns."""
    return read_comment(pump.cam_table_path, "a lift table")


def _column(table: SmallTable, name: str, dimension: str) -> Array:
    if name not in table.columns:
        names = tuple(table.columns)
        raise Refusal(f"{table.path}: no column {name!r}{did_you_mean(name, names)}; there are {', '.join(names)}")
    return table.columns[name] * unit_factor(_unit(table, name), dimension, f"{table.path} column {name!r}")


def _unit(table: SmallTable, name: str) -> str:
    unit = tidy_unit(table.units.get(name, "") or name.rpartition("_")[2])
    if unit not in BORDER_UNITS:
        raise Refusal(
            f"{table.path}: column {name!r} has no known unit; write it at the end of the name (_deg, _rad, _mm, _m) "
            "or in a row below the names"
        )
    return unit


def _resolution(table: SmallTable, column: str, scale: float) -> float:
    match = RESOLUTION.search(table.comment)
    if match:
        return float(match[1]) * unit_factor(match[2], "length", f"{table.path} comment")
    return max(10.0 ** -table.decimals[column] * scale, FINEST)


def _check_angles(table: SmallTable, theta: Array) -> None:
    if theta.size < LEAST_ROWS:
        raise Refusal(f"{table.path}: {theta.size} rows, expected at least {LEAST_ROWS} over one revolution")
    steps = np.diff(theta)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 2
        raise Refusal(
            f"{table.path}: the angle does not increase at row {row}; sort the table along the running direction"
        )
    gap = max(float(np.max(steps)), 2.0 * np.pi - float(theta[-1] - theta[0]))
    if theta[-1] - theta[0] >= 2.0 * np.pi or gap > 4.0 * float(np.median(steps)):
        raise Refusal(
            f"{table.path}: angles from {np.rad2deg(theta[0]):g} to {np.rad2deg(theta[-1]):g} deg with a largest step "
            "of "
            f"{np.rad2deg(gap):g} deg; expected one whole revolution without gaps"
        )

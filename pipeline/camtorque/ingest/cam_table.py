"""The measured lift table of the cam, and its single wrong points: a slip of the pen, a burr under the stylus."""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from camtorque.config import PumpData
from camtorque.ingest.header import name_and_unit
from camtorque.ingest.table_file import SmallTable, read_small_table
from camtorque.records import MOST_LOBES, Array, CamTable, Finding, Refusal
from camtorque.units import BORDER_UNITS, DEGREE, did_you_mean, tidy_unit, unit_factor

RESOLUTION = re.compile(
    r"resolution\s*[:=]?\s*(\d{1,9}(?:[.,]\d{1,9})?(?:e-?\d{1,2})?)\s*([a-zµμ]{1,9})", re.IGNORECASE
)
STATED = re.compile(r"resolution\s*[:=]?\s*\d[^\s;,#]*(?:\s*[a-zµμ]{1,9}\b)?", re.IGNORECASE)
LEAST_ROWS = 8
SMALL_DIP = 5.0e-3
"""Share of the lift below the base circle that is runout or noise of a measured table."""
SAME_ANGLE = 0.01
"""Share of a step within which two angles are one: 2 pi is written 6.28318531."""
ABOVE_ZERO, FAR_ABOVE_ZERO = 0.02, 0.2
"""Share of the stroke above which the lowest lift is reported, and refused."""
STILL = 1.0e-3
"""Share of the stroke below which a lift has hardly begun."""
MOST_AT_ZERO, LAST_TOP = 0.4, np.radians(185.0)
"""Share of the stroke that the lift may have at angle zero, and angle at which it has to be at its top [rad]: rising
flank and end of delivery are sought from zero to half a revolution; an eccentric is at its top there."""
LOBE_TOP = 0.97
"""Share of the stroke from which a rise is a lobe's top, be it worn or ground lower than another one's."""
OPEN = 4.0
"""Times the largest change of slope between other rows that the step from the last row to the first may make."""
WHOLE = 0.02
"""Share of a turn within which a table covers a whole one, a part of it, or degrees that are radians."""
COARSE = 0.2
"""Share of the stroke between two rows beyond which the lift between them is a guess, as of a pressure curve: a flank
of five points."""
DISTINCT = 16
"""Values that have to differ before a step that they share is taken for the resolution: few may share one by chance."""
FINEST = 1.0e-9
"""A spreadsheet writes sixteen digits whatever was measured [m]."""
ORDER = 6
"""Order of the differences, in which a smooth lift vanishes and one wrong point leaves a row of binomials."""
EXACT = 1.0e-7
"""An exact table is taken to be good to this [m]."""
LEAST = 10.0
"""A point counts when it is off by more than this many standard deviations of the rounding."""
LIKENESS = 0.95
"""Share of the local sixth differences that one wrong point has to explain; steep ends of flanks explain less."""


def read_cam_table(pump: PumpData) -> tuple[CamTable, tuple[Finding, ...]]:
    """Read the lift table that the pump names.

    Angle and lift carry their units at the end of the column names (``cam_angle_deg``, ``lift_mm``). The resolution is
    that of the comment, else the step that all values share, at least the last decimal written. A repeated end point
    at one revolution is dropped. The angles returned count from the start of lift: from ``cam_table_zero`` of the file.

    Raises
    ------
    Refusal : for a missing file or column, an unknown unit, angles that do not increase or exceed one revolution
    """
    table = read_small_table(pump.cam_table_path, "a lift table")
    angle_name = _named(table, pump.cam_table_angle_column, "cam_table_angle_column")
    lift_name = _named(table, pump.cam_table_lift_column, "cam_table_lift_column")
    theta = table.column(angle_name) * _factor(table, angle_name, "angle")
    scale = _factor(table, lift_name, "length")
    lift = table.column(lift_name) * scale
    resolution = _resolution(table, lift_name, scale, lift)
    where = table.path.name
    theta, lift, findings = _in_order(theta, lift, where)
    theta, rounded = _evened(theta, _factor(table, angle_name, "angle"), where)
    findings += rounded
    if theta.size > 1 and abs(theta[-1] - theta[0] - 2.0 * np.pi) < SAME_ANGLE * abs(theta[1] - theta[0]):
        if abs(lift[-1] - lift[0]) > 2.0 * resolution:
            raise _open_table(table, lift[-1] - lift[0])
        theta, lift = theta[:-1], lift[:-1]
    _check_angles(table, theta)
    _check_closes(table, theta, lift, resolution)
    findings += _below_zero(table, lift, resolution)
    if np.ptp(lift) <= 2.0 * resolution:
        raise Refusal(f"{table.path}: the lift varies by {1e6 * np.ptp(lift):.3g} um only; is the column right?")
    findings += _above_zero(table, lift, resolution, pump.base_circle_radius)
    if (stated := STATED.search(table.comment)) and not RESOLUTION.search(table.comment):
        text = f"{stated[0]!r} is not read, the decimals tell {1e6 * resolution:.3g} um; write it as: resolution 1 um"
        findings.append(Finding("lift_resolution_unread", "warning", text, where))
    findings += _coarse(theta, lift, where)
    said, places = outliers_text(CamTable(theta, lift, resolution))
    if said:  # no smoothing would take them for wrong
        text = f"{said}: torque and stress are wrong there; measure them again"
        findings.append(Finding("lift_outlier", "warning", text, places))
    if zero := pump.cam_table_zero:
        theta, lift = _turned(theta, lift, zero)
        text = f"cam angles count from the start of lift, which is at {np.rad2deg(zero):g} deg of the lift table"
        findings.append(Finding("lift_table_zero", "info", text, where))
    cam = CamTable(theta, lift, resolution)
    _check_zero(table, cam, zero)
    return cam, tuple(findings)


def _turned(theta: Array, lift: Array, zero: float) -> tuple[Array, Array]:
    """Return a table whose angles count from one of its own."""
    turned = (theta - zero) % (2.0 * np.pi)
    start = int(np.argmin(turned))
    return np.roll(turned, -start), np.roll(lift, -start)


def _in_order(theta: Array, lift: Array, where: str) -> tuple[Array, Array, list[Finding]]:
    """Return a table from its lowest angle upwards that runs down, or begins within the revolution."""
    steps = np.diff(theta)
    if steps.size and np.all(steps < 0.0):
        text = "the angles fall from row to row; the table is read from its end"
        return theta[::-1], lift[::-1], [Finding("lift_table_backwards", "info", text, where)]
    down = np.flatnonzero(steps <= 0.0)
    if down.size == 1 and theta[-1] < theta[0] and np.ptp(theta) < 2.0 * np.pi:
        start = int(down[0]) + 1
        return np.roll(theta, -start), np.roll(lift, -start), []
    return theta, lift, []


def _evened(theta: Array, unit: float, where: str) -> tuple[Array, list[Finding]]:
    """Return even angles for those of a turn that are even ones with digits cut off (99.75, 100, 100.2, 100.5).

    Each has to be the even one to its own last digit, and some not to the last digit of others. The slope of such a
    table is wrong by a fifth from row to row.
    """
    even = theta[0] + np.arange(theta.size) * (2.0 * np.pi / theta.size)
    digits = np.array([len(f"{value / unit:.10g}".partition(".")[2]) for value in theta])
    off, last = np.abs(theta - even) / unit, 10.0**-digits
    if np.any(off > 0.5001 * last) or np.max(off) <= SAME_ANGLE * (even[1] / unit - even[0] / unit):
        return theta, []
    text = (
        f"the angles are even steps of {np.rad2deg(2.0 * np.pi / theta.size):.6g} deg with digits cut off, by up to "
        f"{np.rad2deg(np.max(off) * unit):.2g} deg; the even ones are used: export the table with all digits"
    )
    return np.asarray(even, dtype=np.float64), [Finding("lift_angles_rounded", "warning", text, where)]


def _open_table(table: SmallTable, error: float) -> Refusal:
    return Refusal(
        f"{table.path}: lift at the end of the revolution differs from its beginning by {1e6 * error:.3g} um; the "
        "table does not close: measure it again, or spread the difference over its rows, in proportion to their angle"
    )


def _check_closes(table: SmallTable, theta: Array, lift: Array, resolution: float) -> None:
    """Refuse a table whose last row and first lie a step apart that no other rows do: its roller would look too large.

    A point that sticks out makes two such steps, and is told as that.
    """
    slopes = np.diff(lift, append=lift[0]) / np.diff(theta, append=theta[0] + 2.0 * np.pi)
    before, after = slopes[-1] - slopes[-2], slopes[-1] - slopes[0]
    apart = min(abs(before), abs(after)) if before * after > 0.0 else 0.0
    error = apart * (2.0 * np.pi + theta[0] - theta[-1])
    if apart > OPEN * np.max(np.abs(np.diff(slopes[:-1]))) and error > 2.0 * resolution:
        raise _open_table(table, -math.copysign(error, before))


def _below_zero(table: SmallTable, lift: Array, resolution: float) -> list[Finding]:
    """Tell a lift below the base circle.

    Raises
    ------
    Refusal : its sign is turned
    """
    if -np.min(lift) > np.max(lift):
        raise Refusal(f"{table.path}: the lift goes from {1e3 * np.min(lift):.4g} to {1e3 * np.max(lift):.4g} mm, "
                      "expected it above the base circle; turn its sign")  # fmt: skip
    if np.min(lift) >= -2.0 * resolution:
        return []
    text = f"lift goes down to {1e6 * np.min(lift):.3g} um, below the base circle by more than the resolution"
    severity = "info" if np.min(lift) > -SMALL_DIP * np.ptp(lift) else "warning"
    return [Finding("lift_negative", severity, text, table.path.name)]


def _above_zero(table: SmallTable, lift: Array, resolution: float, radius: float) -> list[Finding]:
    """Tell a lift that never comes down to the base circle.

    Raises
    ------
    Refusal : the column holds a radius, or a height above something else
    """
    lowest, stroke = float(np.min(lift)), float(np.ptp(lift))
    if lowest <= max(10.0 * resolution, ABOVE_ZERO * stroke):
        return []
    text = f"the lift never falls below {1e3 * lowest:.4g} mm, its zero is the base circle ({1e3 * radius:g} mm radius)"
    if lowest > stroke * FAR_ABOVE_ZERO:
        raise Refusal(f"{table.path}: {text}: the column holds a radius or a height; take {1e3 * lowest:.4g} mm off")
    return [Finding("lift_above_zero", "warning", text, table.path.name)]


def _coarse(theta: Array, lift: Array, where: str) -> list[Finding]:
    """Tell a table whose rows lie so far apart that its flanks are drawn by the interpolation."""
    share = np.abs(np.diff(lift, append=lift[0])) / np.ptp(lift)
    worst = int(np.argmax(share))
    if share[worst] <= COARSE:
        return []
    step = np.rad2deg((np.roll(theta, -1)[worst] - theta[worst]) % (2.0 * np.pi))
    text = (
        f"the lift changes by {100.0 * share[worst]:.0f} % of its stroke from {np.rad2deg(theta[worst]):g} deg to the "
        f"next row {step:g} deg on: what lies between is a guess, and torque follows its slope; measure finer"
    )
    return [Finding("lift_table_coarse", "warning", text, where)]


def _check_zero(table: SmallTable, cam: CamTable, zero: float) -> None:
    """Refuse a table whose angles do not count from the start of the lift."""
    theta, lift = cam.theta, cam.lift
    above = (lift - np.min(lift)) / np.ptp(lift)
    at_zero = float(np.interp(0.0, theta, above, period=2.0 * np.pi))
    first = int(np.argmax(above >= LOBE_TOP))
    highest = first + int(np.argmax(above[first:] * np.logical_and.accumulate(above[first:] >= LOBE_TOP)))
    top = float(theta[highest]) % (2.0 * np.pi)
    if at_zero <= MOST_AT_ZERO and top <= LAST_TOP:
        return
    back_from_top = (highest - np.arange(theta.size)) % theta.size
    # the row before the first that is above noise and rounding: soft flanks stand a few degrees on at 2 % of the stroke
    still = max(2.0 * cam.resolution / np.ptp(lift), STILL)
    start = theta[back_from_top[int(np.argmax(above[back_from_top] <= still))]]
    against = at_zero <= MOST_AT_ZERO and 2.0 * np.pi - top <= LAST_TOP
    hint = "; or it runs against the direction of running: then each angle is 360 deg less itself" if against else ""
    found = f"at {np.rad2deg(zero):g} deg, cam_table_zero_deg," if zero else "at angle zero"
    start_deg = round(float(np.rad2deg(start + zero))) % 360
    raise Refusal(
        f"{table.path}: the lift stands at {100.0 * at_zero:.0f} % of its stroke {found} and is highest "
        f"{np.rad2deg(top):.0f} deg further on, expected zero at the start of lift and the top before "
        f"{np.rad2deg(LAST_TOP):.0f} deg; the lift starts at about {start_deg} deg: write cam_table_zero_deg = "
        f"{start_deg} in [pump], where nominal_angle_deg counts from the zero of the table, too{hint}"
    )


def _named(table: SmallTable, name: str, key: str) -> str:
    """Return the column that is meant, with or without its unit in brackets."""
    found = name if name in table.columns else name_and_unit(name)[0]
    if found not in table.columns:
        names = tuple(table.columns)
        raise Refusal(
            f"{table.path}: no column {name!r}{did_you_mean(name, names)}; there are {', '.join(names)}: write the one "
            f"that is meant as {key} in [pump]"
        )
    return found


def _factor(table: SmallTable, name: str, dimension: str) -> float:
    """Return the factor of a column to SI."""
    if dimension == "length" and "_per_" in name:
        raise Refusal(
            f"{table.path}: column {name!r} holds a slope, expected the lift itself; sum it up over the angle, from "
            "zero at the start of lift, and write that as a column such as lift_mm"
        )
    unit = tidy_unit(table.units.get(name, "") or name.rpartition("_")[2])
    if unit not in BORDER_UNITS:
        raise Refusal(
            f"{table.path}: column {name!r} has no known unit; write it at the end of the name (_deg, _rad, _mm, _m) "
            "or in a row below the names"
        )
    return unit_factor(unit, dimension, f"{table.path} column {name!r}")


def _resolution(table: SmallTable, column: str, scale: float, lift: Array) -> float:
    match = RESOLUTION.search(table.comment)
    if match:
        return float(match[1].replace(",", ".")) * unit_factor(match[2], "length", f"{table.path} comment")
    decimal = max(10.0 ** -table.decimals[column] * scale, FINEST)
    # a gauge that reads to 2 um is written to 0.1 um
    counts = np.rint(lift / decimal).astype(np.int64)
    return decimal * (max(int(np.gcd.reduce(counts)), 1) if np.unique(counts).size >= DISTINCT else 1)


def _check_angles(table: SmallTable, theta: Array) -> None:
    if theta.size < LEAST_ROWS:
        raise Refusal(f"{table.path}: {theta.size} rows, expected at least {LEAST_ROWS} over one revolution")
    steps = np.diff(theta)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 2
        remedy = "sort the table along the running direction"
        if np.all(steps >= 0.0):
            remedy = "it stands there twice: take out the row that is wrong"
        raise Refusal(f"{table.path}: the angle does not increase at row {row}; {remedy}")
    gap = max(float(np.max(steps)), 2.0 * np.pi - float(theta[-1] - theta[0]))
    if theta[-1] - theta[0] >= 2.0 * np.pi or gap > 4.0 * float(np.median(steps)):
        raise Refusal(
            f"{table.path}: angles from {np.rad2deg(theta[0]):g} to {np.rad2deg(theta[-1]):g} deg with a largest step "
            f"of {np.rad2deg(gap):g} deg; expected one whole revolution of the cam without gaps"
            f"{_part_of_turn(float(theta[-1] - theta[0] + np.median(steps)) / (2.0 * np.pi))}"
        )


def _part_of_turn(turns: float) -> str:
    """Return what a table may be that covers another part of a turn than one."""
    if abs(turns - 2.0) < 0.1:
        return "; degrees of a crank that turns twice are to be halved"
    if abs(turns / DEGREE - 1.0) < WHOLE:
        return "; they look like radians: say so in the column's name, such as cam_angle_rad"
    lobes = round(1.0 / turns)
    if 1 < lobes <= MOST_LOBES and abs(turns * lobes - 1.0) < WHOLE:
        return f"; where the cam has {lobes} equal lobes, write the rows of the first again for each"
    return ""


def outlying_points(table: CamTable) -> NDArray[np.int64]:
    """Return the indices of points that stick out of their neighbours, none for a table of uneven steps.

    Notes
    -----
    Around a point off by d, the differences of order 6 are ``d (1, -6, 15, -20, 15, -6, 1)``: d by least squares, and
    the share of the differences that it explains.
    """
    if table.theta.size < 4 * ORDER or np.ptp(np.diff(table.theta)) > 1e-3 * np.mean(np.diff(table.theta)):
        return np.empty(0, dtype=np.int64)
    pattern = np.array([(-1.0) ** k * math.comb(ORDER, k) for k in range(ORDER + 1)])
    half = ORDER // 2
    differences = sum(c * np.roll(table.lift, half - k) for k, c in enumerate(pattern))
    window = np.stack([np.roll(differences, half - k) for k in range(ORDER + 1)])
    size = pattern @ window / (pattern @ pattern)
    energy = np.sum(window**2, axis=0)
    explained = size**2 * (pattern @ pattern) / np.where(energy > 0.0, energy, 1.0)
    spread = max(table.resolution / np.sqrt(12.0), EXACT, 1.4826 * float(np.median(np.abs(size))))
    return np.flatnonzero((np.abs(size) > LEAST * spread) & (explained > LIKENESS))


def outliers_text(table: CamTable) -> tuple[str, str]:
    """Return which points of a lift table stick out, and where; empty where none does."""
    found = outlying_points(table)
    if not found.size:
        return "", ""
    where = ", ".join(f"{angle / DEGREE:g}" for angle in table.theta[found[:5]]) + " deg"
    return f"{found.size} point(s) of the lift table stick out of their neighbours, at {where}", where

"""A pump without a recording: its file with the lift table that it names, and a pressure curve."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import replace
from pathlib import Path

import numpy as np

from camtorque.config.pump import PressureCurve, PumpConfig, SectionSpec, load_pump_config
from camtorque.ingest.cam_table import read_cam_table
from camtorque.ingest.check import VACUUM, VACUUM_SHARE
from camtorque.ingest.pump_sizes import check_pump
from camtorque.ingest.table_file import read_small_table
from camtorque.records import CamTable, Finding, Refusal
from camtorque.units import BAR, DEGREE, TURN

LEAST_SPAN_DEG, MOST_BAR = 10.0, 10_000.0
"""A pressure curve over less, or to more than any pump gives, is one in another unit."""
LARGEST_RANGE = 3.5
"""Range of a sensor over the largest pressure that is measured with it; 46 recordings have 1.1 to 3.3."""
CLOSES = 0.02
"""Share of the peak by which a pressure may differ from itself a revolution on: cycles scatter less."""
CURVE_COLUMNS = ("cam_angle_deg", "pressure_bar")


def read_pump(path: Path | str) -> tuple[PumpConfig, tuple[Finding, ...]]:
    """Return a pump file, its lift table read, and what is to be known about the table and the sizes of the pump.

    Raises
    ------
    Refusal : see `load_pump_config`, `read_cam_table` and `check_pump`
    """
    config = load_pump_config(path)
    if config.sections:
        # heights alone: where the path of the roller is too sharp for a cam, its law tells exactly
        return config, _unusual(config, _heights(config.sections), but={"undercut"})
    table, findings = read_cam_table(config.pump)
    return replace(config, cam_table=table), (*findings, *_unusual(config, table))


def _unusual(config: PumpConfig, table: CamTable, but: AbstractSet[str] = frozenset()) -> tuple[Finding, ...]:
    """Hold the sizes of a pump against each other, unless it has no lift: its cam is refused then."""
    if not np.ptp(table.lift) > 0.0:
        return ()
    return tuple(check_pump(config.pump, table, config.rotation, config.path, but=but))


def _heights(sections: tuple[SectionSpec, ...]) -> CamTable:
    """Return the lifts at which sections begin, at even angles in place of theirs."""
    rises = [rise for one in sections for rise in ((one.rise, -one.rise) if one.kind == "tangent" else (one.rise,))]
    return CamTable(np.linspace(0.0, TURN, len(rises), endpoint=False), np.cumsum(rises), np.finfo(float).eps)


def read_pressure_curve(path: Path | str) -> PressureCurve:
    """Return a pressure curve from a CSV file with the columns ``cam_angle_deg`` and ``pressure_bar`` (gauge).

    A repeated end point at one revolution is dropped.

    Raises
    ------
    Refusal : missing file or column, values that are no numbers, angles that do not increase within one revolution,
        angles or pressures of another unit
    """
    table = read_small_table(Path(path), "a pressure curve")
    angle, pressure = map(table.column, CURVE_COLUMNS)
    if angle.size > 1 and abs(angle[-1] - angle[0] - 360.0) < 1e-9:
        if abs(pressure[-1] - pressure[0]) > CLOSES * np.max(np.abs(pressure)):
            raise Refusal(
                f"{path}: found {pressure[0]:g} bar at {angle[0]:g} deg and {pressure[-1]:g} bar at {angle[-1]:g} deg, "
                "which are one angle, expected the same; correct one of them or leave it out"
            )
        angle, pressure = angle[:-1], pressure[:-1]
    if angle.size < 2 or not np.all(np.diff(angle) > 0.0) or angle[-1] - angle[0] >= 360.0:
        raise Refusal(
            f"{path}: cam_angle_deg has to increase strictly within one revolution and have two angles or more, found "
            f"{angle.size}; sort or complete the curve"
        )
    if angle[-1] - angle[0] < LEAST_SPAN_DEG:
        raise Refusal(
            f"{path}: cam_angle_deg spans {angle[-1] - angle[0]:.3g} deg, expected a revolution, or all of it that is "
            "loaded; give degrees, not radians or turns"
        )
    if np.max(pressure) > MOST_BAR:
        raise Refusal(
            f"{path}: pressure_bar reaches {np.max(pressure):.3g} bar, expected {MOST_BAR:g} bar or less; give bar, "
            "not Pa or kPa"
        )
    return _of_a_line(PressureCurve(angle * DEGREE, pressure * BAR), str(path))


def _of_a_line(curve: PressureCurve, where: str) -> PressureCurve:
    """Refuse a pressure that no line holds, with room for the errors of the sensor that it may come from."""
    low, high = float(np.min(curve.pressure)), float(np.max(curve.pressure))
    if low < VACUUM - VACUUM_SHARE * LARGEST_RANGE * max(high, 0.0):
        raise Refusal(
            f"{where}: the pressure goes down to {low / BAR:.4g} bar, expected gauge pressures of -1 bar (vacuum) or "
            "more, no line holds less; check its sign and its zero"
        )
    return curve


def checked_curve(curve: PressureCurve) -> PressureCurve:
    """Return a pressure curve of arrays [rad, Pa], held against what holds for one of a file.

    Raises
    ------
    Refusal : see `read_pressure_curve`
    """
    theta, pressure = curve.theta, curve.pressure
    if theta.ndim != 1 or theta.size < 2 or theta.shape != pressure.shape:
        raise Refusal(
            f"PressureCurve: found theta of shape {theta.shape} and pressure of shape {pressure.shape}, expected one "
            "dimension, 2 points or more and as many of each"
        )
    if not (np.isfinite(theta).all() and np.isfinite(pressure).all()):
        raise Refusal("PressureCurve: found values that are no finite numbers; leave those points out")
    if not np.all(np.diff(theta) > 0.0) or theta[-1] - theta[0] >= TURN:
        raise Refusal(
            f"PressureCurve theta: found {theta[0]:g} to {theta[-1]:g}, expected angles that increase strictly within "
            "one revolution [rad]; convert degrees, and leave out the end that repeats the beginning"
        )
    if theta[-1] - theta[0] < LEAST_SPAN_DEG * DEGREE or np.max(pressure) > MOST_BAR * BAR:
        raise Refusal(
            f"PressureCurve: found angles over {theta[-1] - theta[0]:.3g} and a pressure to {np.max(pressure):.3g}, "
            f"expected rad, all that is loaded of a revolution, and Pa up to {MOST_BAR * BAR:g}"
        )
    return _of_a_line(curve, "PressureCurve")

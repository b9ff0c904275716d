"""Chart 1: what the angle grid, its interpolation and the lift table cost and lose."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator, make_interp_spline

from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.lift_laws import LIFT_METHODS
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import Array
from camtorque.studies.case import SPEED, peak_error, rounded_table, study_law, study_pressure, study_pump
from camtorque.studies.table import Chart, Choice, Point, measured
from camtorque.units import angle_grid, closed

DEFAULT = ("cubic periodic", 3600)
GRIDS = (180, 360, 720, 1800, 3600, 7200, 18000)
CHECKS = 20011
"""Angles at which the interpolated curve is compared: a prime, so that no grid hits them."""
TABLE_STEPS = (0.25, 0.5, 1.0, 2.0, 5.0)
RESOLUTIONS = (0.0, 1.0e-7, 1.0e-6, 1.0e-5)
LEAST = 1.0e-16
"""Errors below are drawn here: rounding of a double."""


INTERPOLANTS: dict[str, Callable[[Array, Array], Callable[[Array], Array]]] = {
    "linear": lambda x, y: lambda at: np.interp(at, *closed(x, y)),
    "PCHIP": lambda x, y: PchipInterpolator(*closed(x, y)),
    "cubic periodic": lambda x, y: CubicSpline(*closed(x, y), bc_type="periodic"),
    "quintic": lambda x, y: make_interp_spline(*closed(x, y), k=5, bc_type="periodic"),
}
"""Curve between grid points: name -> builder."""


def torque_on(theta: Array, law: CamLaw) -> Array:
    """Return the rigid torque of the study pump [N m]."""
    tables = closed_form_tables(study_pump(), law, theta)
    return tables.evaluate("torque", study_pressure(theta), SPEED)


def grid_chart(quick: bool) -> Chart:
    """Return torque error between grid points against the cost of tables, torque and curve."""
    check = angle_grid(CHECKS)
    exact = torque_on(check, study_law())
    choices = []
    for name in INTERPOLANTS:
        for n_theta in GRIDS[:5] if quick else GRIDS:
            run = partial(_interpolated, name, n_theta, check)
            error = max(peak_error(run(), exact), LEAST)
            choices.append(Choice(name, f"{360.0 / n_theta:g} deg", error, run, default=(name, n_theta) == DEFAULT))
    points = measured(choices, 2 if quick else 5)
    note = f"largest error of the torque over its peak at {CHECKS} angles; reference: the analytic law at these angles"
    return Chart("grid", "Angle grid and interpolation", "torque error / peak", "time of one curve [s]", points, note)


def _interpolated(name: str, n_theta: int, check: Array) -> Array:
    theta = angle_grid(n_theta)
    return INTERPOLANTS[name](theta, torque_on(theta, study_law()))(check)


QUANTITIES = ("torque", "acceleration", "Hertz stress")


def law_errors(law: CamLaw, theta: Array) -> tuple[float, float, float]:
    """Return the largest errors of torque, y'' and Hertz stress over their peaks; infinite where a law is undercut."""
    pressure = study_pressure(theta)
    sides = []
    for item in (law, study_law()):
        tables = closed_form_tables(study_pump(), item, theta)
        torque, hertz = tables.evaluate("torque", pressure, SPEED), tables.hertz(pressure, SPEED)
        sides.append((torque, tables.kinematics.acceleration, hertz))
    errors = [peak_error(found, true) for found, true in zip(*sides, strict=True)]
    return tuple(error if np.isfinite(error) else np.inf for error in errors)  # type: ignore[return-value]


def table_charts(quick: bool) -> tuple[Chart, ...]:
    """Return one chart per quantity: error against the points of the lift table, by method and rounding."""
    theta = angle_grid(3607)
    steps = TABLE_STEPS[1:4] if quick else TABLE_STEPS
    points: dict[str, list[Point]] = {name: [] for name in QUANTITIES}
    for resolution in RESOLUTIONS:
        for name, builder in LIFT_METHODS.items():
            if name == "smoothing" and resolution == 0.0:
                continue  # an exact table is not smoothed: quintic
            for step in steps:
                found = law_errors(builder(rounded_table(study_law(), step, resolution)), theta)
                family = f"{name}, {resolution * 1e6:g} um" if resolution else f"{name}, exact"
                for quantity, error in zip(QUANTITIES, found, strict=True):
                    marked = name == "smoothing" and resolution == 1.0e-6 and step == 1.0
                    points[quantity].append(
                        Point(family, f"{step:g} deg", error, 360.0 / step, marked, resolution == 1.0e-6)
                    )
    note = "the front is that of tables rounded to 1 um; a method that interpolates differentiates the rounding twice"
    return tuple(
        Chart(
            f"lift_table_{quantity.split()[0].lower()}", f"Lift table: {quantity}", f"{quantity} error / peak",
            "points of the lift table", tuple(points[quantity]), note, True,
        )
        for quantity in QUANTITIES
    )  # fmt: skip

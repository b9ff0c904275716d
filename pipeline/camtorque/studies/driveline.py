"""Chart 3: the periodic torque of one pump behind an elastic shaft."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from camtorque.laws.chain import filtered
from camtorque.laws.driveline import COUPLING_ROWS, ROWS, compliance, shaft_transfer
from camtorque.mechanism.elastic import ElasticShaft, solve_by_harmonics, solve_elastic
from camtorque.mechanism.mounting import PumpUnit
from camtorque.records import Array
from camtorque.studies.case import knotted_law, peak_error, study_pressure, study_pump
from camtorque.studies.integrators import TABLE, Shaft, collocation, load_rows, march_periodic, rhs
from camtorque.studies.table import Chart, Choice, measured
from camtorque.units import TURN, angle_grid, closed

REFERENCE_ELEMENTS, REFERENCE_STAGES = 3600, 6
CYCLES = 4
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)
LINEAR, PREDICT = "linear harmonic", "predict (elastic shaft)"
DEFAULTS = ((LINEAR, "720/rev"), (PREDICT, "3600/rev"))
"""What the fit's chain uses (3600 points in bins of 5), and what a prediction uses."""
Curve = tuple[Array, Array]


def at_angles(theta: Array, torque: Array, *_: bool, check: Array) -> Array:
    """Return torque at checking angles from samples of one turn (any increasing angles)."""
    order = np.argsort(np.mod(theta, TURN))
    angle, value = closed(np.mod(theta, TURN)[order], torque[order])
    return CubicSpline(angle, value, bc_type="periodic")(np.where(check < angle[0], check + TURN, check))


def harmonic(rows: Array, shaft: Shaft) -> Curve:
    """Return the driveline of the fit's chain: rigid torque through the shaft's transfer, linear, over drive angle.

    ``rows`` are those of `load_rows` on a uniform grid.
    """
    size = rows.shape[1]
    inertia = float(np.mean(rows[2]))
    omega = np.arange(size // 2 + 1) * shaft.speed
    resonance = float(np.sqrt(shaft.stiffness / inertia))
    values = {
        **{row.name: row.start for row in (*ROWS, *COUPLING_ROWS)}, "drive_admittance": 0.0,
        "shaft_compliance": 1.0 / shaft.stiffness, "shaft_resonance": resonance,
        "shaft_damping_ratio": 0.5 * shaft.damping * resonance / shaft.stiffness,
    }  # fmt: skip
    transfer, _ = shaft_transfer(omega, values, compliance(omega, values, False))
    return angle_grid(size), filtered(rows[0] + rows[1] * shaft.speed**2, transfer)


def elastic(shaft: Shaft, size: int, solve: Callable[..., ElasticShaft] = solve_elastic) -> Curve:
    """Return what a prediction uses, collocation read on a uniform grid of the drive's angle, over cam angle.

    ``solve_by_harmonics`` is the non-linear harmonic balance, which also solves several lobes.
    """
    theta, unit = angle_grid(size), PumpUnit(study_pump(), knotted_law())
    values = np.array([shaft.stiffness]), np.array([shaft.damping])
    found = solve([unit], study_pressure(theta)[None], shaft.speed, *values)
    return theta + found.twist[0], found.torque


def adaptive(
    table: Array, shaft: Shaft, method: str, tolerance: float, capped: bool = True
) -> tuple[Array, Array, bool]:
    """Return scipy's solution of the last of `CYCLES` turns from rest; ``capped`` limits the step to 5 degrees."""
    period, steps = TURN / shaft.speed, 3600
    times = (CYCLES - 1) * period + np.arange(steps) * (period / steps)
    found = solve_ivp(
        rhs(table, shaft), (0.0, CYCLES * period), [0.0, 0.0], method=method, t_eval=times, rtol=tolerance,
        atol=[tolerance * 1e-2, tolerance * shaft.speed], max_step=period / 72 if capped else np.inf,
    )  # fmt: skip
    lead, rate = found.y
    return angle_grid(steps) + lead, -shaft.stiffness * lead - shaft.damping * rate, bool(found.success)


def _from_pump(solve: Callable[..., Any], *arguments: Any) -> Any:
    """Return a solution by an integrator from pump and lift law on, its load table included."""
    return solve(load_rows(angle_grid(TABLE)), *arguments)


def candidates(shaft: Shaft, quick: bool) -> dict[tuple[str, str], Callable[[], Any]]:
    """Return (method, setting) -> function that returns cam angle and torque first."""
    found: dict[tuple[str, str], Callable[[], Any]] = {}
    for size in (180, 360, 720, 1800, 3600):
        found[LINEAR, f"{size}/rev"] = partial(harmonic, load_rows(angle_grid(size)), shaft)
    for size in (360, 720, 1800, 3600):
        found["non-linear harmonic", f"{size}/rev"] = partial(elastic, shaft, size, solve_by_harmonics)
    found[PREDICT, "3600/rev"] = partial(elastic, shaft, 3600)
    for elements, place in ((360, "on"), (377, "off")):
        for stages in (1, 2, 3, 4, 6):
            name = f"collocation, {elements} elements {place} the knots"
            found[name, f"{stages} stages"] = partial(collocation, shaft, elements, stages)
    for scheme in ("RK4", "generalized-alpha 0.8"):
        for size in (720, 1800, 3600, 7200, 18000)[: 4 if quick else 5]:
            found[scheme, f"{size}/rev"] = partial(_from_pump, march_periodic, shaft, scheme, size)
    for method in ("DOP853", "Radau") if quick else ("RK45", "DOP853", "Radau", "BDF", "LSODA"):
        for tolerance in TOLERANCES[:2] if quick else TOLERANCES:
            found[f"scipy {method}", f"rtol {tolerance:g}"] = partial(_from_pump, adaptive, shaft, method, tolerance)
    return found


def driveline_chart(quick: bool) -> Chart:
    """Return torque error against time per periodic solution."""
    shaft, check = Shaft(), angle_grid(5003)
    reference = at_angles(*collocation(shaft, REFERENCE_ELEMENTS, REFERENCE_STAGES), check=check)
    choices = [
        Choice(*names, peak_error(at_angles(*run(), check=check), reference), run, default=names in DEFAULTS)
        for names, run in candidates(shaft, quick).items()
    ]
    points = measured(choices, 1 if quick else 4)
    note = (
        f"k = {shaft.stiffness:g} N m/rad, c = {shaft.damping:g} N m s/rad, 500 rpm; reference: collocation with "
        f"{REFERENCE_ELEMENTS} elements of {REFERENCE_STAGES} stages; integrators run five turns from rest, "
        "scipy four; times from pump and lift law on, but for the linear form, whose load the fit's chain has at hand"
    )
    return Chart(
        "driveline", "Periodic driveline", "torque error / peak", "time of one periodic solution [s]", points, note
    )

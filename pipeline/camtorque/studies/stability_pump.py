"""Stability maps of lift tables, cams and running conditions, by the calls that `camtorque predict` makes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from camtorque.config.pump import PressureCurve, PumpConfig
from camtorque.ingest.cam_table import outlying_points
from camtorque.ingest.pump_file import read_pressure_curve
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.friction import Friction
from camtorque.mechanism.lift_laws import LIFT_METHODS, lift_law
from camtorque.mechanism.predict import predict
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import CamTable, Refusal
from camtorque.studies.case import SPEED, peak_error, rounded_table, study_law, study_pressure, study_pump
from camtorque.studies.grid import law_errors
from camtorque.studies.table import Outcome, StabilityMap, cell
from camtorque.units import angle_grid, counted

LIMITS = (5.0e-3, 5.0e-2)
THETA = angle_grid(3600)


def _noisy(std: float) -> CamTable:
    table = rounded_table(study_law(), 1.0, 0.0)
    noise = std * np.random.default_rng(7).standard_normal(table.theta.size)
    return CamTable(table.theta, np.round((table.lift + noise) * 1e6) / 1e6, 1e-6)


def _with_spike() -> CamTable:
    table = rounded_table(study_law(), 1.0, 1e-6)
    lift = table.lift.copy()
    lift[37] += 5e-5
    return CamTable(table.theta, lift, 1e-6)


TABLES: dict[str, Callable[[], CamTable]] = {
    "1 deg, 1 um": lambda: rounded_table(study_law(), 1.0, 1e-6),
    "0.25 deg, 1 um": lambda: rounded_table(study_law(), 0.25, 1e-6),
    "0.25 deg, 10 um": lambda: rounded_table(study_law(), 0.25, 1e-5),
    "5 deg, 1 um": lambda: rounded_table(study_law(), 5.0, 1e-6),
    "20 deg, 1 um": lambda: rounded_table(study_law(), 20.0, 1e-6),
    "noise of 3 um, stated as 1 um": partial(_noisy, 3e-6),
    "noise of 20 um, stated as 1 um": partial(_noisy, 2e-5),
    "one point off by 50 um": _with_spike,
    "11 points": lambda: CamTable(angle_grid(11), study_law().evaluate(angle_grid(11)), 1e-6),
    "resolution missing": lambda: rounded_table(study_law(), 1.0, 0.0),
}
"""Condition of a lift table -> the table."""


def _table_error(table: Callable[[], CamTable], method: str, quantity: int) -> Outcome:
    given = table()
    error, outliers = law_errors(lift_law(given, method), THETA)[quantity], outlying_points(given).size
    return error, counted(outliers, "point sticks out", "points stick out") if outliers else ""


def table_map(quick: bool) -> StabilityMap:
    """Return torque and Hertz stress from damaged lift tables."""
    cells = []
    for name, table in TABLES.items():
        for method in LIFT_METHODS:
            for quantity, label in ((0, "torque"), (2, "Hertz")):
                attempt = partial(_table_error, table, method, quantity)
                cells.append(cell(name, f"{label}: {method}", attempt, LIMITS, default=method == "smoothing"))
    note = "largest error over the peak against the analytic law; up to 0.5 % works, up to 5 % degrades"
    return StabilityMap("lift_tables", "Lift tables: noise, coarse steps, rounding, outliers", tuple(cells), note)


def pump_config(law: CamLaw | None = None, **changes: object) -> PumpConfig:
    """Return a pump file's content with a dense exact table of a law."""
    table = rounded_table(study_law() if law is None else law, 0.5, 1e-8)
    config = PumpConfig(
        Path("pump.toml"), "", study_pump(), (), 0.0, 1, (0.0, 0.0), 0.0, None, (0.0,), float("inf"), 0.0, table
    )
    return replace(config, **changes)  # type: ignore[arg-type]


def _run(config: PumpConfig, speed: float, exact: CamLaw) -> Outcome:
    curve = PressureCurve(THETA, study_pressure(THETA))
    found = predict(config, [speed], curve)
    tables = closed_form_tables(config.pump, exact, found.theta)
    true, contact = (tables.evaluate(name, found.pressure, speed) for name in ("torque", "contact_normal"))
    error = peak_error(found.shaft_torque[0], true)
    # where the model does not hold, the number cannot be trusted, whatever its error against the same model
    broken = bool(np.any(tables.kinematics.undercut) or np.any(contact <= 0.0))
    reported = "; ".join(item.text for item in found.findings if item.severity != "info")
    return (1.0 if broken else error), reported


def running_map(quick: bool) -> StabilityMap:
    """Return what a prediction makes of cams and speeds at the edge of the model."""
    steep, hollow = study_law(rise_deg=25.0), study_law(lift=12e-3)
    wall = study_law(rise_deg=6.0), study_law(rise_deg=2.0)
    large = replace(study_pump(), roller_radius=0.03)
    far = replace(study_pump(), follower_offset=0.05)
    cases: dict[str, Callable[[], Outcome]] = {
        "500 rpm": lambda: _run(pump_config(), SPEED, study_law()),
        "0.001 rpm": lambda: _run(pump_config(), 1e-4, study_law()),
        "speed 0": lambda: _run(pump_config(), 0.0, study_law()),
        "negative speed": lambda: _run(pump_config(), -SPEED, study_law()),
        "speed not a number": lambda: _run(pump_config(), float("nan"), study_law()),
        "no speed": _empty,
        "follower jumps (6000 rpm)": lambda: _run(pump_config(), 12.0 * SPEED, study_law()),
        "concave flank": lambda: _run(pump_config(hollow), SPEED, hollow),
        "steep flank, undercut (25 deg rise)": lambda: _run(pump_config(steep), SPEED, steep),
        "pressure angle to 79 deg (6 deg rise)": lambda: _run(pump_config(wall[0]), SPEED, wall[0]),
        "pressure angle to 86 deg (2 deg rise)": lambda: _run(pump_config(wall[1]), SPEED, wall[1]),
        "undercut (roller of 30 mm)": lambda: _run(pump_config(steep, pump=large), SPEED, steep),
        "offset beyond the roller's reach": lambda: _run(pump_config(pump=far), SPEED, study_law()),
    }
    cells = [cell(name, "predict", attempt, LIMITS, default=True) for name, attempt in cases.items()]
    cells += [
        cell("500 rpm", "tables in float32", _single, LIMITS),
        cell("pressure at one angle", "predict", _one_sample, LIMITS, default=True),
    ]
    for friction, default in ((0.35, True), (1.0, False)):
        name = f"steep flank, guide friction {friction:g}"
        cells.append(cell(name, "fit's chain", partial(_jamming, friction), LIMITS, default=default))
    note = "error of the torque over its peak; 1 where contact is lost or the cam cannot exist"
    return StabilityMap("running", "Cams and speeds at the edge of the model", tuple(cells), note)


def _jamming(friction: float) -> Outcome:
    """Return 1 where the contact force turns negative although the follower jams (mu tan(phi) reaches 1) unrefused.

    0.35 is the largest coefficient that a fit may reach; more can only be held by hand.
    """
    pump, law, pressure = study_pump(), study_law(rise_deg=25.0), study_pressure(THETA)
    load = closed_form_tables(pump, law, THETA, friction=Friction(guide=friction)).evaluate(
        "contact_y", pressure, SPEED
    )
    free = closed_form_tables(pump, law, THETA).evaluate("contact_y", pressure, SPEED)
    return float(np.any((load < 0.0) & (free > 0.0)))


def _empty() -> Outcome:
    predict(pump_config(), [])
    return 1.0


def _one_sample() -> Outcome:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pressure.csv"
        path.write_text("cam_angle_deg,pressure_bar\n0,100\n")
        try:
            curve = read_pressure_curve(path)
        except Refusal as refusal:
            raise Refusal(str(refusal).replace(str(path), path.name)) from refusal
    predict(pump_config(), [SPEED], curve)
    return 1.0


def _single() -> Outcome:
    tables = closed_form_tables(study_pump(), study_law(), THETA)
    full = tables.evaluate("torque", study_pressure(THETA), SPEED)
    row = tables.outputs["torque"].astype(np.float32)
    low = row[0] + row[1] * study_pressure(THETA).astype(np.float32) + row[2] * np.float32(SPEED**2)
    return peak_error(low, full)

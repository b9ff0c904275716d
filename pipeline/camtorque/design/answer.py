"""The result of a design: the chosen cam as lift table and pump file, read back as `predict` reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config.schemas import PUMP as PUMP_TABLE
from camtorque.design.evaluate import Evaluated
from camtorque.design.explain import Price, prices
from camtorque.design.front import Front, FrontPoint, find_front
from camtorque.design.task import Task
from camtorque.design.tolerances import Spread, spreads
from camtorque.ingest.cam_table import outlying_points
from camtorque.ingest.new_recording import toml_value
from camtorque.ingest.pump_file import read_pressure_curve, read_pump
from camtorque.jsonable import jsonable
from camtorque.mechanism.predict import predict, sweep_rows
from camtorque.progress import Progress
from camtorque.records import Refusal
from camtorque.units import BAR, DEGREE

TABLE_STEP_DEG, TABLE_DECIMALS = 0.5, 5
PRESSURE_STEP_DEG = 0.25
PUMP, TABLE = "pump.toml", "cam.csv"


@dataclass(frozen=True)
class Answer:
    """A solved task: its front, and for the chosen design the price of every limit and the spread by tolerances."""

    task: Task
    front: Front
    prices: tuple[Price, ...]
    spreads: Mapping[str, Spread]

    @property
    def chosen(self) -> FrontPoint:
        """The chosen point."""
        return self.front.points[self.front.chosen]


def solve_task(task: Task, tell: Progress) -> Answer:
    """Return the answer to a task.

    Raises
    ------
    Refusal : no design keeps all limits
    """
    front = find_front(task, tell)
    point = front.points[front.chosen]
    tell("what the limits cost, and the tolerances")
    found = prices(point.problem, front.scale, point.variables, point.reference)
    return Answer(task, front, found, spreads(point.problem, point.variables, task.seed))


def lift_table_text(design: Evaluated) -> str:
    """Return the lift table in the direction of running from the start of the rise, as `read_cam_table` wants it."""
    degrees = np.arange(0.0, 360.0, TABLE_STEP_DEG)
    lift = 1e3 * design.lobe.law().evaluate(degrees * DEGREE)
    rows = "\n".join(f"{a:.1f},{y:.{TABLE_DECIMALS}f}" for a, y in zip(degrees, np.maximum(lift, 0.0), strict=True))
    return (
        f"# lift of the chosen design, resolution {10.0 ** (3 - TABLE_DECIMALS):g} um\ncam_angle_deg,lift_mm\n{rows}\n"
    )


def pressure_text(design: Evaluated, number: int) -> str:
    """Return the pressure of a load over the angle of the lift table, as `read_pressure_curve` reads it."""
    order = design.order
    angle, pressure = design.theta[order] / DEGREE, design.solved[number].pressure[order] / BAR
    grid = np.arange(0.0, 360.0, PRESSURE_STEP_DEG)
    # the corners of the load as well, apart from grid points that would coincide with them
    corners, _ = design.lobe.crossings(design.loads[number].events)
    degrees = np.unique(np.round(np.concatenate([grid, corners / DEGREE]), 6))
    values = np.interp(degrees, angle, pressure, period=360.0)
    rows = "\n".join(f"{a:.6f},{p:.4f}" for a, p in zip(degrees, values, strict=True))
    return f"cam_angle_deg,pressure_bar\n{rows}\n"


def pump_text(design: Evaluated) -> str:
    """Return the pump file of a design, which `predict` runs."""
    pump, config = design.pump, design.config
    stated = {key.name: getattr(pump, key.attribute) for key in PUMP_TABLE.keys if key.used}
    columns = {"cam_table": TABLE, "cam_table_angle_column": "cam_angle_deg", "cam_table_lift_column": "lift_mm"}
    guide, bearing, pin = config.friction
    rows = {
        "pump": {"id": "design", **stated, **columns},
        "mounting": {"rotation": "positive" if config.rotation == 1 else "negative", "gravity_m_per_s2": config.gravity,
                     "spring_mass_kg": config.spring_mass, "guide_height_m": config.guide_height},
        "shaft": {"phases_deg": design.phases / DEGREE},
        "friction": {"guide": guide, "bearing_arm_um": 1e6 * bearing, "pin_arm_um": 1e6 * pin},
    }  # fmt: skip
    blocks = ['schema = "camtorque-pump/1"']
    for name, values in jsonable(rows).items():
        lines = [f"{key} = {toml_value(value)}" for key, value in values.items() if value is not None]
        blocks.append("\n".join([f"[{name}]", *lines]))
    return "\n\n".join(blocks) + "\n"


def write_chosen(design: Evaluated, folder: Path) -> list[dict[str, float]]:
    """Write lift table, pump file and pressure curves; return what `predict` makes of them, one row per load.

    Raises
    ------
    Refusal : the files cannot be read back, or a point of the table sticks out
    """
    (folder / TABLE).write_text(lift_table_text(design), encoding="utf-8")
    (folder / PUMP).write_text(pump_text(design), encoding="utf-8")
    config, _ = read_pump(folder / PUMP)
    if config.cam_table is not None and outlying_points(config.cam_table).size:
        raise Refusal(f"{folder / TABLE}: points of the lift table stick out; ask for a smoother lift law in [lift]")
    rows = []
    for k, load in enumerate(design.loads):
        name = f"pressure_{k + 1}.csv"
        (folder / name).write_text(pressure_text(design, k), encoding="utf-8")
        read = sweep_rows(predict(config, [load.speed], read_pressure_curve(folder / name)))[0]
        rows.append({"speed_rpm": read["speed_rpm"], "peak_torque_nm": read["shaft_torque_max_nm"],
                     "hertz_gpa": read["hertz_max_gpa"]})  # fmt: skip
    return rows


def answer_document(
    answer: Answer, read_back: list[dict[str, float]], fitted: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the answer as JSON-ready values (schema ``camtorque.design/1``); ``read_back`` is by `predict`."""
    task = answer.task
    return {
        "schema": "camtorque.design/1",
        "task": task.text,
        "aims": list(task.aims),
        "limits": [limit.text for limit in task.limits],
        "chosen": answer.front.chosen,
        "points": [point_document(point) for point in answer.front.points],
        "prices": [asdict(price) for price in answer.prices],
        "tolerances": {name: asdict(spread) for name, spread in answer.spreads.items()},
        "as_predict_reads_it": read_back,
        "as_fitted": list(fitted),
    }


def point_document(point: FrontPoint) -> dict[str, Any]:
    """Return one point: its law, its free quantities, coefficients of its flanks, every response."""
    design = point.design
    return {
        "law": design.family.name,
        "free": {variable.name: design.values[variable.name] for variable in point.problem.task.variables},
        "rise_coefficients": design.rise,
        "return_coefficients": design.fall,
        "responses": point.responses,
    }

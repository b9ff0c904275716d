"""The answer to a design task: the chosen cam as lift table and pump file, read back by `predict`, and the page.

The page shows the front as a chart whose points open their cam, without a script, and what was learned.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from camtorque.config.schemas import PUMP as PUMP_TABLE
from camtorque.design.explain import SEEN, Price, Spread, limit_words, plain_name, prices, spreads, unit_of
from camtorque.design.front import Front, FrontPoint, find_front
from camtorque.design.responses import RESPONSES, Evaluated, Solved
from camtorque.design.task import Task
from camtorque.ingest.cam_table import outlying_points
from camtorque.ingest.new_recording import toml_value
from camtorque.ingest.pump_file import read_pressure_curve, read_pump
from camtorque.jsonable import jsonable
from camtorque.mechanism.predict import predict, sweep_rows
from camtorque.progress import Progress
from camtorque.records import Array, Refusal
from camtorque.report.chart import CYCLE, Curves, Line, Panel, fill, stroke
from camtorque.report.charts_svg import curves_svg
from camtorque.report.forecast_page import TITLES, with_band
from camtorque.report.numbers import significant, with_sign
from camtorque.report.page import render
from camtorque.report.svg import Scale, drawing, line, padded, text, tick_texts, ticks
from camtorque.units import BAR, DEGREE, TURN

TABLE_STEP_DEG, TABLE_DECIMALS = 0.5, 5
PRESSURE_STEP_DEG = 0.25
PUMP, TABLE = "pump.toml", "cam.csv"
COLUMNS = {"cam_table_angle_column": "cam_angle_deg", "cam_table_lift_column": "lift_mm"}
"""Of the lift table."""


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
    head = f"# lift of the chosen design, resolution {10.0 ** (3 - TABLE_DECIMALS):g} um"
    return f"{head}\n{','.join(COLUMNS.values())}\n{rows}\n"


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
    guide, bearing, pin = config.friction
    rows = {
        "pump": {"id": "design", **stated, "cam_table": TABLE, **COLUMNS},
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


SIZE = (480.0, 340.0)
EDGES = (70.0, 14.0, 14.0, 46.0)
"""Left, right, top and bottom of the front's chart [px], which is read on a phone as well."""
FAR = 2.0
"""A first guess that is further from the front than so many times its width is not drawn."""
RARELY = 0.05
"""Share of made cams that may miss a limit before the headline says so."""


def law_name(name: str) -> str:
    """Return the name of a lift law as one would write it."""
    return {"bspline": "B-spline", "polynomial_345": "polynomial 3-4-5", "polynomial_4567": "polynomial 4-5-6-7"}.get(
        name, name.replace("_", " ")
    )


def label_of(name: str) -> str:
    """Return a response or quantity as words with its unit."""
    unit = unit_of(name)
    return f"{plain_name(name)} [{unit}]" if unit else plain_name(name)


def front_svg(front: Front, aims: tuple[str, ...], axes: tuple[int, int], before: Mapping[str, float]) -> str:
    """Return the front over two aims; every point is a link to its design, a ring shows the first guess."""
    across, up = axes
    x, y = (_values(front, aims[axis]) for axis in (across, up))
    (width, height), (left, right, top, bottom) = SIZE, EDGES
    first = (before[aims[across]], before[aims[up]])
    near = _near(first[0], x) and _near(first[1], y)
    horizontal = Scale(*padded([np.append(x, first[0] if near else x[0])]), left, width - right)
    vertical = Scale(*padded([np.append(y, first[1] if near else y[0])]), height - bottom, top)
    parts = _axes(horizontal, vertical, label_of(aims[across]), label_of(aims[up]))
    place = f'cx="{horizontal(first[0]):.1f}" cy="{vertical(first[1]):.1f}" r="5" fill="none" stroke-width="1.6"'
    parts += [f"<circle {place} {stroke('muted')}><title>first guess</title></circle>"] if near else []
    families = [point.problem.family.name for point in front.points]
    tones = dict(zip(dict.fromkeys(families), cycle(CYCLE), strict=False))
    for k, family in enumerate(families):
        tone, radius = ("bad", 6.5) if k == front.chosen else (tones[family], 4.5)
        hint = f"design {k + 1}: {label_of(aims[across])} {x[k]:.4g}, {label_of(aims[up])} {y[k]:.4g}"
        place = f'cx="{horizontal(x[k]):.1f}" cy="{vertical(y[k]):.1f}" r="{radius}"'
        parts.append(f'<a href="#d{k + 1}"><circle {place} {fill(tone)}><title>{hint}</title></circle></a>')
    label = f"Pareto front of {plain_name(aims[across])} and {plain_name(aims[up])}; each point is a link to its design"
    return drawing(width, height, label, parts, role="group")


def _values(front: Front, name: str) -> Array:
    return np.array([point.responses[name] for point in front.points])


def _near(guess: float, values: Array) -> bool:
    return bool(abs(guess - np.mean(values)) < FAR * np.ptp(values))


def _first_guess_words(answer: Answer, before: Mapping[str, float]) -> str:
    """Return where the charts show the first guess, and which limits it breaks: such a one may lie below the front."""
    far = [plain_name(name) for name in answer.task.aims if not _near(before[name], _values(answer.front, name))]
    broken = [plain_name(limit.response) for limit in answer.chosen.problem.limits
              if limit.missed_by(before[limit.response]) > SEEN * abs(limit.value)]  # fmt: skip
    seen = f"lies beyond the charts of {' and '.join(far)}" if far else "is the ring"
    return f"The first guess {seen}" + (f"; it breaks the limit of {' and '.join(broken)}." if broken else ".")


def _axes(across: Scale, up: Scale, below: str, beside: str) -> list[str]:
    places, levels = (tick_texts(ticks(scale.low, scale.high)) for scale in (across, up))
    parts = [line(across(v), up.start, across(v), up.stop, "grid") for v, _ in places]
    parts += [line(across.start, up(v), across.stop, up(v), "grid") for v, _ in levels]
    parts += [text(across(v), up.start + 17.0, words, "middle", "muted") for v, words in places]
    parts += [text(across.start - 6.0, up(v) + 4.0, words, "end", "muted") for v, words in levels]
    middle = 0.5 * (up.start + up.stop)
    parts.append(text(0.5 * (across.start + across.stop), up.start + 37.0, below, "middle"))
    parts.append(text(14.0, middle, beside, "middle", "ink", f'transform="rotate(-90 14 {middle:.1f})"'))
    return parts


def design_svg(point: FrontPoint, names: tuple[str, ...]) -> str:
    """Return lift, pressure angle, torque and stress of one design over cam angle; ``names`` of the loads."""
    design, grid = point.evaluated, np.linspace(0.0, TURN, 721)
    theta = design.theta[design.order]

    def on_grid(values: Array, lag: float = 0.0) -> Array:
        return np.interp(np.mod(grid - lag, TURN), theta, values[design.order], period=TURN)

    def a_line_a_load(values: Callable[[Solved], Array]) -> tuple[Line, ...]:
        loads = enumerate(zip(names, design.solved, strict=True))
        return tuple(Line(name, values(solved), CYCLE[k % len(CYCLE)]) for k, (name, solved) in loads)

    torque = a_line_a_load(lambda s: np.sum([on_grid(s.outputs["torque"], lag) for lag in design.phases], axis=0))
    hertz = a_line_a_load(lambda s: on_grid(1e-9 * s.hertz))
    steep = np.arctan(design.path[1]) / DEGREE
    panels = (
        Panel("lift [mm]", (Line("lift", on_grid(1e3 * design.lift[0]), "c2"),), height=90.0),
        Panel("pressure angle [deg]", (Line("pressure angle", on_grid(steep), "c6"),), height=90.0),
        Panel("torque of all pumps [N m]", torque, height=150.0),
        Panel("Hertz pressure [GPa]", hertz, height=110.0),
    )
    return curves_svg(
        Curves(grid / DEGREE, "cam angle from the start of the rise [deg]", panels, width=SIZE[0]), "one design"
    )


FITTED = ("torque_max_nm", "torque_min_nm", "torque_mean_nm", "chamber_peak_bar", "delivered_mm3", "hertz_max_gpa")
"""Rows of the fitted model that are shown, by the names of the prediction page."""


def fitted_cells(row: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return name, value of the fitted pump and of the design by the fitted model, each with its 95 % interval."""
    return [(TITLES[key], with_band(row["fitted_pump"][key]), with_band(row["design"][key])) for key in FITTED]


def design_page(answer: Answer, read_back: list[dict[str, float]], fitted: Sequence[Mapping[str, Any]]) -> str:
    """Return the page as HTML; ``fitted`` is what the fitted model makes of pump and design under each load."""
    task, front = answer.task, answer.front
    pairs = [(a, b) for b in range(1, len(task.aims)) for a in range(b)]
    loads = tuple(load.name for load in task.loads)
    designs = [_design(k, point, loads) for k, point in enumerate(front.points)]
    before = first_guess(answer)
    return render(
        "design.html", title=f"{task.path.stem}: design", aims=[label_of(name) for name in task.aims],
        fronts=[Markup(front_svg(front, task.aims, (a, b), before)) for a, b in pairs],
        designs=designs, chosen=front.chosen + 1,
        families=[law_name(f.name) for f in task.families],
        gains="; ".join(_gain(n, answer.chosen.responses[n], before[n]) for n in task.aims),
        targets=_targets(answer, before),
        missed=_most_missed(answer), first_guess=_first_guess_words(answer, before),
        prices=[(p.what, p.unit, [p.per_aim.get(name) for name in task.aims]) for p in answer.prices],
        spreads=[(label_of(name), spread) for name, spread in answer.spreads.items()],
        fitted=[(row["load"], fitted_cells(row)) for row in fitted],
        samples=task.tolerances["samples"], read_back=read_back, config_text=task.text,
    )  # fmt: skip


def _gain(name: str, after: float, before: float) -> str:
    change = f", {with_sign(100.0 * (after / before - 1.0), 1)} %" if before else ""
    return f"{plain_name(name)} {significant(after, 4)} {unit_of(name)} (first guess {significant(before, 4)}{change})"


def _targets(answer: Answer, before: Mapping[str, float]) -> list[tuple[str, float, float, str]]:
    """Return every aim and limited response: name, first guess, design, and what was asked."""
    problem, after = answer.chosen.problem, answer.chosen.responses
    asked = dict.fromkeys(problem.task.aims, "aim")
    for limit in problem.limits:
        text = limit_words(limit).removeprefix(f"{plain_name(limit.response)} ")
        text += "" if limit in problem.task.limits else ", as every cam"
        asked[limit.response] = f"{asked[limit.response]}, {text}" if limit.response in asked else text
    return [(label_of(name), before[name], after[name], text) for name, text in asked.items()]


def _most_missed(answer: Answer) -> str:
    """Return which limit the tolerances of the shop miss most often, in words, empty where they keep all."""
    rows = [(name, row.missed) for name, row in answer.spreads.items() if (row.missed or 0.0) > RARELY]
    if not rows:
        return ""
    named = ", ".join(f"{plain_name(name)} ({100.0 * (share or 0.0):.0f} %)" for name, share in rows)
    return (
        f"Made within the tolerances, many cams miss a limit by more than 0.1 % of it: {named}. Set these limits "
        "tighter than needed, or ask for closer tolerances."
    )


def first_guess(answer: Answer) -> dict[str, float]:
    """Return every aim and limit of the first guess: the pump file within the bounds."""
    problem = answer.chosen.problem
    return {name: RESPONSES[name].value(problem.first_guess) for name in problem.names}


def _design(number: int, point: FrontPoint, loads: tuple[str, ...]) -> dict[str, Any]:
    values = point.design.values
    return {
        "number": number + 1, "law": law_name(point.design.family.name),
        "free": [(label_of(v.name), values[v.name]) for v in point.problem.task.variables],
        "responses": [(label_of(name), value) for name, value in point.responses.items()],
        "svg": Markup(design_svg(point, loads)),
    }  # fmt: skip

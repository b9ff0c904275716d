"""The page and the document of runs predicted with the values of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.fit.endings import holding
from camtorque.fit.forecast import Forecast
from camtorque.fit.uncertainty import COVERAGE
from camtorque.jsonable import jsonable, now
from camtorque.records import Array, Forces
from camtorque.report.chart import CAM_ANGLE, CYCLE, Band, Curves, Line, Panel
from camtorque.report.files import write_json, write_page
from camtorque.report.forecast_texts import ENDED_BY, ending_text, flight_text, step_text
from camtorque.report.numbers import UNKNOWN, plus_minus, rounded_to_error, significant, words
from camtorque.report.page import Drawing, drawing_of, render
from camtorque.units import BAR, DEGREE, RPM
from camtorque.version import __version__

SCHEMA = "camtorque.predict_from/1"
KEPT = 600
PRESSURE = "pressure"
"""Cause that dwarfs the others; it is drawn with the torque."""
SAME_SPEED = 0.02
"""Distance in ln speed that is still a fitted speed."""
TITLES = {
    "speed_rpm": "speed [rpm]", "torque_max_nm": "torque, largest [N m]", "torque_min_nm": "torque, smallest [N m]",
    "torque_mean_nm": "torque, mean [N m]", "chamber_peak_bar": "chamber pressure, largest [bar]",
    "delivered_mm3": "volume delivered in a stroke [mm³]", "contact_max_n": "contact force, largest [N]",
    "contact_min_n": "contact force, smallest; below 0 the cam pulls [N]",
    "hertz_max_gpa": "Hertz pressure, largest [GPa]",
    "law_error_percent": "error of the model in these bands [% of the peak torque, standard deviation]",
}  # fmt: skip
"""Key of a row of the sweep -> what the page calls it."""


def sweep_row(item: Forecast, forces: Sequence[Forces]) -> dict[str, Any]:
    """Return the extremes of one speed, each with its standard uncertainty.

    Parameters
    ----------
    forces : of the run, or of both where nobody knows how delivery ends
    """
    rows = [_extremes(one, force) for one, force in zip(item.both or (item,), forces, strict=True)]
    causes = {name: float(np.mean(values)) for name, values in item.by_cause.items()}
    other = item.other
    return {
        "speed_rpm": item.speed / RPM,
        **{name: _value(*(holding(*value, *rows[-1][name]))) for name, value in rows[0].items()},
        "law_error_percent": 100.0 * item.law_share, "beyond_fitted_speeds": item.beyond > SAME_SPEED,
        "contact_lost": item.take_off is not None,
        "model_steps": item.steps, "ending": item.ending, "other_ending": None if other is None else {
            "ending": other.structure, "torque_difference_nm": other.difference, "theta_deg": other.angle / DEGREE,
        },
        "mean_by_cause_nm": causes,
    }  # fmt: skip


def _extremes(item: Forecast, forces: Forces) -> dict[str, tuple[float, float]]:
    """Return the extremes of a run, each with its standard uncertainty."""
    top, low = int(np.argmax(item.torque)), int(np.argmin(item.torque))
    peak, load, least = int(np.argmax(item.pressure)), int(np.argmax(item.contact)), int(np.argmin(item.contact))
    hertz = float(np.nanmax(forces.hertz)) / 1e9
    scale = np.nan if item.ending == "line" else 1e9  # without a chamber nothing tells what leaves it
    relative = float(item.contact_std[load] / max(abs(item.contact[load]), 1e-9))
    return {
        "torque_max_nm": (item.torque[top], item.torque_std[top]),
        "torque_min_nm": (item.torque[low], item.torque_std[low]),
        "torque_mean_nm": (float(np.mean(item.torque)), item.mean_std),
        "chamber_peak_bar": (item.pressure[peak] / BAR, item.pressure_std[peak] / BAR),
        "delivered_mm3": (scale * item.delivered, scale * item.delivered_std),
        "contact_max_n": (item.contact[load], item.contact_std[load]),
        "contact_min_n": (item.contact[least], item.contact_std[least]),
        "hertz_max_gpa": (hertz, 0.5 * relative * hertz),
    }


def _value(value: Array | float, std: Array | float) -> dict[str, Any]:
    return {
        "value": float(value),
        "stderr": float(std),
        "ci95": [float(value - COVERAGE * std), float(value + COVERAGE * std)],
    }


def assumed_of(items: Sequence[Forecast]) -> list[str]:
    """Return what was assumed, each sentence once, in the order of the runs."""
    return list(dict.fromkeys(text for item in items for text in item.assumed))


def forecast_document(
    items: Sequence[Forecast], forces: Sequence[Sequence[Forces]], source: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the predicted runs as JSON-ready values in border units.

    Parameters
    ----------
    forces : of each run, of both where nobody knows how its delivery ends
    source : where the values come from: ``fit``, ``recordings``, ``inputs``
    """
    return jsonable({
        "schema": SCHEMA, "version": __version__, "created": now(), **source,
        "assumed": assumed_of(items),
        "sweep": [sweep_row(item, force) for item, force in zip(items, forces, strict=True)],
        "curves": [
            {
                "theta_deg": _thin(item.theta / DEGREE), "torque_nm": _thin(item.torque),
                "torque_stderr_nm": _thin(item.torque_std), "shape_stderr_nm": _thin(item.shape_std),
                "pressure_bar": _thin(item.pressure / BAR),
                "pressure_stderr_bar": _thin(item.pressure_std / BAR), "contact_n": _thin(item.contact),
                "contact_stderr_n": _thin(item.contact_std),
                "by_cause_nm": {name: _thin(values) for name, values in item.by_cause.items()},
                "by_cause_stderr_nm": {name: _thin(values) for name, values in item.by_cause_std.items()},
            }
            for item in items
        ],
    })  # fmt: skip


def _thin(values: Array) -> Array:
    return values[:: max(1, values.size // KEPT)]


def write_forecast(items: Sequence[Forecast], document: Mapping[str, Any], title: str, folder: Path) -> None:
    """Write predict.json and predict.html of predicted runs into an existing folder."""
    drawings = [_drawing(f"speed_{k + 1}", item) for k, item in enumerate(items)]
    rows = document["sweep"]
    beyond = [f"{row['speed_rpm']:.0f}" for row in rows if row["beyond_fitted_speeds"]]
    peaks = "; ".join(
        f"{with_band(row['torque_max_nm'])} N m at {significant(row['speed_rpm'], 4)} rpm" for row in rows
    )
    answer = f"{peaks}."
    if beyond:
        answer += (
            f" {' and '.join(beyond)} rpm {'lie' if len(beyond) > 1 else 'lies'} beyond the fitted speeds: the bands "
            "are wider there, and a recording near that speed would narrow them."
        )
    unsure = [text for item in items for text in (*flight_text(item), *step_text(item), *ending_text(item))]
    answer = " ".join((answer, *dict.fromkeys(unsure)))
    html = render(
        "forecast.html", drawings, title=title, answer=answer,
        look=bool(beyond or unsure), assumed=document["assumed"],
        sweep=[(TITLES[key], [_cell(row[key]) for row in rows]) for key in TITLES],
    )  # fmt: skip
    write_page(folder / "predict.html", html)
    write_json(folder / "predict.json", document)


def with_band(estimate: Mapping[str, Any]) -> str:
    """Return a value with half the width of its 95 % interval, as many decimals as that has; one that nobody knows."""
    if estimate["value"] is None or np.isnan(estimate["value"]):
        return UNKNOWN
    half = COVERAGE * estimate["stderr"]
    return f"{rounded_to_error(estimate['value'], half)} ± {plus_minus(half)}"


def _cell(value: Any) -> str:
    return with_band(value) if isinstance(value, Mapping) else significant(value)


def _drawing(name: str, item: Forecast) -> Drawing:
    def panel(title: str, label: str, values: Array, std: Array, height: float) -> Panel:
        band = Band("95 % band", values - COVERAGE * std, values + COVERAGE * std, "chamber")
        return Panel(title, (Line(label, values, "fitted", 1.6),), (band,), height)

    causes = tuple(
        Line(words(cause), values, CYCLE[k % len(CYCLE)], 1.2)
        for k, (cause, values) in enumerate(item.by_cause.items())
        if cause != PRESSURE and np.any(np.abs(values) > 1e-9)
    )  # fmt: skip
    torque = panel("torque [N m]", "torque", item.torque, item.torque_std, 200.0)
    pressure = Line("of it by pressure", item.by_cause[PRESSURE], "c1", 1.2, "6 4")
    both = tuple(
        Line(f"if {ENDED_BY[one.ending]} ends delivery", one.torque, tone, 1.2)
        for one, tone in zip(item.both, CYCLE[2:], strict=False)
    )
    panels = (
        replace(torque, lines=(*torque.lines, *both, pressure)),
        Panel("other causes [N m]", causes, height=140.0),
        panel("chamber [bar]", "pressure on the plunger", item.pressure / BAR, item.pressure_std / BAR, 120.0),
    )
    return drawing_of(
        name, Curves(item.theta / DEGREE, CAM_ANGLE, panels), f"Torque at {significant(item.speed / RPM, 4)} rpm"
    )

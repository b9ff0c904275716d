"""Many reports -> one table over date, speed, load and temperature."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from camtorque.export import safe_text
from camtorque.records import UNTOLD

AXES = {
    "date": "date",
    "speed_rpm": "speed / rpm",
    "line_pressure_peak_bar": "peak line pressure / bar",
    "fuel_temperature_c": "fuel temperature / °C",
}
"""Column -> label of what a trend is drawn over."""


def trend_table(documents: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    """Return one row per report (folder -> result.json): conditions, metrics, chamber, losses, parameters."""
    rows = [{"report": safe_text(name), **_row(document)} for name, document in documents.items()]
    table = pd.DataFrame(rows)
    return table.sort_values(["date", "speed_rpm"], kind="stable", na_position="last", ignore_index=True)


def _row(document: Mapping[str, Any]) -> dict[str, Any]:
    recording, held = document["recording"], document["metrics"]["fitted_held_out_cycles"]
    explained = bool(document["explained"])
    row: dict[str, Any] = {
        "recording": safe_text(recording["name"]),
        "explained": explained,
        "pump": safe_text(recording.get("pump") or ""),
        **{name: recording.get(name) for name in AXES},
        "cycles_used": recording["cycles_used"],
        "fitted_rms_percent": held["rms_percent_of_peak"],
        "rigid_rms_percent": document["metrics"]["rigid"]["rms_percent_of_peak"],
        "trigger_angle_deg": document["alignment"]["trigger_angle_deg"]["value"],
    }
    peak = (document["chamber"] or {}).get("peak_bar") or {}
    row |= {"chamber_peak_bar": peak.get("value"), "chamber_peak_bar_stderr": peak.get("stderr") if explained else None}
    losses = {name: value for name, value in document["losses"].items() if name != "unit"}
    row |= {f"loss_{name}" + ("" if name.endswith("percent") else "_j"): value for name, value in losses.items()}
    for name, estimate in document["parameters"].items():
        row |= {name: estimate["value"], f"{name}_stderr": estimate["stderr"] if explained else None}
    return row


def informed_parameters(documents: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Return parameter -> label of those shared ones that at least one report measured or narrowed."""
    found = {}
    for document in documents.values():
        for name, row in document["parameters"].items() if document["explained"] else ():
            if _informed(row) and row.get("role") == "shared":
                found[name] = f"{name.replace('_', ' ')} / {row['unit']}"
    return found


def _informed(row: Mapping[str, Any]) -> bool:
    return row.get("knowledge", UNTOLD[0]) not in UNTOLD


def drawn_table(table: pd.DataFrame, documents: Mapping[str, Mapping[str, Any]], names: Iterable[str]) -> pd.DataFrame:
    """Return what a figure shows of a trend: parameters where they are measured or narrowed, bars within the interval.

    A bar of ``NAME`` goes ``NAME_down`` down and ``NAME_up`` up: an interval ends at the bounds of its parameter, one
    standard error may reach beyond them.
    """
    drawn = table.copy()
    reports = {safe_text(folder): document for folder, document in documents.items()}
    for name in names:
        rows = [reports[report]["parameters"].get(name) for report in table["report"]]
        told = [
            row if row and sure and _informed(row) else {} for row, sure in zip(rows, table["explained"], strict=True)
        ]
        drawn[name] = np.array([row.get("value", np.nan) for row in told], dtype=np.float64)
        for k, end in enumerate(("down", "up")):
            bars = [min(row["stderr"], abs(row["ci95"][k] - row["value"])) if row else np.nan for row in told]
            drawn[f"{name}_{end}"] = np.array(bars, dtype=np.float64)
    return drawn

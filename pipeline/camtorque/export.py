"""Finished reports -> tables for other programs (CSV, Excel, MATLAB, Parquet), each by itself or a row each of a trend.

Numbers in border units, named by the end of the column. A text that a spreadsheet would take for a formula gets an
apostrophe in front: names and notes come from files of strangers.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
from scipy.io import savemat

from camtorque.records import UNTOLD, Array, Refusal
from camtorque.report.numbers import unit_text, words
from camtorque.units import BAR, DEGREE, RPM

BORDER = {
    "rad": ("deg", 1.0 / DEGREE),
    "rad/s": ("rpm", 1.0 / RPM),
    "Pa": ("bar", 1.0 / BAR),
    "N m": ("nm", 1.0),
    "N": ("n", 1.0),
    "m3": ("mm3", 1.0e9),
    "m": ("mm", 1.0e3),
    "m/rad": ("mm_per_rad", 1.0e3),
    "1": ("", 1.0),
}
"""Unit in cycles.h5 -> end of the column's name and factor."""
VALUE_KEYS = ("value", "unit", "stderr", "stderr_statistical")
PARAMETER_KEYS = (*VALUE_KEYS, "knowledge", "role", "at_bound", "identifiable", "meaning")
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
UNSAFE = re.compile(r"\W+")
SHEET_COLUMNS = 16384
"""Columns of an Excel sheet."""
Tables = Mapping[str, pd.DataFrame]


def report_tables(folder: Path, document: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """Return the tables of a report: cycles.h5 in ``folder``, and the content of its result.json.

    They are ``torque``, ``pressure`` and further channels (one row per angle, one column per cycle), ``cycles`` (one
    row per cycle), ``means`` (one row per angle: measured, models, causes, forces), ``parameters``, ``findings``.

    Raises
    ------
    Refusal : there is no cycles.h5
    """
    path = folder / "cycles.h5"
    if not path.is_file():
        raise Refusal(f"{path}: no such file; expected it beside result.json, make the report again")
    with h5py.File(path) as file:
        index = file["cycles/index"][:]
        angle = file["theta"][:] / DEGREE
        recorded = [name for name, data in file["cycles"].items() if data.ndim == 2]
        tables = {name: _over_cycles(file[f"cycles/{name}"], angle, index) for name in recorded}
        tables |= {"cycles": _per_cycle(file, index), "means": _means(file, angle)}
    explained = bool(document["explained"])
    tables["parameters"] = pd.DataFrame(
        [_parameter(name, row, explained) for name, row in document["parameters"].items()]
    )
    tables["findings"] = pd.DataFrame(document["findings"], columns=["severity", "code", "text", "where"])
    return {name: _safe(table) for name, table in tables.items()}


def _parameter(name: str, row: Mapping[str, Any], explained: bool) -> dict[str, Any]:
    """Return a parameter without its uncertainty where the model does not explain the recording."""
    low, high = row["ci95"] if explained else (None, None)
    unsure = {} if explained else {"stderr": None, "stderr_statistical": None}
    values = {key: row.get(key) for key in PARAMETER_KEYS}
    return {"name": name, **values, **unsure, "low95": low, "high95": high, "explained": explained}


def _border(data: h5py.Dataset) -> tuple[str, float]:
    """Return the end of a column's name and the factor to its unit; a unit without a border unit stays."""
    unit = data.attrs["units"]
    return BORDER.get(unit, (UNSAFE.sub("_", unit), 1.0))


def _over_cycles(data: h5py.Dataset, angle: Array, index: Array) -> pd.DataFrame:
    suffix, factor = _border(data)
    quantity = data.name.rpartition("/")[2]
    columns = {f"{quantity}_{number}_{suffix}": row for number, row in zip(index, factor * data[:], strict=True)}
    return pd.DataFrame({"cam_angle_deg": angle, **columns})


def _per_cycle(file: h5py.File, index: Array) -> pd.DataFrame:
    columns: dict[str, Any] = {"cycle": index, "role": [text.decode() for text in file["cycles/role"][:]]}
    for name, data in file["cycles"].items():
        if data.ndim == 1 and data.dtype.kind == "f":
            suffix, factor = _border(data)
            columns[f"{name}_{suffix}"] = factor * data[:]
    return pd.DataFrame(columns)


def _means(file: h5py.File, angle: Array) -> pd.DataFrame:
    columns = {"cam_angle_deg": angle}

    def visit(path: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.shape == angle.shape and not path.startswith(("theta", "cycles")):
            suffix, factor = _border(item)
            columns[f"{path.replace('/', '_')}_{suffix}".rstrip("_")] = factor * item[:]

    file.visititems(visit)
    return pd.DataFrame(columns)


def _safe(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table without a text that a spreadsheet runs; a lone sign, such as the unit "-", is none."""
    changed = {
        name: [safe_text(item) if isinstance(item, str) else item for item in table[name]]
        for name in table.columns
        if table[name].dtype.kind not in "fiub"
    }
    return table.assign(**changed).rename(columns=safe_text)


def safe_text(text: str) -> str:
    """Return a text that no spreadsheet takes for a formula."""
    return f"'{text}" if len(text) > 1 and text.startswith(FORMULA) else text


def _a_file_each(tables: Tables, stem: Path, suffix: str, **how: Any) -> list[Path]:
    paths = {name: stem.with_name(f"{stem.name}_{name}.{suffix}") for name in tables}
    for name, table in tables.items():
        getattr(table, f"to_{suffix}")(paths[name], index=False, **how)
    return list(paths.values())


def _write_xlsx(tables: Tables, stem: Path) -> list[Path]:
    """Write one workbook, a sheet per table, row by row: a recording of cycles is too much to be held as cells."""
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    for name, table in tables.items():
        if table.shape[1] > SHEET_COLUMNS:
            found = f"--format xlsx: {name} has {table.shape[1]} columns"
            raise Refusal(f"{found}, a sheet holds {SHEET_COLUMNS}; take csv, mat or parquet")
        sheet = book.create_sheet(name)
        sheet.append(list(table.columns))
        for row in table.astype(object).where(table.notna(), None).itertuples(index=False, name=None):
            sheet.append(row)
    path = stem.with_name(f"{stem.name}.xlsx")
    book.save(path)
    return [path]


def _write_mat(tables: Tables, stem: Path) -> list[Path]:
    content = {name: {column: _column(table[column]) for column in table.columns} for name, table in tables.items()}
    path = stem.with_name(f"{stem.name}.mat")
    savemat(path, content, do_compression=True, long_field_names=True, appendmat=False)
    return [path]


def _column(values: pd.Series) -> Any:
    return values.to_numpy() if values.dtype.kind in "fiub" else np.array(values.fillna("").tolist(), dtype=object)


FORMATS: dict[str, Callable[[Tables, Path], list[Path]]] = {
    "csv": partial(_a_file_each, suffix="csv", lineterminator="\n", float_format="%.9g"),
    "xlsx": _write_xlsx,
    "mat": _write_mat,
    "parquet": partial(_a_file_each, suffix="parquet"),
}
"""Format -> its writer: tables into an existing folder, to files that begin with a stem; their paths."""


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
        "verdict": document.get("verdict", {}).get("head"),
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
                found[name] = " / ".join(filter(None, (words(name), unit_text(row["unit"]))))
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

"""A pump without a recording: its TOML file, its lift table and a pressure curve, checked, in SI and radians.

The ``[pump]`` table is that of a bench recording; ``[cam]``, ``[mounting]`` and ``[shaft]`` are the product's own, so
an unknown key there is refused. Documented in docs/predict.md.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.config import PumpData
from pipeline.records import Array, CamTable, Refusal, freeze_arrays
from pipeline.units import BAR, DEGREE

SCHEMA = "camtorque-pump/1"
REQUIRED = {
    "base_circle_radius_m": "base_circle_radius",
    "roller_radius_m": "roller_radius",
    "roller_width_m": "roller_width",
    "cam_mass_kg": "cam_mass",
    "cam_inertia_kg_m2": "cam_inertia",
    "follower_mass_kg": "follower_mass",
    "spring_stiffness_N_per_m": "spring_stiffness",
    "spring_preload_N": "spring_preload",
    "plunger_diameter_m": "plunger_diameter",
    "youngs_modulus_cam_Pa": "youngs_modulus_cam",
    "youngs_modulus_roller_Pa": "youngs_modulus_roller",
}
OPTIONAL = {
    "follower_offset_m": "follower_offset",
    "poisson_ratio": "poisson_ratio",
    "roller_mass_kg": "roller_mass",
    "roller_inertia_kg_m2": "roller_inertia",
}
TABLE_KEYS = ("cam_table", "cam_table_angle_column", "cam_table_lift_column", "cam_table_resolution_m")
NOTES = ("id", "follower_mass_note", "note")
MAY_BE_ZERO = {
    "follower_offset_m",
    "spring_stiffness_N_per_m",
    "spring_preload_N",
    "roller_mass_kg",
    "roller_inertia_kg_m2",
}
MAY_BE_NEGATIVE = {"follower_offset_m"}
TABLES: dict[str, tuple[str, ...]] = {
    "": ("schema", "pump", "cam", "mounting", "shaft"),
    "pump": (*REQUIRED, *OPTIONAL, *TABLE_KEYS, *NOTES),
    "cam": ("sections", "start_deg"),
    "cam.sections": ("kind", "angle_deg", "rise_mm", "nose_radius_mm"),
    "mounting": ("rotation", "gravity_m_per_s2", "spring_mass_kg", "guide_height_m"),
    "shaft": ("phases_deg", "stiffness_N_m_per_rad", "damping_N_m_s_per_rad"),
}
ROTATIONS = {"positive": 1, "negative": -1}
LENGTHS = {"nm": 1e-9, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "m": 1.0}


@dataclass(frozen=True)
class SectionSpec:
    """One section of a cam: kind, angle [rad], rise [m] (negative on the return), nose radius of a tangent lobe [m]."""

    kind: str
    angle: float
    rise: float
    nose_radius: float = 0.0


@dataclass(frozen=True)
class PumpConfig:
    """A pump file, checked.

    Attributes
    ----------
    cam_table : lift table, or None where the cam is given by ``sections``
    sections, sections_start : the cam as sections, from this angle [rad]
    rotation, gravity, spring_mass, guide_height : see `pipeline.mechanism.mounting.Mounting`
    phases : lag of each pump's lobe on the shaft [rad]
    shaft_stiffness, shaft_damping : of each piece of shaft between lobes [N m/rad, N m s/rad]; inf for a rigid shaft
    """

    path: Path
    text: str
    pump: PumpData
    cam_table: CamTable | None
    sections: tuple[SectionSpec, ...]
    sections_start: float
    rotation: int
    gravity: tuple[float, float]
    spring_mass: float
    guide_height: float | None
    phases: tuple[float, ...]
    shaft_stiffness: float
    shaft_damping: float


@dataclass(frozen=True)
class PressureCurve:
    """Pressure on the plunger over one revolution: theta (n,) increasing [rad], pressure (n,) gauge [Pa]."""

    theta: Array
    pressure: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)


def load_pump_config(path: Path | str) -> PumpConfig:
    """Return the checked content of a pump file.

    Raises
    ------
    Refusal : missing file or key, unknown key, a value that is not a number or out of its range, no cam
    """
    path = Path(path)
    text = _read_text(path, "pump file")
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise Refusal(f"{path}: not valid TOML ({error}); correct the file") from error
    _known_keys(path, "", document)
    for name in ("pump", "cam", "mounting", "shaft"):
        _known_keys(path, name, document.get(name, {}))
    if document.get("schema") != SCHEMA:
        raise Refusal(f"{path}: schema is {document.get('schema')!r}, expected {SCHEMA!r}; state it at the top")
    pump = document.get("pump", {})
    cam = document.get("cam", {})
    table = _cam_table(path, pump)
    sections = tuple(_section(path, i, entry) for i, entry in enumerate(cam.get("sections", [])))
    if (table is None) == (not sections):
        raise Refusal(f"{path}: expected either pump.cam_table or cam.sections; give one of them")
    return PumpConfig(
        path=path,
        text=text,
        pump=_pump_data(path, pump),
        cam_table=table,
        sections=sections,
        sections_start=_number(path, "cam.start_deg", cam.get("start_deg", 0.0)) * DEGREE,
        **_mounting(path, document.get("mounting", {})),
        **_shaft(path, document.get("shaft", {})),
    )


def _read_text(path: Path, what: str) -> str:
    """Return the text of a file, UTF-8 or else cp1252."""
    if not path.is_file():
        raise Refusal(f"{path}: no such file, expected a {what}; check the path")
    raw = path.read_bytes()
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def _known_keys(path: Path, table: str, content: Any) -> None:
    """Refuse a key that the table does not have."""
    if not isinstance(content, Mapping):
        raise Refusal(f"{path}: {table} is {content!r}, expected a table [{table}]")
    for key in content:
        if key not in TABLES[table]:
            near = difflib.get_close_matches(key, TABLES[table], n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"expected one of {', '.join(TABLES[table])}"
            raise Refusal(f"{path}: unknown key {key!r} in [{table or 'top level'}]; {hint}")


def _number(path: Path, key: str, value: Any) -> float:
    """Return a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise Refusal(f"{path}: {key} is {value!r}, expected a finite number; correct it")
    return float(value)


def _pump_data(path: Path, content: Mapping[str, Any]) -> PumpData:
    """Return the catalogue values of [pump]."""
    missing = [key for key in REQUIRED if key not in content]
    if missing:
        raise Refusal(f"{path}: [pump] lacks {', '.join(missing)}; add them from the sheet")
    values: dict[str, float | None] = {"follower_offset": 0.0}
    for key, name in {**REQUIRED, **OPTIONAL}.items():
        if key not in content:
            continue
        value = _number(path, f"pump.{key}", content[key])
        least_allowed = -np.inf if key in MAY_BE_NEGATIVE else 0.0
        if value < least_allowed or (value == 0.0 and key not in MAY_BE_ZERO):
            raise Refusal(f"{path}: pump.{key} is {value}, expected a positive value; correct it")
        values[name] = value
    return PumpData(
        **values,  # type: ignore[arg-type]
        cam_table_path=path.parent / str(content.get("cam_table", "")),
        cam_table_angle_column=str(content.get("cam_table_angle_column", "")),
        cam_table_lift_column=str(content.get("cam_table_lift_column", "")),
    )


def _cam_table(path: Path, content: Mapping[str, Any]) -> CamTable | None:
    """Return the lift table that [pump] names, or None."""
    if "cam_table" not in content:
        return None
    for key in ("cam_table_angle_column", "cam_table_lift_column"):
        if key not in content:
            raise Refusal(f"{path}: [pump] names a cam_table but no {key}; add the name of the column")
    resolution = content.get("cam_table_resolution_m")
    return read_lift_table(
        path.parent / str(content["cam_table"]),
        str(content["cam_table_angle_column"]),
        str(content["cam_table_lift_column"]),
        None if resolution is None else _number(path, "pump.cam_table_resolution_m", resolution),
    )


def read_lift_table(path: Path, angle_column: str, lift_column: str, resolution: float | None = None) -> CamTable:
    """Return a lift table from a CSV file whose column names end in their unit (``_deg``, ``_mm``, ``_m``).

    The resolution is, in this order: the argument [m], a comment such as ``resolution 1 um``, the printed decimals.

    Raises
    ------
    Refusal : missing file or column, a column without unit, values that are no numbers, angles out of order
    """
    text = _read_text(path, "lift table")
    frame = _columns(path, text, (angle_column, lift_column))
    if not angle_column.endswith("_deg"):
        raise Refusal(f"{path}: column {angle_column!r} states no unit, expected a name that ends in _deg")
    unit = lift_column.rsplit("_", 1)[-1]
    if unit not in LENGTHS:
        raise Refusal(f"{path}: column {lift_column!r} states no unit, expected a name that ends in _mm, _um or _m")
    angle, lift = (_values(path, frame, name) for name in (angle_column, lift_column))
    step = resolution or _stated_resolution(text) or _printed_step(frame[lift_column]) * LENGTHS[unit]
    if angle.size > 1 and abs(angle[-1] - angle[0] - 360.0) < 1e-9:
        angle, lift = angle[:-1], lift[:-1]
    if angle.size < 2 or not np.all(np.diff(angle) > 0.0) or angle[-1] - angle[0] >= 360.0:
        raise Refusal(
            f"{path}: {angle_column} has to increase strictly within one revolution; sort or complete the table"
        )
    return CamTable(angle * DEGREE, lift * LENGTHS[unit], step)


def _columns(path: Path, text: str, names: tuple[str, ...]) -> pd.DataFrame:
    """Return the named columns as text; comma or semicolon, comment lines start with #."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    separator = ";" if lines and ";" in lines[0] else ","
    rows = [[cell.strip() for cell in line.split(separator)] for line in lines]
    header = rows[0] if rows else []
    for name in names:
        if name not in header:
            raise Refusal(f"{path}: no column {name!r}, found {', '.join(header) or 'nothing'}; name one of them")
    short = next((i for i, row in enumerate(rows) if len(row) != len(header)), None)
    if short is not None:
        raise Refusal(f"{path}: row {short} has {len(rows[short])} cells, expected {len(header)}; complete the row")
    return pd.DataFrame(rows[1:], columns=header)[list(names)]


def _values(path: Path, frame: pd.DataFrame, name: str) -> Array:
    """Return a column as finite numbers; a decimal comma is read as such."""
    cells = frame[name].str.replace(",", ".", regex=False)
    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=np.float64)
    if not np.all(np.isfinite(values)):
        row = int(np.flatnonzero(~np.isfinite(values))[0])
        raise Refusal(
            f"{path}: {name} in data row {row + 1} is {frame[name].iloc[row]!r}, expected a number; correct it"
        )
    return values


def _stated_resolution(text: str) -> float | None:
    """Return the resolution that a comment line states [m], or None."""
    comments = " ".join(line for line in text.splitlines() if line.lstrip().startswith("#"))
    found = re.search(r"resolution\s*[:=]?\s*([0-9.]+)\s*(nm|um|µm|μm|mm)\b", comments)
    return float(found[1]) * LENGTHS[found[2]] if found else None


def _printed_step(cells: pd.Series) -> float:
    """Return the step of the last printed decimal of a column."""
    decimals = cells.str.replace(",", ".", regex=False).str.extract(r"\.(\d*)$")[0].fillna("").str.len()
    return float(10.0 ** -int(decimals.max()))


def _section(path: Path, index: int, entry: Any) -> SectionSpec:
    """Return one entry of cam.sections."""
    _known_keys(path, "cam.sections", entry)
    where = f"cam.sections[{index}]"
    kind = entry.get("kind")
    if not isinstance(kind, str):
        raise Refusal(f"{path}: {where} has kind {kind!r}, expected its name, such as 'dwell'; add it")
    scale = {"angle_deg": DEGREE, "rise_mm": 1e-3, "nose_radius_mm": 1e-3}
    values = {key: _number(path, f"{where}.{key}", entry.get(key, 0.0)) * factor for key, factor in scale.items()}
    return SectionSpec(kind, values["angle_deg"], values["rise_mm"], values["nose_radius_mm"])


def _mounting(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of [mounting]."""
    rotation = content.get("rotation", "positive")
    if rotation not in ROTATIONS:
        raise Refusal(f"{path}: mounting.rotation is {rotation!r}, expected 'positive' or 'negative'; correct it")
    gravity = content.get("gravity_m_per_s2", [0.0, 0.0])
    if not isinstance(gravity, list) or len(gravity) != 2:
        raise Refusal(f"{path}: mounting.gravity_m_per_s2 is {gravity!r}, expected two numbers along X1 and Y1")
    height = content.get("guide_height_m")
    spring_mass = _number(path, "mounting.spring_mass_kg", content.get("spring_mass_kg", 0.0))
    if spring_mass < 0.0:
        raise Refusal(f"{path}: mounting.spring_mass_kg is {spring_mass}, expected 0 or more; correct it")
    return {
        "rotation": ROTATIONS[rotation],
        "gravity": tuple(_number(path, "mounting.gravity_m_per_s2", value) for value in gravity),
        "spring_mass": spring_mass,
        "guide_height": None if height is None else _number(path, "mounting.guide_height_m", height),
    }


def _shaft(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of [shaft]."""
    phases = content.get("phases_deg", [0.0])
    if not isinstance(phases, list) or not phases:
        raise Refusal(f"{path}: shaft.phases_deg is {phases!r}, expected a list with one angle per pump")
    stiffness = content.get("stiffness_N_m_per_rad")
    damping = _number(path, "shaft.damping_N_m_s_per_rad", content.get("damping_N_m_s_per_rad", 0.0))
    rigid = stiffness is None
    value = np.inf if rigid else _number(path, "shaft.stiffness_N_m_per_rad", stiffness)
    if value <= 0.0 or damping < 0.0:
        raise Refusal(
            f"{path}: shaft stiffness is {value}, damping {damping}; expected a positive stiffness, damping >= 0"
        )
    return {
        "phases": tuple(_number(path, "shaft.phases_deg", phase) * DEGREE for phase in phases),
        "shaft_stiffness": value,
        "shaft_damping": damping,
    }


def read_pressure_curve(path: Path | str) -> PressureCurve:
    """Return a pressure curve from a CSV file with the columns ``cam_angle_deg`` and ``pressure_bar`` (gauge).

    Raises
    ------
    Refusal : missing file or column, values that are no numbers, angles out of order
    """
    path = Path(path)
    frame = _columns(path, _read_text(path, "pressure curve"), ("cam_angle_deg", "pressure_bar"))
    angle, pressure = (_values(path, frame, name) for name in ("cam_angle_deg", "pressure_bar"))
    if angle.size > 1 and abs(angle[-1] - angle[0] - 360.0) < 1e-9:
        angle, pressure = angle[:-1], pressure[:-1]
    if angle.size < 2 or not np.all(np.diff(angle) > 0.0) or angle[-1] - angle[0] >= 360.0:
        raise Refusal(
            f"{path}: cam_angle_deg has to increase strictly within one revolution; sort or complete the curve"
        )
    return PressureCurve(angle * DEGREE, pressure * BAR)

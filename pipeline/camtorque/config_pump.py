"""A pump without a recording: its TOML file -> `PumpConfig`, checked, in SI and radians.

The ``[pump]`` table is that of a bench recording; ``[cam]``, ``[mounting]``, ``[shaft]`` and ``[friction]`` are
the product's own, so an unknown key is refused. Documented in docs/predict.md. The lift table that the file may name is
read by `camtorque.ingest.pump_file.read_pump`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config import PumpData
from camtorque.records import Array, CamTable, Refusal, freeze_arrays
from camtorque.toml_table import Table, read_toml
from camtorque.units import DEGREE, did_you_mean

SCHEMA = "camtorque-pump/1"
ROTATIONS = {"positive": 1, "negative": -1}
MILLIMETRE = 1.0e-3
MICROMETRE = 1.0e-6
CAM_TABLE_KEYS = ("cam_table", "cam_table_angle_column", "cam_table_lift_column")
TABLES: dict[str, tuple[str, ...]] = {
    "": ("schema", "pump", "cam", "mounting", "shaft", "friction"),
    "pump": (
        "id",
        "note",
        "base_circle_radius_m",
        "roller_radius_m",
        "roller_width_m",
        "follower_offset_m",
        "cam_mass_kg",
        "cam_inertia_kg_m2",
        "follower_mass_kg",
        "follower_mass_note",
        "spring_stiffness_N_per_m",
        "spring_preload_N",
        "plunger_diameter_m",
        "youngs_modulus_cam_Pa",
        "youngs_modulus_roller_Pa",
        "poisson_ratio",
        "roller_mass_kg",
        "roller_inertia_kg_m2",
        *CAM_TABLE_KEYS,
    ),
    "cam": ("sections", "start_deg"),
    "cam.sections": ("kind", "angle_deg", "rise_mm", "nose_radius_mm"),
    "mounting": ("rotation", "gravity_m_per_s2", "spring_mass_kg", "guide_height_m"),
    "shaft": ("phases_deg", "stiffness_N_m_per_rad", "damping_N_m_s_per_rad"),
    "friction": ("guide", "bearing_arm_um", "pin_arm_um"),
}
"""Every key of a pump file."""


@dataclass(frozen=True)
class SectionSpec:
    """One section of a cam: kind, angle [rad], rise [m] (negative on the return), nose radius of a tangent lobe [m]."""

    kind: str
    angle: float
    rise: float
    nose_radius: float


@dataclass(frozen=True)
class PumpConfig:
    """A pump file, checked.

    Attributes
    ----------
    cam_table : lift table once read, None where the cam is given by ``sections``
    sections, sections_start : the cam as sections, from this angle [rad]; empty where there is a lift table
    rotation, gravity, spring_mass, guide_height : see `camtorque.mechanism.mounting.Mounting`
    phases : lag of each pump's lobe on the shaft [rad]
    friction : guide coefficient, bearing and pin arm [-, m, m], see `camtorque.mechanism.friction.Friction`
    shaft_stiffness, shaft_damping : of each piece of shaft between lobes [N m/rad, N m s/rad]; inf for a rigid shaft
    """

    path: Path
    text: str
    pump: PumpData
    sections: tuple[SectionSpec, ...]
    sections_start: float
    rotation: int
    gravity: tuple[float, float]
    spring_mass: float
    guide_height: float | None
    phases: tuple[float, ...]
    shaft_stiffness: float
    shaft_damping: float
    cam_table: CamTable | None = None
    friction: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class PressureCurve:
    """Pressure on the plunger over one revolution: theta (n,) increasing [rad], pressure (n,) gauge [Pa]."""

    theta: Array
    pressure: Array

    def __post_init__(self) -> None:
        freeze_arrays(self)


def load_pump_config(path: Path | str) -> PumpConfig:
    """Return the checked content of a pump file; a lift table that it names is not read yet.

    Raises
    ------
    Refusal : missing file or key, unknown key, a value of the wrong type or out of its range, not exactly one cam
    """
    file = Path(path)
    text, values = read_toml(file, "expected a pump file (schema camtorque-pump/1)")
    root = Table(values, file, "")
    _known_keys(values, "", file)
    if root.text("schema") != SCHEMA:
        raise Refusal(f"{root.where('schema')}: found {values['schema']!r}, expected {SCHEMA!r}")
    pump, cam = root.table("pump"), root.table("cam", optional=True)
    mounting, shaft, friction = (root.table(name, optional=True) for name in ("mounting", "shaft", "friction"))
    tables = {"pump": pump, "cam": cam, "mounting": mounting, "shaft": shaft, "friction": friction}
    for name, table in tables.items():
        _known_keys(table.values, name, file)
    if pump.has("cam_table") == cam.has("sections"):
        raise Refusal(f"{file}: expected either cam_table in [pump] or [[cam.sections]]; give one of them")
    return PumpConfig(
        path=file,
        text=text,
        pump=_pump_data(pump),
        sections=_sections(cam) if cam.has("sections") else (),
        sections_start=cam.number("start_deg", default=0.0) * DEGREE,
        **_mounting(mounting),
        **_shaft(shaft),
        friction=(
            friction.number("guide", default=0.0, least=0.0, below=1.0),
            friction.number("bearing_arm_um", default=0.0, least=0.0) * MICROMETRE,
            friction.number("pin_arm_um", default=0.0, least=0.0) * MICROMETRE,
        ),
    )


def _known_keys(values: Mapping[str, Any], name: str, file: Path) -> None:
    """Refuse a key that a table does not have."""
    for key in values:
        if key not in TABLES[name]:
            hint = did_you_mean(key, TABLES[name]) or f", expected one of {', '.join(TABLES[name])}"
            raise Refusal(f"{file} [{name or 'top'}]: unknown key {key!r}{hint}")


def _pump_data(table: Table) -> PumpData:
    """Return the catalogue values of [pump]."""
    has_table = table.has("cam_table")
    return PumpData(
        base_circle_radius=table.number("base_circle_radius_m", above=0.0),
        roller_radius=table.number("roller_radius_m", above=0.0),
        roller_width=table.number("roller_width_m", above=0.0),
        follower_offset=table.number("follower_offset_m", default=0.0),
        cam_mass=table.number("cam_mass_kg", above=0.0),
        cam_inertia=table.number("cam_inertia_kg_m2", above=0.0),
        follower_mass=table.number("follower_mass_kg", above=0.0),
        spring_stiffness=table.number("spring_stiffness_N_per_m", least=0.0),
        spring_preload=table.number("spring_preload_N", least=0.0),
        plunger_diameter=table.number("plunger_diameter_m", above=0.0),
        youngs_modulus_cam=table.number("youngs_modulus_cam_Pa", above=0.0),
        youngs_modulus_roller=table.number("youngs_modulus_roller_Pa", above=0.0),
        cam_table_path=table.path("cam_table") if has_table else table.file,
        cam_table_angle_column=table.text("cam_table_angle_column") if has_table else "",
        cam_table_lift_column=table.text("cam_table_lift_column") if has_table else "",
        poisson_ratio=table.number("poisson_ratio", default=0.3, above=0.0, below=0.5),
        roller_mass=table.optional_number("roller_mass_kg", least=0.0),
        roller_inertia=table.optional_number("roller_inertia_kg_m2", least=0.0),
    )


def _sections(cam: Table) -> tuple[SectionSpec, ...]:
    """Return the sections of [cam] in the direction of running."""
    return tuple(_section(table) for table in cam.tables("sections"))


def _section(table: Table) -> SectionSpec:
    """Return one section; a tangent lobe takes the angle that it needs."""
    _known_keys(table.values, "cam.sections", table.file)
    kind = table.text("kind")
    tangent, at_rest = kind == "tangent", kind == "dwell"
    return SectionSpec(
        kind=kind,
        angle=0.0 if tangent else table.number("angle_deg", above=0.0) * DEGREE,
        rise=0.0 if at_rest else table.number("rise_mm") * MILLIMETRE,
        nose_radius=table.number("nose_radius_mm", above=0.0) * MILLIMETRE if tangent else 0.0,
    )


def _numbers(table: Table, key: str, default: list[float]) -> tuple[float, ...]:
    """Return a list of numbers."""
    values = table.values.get(key, default)
    if not isinstance(values, list) or not values:
        raise Refusal(f"{table.where(key)}: found {values!r}, expected a list of numbers")
    return tuple(Table({key: value}, table.file, table.header).number(key) for value in values)


def _mounting(table: Table) -> dict[str, Any]:
    """Return the fields of [mounting]."""
    gravity = _numbers(table, "gravity_m_per_s2", [0.0, 0.0])
    if len(gravity) != 2:
        raise Refusal(
            f"{table.where('gravity_m_per_s2')}: found {list(gravity)}, expected two numbers, along X1 and Y1"
        )
    return {
        "rotation": ROTATIONS[table.choice("rotation", tuple(ROTATIONS))] if table.has("rotation") else 1,
        "gravity": gravity,
        "spring_mass": table.number("spring_mass_kg", default=0.0, least=0.0),
        "guide_height": table.optional_number("guide_height_m"),
    }


def _shaft(table: Table) -> dict[str, Any]:
    """Return the fields of [shaft]."""
    stiffness = table.optional_number("stiffness_N_m_per_rad", above=0.0)
    return {
        "phases": tuple(value * DEGREE for value in _numbers(table, "phases_deg", [0.0])),
        "shaft_stiffness": np.inf if stiffness is None else stiffness,
        "shaft_damping": table.number("damping_N_m_s_per_rad", default=0.0, least=0.0),
    }

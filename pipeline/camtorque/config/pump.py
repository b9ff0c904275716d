"""A pump without a recording: its TOML file -> `PumpConfig`, checked, in SI and radians.

The ``[pump]`` table is that of a bench recording; ``[cam]``, ``[mounting]``, ``[shaft]`` and ``[friction]`` are
the product's own, so an unknown key is refused. Documented in docs/predict.md. The lift table that the file may name is
read by `camtorque.ingest.pump_file.read_pump`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config import PumpData
from camtorque.config.schemas import PUMP_FILE_TABLES, PUMP_SCHEMA
from camtorque.config.tables import Problems, Table, read_closed, read_schema
from camtorque.records import Array, CamTable, Finding, ReadOnly, Refusal
from camtorque.units import BAR, DEGREE, short

ONCE = ("pump", "cam", "mounting", "shaft", "friction")
"""Tables that are there once or not at all."""
HERTZ_SEEN, HERTZ_USUAL, HERTZ_POSSIBLE = "0.5 to 2.5", 3.0e9, 6.0e9
"""Contact stress of rolling steel [GPa] and limits [Pa]; 6 GPa marks any steel at first touch."""


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
class PressureCurve(ReadOnly):
    """Pressure on the plunger over one revolution, for `camtorque.predict`.

    Attributes
    ----------
    theta : (n,) cam angle, increasing [rad]
    pressure : (n,) gauge [Pa]
    """

    theta: Array
    pressure: Array

    def __post_init__(self) -> None:
        for name in ("theta", "pressure"):  # copies: those of the caller stay his to write
            try:
                values = np.array(getattr(self, name), dtype=np.float64)
            except (TypeError, ValueError):
                raise Refusal(f"PressureCurve {name}: found no array of numbers, expected rad and Pa") from None
            object.__setattr__(self, name, values)
        super().__post_init__()


def weak_pressure(pump: PumpData, peak: float, where: str = "") -> tuple[Finding, ...]:
    """Return a warning where the largest pressure [Pa] presses less than the spring of the follower.

    No pump is built for that.
    """
    force = pump.plunger_area * peak
    if not 0.0 < force < pump.spring_preload:
        return ()
    text = (
        f"the largest pressure of {short(peak / BAR)} bar presses the plunger with {short(force)} N, less than the "
        f"spring with {short(pump.spring_preload)} N: is the pressure in its unit?"
    )
    return (Finding("pressure_weak", "warning", text, where),)


def load_pump_config(path: Path | str) -> PumpConfig:
    """Return the checked content of a pump file; a lift table that it names is not read yet.

    Raises
    ------
    Refusal : missing file or key, unknown key, a value of the wrong type or out of its range, not exactly one cam
    """
    file = Path(path)
    text, root = read_schema(file, PUMP_SCHEMA, f"expected a pump file (schema {PUMP_SCHEMA})")
    root.only(("schema", *ONCE))
    problems = Problems()
    tables = {name: _values(root, name, problems) for name in ONCE}
    sections = _sections(root, problems)
    problems.raise_any(listed=False)
    pump = tables["pump"]
    if (pump["cam_table_path"] is None) == (not sections):
        raise Refusal(f"{file}: expected either cam_table in [pump] or [[cam.sections]]; give one of them")
    first = tables["shaft"]["phases"][0]
    if first:
        raise Refusal(
            f"{file} [shaft] phases_deg: found {first / DEGREE:g} for the first pump, expected 0: the others' are lags "
            "behind it; turn the cam itself by start_deg of [cam] or its lift table"
        )
    pump["cam_table_path"] = pump["cam_table_path"] or file
    return PumpConfig(
        path=file,
        text=text,
        pump=PumpData(**pump),
        sections=sections,
        **tables["cam"],
        **tables["mounting"],
        **tables["shaft"],
        friction=tuple(tables["friction"].values()),
    )


def _values(root: Table, name: str, problems: Problems) -> dict[str, Any]:
    schema = PUMP_FILE_TABLES[name]
    with problems.collecting():
        inner = ("sections",) if name == "cam" else ()
        return read_closed(root.table(name, optional=not schema.required), schema, *inner)
    return {}


def _sections(root: Table, problems: Problems) -> tuple[SectionSpec, ...]:
    """Return the sections of [cam] in the direction of running."""
    sections = []
    with problems.collecting():
        cam = root.table("cam", optional=True)
        for table in cam.tables("sections") if cam.has("sections") else ():
            with problems.collecting():
                sections.append(_section(table))
    return tuple(sections)


def _section(table: Table) -> SectionSpec:
    """Return one section; a tangent lobe takes the angle that it needs."""
    schema = PUMP_FILE_TABLES["cam.sections"]
    values = read_closed(table, schema)
    needed = {"tangent": ("rise", "nose_radius"), "dwell": ("angle",)}.get(values["kind"], ("angle", "rise"))
    for key in schema.keys:
        if key.attribute in needed and not table.has(key.name):
            raise Refusal(f"{table.where(key.name)}: this key is missing; {key.meaning}")
        if key.attribute not in ("kind", *needed) and values[key.attribute]:
            raise Refusal(
                f"{table.where(key.name)}: found {key.of_si(values[key.attribute]):g} for a section of kind "
                f"{values['kind']!r}, where nothing reads it; leave it out, or name the kind that is meant"
            )
    unused = set(values) - set(needed) - {"kind"}
    return SectionSpec(**{**values, **dict.fromkeys(unused, 0.0)})

"""Text of a first ``recording.toml``: what the logs tell is filled in, what they cannot tell is a "?" to be replaced.

Written from the same `camtorque.schemas` that the reader checks against; a "?" that is left is refused by its name.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from camtorque.ingest.proposal import Proposal, Wheel, wheel_of
from camtorque.quantities import ANGLE_QUANTITIES, CHANNEL_QUANTITIES
from camtorque.records import Refusal
from camtorque.schemas import RECORDING_SCHEMA, RECORDING_TABLES
from camtorque.toml_schema import UNKNOWN, Key, TableSchema
from camtorque.toml_table import read_toml

FASTEST = 6000.0
"""One pulse a turn at more than this [rpm] is more likely a wheel of several teeth."""
PATHS = ("cam_table", "calibration", "file")
COPIED = ("pump", "trigger", "fluid", "drive")
ASKED_SENSOR = ("unit", "sensitivity_V_per_unit", "zero_V", "nominal_range", "accuracy_percent_fs", "group_delay_s",
                "cutoff_hz", "filter")  # fmt: skip
ASKED_SCALED = ("accuracy_percent_fs", "group_delay_s", "cutoff_hz", "filter")
"""Sheet keys that are asked for: of a sensor in volts, and of values that the logger has scaled."""


@dataclass(frozen=True)
class NewRecording:
    """The text, and the keys whose value is still unknown."""

    text: str
    unknown: tuple[str, ...]


def new_recording(folder: Path, proposals: list[Proposal], like: Path | None) -> NewRecording:
    """Return the text of a recording.toml in ``folder`` for the channels that were found.

    Parameters
    ----------
    like : recording.toml or pump file of the same bench, whose pump, trigger and sensors are taken over
    """
    known = _known_of(like, folder)
    used = [item for item in proposals if item.quantity]
    if not used:
        raise Refusal(f"{proposals[0].path}: no channel looks like torque, pressure or trigger; name the columns so")
    trigger = next((item for item in used if item.quantity in ANGLE_QUANTITIES), None)
    wheel = wheel_of(trigger.channel) if trigger is not None and trigger.quantity != "angle" else None
    writer = Writer()
    writer.line(f'schema = "{RECORDING_SCHEMA}"')
    writer.line('# Replace every "?"; then: camtorque check')
    writer.table("[recording]", RECORDING_TABLES["recording"], {**_recording(folder, wheel), **known["recording"]})
    writer.table("[pump]", RECORDING_TABLES["pump"], known["pump"])
    if trigger is None:
        writer.line("# No channel looks like a trigger: add one to [[channels]], or a cam angle cannot be told.")
    writer.table("[trigger]", RECORDING_TABLES["trigger"], {**_wheel(wheel), **known["trigger"]})
    for item in {item.quantity: item for item in reversed(used)}.values():
        _sensor(writer, item, known["sensors"].get(item.quantity))
    loggers = {path: f"LOG{number}" for number, path in enumerate(dict.fromkeys(item.path for item in used), start=1)}
    for name in loggers.values():
        writer.table("[[loggers]]", RECORDING_TABLES["loggers"], {"id": name, "clock": _clock(loggers)})
    for item in used:
        writer.table("[[channels]]", RECORDING_TABLES["channels"], _channel(item, folder, loggers[item.path]))
    left = [item for item in proposals if not item.quantity]
    for item in left:
        writer.line(
            f"# not used: {item.path.name!a}, {item.channel.group!a}, {item.channel.name!a}, {item.channel.unit!a}"
        )
    return NewRecording("\n".join(writer.lines) + "\n", tuple(writer.unknown))


class Writer:
    """Collects lines of a TOML file, and the keys that are unknown."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.unknown: list[str] = []

    def line(self, text: str) -> None:
        """Add a line."""
        self.lines.append(text)

    def table(self, header: str, schema: TableSchema, values: Mapping[str, Any], asked: tuple[str, ...] = ()) -> None:
        """Add a table: known values, and a "?" for each key that is required, or asked for as a comment."""
        self.lines += ["", header if header.startswith("[[") else f"{header}  # {schema.meaning}"]
        for key in schema.keys:
            if key.name in values:
                self._key(key, values[key.name])
            elif key.required:
                self._key(key, UNKNOWN)
            elif key.name in asked:
                self.lines.append(f"# {key.name} =   # {_told(key)}")
        for name in values:
            if name not in schema.names:
                self.lines.append(f"{name} = {toml_value(values[name])}")

    def _key(self, key: Key, value: Any) -> None:
        if value == UNKNOWN:
            self.unknown.append(key.name)
            self.lines.append(f"{key.name} = {toml_value(value)}  # {_told(key)}")
            return
        self.lines.append(f"{key.name} = {toml_value(value)}  # {key.meaning}")


def _told(key: Key) -> str:
    allowed = f"; {key.band}" if key.band is not None else f"; {', '.join(key.choices)}" if key.choices else ""
    return key.meaning + allowed


def toml_value(value: Any) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    return (
        repr(value)
        if isinstance(value, (int, float))
        else json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    )


def _known_of(like: Path | None, folder: Path) -> dict[str, dict[str, Any]]:
    """Return the tables of another recording or pump file, paths turned to the new folder."""
    empty: dict[str, dict[str, Any]] = {name: {} for name in ("recording", "sensors", *COPIED)}
    if like is None:
        return empty
    file = like / "recording.toml" if like.is_dir() else like
    _, values = read_toml(file, "expected a recording or a pump file whose pump and sensors are taken over")
    tables = {name: dict(values.get(name, {})) for name in empty}
    rotation = tables["recording"].get("rotation")
    tables["recording"] = {name: tables["recording"][name] for name in ("pump_id",) if name in tables["recording"]}
    if rotation is not None:
        tables["recording"]["rotation"] = rotation
    drop = {"id", "note"} if "recording" not in values else set()
    tables["pump"] = {name: value for name, value in tables["pump"].items() if name not in drop}
    for table in (tables["pump"], *tables["sensors"].values()):
        for name in PATHS:
            if isinstance(table.get(name), str):
                table[name] = _relative(file.parent / table[name], folder)
    # readings at standstill belong to the other run
    for table in tables["sensors"].values():
        for name in [name for name in table if name.startswith(("zero_before", "zero_after", "idle_"))]:
            del table[name]
    return tables


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def _recording(folder: Path, wheel: Wheel | None) -> dict[str, Any]:
    values: dict[str, Any] = {"id": folder.resolve().name or "recording", "pump_id": UNKNOWN}
    if wheel is not None and wheel.revolutions_per_second * 60.0 <= FASTEST:
        values["nominal_speed_rpm"] = round(60.0 * wheel.revolutions_per_second, 1)
    return values


def _wheel(wheel: Wheel | None) -> dict[str, Any]:
    if wheel is None or wheel.revolutions_per_second * 60.0 > FASTEST:
        return {"pulses_per_rev": UNKNOWN}
    missing = {"missing_teeth": wheel.missing_teeth} if wheel.missing_teeth else {}
    return {"pulses_per_rev": wheel.pulses_per_rev, **missing}


def _sensor(writer: Writer, item: Proposal, known: dict[str, Any] | None) -> None:
    """Add the table of a sensor: as the other recording has it, else what has to be asked."""
    if CHANNEL_QUANTITIES[item.quantity].is_pulse:
        return
    schema, header = RECORDING_TABLES["sensors"], f"[sensors.{item.quantity}]"
    in_volts = item.unit in ("V", "mV", "uV", "kV", "")
    if known is not None:
        writer.table(header, schema, known)
    elif in_volts:
        unit = {"torque": "N m", "pressure": "bar"}.get(item.quantity, CHANNEL_QUANTITIES[item.quantity].unit)
        writer.table(header, schema, {"unit": unit, "sensitivity_V_per_unit": UNKNOWN}, ASKED_SENSOR)
        writer.line('# or instead of these: serial = "...", calibration = "sheet.toml" with its certificate')
    else:
        writer.table(header, schema, {}, ASKED_SCALED)


def _clock(loggers: Mapping[Path, str]) -> str:
    return "single" if len(loggers) == 1 else UNKNOWN


def _channel(item: Proposal, folder: Path, logger: str) -> dict[str, Any]:
    channel = item.channel
    values: dict[str, Any] = {
        "quantity": item.quantity,
        "file": _relative(item.path, folder),
        "group": channel.group,
        "channel": channel.name,
        "unit": item.unit or UNKNOWN,
        "logger": logger,
        "sample_rate_hz": UNKNOWN if channel.sample_rate is None else float(f"{channel.sample_rate:.9g}"),
    }
    if channel.time_channel:
        values["time_channel"] = channel.time_channel
    return values

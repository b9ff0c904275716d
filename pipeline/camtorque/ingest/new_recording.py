"""Text of a first ``recording.toml``: what the logs tell is filled in, what they cannot tell is a "?" to be replaced.

Written from the same `camtorque.config.schemas` that the reader checks against; a "?" that is left is refused by name.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from camtorque.config.keys import UNKNOWN, Key, TableSchema
from camtorque.config.quantities import ANGLE_QUANTITIES, CHANNEL_QUANTITIES, SHEET_NEEDED
from camtorque.config.schemas import RECORDING_FILE, RECORDING_SCHEMA, RECORDING_TABLES
from camtorque.config.tables import Table, read_toml
from camtorque.hashes import real_path
from camtorque.ingest.proposal import Proposal
from camtorque.ingest.wheel import BY_INDEX, Wheel, angle_wheel, wheel_of
from camtorque.records import Refusal
from camtorque.units import BORDER_UNITS, unit_factor

FASTEST = 6000.0
"""One pulse a turn at more than this [rpm] is more likely a wheel of several teeth."""
HIGHEST_VOLTS = 15.0
MOST_OPEN = 8
"""Channels that nothing names are asked for where torque, pressure or the angle are missing, at most this many."""
NEEDED = ("torque", "pressure")
PATHS = ("cam_table", "calibration", "file")
WHEEL = (("pulses_per_rev", 1), ("missing_teeth", 0), ("double_tooth", False))
"""Keys of a wheel that its mark or an index shows, and what they are where they are left out."""
COPIED = ("pump", "trigger", "fluid", "drive")
ASKED_SCALED = ("accuracy_percent_fs", "group_delay_s", "cutoff_hz", "filter")
ASKED_BRIDGE = ("zero_mV_per_V", *ASKED_SCALED)
ASKED_SENSOR = ("unit", "sensitivity_V_per_unit", "zero_V", "nominal_range", *ASKED_SCALED)
"""Sheet keys that are asked for: of values that the logger has scaled, of a bridge, and of a sensor in volts."""
ASKED_RIG = ("rotation", "follower_offset_m", "edge", "switching_delay_typ_s")
"""Keys of the rig that are asked for, with what is assumed where they are left out."""


SHEET_UNITS = {"torque": "N m", "pressure": "bar"}
"""Units that sheets are usually written in."""


@dataclass(frozen=True)
class NewRecording:
    """The text, the keys whose value is still unknown, and the channels that are asked for as nothing names them."""

    text: str
    unknown: tuple[str, ...]
    asked: tuple[Proposal, ...]


def new_recording(folder: Path, proposals: list[Proposal], like: Path | None) -> NewRecording:
    """Return a recording.toml for ``folder``; pump, trigger and sensors as in ``like``, a recording or pump file."""
    known = _known_of(like, folder)
    supplies = {(item.path, item.channel.group, item.supply) for item in proposals}
    proposals = [item for item in proposals if (item.path, item.channel.group, item.channel.name) not in supplies]
    named = {item.quantity for item in proposals}
    open_ones = [item for item in proposals if not item.quantity and item.high > item.low]
    open_ones = open_ones[:MOST_OPEN] if not named >= set(NEEDED) or not named & set(ANGLE_QUANTITIES) else []
    used = [item for item in proposals if item.quantity or any(item is other for other in open_ones)]
    if not used:
        raise Refusal(f"{proposals[0].path}: no channel changes; there is no torque, pressure or trigger in it")
    angles = [item for item in used if item.quantity in ANGLE_QUANTITIES]
    trigger = min(angles, key=lambda item: item.quantity == "index", default=None)  # an index only beside the others
    wheel = _wheel_of(trigger, proposals) if trigger is not None else None
    writer = Writer()
    writer.line(f'schema = "{RECORDING_SCHEMA}"')
    writer.line('# Replace every "?"; then: camtorque check')
    writer.table("[recording]", RECORDING_TABLES["recording"], {**_recording(folder, wheel), **known["recording"]})
    writer.table("[pump]", RECORDING_TABLES["pump"], known["pump"])
    _write_trigger(writer, known, trigger, wheel, named)
    for quantity, item in _sensed(used, named).items():
        _sensor(writer, quantity, item, known["sensors"].get(quantity))
    loggers = {path: f"LOG{number}" for number, path in enumerate(dict.fromkeys(item.path for item in used), start=1)}
    clock = "single" if len(loggers) == 1 else UNKNOWN
    for name in loggers.values():
        writer.table("[[loggers]]", RECORDING_TABLES["loggers"], {"id": name, "clock": clock})
    for item in used:
        writer.table("[[channels]]", RECORDING_TABLES["channels"], _channel(item, folder, loggers[item.path]))
        for note in _notes(item):
            writer.line(note)
    for item in [item for item in proposals if not item.quantity and item.high > item.low and not open_ones]:
        writer.line(
            f"# not used: {item.path.name!a}, {item.channel.group!a}, {item.channel.name!a}, {item.channel.unit!a}"
        )
    return NewRecording("\n".join(writer.lines) + "\n", tuple(writer.unknown), tuple(open_ones))


def _write_trigger(
    writer: Writer, known: Mapping[str, dict[str, Any]], trigger: Proposal | None, wheel: Wheel | None, named: set[str]
) -> None:
    """Add the table of what tells the cam angle."""
    if trigger is None:
        writer.line("# No channel looks like a trigger: add one to [[channels]], or a cam angle cannot be told.")
    if wheel is not None and wheel.known_from:
        writer.line(f"# what follows of the wheel is told by: {wheel.known_from}")
    taken = known["trigger"]
    if taken and _is_other_wheel(known, wheel, named):
        writer.line("# the cam angle of the other recording is told otherwise: its [trigger] is not taken over")
        taken = {}
    if wheel is not None and 60.0 * wheel.speed > FASTEST and taken.get("pulses_per_rev", 1) == 1:
        writer.line(
            "# one pulse a turn, as in the other recording, would be too fast: its pulses_per_rev is not taken over"
        )
        taken = {name: value for name, value in taken.items() if name != "pulses_per_rev"}
    writer.table("[trigger]", RECORDING_TABLES["trigger"], {**_wheel(trigger, wheel, named), **taken})


def _notes(item: Proposal) -> Iterator[str]:
    """Yield what a person has to know of a channel to fill in what is open."""
    if not item.unit and item.channel.unit.strip("-"):
        yield f"# the file says {item.channel.unit!a}, which is no known unit"
    if item.quantity == "angle" and item.channel.sample_rate is None:
        yield "# where the logger samples by this angle, not by time: samples per turn x speed in rpm / 60"
    if not item.quantity:
        yield f"# its values: {item.low:.4g} to {item.high:.4g}"


def _wheel_of(trigger: Proposal, proposals: list[Proposal]) -> Wheel | None:
    """Return what the angle channel shows, with the help of index, torque and pressure of the same file."""
    mates = {item.quantity: item.channel for item in reversed(proposals) if item.path == trigger.path}
    if trigger.quantity == "angle":
        known = bool(trigger.unit)
        return angle_wheel(trigger.channel, unit_factor(trigger.unit, "angle", "angle")) if known else None
    load = mates.get("torque") or mates.get("pressure")
    return wheel_of(trigger.channel, trigger.sensor or "digital", mates.get("index"), load)


def _is_other_wheel(known: Mapping[str, dict[str, Any]], wheel: Wheel | None, named: set[str]) -> bool:
    """Tell whether logs show another wheel or sensor than the other recording: its angle is of another edge then."""
    sources = named & set(ANGLE_QUANTITIES)
    if sources and known["angles"] and sources != set(known["angles"]):
        return True
    marked = wheel is not None and (wheel.missing_teeth or wheel.double_tooth or wheel.known_from == BY_INDEX)
    return bool(marked) and any(known["trigger"].get(name, usual) != getattr(wheel, name) for name, usual in WHEEL)


def _sensed(used: list[Proposal], named: set[str]) -> dict[str, Proposal]:
    """Return a channel for each sensor table; torque and pressure that no name tells may be any channel in volts."""
    found = {item.quantity: item for item in reversed(used) if item.quantity}
    open_ones = [item for item in used if not item.quantity and item.unit in ("V", "mV", "")]
    return {**found, **{name: open_ones[0] for name in NEEDED if open_ones and name not in named}}


class Writer:
    """Collects lines of a TOML file, and the keys that are unknown."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.unknown: list[str] = []

    def line(self, text: str) -> None:
        """Add a line."""
        self.lines.append(text)

    def table(
        self, header: str, schema: TableSchema, values: Mapping[str, Any], asked: tuple[str, ...] = ASKED_RIG
    ) -> None:
        """Add a table: known values, and a "?" for each key that is required, or asked for as a comment."""
        self.lines += ["", header if header.startswith("[[") else f"{header}  # {schema.meaning}"]
        for key in schema.keys:
            if key.name in values:
                self._key(key, values[key.name])
            elif key.required:
                self._key(key, UNKNOWN)
            elif key.name in asked:
                self.lines.append(f"# {key.name} =   # {_meaning(key)}{_left_out(key)}")
        for name in values:
            if name not in schema.names:
                self.lines.append(f"{name} = {toml_value(values[name])}")

    def _key(self, key: Key, value: Any) -> None:
        self.unknown += [key.name] if value == UNKNOWN else []
        meaning = _meaning(key) if value == UNKNOWN else key.meaning
        self.lines.append(f"{key.name} = {toml_value(value)}  # {meaning}")


def _meaning(key: Key) -> str:
    if key.band is not None:
        return f"{key.meaning}; {key.band}"
    unsaid = [word for word in key.choices if f"{word}:" not in key.meaning]
    return f"{key.meaning}; {', '.join(key.choices)}" if unsaid else key.meaning


def _left_out(key: Key) -> str:
    """Return what is assumed where a key is left out, "" where nothing is."""
    default = next((word for word, value in key.choices.items() if value == key.default), key.default)
    return "" if default in (None, "") else f"; {toml_value(default)} is assumed where it is left out"


def toml_value(value: Any) -> str:
    """Return a value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    if isinstance(value, (int, float)):
        return repr(value)
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def _known_of(like: Path | None, folder: Path) -> dict[str, dict[str, Any]]:
    """Return the tables of another recording or pump file, paths turned to the new folder."""
    empty: dict[str, dict[str, Any]] = {name: {} for name in ("recording", "sensors", "angles", *COPIED)}
    if like is None:
        return empty
    file = like / RECORDING_FILE if like.is_dir() else like
    _, values = read_toml(file, "expected a recording or a pump file whose pump and sensors are taken over")
    root = Table(values, file, "")
    tables = {name: dict(root.table(name, optional=True).values) for name in empty}
    tables["sensors"] = {name: dict(root.table("sensors").table(name).values) for name in tables["sensors"]}
    quantities = [channel.values.get("quantity") for channel in root.tables("channels")] if "channels" in values else []
    tables["angles"] = {name: True for name in ANGLE_QUANTITIES if name in quantities}
    of_rig = ("pump_id", "rotation")
    tables["recording"] = {name: tables["recording"][name] for name in of_rig if name in tables["recording"]}
    if "recording" not in values:  # a pump file, whose id is the name of the pump
        tables["pump"].pop("note", None)
        name = tables["pump"].pop("id", "")
        tables["recording"] |= {"pump_id": name} if name != "" else {}
    for table in (tables["pump"], *tables["sensors"].values()):
        for name in PATHS:
            if isinstance(table.get(name), str) and table[name] != UNKNOWN:
                table[name] = _relative(file.parent / table[name], folder)
    # readings at standstill belong to the other run
    for table in tables["sensors"].values():
        for name in [name for name in table if name.startswith(("zero_before", "zero_after", "idle_"))]:
            del table[name]
    return tables


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(real_path(path), real_path(folder))).as_posix()


def _recording(folder: Path, wheel: Wheel | None) -> dict[str, Any]:
    values: dict[str, Any] = {"id": real_path(folder).name or "recording", "pump_id": UNKNOWN}
    speed = 0.0 if wheel is None else round(60.0 * wheel.speed, 1)
    if 0.0 < speed <= FASTEST:
        values["nominal_speed_rpm"] = speed
    return values


def _wheel(trigger: Proposal | None, wheel: Wheel | None, named: set[str]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    if wheel is None or 60.0 * wheel.speed > FASTEST:
        values |= {} if trigger is not None and trigger.quantity == "angle" else {"pulses_per_rev": UNKNOWN}
        wheel = None
    elif wheel.pulses_per_rev:
        values["pulses_per_rev"] = wheel.pulses_per_rev
    if trigger is not None and trigger.sensor:
        values |= {"sensor": trigger.sensor, "edge": "falling"}
    if "index" in named and (wheel is None or not (wheel.missing_teeth or wheel.double_tooth)):
        values["reference"] = "index"  # a wheel without a mark has no tooth 1
    for name in ("missing_teeth", "double_tooth", "revolutions_per_cycle") if wheel is not None else ():
        value = getattr(wheel, name)
        values |= {name: value} if value > (name == "revolutions_per_cycle") else {}
    return values


def _sensor(writer: Writer, quantity: str, item: Proposal, known: dict[str, Any] | None) -> None:
    """Add the table of a sensor: as the other recording has it, else what has to be asked."""
    if CHANNEL_QUANTITIES[quantity].is_pulse:
        return
    schema, header = RECORDING_TABLES["sensors"], f"[sensors.{quantity}]"
    unit, kind = SHEET_UNITS.get(quantity, CHANNEL_QUANTITIES[quantity].unit), BORDER_UNITS.get(item.unit, ("", 1.0))[0]
    # no amplifier puts out more: values without a unit are not volts then
    in_volts = kind == "voltage" or (not item.unit and max(-item.low, item.high) <= HIGHEST_VOLTS)
    if known is not None:
        writer.table(header, schema, known)
    elif item.supply or kind == "bridge output":
        values = {"unit": unit, "nominal_range": UNKNOWN, "sensitivity_mV_per_V": UNKNOWN}
        writer.table(header, schema, values, ASKED_BRIDGE)
        writer.line("# or in place of range and sensitivity: unit_per_mV_per_V")
    elif in_volts:
        writer.table(header, schema, {"unit": unit, "sensitivity_V_per_unit": UNKNOWN}, ASKED_SENSOR)
        writer.line('# or instead of these: serial = "...", calibration = "sheet.toml" with its certificate')
        if not item.unit or item.quantity != quantity:
            writer.line("# these two only for a channel in volts: leave them out where the logger has scaled")
    elif quantity in SHEET_NEEDED:
        writer.table(header, schema, {"reference": "absolute"} if item.is_absolute else {}, ASKED_SCALED)


def _channel(item: Proposal, folder: Path, logger: str) -> dict[str, Any]:
    channel = item.channel
    values: dict[str, Any] = {
        "quantity": item.quantity or UNKNOWN,
        "file": _relative(item.path, folder),
        "group": channel.group,
        "channel": channel.name,
        "unit": item.unit or UNKNOWN,
        "logger": logger,
        "sample_rate_hz": UNKNOWN if channel.sample_rate is None else float(f"{channel.sample_rate:.9g}"),
    }
    if item.has_rival:
        values["used"] = UNKNOWN
    values |= {"time_channel": channel.time_channel} if channel.time_channel else {}
    values |= {"supply_channel": item.supply} if item.supply else {}
    return values

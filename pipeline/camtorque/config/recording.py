"""The bench's ``recording.toml`` (schema ``fip-bench-recording/1``) -> `RecordingConfig`, in SI and radians.

What each key may hold stands in `camtorque.config.schemas`. Everything that is wrong is said at once; a key that the
product does not know is a finding: benches add keys of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.config import (
    ChannelSpec,
    DriveSpec,
    FluidSpec,
    LoggerSpec,
    PumpData,
    RecordingConfig,
    SensorRef,
    TriggerSpec,
)
from camtorque.config.absent import MOST_LISTED
from camtorque.config.keys import TableSchema
from camtorque.config.quantities import ANGLE_QUANTITIES, CHANNEL_QUANTITIES, SENSOR_QUANTITIES, channel_factor
from camtorque.config.schemas import RECORDING_FILE, RECORDING_SCHEMA, RECORDING_TABLES, SHEET_KEYS
from camtorque.config.tables import Problems, Table, read_keys, read_schema
from camtorque.records import Finding, Refusal
from camtorque.units import BORDER_UNITS, did_you_mean, first_of, tidy_unit, unit_factor

ONLY_LOGGER = LoggerSpec("logger", "single")
"""Where recording.toml names no logger."""
CHANNELS_AT_MOST = 64
FAR_ALONG = 0.05
"""Length of line before a pressure sensor above which it is told [m]: the oil of 40 mm moves as one in the model."""
PER_LOGGER = ("trigger", "index", "encoder_a", "encoder_b", "angle")
"""Quantities that every logger may record, to tie its clock to the others."""


def load_recording_config(path: Path) -> RecordingConfig:
    """Read and check ``recording.toml``; ``path`` is that file or its folder.

    Raises
    ------
    Refusals : missing files or keys, wrong types, impossible values, channels without logger or sensor; all of them
    """
    file = path / RECORDING_FILE if path.is_dir() else path
    expected = f"a recording is a folder that holds {RECORDING_FILE}, or that file{_near(path)}"
    if path.is_file() and path.suffix != ".toml":
        raise Refusal(f"{path}: is no TOML file; {expected}; for a log, `camtorque new {path}` writes one")
    text, root = read_schema(file, RECORDING_SCHEMA, expected)
    problems = Problems()
    single = {name: _one(root, name, problems) for name in ("recording", "pump", "trigger", "fluid", "drive")}
    channels, sensors = _channels(root, problems), _sensors(root, problems)
    loggers = _loggers(root, any(table.get("logger") for table in channels), problems)
    _refuse_any(problems, root)
    left_out = [table for table in channels if not table.pop("used")]
    channels = [table for table in channels if table not in left_out]
    recording = single["recording"]
    idle = {name: recording.pop(name) for name in ("idle_from", "idle_to")}
    duration = recording.pop("duration")
    references, specs = dict[str, SensorRef](), list[ChannelSpec]()
    for name, table in sensors.items():
        with problems.collecting():
            references[name] = _sensor(name, table, idle, file)
    for table in channels:
        with problems.collecting():
            specs.append(_channel(table, loggers, duration))
    _refuse_any(problems, root)
    config = RecordingConfig(
        path=file,
        text=text,
        **recording,
        pump_sheet=PumpData(**single["pump"]) if root.has("pump") else None,
        trigger=_from_start_of_lift(TriggerSpec(**single["trigger"]), single["pump"]),
        sensors=references,
        loggers=loggers,
        channels=tuple(specs),
        findings=(*_unknown_keys(root.values, file), *_assumed(root), *(_left_out(table) for table in left_out)),
        fluid=FluidSpec(**single["fluid"]),
        drive=DriveSpec(**single["drive"]),
    )
    _check_roles(config)
    return replace(config, findings=(*config.findings, *_one_file_two_clocks(config), *place_findings(config)))


def _refuse_any(problems: Problems, root: Table) -> None:
    """Refuse where anything was noted, and say which keys are not known: a key that is missed may be one of them."""
    if problems.texts:
        problems.texts += [f"{row.where}: {row.text}" for row in _unknown_keys(root.values, root.file)]
    problems.raise_any()


def _near(path: Path) -> str:
    """Return the recordings below a folder that is none, or beside one that is missing, in words."""
    folder = path if path.is_dir() else path.parent
    if (path / RECORDING_FILE).exists() or path.is_file() or not folder.is_dir():
        return ""
    names = tuple(sorted(item.parent.name for item in folder.glob(f"*/{RECORDING_FILE}")))
    return did_you_mean(path.name, names) or (f"; in {folder} are {first_of(names, MOST_LISTED)}" if names else "")


def _one(root: Table, name: str, problems: Problems) -> dict[str, Any]:
    """Return the values of a table that is there once; those of an optional one that is left out are its defaults."""
    schema = RECORDING_TABLES[name]
    with problems.collecting():
        table = root.table(name, optional=not schema.required)
        return read_keys(table, schema, problems if schema.required or root.has(name) else Problems())
    return {}


def _loggers(root: Table, are_named: bool, problems: Problems) -> tuple[LoggerSpec, ...]:
    if not root.has("loggers") and not are_named:
        return (ONLY_LOGGER,)
    loggers = []
    with problems.collecting():
        for table in root.tables("loggers"):
            values = read_keys(table, RECORDING_TABLES["loggers"], problems)
            loggers += [LoggerSpec(**values)] if len(values) == 2 else []
    problems.texts += _repeated([logger.id for logger in loggers], f"{root.file} [[loggers]] id")
    return tuple(loggers)


def _channels(root: Table, problems: Problems) -> list[dict[str, Any]]:
    channels = []
    with problems.collecting():
        tables = root.tables("channels")
        if len(tables) > CHANNELS_AT_MOST:
            raise Refusal(f"{root.file} [[channels]]: {len(tables)} channels, expected at most {CHANNELS_AT_MOST}")
        for table in tables:
            values = read_keys(table, RECORDING_TABLES["channels"], problems)
            channels.append({**values, "where": table.where("logger")})
            quantity, unit, name = (values.get(key, "") for key in ("quantity", "unit", "channel"))
            if quantity and unit and name and values.get("used") and not values.get("supply_channel"):
                with problems.collecting():
                    channel_factor(quantity, unit, f"{root.file} [[channels]] {name!r} unit")
    return channels


def _sensors(root: Table, problems: Problems) -> dict[str, dict[str, Any]]:
    sensors: dict[str, dict[str, Any]] = {}
    with problems.collecting():
        tables = root.table("sensors", optional=True)
        for quantity in tables.values:
            with problems.collecting():
                if quantity not in SENSOR_QUANTITIES:
                    hint = did_you_mean(quantity, SENSOR_QUANTITIES)
                    expected = ", ".join(SENSOR_QUANTITIES)
                    raise Refusal(f"{root.file} [sensors.{quantity}]: unknown quantity{hint}; expected {expected}")
                sensors[quantity] = read_keys(tables.table(quantity), RECORDING_TABLES["sensors"], problems)
    return sensors


def _sensor(quantity: str, values: dict[str, Any], idle: dict[str, Any], file: Path) -> SensorRef:
    own = {name: values.pop(name) for name in ("idle_from", "idle_to")}
    chosen = own if any(value is not None for value in own.values()) else idle
    start, stop = chosen["idle_from"], chosen["idle_to"]
    if (start is None) != (stop is None) or (start is not None and stop <= start):
        raise Refusal(
            f"{file} [sensors.{quantity}] idle_to_s: an idle stretch needs idle_from_s < idle_to_s, "
            f"found {start} and {stop}"
        )
    sheet = {key.attribute: values.pop(key.attribute) for key in SHEET_KEYS}
    return SensorRef(quantity=quantity, **values, idle_from=start, idle_to=stop, sheet=sheet)


def _channel(values: dict[str, Any], loggers: tuple[LoggerSpec, ...], duration: float | None) -> ChannelSpec:
    names = tuple(logger.id for logger in loggers)
    where = values.pop("where")
    logger = values["logger"] or (names[0] if len(names) == 1 else "")
    if logger not in names:
        hint = did_you_mean(logger, names)
        raise Refusal(f"{where}: found {logger!r}, expected one of {', '.join(names)}{hint}")
    stated = values["duration"] if values["duration"] is not None else duration
    return ChannelSpec(**{**values, "logger": logger, "duration": stated})


def _from_start_of_lift(trigger: TriggerSpec, pump: Mapping[str, Any]) -> TriggerSpec:
    """Return the trigger with its angle counted from the start of lift, within half a revolution of it."""
    if not pump.get("cam_table_zero"):
        return trigger
    turned = (trigger.nominal_angle - pump["cam_table_zero"] + np.pi) % (2.0 * np.pi) - np.pi
    return replace(trigger, nominal_angle=turned, start_of_lift=trigger.nominal_angle - turned)


def _assumed(root: Table) -> list[Finding]:
    """Tell sizes of the pump that nobody states and that are taken as usual."""
    if not root.has("pump") or root.table("pump").has("follower_offset_m"):
        return []
    text = "follower_offset_m is not given; 0 is assumed: the follower's line passes through the cam axis"
    return [Finding("follower_offset_assumed", "info", text, f"{root.file.name} [pump]")]


def _one_file_two_clocks(config: RecordingConfig) -> list[Finding]:
    """Tell a file whose channels are given to loggers with clocks of their own: one device wrote them all, mostly."""
    found = []
    for path in dict.fromkeys(channel.path for channel in config.channels):
        named = sorted({channel.logger for channel in config.channels if channel.path == path} & config.own_clocks)
        if len(named) > 1:
            text = (
                f"its channels are given to the loggers {' and '.join(named)} with clocks of their own, which are then "
                f"sought from the signals: where one device wrote the file, give all of them to {named[0]}"
            )
            found.append(Finding("one_file_several_clocks", "warning", text, path.name))
    return found


def place_findings(config: RecordingConfig) -> tuple[Finding, ...]:
    """Return what the location of the pressure sensor means: the plunger's pressure, or one far along the line."""
    sensor = config.sensors.get("pressure")
    if sensor is None:
        return ()
    if sensor.distance is not None and sensor.distance > FAR_ALONG:
        text = (
            f"location {sensor.location!r} says that {1e3 * sensor.distance:.0f} mm of line lie before the sensor, "
            f"expected {1e3 * FAR_ALONG:.0f} mm or less: waves up to there are not in the model, trigger angle and "
            "chamber pressure may be off by more than is stated; put the sensor at the pump's end of the line"
        )
        return (Finding("pressure_along_line", "warning", text, f"{config.path.name} [sensors.pressure]"),)
    if not config.measures_chamber:
        return ()
    text = (
        f"location {sensor.location!r} says that the pressure is that on the plunger: it is taken "
        "as it is, no chamber and no delivery valve are fitted; name the line where the sensor sits there"
    )
    return (Finding("pressure_in_chamber", "info", text, f"{config.path.name} [sensors.pressure]"),)


def _left_out(table: dict[str, Any]) -> Finding:
    text = f"the {table['quantity']} {table['channel']!r} is left out: used = false"
    return Finding("channel_left_out", "info", text, table["path"].name)


def _check_roles(config: RecordingConfig) -> None:
    problems = Problems()
    file, trigger = config.path, config.trigger
    for channel in config.channels:
        with problems.collecting():
            _check_channel(channel, config)
    names, where = {channel.quantity for channel in config.channels}, f"{file} [[channels]]"
    repeated = _repeated([f"{c.path.name} / {c.group} / {c.channel}" for c in config.channels], where)
    problems.texts += [f"{text}; one for each is expected: a file of one device has one logger" for text in repeated]
    pulses = [c for c in config.channels if c.quantity in PER_LOGGER]
    problems.texts += _repeated([f"{c.quantity} on {c.logger}" for c in pulses], where)
    problems.texts += _rivals(config)
    if not names & set(ANGLE_QUANTITIES):
        problems.texts.append(f"{file}: no channel has quantity 'trigger' (or {', '.join(ANGLE_QUANTITIES[1:])}); "
                              "without it there is no cam angle")  # fmt: skip
    problems.texts += _trigger_problems(trigger, names, file)
    problems.raise_any()


def _rivals(config: RecordingConfig) -> list[str]:
    """Tell quantities that several channels measure: one has to be chosen. Pulses may stand on every logger."""
    texts = []
    for quantity in dict.fromkeys(channel.quantity for channel in config.channels):
        rivals = [channel.channel for channel in config.channels if channel.quantity == quantity]
        if len(rivals) > 1 and quantity not in PER_LOGGER:
            shown = ", ".join(map(repr, rivals))
            texts.append(
                f"{config.path} [[channels]]: {len(rivals)} channels measure {quantity} ({shown}); write used = false "
                "under all but the one that counts"
            )
    return texts


def _trigger_problems(trigger: TriggerSpec, quantities: set[str], file: Path) -> list[str]:
    where, teeth, missing = f"{file} [trigger]", trigger.pulses_per_rev, trigger.missing_teeth
    texts = []
    if missing and missing >= teeth:
        texts.append(
            f"{where} missing_teeth: {missing} of {teeth} pulses per revolution are missing, expected fewer than "
            "pulses_per_rev, which counts the missing ones as if present; correct one of them"
        )
    if missing and trigger.double_tooth:
        texts.append(f"{where} double_tooth: a wheel has missing teeth or a double tooth, not both")
    if trigger.reference == "index" and "index" not in quantities:
        texts.append(f"{where} reference: is 'index', but no channel has quantity 'index'; add the channel")
    if "encoder_b" in quantities and "encoder_a" not in quantities:
        texts.append(f"{file} [[channels]]: encoder_b without encoder_a; add track A")
    return texts


def _check_channel(channel: ChannelSpec, config: RecordingConfig) -> None:
    where = f"{config.path} [[channels]] {channel.channel!r}"
    unit = channel.output_unit
    _, is_sensed = channel_factor(channel.quantity, unit, f"{where} unit")
    if channel.supply_channel:
        unit_factor(channel.unit, "voltage", f"{where} supply_channel: unit of the bridge")
    if CHANNEL_QUANTITIES[channel.quantity].is_pulse:
        return
    if channel.quantity not in config.sensors:
        if is_sensed:
            raise Refusal(f"{where}: measures {channel.quantity} in {unit} but there is no table "
                          f"[sensors.{channel.quantity}] that says what a volt means")  # fmt: skip
        return
    sensor = config.sensors[channel.quantity]
    if channel.sensor and sensor.serial and channel.sensor != sensor.serial:
        raise Refusal(
            f"{where}: sensor is {channel.sensor!r}, but [sensors.{channel.quantity}] has serial {sensor.serial!r}"
        )
    volts = sensor.zero_before_volts is not None or sensor.zero_after_volts is not None
    in_volts = BORDER_UNITS[tidy_unit(unit)][0] == "voltage"
    scaled = sensor.zero_before is not None or sensor.zero_after is not None
    if volts and not in_volts:
        raise Refusal(
            f"{where}: the channel is in {unit}, the zero of [sensors.{channel.quantity}] in V; give it as "
            f"zero_before, zero_after in {unit}"
        )
    if scaled and in_volts:
        raise Refusal(
            f"{where}: the channel is in {unit}, give the zero of [sensors.{channel.quantity}] as "
            "zero_before_V, zero_after_V"
        )


def _repeated(names: list[str], where: str) -> list[str]:
    """Tell the first of the names that repeat."""
    repeated = sorted({name for name in names if names.count(name) > 1})
    return [f"{where}: {name!r} is given more than once" for name in repeated[:1]]


def _unknown_keys(values: Mapping[str, Any], file: Path) -> list[Finding]:
    found = unknown_keys(values, ("schema", *RECORDING_TABLES), file.name)
    for name, schema in RECORDING_TABLES.items():
        for header, table in _tables_of(values.get(name, {}), name, schema).items():
            found += unknown_keys(table, schema.names, f"{file.name} {header}") if isinstance(table, dict) else []
    return found


def _tables_of(value: Any, name: str, schema: TableSchema) -> dict[str, Any]:
    """Return the tables of a name by header; what is no table, or no list of them, is refused where it is read."""
    if schema.many:
        tables = value if isinstance(value, list) else []
        return {f"[[{name}]] no. {number}": table for number, table in enumerate(tables, start=1)}
    if name == "sensors" and isinstance(value, dict):
        return {f"[sensors.{quantity}]": table for quantity, table in value.items()}
    return {f"[{name}]": value}


def unknown_keys(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> list[Finding]:
    """Return a finding for each key that is not known, with the nearest one that is."""
    return [
        Finding("unknown_key", "warning", f"key {key!r} is not known and not used{did_you_mean(key, known)}", where)
        for key in table
        if key not in known
    ]

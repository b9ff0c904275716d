"""The bench's ``recording.toml`` (schema ``fip-bench-recording/1``) -> `RecordingConfig`, in SI and radians.

A missing key, a wrong type or an impossible value is refused. A key that the product does not know is a finding:
benches add keys of their own. The product's optional keys are listed in `TABLES` beside the bench's.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from camtorque.config import ChannelSpec, LoggerSpec, PumpData, RecordingConfig, SensorRef, TriggerSpec
from camtorque.records import Finding, Refusal
from camtorque.toml_table import Table, read_toml
from camtorque.units import DEGREE, RPM, did_you_mean

SCHEMA = "fip-bench-recording/1"
FILE_NAME = "recording.toml"
QUANTITIES = ("torque", "pressure", "trigger")
SENSOR_QUANTITIES = ("torque", "pressure")
CLOCKS = ("single", "synchronised", "independent")
ROTATIONS = {"positive": 1, "negative": -1}
EDGES = ("rising", "falling")
FORMAT_ALIASES: dict[str, str] = {
    "csv": "csv",
    "ascii": "csv",
    "txt": "csv",
    "tdms": "tdms",
    "mf4": "mf4",
    "mdf4": "mf4",
    "hdf5": "hdf5",
    "h5": "hdf5",
    "mat": "mat",
    "catman": "catman",
}
"""``file_format`` of the bench -> name of the reader."""

TABLES: dict[str, tuple[str, ...]] = {
    "": ("schema", "recording", "pump", "trigger", "sensors", "loggers", "channels"),
    "recording": (
        "id",
        "pump_id",
        "nominal_speed_rpm",
        "file_format",
        "csv_dialect",
        "acquisition",
        "rotation",
        "note",
        "idle_from_s",
        "idle_to_s",
        "duration_s",
    ),
    "pump": (
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
        "cam_table",
        "cam_table_angle_column",
        "cam_table_lift_column",
        "poisson_ratio",
        "roller_mass_kg",
        "roller_inertia_kg_m2",
    ),
    "trigger": (
        "nominal_angle_deg",
        "installation_tolerance_deg",
        "meaning",
        "edge",
        "pulses_per_rev",
        "level_V",
        "switching_delay_typ_s",
        "missing_teeth",
        "double_tooth",
    ),
    "sensors": ("serial", "calibration", "location", "zero_before_V", "zero_after_V", "idle_from_s", "idle_to_s"),
    "loggers": ("id", "clock"),
    "channels": (
        "quantity",
        "file",
        "group",
        "channel",
        "unit",
        "logger",
        "sample_rate_hz",
        "sensor",
        "time_channel",
        "start_time_s",
        "duration_s",
    ),
}
"""Every key that the product reads, table by table; the test of the documentation reads this too."""


def load_recording_config(path: Path) -> RecordingConfig:
    """Read and check ``recording.toml``.

    Parameters
    ----------
    path : the recording's folder, or the TOML file itself

    Raises
    ------
    Refusal
        for a missing file or key, a wrong type, an impossible value, a channel without logger or sensor table
    """
    file = path / FILE_NAME if path.is_dir() else path
    text, values = read_toml(file, "a recording is a folder that holds recording.toml, or that file")
    root = Table(values, file, "")
    schema = root.text("schema")
    if schema != SCHEMA:
        raise Refusal(f"{file}: schema is {schema!r}, expected {SCHEMA!r}{did_you_mean(schema, (SCHEMA,))}")
    recording = root.table("recording")
    loggers = tuple(_logger(table) for table in root.tables("loggers"))
    _refuse_repeated([logger.id for logger in loggers], f"{file} [[loggers]] id")
    channels = tuple(_channel(table, loggers, recording) for table in root.tables("channels"))
    sensors = _sensors(root, recording)
    _check_roles(channels, sensors, file)
    return RecordingConfig(
        path=file,
        text=text,
        id=recording.text("id"),
        pump_id=recording.text("pump_id"),
        nominal_speed=recording.number("nominal_speed_rpm", above=0.0) * RPM,
        file_format=_file_format(recording),
        csv_dialect=recording.text("csv_dialect", ""),
        acquisition=recording.text("acquisition", ""),
        rotation=ROTATIONS[recording.choice("rotation", tuple(ROTATIONS))],
        note=recording.text("note", ""),
        pump=_pump(root.table("pump")),
        trigger=_trigger(root.table("trigger")),
        sensors=sensors,
        loggers=loggers,
        channels=channels,
        findings=tuple(_unknown_keys(values, file)),
    )


def _file_format(recording: Table) -> str:
    return FORMAT_ALIASES[recording.choice("file_format", tuple(FORMAT_ALIASES), lower=True)]


def _pump(table: Table) -> PumpData:
    return PumpData(
        base_circle_radius=table.number("base_circle_radius_m", above=0.0),
        roller_radius=table.number("roller_radius_m", above=0.0),
        roller_width=table.number("roller_width_m", above=0.0),
        follower_offset=table.number("follower_offset_m"),
        cam_mass=table.number("cam_mass_kg", above=0.0),
        cam_inertia=table.number("cam_inertia_kg_m2", above=0.0),
        follower_mass=table.number("follower_mass_kg", above=0.0),
        spring_stiffness=table.number("spring_stiffness_N_per_m", least=0.0),
        spring_preload=table.number("spring_preload_N", least=0.0),
        plunger_diameter=table.number("plunger_diameter_m", above=0.0),
        youngs_modulus_cam=table.number("youngs_modulus_cam_Pa", above=0.0),
        youngs_modulus_roller=table.number("youngs_modulus_roller_Pa", above=0.0),
        cam_table_path=table.path("cam_table"),
        cam_table_angle_column=table.text("cam_table_angle_column"),
        cam_table_lift_column=table.text("cam_table_lift_column"),
        poisson_ratio=table.number("poisson_ratio", default=0.3, above=0.0, below=0.5),
        roller_mass=table.optional_number("roller_mass_kg", above=0.0),
        roller_inertia=table.optional_number("roller_inertia_kg_m2", above=0.0),
    )


def _trigger(table: Table) -> TriggerSpec:
    pulses = table.integer("pulses_per_rev", least=1)
    missing = table.integer("missing_teeth", default=0, least=0)
    double = table.flag("double_tooth", False)
    if missing and missing >= pulses:
        raise Refusal(f"{table.where('missing_teeth')}: {missing} of {pulses} pulses per revolution are missing")
    if missing and double:
        raise Refusal(f"{table.where('double_tooth')}: a wheel has missing teeth or a double tooth, not both")
    return TriggerSpec(
        nominal_angle=table.number("nominal_angle_deg") * DEGREE,
        installation_tolerance=table.number("installation_tolerance_deg", least=0.0) * DEGREE,
        edge=table.choice("edge", EDGES),
        pulses_per_rev=pulses,
        level_volts=table.number("level_V"),
        switching_delay=table.number("switching_delay_typ_s", least=0.0),
        missing_teeth=missing,
        double_tooth=double,
    )


def _sensors(root: Table, recording: Table) -> Mapping[str, SensorRef]:
    tables = root.table("sensors", optional=True)
    return {quantity: _sensor(quantity, tables.table(quantity), recording) for quantity in tables.keys_of_tables()}


def _sensor(quantity: str, table: Table, recording: Table) -> SensorRef:
    if quantity not in SENSOR_QUANTITIES:
        hint = did_you_mean(quantity, SENSOR_QUANTITIES)
        raise Refusal(
            f"{table.file} [sensors.{quantity}]: unknown quantity{hint}; expected {', '.join(SENSOR_QUANTITIES)}"
        )
    idle = table if table.has("idle_from_s") or table.has("idle_to_s") else recording
    start, stop = idle.optional_number("idle_from_s", least=0.0), idle.optional_number("idle_to_s", above=0.0)
    if (start is None) != (stop is None) or (start is not None and stop is not None and stop <= start):
        raise Refusal(
            f"{idle.where('idle_to_s')}: an idle stretch needs idle_from_s < idle_to_s, found {start} and {stop}"
        )
    return SensorRef(
        quantity=quantity,
        serial=table.text("serial"),
        calibration_path=table.path("calibration"),
        zero_before_volts=table.optional_number("zero_before_V"),
        zero_after_volts=table.optional_number("zero_after_V"),
        location=table.text("location", ""),
        idle_from=start,
        idle_to=stop,
    )


def _logger(table: Table) -> LoggerSpec:
    return LoggerSpec(id=table.text("id"), clock=table.choice("clock", CLOCKS))


def _channel(table: Table, loggers: tuple[LoggerSpec, ...], recording: Table) -> ChannelSpec:
    duration = table.optional_number("duration_s", above=0.0)
    return ChannelSpec(
        quantity=table.choice("quantity", QUANTITIES),
        path=table.path("file"),
        group=table.text("group", ""),
        channel=table.text("channel"),
        unit=table.text("unit"),
        logger=table.choice("logger", tuple(logger.id for logger in loggers)),
        sample_rate=table.number("sample_rate_hz", above=0.0),
        sensor=table.text("sensor", ""),
        time_channel=table.text("time_channel", ""),
        start_time=table.optional_number("start_time_s"),
        duration=duration if duration is not None else recording.optional_number("duration_s", above=0.0),
    )


def _check_roles(channels: tuple[ChannelSpec, ...], sensors: Mapping[str, SensorRef], file: Path) -> None:
    for channel in channels:
        where = f"{file} [[channels]] {channel.channel!r}"
        if channel.quantity not in SENSOR_QUANTITIES:
            continue
        if channel.quantity not in sensors:
            raise Refusal(f"{where}: measures {channel.quantity} but there is no table [sensors.{channel.quantity}]")
        serial = sensors[channel.quantity].serial
        if channel.sensor != serial:
            raise Refusal(
                f"{where}: sensor is {channel.sensor!r}, but [sensors.{channel.quantity}] has serial {serial!r}"
            )
    _refuse_repeated([f"{c.path.name} / {c.group} / {c.channel}" for c in channels], f"{file} [[channels]]")
    _refuse_repeated([f"{c.quantity} on {c.logger}" for c in channels], f"{file} [[channels]]")
    if not any(channel.quantity == "trigger" for channel in channels):
        raise Refusal(f"{file}: no channel has quantity 'trigger'; without it there is no cam angle")


def _refuse_repeated(names: list[str], where: str) -> None:
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise Refusal(f"{where}: {repeated[0]!r} is given more than once")


def _unknown_keys(values: Mapping[str, Any], file: Path) -> list[Finding]:
    found = _unknown_in(values, "", file.name)
    for name in ("recording", "pump", "trigger"):
        found += _unknown_in(values.get(name, {}), name, f"{file.name} [{name}]")
    for quantity, table in values.get("sensors", {}).items():
        found += _unknown_in(table, "sensors", f"{file.name} [sensors.{quantity}]")
    for name in ("loggers", "channels"):
        for number, table in enumerate(values.get(name, ()), start=1):
            found += _unknown_in(table, name, f"{file.name} [[{name}]] no. {number}")
    return found


def _unknown_in(table: Mapping[str, Any], name: str, where: str) -> list[Finding]:
    known = TABLES[name]
    return [
        Finding("unknown_key", "warning", f"key {key!r} is not known and not used{did_you_mean(key, known)}", where)
        for key in table
        if key not in known
    ]

"""A folder with recording.toml -> `Recording`: channels by name, volts to SI, every contradiction said or refused."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime, time
from pathlib import Path

import numpy as np

from camtorque.config import ChannelSpec, RecordingConfig, SensorRef
from camtorque.config.quantities import SHEET_NEEDED, channel_factor
from camtorque.config.recording import load_recording_config
from camtorque.config.tables import Problems
from camtorque.hashes import input_files
from camtorque.ingest.cam_table import read_cam_table
from camtorque.ingest.formats import FORMATS, declared_format, file_format
from camtorque.ingest.plausibility import check_loads, check_trigger, check_trigger_exchanged, extent
from camtorque.ingest.pump_sizes import check_pump
from camtorque.ingest.raw import RawChannel, RawFile
from camtorque.ingest.repeated import without_repeats
from camtorque.ingest.sensitivity import over_supplies, with_supplies
from camtorque.ingest.sensors import FIRST_STAMP, Sensor, certificate_age, read_sensor
from camtorque.ingest.starts import starts, time_findings
from camtorque.ingest.table_file import commented_rows
from camtorque.ingest.zeros import with_idle_zero
from camtorque.records import CamTable, Channel, Finding, Recording, Refusal, SensorCalibration
from camtorque.signal.running import percentile
from camtorque.units import ATMOSPHERE, UNIT_OFFSETS, absolute_unit, is_known_unit, tidy_unit

LEAST_IDLE_SAMPLES = 100
SPAN_SAMPLES = 1_000_000
"""Samples looked at for the range of a channel whose sheet states none."""
STRAY = 2.0
"""A few samples beyond so many times all others are no part of the range, of which the accuracy is a share."""
DURATION_TOLERANCE = 1.0e-4
"""Relative difference from a declared duration that a crystal may cause."""


def read_recording(path: Path) -> Recording:
    """Return one recording: channels in the order of recording.toml, whose samples are read when asked for, in SI.

    Raises
    ------
    Refusal : one line that says what is wrong, where, and what to do
    """
    return recording_of(load_recording_config(Path(path)))


def recording_of(config: RecordingConfig) -> Recording:
    """Read the recording that a configuration describes; see `read_recording`."""
    problems, cam_table, cam_findings = Problems(), None, tuple[Finding, ...]()
    if config.pump_sheet is not None:
        with problems.collecting():
            cam_table, cam_findings = read_cam_table(config.pump)
    raw, file_findings = _read_files(config, problems)
    sensors = read_sensors(config, raw, problems)
    problems.raise_any()
    begun = starts(config, raw)
    read = [_channel(config, spec, raw[spec], begun[spec], sensors.get(spec.quantity)) for spec in config.channels]
    channels = tuple(channel for channel, _ in read)
    files = [config.path, *([config.pump.cam_table_path] if config.pump_sheet is not None else [])]
    files += [file for sensor in sensors.values() for file in sensor.files]
    files += [spec.path for spec in config.channels]
    recording = Recording(
        config=_dated(config, raw.values()),
        channels=channels,
        lift_table=cam_table,
        inputs=input_files(*files),
        findings=(
            *config.findings,
            *cam_findings,
            *(finding for sensor in sensors.values() for finding in sensor.findings),
            *_without_repeats(
                *file_findings, *(row for _, rows in read for row in rows), *time_findings(config, raw, channels)
            ),
            *_other_run(config),
        ),
    )
    check_trigger_exchanged(recording)
    try:
        plausible = [*_plausible(config, cam_table), *check_loads(recording)]
    except Refusal as refusal:
        raise _of_damaged(refusal, file_findings) from None
    return replace(recording, findings=(*recording.findings, *plausible))


def _of_damaged(refusal: Refusal, findings: Iterable[Finding]) -> Refusal:
    """Return a refusal of what numbers say behind the damage of their files: half a log contradicts any sheet."""
    damaged = [f"{finding.where}: {finding.text}" for finding in findings if finding.severity == "error"]
    return Refusal(f"{damaged[0]}; with what is left of it: {refusal}") if damaged else refusal


def _dated(config: RecordingConfig, raw: Iterable[RawChannel]) -> RecordingConfig:
    """Return the configuration with the day that the logs state, where it states none."""
    stamps = [channel.stamp for channel in raw if channel.stamp is not None and channel.stamp >= FIRST_STAMP]
    if config.date is not None or not stamps:
        return config
    return replace(config, date=datetime.fromtimestamp(min(stamps), UTC).date())


def _plausible(config: RecordingConfig, table: CamTable | None) -> list[Finding]:
    """Hold the numbers of the pump against each other and the trigger against the lift table."""
    if table is None:
        return []
    problems, findings = Problems(), _other_pump(config)
    with problems.collecting():
        findings += check_pump(config.pump, table, config.rotation, config.path)
    with problems.collecting():
        findings += check_trigger(config, table)
    problems.raise_any()
    return findings


def _other_pump(config: RecordingConfig) -> list[Finding]:
    """Tell a lift table whose file name or comment names another pump of the same series (FIP-B for FIP-A)."""
    series, mark, _ = config.pump_id.rpartition("-")
    if not mark or not series:
        return []
    lift_table = config.pump.cam_table_path
    text = f"{lift_table.stem} {commented_rows(lift_table, 'a lift table')[0]}".replace("_", " ")
    named = re.findall(rf"(?<!\w){re.escape(series)}-\w+", text)
    if not named or config.pump_id in named:
        return []
    said = f"the lift table names pump {named[0]}, recording.toml is about {config.pump_id}"
    return [Finding("lift_table_of_other_pump", "warning", said, lift_table.name)]


def _other_run(config: RecordingConfig) -> list[Finding]:
    """Tell logs whose file name holds the number of another recording of the same series (run_016 for run_017)."""
    series = re.fullmatch(r"(.*[A-Za-z].*?)(\d+)(\D*)", config.id)
    if series is None:
        return []
    pattern = re.compile(rf"(?<!\w){re.escape(series[1])}(\d+){re.escape(series[3])}")
    found = []
    for path in dict.fromkeys(spec.path for spec in config.channels):
        named = {match[1] for match in pattern.finditer(path.stem)}
        if named and series[2] not in named:
            other = f"{series[1]}{min(named)}{series[3]}"
            text = f"the file's name says {other}, recording.toml is about {config.id}: it may be of another run"
            found.append(Finding("log_of_other_run", "warning", text, path.name))
    return found


def _without_repeats(*findings: Finding) -> tuple[Finding, ...]:
    """Drop findings that channels of one file repeat word for word."""
    return tuple({(finding.code, finding.text): finding for finding in reversed(findings)}.values())[::-1]


def _read_files(config: RecordingConfig, problems: Problems) -> tuple[dict[ChannelSpec, RawChannel], list[Finding]]:
    """Read each file once for all its channels."""
    declared = declared_format(config.file_format, str(config.path))
    raw: dict[ChannelSpec, RawChannel] = {}
    findings: list[Finding] = []
    files = dict.fromkeys(spec.path for spec in config.channels)
    for file in files:
        with problems.collecting():
            form = FORMATS[file_format(file, declared, files)]
            specs = tuple(spec for spec in config.channels if spec.path == file)
            result: RawFile = form.read(file, with_supplies(specs), config.csv_dialect)
            findings += result.findings
            for spec, channel in zip(specs, over_supplies(specs, result.channels), strict=True):
                raw[spec] = channel
                if spec.quantity != "trigger":  # whose edges are few and steep
                    raw[spec], repeated = without_repeats(channel, f"{file.name} {spec.channel}")
                    findings += repeated
    return raw, findings


def read_sensors(
    config: RecordingConfig, raw: Mapping[ChannelSpec, RawChannel], problems: Problems
) -> dict[str, Sensor]:
    """Return the sensor of each quantity that has one, or whose delay and accuracy the model needs."""
    sensors = {}
    for spec in config.channels:
        reference = config.sensors.get(spec.quantity)
        if reference is None and spec.quantity in SHEET_NEEDED:
            reference = SensorRef(spec.quantity, spec.sensor, None, None, None)
        if reference is not None and spec.quantity not in sensors:
            with problems.collecting():
                span = math.nan
                if spec in raw:
                    scale, _ = _scale(spec)
                    span = _span(raw[spec], scale) if reference.calibration_path is None else span
                sensors[spec.quantity] = read_sensor(reference, spec.output_unit, span)
    return sensors


def _span(raw: RawChannel, scale: float) -> float:
    """Return the largest value of a channel that is no stray one [SI], as far as its first samples tell."""
    values = np.abs(raw.source.read(0, min(raw.source.n_samples, SPAN_SAMPLES)))
    values = values[np.isfinite(values)]
    if not values.size:
        return 0.0
    # a stroke is above half of its peak for more than two degrees
    top, usual = float(values.max()), percentile(values, 99.5)
    return scale * (top if top <= STRAY * usual or not usual else usual)


def _channel(
    config: RecordingConfig, spec: ChannelSpec, raw: RawChannel, start: float, sensor: Sensor | None
) -> tuple[Channel, list[Finding]]:
    name, findings, unit = config.name_of(spec), list[Finding](), tidy_unit(spec.unit)
    where = f"{spec.path.name} {name}"
    scale, is_volts = _scale(spec)
    if raw.unit.strip("-") and not is_known_unit(raw.unit) and absolute_unit(raw.unit) != unit:
        text = f"the file's unit {raw.unit!r} is not known; {spec.unit!r} of recording.toml is used"
        findings.append(Finding("unit_unknown", "warning", text, where))
    calibration, reference = None, config.sensors.get(spec.quantity)
    if sensor is not None:
        calibration = sensor.calibration
        noon = None if config.date is None else datetime.combine(config.date, time(12), UTC)
        findings += certificate_age(sensor, raw.stamp if noon is None else noon.timestamp(), where)
    elif unit in UNIT_OFFSETS:
        calibration = SensorCalibration(spec.quantity, spec.sensor, zero_volts=-UNIT_OFFSETS[unit], zero_source="unit")
    if sensor is not None and not is_volts:
        text = f"values are in {spec.unit!r}; the gain is the logger's"
        findings.append(Finding("already_scaled", "info", text, where))
    if absolute_unit(raw.unit) and calibration is not None and calibration.zero_volts < 0.5 * ATMOSPHERE:
        text = (
            f'the file says {raw.unit!r}, which counts from vacuum; give reference = "absolute" in its sensor table, '
            "or in the sheet that this names"
        )
        findings.append(Finding("pressure_is_absolute", "warning", text, where))
    if calibration is not None and reference is not None and reference.idle_from is not None:
        calibration = _idle_zero(calibration, reference, raw, scale, where)
    channel = Channel(
        spec.quantity, spec.logger, raw.source, start, raw.sample_rate, calibration, spec.path, name,
        scale=scale, sign=-1.0 if spec.quantity == "torque" and config.rotation < 0 else 1.0,
        breaks=raw.breaks, break_steps=raw.break_steps,
    )  # fmt: skip
    expected = spec.duration
    allowed = max(1.5 / raw.sample_rate, DURATION_TOLERANCE * (expected or 0.0))
    if expected is not None and abs(channel.duration - expected) > allowed:
        text = f"{channel.duration:.4f} s are there, recording.toml declares {expected:.4f} s"
        findings.append(Finding("duration_differs", "error", text, where))
    return channel, findings


def _scale(spec: ChannelSpec) -> tuple[float, bool]:
    """Return the factor to volts (or to SI for values that are scaled already), and whether they are volts."""
    return channel_factor(spec.quantity, spec.output_unit, f"{spec.path} {spec.channel!r} unit")


def _idle_zero(
    calibration: SensorCalibration, reference: SensorRef, raw: RawChannel, scale: float, where: str
) -> SensorCalibration:
    """Return the calibration with its zero from the marked idle stretch."""
    assert reference.idle_from is not None  # checked with the configuration
    assert reference.idle_to is not None
    start, stop = (round(t * raw.sample_rate) for t in (reference.idle_from, reference.idle_to))
    stop = min(stop, raw.source.n_samples)
    values = raw.source.read(start, stop) * scale
    values = values[np.isfinite(values)]
    stretch = f"{where}: the idle stretch {reference.idle_from:g}..{reference.idle_to:g} s"
    if values.size < LEAST_IDLE_SAMPLES:
        raise Refusal(f"{stretch} holds {values.size} samples, expected at least {LEAST_IDLE_SAMPLES}")
    return with_idle_zero(calibration, values, extent(raw.source) * abs(scale), stretch)

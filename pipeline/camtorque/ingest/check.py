"""What a recording holds and what is wrong with it, without a model: `camtorque check`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from camtorque.config import RecordingConfig
from camtorque.config.quantities import LIQUID_C
from camtorque.records import Array, Channel, Finding, Recording, Refusal, SensorCalibration
from camtorque.signal.damage import SPIKE_TIMES_BESIDE, Scan, scan_channel
from camtorque.signal.edges import without_bounces
from camtorque.signal.inductive import find_pulses
from camtorque.signal.logger_time import pause_intervals
from camtorque.signal.marks import uneven_marks
from camtorque.units import BAR, DEGREE, RPM, ZERO_CELSIUS, counted, short

VACUUM = -1.5 * BAR
"""Gauge pressure that no liquid line keeps up [Pa]."""
VACUUM_SHARE = 0.005
"""Room below it for zero, noise and steps of the converter, as a share of the sensor's range."""
STRAY, BLOCK = 3, 1 << 20
"""Samples below it that are strays and tell nothing of the line, and how many are looked at together."""
SPEED_TOLERANCE = 0.1
"""Relative difference of pulse count and nominal speed that is worth a finding."""
PERIOD_TOLERANCE = 0.3
"""A pulse period that differs by this share from the usual one is a missed or an extra pulse."""
MUCH_CLIPPED = 1.0e-4
BEYOND_RANGE, FAR_BEYOND_RANGE = 0.01, 0.1
"""Share of a sensor's range by which values go beyond it that is told, and that no sensor gives."""
SHAPED, COARSE_DEG = ("torque", "pressure"), 4.0
"""Channels whose shape within the revolution counts, and the degrees of cam angle between samples that lose it: 3 leave
the chamber peak of `A_1000rpm` at 1395 bar, 5 move it to 1471."""
SAME_ANGLE, OTHER_TURNS, LEAST_TURNS = 1.5 / 360.0, (-3, -2, -1, 1, 2, 3), 3
"""A sample is held against what the signal does so near to it [turns] in so many other turns."""


@dataclass(frozen=True)
class ChannelSummary:
    """One channel in a few numbers; ``low``, ``high`` in SI (volts for the trigger)."""

    quantity: str
    name: str
    file: str
    logger: str
    sample_rate: float
    n_samples: int
    start_time: float
    duration: float
    low: float
    high: float
    scan: Scan
    pulses: int = 0


@dataclass(frozen=True)
class RecordingSummary:
    """What `check` shows: the recording's channels, the speed that the pulses tell [rpm], and all findings."""

    id: str
    file_format: str
    channels: tuple[ChannelSummary, ...]
    speed_rpm: float
    findings: tuple[Finding, ...]


def summarise(recording: Recording, pulses: Mapping[str, Array] = MappingProxyType({})) -> RecordingSummary:
    """Look at every sample and sum up; ``pulses`` are those that `CamCycles` knows: others are looked for."""
    config: RecordingConfig = recording.config
    findings = list(recording.findings)
    summaries, speeds, trains = [], [], {}
    first_triggers = {channel.logger: channel for channel in reversed(recording.of("trigger"))}
    units = {(spec.quantity, config.name_of(spec)): spec.output_unit for spec in config.channels}
    for channel in recording.channels:
        scan = scan_channel(channel)
        findings += _sample_findings(channel, scan, units.get((channel.quantity, channel.name), ""))
        times = np.empty(0)
        if channel.quantity == "trigger" and not scan.is_constant:
            known = pulses.get(channel.logger) if channel is first_triggers[channel.logger] else None
            times, more = _pulses(channel, config, known)
            findings += more
            speeds.append(_speed(times, config))
            trains[channel.logger] = times
        summaries.append(_summary(channel, scan, times.size))
    for channel, row in zip(recording.channels, summaries, strict=True):
        findings += [*_isolated(channel, row.scan, trains, config), *_not_liquid(row)]
    findings += _swapped(recording, summaries)
    speed = float(np.nanmedian(speeds)) if np.isfinite(speeds).any() else float("nan")
    findings += [row for quantity in SHAPED for channel in recording.of(quantity) for row in _coarse(channel, speed)]
    return RecordingSummary(config.id, config.file_format, tuple(summaries), speed / RPM, tuple(findings))


def _not_liquid(row: ChannelSummary) -> list[Finding]:
    """Tell a temperature of the fuel at which none is liquid."""
    low, high = row.low - ZERO_CELSIUS, row.high - ZERO_CELSIUS
    if row.quantity != "fuel_temperature" or not (low < LIQUID_C[0] or high > LIQUID_C[1]):
        return []
    text = (
        f"the fuel reads {low:.4g} to {high:.4g} degC, expected {LIQUID_C[0]:g} to {LIQUID_C[1]:g}: what lies outside "
        "is not used; check the sensor, its cable and its unit"
    )
    return [Finding("temperature_not_of_liquid", "error", text, f"{row.file} {row.name}")]


def _coarse(channel: Channel, speed: float) -> list[Finding]:
    """Tell samples that lie too far apart for the cam's speed [rad/s] or for the low-pass before them."""
    rate, apart = channel.sample_rate, speed / channel.sample_rate / DEGREE
    cutoff = channel.calibration.cutoff_hz if channel.calibration else float("nan")
    if apart > COARSE_DEG:
        text = (
            f"the samples lie {apart:.1f} degrees of cam angle apart, in which a delivery begins or ends: its shape is "
            f"lost; sample at {short(rate * apart / COARSE_DEG, 2)} Hz or more"
        )
    elif rate < cutoff:
        text = (
            f"sampled at {rate:g} Hz behind a low-pass of {cutoff:g} Hz: what is faster than {rate / 2.0:g} Hz comes "
            f"through as something slow; sample at {2.0 * cutoff:g} Hz or more"
        )
    else:
        return []
    return [Finding("sampled_coarsely", "warning", text, f"{channel.path.name} {channel.name}")]


def _pulses(channel: Channel, config: RecordingConfig, known: Array | None) -> tuple[Array, list[Finding]]:
    """Return the pulse times of a trigger [s], and what is to be said of them."""
    try:
        times = find_pulses(channel, config.trigger.sensor, config.trigger.edge).time if known is None else known
    except Refusal as refusal:
        return np.empty(0), [Finding("few_pulses", "error", str(refusal))]
    if config.trigger.pulses_per_rev == 1 and not config.trigger.double_tooth:
        times, _ = without_bounces(times)
    return times, _pulse_findings(channel, times, config)


def _summary(channel: Channel, scan: Scan, pulses: int) -> ChannelSummary:
    ends = np.array([scan.low, scan.high])
    if channel.calibration is not None:
        ends = channel.sign * channel.calibration.gain * (ends - channel.calibration.zero_volts)
    return ChannelSummary(
        quantity=channel.quantity,
        name=channel.name,
        file=channel.path.name,
        logger=channel.logger,
        sample_rate=channel.sample_rate,
        n_samples=channel.n_samples,
        start_time=channel.start_time,
        duration=channel.duration,
        low=float(ends.min()),
        high=float(ends.max()),
        scan=scan,
        pulses=pulses,
    )


def _sample_findings(channel: Channel, scan: Scan, unit: str) -> list[Finding]:
    """Return what is odd about the samples; values are told in the unit of the log, whether volts or scaled already."""
    where = f"{channel.path.name} {channel.name}"
    found = []
    if scan.missing:
        text = (
            f"{counted(scan.missing, 'sample is', 'samples are')} missing, the longest run has {scan.longest_missing}"
        )
        every = scan.longest_missing + 1
        if scan.missing == scan.n_samples - math.ceil(scan.n_samples / every):
            text += f": one in {every} holds a value; write sample_rate_hz = {channel.sample_rate / every:g}"
        found.append(Finding("samples_not_numbers", "warning", text, where))
    if scan.is_constant:
        value = f"{scan.low / channel.scale:g} {unit}".strip()
        text = f"the channel never changes ({value}); is the sensor connected?"
        if math.isnan(scan.low):
            text = "the channel holds no number at all; is it the right column, and exported as numbers?"
        return [*found, Finding("channel_constant", "error", text, where)]
    clipped = scan.clipped_low + scan.clipped_high
    if channel.quantity != "trigger" and clipped > MUCH_CLIPPED * scan.n_samples:
        share = 100.0 * clipped / scan.n_samples
        text = f"{clipped} samples ({share:.2g} %) stand at the lowest or highest value in flat runs: clipped"
        found.append(Finding(f"{channel.quantity}_clipped", "warning", text, where))
    calibration = channel.calibration
    if calibration is None:
        return found
    return [*found, *_beyond_range(channel, calibration, scan, unit)]


def _beyond_range(channel: Channel, calibration: SensorCalibration, scan: Scan, unit: str) -> list[Finding]:
    """Return a finding on values beyond the range of the sensor: far, or so far that its sheet tells nothing."""
    span = calibration.output_max_volts - calibration.output_min_volts
    beyond = max(scan.high - calibration.output_max_volts, calibration.output_min_volts - scan.low)
    if not beyond > BEYOND_RANGE * span:
        return []
    low, high, least, most = (
        volts / channel.scale
        for volts in (scan.low, scan.high, calibration.output_min_volts, calibration.output_max_volts)
    )
    seen, where = f"{low:.4g} to {high:.4g} {unit}".strip(), f"{channel.path.name} {channel.name}"
    if beyond > FAR_BEYOND_RANGE * span:
        text = f"{seen}, the sensor gives {least:g} to {most:g}; wrong unit, or samples damaged"
        return [Finding("out_of_range", "error", text, where)]
    if calibration.saturates and scan.high - calibration.output_max_volts < beyond:
        return []  # below the lower end of an amplifier lies its zero's error
    named = "output range of its sheet" if calibration.saturates else "nominal range"
    text = f"{seen}, the {named} is {least:g} to {most:g}: beyond it nothing states how good the sensor is"
    return [Finding("beyond_nominal_range", "warning", text, where)]


def _isolated(channel: Channel, scan: Scan, trains: Mapping[str, Array], config: RecordingConfig) -> list[Finding]:
    """Return a warning on samples that stand out, but for where the signal bends like that at any turn."""
    times = trains.get(channel.logger, next(iter(trains.values()), np.empty(0)))
    pulses = times[:: max(round(_expected(config)), 1)]
    at = list(scan.isolated_at)
    if channel.quantity != "trigger":  # whose edges recur
        at = [place for place in at if not _bends_there(channel, place, pulses)]
    if not at:
        return []
    count = f"{len(at)}{' or more' if scan.isolated > len(scan.isolated_at) else ''}"
    text = f"samples that stand out from both neighbours: {count}, the first is no. {at[0]}"
    return [Finding("isolated_samples", "warning", text, f"{channel.path.name} {channel.name}")]


def _bends_there(channel: Channel, place: int, pulses: Array) -> bool:
    """Tell whether a channel bends as it does at a sample at the same angle of turns before and after, too."""
    if pulses.size < LEAST_TURNS:
        return False
    pulses = np.r_[2.0 * pulses[0] - pulses[1], pulses, 2.0 * pulses[-1] - pulses[-2]]  # a log goes on beyond them
    turn = np.interp(channel.start_time + place / channel.sample_rate, pulses, np.arange(pulses.size))
    turns = turn + np.array(OTHER_TURNS)
    times = np.interp(turns[:, None] + np.array([-SAME_ANGLE, SAME_ANGLE]), np.arange(pulses.size), pulses)
    ends = np.round((times - channel.start_time) * channel.sample_rate).astype(np.int64)
    inside = (turns >= 0.0) & (turns <= pulses.size - 1.0) & (ends[:, 0] > 0) & (ends[:, 1] < channel.n_samples - 1)
    usual = max((_largest_bend(channel, first, last) for first, last in ends[inside]), default=0.0)
    return _largest_bend(channel, place, place) < float(SPIKE_TIMES_BESIDE) * usual


def _largest_bend(channel: Channel, first: int, last: int) -> float:
    """Return how far a sample from ``first`` to ``last`` lies off the middle of its neighbours, at most [V]."""
    volts = channel.read_volts(max(first - 1, 0), min(last + 2, channel.n_samples))
    bends = np.abs(volts[1:-1] - 0.5 * (volts[:-2] + volts[2:]))
    return float(np.max(bends[np.isfinite(bends)], initial=0.0))


def _expected(config: RecordingConfig) -> float:
    """Return pulses per turn of the cam as they show: missing teeth left out, a double tooth added."""
    trigger = config.trigger
    shown = trigger.pulses_per_rev - trigger.missing_teeth + int(trigger.double_tooth)
    return shown * trigger.revolutions_per_cycle


def _speed(times: Array, config: RecordingConfig) -> float:
    """Return the cam's speed [rad/s], nan where nothing tells it.

    Where each period is a turn it is told by the usual ones: pulses may be missing.
    """
    if times.size < 2:
        return float("nan")
    periods = np.diff(times)
    ratio, trigger = periods / np.median(periods), config.trigger
    if trigger.pulses_per_rev == 1:
        periods = periods[np.abs(ratio - 1.0) <= PERIOD_TOLERANCE]
    else:  # a clock that jumps by an hour is no hour of running
        periods = periods[(ratio > 0.0) & (ratio < trigger.pulses_per_rev)]
    return float(2.0 * np.pi / np.mean(periods) / _expected(config)) if periods.size else float("nan")


def speed_findings(
    speed: float, config: RecordingConfig, where: str, teller: str = "the pulses give"
) -> tuple[Finding, ...]:
    """Tell a cam speed [rad/s] that is far from the nominal one: of pulses that are not one a turn, or a wrong rate."""
    if abs(speed / config.nominal_speed - 1.0) <= SPEED_TOLERANCE:
        return ()
    text = (
        f"{teller} {speed / RPM:.4g} rpm, the nominal speed is {config.nominal_speed / RPM:.4g} rpm; check "
        "nominal_speed_rpm, pulses_per_rev, and sample_rate_hz where no file states it: all times rest on it"
    )
    return (Finding("speed_off_nominal", "warning", text, where),)


def angle_speed_findings(recording: Recording, speed: float) -> tuple[Finding, ...]:
    """Tell a cam speed [rad/s] far from the nominal one where an angle was recorded, which has no pulses to tell it."""
    return tuple(
        row
        for channel in recording.of("angle")
        for row in speed_findings(
            speed, recording.config, f"{channel.path.name} {channel.name}", "angle and sample_rate_hz give"
        )
    )


def _pulse_findings(channel: Channel, times: Array, config: RecordingConfig) -> list[Finding]:
    where = f"{channel.path.name} {channel.name}"
    speed = _speed(times, config)
    marks = uneven_marks(times) if config.trigger.pulses_per_rev == 1 else ""
    if not np.isfinite(speed):
        why = marks or "check the sensor and its threshold, and how many marks pass it in a turn"
        text = (
            f"none of the {times.size - 1} periods between the trigger pulses is within "
            f"{100.0 * PERIOD_TOLERANCE:.0f} % of their median, expected one pulse per turn: {why}"
        )
        return [Finding("pulses_irregular", "error", text, where)]
    found = [*speed_findings(speed, config, where)]
    if config.trigger.pulses_per_rev == 1:
        period = np.diff(times)
        whole = np.ones(period.size, dtype=bool)
        paused = np.searchsorted(times, pause_intervals(channel)[:, 0]) - 1
        whole[paused[(paused >= 0) & (paused < whole.size)]] = False
        odd = int((np.abs(period / np.median(period) - 1.0) > PERIOD_TOLERANCE)[whole].sum())
        if odd:
            text = f"{odd} of {period.size} pulse periods differ by more than 30 % from the usual one"
            text += f": {marks}" if marks else ""
            found.append(Finding("pulses_irregular", "warning", text, where))
    return found


def least_pressure(recording: Recording) -> float:
    """Return the gauge pressure that no line goes below, with room for the errors of the sensor [Pa]."""
    ends = [channel.calibration.range_max for channel in recording.of("pressure") if channel.calibration is not None]
    return VACUUM - VACUUM_SHARE * max((end for end in ends if np.isfinite(end)), default=0.0)


def _below(channel: Channel, limit: float) -> int:
    """Return how many samples of a channel lie below a limit [SI]."""
    blocks = (channel.read_volts(first, first + BLOCK) for first in range(0, channel.n_samples, BLOCK))
    return sum(int(np.count_nonzero(channel.from_volts(volts) < limit)) for volts in blocks)


def _swapped(recording: Recording, summaries: list[ChannelSummary]) -> list[Finding]:
    """Find swapped torque and pressure: a line has no deep vacuum, and a cam drives back."""
    by_quantity = {summary.quantity: summary for summary in summaries}
    torque, pressure = by_quantity.get("torque"), by_quantity.get("pressure")
    least = least_pressure(recording)
    if pressure is None or pressure.low > least:
        return []
    if all(_below(channel, least) <= STRAY for channel in recording.of("pressure")):
        return []
    where = f"{pressure.file} {pressure.name}"
    text = f"pressure goes down to {pressure.low / BAR:.3g} bar gauge, which no line can hold"
    if torque is not None and torque.low > -0.02 * max(abs(torque.high), 1e-9):
        text += f", and torque never goes below {torque.low:.3g} N m: torque and pressure seem to be swapped"
        return [Finding("channels_swapped", "error", text, where)]
    return [Finding("pressure_below_vacuum", "error", text, where)]

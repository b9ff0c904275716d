"""Columns with names and units, from a text, a spreadsheet or a columnar file: find them, and find their time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.ingest.csv_layout import MAYBE_TIME, TIME_NAME, CsvLayout
from camtorque.ingest.raw import FileChannel, RawChannel, RawFile
from camtorque.ingest.timebase import TimeBase, agreed_rate, time_base
from camtorque.records import Finding, Refusal, SampleSource
from camtorque.units import did_you_mean, unit_factor

SECONDS = (500.0, 5.0e5)
"""A time without a unit is in seconds where that gives such a rate: milliseconds would be 500 kHz and more [Hz]."""
RATE_SAMPLES = 10_000
"""Time stamps looked at to tell the rate of a file that nobody has described yet."""


def raw_file(
    path: Path, layout: CsvLayout, sources: Mapping[int, SampleSource], specs: tuple[ChannelSpec, ...]
) -> RawFile:
    """Return the channels of columns that were read; ``sources`` holds them by number, the time column too."""
    time_column = time_column_of(path, layout, specs)
    channels: list[RawChannel] = []
    findings: list[Finding] = []
    for number, spec in enumerate(specs):
        column = column_of(path, layout, spec.channel)
        base, stamp = _times(path, layout, sources, time_column, spec)
        raw = RawChannel(
            spec.channel, layout.units[column], sources[column], base.start, base.rate, stamp, base.breaks,
            base.break_steps,
        )  # fmt: skip
        channels.append(raw)
        findings += base.findings if number == 0 else ()
    return RawFile(tuple(channels), tuple(findings))


def time_column_of(path: Path, layout: CsvLayout, specs: tuple[ChannelSpec, ...]) -> int | None:
    """Return the number of the time column, None where there is none.

    Raises
    ------
    Refusal : recording.toml names one that is not there
    """
    column = layout.time_column(specs[0].time_channel, tuple(spec.channel for spec in specs))
    if specs[0].time_channel and column is None:
        shown = ", ".join(layout.names)
        raise Refusal(f"{path}: no time column {specs[0].time_channel!r}; the columns are {shown}")
    return column


def listed(path: Path, layout: CsvLayout, sources: Mapping[int, SampleSource]) -> tuple[FileChannel, ...]:
    """Return every column but the time as a channel; the time's usual step tells the rate."""
    time = layout.time_column("")
    rate = layout.header_rate
    if time is not None:
        unit = layout.units[time]
        rate = usual_rate(sources[time], unit_factor(unit, "time", f"{path} time") if unit else 1.0)
        if not unit and not layout.stamp_kind(time) and not (rate and SECONDS[0] <= rate <= SECONDS[1]):
            rate = None  # seconds or milliseconds: a person has to say
    return tuple(
        FileChannel("", layout.names[number], layout.units[number], source.n_samples, rate, "", source)
        for number, source in sources.items()
        if number != time and layout.names[number]
    )


def with_times(found: list[FileChannel]) -> tuple[FileChannel, ...]:
    """Return channels with the rate of the time channel beside them, by name and length, where they have none."""
    times = {
        (item.group, item.n_samples): item
        for item in reversed(found)
        if TIME_NAME.match(item.name) or MAYBE_TIME.match(item.name)
    }
    listed_channels = []
    for item in found:
        time = times.get((item.group, item.n_samples))
        if item in times.values():
            continue
        if item.sample_rate is None and time is not None:
            item = replace(item, sample_rate=usual_rate(time.source), time_channel=time.name)
        listed_channels.append(item)
    return tuple(listed_channels)


def usual_rate(times: SampleSource, to_seconds: float = 1.0) -> float | None:
    """Return the sampling rate that stamps tell [Hz], None where they do not run forward."""
    stamps = times.read(0, min(times.n_samples, RATE_SAMPLES))
    stamps = stamps[np.isfinite(stamps)]
    span = (stamps[-1] - stamps[0]) * to_seconds if stamps.size > 1 else 0.0
    return float((stamps.size - 1) / span) if span > 0.0 else None


def column_of(path: Path, layout: CsvLayout, name: str) -> int:
    """Return the number of a column by its name, or refuse with the names that there are."""
    count = layout.names.count(name)
    if count == 1:
        return layout.names.index(name)
    shown = ", ".join(layout.names)
    if count:
        raise Refusal(f"{path}: {count} columns are named {name!r}; rename them, the columns are {shown}")
    raise Refusal(f"{path}: no column {name!r}{did_you_mean(name, layout.names)}; the columns are {shown}")


def _times(
    path: Path, layout: CsvLayout, sources: Mapping[int, SampleSource], column: int | None, spec: ChannelSpec
) -> tuple[TimeBase, float | None]:
    """Return the time base of a channel, and its date where the file has stamps."""
    where = path.name
    findings: tuple[Finding, ...] = ()
    if layout.header_rate is not None:
        rate, findings = agreed_rate(layout.header_rate, spec.sample_rate, where, 1e-9, "the header says")
    if column is None:
        rate = layout.header_rate or spec.sample_rate
        return TimeBase(spec.start_time or layout.start or 0.0, rate, findings=findings), None
    times, kind = sources[column], layout.stamp_kind(column)
    factor = 1.0 if kind else _time_factor(times, layout.units[column], spec, where)
    base = time_base(times, spec.sample_rate, where, to_seconds=factor)
    base = TimeBase(base.start, base.rate, base.breaks, base.break_steps, (*base.findings, *findings))
    if kind in ("", "clock"):
        return base, None
    return TimeBase(0.0, base.rate, base.breaks, base.break_steps, base.findings), base.start


def _time_factor(times: SampleSource, unit: str, spec: ChannelSpec, where: str) -> float:
    if unit:
        return unit_factor(unit, "time", f"{where} time column")
    steps = np.diff(times.read(0, min(times.n_samples, 10_000)))
    steps = steps[np.isfinite(steps)]
    step = float(np.median(steps)) if steps.size else 0.0
    for factor in (1.0, 1e-3, 1e-6):
        if abs(step * factor * spec.sample_rate - 1.0) < 0.05:
            return factor
    raise Refusal(
        f"{where}: the time column has no unit and its step of {step:.6g} fits neither s, ms nor us at "
        f"{spec.sample_rate:g} Hz; write the unit into the header"
    )

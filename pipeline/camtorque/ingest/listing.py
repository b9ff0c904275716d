"""What `camtorque new` lists of a table: every column but its times, with the rate that the times tell."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from camtorque.ingest.csv_layout import CsvLayout
from camtorque.ingest.header import COUNTS, is_time_name, is_time_unit, numbered_name, time_unit, timed_by_name
from camtorque.ingest.raw import ArraySource, FileChannel
from camtorque.ingest.stamps import date_of
from camtorque.ingest.table_rows import are_changes, at, held, own_rows, rate_of_changes, rows_of, usual_distance
from camtorque.records import Refusal, SampleSource
from camtorque.units import BORDER_UNITS, DEGREE, TURN, UNITS, is_known_unit, tidy_unit, unit_factor

SECONDS = (500.0, 5.0e5)
"""A time without a unit is in seconds where that gives such a rate: milliseconds would be 500 kHz and more [Hz]."""
LEAST_STAMPS = 100
"""This many values that rise evenly are no coincidence."""
NO_TIME = re.compile(r"cycle|zyklus|spiel|angle|winkel|\bCA\b|°|\bdeg", re.IGNORECASE)
"""Names of columns that rise evenly and are no time."""
SAME_RATE = 0.01
"""A first column without a name is the time where it and the header state rates that differ by less."""
MOST_COLUMNS = 50
"""Columns that a log of few rows may have."""
OVER_TIME = (
    "expected samples over time, one below the other, and one column for each channel; export the recording over time, "
    "or all cycles below each other with the angle in a column"
)
MOST_TURNS = 2.1
"""An angle that rises evenly over no more is that of one cycle."""
RATE_SAMPLES = 10_000
"""Time stamps used to find the rate of a file that has no recording.toml yet."""
MOST_ALIKE = 0.9
"""Share of the steps that are alike where stamps have enough digits; the others are gaps."""


def listed(path: Path, layout: CsvLayout, sources: Mapping[int, SampleSource]) -> tuple[FileChannel, ...]:
    """Return every column but the times as a channel; the time's usual step tells the rate."""
    columns = {number: layout.time_column("", (), number) for number in sources}
    has_times = any(time is not None for time in columns.values())
    filled = (n for n, s in sources.items() if np.isfinite(s.read(0, min(s.n_samples, RATE_SAMPLES))).mean() > 0.5)
    first = next(filled, -1)
    unnamed = first if not has_times and first >= 0 and _may_be_time(layout, first, sources[first]) else None
    if unnamed is not None:
        columns = dict.fromkeys(columns, unnamed)
    elif not has_times:
        _refuse_cycles_side_by_side(path, layout, sources, first)
    times = {time for time in columns.values() if time is not None}
    rates = {time: _listed_rate(path, layout, sources[time], time) for time in times if time in sources}

    def channel(number: int, source: SampleSource) -> FileChannel:
        time, named = columns[number], "" if unnamed is None else _unique(layout, unnamed)
        rate = layout.header_rate if time is None else rates.get(time)
        if time is not None and time in sources:
            own, stamps = own_rows(source, sources[time])
            if own is not source:
                source, rate = own, _listed_rate(path, layout, stamps, time)
            if are_changes(source, stamps):
                stamps = ArraySource(stamps.read(0, stamps.n_samples) * time_unit_of(path, layout, time))
                rate = rate_of_changes(stamps)
                source = held(source, stamps, rate, path.name)
        rows = rows_of(source, usual_distance(source))
        source = at(rows, source)
        return FileChannel("", _unique(layout, number), layout.units[number], source.n_samples,
                           rate and rate / rows.step, named, source)  # fmt: skip

    return tuple(
        channel(number, source)
        for number, source in sources.items()
        if number not in times
        and layout.stamp_kind(number) != "date"
        and not ((not layout.names[number] or COUNTS.match(layout.names[number])) and _rises_evenly(source))
    )


def _may_be_time(layout: CsvLayout, column: int, source: SampleSource) -> bool:
    """Tell a column that nothing names but that can be the time; one of cycles, angles or another unit is none."""
    unit, stated = layout.units[column], layout.header_rate
    if (unit and not is_time_unit(unit)) or NO_TIME.search(layout.names[column]) or not _rises_evenly(source):
        return False
    rate = usual_rate(source)
    return stated is None or (rate is not None and abs(rate / stated - 1.0) < SAME_RATE)


def _refuse_cycles_side_by_side(path: Path, layout: CsvLayout, sources: Mapping[int, SampleSource], first: int) -> None:
    """Refuse a table of cycles: one in each column over the angle of a turn, or one in each row."""
    n_rows = max((source.n_samples for source in sources.values()), default=0)
    if not sources:
        raise Refusal(
            f"{path}: found no column of numbers, expected the samples of the channels; export them as numbers"
        )
    if layout.n_columns > max(MOST_COLUMNS, n_rows):
        raise Refusal(f"{path}: holds {layout.n_columns} columns of {n_rows} rows, as cycles in rows do; {OVER_TIME}")
    if first < 0:
        return
    unit = layout.units[first]
    kind, factor = BORDER_UNITS.get(tidy_unit(unit), ("", 0.0))
    angle = kind == "angle" or (not unit and bool(NO_TIME.search(layout.names[first])))
    values = sources[first].read(0, n_rows) if angle else np.empty(0)
    values = values[np.isfinite(values)]
    if not _rises_evenly(ArraySource(values)):
        return
    span = float(np.ptp(values)) * (factor or DEGREE) / TURN
    if span < MOST_TURNS:
        raise Refusal(
            f"{path}: {layout.names[first]!r} runs once over {span:.3g} turns, as an angle does beside cycles in "
            f"columns ({len(sources) - 1} here); {OVER_TIME}"
        )


def _unique(layout: CsvLayout, number: int) -> str:
    """Return the name of a column, or its place where others have that name or none is there."""
    name = layout.names[number]
    return name if name and layout.names.count(name) == 1 else numbered_name(number)


def _rises_evenly(source: SampleSource) -> bool:
    """Tell a column that nothing names but that can be the time: it leaves a straight line by two steps at most."""
    values = source.read(0, min(source.n_samples, RATE_SAMPLES))
    steps = np.diff(values)
    if values.size < LEAST_STAMPS or not np.isfinite(values).all() or steps.min() < 0.0 or values[0] == values[-1]:
        return False
    line = np.linspace(values[0], values[-1], values.size)
    return bool(np.ptp(values - line) <= 2.0 * steps.max())


def _listed_rate(path: Path, layout: CsvLayout, times: SampleSource, column: int) -> float | None:
    stamped = bool(layout.stamp_kind(column))
    unit = "" if stamped or not is_known_unit(layout.units[column]) else layout.units[column]
    if unit or stamped:
        return usual_rate(times, time_unit_of(path, layout, column))
    return rate_of_times(times, "") or layout.header_rate


def time_unit_of(path: Path, layout: CsvLayout, column: int) -> float:
    """Return the unit of a time column [s]; 1 where the file says none that is known."""
    unit = layout.units[column]
    return unit_factor(unit, "time", f"{path} time") if is_known_unit(unit) and not layout.stamp_kind(column) else 1.0


def with_times(found: list[FileChannel]) -> tuple[FileChannel, ...]:
    """Return channels with the rate of the time channel beside them, by name and length, where they have none."""
    times = {(item.group, item.n_samples): item for item in reversed(found) if is_time_name(item.name)}
    first = [item for item in found if item.name == numbered_name(0)]
    times = {(item.group, item.n_samples): item for item in first if _rises_evenly(item.source)} | times
    names = {(item.group, item.name) for item in found}
    own = {place: item for item in found if (place := (item.group, timed_by_name(item.name))) in names
           and place != (item.group, item.name)}  # fmt: skip
    taken, listed_channels = {id(item) for item in (*times.values(), *own.values())}, []
    for item in (item for item in found if id(item) not in taken):
        time = own.get((item.group, item.name)) or times.get((item.group, item.n_samples))
        if item.sample_rate is None and time is not None:
            rate = rate_of_times(time.source, time_unit(time.name, _unit_of_times(time)), time.name)
            item = replace(item, sample_rate=rate, time_channel=time.name)
        listed_channels.append(item)
    return tuple(listed_channels)


def _unit_of_times(item: FileChannel) -> str:
    """Return the unit of a time channel, "" for one of another quantity: its group states that of what was measured."""
    return "" if is_known_unit(item.unit) and tidy_unit(item.unit) not in UNITS["time"] else item.unit


def rate_of_times(times: SampleSource, unit: str, name: str = "") -> float | None:
    """Return the rate that times tell; None where they state no unit and may be milliseconds: a person has to say."""
    if unit:
        return usual_rate(times, unit_factor(unit, "time", f"{name} unit"))
    start = float(times.read(0, 1)[0])
    epoch = next((factor for factor in (1.0, 1e-3, 1e-6, 1e-9) if date_of(start * factor) is not None), 0.0)
    rate = usual_rate(times, epoch or 1.0)
    return rate if epoch or (rate and SECONDS[0] <= rate <= SECONDS[1]) else None


def usual_rate(times: SampleSource, to_seconds: float = 1.0) -> float | None:
    """Return the sampling rate that stamps tell [Hz], None where they do not run forward.

    Stamps are rounded; of the rates that they allow it is the one with the fewest digits.
    """
    stamps = times.read(0, min(times.n_samples, RATE_SAMPLES)) * to_seconds
    stamps = stamps[np.isfinite(stamps)]
    steps = np.diff(stamps)
    usual = float(np.median(steps)) if steps.size else 0.0
    near = steps[np.abs(steps - usual) < 0.5 * usual]
    # where several samples share a stamp only the whole span tells
    steps = near if near.size > MOST_ALIKE * steps.size else steps
    span = float(steps.sum())
    if not span > 0.0:
        return None
    rate = steps.size / span
    rounding = float(np.percentile(steps, 99.0) - np.percentile(steps, 1.0)) + float(np.spacing(abs(stamps[-1])))
    allowed = rate * min(rounding / span, 0.05)
    return next((r for digits in range(1, 12) if abs((r := float(f"{rate:.{digits}g}")) - rate) <= allowed), rate)

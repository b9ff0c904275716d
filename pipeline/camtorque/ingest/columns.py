"""Columns with names and units, from a text, a spreadsheet or a columnar file: find them, and find their time."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.config.tables import Problems
from camtorque.ingest.cells import UNDATED
from camtorque.ingest.csv_layout import CsvLayout
from camtorque.ingest.header import MAYBE_TIME, TIME_NAME, is_time_name, name_and_unit, numbered_name, time_unit
from camtorque.ingest.raw import ArraySource, FileChannel, RawChannel, RawFile
from camtorque.ingest.stamps import DAY, RATE_NOTE, Stamps, agreed_rate, date_of, read_stamps
from camtorque.records import Finding, Refusal, SampleSource
from camtorque.units import counted, did_you_mean, is_known_unit, unit_factor

SECONDS = (500.0, 5.0e5)
"""A time without a unit is in seconds where that gives such a rate: milliseconds would be 500 kHz and more [Hz]."""
END_ROWS = 100_000
"""Rows at either end of a table that are looked at for a time."""
MOST_ALIKE = 0.9
"""Share of the steps that are alike where stamps have enough digits; the others are gaps."""
LEAST_STAMPS = 100
"""This many values that rise evenly are no coincidence."""
ROWS = 1_000_000
"""Rows looked at in one go."""
RATE_SAMPLES = 10_000
"""Time stamps used to find the rate of a file that has no recording.toml yet."""


def raw_file(
    path: Path, layout: CsvLayout, sources: Mapping[int, SampleSource], specs: tuple[ChannelSpec, ...]
) -> RawFile:
    """Return the channels of columns that were read; ``sources`` holds them by number, the time column too."""
    channels: list[RawChannel] = []
    findings: list[Finding] = []
    seen: set[tuple[int | None, int]] = set()
    fastest = max(spec.sample_rate for spec in specs)
    for spec, time in zip(specs, time_columns_of(path, layout, specs), strict=True):
        column = column_of(path, layout, spec.channel)
        source, stamps, cut = _where_timed(sources[column], sources.get(time) if time is not None else None, path)
        rows = _rows_of(source, round(fastest / spec.sample_rate))
        base, stamp = _times(path, layout, stamps and _at(rows, stamps), time, spec, rows)
        channels.append(base.channel(spec.channel, layout.units[column], _at(rows, source), stamp))
        findings += (*base.findings, *cut) if (time, rows.step) not in seen else ()
        seen.add((time, rows.step))
    return RawFile(tuple(channels), tuple(findings))


def time_columns_of(path: Path, layout: CsvLayout, specs: tuple[ChannelSpec, ...]) -> list[int | None]:
    """Return the number of each channel's time column, None where there is none.

    Raises
    ------
    Refusal : recording.toml names one that is not there
    """
    found, names = [], tuple(spec.channel for spec in specs)
    for spec in specs:
        column = layout.time_column(spec.time_channel, names, column_of(path, layout, spec.channel))
        if spec.time_channel and column is None:
            shown = ", ".join(layout.names)
            raise Refusal(f"{path}: no time column {spec.time_channel!r}; the columns are {shown}")
        found.append(column)
    return found


def _where_timed(
    source: SampleSource, times: SampleSource | None, path: Path
) -> tuple[SampleSource, SampleSource | None, tuple[Finding, ...]]:
    """Leave out rows at both ends of a table that have no time: numbers of sensors, statistics, a shorter pair."""
    if times is None or not times.n_samples:
        return source, times, ()
    above, below = rows_without_time(times)
    if not above + below:
        return source, times, ()
    findings = [
        Finding("rows_without_time", "warning",
                counted(count, f"row at the {end} holds no time; it is left out",
                        f"rows at the {end} hold no time; they are left out"), path.name)
        for count, end in ((above, "beginning"), (below, "end"))
        if count
    ]  # fmt: skip
    stop = times.n_samples - below
    return ArraySource(source.read(above, stop)), ArraySource(times.read(above, stop)), tuple(findings)


def rows_without_time(times: SampleSource) -> tuple[int, int]:
    """Return how many rows at the beginning and at the end of a table hold no time."""
    first = np.isfinite(times.read(0, END_ROWS))
    last = np.isfinite(times.read(max(times.n_samples - END_ROWS, 0), times.n_samples))
    return (int(np.argmax(first)) if first.any() else 0), (int(np.argmax(last[::-1])) if last.any() else 0)


def _rows_of(source: SampleSource, every: int) -> slice:
    """Return the rows that hold a channel: one in so many where a faster one fills the rows between, else all.

    Only where its values stand in each ``every``-th row and nowhere else; the cells between are blank.
    """
    every = max(every, 1)
    block = every * max(ROWS // every, 1)
    held: set[int] = set()
    for low in range(0, source.n_samples if every > 1 else 0, block):
        held |= set((np.flatnonzero(np.isfinite(source.read(low, low + block))) % every).tolist())
    return slice(held.pop(), None, every) if len(held) == 1 else slice(0, None, 1)


def _usual_distance(source: SampleSource) -> int:
    """Return how many rows lie from one value to the next, 1 where there are fewer than two."""
    there = np.flatnonzero(np.isfinite(source.read(0, min(source.n_samples, ROWS))))
    return int(np.median(np.diff(there))) if there.size > 1 else 1


def _at(rows: slice, source: SampleSource) -> SampleSource:
    if rows.step == 1:
        return source
    block = rows.step * max(ROWS // rows.step, 1)
    return ArraySource(
        np.concatenate([source.read(low, low + block)[rows] for low in range(0, source.n_samples, block)])
    )


def listed(path: Path, layout: CsvLayout, sources: Mapping[int, SampleSource]) -> tuple[FileChannel, ...]:
    """Return every column but the times as a channel; the time's usual step tells the rate."""
    columns = {number: layout.time_column("", (), number) for number in sources}
    has_times = any(time is not None for time in columns.values())
    unnamed = 0 if not has_times and layout.header_rate is None and 0 in sources and _rises_evenly(sources[0]) else None
    if unnamed is not None:
        columns = dict.fromkeys(columns, unnamed)
    times = {time for time in columns.values() if time is not None}
    rates = {time: _listed_rate(path, layout, sources[time], time) for time in times if time in sources}

    def channel(number: int, source: SampleSource) -> FileChannel:
        time, rows = columns[number], _rows_of(source, _usual_distance(source))
        rate, source = layout.header_rate if time is None else rates.get(time), _at(rows, source)
        named = "" if unnamed is None else _unique(layout, unnamed)
        return FileChannel("", _unique(layout, number), layout.units[number], source.n_samples,
                           rate and rate / rows.step, named, source)  # fmt: skip

    return tuple(
        channel(number, source)
        for number, source in sources.items()
        if number not in times and layout.names[number] and layout.stamp_kind(number) != "date"
    )


def _unique(layout: CsvLayout, number: int) -> str:
    """Return the name of a column, or its place where others have that name or none is there."""
    name = layout.names[number]
    return name if name and layout.names.count(name) == 1 else numbered_name(number)


def _rises_evenly(source: SampleSource) -> bool:
    """Tell a column that nothing names but that can be the time: it leaves a straight line by two steps at most."""
    values = source.read(0, min(source.n_samples, RATE_SAMPLES))
    steps = np.diff(values)
    if values.size < LEAST_STAMPS or not np.isfinite(values).all() or not 0.0 <= steps.min() < steps.max() * 2.0:
        return False
    line = np.linspace(values[0], values[-1], values.size)
    return bool(np.ptp(values - line) <= 2.0 * steps.max())


def _listed_rate(path: Path, layout: CsvLayout, times: SampleSource, column: int) -> float | None:
    stamped = bool(layout.stamp_kind(column))
    unit = "" if stamped or not is_known_unit(layout.units[column]) else layout.units[column]
    epoch = 0.0 if unit or stamped else _epoch_unit(times)
    rate = usual_rate(times, unit_factor(unit, "time", f"{path} time") if unit else epoch or 1.0)
    if not unit and not stamped and not epoch and not (rate and SECONDS[0] <= rate <= SECONDS[1]):
        return layout.header_rate  # seconds or milliseconds: the header, or a person, has to say
    return rate


def _epoch_unit(times: SampleSource) -> float:
    """Return the unit [s] in which times are a date of this century, 0 where they are none."""
    first = times.read(0, 1)
    return next((unit for unit in (1.0, 1e-3, 1e-6, 1e-9) if date_of(float(first[0]) * unit) is not None), 0.0)


def with_times(found: list[FileChannel]) -> tuple[FileChannel, ...]:
    """Return channels with the rate of the time channel beside them, by name and length, where they have none."""
    times = {(item.group, item.n_samples): item for item in reversed(found) if is_time_name(item.name)}
    first = [item for item in found if item.name == numbered_name(0)]
    times = {(item.group, item.n_samples): item for item in first if _rises_evenly(item.source)} | times
    listed_channels = []
    for item in found:
        time = times.get((item.group, item.n_samples))
        if item in times.values():
            continue
        if item.sample_rate is None and time is not None:
            unit = time_unit(time.name, time.unit)
            factor = unit_factor(unit, "time", f"{time.name} unit") if unit else 1.0
            item = replace(item, sample_rate=usual_rate(time.source, factor), time_channel=time.name)
        listed_channels.append(item)
    return tuple(listed_channels)


def time_beside(names: Iterable[str], channels: Container[str], source: Callable[[str], SampleSource]) -> str:
    """Return which of the names beside a channel, each with as many samples, holds its times; "" where none does.

    One that is named outright so, else ``t`` or ``x`` that runs as a clock does; a channel of the recording is none.
    """
    free = [name for name in names if name not in channels]
    outright = [name for name in free if TIME_NAME.match(name)]
    maybe = (name for name in free if MAYBE_TIME.match(name) and _runs(source(name)))
    return outright[0] if outright else next(maybe, "")


def _runs(source: SampleSource) -> bool:
    """Tell values that rise by steps that are alike, but for gaps."""
    steps = np.diff(source.read(0, min(source.n_samples, RATE_SAMPLES)))
    usual = float(np.median(steps)) if steps.size else 0.0
    return usual > 0.0 and float(np.mean(np.abs(steps - usual) < 0.5 * usual)) > MOST_ALIKE


def times_beside(times: SampleSource, unit: str, spec: ChannelSpec, where: str) -> tuple[Stamps, float | None]:
    """Return the time base of a channel by the times beside it, and its date where they tell one.

    A time without a unit is in the one that gives the declared rate.
    """
    factor = _time_factor(times, unit, spec, where)
    return _dated(read_stamps(times, spec.sample_rate, where, to_seconds=factor), factor)


def _dated(base: Stamps, factor: float) -> tuple[Stamps, float | None]:
    date = date_of(base.start, in_days=factor == DAY)
    return (base, None) if date is None else (replace(base, start=0.0), date)


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


def column_of(path: Path, layout: CsvLayout, name: str) -> int:
    """Return the number of a column by its name, with or without its unit, or by its place.

    Raises
    ------
    Refusal : no column, or several, of that name
    """
    bare, unit = name_and_unit(name)
    if name not in layout.names and (bare, unit) in zip(layout.names, layout.units, strict=True):
        name = bare  # the header says "Torque [V]", and so does the recording
    places = [number for number, other in enumerate(layout.names) if other == name]
    found = layout.place(name)
    if found is not None and len(places) < 2:
        return found
    shown = ", ".join(layout.names)
    if places:
        named = " or ".join(repr(numbered_name(number)) for number in places[:3])
        raise Refusal(
            f"{path}: {len(places)} columns are named {name!r}; name one by its place, channel = {named}; the columns "
            f"are {shown}"
        )
    raise Refusal(f"{path}: no column {name!r}{did_you_mean(name, layout.names)}; the columns are {shown}")


def columns_of(path: Path, layout: CsvLayout, specs: tuple[ChannelSpec, ...]) -> list[int]:
    """Return the numbers of the columns of channels.

    Raises
    ------
    Refusals : see `column_of`; every channel whose column is not there
    """
    problems, found = Problems(), list[int]()
    for spec in specs:
        with problems.collecting():
            found.append(column_of(path, layout, spec.channel))
    problems.raise_any()
    return found


def _times(
    path: Path, layout: CsvLayout, times: SampleSource | None, column: int | None, spec: ChannelSpec, rows: slice
) -> tuple[Stamps, float | None]:
    """Return the time base of a channel that stands in some rows, and its date where the file has stamps."""
    where, stated = path.name, layout.header_rate and layout.header_rate / rows.step
    if column is None or times is None:
        rate: float = spec.sample_rate
        findings: tuple[Finding, ...] = ()
        if stated is not None:
            rate, findings = agreed_rate(stated, spec.sample_rate, where, 1e-9, "the header says")
        begun = (layout.start or 0.0) if spec.start_time is None else spec.start_time
        return Stamps(begun + rows.start / rows.step / rate, rate, findings=findings), None
    kind = layout.stamp_kind(column)
    factor = 1.0 if kind else _time_factor(times, layout.units[column], spec, where)
    base = read_stamps(times, spec.sample_rate, where, to_seconds=factor)
    if not layout.units[column] and factor * spec.sample_rate == 1.0 and date_of(base.start) is None:
        text = (
            f"the column {layout.names[column]!r} counts samples; the declared {spec.sample_rate:g} Hz make times of it"
        )
        base = replace(base, findings=(*base.findings, Finding("samples_counted", "info", text, where)))
    if stated is not None and abs(stated / base.rate - 1.0) > RATE_NOTE:
        text = f"the header says {stated:.8g} Hz, the time column {base.rate:.8g} Hz, which is used"
        base = replace(base, findings=(*base.findings, Finding("header_rate_differs", "warning", text, where)))
    if not kind:
        return _dated(base, factor)
    if kind in UNDATED:
        day = layout.date_of(column) if kind == "clock" else None
        return (base, None) if day is None else (replace(base, start=0.0), day + base.start)
    return replace(base, start=0.0), base.start


def _time_factor(times: SampleSource, unit: str, spec: ChannelSpec, where: str) -> float:
    if unit:
        return unit_factor(unit, "time", f"{where} time column")
    steps = np.diff(times.read(0, min(times.n_samples, 10_000)))
    steps = steps[np.isfinite(steps)]
    # stamps of too few digits are shared by samples, so that only their mean step tells
    step = float(np.median(steps)) or float(np.mean(steps)) if steps.size else 0.0
    if not step > 0.0:
        return 1.0  # in no unit does time run forward: that is refused where the stamps are read
    for factor in (1.0, 1e-3, 1e-6, 1e-9, DAY):
        if abs(step * factor * spec.sample_rate - 1.0) < 0.05:
            return factor
    if step == 1.0:
        return 1.0 / spec.sample_rate  # sample numbers: the rate is the declared one, gaps show
    raise Refusal(
        f"{where}: the time column has no unit and its step of {step:.6g} fits neither s, ms, us, ns nor days at "
        f"{spec.sample_rate:g} Hz; correct sample_rate_hz, or write the unit behind the name of the time, as in time_ms"
    )

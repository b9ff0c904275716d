"""Columns with names and units, from a text, a spreadsheet or a columnar file: find them, and find their time."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.config.tables import Problems
from camtorque.ingest.cells import UNDATED
from camtorque.ingest.csv_layout import CsvLayout
from camtorque.ingest.header import MAYBE_TIME, TIME_NAME, name_and_unit, numbered_name, timed_by_name
from camtorque.ingest.listing import MOST_ALIKE, RATE_SAMPLES, time_unit_of
from camtorque.ingest.raw import ArraySource, RawChannel, RawFile, refuse_other_unit
from camtorque.ingest.stamps import RATE_NOTE, Stamps, agreed_rate, date_of, read_stamps
from camtorque.ingest.table_rows import are_changes, at, held, own_rows, rows_of, spaced, where_timed
from camtorque.records import Finding, Refusal, SampleSource
from camtorque.units import DAY, did_you_mean, unit_factor

PULSES = [name for name, quantity in CHANNEL_QUANTITIES.items() if quantity.is_pulse]
"""Quantities whose channels are pulses."""


def raw_file(
    path: Path, layout: CsvLayout, sources: Mapping[int, SampleSource], specs: tuple[ChannelSpec, ...]
) -> RawFile:
    """Return the channels of columns that were read; ``sources`` holds them by number, the time column too.

    Raises
    ------
    Refusals : all that is wrong with them
    """
    problems, channels, findings = Problems(), list[RawChannel](), list[Finding]()
    seen: set[tuple[int | None, int]] = set()
    fastest = max(spec.sample_rate for spec in specs)
    for spec, (column, time) in zip(specs, columns_of(path, layout, specs), strict=True):
        with problems.collecting():
            source, stamps, cut = where_timed(sources[column], sources.get(time) if time is not None else None, path)
            if stamps is not None and time is not None:
                source, stamps = own_rows(source, stamps)
                if spec.quantity in PULSES and are_changes(source, stamps):
                    base, stamp, source = _held(path, layout, spec, time, source, stamps)
                    channels.append(base.channel(spec.channel, layout.units[column], source, stamp))
                    findings += (*base.findings, *cut)
                    continue
            every = round(fastest / spec.sample_rate)
            rows = rows_of(source, every)
            own = (at(rows, source), stamps and at(rows, stamps))
            if rows.step < every and stamps is not None and (apart := spaced(source, stamps, every)):
                rows, own = slice(0, None, every), apart
            base, stamp = _times(path, layout, own[1], time, spec, rows)
            channels.append(base.channel(spec.channel, layout.units[column], own[0], stamp))
            findings += (*base.findings, *cut) if (time, rows.step) not in seen else ()
            seen.add((time, rows.step))
    problems.raise_any()
    return RawFile(tuple(channels), tuple(findings))


def _held(
    path: Path, layout: CsvLayout, spec: ChannelSpec, time: int, source: SampleSource, stamps: SampleSource
) -> tuple[Stamps, float | None, SampleSource]:
    """Return time base, date and samples at the declared rate of levels that are written at their changes only."""
    if not layout.units[time] and not layout.stamp_kind(time):
        raise Refusal(
            f"{path.name}: {spec.channel!r} is written where its level changes, and the time column "
            f"{layout.names[time]!r} has no unit; write the unit behind its name, as in Time [s]"
        )
    factor = time_unit_of(path, layout, time)
    text = (
        f"{spec.channel!r} is written where its level changes; it is held from one change to the next and read at the "
        f"declared {spec.sample_rate:g} Hz, to which its edges are known"
    )
    told = Finding("levels_held", "info", text, path.name)
    seconds = ArraySource(stamps.read(0, stamps.n_samples) * factor)
    base = Stamps(float(seconds.read(0, 1)[0]), spec.sample_rate, findings=(told,))
    return *_dated(base, factor), held(source, seconds, spec.sample_rate, path.name)


def time_beside(names: Iterable[str], channels: Container[str], source: Callable[[str], SampleSource], own: str) -> str:
    """Return which of the names beside a channel, each with as many samples, holds its times; "" where none does.

    One that is named after the channel (``own``) or outright so, else ``t`` or ``x`` that runs as a clock does; a
    channel of the recording is none.
    """
    free = [name for name in names if name not in channels]
    named = [name for name in free if name != own and timed_by_name(name) == own]
    outright = named + [name for name in free if TIME_NAME.match(name)]
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


def columns_of(path: Path, layout: CsvLayout, specs: tuple[ChannelSpec, ...]) -> list[tuple[int, int | None]]:
    """Return the numbers of each channel's column and of that of its times, None where there is none.

    Raises
    ------
    Refusals : see `_column_of`; every channel whose column, or the time column that recording.toml names, is not there,
        or in another unit
    """
    problems, found = Problems(), list[tuple[int, int | None]]()
    names = tuple(spec.channel for spec in specs)
    for spec in specs:
        with problems.collecting():
            column = _column_of(path, layout, spec.channel)
            time = layout.time_column(spec.time_channel, names, column)
            found.append((column, time))
            with problems.collecting():
                refuse_other_unit(spec, layout.units[column])
            if spec.time_channel and time is None:
                shown = ", ".join(layout.names)
                raise Refusal(f"{path}: no time column {spec.time_channel!r}; the columns are {shown}")
    problems.raise_any()
    return found


def _column_of(path: Path, layout: CsvLayout, name: str) -> int:
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
    if found is not None and found in layout.words:
        raise Refusal(
            f"{path}: column {name!r} holds words, expected numbers, or levels as true and false, on and off, high and "
            "low; write them so"
        )
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


def _times(
    path: Path, layout: CsvLayout, times: SampleSource | None, column: int | None, spec: ChannelSpec, rows: slice
) -> tuple[Stamps, float | None]:
    """Return the time base of a channel that stands in some rows, and its date where the file has stamps."""
    where, stated = path.name, layout.header_rate and layout.header_rate / rows.step
    if column is None or times is None:
        rate, findings = agreed_rate(stated or spec.sample_rate, spec.sample_rate, where, "the header says")
        start = (layout.start or 0.0) + rows.start / rows.step / rate
        return Stamps(start, rate, findings=findings), layout.header_date
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
        dated = _dated(base, factor)
        # which moment a header's date is of is plain only where the times count from it
        return (base, layout.header_date) if dated[1] is None and abs(base.start) * base.rate < 1.0 else dated
    if kind in UNDATED:
        day = layout.date_of(column) if kind == "clock" else None
        return (base, None) if day is None else (replace(base, start=0.0), day + base.start)
    return replace(base, start=0.0), base.start


def _time_factor(times: SampleSource, unit: str, spec: ChannelSpec, where: str) -> float:
    if unit:
        return unit_factor(unit, "time", f"{where} time column")
    steps = np.diff(times.read(0, min(times.n_samples, 10_000)))
    steps = steps[np.isfinite(steps)]
    # stamps of too few digits are shared by samples, or step by more and by less: only their mean step tells
    mean = float(np.mean(steps)) if steps.size else 0.0
    step = float(np.median(steps)) or mean if steps.size else 0.0
    if not step > 0.0:
        return 1.0  # in no unit does time run forward: that is refused where the stamps are read
    for factor in (1.0, 1e-3, 1e-6, 1e-9, DAY):
        if any(abs(each * factor * spec.sample_rate - 1.0) < 0.05 for each in (step, mean)):
            return factor
    if step == 1.0:
        return 1.0 / spec.sample_rate  # sample numbers: the rate is the declared one, gaps show
    raise Refusal(
        f"{where}: the time column has no unit and its step of {step:.6g} fits neither s, ms, us, ns nor days at "
        f"{spec.sample_rate:g} Hz; correct sample_rate_hz, or write the unit behind the name of the time, as in time_ms"
    )

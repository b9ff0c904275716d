"""Channels as a file stores them, whichever its format: found by name, timed by what the file or a channel beside says.

A format whose channels each have samples of their own says what it stores; which of it is asked for, and when the
samples were taken, is told here. What stands in the columns of a table is told in `columns`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camtorque.config import ChannelSpec
from camtorque.config.tables import Problems
from camtorque.ingest.columns import times_beside
from camtorque.ingest.header import time_unit
from camtorque.ingest.listing import rate_of_times, with_times
from camtorque.ingest.raw import FileChannel, RawChannel, RawFile, missing_samples, refuse_other_unit, refusing
from camtorque.ingest.stamps import Stamps, agreed_rate, break_findings
from camtorque.records import Array, Finding, Refusal, SampleSource
from camtorque.units import did_you_mean, first_of

LEAST_PAUSE = 0.05
"""Dates that leave the time of the samples before by less are those of a loop that reads blocks [s]."""
MOST_SHOWN = 12
"""Channels that a refusal lists."""
SCALE_NAMES = ("scale", "slope", "factor", "scaling", "multiplier")
GAIN_NAMES = ("gain", "lsb", "voltsperbit", "vperbit", "voltspercount", "unitsperbit")
"""Attributes, as `plain` has them, that look like a scale and follow no convention: they are never applied. A gain is
one beside whole numbers, beside others it may be that of an amplifier."""


@dataclass(frozen=True)
class Stored:
    """One channel of a file.

    Attributes
    ----------
    unit : as the file says, "" where it says nothing
    rate, start : sampling rate [Hz] and time of sample 0 [s], None where the file does not state them
    times, times_unit : time stamps that belong to it, None where the format has none, and their unit
    time_beside : tells which channel beside it, none of these, holds its times, "" where none does
    beside : finds a channel beside it by name, with the unit that is stated of that one alone; None where group and
        name find it as well
    dates : samples at which the file states a date, with that in seconds since 1970
    first_dated : the first of these is that of the first sample whatever time a channel beside gives it, not of time 0
    declared : number of samples that the file states
    if_untimed : findings where neither the file nor a channel beside tells the times
    """

    group: str
    name: str
    unit: str
    source: SampleSource
    rate: float | None = None
    start: float | None = None
    times: SampleSource | None = None
    times_unit: str = "s"
    time_beside: Callable[[Container[str]], str] | None = None
    beside: Callable[[str], Stored] | None = None
    dates: tuple[tuple[int, float], ...] = ()
    first_dated: bool = False
    declared: int = 0
    if_untimed: tuple[Finding, ...] = ()
    findings: tuple[Finding, ...] = ()


Find = Callable[[str, str], Stored]
"""Group and name, as recording.toml has them -> the channel."""


def read_stored(path: Path, kind: str, specs: tuple[ChannelSpec, ...], find: Find) -> RawFile:
    """Return the channels that a recording names; what a library raises is a refusal that names the channel.

    Raises
    ------
    Refusals : all that is wrong with them
    """
    problems, channels, findings = Problems(), list[RawChannel](), list[Finding]()
    for spec in specs:
        with problems.collecting(), refusing(path, kind, f"{spec.group}/{spec.channel}".lstrip("/")):
            item = find(spec.group, spec.channel)
            with problems.collecting():
                refuse_other_unit(spec, item.unit)
            channel, more = _channel(path, spec, item, specs, find)
            channels.append(channel)
            findings += more
    problems.raise_any()
    return RawFile(tuple(channels), tuple(findings))


def listing_of(items: Iterable[Stored]) -> tuple[FileChannel, ...]:
    """Return channels as `camtorque new` lists them, with the rate that the file or the times tell."""
    return with_times([
        FileChannel(item.group, item.name, item.unit, item.source.n_samples, _listed_rate(item), "", item.source)
        for item in items
    ])  # fmt: skip


def _listed_rate(item: Stored) -> float | None:
    if item.rate is None and item.times is not None:
        return rate_of_times(item.times, item.times_unit, item.name)
    return item.rate if item.rate is not None and 0.0 < item.rate < math.inf else None


def among(path: Path, items: Iterable[Stored]) -> Find:
    """Return what finds a channel among all that a file holds."""
    return partial(chosen, path, [((item.group,), item.name, item) for item in items])


def chosen(path: Path, held: Sequence[tuple[Sequence[str], str, Any]], group: str, name: str) -> Any:
    """Return what a file holds under a name, in a group where one is named.

    ``held`` are the names of each channel's group, the usual one first, its own, and what is to be returned.

    Raises
    ------
    Refusal : no such group, no such channel, or several
    """
    groups = list(dict.fromkeys(other for names, *_ in held for other in names if other))
    if group and group not in groups:
        there = ", ".join(groups) or "none: leave out group"
        raise Refusal(f"{path}: no group {group!r}{did_you_mean(group, groups)}; the file has {there}")
    inside = [(names[0], other, handle) for names, other, handle in held if group in ("", *names)]
    found = [(place, handle) for place, other, handle in inside if other == name]
    if len(found) == 1:
        return found[0][1]
    if found:
        where = f"in the groups {', '.join(place for place, _ in found)}" if groups else f"there {len(found)} times"
        raise Refusal(
            f"{path}: {name!r} is {where}; name one as group in recording.toml, or export them under two names"
        )
    where = f" in group {group!r}" if group else " in any group" if groups else ""
    names = [other for _, other, _ in inside]
    there = first_of(names if group else [f"{place}/{other}".lstrip("/") for place, other, _ in inside], MOST_SHOWN)
    raise Refusal(f"{path}: no channel {name!r}{where}{did_you_mean(name, names)}; there are {there or 'none'}")


def _channel(
    path: Path, spec: ChannelSpec, item: Stored, specs: tuple[ChannelSpec, ...], find: Find
) -> tuple[RawChannel, tuple[Finding, ...]]:
    name, count = f"{item.group}/{item.name}".strip("/"), item.source.n_samples
    if not count:
        raise Refusal(f"{path}: channel {name!r} holds no samples; the logger wrote none: record it again")
    where, times, unit = f"{path.name} {name}", item.times, item.times_unit
    named = spec.time_channel
    if not named and times is None and item.time_beside is not None:
        named = item.time_beside(_taken(item, specs, find))
    if named:
        beside = find(item.group, named) if item.beside is None else item.beside(named)
        times, unit = beside.source, time_unit(named, beside.unit)
        if times.n_samples != count:
            raise Refusal(f"{where}: {times.n_samples} times in {named!r} for {count} samples: the file is cut or "
                          "mixed up; save both from one recording")  # fmt: skip
    base, date = times_beside(times, unit, spec, where) if times else (_equidistant(spec, item, where), None)
    stamp, index, size = _dated(item, base.rate)
    if named and item.first_dated and stamp is not None:
        stamp -= base.start
    if not times:
        told = break_findings(index, size, 1.0 / base.rate, where)
        base = Stamps(base.start, base.rate, tuple(index.tolist()), tuple(size.tolist()), (*base.findings, *told))
    raw = base.channel(spec.channel, item.unit, item.source, stamp if date is None else date)
    return raw, (*item.findings, *missing_samples(count, item.declared, where), *base.findings)


def _taken(item: Stored, specs: tuple[ChannelSpec, ...], find: Find) -> set[str]:
    """Return the channels of a recording in the group of one of them; a group that is not named may be any or none."""
    return {
        other.channel for other in specs
        if other.group == item.group or (not other.group and find("", other.channel).group == item.group)
    }  # fmt: skip


def _equidistant(spec: ChannelSpec, item: Stored, where: str) -> Stamps:
    """Return the time base of a channel without times, at the rate that the file states or recording.toml."""
    start = item.start or 0.0
    if item.rate is None:
        return Stamps(start, spec.sample_rate, findings=item.if_untimed)
    if not 0.0 < item.rate < math.inf:
        raise Refusal(f"{where}: the sampling rate in the file is {item.rate!r} Hz, expected a number > 0; correct "
                      "what states rate or step there, or take it out")  # fmt: skip
    rate, findings = agreed_rate(item.rate, spec.sample_rate, where, "the file says")
    return Stamps(start, rate, findings=findings)


def _dated(item: Stored, rate: float) -> tuple[float | None, NDArray[np.int64], Array]:
    """Return the date of time 0, the samples behind pauses, and these [s]: logs may have been appended."""
    at = np.array([number for number, _ in item.dates], dtype=np.int64)
    zero = np.array([date for _, date in item.dates]) - at / rate
    late = np.diff(zero)
    paused = np.flatnonzero((np.abs(late) > LEAST_PAUSE) & (at[1:] > 0) & (at[1:] < item.source.n_samples))
    return (float(zero[0]) if zero.size else None), at[1:][paused], late[paused]


def plain(name: str) -> str:
    """Return a name in small letters without blanks, dashes and underscores."""
    return re.sub(r"[ _-]", "", name).lower()


def unused_scales(attributes: Mapping[str, Any], kind: np.dtype[Any]) -> str:
    """Return the attributes beside values of a kind that look like a scale of them, with their numbers; "" for none."""
    names = (*SCALE_NAMES, *GAIN_NAMES) if kind.kind in "iu" else SCALE_NAMES
    numbers = {
        name: float(value)
        for name, value in attributes.items()
        if plain(name) in names and np.size(value) == 1 and np.asarray(value).dtype.kind in "fiu"
    }
    return ", ".join(f"{name} = {value:g}" for name, value in numbers.items() if value not in (0.0, 1.0))

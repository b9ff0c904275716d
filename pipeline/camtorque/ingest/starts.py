"""When each log begins on its clock, and what is odd about it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

from camtorque.config import ChannelSpec, RecordingConfig
from camtorque.ingest.raw import RawChannel
from camtorque.ingest.sensors import FIRST_STAMP
from camtorque.records import Channel, Finding
from camtorque.signal.logger_time import end_time
from camtorque.units import DAY, HOUR, TURN, first_of, zone_hint

T = TypeVar("T", ChannelSpec, Channel)
CLOCKS_APART = HOUR
"""Clocks of two loggers that nobody set may differ by this [s]."""


def starts(config: RecordingConfig, raw: Mapping[ChannelSpec, RawChannel]) -> dict[ChannelSpec, float]:
    """Return start times on each time base: dates count from the earliest one of the logs that share a clock.

    Where a file holds no date, what recording.toml states of a channel's first sample goes before the file's own times.
    """
    found = {}
    for group in _by_clock(config, raw):
        dates = [raw[spec].stamp for spec in group]
        earliest = min((date for date in dates if date is not None), default=0.0)
        for spec, date in zip(group, dates, strict=True):
            own = raw[spec].start_time
            if date is not None:
                own += date - earliest
            elif spec.start_time is not None:
                own = spec.start_time
            found[spec] = own
        if not any(dates):
            found |= _over_midnight({spec: found[spec] for spec in group}, raw)
    return found


def _over_midnight(begun: dict[ChannelSpec, float], raw: Mapping[ChannelSpec, RawChannel]) -> dict[ChannelSpec, float]:
    """Return starts by time of day of which some lie behind midnight: a day on where they share time then alone."""
    lasts = {spec: raw[spec].source.n_samples / raw[spec].sample_rate for spec in begun}
    latest = max(begun, key=begun.__getitem__)
    return {
        spec: start + DAY * (start + lasts[spec] < begun[latest] and start + DAY < begun[latest] + lasts[latest])
        for spec, start in begun.items()
    }


def _by_clock(config: RecordingConfig, logs: Iterable[T]) -> list[list[T]]:
    """Return channels in groups that share a clock."""
    groups: dict[str, list[T]] = {}
    for log in logs:
        groups.setdefault(log.logger if log.logger in config.own_clocks else "", []).append(log)
    return list(groups.values())


def time_findings(
    config: RecordingConfig, raw: Mapping[ChannelSpec, RawChannel], channels: Sequence[Channel]
) -> list[Finding]:
    """Tell logs of other times, starts that nothing states, and ends apart on one clock."""
    return [
        *_ends(config, channels),
        *_apart(config, raw),
        *_stated_beside_a_date(raw),
        *_without_date(config, raw),
        *_together(config, raw, channels),
    ]


def _apart(config: RecordingConfig, raw: Mapping[ChannelSpec, RawChannel]) -> list[Finding]:
    """Tell logs whose headers say that they were taken at other times: one may be of another run."""
    stamps = {spec: channel.stamp for spec, channel in raw.items() if channel.stamp and channel.stamp > FIRST_STAMP}
    if len(stamps) < 2:
        return []
    first, last = min(stamps, key=stamps.__getitem__), max(stamps, key=stamps.__getitem__)
    apart = stamps[last] - stamps[first]
    length = max(channel.source.n_samples / channel.sample_rate for channel in raw.values())
    if apart <= (max(length, CLOCKS_APART) if config.own_clocks else length):
        return []
    text = (
        f"by its date {last.path.name} begins {apart:.4g} s behind {first.path.name}, the logs last {length:.4g} s: "
        f"one may be of another run{zone_hint(apart)}"
    )
    return [Finding("logs_of_other_times", "warning", text, config.path.name)]


def _stated_beside_a_date(raw: Mapping[ChannelSpec, RawChannel]) -> list[Finding]:
    """Tell starts of recording.toml that are not used, since the file has a date of its own."""
    return [
        Finding(
            "start_not_used", "warning",
            f"start_time_s = {spec.start_time:g} is not used: the file has the date of its start, by which logs on one "
            "clock are laid together; take the key out, or the date out of the file where that is wrong",
            f"{spec.path.name} {spec.channel}",
        )
        for spec, channel in raw.items()
        if spec.start_time is not None and channel.stamp is not None
    ]  # fmt: skip


def _without_date(config: RecordingConfig, raw: Mapping[ChannelSpec, RawChannel]) -> list[Finding]:
    """Tell logs without a date beside dated ones on the same clock: when they began is not known."""
    findings = []
    for group in _by_clock(config, raw):
        dateless = dict.fromkeys(
            spec.path.name for spec in group if raw[spec].stamp is None and spec.start_time is None
        )
        dated = dict.fromkeys(spec.path.name for spec in group if raw[spec].stamp is not None)
        if dated:
            findings += [
                Finding(
                    "start_without_date", "warning",
                    f"no date of its start, which {first_of(tuple(dated), 3)} on the same clock has: its time counts "
                    "from the earliest of those; if it began at another time, give start_time_s for its channels", name,
                )
                for name in dateless
            ]  # fmt: skip
    return findings


def _together(
    config: RecordingConfig, raw: Mapping[ChannelSpec, RawChannel], channels: Sequence[Channel]
) -> list[Finding]:
    """Tell loggers on a common clock that begin at 0 s where neither a date nor recording.toml states any start."""
    synchronised = {logger.id for logger in config.loggers if logger.clock == "synchronised"}
    begun = {channel.logger: channel.start_time for channel in channels if channel.logger in synchronised}
    at_zero = sorted(name for name, start in begun.items() if start == 0.0)
    stated = any(channel.stamp is not None or spec.start_time is not None for spec, channel in raw.items())
    if len(begun) < 2 or not at_zero or stated:
        return []
    others = [f"{name} at {begun[name]:.6g} s" for name in sorted(begun) if name not in at_zero]
    text = (
        f"{', '.join(at_zero)} begin{'s' * (len(at_zero) == 1)} at 0 s, {', '.join(others)}, on one clock: if these do "
        "not count from one moment, say start_time_s of their channels"
        if others
        else f"{', '.join(at_zero)} are synchronised and all begin at 0 s; if one began later, say start_time_s of "
        "its channels"
    )
    return [Finding("starts_together", "info", text, config.path.name)]


def _ends(config: RecordingConfig, channels: Sequence[Channel]) -> list[Finding]:
    """Find logs that end apart although their loggers share a clock: one of them was cut."""
    findings = []
    # loggers that were started one by one are stopped so, too: less than a revolution is nothing that was cut
    apart = {logger.id for logger in config.loggers if logger.clock == "synchronised"}
    turn = TURN / config.nominal_speed
    for group in _by_clock(config, channels):
        ends = [end_time(channel) for channel in group]
        usual = 1.5 * max(1.0 / channel.sample_rate for channel in group)
        for channel, end in zip(group, ends, strict=True):
            early = max(ends) - end
            if early > (max(usual, turn) if channel.logger in apart else usual):
                begun = end > max(other.start_time for other in group)
                what = "is it cut?" if begun else "another begins later: do their times count from one moment?"
                text = f"the log ends {early:.6g} s before the others on its clock; {what}"
                findings.append(Finding("log_ends_early", "warning", text, f"{channel.path.name} {channel.name}"))
    return findings

"""Check a column of time stamps: start, rate, jumps, damaged stamps of what should be a uniform time base.

Logged stamps are rounded (1e-6 s in many CSV files), so the rate comes from the whole stretch, never from one step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from camtorque.ingest.raw import RawChannel
from camtorque.records import Array, Finding, Refusal, SampleSource
from camtorque.units import DAY, HOUR, counted

BLOCK = 1_000_000
"""Stamps looked at in one go."""
ODD_STEP = 0.5
"""A step that differs by more than this part of a sampling interval is odd: nearer to another sample."""
BESIDE = 8
"""Stamps on either side of an odd step whose medians tell whether time stays where it was."""
MANY_ODD = 0.01
"""Above this share of odd steps the stamps are not a uniform time base."""
COARSEST = 99.0
"""Percentile of the steps of shared stamps that is their coarsest: the rest may be gaps."""
STANDS = 0.1
"""A step of less than this part of a sampling interval is none: the row stands there twice."""
CLOCK_SET = 1.0
"""A step that differs from an hour by less is that of a clock which was set to summer or winter time [s]."""
RATE_NOTE = 1.0e-5
"""Relative difference of two rates that is worth a finding: ten times what a crystal is off."""
RATE_GROSS = 0.05
"""Relative difference of two rates at which one of them is simply wrong."""
EPOCHS = {"1970": 0.0, "1904": 2_082_844_800.0, "1900": 25_569.0 * DAY, "0": 719_529.0 * DAY}
"""Year that stamps count from -> seconds to 1970: Unix; LabVIEW; days of Excel and OLE; days of MATLAB."""
DATES = (1.0e9, 2.9e9)
"""2001 to 2061 in seconds since 1970: so short that the size of a stamp tells its unit and the year it counts from."""


@dataclass(frozen=True)
class Stamps:
    """The time base of one channel: from its time stamps, or from what replaces them."""

    start: float
    rate: float
    breaks: tuple[int, ...] = ()
    break_steps: tuple[float, ...] = ()
    findings: tuple[Finding, ...] = ()

    def channel(self, name: str, unit: str, source: SampleSource, stamp: float | None = None) -> RawChannel:
        """Return a channel whose samples were taken at these times."""
        return RawChannel(name, unit, source, self.start, self.rate, stamp, self.breaks, self.break_steps)


def date_of(stamp: float, *, in_days: bool = False) -> float | None:
    """Return the date of a stamp [s], which may have been days, in seconds since 1970; None where it is no date."""
    years = ("1970", "1900", "0") if in_days else ("1970", "1904")
    return next((date for year in years if DATES[0] < (date := stamp - EPOCHS[year]) < DATES[1]), None)


def read_stamps(times: SampleSource, declared_rate: float, where: str, *, to_seconds: float = 1.0) -> Stamps:
    """Check stamps and return start, rate and jumps.

    Parameters
    ----------
    times : stamps in the unit of the file
    declared_rate : [Hz] of the bench file
    to_seconds : factor from the file's unit to seconds

    Raises
    ------
    Refusal : when there are fewer than two stamps, when they do not run forward, or contradict the declared rate
        grossly
    """
    if resolution := _shared_step(times, to_seconds):
        return _coarse_base(times, declared_rate, where, to_seconds, resolution)
    step, rounding = _usual_step(times, where, to_seconds)
    odd_index, odd_size, passing, damaged, first, last = _odd_steps(times, step, to_seconds)
    steps_seen = last[0] - first[0]
    if odd_index.size > max(3, MANY_ODD * steps_seen):
        raise Refusal(
            f"{where}: {odd_index.size} of {steps_seen} time steps differ from {step:.6g} s by more than half a step; "
            "the samples are not equidistant, export them at one rate"
        )
    true = _not_of_one_stamp(odd_index, odd_size, step)
    damaged, strays = damaged + int(np.sum(~true)) // 2, int(np.sum(true & passing))
    index, size = odd_index[true & ~passing], odd_size[true & ~passing]
    elapsed = last[1] - first[1] - float(np.sum(size))
    if not elapsed > 0.0:
        raise Refusal(f"{where}: the time stamps cover {elapsed:.6g} s for {steps_seen} samples; export them anew")
    rate = steps_seen / elapsed
    findings = [*_stamp_findings(damaged, strays, where), *break_findings(index, size, step, where),
                *_appended(index, size, first[0], step, where)]  # fmt: skip
    # the stamps of the ends are rounded, which bounds how well they tell the rate
    unsure = 2.0 * rounding * rate / max(steps_seen, 1)
    rate, more = agreed_rate(rate, declared_rate, where, "the time stamps say", unsure)
    start = first[1] - first[0] / rate
    return Stamps(start, rate, tuple(index.tolist()), tuple(size.tolist()), (*findings, *more))


def _shared_step(times: SampleSource, to_seconds: float) -> float:
    """Return the step of stamps that several samples share [s], 0 where they do not.

    Such stamps were printed with too few digits, maybe from some time on only: a fixed number of them tells less and
    less of a time that grows.
    """
    steps = np.diff(times.read(max(times.n_samples - BLOCK, 0), times.n_samples) * to_seconds)
    steps = steps[np.isfinite(steps)]
    shared = steps == 0.0
    behind = steps[1:][shared[:-1] & (steps[1:] > 0.0)]
    return float(np.percentile(behind, COARSEST)) if behind.size and np.mean(shared) > MANY_ODD else 0.0


def _coarse_base(times: SampleSource, declared_rate: float, where: str, to_seconds: float, resolution: float) -> Stamps:
    """Return start and rate of stamps that several samples share; they have to follow the declared rate.

    Raises
    ------
    Refusal : when the stamps leave the line of the declared rate by more than their own steps
    """
    stamps = times.read(0, times.n_samples) * to_seconds
    good = np.flatnonzero(np.isfinite(stamps))
    off = stamps[good] - good / declared_rate
    spread = float(np.ptp(off))
    if spread > 2.0 * resolution + 2.0 / declared_rate:
        raise Refusal(
            f"{where}: several samples share each time stamp (they step by {resolution:.6g} s), and sample_rate_hz = "
            f"{declared_rate:.8g} leaves the stamps by {spread:.4g} s over {stamps[good[-1]] - stamps[good[0]]:.6g} s: "
            "give the rate of the logger, export the time with more digits, or leave out rows that stand there twice"
        )
    text = (
        f"several samples share each time stamp, which step by {resolution:.6g} s: the samples are taken as "
        f"equidistant at the declared {declared_rate:.8g} Hz, which the stamps follow within {spread:.4g} s; their "
        "start against other loggers is known to that"
    )
    start = float(np.mean(off))
    return Stamps(start, declared_rate, findings=(Finding("time_stamps_coarse", "warning", text, where),))


def agreed_rate(
    rate: float, declared_rate: float, where: str, what: str, tolerance: float = 0.0
) -> tuple[float, tuple[Finding, ...]]:
    """Hold a file's rate, as ``what`` says it, against the declared one: equal, a finding, or a refusal.

    ``tolerance`` is a relative difference that rounding of the stamps may cause.
    """
    difference = abs(rate / declared_rate - 1.0)
    if difference <= max(tolerance, 1.0e-9):
        return declared_rate, ()
    text = f"{what} {rate:.8g} Hz, recording.toml says {declared_rate:.8g} Hz"
    if difference > RATE_GROSS:
        slips = {"ms or us for s": (1e3, 1e6), "s for ms or us": (1e-3, 1e-6)}
        hint = "".join(
            f", or the unit of the stamps ({slip}?)"
            for slip, factors in slips.items()
            if any(abs(rate * factor / declared_rate - 1.0) <= RATE_GROSS for factor in factors)
        )
        raise Refusal(f"{where}: {text}; correct the one that is wrong{hint}")
    if difference <= RATE_NOTE:
        return rate, ()
    return rate, (Finding("rate_differs", "warning", f"{text}; the rate of the file is used", where),)


def _usual_step(times: SampleSource, where: str, to_seconds: float) -> tuple[float, float]:
    """Return the usual step [s] and a bound of its rounding [s] from the first block."""
    stamps = times.read(0, min(times.n_samples, BLOCK)) * to_seconds
    stamps = stamps[np.isfinite(stamps)]
    if stamps.size < 2:
        found = counted(stamps.size, "sample", "samples")
        raise Refusal(f"{where}: found {found} with a time, expected at least 2; record longer")
    steps = np.diff(stamps)
    step = float(np.median(steps))
    if not step > 0.0:
        backward = bool(np.all(steps < 0.0))
        ask = "the rows run from the newest to the oldest: sort them" if backward else "is this the time column?"
        raise Refusal(f"{where}: time does not run forward (usual step {step:.6g} s); {ask}")
    usual = steps[np.abs(steps - step) < ODD_STEP * step]
    return (float(np.mean(usual)) if usual.size else step), float(np.ptp(usual)) if usual.size else 0.0


def _odd_steps(
    times: SampleSource, step: float, to_seconds: float
) -> tuple[np.ndarray, Array, np.ndarray, int, tuple[int, float], tuple[int, float]]:
    """Return the odd steps and the stamps that frame the log.

    Returns
    -------
    index, excess, passing : of the odd steps: sample behind, by how much too long [s], whether time stays where it was
    damaged, first, last : number of unreadable stamps, first and last good stamp
    """
    indices, sizes, back, damaged = [], [], [], 0
    first: tuple[int, float] | None = None
    last: tuple[int, float] = (0, 0.0)
    for low in range(0, times.n_samples, BLOCK):
        stamps = times.read(low, min(low + BLOCK, times.n_samples)) * to_seconds
        good = np.flatnonzero(np.isfinite(stamps))
        damaged += stamps.size - good.size
        if not good.size:
            continue
        at, value = good + low, stamps[good]
        if first is None:
            first = (int(at[0]), float(value[0]))
        else:
            at, value = np.concatenate(([last[0]], at)), np.concatenate(([last[1]], value))
        excess = np.diff(value) - np.diff(at) * step
        odd = np.flatnonzero(np.abs(excess) > ODD_STEP * step)
        indices.append(at[odd + 1])
        sizes.append(excess[odd])
        # by the medians of those beside, time is as late behind the step as before it
        windows = sliding_window_view(np.pad(value - at * step, BESIDE, mode="edge"), BESIDE)
        before, behind = (np.median(windows[odd + shift], axis=1) for shift in (1, 1 + BESIDE))
        back.append(np.abs(behind - before) < ODD_STEP * step)
        last = (int(at[-1]), float(value[-1]))
    assert first is not None  # _usual_step found good stamps
    return np.concatenate(indices), np.concatenate(sizes), np.concatenate(back), damaged, first, last


def _not_of_one_stamp(index: np.ndarray, size: Array, step: float) -> np.ndarray:
    """Tell odd steps from pairs of them that cancel: one stamp is damaged there, time itself went on."""
    keep = np.ones(index.size, dtype=bool)
    for i in range(index.size - 1):
        if keep[i] and index[i + 1] - index[i] == 1 and abs(size[i] + size[i + 1]) < ODD_STEP * step:
            keep[i] = keep[i + 1] = False
    return keep


def _stamp_findings(damaged: int, strays: int, where: str) -> list[Finding]:
    rows = (
        ("time_stamp_damaged", damaged, "time stamp is damaged", "time stamps are damaged", "the neighbours are used"),
        ("time_stamps_stray", strays, "time step is odd", "time steps are odd",
         "time stays where it was: the stamps scatter, the samples are taken as equidistant"),
    )  # fmt: skip
    return [
        Finding(code, "warning", f"{counted(number, one, many)}; {then}", where)
        for code, number, one, many, then in rows if number
    ]  # fmt: skip


def break_findings(index: np.ndarray, size: Array, step: float, where: str) -> list[Finding]:
    """Tell jumps of a time: at which samples, by how much [s], of a usual step [s]."""
    found = []
    forward, back, twice = size > 0.0, size < -step, np.abs(size + step) < STANDS * step
    rows = (
        (forward, "time_gap", "gap in time", "gaps in time"),
        (~forward & ~back & ~twice, "time_short_step", "step that is too short", "steps that are too short"),
        (twice, "time_repeated", "row has the time of the one before and may stand there twice",
         "rows have the time of the one before: leave out those that are repeated"),
        (back & ~twice, "time_not_monotonic", "place where time runs back", "places where time runs back"),
    )  # fmt: skip
    for chosen, code, one, many in rows:
        if chosen.any():
            at = ", ".join(f"sample {i} ({s:+.6g} s)" for i, s in zip(index[chosen][:3], size[chosen][:3], strict=True))
            was_set = np.any(np.abs(np.abs(size[chosen]) - HOUR) < CLOCK_SET)
            hint = "; was the clock set to summer or winter time? export the log in UTC" if was_set else ""
            found.append(Finding(code, "error", f"{counted(int(chosen.sum()), one, many)}: {at}{hint}", where))
    return found


def _appended(index: np.ndarray, size: Array, first: int, step: float, where: str) -> list[Finding]:
    """Tell where the time is again that of the first sample: a copy of the log, or another one, stands behind it."""
    again = np.flatnonzero(np.abs((index - first) * step + np.cumsum(size)) < ODD_STEP * step)
    if not again.size:
        return []
    text = (
        f"at sample {index[again[0]]} the time begins again as at the start of the file: the log was appended to "
        "itself, so that its cycles count twice, or another log to it; keep one of them"
    )
    return [Finding("log_appended", "error", text, where)]

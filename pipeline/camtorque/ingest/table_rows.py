"""Which rows of a table hold a channel: those between the first and the last time, each one, one in so many, its own.

A table may hold channels of several rates, each in rows of its own, and levels that are written at their changes only.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camtorque.ingest.raw import ArraySource, EveryNth
from camtorque.records import Finding, Refusal, SampleSource
from camtorque.units import counted

END_ROWS = 100_000
"""Rows at either end of a table that are looked at for a time."""
ROWS = 1_000_000
"""Rows looked at in one go."""
MANY_UNEVEN = 0.1
"""Share of steps in time that differ from the usual one by half of it where a table has no one rate."""
MANY_SHARED = 0.01
"""Share of steps of no time above which stamps have too few digits."""
LEVEL_RATES = (1.0e5, 1.0e7)
"""Lowest and highest rate at which levels that are written at their changes are read [Hz]."""
SHORTEST = 20.0
"""Samples of the shortest level."""
MOST_SAMPLES = 2.0e8
"""Samples that held levels may become."""


def where_timed(
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


def rows_of(source: SampleSource, every: int) -> slice:
    """Return the rows that hold a channel: one in so many where a faster one fills the rows between, else all.

    Only where its values stand in each ``every``-th row, or nowhere; the cells between are blank.
    """
    every = max(every, 1)
    block = every * max(ROWS // every, 1)
    held: set[int] = set()
    for low in range(0, source.n_samples if every > 1 else 0, block):
        held |= set((np.flatnonzero(np.isfinite(source.read(low, low + block))) % every).tolist())
    return slice(held.pop() if held else 0, None, every) if len(held) < 2 else slice(0, None, 1)


def spaced(source: SampleSource, times: SampleSource, every: int) -> tuple[SampleSource, SampleSource] | None:
    """Return samples and times of a channel in most ``every``-th rows where rows were lost, None for another channel.

    Behind a gap of the log it stands in other rows; the times tell.
    """
    values = source.read(0, source.n_samples)
    there = np.flatnonzero(np.isfinite(values))
    if there.size < 2 or float(np.mean(np.diff(there) != every)) > MANY_UNEVEN:
        return None
    return ArraySource(values[there]), ArraySource(times.read(0, times.n_samples)[there])


def usual_distance(source: SampleSource) -> int:
    """Return how many rows lie from one value to the next, 1 where there are fewer than two."""
    there = np.flatnonzero(np.isfinite(source.read(0, min(source.n_samples, ROWS))))
    return int(np.median(np.diff(there))) if there.size > 1 else 1


def at(rows: slice, source: SampleSource) -> SampleSource:
    """Return the samples of some rows."""
    return source if rows.step == 1 else EveryNth(source, rows.start, rows.step)


def is_fraction(source: SampleSource, unit: float) -> bool:
    """Tell fractions of a second in a unit [s] from times that run on in it."""
    values = source.read(0, min(source.n_samples, ROWS))
    return bool(((values >= 0.0) & (values * unit < 1.0) | np.isnan(values)).all())


def is_uneven(times: SampleSource) -> bool:
    """Tell times that have no one step: of rows that are written when something happens."""
    steps = np.diff(times.read(0, min(times.n_samples, ROWS)))
    steps = steps[np.isfinite(steps)]
    usual = float(np.median(steps)) if steps.size else 0.0
    return usual > 0.0 and float(np.mean(np.abs(steps - usual) > 0.5 * usual)) > MANY_UNEVEN


def own_rows(source: SampleSource, times: SampleSource) -> tuple[SampleSource, SampleSource]:
    """Return the samples and times of the rows that hold a channel, where rows of other channels stand between."""
    if not is_uneven(times):
        return source, times
    values = source.read(0, source.n_samples)
    there = np.isfinite(values)
    own = ArraySource(times.read(0, times.n_samples)[there])
    if there.all() or not there.any() or are_shared(own):
        return source, times
    return ArraySource(values[there]), own


def are_shared(times: SampleSource) -> bool:
    """Tell times that several samples share, as ones of too few digits: uneven to look at, of even samples."""
    return bool(np.mean(np.diff(times.read(0, min(times.n_samples, ROWS))) == 0.0) > MANY_SHARED)


def are_changes(source: SampleSource, times: SampleSource) -> bool:
    """Tell levels 0 and 1 that stand in uneven rows: written where they change, not sample by sample."""
    if not is_uneven(times) or are_shared(times):
        return False
    return bool(np.isin(source.read(0, source.n_samples), (0.0, 1.0)).all())


def rate_of_changes(times: SampleSource) -> float:
    """Return a rate at which levels that are written at their changes can be read [Hz]; ``times`` in seconds."""
    shortest = np.diff(times.read(0, times.n_samples))
    least = SHORTEST / float(shortest[shortest > 0.0].min())
    return float(np.clip(10.0 ** np.ceil(np.log10(least)), *LEVEL_RATES))


def held(source: SampleSource, times: SampleSource, rate: float, where: str) -> SampleSource:
    """Return levels held from each change to the next, as samples at a rate; ``times`` in seconds."""
    stamps, values = times.read(0, times.n_samples), source.read(0, source.n_samples)
    n_samples = (stamps[-1] - stamps[0]) * rate + 1.0
    if not 0.0 < n_samples < MOST_SAMPLES or (np.diff(stamps) < 0.0).any():
        raise Refusal(
            f"{where}: levels from {stamps[0]:.6g} s to {stamps[-1]:.6g} s, held from change to change, would be "
            f"{n_samples:.3g} samples at {rate:.6g} Hz; expected times that run forward and {MOST_SAMPLES:.0e} samples "
            "at most: correct the times or the unit of the time column, or lower sample_rate_hz"
        )
    grid = stamps[0] + np.arange(int(n_samples)) / rate
    return ArraySource(values[np.searchsorted(stamps, grid + 1e-3 / rate, side="right") - 1])

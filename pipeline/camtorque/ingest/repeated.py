"""Samples of a slow module that a faster table repeats until the next one comes.

The values change at rows that lie whole multiples of one number apart, and nowhere else: each was taken where it first
stands. Taken as they are such steps lie half of that number late, and a level that stands looks clipped. Where the
table's rate is no multiple of the module's, the number is no whole one and each value stands from the next row on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from camtorque.ingest.raw import EveryNth, RawChannel
from camtorque.records import Array, Finding, Integers, SampleSource

LOOKED_AT = 200_000
"""Samples at either end that are looked at."""
LEAST_CHANGES = 100
"""Changes at whole multiples of two, of which chance makes one channel in 2^99; and runs of either of two lengths."""
LATEST = 1.05
"""Rows from where a value is taken to where it stands, at most, with what the places lack by rounding; a noise that
repeats values here and there drifts off a line by ten rows or more."""


@dataclass(frozen=True)
class OneOfEach:
    """One sample of each value that stands in ``every`` rows, no whole number, the first one taken at row ``first``."""

    source: SampleSource
    first: float
    every: float

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return max(math.floor((self.source.n_samples - 1 - self.first) / self.every + 0.5), 0)

    def read(self, start: int, stop: int) -> Array:
        """Return raw samples ``[start, stop)``, each from the middle of the rows in which it stands."""
        start, stop, _ = slice(start, stop).indices(self.n_samples)
        rows = np.rint(self.first + self.every * (np.arange(start, stop) + 0.5)).astype(np.int64)
        return self.source.read(int(rows[0]), int(rows[-1]) + 1)[rows - rows[0]] if rows.size else np.zeros(0)


def without_repeats(raw: RawChannel, where: str) -> tuple[RawChannel, tuple[Finding, ...]]:
    """Return a channel at the rate at which its values were taken, and tell where that is not the table's."""
    if raw.breaks:
        return raw, ()
    first, every = repeats_of(raw.source)
    source: SampleSource = EveryNth(raw.source, int(first), int(every))
    if every == 1:
        first, every = uneven_repeats_of(raw.source)
        source = OneOfEach(raw.source, first, every)
    if every == 1:
        return raw, ()
    rate = raw.sample_rate / every
    text = (
        f"each value stands in {every:.6g} rows, as one of a module of {rate:g} Hz in a table of "
        f"{raw.sample_rate:g} Hz; it counts where it first stands"
    )
    start = raw.start_time + first / raw.sample_rate
    return replace(raw, source=source, sample_rate=rate, start_time=start), (
        Finding("values_repeated", "info", text, where),
    )


def repeats_of(source: SampleSource) -> tuple[float, float]:
    """Return the first row that begins a value, and in how many rows each stands; (0, 1) where that is not so."""
    places = [_changes(source, start) for start in {0, max(source.n_samples - LOOKED_AT, 0)}]
    if min(at.size for at in places) < LEAST_CHANGES:
        return 0, 1
    changes = np.concatenate(places)
    every = int(np.gcd.reduce(changes - changes[0]))
    return int(changes[0]) % every, every


def uneven_repeats_of(source: SampleSource) -> tuple[float, float]:
    """Return the same where the number of rows is no whole one: the first value's time in rows, and the number."""
    if _line(_changes(source, 0)) is None:
        return 0.0, 1.0
    found = _line(np.concatenate([_changes(source, start) for start in range(0, source.n_samples, LOOKED_AT)]))
    return found or (0.0, 1.0)


def _changes(source: SampleSource, start: int) -> Integers:
    """Return the rows of a block whose value is not that of the row before."""
    return start + 1 + np.flatnonzero(np.diff(source.read(start, start + LOOKED_AT + 1)) != 0.0)


def _line(changes: Integers) -> tuple[float, float] | None:
    """Return offset and step of the evenly spaced times, after each of which one of the changes is the next row."""
    gaps = np.diff(changes)
    least = int(np.min(gaps, initial=LOOKED_AT))
    if min(np.sum(gaps == least), np.sum(gaps == least + 1)) < LEAST_CHANGES:
        return None
    alone = gaps <= least + 1  # what is longer holds equal values next to each other
    values = np.where(alone, 1.0, np.rint(gaps / np.mean(gaps[alone])))
    place = np.r_[0.0, np.cumsum(values)]
    centred = place - np.mean(place)
    every = float(np.sum(centred * changes) / np.sum(centred**2))
    rest = changes - every * place
    if np.ptp(rest) > LATEST:
        return None
    return float(0.5 * (np.min(rest) + np.max(rest) - 1.0)) % every, every

"""Samples of a slow module that a faster table repeats until the next one comes.

The values change at rows that lie whole multiples of one number apart, and nowhere else: each was taken where it first
stands. Taken as they are such steps lie half of that number late, and a level that stands looks clipped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from camtorque.ingest.raw import EveryNth, RawChannel
from camtorque.records import Finding, SampleSource

LOOKED_AT = 200_000
"""Samples at either end that are looked at."""
LEAST_CHANGES = 100
"""Changes at whole multiples of two, of which chance makes one channel in 2^99."""


def without_repeats(raw: RawChannel, where: str) -> tuple[RawChannel, tuple[Finding, ...]]:
    """Return a channel at the rate at which its values were taken, and tell where that is not the table's."""
    first, every = repeats_of(raw.source)
    if every == 1 or raw.breaks:
        return raw, ()
    rate = raw.sample_rate / every
    text = (
        f"each value stands in {every} rows, as one of a module of {rate:g} Hz in a table of {raw.sample_rate:g} Hz; "
        "it counts where it first stands"
    )
    found = replace(
        raw, source=EveryNth(raw.source, first, every), sample_rate=rate,
        start_time=raw.start_time + first / raw.sample_rate,
    )  # fmt: skip
    return found, (Finding("values_repeated", "info", text, where),)


def repeats_of(source: SampleSource) -> tuple[int, int]:
    """Return the first row that begins a value, and in how many rows each stands; (0, 1) where that is not so."""
    count = source.n_samples
    starts = {0, max(count - LOOKED_AT, 0)}
    places = [start + 1 + np.flatnonzero(np.diff(source.read(start, start + LOOKED_AT)) != 0.0) for start in starts]
    if min(at.size for at in places) < LEAST_CHANGES:
        return 0, 1
    changes = np.concatenate(places)
    every = int(np.gcd.reduce(changes - changes[0]))
    return int(changes[0]) % every, every

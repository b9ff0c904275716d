"""Edges of a contact that bounces: more than one a pulse."""

from __future__ import annotations

import numpy as np

from camtorque.records import Array
from camtorque.signal.threshold import Threshold

BOUNCE_PERIODS = Threshold(
    0.1, "periods", "physics",
    "An edge that follows the one before within this part of a period is a bounce: no shaft speeds up tenfold."
)  # fmt: skip


def without_bounces(time: Array) -> tuple[Array, int]:
    """Keep the first edge of a burst: the contact closes first and bounces afterwards.

    Parameters
    ----------
    time : (n,) of the edges [s]

    Returns
    -------
    kept, n_bounced : times without bounces, and how many were left out
    """
    if time.size < 3:
        return time, 0
    gaps = np.diff(time)
    shortest = BOUNCE_PERIODS * np.median(gaps[gaps >= 0.5 * np.percentile(gaps, 75)])
    if gaps.min() >= shortest:
        return time, 0
    keep = np.ones(time.size, dtype=bool)
    last = time[0]
    for i in range(1, time.size):
        if time[i] - last < shortest:
            keep[i] = False
        else:
            last = time[i]
    return time[keep], int(np.sum(~keep))

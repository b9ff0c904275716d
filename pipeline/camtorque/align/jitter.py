"""Trigger edges that jitter look like a speed that changes; their periods tell the two apart."""

from __future__ import annotations

import numpy as np

from camtorque.align.quality import CUTS, CycleTable
from camtorque.records import Refusal
from camtorque.signal.threshold import Count, Threshold

LEAST_PERIODS = Count(8, "periods", "statistics", "A correlation of neighbouring periods needs some.")
MOST_LOST = Threshold(
    0.5, "1", "convention",
    "Part of the complete cycles that may fail the cut on steady speed before its cause is looked for."
)  # fmt: skip
ALTERNATES = Threshold(
    -0.25, "1", "statistics",
    "Correlation of neighbouring periods: -0.5 for edges that jitter independently, near +1 for a speed that changes."
)  # fmt: skip


def refuse_jitter(table: CycleTable, name: str) -> None:
    """Refuse a recording of which most cycles are lost because the edges jitter, not because the speed changes.

    An edge that comes late by e makes its period longer by e and the next shorter: periods of variance 2 e^2 whose
    neighbours correlate by -1/2.

    Raises
    ------
    Refusal : naming the jitter
    """
    test, _ = CUTS["start_stop"]
    known = table.complete & ~table.unproven & ~table.clock_jump
    lost = int(np.sum(test(table) & known))
    if known.sum() < LEAST_PERIODS or lost <= MOST_LOST * known.sum():
        return
    period = 2.0 * np.pi / table.speed[known]
    places = np.arange(period.size)
    scatter = period - np.polyval(np.polyfit(places, period, 1), places)
    alternation = float(np.corrcoef(scatter[1:], scatter[:-1])[0, 1])
    if not alternation < ALTERNATES:
        return
    jitter = float(np.std(scatter)) / np.sqrt(2.0)
    raise Refusal(
        f"{name}: the trigger edges jitter by {1e3 * jitter:.2g} ms, {360.0 * jitter / np.median(period):.2g} degrees "
        f"of cam angle: {lost} of {int(known.sum())} cycles change their period by more than "
        f"{100.0 * table.steady_change:.2g} %, and a long one follows a short one (correlation "
        f"{alternation:.2f}), which no shaft does; expected edges that repeat; check gap, mounting and shielding of "
        "the pick-up and the declared edge, or record a tooth wheel"
    )

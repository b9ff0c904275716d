"""The phases of a revolution as the lift tells them: forward stroke, top, return stroke, base circle."""

from __future__ import annotations

import numpy as np

from camtorque.records import Array, ResidualBump
from camtorque.report.chart import Span
from camtorque.units import DEGREE, TURN

ENDS = 2.0e-3
"""Share of the lift within which it counts as base circle, or as top."""
SHORTEST_DEG = 3.0
"""A shorter top is a point between the strokes."""
LEAST_LOBE = 0.3
"""Share of the largest lift from which a rise off the base circle is a lobe."""


def phases(theta: Array, lift: Array) -> tuple[Span, ...]:
    """Return the phases of all lobes over one revolution in degrees, in the order of the angle.

    Parameters
    ----------
    theta : (n,) cam angle [rad]; lift : (n,) [m]
    """
    lobes = sorted(_lobes(theta / DEGREE, (lift - np.min(lift)) / np.ptp(lift)))
    marks = []
    for (start, reach, leave, end), after in zip(lobes, (*lobes[1:], tuple(x + 360.0 for x in lobes[0])), strict=True):
        marks += [("forward stroke", start, reach), ("top", reach, leave), ("return stroke", leave, end),
                  ("base circle", end, after[0])]  # fmt: skip
    return tuple(
        sorted(
            (span for name, low, high in marks if high > low for span in _within_turn(name, low, high)),
            key=lambda span: span.low,
        )
    )


def _lobes(angle: Array, share: Array) -> list[tuple[float, ...]]:
    """Return where each lobe starts, reaches and leaves its top, and ends [deg]; ``share`` of the lift, (n,)."""
    found, left, step = [], share.copy(), 360.0 / share.size
    while np.max(left) > LEAST_LOBE:
        top = int(np.argmax(left))
        after = np.roll(share, -top)
        before = after[::-1]
        leave, reach = (_first(side, (1.0 - ENDS) * share[top]) for side in (after, before))
        down, start = (_first(side, ENDS) for side in (after, before))
        left[np.arange(top - start, top + down) % share.size] = 0.0
        if (leave + reach) * step < SHORTEST_DEG:
            leave = reach = 0
        found.append(tuple(float(angle[top] + place * step) for place in (-start, -reach, leave, down)))
    return found


def strokes(theta: Array, lift: Array) -> tuple[Span, ...]:
    """Return the phases that are strokes."""
    return tuple(span for span in phases(theta, lift) if "stroke" in span.label)


def _first(share: Array, limit: float) -> int:
    """Return the first place below a limit."""
    return int(np.argmax(share < limit)) if np.any(share < limit) else share.size


def _within_turn(name: str, low: float, high: float) -> list[Span]:
    """Return a span, cut in two where it passes the end of the revolution."""
    turn = 360.0 * np.floor(low / 360.0)
    low, high = low - turn, high - turn
    if high <= 360.0:
        return [Span(low, high, name)]
    return [Span(low, 360.0, name), Span(0.0, high - 360.0, name)]


def bump_spans(bumps: tuple[ResidualBump, ...]) -> tuple[Span, ...]:
    """Return where the residual stands out, as loud spans in degrees."""
    return tuple(
        Span(part.low, part.high, f"bump {k}", loud=True)
        for k, bump in enumerate(bumps, 1)
        for part in _within_turn("", bump.start / DEGREE, (bump.stop + TURN * (bump.stop < bump.start)) / DEGREE)
    )

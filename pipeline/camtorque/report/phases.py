"""The phases of a revolution as the lift tells them: forward stroke, top, return stroke, base circle."""

from __future__ import annotations

import numpy as np

from camtorque.records import Array, ResidualBump
from camtorque.report.chart import Span
from camtorque.units import DEGREE

ENDS = 2.0e-3
"""Share of the lift within which it counts as base circle, or as top."""
SHORTEST_DEG = 3.0
"""A shorter top is a point between the strokes."""


def phases(theta: Array, lift: Array) -> tuple[Span, ...]:
    """Return the phases over one revolution in degrees, in the order of the angle.

    Parameters
    ----------
    theta : (n,) cam angle [rad]; lift : (n,) [m]
    """
    share = (lift - np.min(lift)) / np.ptp(lift)
    top = int(np.argmax(share))
    turned = np.roll(share, -top)
    before, after = turned[::-1], turned
    angle, step = theta / DEGREE, 360.0 / theta.size
    leave, reach = _first(after, 1.0 - ENDS), _first(before, 1.0 - ENDS)
    down, start = _first(after, ENDS), _first(before, ENDS)
    highest = angle[top]
    if (leave + reach) * step < SHORTEST_DEG:
        leave = reach = 0
    marks = (
        ("forward stroke", highest - start * step, highest - reach * step),
        ("top", highest - reach * step, highest + leave * step),
        ("return stroke", highest + leave * step, highest + down * step),
        ("base circle", highest + down * step, highest - start * step + 360.0),
    )
    return tuple(
        sorted(
            (span for name, low, high in marks if high > low for span in _within_turn(name, low, high)),
            key=lambda span: span.low,
        )
    )


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
        for part in _within_turn("", bump.start / DEGREE, _after(bump) / DEGREE)
    )


def _after(bump: ResidualBump) -> float:
    """Return the end of a bump, past the zero of the angle where it wraps."""
    return bump.stop if bump.stop >= bump.start else bump.stop + 2.0 * np.pi

"""The elements of an SVG drawing as strings: ticks, texts, lines, paths; every text escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from markupsafe import escape

from camtorque.jsonable import clean
from camtorque.records import Array
from camtorque.report.chart import Band, Line, Marks, fill, stroke
from camtorque.report.numbers import MINUS

FONT = "-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,'DejaVu Sans',sans-serif"
FONT_SIZE = 12.0
WIDTH_OF_LETTER = 0.57
"""Mean width of a letter over the size of the font: legends are laid out without measuring text."""
TENTHS = 10.0
"""Curves are written in tenths of a pixel, which need no decimal point."""
SMALLEST_STEP = 0.3
"""A point that lies nearer than this to the line between its neighbours [px] is left out."""


Entry = TypeVar("Entry", Marks, Line | Band)


@dataclass(frozen=True)
class Scale:
    """Maps values to pixels."""

    low: float
    high: float
    start: float
    stop: float
    log: bool = False

    def __call__(self, value: float) -> float:
        """Return the place of one value [px]."""
        return float(self.places(np.array([value]))[0])

    def within(self, value: float) -> float:
        """Return the place of a value that is held within the scale [px]."""
        return self(min(max(value, self.low), self.high))

    def places(self, values: Array) -> Array:
        """Return the places of values [px]."""
        low, high = (math.log10(self.low), math.log10(self.high)) if self.log else (self.low, self.high)
        shown = np.log10(values) if self.log else values
        return self.start + (shown - low) / (high - low) * (self.stop - self.start)


def text_width(text: str, size: float = FONT_SIZE) -> float:
    """Return about how wide a text is [px]."""
    return WIDTH_OF_LETTER * size * len(text)


def text(x: float, y: float, words: str, anchor: str = "start", tone: str = "ink", extra: str = "") -> str:
    """Return a text element; ``anchor`` is ``start``, ``middle`` or ``end``."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" {fill(tone)} {extra}>{escape(clean(words))}</text>'


def line(x1: float, y1: float, x2: float, y2: float, tone: str, width: float = 1.0, dash: str = "") -> str:
    """Return a straight line."""
    pattern = f' stroke-dasharray="{dash}"' if dash else ""
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} {stroke(tone)} stroke-width="{width:g}"{pattern}/>'


def box(x: float, y: float, width: float, height: float, tone: str) -> str:
    """Return a filled rectangle."""
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{max(width, 0):.1f}" height="{max(height, 0):.1f}" {fill(tone)}/>'


def circle(x: float, y: float, radius: float, tone: str, ring: bool = False) -> str:
    """Return a point, or a ring."""
    look = f'fill="none" {stroke(tone)} stroke-width="1.5"' if ring else fill(tone)
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" {look}/>'


def in_lines(entries: Iterable[Entry], width: float, symbol: float) -> list[list[Entry]]:
    """Return the entries of a legend by lines of some width; each takes its text and the room of a symbol [px]."""
    lines: list[list[Entry]] = []
    used = math.inf
    for entry in entries:
        size = symbol + text_width(entry.label)
        if used + size > width:
            lines.append([])
            used = 0.0
        lines[-1].append(entry)
        used += size
    return lines


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Return round values within a range."""
    span = high - low
    if not (math.isfinite(span) and span > 0.0):
        return [low]
    raw = span / max(most, 1)
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(unit * factor for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if unit * factor >= raw * (1.0 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def log_ticks(low: float, high: float) -> list[float]:
    """Return powers of ten within a range, with 2 and 5 between them where there are few."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found = [10.0**k for k in decades if low <= 10.0**k <= high]
    if len(found) >= 3:
        return found
    return [f * 10.0**k for k in decades for f in (1.0, 2.0, 5.0) if low <= f * 10.0**k <= high]


def tick_text(value: float, step: float) -> str:
    """Return the text of a tick with as many decimals as the step between ticks needs."""
    if abs(value) < 1e-9 * step:
        value = 0.0
    decimals = max(0, min(6, math.ceil(-math.log10(step) - 1e-9))) if step > 0.0 else 0
    if step > 0.0 and abs(round(step * 10**decimals) - step * 10**decimals) > 1e-6 * step * 10**decimals:
        decimals += 1
    shown = f"{value:.{decimals}f}" if 1e-5 <= step < 1e6 else f"{value:.4g}"
    return shown.replace("-", MINUS)


def tick_texts(places: Sequence[float]) -> list[tuple[float, str]]:
    """Return ticks at even steps, each with its text."""
    step = places[1] - places[0] if len(places) > 1 else 1.0
    return [(place, tick_text(place, step)) for place in places]


def padded(values: Iterable[Array], share: float = 0.06) -> tuple[float, float]:
    """Return the range of all finite values with a margin."""
    finite = [part[np.isfinite(part)] for part in values]
    finite = [part for part in finite if part.size]
    if not finite:
        return -1.0, 1.0
    low, high = min(float(part.min()) for part in finite), max(float(part.max()) for part in finite)
    margin = share * (high - low) or 0.05 * abs(high) or 1.0
    return low - margin, high + margin


def simplified(x: Array, y: Array) -> tuple[Array, Array]:
    """Return a curve in pixels without the points that cannot be seen (Douglas and Peucker 1973, all segments at once).

    Where several points fall on one column of pixels, the extremes of each column stay.
    """
    if x.size > 3.0 * max(x[-1] - x[0], 1.0):
        column = np.floor(x).astype(int)
        starts = np.flatnonzero(np.r_[True, np.diff(column) > 0])
        order = np.lexsort((y, column))
        ends = np.r_[starts[1:], x.size] - 1
        keep = np.unique(np.r_[0, order[starts], order[ends], x.size - 1])
        x, y = x[keep], y[keep]
    kept = np.zeros(x.size, dtype=bool)
    kept[[0, -1]] = True
    while True:
        places = np.flatnonzero(kept)
        distance = np.abs(y - np.interp(x, x[places], y[places]))
        largest = np.maximum.reduceat(distance, places[:-1]) if places.size > 1 else np.zeros(1)
        mine = np.minimum(np.cumsum(kept), largest.size) - 1
        more = (distance > SMALLEST_STEP) & (distance >= largest[mine])
        if not np.any(more & ~kept):
            return x[kept], y[kept]
        kept |= more


def runs(*values: Array) -> list[slice]:
    """Return the stretches where all values are finite."""
    good = np.all([np.isfinite(part) for part in values], axis=0)
    edges = np.flatnonzero(np.diff(np.r_[False, good, False].astype(int)))
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def path_data(x: Array, y: Array, start: str = "M") -> str:
    """Return a polyline as path data in tenths of a pixel, relative after its first point."""
    points = np.rint(np.column_stack([x, y]) * TENTHS).astype(int)
    steps = np.diff(points, axis=0)
    steps = steps[np.any(steps != 0, axis=1)]
    return f"{start}{points[0, 0]} {points[0, 1]}" + "".join(f"l{dx} {dy}" for dx, dy in steps.tolist())


def polyline(x: Array, y: Array, tone: str, width: float, dash: str) -> str:
    """Return a curve in pixels, with gaps where it is not finite."""
    data = "".join(path_data(*simplified(x[part], y[part])) for part in runs(y) if part.stop - part.start > 1)
    pattern = f' stroke-dasharray="{" ".join(str(10 * int(k)) for k in dash.split())}"' if dash else ""
    return (
        f'<path transform="scale(.1)" d="{data}" fill="none" {stroke(tone)} stroke-width="{width * TENTHS:g}"'
        f' stroke-linejoin="round"{pattern}/>'
    )


def dots(x: Array, y: Array, tone: str, size: float) -> str:
    """Return points in pixels as one path of steps from each to the next: a thousand of them stay small."""
    steps = np.diff(np.rint(np.column_stack([x, y]) * TENTHS).astype(int), axis=0, prepend=0)
    data = "".join(f"m{across} {along}h0" for across, along in steps.tolist())
    look = f'stroke-width="{size * TENTHS:g}" stroke-linecap="round"'
    return f'<path transform="scale(.1)" d="{data}" fill="none" {stroke(tone)} {look}/>'


def area(x: Array, low: Array, high: Array, tone: str) -> str:
    """Return the shape between two curves in pixels."""
    data = ""
    for part in runs(low, high):
        if part.stop - part.start > 1:
            upper, lower = simplified(x[part], high[part]), simplified(x[part], low[part])
            data += path_data(*upper) + path_data(lower[0][::-1], lower[1][::-1], "L") + "z"
    return f'<path transform="scale(.1)" d="{data}" {fill(tone)} fill-opacity=".75"/>'


def drawing(width: float, height: float, label: str, parts: Iterable[str], role: str = "img") -> str:
    """Return the SVG element; ``label`` is what a screen reader says, ``role`` is ``group`` where parts are links."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" role="{role}" '
        f'aria-label="{escape(clean(label))}" font-family="{FONT}" font-size="{FONT_SIZE:g}">'
        + "".join(parts) + "</svg>"
    )  # fmt: skip

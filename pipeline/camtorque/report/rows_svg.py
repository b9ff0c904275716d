"""Named rows as SVG: bars, points with intervals, and stacked shares, in panels beside each other."""

from __future__ import annotations

import math
import textwrap

import numpy as np

from camtorque.report.chart import Marks, RowPanel, Rows
from camtorque.report.svg import (
    Scale,
    box,
    circle,
    drawing,
    in_lines,
    line,
    log_ticks,
    padded,
    text,
    text_width,
    tick_texts,
    ticks,
)

ROW, TOP, RIGHT, GAP, LEGEND_LINE, LINE = 24.0, 8.0, 16.0, 26.0, 18.0, 15.0
SMALL = 11.0
SMALLEST_BAR = 0.3
"""A part of a stack below this width [px] is not drawn."""
NOTE_ROOM = 0.22
"""Share of a panel's width that is kept free for the notes at the ends of its bars."""


def rows_svg(chart: Rows, label: str) -> str:
    """Return the drawing of rows; ``label`` is what a screen reader says of it."""
    left = 14.0 + max((text_width(name) for name in chart.labels), default=0.0)
    panels = len(chart.panels)
    width = (chart.width - left - RIGHT - GAP * (panels - 1)) / panels
    room = width if panels > 1 else chart.width
    legends = [in_lines((item for item in panel.marks if item.label), room, 30.0) for panel in chart.panels]
    names = [textwrap.wrap(panel.abscissa, int(chart.width / panels / text_width("n"))) for panel in chart.panels]
    top = TOP + LEGEND_LINE * max(map(len, legends))
    bottom = top + ROW * len(chart.labels)
    parts = [text(left - 8.0, top + ROW * (k + 0.5) + 4.0, name, "end") for k, name in enumerate(chart.labels)]
    for k, (panel, legend) in enumerate(zip(chart.panels, legends, strict=True)):
        start = left + k * (width + GAP)
        parts += _panel(panel, (start, start + width), (top, bottom))
        parts += _legend(legend, start if panels > 1 else 0.0)
        for number, words in enumerate(names[k]):  # below the axis, within the drawing
            half = 0.5 * text_width(words)
            middle = min(max(start + 0.5 * width, half), chart.width - half)
            parts.append(text(middle, bottom + 33.0 + LINE * number, words, "middle"))
    return drawing(chart.width, bottom + 25.0 + LINE * max(map(len, names)), label, parts)


def _scale(panel: RowPanel, start: float, stop: float) -> Scale:
    if panel.limits is not None:
        return Scale(*panel.limits, start, stop, panel.log)
    ends = [np.array(part, dtype=float) for item in panel.marks for part in (item.values, item.low, item.high)
            if part is not None]  # fmt: skip
    if panel.log:
        good = np.concatenate([part[np.isfinite(part) & (part > 0.0)] for part in ends])
        low, high = (good.min() / 1.3, good.max() * 1.3) if good.size else (0.1, 1.0)
        return Scale(float(low), float(high), start, stop, True)
    if any(item.kind == "bar" for item in panel.marks):
        ends.append(np.zeros(1))
    ends += [np.array(panel.shaded, dtype=float)] if panel.shaded else []
    return Scale(*padded(ends, NOTE_ROOM if panel.notes else 0.05), start, stop)


def _panel(panel: RowPanel, across: tuple[float, float], rows: tuple[float, float]) -> list[str]:
    scale, (top, bottom) = _scale(panel, *across), rows
    parts = []
    if panel.shaded:
        low, high = map(scale.within, panel.shaded)
        parts.append(box(low, top, high - low, bottom - top, "soft"))
    if panel.log:
        marks = [(place, f"{place:g}") for place in log_ticks(scale.low, scale.high)]
    else:
        marks = tick_texts(ticks(scale.low, scale.high, int((scale.stop - scale.start) / 62)))
    for place, words in marks:
        parts.append(line(scale(place), top, scale(place), bottom, "grid"))
        parts.append(text(scale(place), bottom + 15.0, words, "middle", "muted"))
    if not panel.log and scale.low < 0.0 < scale.high:
        parts.append(line(scale(0.0), top, scale(0.0), bottom, "axis"))
    for item in panel.marks:
        parts += _marks(item, scale, top)
    parts += _notes(panel, scale, top)
    return parts


def _marks(item: Marks, scale: Scale, top: float) -> list[str]:
    parts = []
    for k, value in enumerate(item.values):
        if not math.isfinite(value):
            continue
        tone, middle = item.tones[k % len(item.tones)], top + ROW * (k + 0.5)
        if item.kind == "stack":
            assert item.low is not None
            if scale(value) - scale(item.low[k]) < SMALLEST_BAR:
                continue
            parts.append(box(scale(item.low[k]), middle - 8.0, scale(value) - scale(item.low[k]), 16.0, tone))
            continue
        place = scale.within(value)
        if item.kind == "bar":
            zero = scale.within(0.0)
            parts.append(box(min(zero, place), middle - 7.5, abs(place - zero), 15.0, tone))
        if item.low is not None and item.high is not None:
            parts += _interval(item.low[k], item.high[k], scale, middle, "ink" if item.kind == "bar" else tone)
        if item.kind in ("point", "ring"):
            parts.append(circle(place, middle, 4.0, tone, item.kind == "ring"))
    return parts


def _interval(low: float, high: float, scale: Scale, middle: float, tone: str) -> list[str]:
    if not (math.isfinite(low) and math.isfinite(high)):
        return []
    ends = [scale.within(end) for end in (low, high)]
    return [line(ends[0], middle, ends[1], middle, tone, 1.4)] + [
        line(end, middle - 4.0, end, middle + 4.0, tone, 1.4) for end in ends
    ]


def _notes(panel: RowPanel, scale: Scale, top: float) -> list[str]:
    """Return the text at the end of each row's mark, on the side where there is no bar."""
    parts = []
    for k, note in enumerate(panel.notes):
        highs = [part[k] for item in panel.marks for part in (item.values, item.high) if part is not None]
        lows = [part[k] for item in panel.marks for part in (item.values, item.low) if part is not None]
        highs, lows = [v for v in highs if math.isfinite(v)], [v for v in lows if math.isfinite(v)]
        place, anchor = scale.within(0.0) + 5.0, "start"
        left = scale(max(min(lows, default=0.0), scale.low)) - 5.0
        if highs and max(highs) <= 0.0 and min(lows) < 0.0 and left - text_width(note, SMALL) > scale.start:
            place, anchor = left, "end"
        elif highs and max(highs) > 0.0:
            place = min(scale(min(max(highs), scale.high)) + 5.0, scale.stop - text_width(note, SMALL))
        parts.append(text(place, top + ROW * (k + 0.5) + 4.0, note, anchor, "muted", f'font-size="{SMALL:g}"'))
    return parts


def _legend(rows: list[list[Marks]], start: float) -> list[str]:
    parts = []
    for number, row in enumerate(rows):
        x, y = start, TOP + LEGEND_LINE * number + 11.0
        for item in row:
            tone = item.tones[0]
            if item.kind in ("point", "ring"):
                parts.append(circle(x + 6.0, y - 4.0, 4.0, tone, item.kind == "ring"))
            else:
                parts.append(box(x, y - 9.0, 12.0, 10.0, tone))
            parts.append(text(x + 17.0, y, item.label, "start", "muted"))
            x += 30.0 + text_width(item.label)
    return parts

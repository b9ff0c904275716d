"""Charts as SVG: curves in panels above each other, and named rows with bars, points or stacked shares beside them."""

from __future__ import annotations

import math
import textwrap
from itertools import count

import numpy as np

from camtorque.records import Array, Mask
from camtorque.report.chart import Band, Curves, Line, Marks, Panel, RowPanel, Rows, stroke
from camtorque.report.svg import (
    Scale,
    area,
    box,
    circle,
    dots,
    drawing,
    in_lines,
    line,
    log_ticks,
    padded,
    polyline,
    text,
    text_width,
    tick_texts,
    ticks,
)

LEFT, RIGHT, TOP, BOTTOM, LEGEND_LINE, GAP = 64.0, 12.0, 8.0, 38.0, 18.0, 14.0
BESIDE_TICKS = 28.0
"""Room on the left for the turned name of an ordinate and the gap behind its ticks [px]."""
POINT = 5.2
"""Width of a point [px]."""
BETWEEN_NAMES, NAME_LINE = 4.0, 13.0
"""Least room between the names of two stretches, and how far below each other they stand where they have less [px]."""
TURN_TICKS = tuple(45.0 * k for k in range(9))


def curves_svg(chart: Curves, label: str) -> str:
    """Return the drawing of curves; ``label`` is what a screen reader says of it."""
    low, high = chart.x_range or ((0.0, 360.0) if chart.full_turn else padded([chart.x], 0.03))
    inside = (chart.x >= low) & (chart.x <= high)
    ordinates = [_ordinate(panel, inside) for panel in chart.panels]
    widest = max((text_width(words) for _, ticks_of in ordinates for _, words in ticks_of), default=0.0)
    across = Scale(low, high, max(LEFT, BESIDE_TICKS + widest), chart.width - RIGHT)
    parts, y = [], TOP + (16.0 if any(not span.loud for span in chart.spans) else 0.0)
    for number, (panel, ordinate) in enumerate(zip(chart.panels, ordinates, strict=True)):
        legend = _legend(panel, across.stop - across.start)
        y += LEGEND_LINE * len(legend)
        parts += _shaded(chart, across, y, panel.height, number == 0, y - LEGEND_LINE * len(legend))
        parts += _panel(panel, chart.x[inside], inside, across, y, *ordinate)
        parts += _legend_drawn(legend, across.start, y)
        y += panel.height + GAP
    bottom = y - GAP
    turn = chart.full_turn and chart.x_range is None
    marks = tick_texts(TURN_TICKS if turn else ticks(low, high, 8))
    parts += [text(across(place), bottom + 16.0, words, "middle", "muted") for place, words in marks]
    parts.append(text(0.5 * (across.start + across.stop), bottom + 33.0, chart.abscissa, "middle"))
    return drawing(chart.width, bottom + BOTTOM, label, parts)


def _shaded(chart: Curves, across: Scale, y: float, height: float, first: bool, above: float) -> list[str]:
    """Return the named spans behind a panel; names stand above the first panel, loud ones in it, below each other."""
    boxes, names, written = list[str](), list[str](), list[tuple[float, int]]()
    for span in chart.spans:
        start, stop = across(max(span.low, across.low)), across(min(span.high, across.high))
        if stop <= start:
            continue
        boxes.append(box(start, y, stop - start, height, "warnsoft" if span.loud else "soft"))
        middle, width = 0.5 * (start + stop), text_width(span.label)
        if first and span.loud:
            middle = min(max(middle, across.start + 0.5 * width), across.stop - 0.5 * width)
            under = {place for other, place in written if abs(other - middle) < width + BETWEEN_NAMES}
            written.append((middle, place := next(k for k in count() if k not in under)))
            names.append(text(middle, y + 11.0 + NAME_LINE * place, span.label, "middle", "warn"))
        elif first and stop - start > width:
            names.append(text(middle, above - 4.0, span.label, "middle", "muted"))
    return boxes + names


def _ordinate(panel: Panel, inside: Mask) -> tuple[tuple[float, float], list[tuple[float, str]]]:
    """Return the range of a panel's ordinate, and its ticks with their texts."""
    ends = [part[inside] for item in panel.bands for part in (item.low, item.high)]
    for item in panel.lines:
        error = 0.0 if item.error is None else np.nan_to_num(item.error)
        ends += [(item.values + side * error)[inside] for side in (-1.0, 1.0)]
    low, high = panel.limits or padded(ends)
    return (low, high), tick_texts(ticks(low, high, max(4, int(panel.height / 38.0))))


def _panel(
    panel: Panel, x: Array, inside: Mask, across: Scale, y: float, ends: tuple[float, float],
    marks: list[tuple[float, str]],
) -> list[str]:  # fmt: skip
    up, left = Scale(*ends, y + panel.height, y), across.start
    parts = [line(left, up(place), across.stop, up(place), "grid") for place, _ in marks]
    parts += [text(left - 6.0, up(place) + 4.0, words, "end", "muted") for place, words in marks]
    if panel.zero and up.low < 0.0 < up.high:
        parts.append(line(left, up(0.0), across.stop, up(0.0), "axis", 0.8))
    place = across.places(x)
    for band in panel.bands:
        low_edge, high_edge = (_clipped(up.places(part[inside]), y, panel) for part in (band.low, band.high))
        parts.append(area(place, low_edge, high_edge, band.tone))
    for item in panel.lines:
        parts.append(_drawn(item, place, inside, up, y, panel))
    parts.append(line(left, y, left, y + panel.height, "axis"))
    parts.append(line(left, y + panel.height, across.stop, y + panel.height, "axis"))
    middle = y + 0.5 * panel.height
    parts.append(text(14.0, middle, panel.ordinate, "middle", "ink", f'transform="rotate(-90 14 {middle:.1f})"'))
    return parts


def _clipped(places: Array, y: float, panel: Panel) -> Array:
    """Return places held within the panel: a curve beyond fixed limits runs along the edge."""
    return places if panel.limits is None else np.clip(places, y, y + panel.height)


def _drawn(item: Line, place: Array, inside: Mask, up: Scale, y: float, panel: Panel) -> str:
    values = item.values[inside]
    if not item.points:
        return polyline(place, _clipped(up.places(values), y, panel), item.tone, item.width, item.dash)
    good = np.isfinite(values)
    across, along = place[good], up.places(values[good])
    parts = []
    if item.error is not None:
        error = np.nan_to_num(item.error[inside])[good]
        ends = zip(across, up.places(values[good] - error), up.places(values[good] + error), strict=True)
        data = "".join(f"M{x:.1f} {low:.1f}V{high:.1f}" for x, low, high in ends)
        parts.append(f'<path d="{data}" fill="none" {stroke(item.tone)}/>')
    return "".join(parts) + dots(across, along, item.tone, POINT)


def _legend(panel: Panel, width: float) -> list[list[Line | Band]]:
    """Return the entries of a legend by lines; one curve that has the name of its ordinate needs none."""
    if not panel.keys:
        return []
    entries: list[Line | Band] = [*panel.lines, *panel.bands]
    if len(entries) == 1 and entries[0].label in panel.ordinate:
        return []
    return in_lines(entries, width, 44.0)


def _legend_drawn(rows: list[list[Line | Band]], left: float, bottom: float) -> list[str]:
    parts = []
    for number, row in enumerate(rows):
        x, y = left, bottom - LEGEND_LINE * (len(rows) - number) + 12.0
        for entry in row:
            if isinstance(entry, Band):
                parts.append(box(x, y - 9.0, 22.0, 9.0, entry.tone))
            elif entry.points:
                parts.append(circle(x + 11.0, y - 4.0, 2.8, entry.tone))
            else:
                parts.append(line(x, y - 4.0, x + 22.0, y - 4.0, entry.tone, max(entry.width, 1.5), entry.dash))
            parts.append(text(x + 28.0, y, entry.label, "start", "muted"))
            x += 44.0 + text_width(entry.label)
    return parts


ROW, ROWS_RIGHT, ROWS_GAP, LINE = 24.0, 16.0, 26.0, 15.0
SMALL = 11.0
SMALLEST_BAR = 0.3
"""A part of a stack below this width [px] is not drawn."""
NOTE_ROOM = 0.22
"""Share of a panel's width that is kept free for the notes at the ends of its bars."""


def rows_svg(chart: Rows, label: str) -> str:
    """Return the drawing of rows; ``label`` is what a screen reader says of it."""
    left = 14.0 + max((text_width(name) for name in chart.labels), default=0.0)
    panels = len(chart.panels)
    width = (chart.width - left - ROWS_RIGHT - ROWS_GAP * (panels - 1)) / panels
    room = width if panels > 1 else chart.width
    legends = [in_lines((item for item in panel.marks if item.label), room, 30.0) for panel in chart.panels]
    names = [textwrap.wrap(panel.abscissa, int(chart.width / panels / text_width("n"))) for panel in chart.panels]
    top = TOP + LEGEND_LINE * max(map(len, legends))
    bottom = top + ROW * len(chart.labels)
    parts = [text(left - 8.0, top + ROW * (k + 0.5) + 4.0, name, "end") for k, name in enumerate(chart.labels)]
    for k, (panel, legend) in enumerate(zip(chart.panels, legends, strict=True)):
        start = left + k * (width + ROWS_GAP)
        parts += _row_panel(panel, (start, start + width), (top, bottom))
        parts += _legend_of_rows(legend, start if panels > 1 else 0.0)
        for number, words in enumerate(names[k]):  # below the axis, within the drawing
            half = 0.5 * text_width(words)
            middle = min(max(start + 0.5 * width, half), chart.width - half)
            parts.append(text(middle, bottom + 33.0 + LINE * number, words, "middle"))
    return drawing(chart.width, bottom + 25.0 + LINE * max(map(len, names)), label, parts)


def _row_scale(panel: RowPanel, start: float, stop: float) -> Scale:
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


def _row_panel(panel: RowPanel, across: tuple[float, float], rows: tuple[float, float]) -> list[str]:
    scale, (top, bottom) = _row_scale(panel, *across), rows
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


def _legend_of_rows(rows: list[list[Marks]], start: float) -> list[str]:
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

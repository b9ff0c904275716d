"""Curves as SVG: panels above each other over one abscissa, with legends, shaded stretches and error bars."""

from __future__ import annotations

from itertools import count

import numpy as np

from camtorque.records import Array, Mask
from camtorque.report.chart import Band, Curves, Line, Panel
from camtorque.report.svg import (
    Scale,
    area,
    box,
    circle,
    dots,
    drawing,
    in_lines,
    line,
    padded,
    polyline,
    text,
    text_width,
    tick_texts,
    ticks,
)
from camtorque.report.tones import stroke

LEFT, RIGHT, TOP, BOTTOM, LEGEND_LINE, GAP = 64.0, 12.0, 8.0, 38.0, 18.0, 14.0
POINT = 5.2
"""Width of a point [px]."""
BETWEEN_NAMES, NAME_LINE = 4.0, 13.0
"""Least room between the names of two stretches, and how far below each other they stand where they have less [px]."""
TURN_TICKS = tuple(45.0 * k for k in range(9))


def curves_svg(chart: Curves, label: str) -> str:
    """Return the drawing of curves; ``label`` is what a screen reader says of it."""
    low, high = chart.x_range or ((0.0, 360.0) if chart.full_turn else padded([chart.x], 0.03))
    across = Scale(low, high, LEFT, chart.width - RIGHT)
    inside = (chart.x >= low) & (chart.x <= high)
    parts, y = [], TOP + (16.0 if any(not span.loud for span in chart.spans) else 0.0)
    for number, panel in enumerate(chart.panels):
        legend = _legend(panel, chart.width - LEFT - RIGHT)
        y += LEGEND_LINE * len(legend)
        parts += _shaded(chart, across, y, panel.height, number == 0, y - LEGEND_LINE * len(legend))
        parts += _panel(panel, chart.x[inside], inside, across, y)
        parts += _legend_drawn(legend, y)
        y += panel.height + GAP
    bottom = y - GAP
    turn = chart.full_turn and chart.x_range is None
    marks = tick_texts(TURN_TICKS if turn else ticks(low, high, 8))
    parts += [text(across(place), bottom + 16.0, words, "middle", "muted") for place, words in marks]
    parts.append(text(0.5 * (LEFT + chart.width - RIGHT), bottom + 33.0, chart.abscissa, "middle"))
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


def _panel(panel: Panel, x: Array, inside: Mask, across: Scale, y: float) -> list[str]:
    shown = list(panel.lines)
    ends = [part[inside] for item in panel.bands for part in (item.low, item.high)]
    low, high = panel.limits or padded([item.values[inside] for item in shown] + ends + _error_ends(shown, inside))
    up = Scale(low, high, y + panel.height, y)
    marks = tick_texts(ticks(low, high, max(4, int(panel.height / 38.0))))
    parts = [line(LEFT, up(place), across.stop, up(place), "grid") for place, _ in marks]
    parts += [text(LEFT - 6.0, up(place) + 4.0, words, "end", "muted") for place, words in marks]
    if panel.zero and low < 0.0 < high:
        parts.append(line(LEFT, up(0.0), across.stop, up(0.0), "axis", 0.8))
    place = across.places(x)
    for band in panel.bands:
        low_edge, high_edge = (_clipped(up.places(part[inside]), y, panel) for part in (band.low, band.high))
        parts.append(area(place, low_edge, high_edge, band.tone))
    for item in shown:
        parts.append(_drawn(item, place, inside, up, y, panel))
    parts.append(line(LEFT, y, LEFT, y + panel.height, "axis"))
    parts.append(line(LEFT, y + panel.height, across.stop, y + panel.height, "axis"))
    middle = y + 0.5 * panel.height
    parts.append(text(14.0, middle, panel.ordinate, "middle", "ink", f'transform="rotate(-90 14 {middle:.1f})"'))
    return parts


def _clipped(places: Array, y: float, panel: Panel) -> Array:
    """Return places held within the panel: a curve beyond fixed limits runs along the edge."""
    return places if panel.limits is None else np.clip(places, y, y + panel.height)


def _error_ends(lines: list[Line], inside: Mask) -> list[Array]:
    return [
        part
        for item in lines
        if item.error is not None
        for part in ((item.values - item.error)[inside], (item.values + item.error)[inside])
    ]


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


def _legend_drawn(rows: list[list[Line | Band]], bottom: float) -> list[str]:
    parts = []
    for number, row in enumerate(rows):
        x, y = LEFT, bottom - LEGEND_LINE * (len(rows) - number) + 12.0
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

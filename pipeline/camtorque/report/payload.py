"""Curves as compact data for the script of a page: 16-bit steps of each curve's own range, in base64."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from camtorque.jsonable import clean
from camtorque.records import Array
from camtorque.report.chart import Curves, Line, Panel, Span

STEPS = 65_000.0
"""Steps over the range of a curve: the screen shows a thousand pixels."""
MISSING = -32_768
LARGEST_LIVE = 3_600
"""Points of a curve in a page; a finer grid is thinned, cycles.h5 keeps it."""


def packed(values: Array) -> dict[str, Any]:
    """Return values as base64 of little-endian 16-bit integers ``d``: value = o + k d, -32768 for NaN."""
    good = np.isfinite(values)
    low, high = (float(np.min(values[good])), float(np.max(values[good]))) if good.any() else (0.0, 0.0)
    step = (high - low) / STEPS or 1.0
    middle = 0.5 * (low + high)
    numbers = np.full(values.shape, MISSING, dtype="<i2")
    numbers[good] = np.rint((values[good] - middle) / step)
    return {
        "o": float(f"{middle:.9g}"),
        "k": float(f"{step:.9g}"),
        "d": base64.b64encode(numbers.tobytes()).decode("ascii"),
    }


def curves_payload(name: str, chart: Curves) -> dict[str, Any]:
    """Return one chart as JSON-ready values; ``name`` is the id of its figure in the page."""
    keep = slice(None, None, max(1, -(-chart.x.size // LARGEST_LIVE)))
    return {
        "id": name, "group": "theta" if chart.full_turn else name, "turn": chart.full_turn, "label": chart.abscissa,
        "x": _abscissa(chart.x[keep]), "panels": [_panel(panel, keep) for panel in chart.panels],
        "spans": [_span(span) for span in chart.spans], "links": chart.links,
    }  # fmt: skip


def _abscissa(x: Array) -> dict[str, Any]:
    """Return an abscissa: start, step and count where it is even, single precision otherwise."""
    step = (x[-1] - x[0]) / (x.size - 1) if x.size > 1 else 0.0
    if x.size > 2 and np.allclose(np.diff(x), step, rtol=1e-6, atol=0.0):
        return {"a": float(x[0]), "step": float(step), "n": x.size}
    return {"d": base64.b64encode(np.asarray(x, dtype="<f4").tobytes()).decode("ascii")}


def _panel(panel: Panel, keep: slice) -> dict[str, Any]:
    return {
        "y": panel.ordinate, "h": panel.height, "zero": panel.zero, "lim": panel.limits, "keys": panel.keys,
        "lines": [_line(item, keep) for item in panel.lines],
        "bands": [
            {"l": item.label, "t": item.tone, "lo": packed(item.low[keep]), "hi": packed(item.high[keep])}
            for item in panel.bands
        ],
    }  # fmt: skip


def _line(item: Line, keep: slice) -> dict[str, Any]:
    error = None if item.error is None else packed(item.error[keep])
    return {
        "l": item.label, "t": item.tone, "w": item.width, "s": [int(part) for part in item.dash.split()],
        "p": item.points, "v": packed(item.values[keep]), "e": error,
    }  # fmt: skip


def _span(span: Span) -> dict[str, Any]:
    return {"a": span.low, "b": span.high, "l": span.label, "loud": span.loud}


def chart_data(charts: Mapping[str, Curves], phases: tuple[Span, ...] = ()) -> Markup:
    """Return the data of all charts of a page for its script."""
    drawn = [curves_payload(name, chart) for name, chart in charts.items()]
    return as_data({"charts": drawn, "phases": [_span(span) for span in phases]})


def as_data(data: Mapping[str, Any]) -> Markup:
    """Return JSON as the content of a script element that no browser runs: ``<`` as an escape cannot end it."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Markup(clean(text).replace("<", "\\u003c"))

"""One figure of a trend: each quantity a row, over each condition that varies a column."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from camtorque.report.style import STYLE
from camtorque.report.tones import light

WIDTH, HEIGHT = 3.4, 1.9
"""Of one panel [inch]."""


def trend_figure(table: Any, axes: Mapping[str, str], quantities: Mapping[str, str]) -> Figure:
    """Return the figure of a trend; ``axes``, ``quantities``: column (bars of ``NAME_stderr``) -> label."""
    over = {name: label for name, label in axes.items() if table[name].nunique() > 1} or {"recording": "recording"}
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH * len(over), HEIGHT * len(quantities)), layout="constrained")
        panels = figure.subplots(len(quantities), len(over), squeeze=False, sharex="col", sharey="row")
        for row, (quantity, label) in zip(panels, quantities.items(), strict=True):
            row[0].set_ylabel(label)
            for panel, name in zip(row, over, strict=True):
                _draw(panel, table, name, quantity)
        for panel, label in zip(panels[-1], over.values(), strict=True):
            panel.set_xlabel(label)
            panel.tick_params(axis="x", rotation=0 if label.startswith(("speed", "peak", "fuel")) else 30)
    return figure


def _draw(panel: Axes, table: Any, name: str, quantity: str) -> None:
    rows = table[table[name].notna() & table[quantity].notna()].sort_values(name, kind="stable")
    error = rows[f"{quantity}_stderr"] if f"{quantity}_stderr" in table else None
    place = rows[name].astype("datetime64[ns]") if name == "date" else rows[name]
    panel.errorbar(place, rows[quantity], yerr=error, fmt="o", markersize=4, linewidth=1.0, color=light("fitted"))

"""One quiet style for all figures: colours that colour-blind readers tell apart, thin axes, text left as text."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from camtorque.records import Array
from camtorque.units import DEGREE

MEASURED, FITTED, RIGID, RESIDUAL = "#1b1b1b", "#0072b2", "#d55e00", "#7a4fa3"
FITTED_OVER = "#4db2ec"
"""Colours of Okabe and Ito (2008) and two of the same lightness steps."""
CYCLE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#7a4fa3", "#5f6b6d", "#8c6d31", "#b04a5a")
BAND, GRID, MUTED = "#c3c9cf", "#e6e8eb", "#5b6470"
STYLE: Any = {
    "font.size": 9.5,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8a929b",
    "axes.labelcolor": "#30363d",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=CYCLE),
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.5,
    "svg.fonttype": "none",
    "figure.dpi": 100,
}
LARGEST_CURVE = 1200
"""Points of a curve in a figure; extremes are kept (see `thinned`)."""
LINE_STYLES = ("-", "--", "-.", ":")


def new_figure(rows: int = 1, width: float = 7.2, height: float = 3.4, ratios: Iterable[float] = ()) -> Figure:
    """Return a figure with panels above each other that share the abscissa; it belongs to no window system."""
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.subplots(rows, 1, sharex=True, height_ratios=list(ratios) or None)
    return figure


def thinned(*values: Array) -> tuple[Array, ...]:
    """Return arrays with at most `LARGEST_CURVE` entries, every k-th and the extremes of the last one."""
    size = values[-1].size
    step = max(1, -(-size // LARGEST_CURVE))
    keep = np.unique(np.r_[np.arange(0, size, step), np.argmax(values[-1]), np.argmin(values[-1]), size - 1])
    return tuple(value[keep] for value in values)


def degrees(theta: Array) -> Array:
    """Return angles in degrees."""
    return theta / DEGREE


def curve(axes: Axes, theta: Array, values: Array, label: str, **style: object) -> None:
    """Draw one thinned curve over the cam angle [rad]."""
    angle, shown = thinned(degrees(theta), values)
    axes.plot(angle, shown, label=label, **style)  # type: ignore[arg-type]


def band(axes: Axes, theta: Array, low: Array, high: Array, label: str, color: str = BAND) -> None:
    """Draw a thinned band over the cam angle [rad]."""
    angle, lower, upper = thinned(degrees(theta), low, high)
    axes.fill_between(angle, lower, upper, color=color, linewidth=0, alpha=0.75, label=label)


def label_axes(axes: Axes, ordinate: str, legend: bool = True, **options: object) -> None:
    """Name the ordinate and add the legend."""
    axes.set_ylabel(ordinate)
    if legend:
        axes.legend(**{"loc": "best", **options})  # type: ignore[arg-type]


def full_turn(axes: Axes) -> None:
    """Set the abscissa to one revolution with ticks every 45 degrees."""
    axes.set_xlim(0.0, 360.0)
    axes.set_xticks(range(0, 361, 45))
    axes.set_xlabel("cam angle [deg]")


def svg_text(figure: Figure, name: str) -> str:
    """Return a figure as an SVG element for a page: no XML head, no date, the same bytes for the same data."""
    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    # inside tags only: a number that a reader sees (tick, note) keeps all its digits
    text = re.sub(r"<[^>]+>", lambda tag: re.sub(r"(\d+\.\d\d)\d+", r"\1", tag[0]), text)
    text = re.sub(r"<svg [^>]*?(viewBox=\"[^\"]+\")[^>]*>", r'<svg xmlns="http://www.w3.org/2000/svg" '
                  r'xmlns:xlink="http://www.w3.org/1999/xlink" \1 role="img">', text, count=1)  # fmt: skip
    return re.sub(
        r'\bid="(figure|axes|patch|line2d|text|xtick|ytick|matplotlib\.axis|legend|fillbetween)[^"]*"', "", text
    )

"""Figures that matplotlib draws: a trend over many reports, and the charts and maps of the studies."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from camtorque.report.chart import CYCLE as TONES_OF_CURVES
from camtorque.report.chart import light

WIDTH, HEIGHT = 3.4, 1.9
"""Of one panel [inch]."""


def trend_figure(table: Any, axes: Mapping[str, str], quantities: Mapping[str, str]) -> Figure:
    """Return the figure of a trend.

    Parameters
    ----------
    axes, quantities : column -> label; bars of a quantity go by ``NAME_down`` and ``NAME_up``, else by ``NAME_stderr``
    """
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
            for text in () if label.startswith(("speed", "peak", "fuel")) else panel.get_xticklabels():
                # a turned one that is centred ends below the next tick
                text.set(rotation=30, horizontalalignment="right", rotation_mode="anchor")
    return figure


def _draw(panel: Axes, table: Any, name: str, quantity: str) -> None:
    rows = table[table[name].notna() & table[quantity].notna()].sort_values(name, kind="stable")
    ends = [column for end in ("down", "up") if (column := f"{quantity}_{end}") in table]
    error = rows.reindex(columns=ends or 2 * [f"{quantity}_stderr"]).to_numpy(float).T  # what nothing states is nan
    place = rows[name].astype("datetime64[ns]") if name == "date" else rows[name]
    panel.errorbar(place, rows[quantity], yerr=error, fmt="o", markersize=4, linewidth=1.0, color=light("fitted"))


MEASURED, MUTED = light("measured"), light("muted")
CYCLE = tuple(light(tone) for tone in TONES_OF_CURVES)
STYLE: Any = {
    "font.size": 9.5,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": light("axis"),
    "axes.labelcolor": "#30363d",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=CYCLE),
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "grid.color": light("grid"),
    "grid.linewidth": 0.8,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.5,
    "svg.fonttype": "none",
    "figure.dpi": 100,
}


MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*")
COLOURS = {"works": "#b7e0cf", "degrades": "#fbe3a8", "fails loudly": "#c9ddf2", "fails silently": "#e8927c"}
CHARACTERS_PER_INCH, LINES = 16.0, 4
"""Room for text in a cell of a map."""
SIGNS = {"works": "works", "degrades": "degrades", "fails loudly": "loud", "fails silently": "SILENT"}


def study_figure(part: Mapping[str, Any]) -> Figure:
    """Return the figure of one part of a study: a chart where it has points, a map where it has cells."""
    with mpl.rc_context(STYLE):
        return _chart(part) if "points" in part else _map(part)


def save_study_figure(part: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the figure as PNG and SVG, named after the part, and return the paths."""
    figure = study_figure(part)
    paths = [folder / f"{part['name']}.{kind}" for kind in ("png", "svg")]
    with mpl.rc_context({"svg.hashsalt": part["name"], "svg.fonttype": "none"}):
        figure.savefig(paths[0], dpi=130)
        figure.savefig(paths[1], metadata={"Date": None, "Creator": None})
    return paths


def _xy(points: Sequence[Mapping[str, Any]]) -> tuple[list[float], list[float]]:
    return [point["cost"] for point in points], [point["error"] for point in points]


def _front(points: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    front: list[Mapping[str, Any]] = []
    for point in sorted((p for p in points if p["candidate"]), key=lambda p: (p["cost"], p["error"])):
        if not front or point["error"] < front[-1]["error"]:
            front.append(point)
    return front


def _chart(part: Mapping[str, Any]) -> Figure:
    figure = Figure(figsize=(9.6, 5.4), layout="constrained")
    axes = figure.subplots()
    points = [point for point in part["points"] if point["error"] is not None and math.isfinite(point["error"])]
    families = list(dict.fromkeys(point["family"] for point in points))
    methods, variants = (list(dict.fromkeys(part)) for part in zip(*map(_split, families), strict=True))
    grouped = part["given_cost"]
    for place, family in enumerate(families):
        line = [point for point in points if point["family"] == family]
        method, variant = _split(family)
        hue = methods.index(method) if grouped else place
        shape = variants.index(variant) if grouped else place // len(CYCLE)
        axes.plot(
            *_xy(line), marker=MARKERS[shape % len(MARKERS)], color=CYCLE[hue % len(CYCLE)], markersize=4.5,
            lw=1.6 if line[0]["candidate"] else 1.0, label=family, ls="-" if line[0]["candidate"] else ":",
            alpha=1.0 if line[0]["candidate"] else 0.7,
        )  # fmt: skip
        if not grouped:
            _ends(axes, line, CYCLE[hue % len(CYCLE)])
    front = _front(points)
    if front:
        axes.step(*_xy(front), where="post", color="#30363d", lw=5.0, alpha=0.16, label="Pareto front", zorder=0)
    chosen = [point for point in points if point["default"]]
    axes.plot(*_xy(chosen), ls="", marker="o", ms=13, mfc="none", mec=MEASURED, mew=1.8, label="default")
    axes.set(xscale="log", yscale="log", xlabel=part["cost_label"], ylabel=part["error_label"], title=part["title"])
    axes.margins(x=0.09, y=0.07)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8.5)
    _note(figure, part["note"])
    return figure


def _split(family: str) -> tuple[str, str]:
    """Return method and variant of a family named ``method, variant``."""
    method, _, variant = family.partition(", ")
    return method, variant


def _ends(axes: Axes, line: Sequence[Mapping[str, Any]], colour: str) -> None:
    """Write the setting beside the first and last point of a line."""
    for point in dict.fromkeys((0, len(line) - 1)):
        text = line[point]["setting"]
        axes.annotate(
            text, (line[point]["cost"], line[point]["error"]), xytext=(4, 4), textcoords="offset points", fontsize=7,
            color=colour,
        )  # fmt: skip


def _note(figure: Figure, text: str) -> None:
    if text:
        figure.supxlabel(textwrap.fill(text, 130), fontsize=8, color=MUTED, x=0.01, ha="left")


def _map(part: Mapping[str, Any]) -> Figure:
    cells = part["cells"]
    conditions = list(dict.fromkeys(cell["condition"] for cell in cells))
    methods = list(dict.fromkeys(cell["method"] for cell in cells))
    width = max(9.0, 2.4 + 2.05 * len(methods))
    figure = Figure(figsize=(width, 1.3 + 0.7 * len(conditions)), layout="constrained")
    axes = figure.subplots()
    characters = int(CHARACTERS_PER_INCH * (width - 2.4) / len(methods))
    for cell in cells:
        x, y = methods.index(cell["method"]), conditions.index(cell["condition"])
        axes.add_patch(mpl.patches.Rectangle((x, y), 1, 1, facecolor=COLOURS[cell["verdict"]], edgecolor="white", lw=2))
        detail = textwrap.shorten(cell["detail"], LINES * characters, placeholder=" ...")
        text = "\n".join([SIGNS[cell["verdict"]].upper(), *textwrap.wrap(detail, characters)[: LINES + 1]])
        axes.text(x + 0.02, y + 0.5, text, va="center", ha="left", fontsize=6.6, linespacing=1.05, color="#1b1b1b")
    defaults = {cell["method"] for cell in cells if cell["default"]}
    axes.set(xlim=(0, len(methods)), ylim=(len(conditions), 0))
    axes.set_xticks(
        [i + 0.5 for i in range(len(methods))], [f"{m}\n(default)" if m in defaults else m for m in methods]
    )
    axes.set_yticks([i + 0.5 for i in range(len(conditions))], [textwrap.fill(c, 34) for c in conditions])
    axes.tick_params(length=0, labelsize=8.5, top=True, labeltop=True, bottom=False, labelbottom=False)
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_title(part["title"], pad=14)
    _note(figure, part["note"])
    return figure

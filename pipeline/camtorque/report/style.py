"""The style of charts that matplotlib draws: those of the studies."""

from __future__ import annotations

from typing import Any

from cycler import cycler

from camtorque.report.tones import CYCLE as TONES_OF_CURVES
from camtorque.report.tones import light

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

"""How sure: profiles of what matters, and where each parameter's uncertainty comes from."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator

from camtorque.fit.budget import MODEL, SOURCES, BudgetRow
from camtorque.fit.profiles import THRESHOLD, Profile
from camtorque.records import Array, ParameterEstimate
from camtorque.report.bundle import RunResult
from camtorque.report.style import BAND, CYCLE, FITTED, MUTED, RIGID

HIGHEST_RISE = 6.0
COLUMNS = 3


def profiles(result: RunResult) -> Figure:
    """Draw the profile of every parameter that has one, with the parabola that the covariance would give."""
    found: tuple[Profile, ...] = result.fitted.details.get("profiles", ())
    rows = max(int(np.ceil(len(found) / COLUMNS)), 1)
    figure = Figure(figsize=(9.6, 0.4 + 2.3 * rows), layout="constrained")
    axes = figure.subplots(rows, COLUMNS, squeeze=False, sharey=True)
    for place, item in zip(axes.flat, found, strict=False):
        _one_profile(place, item, result.fitted.parameter(item.name))
    for place in list(axes.flat)[len(found) :]:
        place.set_visible(False)
    if not found:
        figure.text(0.5, 0.5, "no profiles were asked for", ha="center", color=MUTED)
    return figure


def _one_profile(axes: Axes, item: Profile, row: ParameterEstimate) -> None:
    axes.axvspan(*row.ci95, color=BAND, alpha=0.35, linewidth=0)
    axes.plot(item.values, item.rise, "o", color=FITTED, ms=3.5)
    axes.plot(*_smooth(item), color=FITTED)
    if row.stderr_statistical > 0.0:
        grid = np.linspace(item.values[0], item.values[-1], 60)
        axes.plot(grid, ((grid - row.value) / row.stderr_statistical) ** 2, "--", color=RIGID, lw=1)
    axes.axhline(THRESHOLD, color=MUTED, lw=0.8, ls=":")
    axes.set_ylim(-0.3, HIGHEST_RISE)
    axes.set_title(f"{item.name.replace('_', ' ')}: {item.kind}", fontsize=9)
    axes.set_xlabel(f"[{item.unit}]")


def _smooth(item: Profile) -> tuple[Array, Array]:
    """Return the profile between its points: its root is close to a straight line on either side of the best value."""
    root = np.sign(item.values - item.best) * np.sqrt(np.maximum(item.rise, 0.0))
    grid = np.linspace(item.values[0], item.values[-1], 120)
    return grid, PchipInterpolator(item.values, root)(grid) ** 2


def budget(result: RunResult) -> Figure:
    """Draw the share of each source in the variance of every parameter."""
    rows: tuple[BudgetRow, ...] = tuple(row for row in result.fitted.details.get("budget", ()) if row.total > 0.0)
    figure = Figure(figsize=(9.6, 1.6 + 0.24 * max(len(rows), 1)), layout="constrained")
    axes = figure.subplots()
    left = np.zeros(len(rows))
    for k, source in enumerate(SOURCES):
        share = np.array([100.0 * (row.contributions.get(source, 0.0) / row.total) ** 2 for row in rows])
        if np.any(share > 0.5):
            color = BAND if source == MODEL else CYCLE[k % len(CYCLE)]
            axes.barh(range(len(rows)), share, left=left, height=0.7, color=color, label=source)
            left = left + share
    axes.set_yticks(range(len(rows)), [row.name.replace("_", " ") for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("share of the variance [%]")
    axes.grid(False)
    if rows:
        figure.legend(loc="outside lower center", ncols=4, fontsize=8)
    return figure

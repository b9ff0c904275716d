"""The gap between the rigid model and the measurement, by cause."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from camtorque.report.bundle import RunResult
from camtorque.report.gaps import RESIDUAL, GapShare, gap_shares
from camtorque.report.numbers import signed
from camtorque.report.style import CYCLE, FITTED, MUTED

SMALLEST_SHARE = 2.0e-3
"""A cause below this share of the largest one, in both panels, stands in the table only."""


def gap(result: RunResult) -> Figure:
    """Draw what each cause adds to the rigid torque on the forward stroke and at the return minimum."""
    rows = shown(gap_shares(result))
    figure = Figure(figsize=(6.4, 1.0 + 0.34 * max(len(rows), 1)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _bars(left, [row.forward for row in rows], "forward stroke, mean [N m]")
    _bars(right, [row.return_minimum for row in rows], "at the return minimum [N m]")
    left.set_yticks(range(len(rows)), [row.cause.replace("_", " ") for row in rows])
    left.set_ylim(len(rows) - 0.4, -0.6)
    return figure


def shown(rows: tuple[GapShare, ...]) -> list[GapShare]:
    """Return the rows that can be seen in a figure; the residual always."""
    forward = max(abs(row.forward) for row in rows)
    lowest = max(abs(row.return_minimum) for row in rows)
    return [
        row
        for row in rows
        if row.cause == RESIDUAL
        or abs(row.forward) > SMALLEST_SHARE * forward
        or abs(row.return_minimum) > SMALLEST_SHARE * lowest
    ]


def _bars(axes: Axes, values: list[float], name: str) -> None:
    axes.barh(range(len(values)), values, color=[FITTED if value >= 0 else CYCLE[1] for value in values], height=0.62)
    axes.axvline(0.0, color=MUTED, linewidth=0.7)
    for k, value in enumerate(values):
        axes.annotate(
            signed(value), (value, k), xytext=(4 if value >= 0 else -4, 0), textcoords="offset points", va="center",
            ha="left" if value >= 0 else "right", fontsize=8, color=MUTED,
        )  # fmt: skip
    axes.set_xlabel(name)
    axes.margins(x=0.24)

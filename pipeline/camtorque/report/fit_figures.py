"""What the fit decided: the ladder, the parameters against what was known before, correlations, losses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from camtorque.records import LadderRung, ParameterEstimate
from camtorque.report.bundle import RunResult
from camtorque.report.numbers import MINUS
from camtorque.report.style import CYCLE, FITTED, MUTED, RIGID

NOT_LOSSES = ("input", "closure_percent")
CONSERVED = 1.0e-4
"""Share of the input below which a cause gives back over the revolution what it takes."""


def ladder(result: RunResult) -> Figure:
    """Draw the residual of every rung on fitted and held-out cycles."""
    rungs = result.fitted.ladder
    names = rung_names(rungs)
    figure = Figure(figsize=(6.4, max(2.0, 0.8 + 0.32 * len(rungs))), layout="constrained")
    axes = figure.subplots()
    place = np.arange(len(rungs))
    axes.plot([rung.rms_nm for rung in rungs], place, "o", color=FITTED, label="fitted cycles")
    axes.plot([rung.cv_rms_nm for rung in rungs], place, "D", mfc="none", color=RIGID, label="held-out cycles")
    for k, rung in enumerate(rungs):
        if rung.chosen:
            axes.axhspan(k - 0.45, k + 0.45, color="#e5f1f9", zorder=-5, linewidth=0)
    axes.axvline(result.fitted.odd_even_rms, color=MUTED, linestyle=":", label="odd against even cycles")
    axes.set_xscale("log")
    axes.set_yticks(place, names)
    axes.set_ylim(len(rungs) - 0.4, -0.6)
    axes.set_xlabel("RMS residual [N m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, -0.02), ncols=3, fontsize=8, borderaxespad=4.2)
    return figure


def rung_names(rungs: Sequence[LadderRung]) -> list[str]:
    """Return what each rung changes: ``+`` an effect that is added, ``-`` one that is left out of the richer model."""
    names, best = [], next((set(rung.effects) for rung in rungs if rung.chosen), set())
    for rung, before in zip(rungs, [None, *rungs[:-1]], strict=True):
        effects, earlier = set(rung.effects), set(before.effects) if before else set()
        added, dropped = effects - earlier, (best or earlier) - effects or earlier - effects
        if before is None or not effects:
            names.append("torque zero" if rung.n_parameters else "rigid model")
        elif added and earlier < effects:
            names.append("+ " + ", ".join(sorted(added)))
        else:
            names.append(MINUS + " " + ", ".join(sorted(dropped)))
    return names


def priors(result: RunResult) -> Figure:
    """Draw each parameter with a prior in standard deviations of the prior; two of them are shaded."""
    rows = [row for row in result.fitted.parameters if row.prior is not None and row.role != "assumed"]
    figure = Figure(figsize=(6.4, 1.1 + 0.25 * max(len(rows), 1)), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(-2.0, 2.0, color="#eef1f4", zorder=-5, linewidth=0)
    axes.axvline(0.0, color=MUTED, linewidth=0.7)
    for k, row in enumerate(rows):
        value, width = _pull(row)
        color = FITTED if row.identifiable else CYCLE[1]
        axes.errorbar(value, k, xerr=width, fmt="o", ms=4, color=color, elinewidth=1.3)
    axes.set_yticks(range(len(rows)), [row.name.replace("_", " ") for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlabel("distance from what was expected [standard deviations of the prior]")
    return figure


def _pull(row: ParameterEstimate) -> tuple[float, float]:
    assert row.prior is not None
    mean, std = row.prior
    return (row.value - mean) / std, row.stderr / std


def correlations(result: RunResult) -> Figure:
    """Draw the correlation matrix of the fitted parameters."""
    names = [name.split("__")[0].replace("_", " ") for name in result.fitted.correlation_names]
    size = 1.9 + 0.235 * len(names)
    figure = Figure(figsize=(size, size), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(result.fitted.correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7.5)
    axes.set_yticks(range(len(names)), names, fontsize=7.5)
    axes.grid(False)
    figure.colorbar(image, ax=axes, shrink=0.5, label="correlation")
    return figure


def losses(result: RunResult) -> Figure:
    """Draw where the work of one revolution goes."""
    smallest = CONSERVED * abs(result.fitted.losses["input"])
    rows = {k: v for k, v in result.fitted.losses.items() if k not in NOT_LOSSES and abs(v) > smallest}
    figure = Figure(figsize=(6.4, 0.9 + 0.34 * max(len(rows), 1)), layout="constrained")
    axes = figure.subplots()
    values = list(rows.values())
    axes.barh(range(len(rows)), values, color=[FITTED if v >= 0 else CYCLE[1] for v in values], height=0.62)
    axes.axvline(0.0, color=MUTED, linewidth=0.7)
    for k, value in enumerate(values):
        axes.annotate(f"{value:.3g}", (max(value, 0.0), k), xytext=(4, 0), textcoords="offset points", va="center",
                      fontsize=8.5, color=MUTED)  # fmt: skip
    axes.set_yticks(range(len(rows)), [name.replace("_", " ") for name in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.margins(x=0.12)
    axes.set_xlabel("work [J per revolution]")
    return figure

"""Figures of a sampled posterior: corner plot and predictive band. Drawn only when the posterior was asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from camtorque.plain import plain
from camtorque.records import Refusal
from camtorque.report.chart import Band, Curves, Line, Panel
from camtorque.report.document import write_json
from camtorque.report.figures import png_of, svg_of
from camtorque.report.tones import light
from camtorque.report.torque_figures import CAM_ANGLE

SHOWN = (
    "trigger_offset", "shaft_compliance", "dead_volume", "valve_opening", "valve_area", "leakage", "end_of_delivery",
    "bearing_arm", "guide_friction", "torque_zero",
)  # fmt: skip
"""Parameters of the corner plot; all of them are in posterior.json."""
DPI = 110


def save_corner(posterior: Any, path: Path) -> None:
    """Write the corner plot of the parameters that a user asks about first.

    Raises
    ------
    Refusal
        When corner is not installed.
    """
    try:
        import corner
        from matplotlib.figure import Figure
    except ImportError as error:
        raise Refusal("posterior: corner is not installed; install `pip install camtorque[posterior]`") from error
    columns = [k for k, name in enumerate(posterior.names) if name in SHOWN]
    samples = posterior.samples[:, columns]
    moving = [k for k in range(samples.shape[1]) if np.ptp(samples[:, k]) > 0.0]
    labels = [f"{posterior.names[columns[k]]} [{posterior.units[columns[k]]}]" for k in moving]
    figure = Figure(figsize=(2.0 * len(moving), 2.0 * len(moving)))
    corner.corner(samples[:, moving], labels=labels, fig=figure, color=light("fitted"), show_titles=True)
    figure.savefig(path, dpi=DPI)


def band_chart(posterior: Any) -> Curves:
    """Return the predictive band of the torque about its median, 2.5 to 97.5 %."""
    low, middle, high = next(iter(posterior.torque_band.values()))
    angle = np.arange(middle.size) * 360.0 / middle.size
    panel = Panel("torque about the median [N m]", (Line("median", np.zeros_like(middle), "measured", 0.8),),
                  (Band("2.5 to 97.5 %", low - middle, high - middle, "chamber"),))  # fmt: skip
    return Curves(angle, CAM_ANGLE, (panel,))


def write_posterior(posterior: Any, folder: Path) -> dict[str, Any]:
    """Write posterior.json and its two figures into a run's folder; return the content of the former."""
    quantiles = np.quantile(posterior.samples, (0.025, 0.16, 0.5, 0.84, 0.975), axis=0)
    rows = {
        name: {"unit": unit, "median": q[2], "ci68": [q[1], q[3]], "ci95": [q[0], q[4]]}
        for name, unit, q in zip(posterior.names, posterior.units, quantiles.T, strict=True)
    }
    document = plain({
        "schema": "camtorque.posterior/1", "parameters": rows, "samples": posterior.samples.shape[0],
        "acceptance": posterior.acceptance, "autocorrelation_steps": posterior.autocorrelation_steps,
        "trusted": posterior.trusted,
    })  # fmt: skip
    write_json(folder / "posterior.json", document)
    (folder / "figures").mkdir(exist_ok=True)
    save_corner(posterior, folder / "figures" / "posterior_corner.png")
    drawn = svg_of(band_chart(posterior), "predictive band of the torque")
    (folder / "figures" / "posterior_band.png").write_bytes(png_of(drawn))
    return document

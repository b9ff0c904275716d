"""`camtorque study speed-accuracy`: all charts, written and drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pipeline.report.study_figures import save_study_figure
from pipeline.studies.driveline import driveline_chart
from pipeline.studies.dynamics import dynamics_chart
from pipeline.studies.grid import grid_chart, table_charts
from pipeline.studies.table import Chart, document, write_document

Charts = tuple[Chart, ...]
CHARTS: dict[str, Callable[[bool], Charts]] = {
    "grid": lambda quick: (grid_chart(quick), *table_charts(quick)),
    "dynamics": lambda quick: (dynamics_chart(quick),),
    "driveline": lambda quick: (driveline_chart(quick),),
}
"""Part of the study -> its charts."""


def run_speed_accuracy(out: Path, quick: bool = False) -> list[Path]:
    """Measure every chart, write ``speed_accuracy.json`` and one PNG and SVG per chart, and return the paths.

    Parameters
    ----------
    out : folder, made when missing
    quick : fewer settings and repeats, below a minute
    """
    out.mkdir(parents=True, exist_ok=True)
    charts = [chart for build in CHARTS.values() for chart in build(quick)]
    content = document("speed-accuracy", charts, quick)
    paths = [write_document(out / "speed_accuracy.json", content)]
    for part in content["parts"]:
        paths += save_study_figure(part, out)
    return paths

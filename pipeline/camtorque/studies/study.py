"""`camtorque study NAME`: all charts or maps of a study: measured, written, drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from camtorque.progress import Progress, announced, silent
from camtorque.report.files import write_json
from camtorque.report.folder import output_files
from camtorque.report.plots import save_study_figure
from camtorque.studies.driveline import driveline_chart
from camtorque.studies.dynamics import dynamics_chart
from camtorque.studies.grid import grid_chart, table_charts
from camtorque.studies.resampling import resampling_charts
from camtorque.studies.stability_align import align_map
from camtorque.studies.stability_driveline import drift_map, event_map, multiplier_map, stiffness_map
from camtorque.studies.stability_pump import running_map, table_map
from camtorque.studies.table import Chart, StabilityMap, document

CHARTS: dict[str, Callable[[bool], tuple[Chart, ...]]] = {
    "grid": lambda quick: (grid_chart(quick), *table_charts(quick)),
    "dynamics": lambda quick: (dynamics_chart(quick),),
    "driveline": lambda quick: (driveline_chart(quick),),
    "resampling": resampling_charts,
}
"""Part of the study of speed against accuracy -> its charts."""
MAPS: dict[str, Callable[[bool], tuple[StabilityMap, ...]]] = {
    "driveline_stiffness": lambda quick: (stiffness_map(quick),),
    "pump_event": lambda quick: (event_map(quick),),
    "constraint_drift": lambda quick: (drift_map(quick),),
    "cut_joint_force": lambda quick: (multiplier_map(quick),),
    "alignment": lambda quick: (align_map(quick),),
    "lift_tables": lambda quick: (table_map(quick),),
    "running": lambda quick: (running_map(quick),),
}
"""Part of the study of stability -> its map."""
Parts = Mapping[str, Callable[[bool], tuple[Chart | StabilityMap, ...]]]
STUDIES: dict[str, Parts] = {"speed-accuracy": CHARTS, "stability": MAPS}
"""Name on the command line -> what is measured."""


def run_study(name: str, out: Path, quick: bool = False, progress: Progress = silent) -> list[Path]:
    """Measure every part, write them as JSON, PNG and SVG, and return the paths; ``quick``: below a minute."""
    with output_files(out) as folder:
        parts = [part for build in announced(STUDIES[name], progress) for part in build(quick)]
        content = document(name, parts, quick)
        paths = [folder / f"{name.replace('-', '_')}.json"]
        write_json(paths[0], content)
        for part in content["parts"]:
            paths += save_study_figure(part, folder)
    return [out / path.name for path in paths]

"""`camtorque study stability`: all maps, written and drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pipeline.report.study_figures import save_study_figure
from pipeline.studies.stability_align import align_map
from pipeline.studies.stability_driveline import drift_map, event_map, stiffness_map
from pipeline.studies.stability_pump import running_map, table_map
from pipeline.studies.table import StabilityMap, document, write_document

MAPS: dict[str, Callable[[bool], StabilityMap]] = {
    "driveline_stiffness": stiffness_map,
    "pump_event": event_map,
    "constraint_drift": drift_map,
    "alignment": align_map,
    "lift_tables": table_map,
    "running": running_map,
}
"""Name -> map."""


def run_stability(out: Path, quick: bool = False) -> list[Path]:
    """Judge every condition, write ``stability.json`` and one PNG and SVG per map, and return the paths.

    Parameters
    ----------
    out : folder, made when missing
    quick : fewer conditions, below a minute
    """
    out.mkdir(parents=True, exist_ok=True)
    content = document("stability", [build(quick) for build in MAPS.values()], quick)
    paths = [write_document(out / "stability.json", content)]
    for part in content["parts"]:
        paths += save_study_figure(part, out)
    return paths

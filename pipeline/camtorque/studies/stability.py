"""`camtorque study stability`: all maps, written and drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from camtorque.progress import told
from camtorque.report import output_files
from camtorque.report.study_figures import save_study_figure
from camtorque.run import Progress, silent
from camtorque.studies.speed_accuracy import EXAMPLES, need_examples
from camtorque.studies.stability_align import align_map
from camtorque.studies.stability_driveline import drift_map, event_map, multiplier_map, stiffness_map
from camtorque.studies.stability_pump import running_map, table_map
from camtorque.studies.table import StabilityMap, document, write_document

MAPS: dict[str, Callable[[bool, Path], StabilityMap]] = {
    "driveline_stiffness": lambda quick, _: stiffness_map(quick),
    "pump_event": lambda quick, _: event_map(quick),
    "constraint_drift": lambda quick, _: drift_map(quick),
    "cut_joint_force": lambda quick, _: multiplier_map(quick),
    "alignment": lambda quick, _: align_map(quick),
    "lift_tables": lambda quick, _: table_map(quick),
    "running": lambda quick, _: running_map(quick),
}
"""Name -> map."""


def run_stability(out: Path, quick: bool = False, examples: Path = EXAMPLES, progress: Progress = silent) -> list[Path]:
    """Judge every condition, write ``stability.json`` and one PNG and SVG per map, and return the paths.

    Parameters
    ----------
    out : folder, made when missing
    quick : fewer conditions, below a minute
    examples : folder with the example recordings
    progress : is told what is being measured, and how long the rest will take

    Raises
    ------
    Refusal
        No example recordings.
    """
    need_examples(examples)
    with output_files(out) as folder:
        content = document("stability", [build(quick, examples) for build in told(MAPS, progress)], quick)
        paths = [write_document(folder / "stability.json", content)]
        for part in content["parts"]:
            paths += save_study_figure(part, folder)
    return [out / path.name for path in paths]

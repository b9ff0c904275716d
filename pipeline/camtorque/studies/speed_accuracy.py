"""`camtorque study speed-accuracy`: all charts, written and drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from camtorque.progress import told
from camtorque.records import Refusal
from camtorque.report import output_files
from camtorque.report.study_figures import save_study_figure
from camtorque.run import Progress, silent
from camtorque.studies.driveline import driveline_chart
from camtorque.studies.dynamics import dynamics_chart
from camtorque.studies.grid import grid_chart, table_charts
from camtorque.studies.resampling import resampling_charts
from camtorque.studies.table import Chart, document, write_document

Charts = tuple[Chart, ...]
EXAMPLES = Path("raw_examples")
CHARTS: dict[str, Callable[[Path, bool], Charts]] = {
    "grid": lambda _, quick: (grid_chart(quick), *table_charts(quick)),
    "dynamics": lambda _, quick: (dynamics_chart(quick),),
    "driveline": lambda _, quick: (driveline_chart(quick),),
    "resampling": lambda _, quick: resampling_charts(quick),
}
"""Part of the study -> its charts."""


def need_examples(examples: Path) -> None:
    """Refuse a folder without the recordings that the studies fit.

    Raises
    ------
    Refusal
        Naming the folder.
    """
    if not (examples / "A_0500rpm" / "recording.toml").exists():
        raise Refusal(
            f"study: no example recordings in {examples}, expected A_0500rpm and others; run it in the folder that "
            "holds raw_examples"
        )


def run_speed_accuracy(
    out: Path, quick: bool = False, examples: Path = EXAMPLES, progress: Progress = silent
) -> list[Path]:
    """Measure every chart, write ``speed_accuracy.json`` and one PNG and SVG per chart, and return the paths.

    Parameters
    ----------
    out : folder, made when missing
    quick : fewer settings and repeats, below a minute
    examples : folder with the example recordings
    progress : is told what is being measured, and how long the rest will take

    Raises
    ------
    Refusal
        No example recordings.
    """
    need_examples(examples)
    with output_files(out) as folder:
        charts = [chart for build in told(CHARTS, progress) for chart in build(examples, quick)]
        content = document("speed-accuracy", charts, quick)
        paths = [write_document(folder / "speed_accuracy.json", content)]
        for part in content["parts"]:
            paths += save_study_figure(part, folder)
    return [out / path.name for path in paths]

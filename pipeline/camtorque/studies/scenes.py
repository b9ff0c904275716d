"""Chart 6: held-out error against the number of parameters, for each of the five recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from camtorque.fit import FitOptions, fit_prepared
from camtorque.studies.fitting import prepared_example
from camtorque.studies.table import Chart, Point

QUICK_EFFECTS = ("chamber", "trigger", "friction")


def scenes_chart(examples: Path, quick: bool) -> Chart:
    """Return the way up of the ladder and what it chose, one line per recording."""
    points: list[Point] = []
    folders = sorted(path for path in examples.iterdir() if (path / "recording.toml").exists())
    for folder in folders[1:2] if quick else folders:
        points += scene_points(folder, QUICK_EFFECTS if quick else None)
    note = (
        "points of a line: the rigid model (drawn at 0.5), its zero, then each further effect in the order "
        "of the ladder; the circle is what the ladder chose; effective parameters, so a prior counts for less than one"
    )
    return Chart("scenes", "Model against scene", "held-out rms error / peak torque", "parameters", tuple(points), note)


def scene_points(folder: Path, effects: tuple[str, ...] | None) -> list[Point]:
    """Return the rungs of one recording, held-out rms over the peak of the measured mean cycle."""
    prepared = prepared_example(folder)
    peak = float(np.max(np.abs(prepared.data.mean_torque)))
    points = []
    for rung in fit_prepared(prepared, FitOptions(effects, checks=False)).ladder:
        if rung.reason.startswith("back") and not rung.chosen:
            continue
        last = "chosen" if rung.reason.startswith("back") else (rung.effects or ("rigid",))[-1]
        cost = max(float(rung.n_parameters), 0.5)
        points.append(Point(folder.name, last, rung.cv_rms_nm / peak, cost, rung.chosen, False))
    return points

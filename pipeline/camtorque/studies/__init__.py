"""Speed against accuracy, and stability where methods fail: measured, written as JSON and drawn.

table, verdicts     points, charts, cells, maps; the Pareto front; reading and writing
case, integrators   the pump of the studies, and the usual ways to integrate its driveline
grid, dynamics, driveline, resampling, fitting, scenes              the charts
replicates          a reference for stated uncertainties
stability_driveline, stability_pump, stability_align, stability_fit                the maps
choices             the grid for a wanted error
"""

from camtorque.studies.choices import choose_grid, grid_note
from camtorque.studies.speed_accuracy import run_speed_accuracy
from camtorque.studies.stability import run_stability

__all__ = ["choose_grid", "grid_note", "run_speed_accuracy", "run_stability"]

"""Speed against accuracy, and stability where methods fail: measured, written as JSON and drawn.

table, verdicts     points, charts, cells, maps; the Pareto front; reading and writing
case, integrators   the pump of the studies, and the usual ways to integrate its driveline
grid, dynamics, driveline, resampling, fitting, scenes              the charts
replicates          a reference for stated uncertainties
stability_driveline, stability_pump, stability_align, stability_fit                the maps
"""

from camtorque.studies.speed_accuracy import run_speed_accuracy
from camtorque.studies.stability import run_stability

__all__ = ["run_speed_accuracy", "run_stability"]

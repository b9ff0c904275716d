"""Speed against accuracy, and stability where methods fail: measured, written as JSON and drawn.

table               points, charts, cells, maps; the Pareto front; reading and writing
case, integrators   the pump of the studies, and the usual ways to integrate its driveline
grid, dynamics, driveline, resampling, fitting, scenes     the charts
choices             the grid for a wanted error
"""

from pipeline.studies.speed_accuracy import run_speed_accuracy

__all__ = ["run_speed_accuracy"]

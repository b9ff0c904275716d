"""Speed against accuracy, and stability where methods fail: measured, written as JSON and drawn.

table, verdicts     points, charts, cells, maps; reading and writing
case, integrators   the pump of the studies, and the usual ways to integrate its driveline
grid, dynamics, driveline, resampling                       the charts
stability_driveline, stability_pump, stability_align        the maps
study               their registries, and the run
"""

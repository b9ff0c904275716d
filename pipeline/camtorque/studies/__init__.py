"""Speed against accuracy, and stability where methods fail: measured, written as JSON and drawn.

table               points, charts, cells, maps; writing; what becomes of an attempt
case                the pump of the studies
grid, dynamics, driveline, resampling                       the charts
stability_driveline, stability_pump, stability_align        the maps
study               their registries, and the run
"""

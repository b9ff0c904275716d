"""Which effects, which values, how sure: aligned cycles and the chain of effects -> `FittedTorque`."""

from pipeline.fit.single import FitOptions, fit_recording

__all__ = ["FitOptions", "fit_recording"]

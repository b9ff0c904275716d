"""Which effects, which values, how sure: aligned cycles and the chain of effects -> `FittedTorque`."""

from pipeline.fit.joint import CampaignFit, Drift, HeldOut, fit_joint
from pipeline.fit.single import FitOptions, Prepared, fit_prepared, fit_recording, prepare

__all__ = [
    "CampaignFit",
    "Drift",
    "FitOptions",
    "HeldOut",
    "Prepared",
    "fit_joint",
    "fit_prepared",
    "fit_recording",
    "prepare",
]

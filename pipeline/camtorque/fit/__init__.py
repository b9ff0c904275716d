"""Which effects, which values, how sure: aligned cycles and the chain of effects -> `FittedTorque`."""

from camtorque.fit.joint import CampaignFit, Drift, HeldOut, fit_joint
from camtorque.fit.single import FitOptions, Prepared, fit_prepared, fit_recording, prepare

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

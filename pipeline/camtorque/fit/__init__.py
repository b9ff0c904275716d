"""Which values, how sure, which losses are needed: problem, search, solver, evidence, uncertainty, result."""

from camtorque.fit.joint import CampaignFit, Drift, JointRecording, fit_joint
from camtorque.fit.joint_input import JointInput, joint_input
from camtorque.fit.leftout import HeldOut
from camtorque.fit.single import Fit, FitOptions, Prepared, fit_prepared, prepare

__all__ = [
    "CampaignFit", "Drift", "Fit", "FitOptions", "HeldOut", "JointInput", "JointRecording", "Prepared", "fit_joint",
    "fit_prepared", "joint_input", "prepare",
]  # fmt: skip

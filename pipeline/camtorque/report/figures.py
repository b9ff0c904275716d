"""Every figure of a run, in the order of the page."""

from __future__ import annotations

from functools import partial

from camtorque.report import curve_figures, fit_figures
from camtorque.report.drawings import FigureSpec

FIGURES: dict[str, FigureSpec] = {
    "torque_full": FigureSpec(
        "Torque over one revolution",
        "Where the dashed rigid model leaves the measured mean, something is missing in it; the fitted model should "
        "lie on the measured mean. Below: what the fit leaves over, on cycles that were not fitted.",
        curve_figures.full_cycle, "curves", True, True,
    ),
    "pressure": FigureSpec(
        "Line pressure and chamber pressure", "The sensor sits behind the delivery valve. The chamber pressure is "
        "rebuilt from the torque and the laws of the chamber, and is what loads the plunger.",
        curve_figures.pressures, "curves", True, True,
    ),
    "lift": FigureSpec("Lift", "The strokes are those of the lift.", curve_figures.lift, "curves", True),
    "torque_forward": FigureSpec(
        "Forward stroke", "The lift rises; the pump is loaded.", partial(curve_figures.stroke, which=0), "strokes",
    ),
    "torque_return": FigureSpec(
        "Return stroke", "The lift falls; what is still compressed drives the cam.", 
        partial(curve_figures.stroke, which=1), "strokes",
    ),
    "gap": FigureSpec(
        "What closes the gap", "Measured − rigid torque, by cause. Left: mean over the loaded part of the forward "
        "stroke. Right: where the measured torque is least on the return stroke. Lines: two standard uncertainties.",
        fit_figures.gap, "causes",
        png=True,
    ),
    "losses": FigureSpec(
        "Work per revolution", "Each cause integrated for itself over the true cam angle. Lines: two standard "
        "uncertainties.", fit_figures.losses, "causes",
    ),
    "torque_by_cause": FigureSpec(
        "Torque by cause", "Each law for itself, as the transducer sees it; all of them sum to the fitted model. Each "
        "panel has its own scale.", curve_figures.by_cause, "causes", True,
    ),
    "evidence": FigureSpec(
        "Which losses the data need", "Left: evidence for the loss against its absence (2 ln of the Bayes factor); to "
        "the left of zero the data do better without. Right: how much the loss moves the mean cycle.",
        fit_figures.evidence, "evidence", True, True,
    ),
    "motion": FigureSpec(
        "Velocity and acceleration of the follower", "At the mean speed.", curve_figures.motion, "inside",
    ),
    "contact": FigureSpec(
        "Contact of cam and roller", "Normal force and the largest Hertz pressure.", curve_figures.contact, "inside",
    ),
    "reactions": FigureSpec("Bearing and guide reactions", "Of the fitted model.", curve_figures.reactions, "inside"),
    "cam_angle": FigureSpec(
        "Cam angle", "How far the cam is from where the trigger and a constant speed put it.", curve_figures.cam_angle,
        "alignment",
    ),
    "cycles": FigureSpec(
        "Used cycles", "A trend or a step here means that the run was not steady.", curve_figures.cycles, "alignment",
    ),
    "priors": FigureSpec(
        "Parameters against expectation", "Shaded: within two standard deviations of sheet, certificate or literature. "
        "Grey: no surer than before.", fit_figures.priors, "uncertainty",
    ),
    "budget": FigureSpec(
        "Where the uncertainty comes from",
        "Variance of each parameter that the data say something about, by source. The name of a parameter stands for "
        "what was known of it before: sheet, certificate, literature.", fit_figures.budget, "uncertainty",
        True,
    ),
}  # fmt: skip
"""File name -> figure."""

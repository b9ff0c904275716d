"""Every figure of a run, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import matplotlib as mpl
from matplotlib.figure import Figure

from camtorque.report import fit_figures, gap_figures, part_figures, torque_figures, uncertainty_figures
from camtorque.report.bundle import RunResult
from camtorque.report.style import STYLE, svg_text


@dataclass(frozen=True)
class FigureSpec:
    """One figure: title, what to look at, how it is drawn, in which section of the page."""

    title: str
    caption: str
    draw: Callable[[RunResult], Figure]
    section: str
    wide: bool = False


FIGURES: dict[str, FigureSpec] = {
    "torque_full": FigureSpec(
        "One revolution",
        "Where the dashed rigid model leaves the black measured mean, something is missing in it; the blue fitted "
        "model should lie on the black line. Below: what the fit leaves over, on cycles that it has not seen.",
        torque_figures.full_cycle, "torque", True,
    ),
    "torque_forward": FigureSpec(
        "Forward stroke", "The lift rises; the pump is loaded.", torque_figures.forward_stroke, "torque",
    ),
    "torque_return": FigureSpec(
        "Return stroke", "The lift falls; what is still compressed drives the cam.", torque_figures.return_stroke,
        "torque",
    ),
    "torque_by_cause": FigureSpec(
        "Torque by cause", "Each law for itself, as the transducer sees it; all of them sum to the fitted model. Each "
        "panel has its own scale.", torque_figures.by_cause, "causes", True,
    ),
    "losses": FigureSpec(
        "Work per revolution", "Each cause integrated for itself over the true cam angle.", fit_figures.losses,
        "causes",
    ),
    "gap": FigureSpec(
        "What closes the gap", "Measured minus rigid torque, by cause. Left: mean over the loaded part of the forward "
        "stroke. Right: where the measured torque is least on the return stroke.", gap_figures.gap, "causes",
    ),
    "pressure": FigureSpec(
        "Line pressure and chamber pressure", "The sensor sits behind the delivery valve. The chamber pressure is "
        "rebuilt from the torque and the laws of the chamber, and is what loads the plunger.",
        part_figures.pressures, "inside", True,
    ),
    "lift": FigureSpec("Lift, velocity, acceleration", "At the mean speed.", part_figures.lift, "inside"),
    "contact": FigureSpec(
        "Contact of cam and roller", "Normal force and the largest Hertz pressure.", part_figures.contact, "inside",
    ),
    "reactions": FigureSpec(
        "Bearing and guide reactions", "Of the fitted model.", part_figures.reactions, "inside",
    ),
    "cam_angle": FigureSpec(
        "Cam angle", "How far the cam is from where the trigger and a constant speed put it.", part_figures.cam_angle,
        "alignment",
    ),
    "cycles": FigureSpec(
        "Used cycles", "A trend or a step here means that the run was not steady.", part_figures.cycles, "alignment",
    ),
    "ladder": FigureSpec(
        "Ladder", "Residual of every model tried; shaded: chosen. Dotted: odd against even cycles, below which nothing "
        "can be told.", fit_figures.ladder, "fit",
    ),
    "priors": FigureSpec(
        "Parameters against expectation", "Grey: within two standard deviations of sheet, certificate or literature. "
        "Orange: not identifiable by this recording.", fit_figures.priors, "fit",
    ),
    "correlations": FigureSpec(
        "Correlations", "Dark off the diagonal: these recordings cannot tell the two apart.",
        fit_figures.correlations, "fit",
    ),
    "profiles": FigureSpec(
        "Profiles", "How the sum of squares rises when one parameter is moved and all others follow; 95 % where it "
        "passes the dotted line. Dashed: what the covariance would say. A profile that never passes on one side "
        "gives a limit, not an interval. Grey: the "
        "stated interval, spread of plausible models included.", uncertainty_figures.profiles, "uncertainty", True,
    ),
    "budget": FigureSpec(
        "Where the uncertainty comes from", "Variance of each parameter by source: what the recording leaves open, "
        "certificates and sheets, literature, and the spread of plausible models.", uncertainty_figures.budget,
        "uncertainty", True,
    ),
}  # fmt: skip
"""File name -> figure."""


def draw(name: str, result: RunResult) -> Figure:
    """Return one figure in the common style."""
    with mpl.rc_context(STYLE):
        figure = FIGURES[name].draw(result)
        figure.set_gid(name)
    return figure


def drawn_svg(name: str, result: RunResult) -> tuple[Figure, str]:
    """Return a figure and its SVG element."""
    with mpl.rc_context(STYLE):
        figure = draw(name, result)
        return figure, svg_text(figure, name)

"""A prediction as one self-contained HTML page: what was asked, the sweep, findings, and figures over cam angle."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from html import escape

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from camtorque.mechanism.predict import Prediction, sweep_rows
from camtorque.units import BAR, DEGREE, RPM

STYLE = """body{font:15px/1.45 sans-serif;max-width:62em;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;font-size:90%}td,th{border:1px solid #ccc;padding:.2em .5em;text-align:right}
td:first-child,th:first-child{text-align:left}img{max-width:100%}.error{color:#b00}.warning{color:#a60}"""
SIZE = (8.0, 3.2)


def _torque(axis: Axes, prediction: Prediction) -> None:
    for torque, speed in zip(prediction.shaft_torque, prediction.speeds, strict=True):
        axis.plot(prediction.theta / DEGREE, torque, label=f"{speed / RPM:.0f} rpm")
    axis.set_ylabel("drive torque [N m]")
    axis.legend(fontsize=8)


def _causes(axis: Axes, prediction: Prediction) -> None:
    pump = prediction.pumps[-1]
    for name, torque in pump.by_cause.items():
        if np.any(torque != 0.0):
            axis.plot(prediction.theta / DEGREE, torque, label=name.replace("_", " "))
    axis.set_ylabel(f"torque by cause, {prediction.speeds[-1] / RPM:.0f} rpm [N m]")
    axis.legend(fontsize=8)


def _forces(axis: Axes, prediction: Prediction) -> None:
    forces = prediction.pumps[-1].forces
    for name in ("contact_normal", "bearing_x", "bearing_y", "guide"):
        axis.plot(prediction.theta / DEGREE, getattr(forces, name), label=name.replace("_", " "))
    axis.set_ylabel(f"force, {prediction.speeds[-1] / RPM:.0f} rpm [N]")
    axis.legend(fontsize=8)


def _hertz(axis: Axes, prediction: Prediction) -> None:
    for pump, speed in zip(prediction.pumps, prediction.speeds, strict=True):
        axis.plot(prediction.theta / DEGREE, pump.forces.hertz / 1e9, label=f"{speed / RPM:.0f} rpm")
    axis.set_ylabel("Hertz stress p0 [GPa]")
    axis.legend(fontsize=8)


def _cam(axis: Axes, prediction: Prediction) -> None:
    angle, path = prediction.theta / DEGREE, prediction.kinematics
    axis.plot(angle, 1e3 * path.lift, label="lift [mm]")
    axis.plot(angle, 1e3 * path.velocity, label="velocity [mm/rad]")
    axis.plot(angle, path.pressure_angle / DEGREE, label="pressure angle [deg]")
    axis.plot(angle, prediction.pressure / BAR / 20.0, label="pressure [20 bar]")
    axis.legend(fontsize=8)


FIGURES: dict[str, Callable[[Axes, Prediction], None]] = {
    "Cam and load": _cam,
    "Drive torque": _torque,
    "Torque by cause": _causes,
    "Forces": _forces,
    "Hertz stress": _hertz,
}


def figure_of(title: str, prediction: Prediction) -> Figure:
    """Return one of `FIGURES` over cam angle."""
    figure = Figure(figsize=SIZE, layout="constrained")
    axis = figure.subplots()
    FIGURES[title](axis, prediction)
    axis.set(xlabel="cam angle [deg]", xlim=(0.0, 360.0), title=title)
    axis.grid(alpha=0.3)
    return figure


def _image(title: str, prediction: Prediction) -> str:
    """Return a figure as an image that needs no file."""
    buffer = io.BytesIO()
    figure_of(title, prediction).savefig(buffer, format="png", dpi=100)
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<h2>{escape(title)}</h2><img alt="{escape(title)} over cam angle" src="data:image/png;base64,{data}">'


def _cell(value: float | bool) -> str:
    """Return a number with four digits, or yes or no."""
    return ("yes" if value else "no") if isinstance(value, bool) else f"{value:.4g}"


def _sweep(prediction: Prediction) -> str:
    """Return the sweep with one column per speed."""
    rows = sweep_rows(prediction)
    lines = [
        f"<tr><th>{escape(name)}</th>{''.join(f'<td>{_cell(row[name])}</td>' for row in rows)}</tr>" for name in rows[0]
    ]
    return f"<table>{''.join(lines)}</table>"


def _contact(prediction: Prediction) -> str:
    """Return the sentence on contact loss."""
    loss = prediction.jump
    if not np.isfinite(loss.speed):
        return "The follower stays on the cam at every speed."
    return (
        f"The follower leaves the cam from {loss.speed / RPM:.0f} rpm on, first at {loss.theta / DEGREE:.1f} degrees."
    )


def prediction_page(prediction: Prediction, title: str) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    prediction : `camtorque.mechanism.predict.predict`
    title : heading, such as the name of the pump file
    """
    findings = "".join(
        f'<li class="{escape(f.severity)}">{escape(f.text)}{f" ({escape(f.where)})" if f.where else ""}</li>'
        for f in prediction.findings
    )
    steep, back = (value / DEGREE for value in prediction.flat_pressure_angles)
    figures = "".join(_image(name, prediction) for name in FIGURES)
    return (
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f"<style>{STYLE}</style></head><body><h1>{escape(title)}</h1>"
        "<p>Rigid multibody model on frictionless joints; pressure as given, the same at every speed.</p>"
        f"<p>{_contact(prediction)} Pressure angle by the flat check at most {steep:.1f} and {-back:.1f} degrees.</p>"
        f"<ul>{findings}</ul>{_sweep(prediction)}{figures}</body></html>"
    )

"""Small pictures: the thumbnail of a recording and the aligned cycles without a model."""

from __future__ import annotations

import numpy as np

from camtorque.records import Array
from camtorque.report.bundle import RunResult
from camtorque.report.svg import Scale, drawing, padded, polyline
from camtorque.report.torque_figures import measured_mean

THUMB_WIDTH, THUMB_HEIGHT = 150.0, 50.0


def thumbnail(result: RunResult) -> str:
    """Return measured, rigid and fitted torque as a small SVG element without axes."""
    curves = (measured_mean(result)[0], result.rigid.torque, result.fitted.torque)
    return small_torques(result.cycles.theta, curves, result.recording.config.id)


def small_torques(theta: Array, curves: tuple[Array, Array, Array], name: str) -> str:
    """Return measured, rigid and fitted torque over one revolution as a small SVG element.

    Parameters
    ----------
    theta : (n,) cam angle [rad]; curves : three of (n,) in one unit; name : of the recording
    """
    across = Scale(0.0, 2.0 * np.pi, 1.0, THUMB_WIDTH - 1.0)
    up = Scale(*padded(curves), THUMB_HEIGHT, 0.0)
    styles = (("measured", 1.6, ""), ("rigid", 0.8, "3 2"), ("fitted", 0.8, ""))
    parts = [
        polyline(across.places(theta), up.places(values), tone, width, dash)
        for values, (tone, width, dash) in zip(curves, styles, strict=True)
    ]
    return drawing(THUMB_WIDTH, THUMB_HEIGHT, f"torque of {name}", parts)

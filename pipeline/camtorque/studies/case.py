"""The pump that the studies run on: the paper's Tables 1 and 2 under a smooth pressure, known in closed form."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from camtorque.config import PumpData
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.lift_laws import cubic_law
from camtorque.mechanism.sections import dwell, flank, section_law
from camtorque.records import Array, CamTable
from camtorque.units import BAR, DEGREE, angle_grid

SPEED = 500.0 * 2.0 * np.pi / 60.0
PEAK_PRESSURE = 600.0 * BAR
LIFT = 8.0e-3
KIND = "polynomial_4567"
RISE_START, RISE_WIDTH = 20.0 * DEGREE, 2.0 * DEGREE
FALL_START, FALL_WIDTH = 55.0 * DEGREE, 2.0 * DEGREE
"""Pressure rises and falls by logistic flanks of this scale: analytic, and as steep as a delivery valve makes it."""


@cache
def study_pump() -> PumpData:
    """Return the pump of the paper with a 2 mm offset and a roller whose inertia shows."""
    return PumpData(
        base_circle_radius=0.02,
        roller_radius=0.008,
        roller_width=0.005,
        follower_offset=2.0e-3,
        cam_mass=0.25,
        cam_inertia=5.0e-5,
        follower_mass=0.075,
        spring_stiffness=2.0e4,
        spring_preload=110.0,
        plunger_diameter=0.008,
        youngs_modulus_cam=210e9,
        youngs_modulus_roller=210e9,
        cam_table_path=Path("study"),
        cam_table_angle_column="",
        cam_table_lift_column="",
        roller_mass=0.02,
        roller_inertia=8.0e-7,
    )


@cache
def study_law(lift: float = LIFT, rise_deg: float = 60.0) -> CamLaw:
    """Return rise, 20 degree dwell, fall of 55 degrees and base circle."""
    rest = 2.0 * np.pi - (rise_deg + 20.0 + 55.0) * DEGREE
    rise, fall = flank(KIND, rise_deg * DEGREE, lift), flank(KIND, 55.0 * DEGREE, -lift)
    return section_law([rise, dwell(20.0 * DEGREE), fall, dwell(rest)])


@cache
def knotted_law() -> CamLaw:
    """Return the cubic law of the exact 1 degree table: its third derivative jumps at 360 knots, as in daily use."""
    return cubic_law(rounded_table(study_law(), 1.0, 0.0))


def study_pressure(theta: Array) -> Array:
    """Return the pressure on the plunger over cam angle [Pa]."""
    angle = np.mod(np.asarray(theta, dtype=np.float64), 2.0 * np.pi)
    rise = 1.0 / (1.0 + np.exp(np.clip(-(angle - RISE_START) / RISE_WIDTH, -60.0, 60.0)))
    fall = 1.0 / (1.0 + np.exp(np.clip((angle - FALL_START) / FALL_WIDTH, -60.0, 60.0)))
    return np.asarray(PEAK_PRESSURE * rise * fall)


def peak_error(found: Array, exact: Array) -> float:
    """Return the largest error over the peak."""
    return float(np.max(np.abs(found - exact)) / np.max(np.abs(exact)))


def rms_error(found: Array, exact: Array) -> float:
    """Return the rms error over the highest value."""
    return float(np.sqrt(np.mean((found - exact) ** 2)) / np.max(exact))


def rounded_table(law: CamLaw, step_deg: float, resolution: float) -> CamTable:
    """Return the lift table of a law, rounded to a resolution [m]; 0 keeps it exact."""
    theta = angle_grid(round(360.0 / step_deg))
    lift = law.evaluate(theta)
    return CamTable(theta, np.round(lift / resolution) * resolution if resolution > 0.0 else lift, resolution)

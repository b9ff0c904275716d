"""Metrics by their definitions, on curves whose metrics are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.fit.residual import block_cross_validation, metrics, stroke_masks
from camtorque.fit.uncertainty import covariance
from fit_cases import quick

THETA = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
LIFT = 4e-3 * (1.0 - np.cos(THETA))
VELOCITY = 4e-3 * np.sin(THETA)
TORQUE = 50.0 * np.sin(THETA)


def test_strokes_leave_out_both_ends_and_never_overlap():
    rise, fall = stroke_masks(LIFT, VELOCITY)
    assert not np.any(rise & fall)
    share = LIFT / 8e-3
    for mask in (rise, fall):
        assert share[mask].min() >= 0.05
        assert share[mask].max() <= 0.95
    # (1 - cos)/2 between 0.05 and 0.95: arccos(0.9) = 25.84 deg to 154.16 deg, on a grid of 0.1 deg
    assert np.degrees(THETA[rise][[0, -1]]) == pytest.approx([25.9, 154.1], abs=0.051)
    assert np.degrees(THETA[fall][[0, -1]]) == pytest.approx([205.9, 334.1], abs=0.051)


def test_perfect_model_has_no_error():
    found = metrics(TORQUE, TORQUE, TORQUE, LIFT, VELOCITY)
    assert (found.rms_nm, found.forward_gap_percent, found.forward_peak_error_nm, found.return_rms_nm) == (0, 0, 0, 0)
    assert found.return_min_measured_nm == found.return_min_model_nm == pytest.approx(-50.0)


def test_gain_of_one_per_cent_is_a_gap_of_one_per_cent():
    found = metrics(1.01 * TORQUE, TORQUE, TORQUE, LIFT, VELOCITY)
    assert found.forward_gap_percent == pytest.approx(1.0, rel=1e-12)
    assert found.forward_peak_error_nm == pytest.approx(0.5)
    assert found.return_min_measured_nm == pytest.approx(-50.5)
    # rms of a sine is its amplitude over sqrt(2); percent of the measured peak
    assert found.rms_nm == pytest.approx(0.5 / np.sqrt(2.0))
    assert found.rms_percent_of_peak == pytest.approx(100.0 * 0.5 / np.sqrt(2.0) / 50.5)


def test_an_offset_counts_on_every_stroke():
    found = metrics(TORQUE + 2.0, TORQUE, TORQUE, LIFT, VELOCITY)
    assert found.rms_nm == pytest.approx(2.0)
    assert found.return_rms_nm == pytest.approx(2.0)
    assert found.return_min_measured_nm - found.return_min_model_nm == pytest.approx(2.0)


def test_gap_is_taken_where_the_rigid_model_is_loaded():
    # an error where the rigid torque is below a fifth of its peak does not count in the gap
    rise, _ = stroke_masks(LIFT, VELOCITY)
    early = np.sin(THETA) * np.cos(THETA) > 0.0  # the first quarter of the rise
    rigid = np.where(early, TORQUE, 0.0)
    unloaded = rise & ~early
    found = metrics(TORQUE + np.where(unloaded, 5.0, 0.0), TORQUE, rigid, LIFT, VELOCITY)
    assert found.forward_gap_percent == pytest.approx(0.0, abs=1e-12)
    assert found.rms_nm > 1.0


def test_a_stretch_that_was_left_out_is_met_no_better_than_one_that_was_fitted():
    found = quick(("closed_volume", 0, 1000.0))
    blocks = block_cross_validation(found.problem, found.solution, covariance(found.problem, found.solution))
    left = found.solution.left / found.data.weight
    fitted = np.array([np.sqrt(np.mean(part**2)) for part in np.array_split(left, 18)])
    assert blocks.shape == (18,)
    assert np.all(blocks > 0.95 * fitted)  # weights differ within a stretch
    assert np.median(blocks) > np.median(fitted)

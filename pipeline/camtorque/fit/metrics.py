"""How well a model meets the measured mean cycle; the definitions of docs/result_schema.md."""

from __future__ import annotations

import numpy as np

from camtorque.fit.prepare import MeanCycles
from camtorque.records import Array, Mask, Metrics, RigidTorque

STROKE = (0.05, 0.95)
"""Shares of the lift between which a stroke counts."""


def stroke_masks(lift: Array, velocity: Array) -> tuple[Mask, Mask]:
    """Return where the lift rises and where it falls between 5 and 95 % of its range, each (n_theta,)."""
    share = (lift - np.min(lift)) / np.ptp(lift)
    inside = (share >= STROKE[0]) & (share <= STROKE[1])
    return inside & (velocity > 0.0), inside & (velocity < 0.0)


def loaded_part(rigid: Array, lift: Array, velocity: Array) -> tuple[Mask, Mask]:
    """Return the loaded part of the forward stroke and the return stroke, each (n_theta,), as `metrics` use them."""
    rise, fall = stroke_masks(lift, velocity)
    return rise & (rigid > 0.2 * np.max(rigid[rise])), fall


def parts_of_gap(rigid: RigidTorque, measured: Array) -> tuple[Mask, Mask, int]:
    """Return both of `loaded_part`, and where the measured torque (n_theta,) is least on the return stroke."""
    forward, fall = loaded_part(rigid.torque, rigid.lift, rigid.lift_velocity)
    return forward, fall, int(np.flatnonzero(fall)[np.argmin(measured[fall])])


def metrics_of_fit(
    means: MeanCycles, fitted: Array, held: Array, rigid: Array, lift: Array, velocity: Array
) -> dict[str, Metrics]:
    """Return the metrics of the rigid model, of the fitted one and of that on the cycles that were held out.

    ``fitted`` and ``held`` (n_theta,) are the model for both halves of the cycles [N m]; else as in `metrics`.
    """
    pairs = {
        "rigid": (means.torque_all, rigid), "fitted": (means.torque, fitted),
        "fitted_held_out_cycles": (means.held_torque, held),
    }  # fmt: skip
    return {name: metrics(*pair, rigid, lift, velocity) for name, pair in pairs.items()}


def metrics(measured: Array, model: Array, rigid: Array, lift: Array, velocity: Array) -> Metrics:
    """Return the metrics of one model.

    Parameters
    ----------
    measured, model, rigid : (n_theta,) mean cycle, model, rigid model [N m]
    lift, velocity : (n_theta,) lift [m] and its slope [m/rad] at the nominal cam angle
    """
    residual = measured - model
    loaded, fall = loaded_part(rigid, lift, velocity)
    rms = float(np.sqrt(np.mean(residual**2)))
    mean_model = float(np.mean(model[loaded]))
    return Metrics(
        rms_nm=rms,
        rms_percent_of_peak=100.0 * rms / float(np.max(measured)),
        forward_gap_percent=100.0 * (float(np.mean(measured[loaded])) - mean_model) / mean_model,
        forward_peak_error_nm=float(np.max(measured[loaded]) - np.max(model[loaded])),
        return_min_measured_nm=float(np.min(measured[fall])),
        return_min_model_nm=float(np.min(model[fall])),
        return_rms_nm=float(np.sqrt(np.mean(residual[fall] ** 2))),
    )

"""What the bench measured inside the pump against what the fit rebuilt: chamber pressure, delivered volume."""

from __future__ import annotations

from typing import Any

import numpy as np

from camtorque.records import Array, Estimate, SensorCalibration
from camtorque.report.bundle import RunResult
from camtorque.units import BAR, DEGREE

MM3 = 1.0e-9
LOADED_SHARE = 0.3
"""Share of the rebuilt peak above which an angle counts as loaded."""


def measured_chamber(result: RunResult) -> Array | None:
    """Return the mean cycle of the chamber pressure (n_theta,) [Pa], None where it was not recorded."""
    values = result.cycles.channels.get("chamber_pressure")
    if values is None:
        return None
    whole = np.isfinite(values).all(axis=1)
    return np.asarray(np.mean(values[whole], axis=0)) if whole.any() else None


def measured_document(result: RunResult) -> dict[str, Any]:
    """Return each comparison in the units of its keys, None where the bench or the model has nothing to compare."""
    return {"chamber_pressure": _chamber(result), "delivered_volume": _delivery(result)}


def _chamber(result: RunResult) -> dict[str, Any] | None:
    measured, rebuilt = measured_chamber(result), result.fitted.chamber_pressure
    if measured is None or rebuilt is None:
        return None
    difference, peak = measured - rebuilt, float(np.max(rebuilt))
    model_std = result.fitted.chamber_pressure_std
    std = np.hypot(np.nan if model_std is None else model_std, _sensor_std(result, measured))
    loaded = rebuilt > LOADED_SHARE * peak
    worst = int(np.argmax(np.abs(difference)))
    rms = float(np.sqrt(np.mean(difference**2)))
    return {
        "peak_bar": float(np.max(measured)) / BAR,
        "peak_at_deg": float(result.cycles.theta[int(np.argmax(measured))]) / DEGREE,
        "rebuilt_peak_bar": peak / BAR,
        "rms_difference_bar": rms / BAR,
        "rms_difference_percent": 100.0 * rms / peak,
        "largest_difference_bar": float(difference[worst]) / BAR,
        "largest_difference_at_deg": float(result.cycles.theta[worst]) / DEGREE,
        "loaded_inside_two_std_percent": 100.0 * float(np.mean(np.abs(difference[loaded]) < 2.0 * std[loaded])),
    }


def _sensor_std(result: RunResult, measured: Array) -> Array:
    """Return the standard uncertainty of the measured chamber pressure: gain, zero and linearity of its sensor."""
    sheet: SensorCalibration | None = next((c.calibration for c in result.recording.of("chamber_pressure")), None)
    if sheet is None:
        return np.zeros_like(measured)
    parts = np.nan_to_num([sheet.gain_relative_std, sheet.zero_std, sheet.nonlinearity_std])
    return np.sqrt((parts[0] * measured) ** 2 + parts[1] ** 2 + parts[2] ** 2)


def _delivery(result: RunResult) -> dict[str, Any] | None:
    """Return the volume of a stroke past the delivery valve, measured and modelled at zero gauge pressure."""
    modelled: Estimate | None = result.fitted.details.get("delivered_volume")
    if modelled is None or "delivered_volume" not in result.cycles.channels:
        return None
    each = result.cycles.means("delivered_volume")
    each = each[np.isfinite(each)]
    if not each.size:
        return None
    measured = float(np.mean(each))
    return {
        "measured_mm3": measured / MM3,
        "measured_std_mm3": float(np.std(each, ddof=1)) / MM3 if each.size > 1 else None,
        "modelled_mm3": {"value": modelled.value / MM3, "stderr": modelled.stderr / MM3},
        "difference_percent": 100.0 * (measured / modelled.value - 1.0) if modelled.value else None,
    }

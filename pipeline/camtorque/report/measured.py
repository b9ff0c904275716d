"""What the bench measured beside torque and line pressure, against the fitted model: chamber pressure, delivery."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from camtorque.records import Array, Estimate, Finding, SensorCalibration
from camtorque.report.bundle import RunResult
from camtorque.report.numbers import signed_significant, significant
from camtorque.units import BAR, DEGREE

MM3 = 1.0e-9
LOADED_SHARE = 0.3
"""Share of the rebuilt peak above which an angle counts as loaded."""
LEAST_INSIDE, FAR_RMS = 50.0, 2.0
"""Percent of the loaded angles inside two standard uncertainties, and rms difference in percent of the peak, below and
above which a measured chamber pressure contradicts the rebuilt one: of sound fits 95 % are inside."""
METER_STD, CONTRADICTS = 0.01, 3.0
"""Relative standard uncertainty of a flow meter, and standard uncertainties that a delivered volume may be off by."""


def measured_document(result: RunResult) -> dict[str, Any]:
    """Return each comparison in the units of its keys, None where the bench or the model has nothing to compare."""
    return {"chamber_pressure": _against_the_measured_chamber(result), "delivered_volume": _delivery(result)}


def _against_the_measured_chamber(result: RunResult) -> dict[str, Any] | None:
    measured, rebuilt = result.cycles.mean_cycle("chamber_pressure"), result.fitted.chamber_pressure
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


def measured_findings(measured: dict[str, Any]) -> tuple[Finding, ...]:
    """Tell what was measured beside the fit and contradicts it; ``measured`` as of `measured_document`.

    Neither is used by the fit: they are the one check of it that does not come from torque and line pressure.
    """
    found, chamber, volume = [], measured["chamber_pressure"], measured["delivered_volume"]
    if (
        chamber
        and chamber["loaded_inside_two_std_percent"] < LEAST_INSIDE
        and chamber["rms_difference_percent"] > FAR_RMS
    ):
        text = (
            f"the measured chamber pressure contradicts the rebuilt one: {significant(chamber['peak_bar'], 4)} against "
            f"{significant(chamber['rebuilt_peak_bar'], 4)} bar, inside two standard uncertainties at "
            f"{chamber['loaded_inside_two_std_percent']:.0f} % of the loaded angles; a sensor, the plunger or "
            "the model is wrong: check gain and place of that sensor; do not rely on chamber pressure and losses"
        )
        found.append(Finding("chamber_contradicted", "warning", text, "chamber_pressure"))
    if volume and volume["difference_percent"] is not None and _is_far(volume):
        modelled = volume["modelled_mm3"]
        text = (
            f"the measured delivery contradicts the model: {significant(volume['measured_mm3'], 4)} mm³ a stroke "
            f"against {significant(modelled['value'], 3)} ± {significant(modelled['stderr'], 2)} mm³ "
            f"({signed_significant(volume['difference_percent'])} %): check unit and strokes of the meter, plunger and "
            "lift table, and what leaves the pump past the delivery valve otherwise"
        )
        found.append(Finding("delivery_contradicted", "warning", text, "delivered_volume"))
    return tuple(found)


def _is_far(volume: dict[str, Any]) -> bool:
    measured, modelled = volume["measured_mm3"], volume["modelled_mm3"]
    std = math.hypot(modelled["stderr"], volume["measured_std_mm3"] or 0.0, METER_STD * measured)
    return bool(abs(measured - modelled["value"]) > CONTRADICTS * std)

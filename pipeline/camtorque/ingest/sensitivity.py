"""What the output of a sensor means: the line of its certificate, or the one that its stated sensitivity draws.

A sensor gives volts, or, as an unamplified bridge, its output over its supply in mV/V.
"""

from __future__ import annotations

import math

from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.ingest.certificate import CertificateLine, read_certificate
from camtorque.ingest.sheet import Sheet
from camtorque.records import Finding, Refusal
from camtorque.units import unit_factor

OFF_NOMINAL = 0.02
"""Relative difference of two sensitivities of one sensor that is worth a finding."""
VOLT_KEYS = {
    "sensitivity_V_per_unit": "sensitivity_V_per_unit",
    "zero": "zero_V",
    "output_range": "output_range_V",
    "zero_tolerance": "zero_tolerance_V",
}
BRIDGE_KEYS = {
    "bridge_sensitivity": "sensitivity_mV_per_V",
    "unit_per_mV_per_V": "unit_per_mV_per_V",
    "bridge_zero": "zero_mV_per_V",
}
"""Attribute -> key that says what an output in volts, and what one in mV/V means."""


def sensor_line(sheet: Sheet, quantity: str, output: str) -> CertificateLine:
    """Return what a volt, or a mV/V where ``output`` is that of a bridge, means.

    Raises
    ------
    Refusal : nothing says it, or only for the other kind of output
    """
    dimension = CHANNEL_QUANTITIES[quantity].dimension
    if sheet.certificate is not None:
        if not sheet["unit"]:
            raise Refusal(f"{sheet.where} unit: this key is missing; the certificate is held against it")
        unit_factor(sheet["unit"], dimension, f"{sheet.where} unit")
        return read_certificate(sheet.certificate, quantity, sheet.serial, sheet["unit"], output)
    per_unit, zero = _of_bridge(sheet) if output == "bridge output" else _of_volts(sheet)
    factor = unit_factor(sheet["unit"], dimension, f"{sheet.where} unit")
    return CertificateLine(factor / per_unit, 0.0, zero, 0.0, math.nan)


def _of_volts(sheet: Sheet) -> tuple[float, float]:
    """Return volts per unit and volts at zero load."""
    _refuse_keys(sheet, BRIDGE_KEYS, "V", "mV/V")
    sensitivity, zero = sheet["sensitivity_V_per_unit"], sheet["zero"]
    stated = not sheet.files and sheet["nominal_range"] is not None and sheet["output_range"] is not None
    if not sensitivity and stated:
        # the ends of both ranges are a line: +/-10 V at +/-200 N m, 0.5 to 4.5 V at 0 to 2000 bar
        (low, high), (out_low, out_high) = range_of(sheet, "nominal_range"), range_of(sheet, "output_range")
        sensitivity = (out_high - out_low) / (high - low)
        zero = out_low - sensitivity * low if zero is None else zero
    if not sensitivity or not sheet["unit"]:
        raise Refusal(
            f"{sheet.where}: nothing says what a volt means; give calibration (a sheet with its certificate), or unit "
            "with sensitivity_V_per_unit (not 0), or with nominal_range and output_range_V, which belong together"
        )
    return sensitivity, zero or 0.0


def _of_bridge(sheet: Sheet) -> tuple[float, float]:
    """Return mV/V per unit and mV/V at zero load."""
    _refuse_keys(sheet, VOLT_KEYS, "mV/V", "V")
    full, gain = sheet["bridge_sensitivity"], sheet["unit_per_mV_per_V"]
    high = range_of(sheet, "nominal_range", (0.0, 0.0))[1]
    by_range = full / high if full and high else None
    if by_range and gain and abs(by_range * gain - 1.0) > 0.02:
        raise Refusal(
            f"{sheet.where} unit_per_mV_per_V: {gain:g}, but {full:g} mV/V at {high:g} are {1.0 / by_range:.4g} per "
            "mV/V; one of sensitivity_mV_per_V, nominal_range, unit_per_mV_per_V is wrong"
        )
    per_unit = 1.0 / gain if gain else by_range
    if not per_unit or not sheet["unit"]:
        raise Refusal(
            f"{sheet.where}: nothing says what a mV/V means; give unit with sensitivity_mV_per_V (output at the upper "
            "end) and nominal_range, or with unit_per_mV_per_V (not 0), or calibration, a sheet with its certificate"
        )
    return per_unit, sheet["bridge_zero"] or 0.0


def _refuse_keys(sheet: Sheet, keys: dict[str, str], own: str, other: str) -> None:
    """Refuse keys that are about another kind of output than the channel's."""
    stated = [name for attribute, name in keys.items() if sheet[attribute] is not None]
    if stated:
        raise Refusal(
            f"{sheet.where} {stated[0]}: is about an output in {other}, the channel is in {own}; correct its unit, or "
            f"give {', '.join((BRIDGE_KEYS if keys is VOLT_KEYS else VOLT_KEYS).values())}"
        )


def range_of(sheet: Sheet, name: str, otherwise: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
    """Return a range of the sheet, or what holds in its place where the sheet leaves it open."""
    key = {"nominal_range": "nominal_range", "output_range": "output_range_V"}[name]
    if sheet[name] is None:
        return otherwise
    low, high = sheet[name]
    if not low < high:
        raise Refusal(f"{sheet.where} {key}: found [{low:g}, {high:g}], expected [lowest, highest]")
    return low, high


def sensitivity_findings(sheet: Sheet, line: CertificateLine, factor: float) -> list[Finding]:
    """Hold nominal sensitivity and ranges against the certificate: a factor between them is a wrong unit or sensor."""
    nominal, found = sheet["nominal_sensitivity_V_per_unit"], factor / line.gain
    if nominal is not None and (nominal == 0.0 or not 0.5 < found / nominal < 2.0):
        raise Refusal(
            f"{sheet.where} nominal_sensitivity_V_per_unit: {nominal:g} V per unit, the certificate shows "
            f"{found:.4g}; unit or certificate is wrong"
        )
    if nominal is not None and abs(found / nominal - 1.0) > OFF_NOMINAL:
        text = f"the certificate's sensitivity is {100 * (found / nominal - 1):+.2f} % off the nominal one"
        return [Finding("sensitivity_off_nominal", "warning", text, sheet.place)]
    if sheet["nominal_range"] is None or sheet["output_range"] is None:
        return []
    (low, high), (out_low, out_high) = range_of(sheet, "nominal_range"), range_of(sheet, "output_range")
    by_ranges = (out_high - out_low) / (high - low)
    if abs(abs(found) / by_ranges - 1.0) <= OFF_NOMINAL:
        return []
    text = (
        f"{out_low:g} to {out_high:g} V at {low:g} to {high:g} {sheet['unit']} are {by_ranges:.4g} V per unit, the "
        f"sensitivity is {found:.4g}, which is used: one of nominal_range, output_range_V and the sensitivity is wrong"
    )
    return [Finding("sensitivity_off_ranges", "warning", text, sheet.place)]

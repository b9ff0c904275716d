"""A sensor sheet, with its certificate, its stated sensitivity or values scaled by the logger -> `SensorCalibration`.

Uncertainties follow the usual rules (JCGM 100): a stated k=2 is halved, a tolerance +/-a is rectangular, a / sqrt(3).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path

from camtorque.config import SensorRef
from camtorque.config.quantities import CHANNEL_QUANTITIES, SENSED
from camtorque.ingest.sensitivity import CertificateLine, range_of, sensitivity_findings, sensor_line
from camtorque.ingest.sheet import Sheet, read_sheet
from camtorque.ingest.zeros import (
    READING_SHARE,
    USUAL_ACCURACY,
    Readings,
    apart_findings,
    with_zero,
    zero_findings,
    zero_of_readings,
    zero_tolerance_of,
)
from camtorque.records import Finding, Refusal, SensorCalibration
from camtorque.units import ATMOSPHERE, BORDER_UNITS, UNIT_OFFSETS, tidy_unit, unit_factor

DELAY_TOLERANCE = 0.10
"""Relative half width assumed for a delay whose sheet states no tolerance; printed as a finding."""
USUAL_DELAYS: dict[str, float] = {"torque": 0.5e-3, "pressure": 25e-6}
"""A delay that no sheet states: this +/- 100 %, which holds the amplifiers on the market [s]; reported as a warning."""
NO_LOW_PASS = re.compile(r"(high|band|hoch)[ -]?pa(ss|ß)|passe[ -](haut|bande)", re.IGNORECASE)
"""Kinds of a filter that let no steady value through."""
LONGEST_USUAL_DELAY = 2.0e-3
"""Of amplifiers [s]: what is longer is telemetry or a digital filter, or a slip of unit, and is told."""
USUAL_ORDER = 2
"""Order of a low-pass whose sheet names none."""
CERTIFICATE_DAYS = 366
"""A certificate older than this is reported; sensors are calibrated once a year."""
FIRST_STAMP = 946_684_800.0
"""2000-01-01: a logger that says an earlier date has no clock [s since 1970]."""


@dataclass(frozen=True)
class Sensor:
    """A calibration with the files it came from."""

    calibration: SensorCalibration
    files: tuple[Path, ...]
    findings: tuple[Finding, ...]
    calibration_date: date | None


def read_sensor(reference: SensorRef, unit: str = "V", span: float = math.nan) -> Sensor:
    """Return what turns a channel into SI.

    Parameters
    ----------
    unit : of the channel; a unit of the quantity where the logger has scaled already
    span : largest value that the channel shows [V, or SI where scaled]; stands in for a range that nobody states

    Raises
    ------
    Refusal : when sheet, certificate and recording contradict each other in serial, quantity or unit, or a key is
        missing
    """
    sheet = read_sheet(reference)
    output, factor = BORDER_UNITS.get(tidy_unit(unit), ("voltage", 1.0))
    others = _there(reference.zero_before, reference.zero_after)
    if output not in SENSED:
        calibration, findings = _scaled(sheet, reference.quantity, Readings(unit, others), span)
    else:
        readings = Readings("mV/V", [factor * reading for reading in others])
        if output == "voltage":
            readings = Readings("V", _there(reference.zero_before_volts, reference.zero_after_volts))
        line = sensor_line(sheet, reference.quantity, output)
        calibration, findings = _sensed(sheet, reference.quantity, line, readings, span)
    if sheet["nominal_range"] is None:  # then it holds all that the channel shows, wherever its zero lies
        reach = abs(calibration.gain) * (span + abs(calibration.zero_volts))
        calibration = replace(calibration, range_min=-reach, range_max=reach)
    return Sensor(calibration, sheet.files, (*sheet.findings, *findings), sheet["calibration_date"])


def _there(*readings: float | None) -> list[float]:
    return [reading for reading in readings if reading is not None]


def _sensed(
    sheet: Sheet, quantity: str, line: CertificateLine, readings: Readings, span: float
) -> tuple[SensorCalibration, list[Finding]]:
    """Return the calibration of what a sensor gives: volts, or mV/V of a bridge in their place."""
    factor = unit_factor(sheet["unit"], CHANNEL_QUANTITIES[quantity].dimension, f"{sheet.where} unit")
    anything = (-math.inf, math.inf)
    out_low, out_high = range_of(sheet, "output_range", anything) if readings.unit == "V" else anything
    reach = abs(line.gain) * span / factor
    low, high = range_of(sheet, "nominal_range", (-reach, reach))
    calibration, findings = _delayed(sheet, quantity)
    gain_std, more = _gain_std(sheet, line)
    calibration = replace(
        calibration, gain=line.gain, gain_relative_std=gain_std, nonlinearity_std=line.residual_rms,
        range_min=low * factor, range_max=high * factor, output_min_volts=out_low, output_max_volts=out_high,
        calibrated_to=line.largest,
    )  # fmt: skip
    calibration = with_zero(calibration, sheet, line, readings)
    off, beyond = zero_findings(calibration, sheet, line, readings)
    tolerance = zero_tolerance_of(sheet, calibration, abs(line.gain)) / abs(line.gain)
    findings += [*more, *line.findings, *sensitivity_findings(sheet, line, factor), *off,
                 *apart_findings(readings, tolerance, sheet)]  # fmt: skip
    # a sheet in degC counts from ice, the volts of its zero do not
    zero = calibration.zero_volts - UNIT_OFFSETS.get(tidy_unit(sheet["unit"]), 0.0) / line.gain
    return replace(calibration, zero_volts=zero, zero_std=math.hypot(calibration.zero_std, beyond)), findings


def _scaled(sheet: Sheet, quantity: str, readings: Readings, span: float) -> tuple[SensorCalibration, list[Finding]]:
    """Return the calibration of values that the logger has scaled: gain 1, zero and accuracy as stated."""
    unit, dimension = readings.unit, CHANNEL_QUANTITIES[quantity].dimension
    factor = unit_factor(unit, dimension, f"{sheet.where} unit of the channel")
    calibration, findings = _delayed(sheet, quantity)
    low, high = -span, span
    if sheet["nominal_range"] is not None:
        per_unit = unit_factor(sheet["unit"] or unit, dimension, f"{sheet.where} unit")
        low, high = (value * per_unit for value in range_of(sheet, "nominal_range"))
        calibration = replace(calibration, output_min_volts=low, output_max_volts=high, saturates=False)
    accuracy, assumed = _accuracy(sheet)
    largest = max(abs(low), abs(high))
    width = accuracy * largest
    zero, zero_std = zero_of_readings([factor * v for v in readings.values], READING_SHARE * largest, width)
    if sheet["reference"] == "absolute" and not readings.values:
        zero = ATMOSPHERE
    return replace(
        calibration, gain_relative_std=accuracy / math.sqrt(3.0), zero_std=zero_std, nonlinearity_std=0.0,
        zero_volts=zero - UNIT_OFFSETS.get(tidy_unit(unit), 0.0), range_min=low, range_max=high,
        zero_source="standstill" if readings.values else "certificate",
    ), [*findings, *assumed, *apart_findings(readings, width / factor, sheet)]  # fmt: skip


def _accuracy(sheet: Sheet) -> tuple[float, list[Finding]]:
    """Return the accuracy as a share of the range, assumed with a finding where the sheet states none."""
    accuracy = sheet.accuracy()
    if accuracy is not None:
        return accuracy, []
    text = f"{100 * USUAL_ACCURACY:g} % of the range"
    return USUAL_ACCURACY, [_assumed("accuracy", text, sheet, "accuracy_percent_fs")]


def _assumed(what: str, value: str, sheet: Sheet, key: str) -> Finding:
    text = f"nothing states the {what}; {value} is assumed, give {key}"
    return Finding(f"{what.replace('-', '_')}_assumed", "warning", text, sheet.place)


def _low_pass_delay(cutoff_hz: float, order: int) -> float:
    """Return the delay of a low-pass [s]; 0 without a cut-off (nan).

    It is nearly that of a Bessel filter (Thomson, Proc. IEE 96 (1949)); a Butterworth one is slower.
    """
    return math.sqrt((2 * order - 1) * math.log(2.0)) / (2.0 * math.pi * cutoff_hz) if cutoff_hz > 0.0 else 0.0


def certificate_age(sensor: Sensor, stamp: float | None, where: str) -> list[Finding]:
    """Tell a certificate that is older than a year, or younger than the recording; ``stamp`` counts from 1970 [s]."""
    if sensor.calibration_date is None:
        return []
    if stamp is None or stamp < FIRST_STAMP:
        text = (
            f"nothing says when this was recorded, so the certificate of {sensor.calibration.serial} of "
            f"{sensor.calibration_date} cannot be judged; give date in [recording]"
        )
        return [Finding("certificate_age_unknown", "info", text)]
    days = (datetime.fromtimestamp(stamp, UTC).date() - sensor.calibration_date).days
    if 0 <= days <= CERTIFICATE_DAYS:
        return []
    what = f"{days} days old" if days > 0 else f"dated {-days} days after the recording"
    return [Finding("certificate_age", "warning", f"the certificate of {sensor.calibration.serial} is {what}", where)]


def _gain_std(sheet: Sheet, line: CertificateLine) -> tuple[float, list[Finding]]:
    findings: list[Finding] = []
    stated = line.reference_relative_std
    if not math.isfinite(stated):
        accuracy, findings = _accuracy(sheet)
        stated = accuracy / math.sqrt(3.0)
    drift = sheet["span_drift_percent"] / 100.0 / math.sqrt(3.0)
    return math.sqrt(stated**2 + line.gain_relative_std**2 + drift**2), findings


def _delayed(sheet: Sheet, quantity: str) -> tuple[SensorCalibration, list[Finding]]:
    """Return delay and low-pass of a sensor; what its output means is not known yet."""
    if NO_LOW_PASS.search(sheet["filter"]):
        raise Refusal(
            f"{sheet.where} filter: found {sheet['filter']!r}, expected the low-pass in front of the logger, such as "
            f"'low-pass, 4th order, Bessel'; behind a high-pass a {quantity} has no mean"
        )
    delay, delay_std, findings = _delay(sheet, quantity)
    if sheet["filter"] and sheet["cutoff_hz"] and not sheet.filter_order:
        text = f"filter: {sheet['filter']!r} names no order; second order is taken (say '4th order, Bessel')"
        findings = [*findings, Finding("filter_order_assumed", "info", text, sheet.place)]
    if quantity == "torque" and not sheet["cutoff_hz"]:  # no other low-pass acts in the model
        findings = [*findings, _assumed("low-pass", "1 kHz +/- 100 %", sheet, "cutoff_hz")]
    return SensorCalibration(
        quantity, sheet.serial, delay=delay, delay_std=delay_std, cutoff_hz=sheet["cutoff_hz"] or math.nan,
        filter_order=sheet.filter_order, filter_damping=sheet.filter_damping,
    ), findings  # fmt: skip


def usual_delay(quantity: str, cutoff_hz: float, order: int) -> tuple[float, float]:
    """Return the delay of usual amplifiers of a quantity, where nothing states it, and its standard uncertainty [s].

    It is no shorter than that of the low-pass that is stated (nan, 0: none).
    """
    usual = USUAL_DELAYS.get(quantity, 0.0)
    usual = usual and max(usual, _low_pass_delay(cutoff_hz, order or USUAL_ORDER))
    return usual, usual / math.sqrt(3.0)


def _delay(sheet: Sheet, quantity: str) -> tuple[float, float, list[Finding]]:
    delay = sheet["group_delay"]
    if delay is None:
        usual, std = usual_delay(quantity, sheet["cutoff_hz"] or math.nan, sheet.filter_order)
        of = " of its low-pass" if usual > USUAL_DELAYS.get(quantity, 0.0) else ""
        text = f"{1e3 * usual:.3g} ms{of} +/- 100 %"
        return usual, std, [_assumed("delay", text, sheet, "group_delay_s")] if usual else []
    order = max(sheet.filter_order, 1)
    least = _low_pass_delay(sheet["cutoff_hz"] or math.nan, order)
    if delay < 0.5 * least:
        raise Refusal(
            f"{sheet.where} group_delay_s: {delay:g} s is shorter than the {least:.3g} s of its own low-pass "
            f"(order {order}, {sheet['cutoff_hz']:g} Hz), which it has to include"
        )
    long = f"a delay of {1e3 * delay:g} ms is that of telemetry or a digital filter, amplifiers take 2 ms at most"
    told = [Finding("delay_long", "warning", f"{long}; is group_delay_s in seconds?", sheet.place)]
    told = told if delay > LONGEST_USUAL_DELAY else []
    percent = sheet.percent("group_delay_note")
    if percent is not None:
        return delay, delay * percent / 100.0 / math.sqrt(3.0), told
    note = sheet["group_delay_note"]
    what = f"group_delay_note {note!r} names no percentage" if note else "the sheet states no tolerance"
    text = f"{what} of the delay of {delay:g} s; +/-{100 * DELAY_TOLERANCE:g} % is assumed"
    told.append(Finding("delay_tolerance_assumed", "info", text, sheet.place))
    return delay, delay * DELAY_TOLERANCE / math.sqrt(3.0), told

"""A sensor sheet and its certificate -> `SensorCalibration`.

Uncertainties follow the usual rules (JCGM 100): a stated k=2 is halved, a tolerance +/-a is rectangular, a / sqrt(3).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from camtorque.config import SensorRef
from camtorque.ingest.certificate import CertificateLine, read_certificate
from camtorque.records import Finding, Refusal, SensorCalibration
from camtorque.toml_table import Table, read_toml
from camtorque.units import ATMOSPHERE, did_you_mean, unit_factor

DELAY_TOLERANCE = 0.10
"""Relative half width assumed for a delay whose sheet states no tolerance; printed as a finding."""
READING_STEP = 1.0e-4
"""Standstill readings are noted to a tenth of a millivolt [V]."""
CERTIFICATE_DAYS = 366
"""A certificate older than this is told; sensors are calibrated once a year."""
FIRST_STAMP = 946_684_800.0
"""2000-01-01: a logger that says an earlier date has no clock [s since 1970]."""
PERCENT = re.compile(r"(\d+(?:\.\d+)?)\s*%")
ORDER = re.compile(r"(\d+)(?:st|nd|rd|th)?[- ]?order", re.IGNORECASE)
REFERENCES = ("gauge", "absolute")

SHEET_KEYS = (
    "serial",
    "type",
    "quantity",
    "unit",
    "reference",
    "nominal_range",
    "output_range_V",
    "nominal_sensitivity_V_per_unit",
    "accuracy_class",
    "accuracy_percent_fs",
    "cutoff_hz",
    "filter",
    "natural_frequency_hz",
    "group_delay_s",
    "group_delay_note",
    "zero_tolerance_V",
    "zero_drift_note",
    "residual_ripple_V",
    "span_drift_percent",
    "certificate",
    "calibration_date",
)


@dataclass(frozen=True)
class Sensor:
    """A calibration with the papers it came from."""

    calibration: SensorCalibration
    files: tuple[Path, ...]
    findings: tuple[Finding, ...]
    calibration_date: date | None


def read_sensor(reference: SensorRef) -> Sensor:
    """Read sheet and certificate of one sensor.

    Raises
    ------
    Refusal
        when sheet, certificate and recording contradict each other in serial, quantity or unit, or a key is missing
    """
    path = reference.calibration_path
    _, values = read_toml(path, f"[sensors.{reference.quantity}] names it as the sheet of its sensor")
    sheet = Table(values, path, "").table("sensor")
    serial = sheet.text("serial")
    if serial != reference.serial:
        raise Refusal(f"{path}: is the sheet of {serial}, [sensors.{reference.quantity}] has {reference.serial}")
    quantity = sheet.text("quantity")
    if quantity != reference.quantity:
        raise Refusal(f"{path}: quantity is {quantity!r}, but recording.toml names it for {reference.quantity!r}")
    unit = sheet.text("unit")
    factor = unit_factor(unit, quantity, f"{path} [sensor] unit")
    certificate = sheet.path("certificate")
    line = read_certificate(certificate, quantity, serial, unit)
    findings = [*_unknown(values, path), *_sensitivity(sheet, line, factor)]
    low, high = _pair(sheet, "nominal_range")
    out_low, out_high = _pair(sheet, "output_range_V")
    delay, delay_std, more = _delay(sheet)
    cutoff, order = _filter(sheet)
    calibration = SensorCalibration(
        serial=serial,
        quantity=quantity,
        gain=line.gain,
        gain_relative_std=_gain_std(sheet, line),
        zero_volts=math.nan,
        zero_std=math.nan,
        zero_source="certificate",
        nonlinearity_std=line.residual_rms,
        delay=delay,
        delay_std=delay_std,
        cutoff_hz=cutoff,
        filter_order=order,
        range_min=low * factor,
        range_max=high * factor,
        output_min_volts=out_low,
        output_max_volts=out_high,
    )
    calibration = _with_zero(calibration, sheet, line, reference)
    findings += [*more, *_zero_findings(calibration, sheet, line)]
    return Sensor(calibration, (path, certificate), tuple(findings), _date(sheet))


def with_idle_zero(calibration: SensorCalibration, mean_volts: float, std_volts: float) -> SensorCalibration:
    """Return the calibration with its zero from a stretch of the recording at standstill."""
    std = abs(calibration.gain) * std_volts
    return replace(calibration, zero_volts=mean_volts, zero_std=std, zero_source="idle stretch")


def _with_zero(
    calibration: SensorCalibration, sheet: Table, line: CertificateLine, reference: SensorRef
) -> SensorCalibration:
    """Take the zero from the standstill readings, else from the certificate with the sheet's tolerance."""
    readings = [v for v in (reference.zero_before_volts, reference.zero_after_volts) if v is not None]
    gain = abs(line.gain)
    tolerance = _zero_tolerance(sheet, calibration, gain)
    if not readings:
        # an absolute sensor shows the atmosphere at zero load; standstill readings hold it already
        absolute = sheet.choice("reference", REFERENCES) == "absolute" if sheet.has("reference") else False
        zero = line.zero_volts + (ATMOSPHERE / line.gain if absolute else 0.0)
        return replace(calibration, zero_volts=zero, zero_std=tolerance / math.sqrt(3.0), zero_source="certificate")
    zero = sum(readings) / len(readings)
    # between the readings the zero may have been anywhere: the half difference as one standard uncertainty;
    # with one reading the drift is unknown and half of the tolerance bounds it
    drift = gain * abs(readings[-1] - readings[0]) / 2.0 if len(readings) == 2 else tolerance / 2.0 / math.sqrt(3.0)
    std = math.hypot(drift, gain * READING_STEP / math.sqrt(12.0))
    return replace(calibration, zero_volts=zero, zero_std=std, zero_source="standstill")


def _zero_findings(calibration: SensorCalibration, sheet: Table, line: CertificateLine) -> list[Finding]:
    """Tell a standstill zero that lies further from the certificate's than the sheet allows."""
    off = line.gain * (calibration.zero_volts - line.zero_volts)
    tolerance = _zero_tolerance(sheet, calibration, abs(line.gain))
    if calibration.zero_source != "standstill" or abs(off) <= tolerance:
        return []
    text = (
        f"the standstill zero is {100.0 * abs(off) / calibration.range_max:.2g} % of the range off the certificate's, "
        f"the sheet allows {100.0 * tolerance / calibration.range_max:.2g} %; the standstill zero is used"
    )
    return [Finding("zero_off_certificate", "warning", text, sheet.file.name)]


def certificate_age(sensor: Sensor, stamp: float | None, where: str) -> list[Finding]:
    """Tell a certificate that is older than a year, or younger than the recording; ``stamp`` counts from 1970 [s]."""
    if stamp is None or sensor.calibration_date is None or stamp < FIRST_STAMP:
        return []
    days = (datetime.fromtimestamp(stamp, UTC).date() - sensor.calibration_date).days
    if 0 <= days <= CERTIFICATE_DAYS:
        return []
    what = f"{days} days old" if days > 0 else f"{-days} days younger than the recording"
    return [Finding("certificate_age", "warning", f"the certificate of {sensor.calibration.serial} is {what}", where)]


def _zero_tolerance(sheet: Table, calibration: SensorCalibration, gain: float) -> float:
    """Return the half width of the zero in SI from the sheet: in volts, in percent of range, or the accuracy."""
    span = max(abs(calibration.range_min), abs(calibration.range_max))
    if sheet.has("zero_tolerance_V"):
        return gain * sheet.number("zero_tolerance_V", least=0.0)
    note = PERCENT.search(sheet.text("zero_drift_note", ""))
    if note:
        return float(note[1]) / 100.0 * span
    for key in ("accuracy_percent_fs", "accuracy_class"):
        if sheet.has(key):
            return sheet.number(key, above=0.0) / 100.0 * span
    raise Refusal(f"{sheet.where('zero_tolerance_V')}: nothing on the sheet bounds the zero; add zero_tolerance_V")


def _gain_std(sheet: Table, line: CertificateLine) -> float:
    if math.isfinite(line.reference_relative_std):
        stated = line.reference_relative_std
    else:
        keys = [key for key in ("accuracy_percent_fs", "accuracy_class") if sheet.has(key)]
        if not keys:
            raise Refusal(
                f"{sheet.where('accuracy_class')}: neither certificate nor sheet states an uncertainty of the gain"
            )
        stated = sheet.number(keys[0], above=0.0) / 100.0 / math.sqrt(3.0)
    drift = sheet.number("span_drift_percent", default=0.0, least=0.0) / 100.0 / math.sqrt(3.0)
    return math.sqrt(stated**2 + line.gain_relative_std**2 + drift**2)


def _delay(sheet: Table) -> tuple[float, float, list[Finding]]:
    delay = sheet.number("group_delay_s", least=0.0)
    note = PERCENT.search(sheet.text("group_delay_note", ""))
    if note:
        return delay, delay * float(note[1]) / 100.0 / math.sqrt(3.0), []
    text = f"the sheet states no tolerance of the delay of {delay:g} s; +/-{100 * DELAY_TOLERANCE:g} % is assumed"
    finding = Finding("delay_tolerance_assumed", "info", text, sheet.file.name)
    return delay, delay * DELAY_TOLERANCE / math.sqrt(3.0), [finding]


def _filter(sheet: Table) -> tuple[float, int]:
    if not sheet.has("cutoff_hz"):
        return math.nan, 0
    text = sheet.text("filter", "")
    order = ORDER.search(text)
    if not order:
        raise Refusal(
            f"{sheet.where('filter')}: found {text!r}; with cutoff_hz it has to name the order ('low-pass, 2nd order')"
        )
    return sheet.number("cutoff_hz", above=0.0), int(order[1])


def _pair(sheet: Table, key: str) -> tuple[float, float]:
    value: Any = sheet.values.get(key)
    numbers = isinstance(value, list) and len(value) == 2 and all(isinstance(v, (int, float)) for v in value)
    if not numbers or not value[0] < value[1]:
        raise Refusal(f"{sheet.where(key)}: found {value!r}, expected [lowest, highest]")
    return float(value[0]), float(value[1])


def _date(sheet: Table) -> date | None:
    value = sheet.values.get("calibration_date")
    if isinstance(value, date):
        return value
    try:
        return date.fromisoformat(str(value)) if value is not None else None
    except ValueError as error:
        raise Refusal(f"{sheet.where('calibration_date')}: found {value!r}, expected a date like 2025-01-31") from error


def _sensitivity(sheet: Table, line: CertificateLine, factor: float) -> list[Finding]:
    """Hold the nominal sensitivity against the certificate: a factor between them is a wrong unit or sensor."""
    if not sheet.has("nominal_sensitivity_V_per_unit"):
        return []
    nominal = sheet.number("nominal_sensitivity_V_per_unit")
    found = factor / line.gain
    if nominal == 0.0 or not 0.5 < found / nominal < 2.0:
        raise Refusal(
            f"{sheet.where('nominal_sensitivity_V_per_unit')}: {nominal:g} V per unit, the certificate shows "
            f"{found:.4g}; "
            "unit or certificate is wrong"
        )
    if abs(found / nominal - 1.0) <= 0.02:
        return []
    text = f"the certificate's sensitivity is {100 * (found / nominal - 1):+.2f} % off the nominal one"
    return [Finding("sensitivity_off_nominal", "warning", text, sheet.file.name)]


def _unknown(values: dict[str, Any], path: Path) -> list[Finding]:
    return [
        Finding(
            "unknown_key", "warning", f"key {key!r} is not known and not used{did_you_mean(key, SHEET_KEYS)}", path.name
        )
        for key in values.get("sensor", {})
        if key not in SHEET_KEYS
    ]

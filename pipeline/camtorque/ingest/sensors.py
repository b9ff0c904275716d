"""A sensor sheet, with its certificate, its stated sensitivity or values scaled by the logger -> `SensorCalibration`.

Uncertainties follow the usual rules (JCGM 100): a stated k=2 is halved, a tolerance +/-a is rectangular, a / sqrt(3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path

from camtorque.config import SensorRef
from camtorque.config.quantities import CHANNEL_QUANTITIES, SENSED
from camtorque.ingest.certificate import CertificateLine
from camtorque.ingest.sensitivity import range_of, sensitivity_findings, sensor_line
from camtorque.ingest.sheet import Sheet, read_sheet
from camtorque.records import Finding, Refusal, SensorCalibration
from camtorque.units import ATMOSPHERE, BORDER_UNITS, UNIT_OFFSETS, tidy_unit, unit_factor

DELAY_TOLERANCE = 0.10
"""Relative half width assumed for a delay whose sheet states no tolerance; printed as a finding."""
USUAL_DELAYS: dict[str, float] = {"torque": 0.5e-3, "pressure": 25e-6}
"""A delay that no sheet states: this +/- 100 %, which holds the amplifiers on the market [s]; reported as a warning."""
USUAL_ACCURACY = 0.01
"""Share of the range assumed where nothing states the accuracy; reported as a warning."""
READING_STEP = 1.0e-4
"""Standstill readings are noted to a tenth of a millivolt, those of a bridge to a tenth of a uV/V [V, mV/V]."""
READING_SHARE = READING_STEP / 10.0
"""Scaled ones are noted to the same part of the range as a tenth of a millivolt is of 10 V."""
CERTIFICATE_DAYS = 366
"""A certificate older than this is reported; sensors are calibrated once a year."""
MILLIVOLTS = 0.1
"""A zero is noted in volts below this; millivolts written as volts lie above [V]."""
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
    output = BORDER_UNITS.get(tidy_unit(unit), ("voltage", 1.0))[0]
    if output in SENSED:
        line = sensor_line(sheet, reference.quantity, output)
        calibration, findings = _sensed(sheet, line, _in_output(reference, unit), span)
    else:
        calibration, findings = _scaled(sheet, reference, unit, span)
    return Sensor(calibration, sheet.files, (*sheet.findings, *findings), sheet["calibration_date"])


@dataclass(frozen=True)
class Readings:
    """Standstill readings of a sensor, in the unit of its output: V or mV/V."""

    quantity: str
    unit: str
    before: float | None
    after: float | None


def _in_output(reference: SensorRef, unit: str) -> Readings:
    kind, factor = BORDER_UNITS.get(tidy_unit(unit), ("voltage", 1.0))
    if kind == "voltage":
        return Readings(reference.quantity, "V", reference.zero_before_volts, reference.zero_after_volts)
    before, after = (None if v is None else factor * v for v in (reference.zero_before, reference.zero_after))
    return Readings(reference.quantity, "mV/V", before, after)


def _sensed(
    sheet: Sheet, line: CertificateLine, readings: Readings, span: float
) -> tuple[SensorCalibration, list[Finding]]:
    """Return the calibration of what a sensor gives: volts, or mV/V of a bridge in their place."""
    quantity = readings.quantity
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
    )  # fmt: skip
    calibration = _with_zero(calibration, sheet, line, readings)
    findings += [*more, *line.findings, *sensitivity_findings(sheet, line, factor)]
    more, beyond = _zero_findings(calibration, sheet, line, readings)
    findings += more
    calibration = replace(calibration, zero_std=math.hypot(calibration.zero_std, beyond))
    tolerance = _zero_tolerance(sheet, calibration, abs(line.gain)) / abs(line.gain)
    findings += _apart((readings.before, readings.after), tolerance, readings.unit, sheet)
    # a sheet in degC counts from ice, the volts of its zero do not
    shift = UNIT_OFFSETS.get(tidy_unit(sheet["unit"]), 0.0) / line.gain
    return replace(calibration, zero_volts=calibration.zero_volts - shift), findings


def _scaled(sheet: Sheet, reference: SensorRef, unit: str, span: float) -> tuple[SensorCalibration, list[Finding]]:
    """Return the calibration of values that the logger has scaled: gain 1, zero and accuracy as stated."""
    quantity = reference.quantity
    factor = unit_factor(unit, CHANNEL_QUANTITIES[quantity].dimension, f"{sheet.where} unit of the channel")
    calibration, findings = _delayed(sheet, quantity)
    low, high = -span, span
    if sheet["nominal_range"] is not None:
        per_unit = unit_factor(sheet["unit"] or unit, CHANNEL_QUANTITIES[quantity].dimension, f"{sheet.where} unit")
        low, high = (value * per_unit for value in range_of(sheet, "nominal_range", (low, high)))
    accuracy, assumed = _accuracy(sheet)
    findings += assumed
    width = accuracy * max(abs(low), abs(high))
    readings = [factor * v for v in (reference.zero_before, reference.zero_after) if v is not None]
    zero, zero_std = zero_of_readings(readings, READING_SHARE * max(abs(low), abs(high)), width)
    calibration = replace(
        calibration, gain_relative_std=accuracy / math.sqrt(3.0), zero_volts=zero, zero_std=zero_std,
        zero_source="standstill" if readings else "certificate", nonlinearity_std=0.0, range_min=low, range_max=high,
    )  # fmt: skip
    if sheet["nominal_range"] is not None:
        calibration = replace(calibration, output_min_volts=low, output_max_volts=high)
    if sheet["reference"] == "absolute" and not readings:
        calibration = replace(calibration, zero_volts=ATMOSPHERE)
    findings += _apart((reference.zero_before, reference.zero_after), width / factor, unit, sheet)
    shift = UNIT_OFFSETS.get(tidy_unit(unit), 0.0)
    return replace(calibration, zero_volts=calibration.zero_volts - shift), findings


def _apart(readings: tuple[float | None, float | None], tolerance: float, unit: str, sheet: Sheet) -> list[Finding]:
    """Tell standstill readings that lie further apart than two within the sheet's tolerance of the zero can."""
    before, after = readings
    if before is None or after is None or abs(after - before) <= 2.0 * tolerance:
        return []
    text = (
        f"the zero was {before:g} {unit} before and {after:g} {unit} after the run, {abs(after - before):.3g} {unit} "
        f"apart; the sheet allows it {tolerance:.3g} {unit} to either side: one reading is of another state or sensor, "
        "or the sensor drifts; their mean is used"
    )
    return [Finding("zero_readings_apart", "warning", text, sheet.place)]


def _accuracy(sheet: Sheet) -> tuple[float, list[Finding]]:
    """Return the accuracy as a share of the range, assumed with a finding where the sheet states none."""
    accuracy = sheet.accuracy()
    if accuracy is not None:
        return accuracy, []
    text = f"{100 * USUAL_ACCURACY:g} % of the range"
    return USUAL_ACCURACY, [_assumed("accuracy", text, sheet, "accuracy_percent_fs")]


def _assumed(what: str, value: str, sheet: Sheet, key: str) -> Finding:
    text = f"nothing states the {what}; {value} is assumed, give {key}"
    return Finding(f"{what}_assumed", "warning", text, sheet.place)


def zero_of_readings(readings: list[float], resolution: float, tolerance: float) -> tuple[float, float]:
    """Return the zero during the run and its standard uncertainty, in the unit of the readings.

    Two readings hold one degree of freedom: their scatter s is known only to lie between what the readings resolve
    and what the sheet allows, alike on a logarithmic scale, and by their difference d::

        p(s | d) ~ 1/s * 1/s exp(-d^2 / 4 s^2),    variance of the mean = E(s^2 | d) / 2

    in closed form (docs/decisions/0063). With one reading the drift is unknown and half of the tolerance bounds it;
    without any the whole tolerance does.

    Parameters
    ----------
    readings : at standstill, none, one or two
    resolution : step in which they were noted
    tolerance : half width of the zero by the sheet
    """
    most = tolerance / math.sqrt(3.0)
    if not readings:
        return 0.0, most
    least = resolution / math.sqrt(12.0)
    if len(readings) == 1:
        return readings[0], math.hypot(most / 2.0, least)
    half = max(abs(readings[1] - readings[0]) / 2.0, 1e-3 * least)
    most = max(most, math.sqrt(2.0) * half, 2.0 * least)

    def moment(scatter: float) -> float:
        return scatter * math.exp(-((half / scatter) ** 2)) + half * math.sqrt(math.pi) * math.erf(half / scatter)

    weight = math.sqrt(math.pi) / (2.0 * half) * (math.erf(half / least) - math.erf(half / most))
    return sum(readings) / 2.0, math.sqrt((moment(most) - moment(least)) / weight / 2.0)


def with_idle_zero(calibration: SensorCalibration, halves: tuple[float, float], noise: float) -> SensorCalibration:
    """Return the calibration with its zero from a stretch of the recording at standstill.

    Parameters
    ----------
    halves : means of its halves [V]; two readings
    noise : standard error of each [V]
    """
    gain = abs(calibration.gain)
    tolerance = math.sqrt(3.0) * calibration.zero_std / gain
    zero, std = zero_of_readings(list(halves), max(math.sqrt(12.0) * noise, READING_STEP), tolerance)
    return replace(calibration, zero_volts=zero, zero_std=gain * std, zero_source="idle stretch")


def _with_zero(
    calibration: SensorCalibration, sheet: Sheet, line: CertificateLine, taken: Readings
) -> SensorCalibration:
    """Take the zero from the standstill readings, else from the certificate with the sheet's tolerance."""
    readings = [v for v in (taken.before, taken.after) if v is not None]
    gain = abs(line.gain)
    tolerance = _zero_tolerance(sheet, calibration, gain)
    zero, std = zero_of_readings(readings, READING_STEP, tolerance / gain)
    if not readings:
        # an absolute sensor shows the atmosphere at zero load; standstill readings hold it already
        zero = line.zero_volts + (ATMOSPHERE / line.gain if sheet["reference"] == "absolute" else 0.0)
        return replace(calibration, zero_volts=zero, zero_std=gain * std, zero_source="certificate")
    return replace(calibration, zero_volts=zero, zero_std=gain * std, zero_source="standstill")


def _refuse_millivolts(
    off: float, tolerance: float, calibration: SensorCalibration, line: CertificateLine, taken: Readings
) -> None:
    """Refuse standstill readings that fit the certificate only if they are in millivolts."""
    shrunk = abs(line.gain) * abs(1e-3 * calibration.zero_volts - line.zero_volts)
    if abs(off) > 5.0 * tolerance and shrunk <= tolerance and abs(calibration.zero_volts) > MILLIVOLTS:
        readings = [reading for reading in (taken.before, taken.after) if reading is not None]
        said = " and ".join(f"{reading:g}" for reading in readings)
        large = [reading for reading in readings if abs(reading) > MILLIVOLTS]
        meant = " and ".join(f"{reading:g} mV = {1e-3 * reading:g} V" for reading in large)
        raise Refusal(
            f"[sensors.{calibration.quantity}] zero_before_V, zero_after_V: found {said} V, "
            f"{100.0 * abs(off) / calibration.largest_reading:.2g} % of the range off the certificate's on average: "
            f"did you mean {meant}?"
        )


def _refuse_short_delay(sheet: Sheet, delay: float) -> None:
    """Refuse a total delay that is shorter than that of the low-pass which it includes."""
    cutoff, order = sheet["cutoff_hz"], max(sheet.filter_order, 1)
    if cutoff is None:
        return
    # that of a Bessel filter, nearly (Thomson, Proc. IEE 96 (1949)); a Butterworth one is slower
    least = math.sqrt((2 * order - 1) * math.log(2.0)) / (2.0 * math.pi * cutoff)
    if delay < 0.5 * least:
        raise Refusal(
            f"{sheet.where} group_delay_s: {delay:g} s is shorter than the {least:.3g} s of its own low-pass "
            f"(order {order}, {cutoff:g} Hz), which it has to include"
        )


def _zero_findings(
    calibration: SensorCalibration, sheet: Sheet, line: CertificateLine, readings: Readings
) -> tuple[list[Finding], float]:
    """Tell a standstill zero that lies further from the certificate's than the sheet allows, and by how much.

    What it lies beyond is a standard uncertainty of it [SI]: the reading may be of another state.
    """
    off = line.gain * (calibration.zero_volts - line.zero_volts)
    tolerance = _zero_tolerance(sheet, calibration, abs(line.gain))
    if calibration.zero_source != "standstill" or abs(off) <= tolerance:
        return [], 0.0
    if readings.unit == "V":
        _refuse_millivolts(off, tolerance, calibration, line, readings)
    largest = calibration.largest_reading
    text = (
        f"the standstill zero is {100.0 * abs(off) / largest:.2g} % of the range off the certificate's, "
        f"the sheet allows {100.0 * tolerance / largest:.2g} %; the standstill zero is used, and what it lies beyond "
        f"that ({100.0 * (abs(off) - tolerance) / largest:.2g} %) counts as its uncertainty"
    )
    return [Finding("zero_off_certificate", "warning", text, sheet.place)], abs(off) - tolerance


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


def _zero_tolerance(sheet: Sheet, calibration: SensorCalibration, gain: float) -> float:
    """Return the half width of the zero in SI from the sheet: in volts, in percent of range, or the accuracy."""
    if sheet["zero_tolerance"] is not None:
        return gain * sheet["zero_tolerance"]
    percent, accuracy = sheet.percent("zero_drift_note"), sheet.accuracy()
    if percent is not None:
        return percent / 100.0 * calibration.largest_reading
    return (USUAL_ACCURACY if accuracy is None else accuracy) * calibration.largest_reading


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
    delay, delay_std, findings = _delay(sheet, quantity)
    if sheet["filter"] and sheet["cutoff_hz"] and not sheet.filter_order:
        text = f"filter: {sheet['filter']!r} names no order; second order is taken (say '4th order, Bessel')"
        findings = [*findings, Finding("filter_order_assumed", "info", text, sheet.place)]
    return SensorCalibration(
        quantity, sheet.serial, delay=delay, delay_std=delay_std, cutoff_hz=sheet["cutoff_hz"] or math.nan,
        filter_order=sheet.filter_order, filter_damping=sheet.filter_damping,
    ), findings  # fmt: skip


def usual_delay(quantity: str) -> tuple[float, float]:
    """Return the delay of usual amplifiers of a quantity, where nothing states it, and its standard uncertainty [s]."""
    usual = USUAL_DELAYS.get(quantity, 0.0)
    return usual, usual / math.sqrt(3.0)


def _delay(sheet: Sheet, quantity: str) -> tuple[float, float, list[Finding]]:
    delay = sheet["group_delay"]
    if delay is None:
        usual, std = usual_delay(quantity)
        text = f"{1e3 * usual:g} ms +/- 100 %"
        return usual, std, [_assumed("delay", text, sheet, "group_delay_s")] if usual else []
    _refuse_short_delay(sheet, delay)
    percent = sheet.percent("group_delay_note")
    if percent is not None:
        return delay, delay * percent / 100.0 / math.sqrt(3.0), []
    text = f"the sheet states no tolerance of the delay of {delay:g} s; +/-{100 * DELAY_TOLERANCE:g} % is assumed"
    finding = Finding("delay_tolerance_assumed", "info", text, sheet.place)
    return delay, delay * DELAY_TOLERANCE / math.sqrt(3.0), [finding]

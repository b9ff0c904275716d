"""The zero of a sensor: from standstill readings, an idle stretch or the certificate, and how sure it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from camtorque.ingest.sensitivity import CertificateLine
from camtorque.ingest.sheet import Sheet
from camtorque.records import Array, Finding, Refusal, SensorCalibration
from camtorque.units import ATMOSPHERE

USUAL_ACCURACY = 0.01
"""Share of the range assumed where nothing states the accuracy; reported as a warning."""
READING_STEP = 1.0e-4
"""Standstill readings are noted to a tenth of a millivolt, those of a bridge to a tenth of a uV/V [V, mV/V]."""
READING_SHARE = READING_STEP / 10.0
"""Scaled ones are noted to the same part of the range as a tenth of a millivolt is of 10 V."""
MILLIVOLTS = 0.1
"""A zero is noted in volts below this; millivolts written as volts lie above [V]."""

IDLE_SWING = 0.25
"""Share of the whole log's extent that 98 % of a standstill may take: noise and hum take a few percent, a
running pump nearly all."""


@dataclass(frozen=True)
class Readings:
    """Standstill readings of a sensor, before or after the run or both, in the unit of its output: V or mV/V."""

    unit: str
    values: list[float]


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


def with_idle_zero(calibration: SensorCalibration, values: Array, extent: float, what: str) -> SensorCalibration:
    """Return the calibration with its zero from a stretch at standstill, whose halves are two readings.

    Parameters
    ----------
    values, extent : samples of the stretch, and how far those of the whole log lie apart [V]

    Raises
    ------
    Refusal : all but 2 % of it lie apart by more than `IDLE_SWING` of what the whole log does
    """
    low, high = np.percentile(values, [1.0, 99.0])
    if high - low > IDLE_SWING * extent:
        raise Refusal(
            f"{what} swings by {100.0 * (high - low) / extent:.0f} % of what the whole log does, expected at most "
            f"{100.0 * IDLE_SWING:.0f} % at standstill; correct idle_from_s and idle_to_s [s after the first sample]"
        )
    halves = [float(half.mean()) for half in np.array_split(values, 2)]
    noise = float(values.std()) / math.sqrt(0.5 * values.size)
    gain = abs(calibration.gain)
    tolerance = math.sqrt(3.0) * calibration.zero_std / gain
    zero, std = zero_of_readings(halves, max(math.sqrt(12.0) * noise, READING_STEP), tolerance)
    return replace(calibration, zero_volts=zero, zero_std=gain * std, zero_source="idle stretch")


def with_zero(
    calibration: SensorCalibration, sheet: Sheet, line: CertificateLine, taken: Readings
) -> SensorCalibration:
    """Take the zero from the standstill readings, else from the certificate with the sheet's tolerance."""
    gain, source = abs(line.gain), "standstill"
    zero, std = zero_of_readings(taken.values, READING_STEP, zero_tolerance_of(sheet, calibration, gain) / gain)
    if not taken.values:
        # an absolute sensor shows the atmosphere at zero load; standstill readings hold it already
        zero = line.zero_volts + (ATMOSPHERE / line.gain if sheet["reference"] == "absolute" else 0.0)
        source = "certificate"
    return replace(calibration, zero_volts=zero, zero_std=gain * std, zero_source=source)


def _refuse_millivolts(
    off: float, tolerance: float, calibration: SensorCalibration, line: CertificateLine, taken: Readings
) -> None:
    """Refuse standstill readings that fit the certificate only if they are in millivolts."""
    shrunk = abs(line.gain) * abs(1e-3 * calibration.zero_volts - line.zero_volts)
    if abs(off) > 5.0 * tolerance and shrunk <= tolerance and abs(calibration.zero_volts) > MILLIVOLTS:
        said = " and ".join(f"{reading:g}" for reading in taken.values)
        large = [reading for reading in taken.values if abs(reading) > MILLIVOLTS]
        meant = " and ".join(f"{reading:g} mV = {1e-3 * reading:g} V" for reading in large)
        raise Refusal(
            f"[sensors.{calibration.quantity}] zero_before_V, zero_after_V: found {said} V, "
            f"{100.0 * abs(off) / calibration.largest_reading:.2g} % of the range off the certificate's on average: "
            f"did you mean {meant}?"
        )


def zero_findings(
    calibration: SensorCalibration, sheet: Sheet, line: CertificateLine, readings: Readings
) -> tuple[list[Finding], float]:
    """Tell a standstill zero further from the certificate's than the sheet allows, and how unsure that makes it.

    Both zeros may be off by what the sheet allows, each on its side. What lies beyond that is a standard uncertainty of
    the standstill zero [SI]: the reading may be of another state.
    """
    off = line.gain * (calibration.zero_volts - line.zero_volts)
    tolerance = zero_tolerance_of(sheet, calibration, abs(line.gain))
    if calibration.zero_source != "standstill" or abs(off) <= tolerance:
        return [], 0.0
    if readings.unit == "V":
        _refuse_millivolts(off, tolerance, calibration, line, readings)
    largest = calibration.largest_reading
    text = (
        f"the standstill zero differs from the certificate's by {100.0 * abs(off) / largest:.2g} % of the range, "
        f"the sheet allows {100.0 * tolerance / largest:.2g} %; the standstill zero is used: check the readings"
    )
    beyond = max(abs(off) - 2.0 * tolerance, 0.0)
    if beyond:
        text += f"; what lies beyond twice that ({100.0 * beyond / largest:.2g} %) counts as its uncertainty"
    return [Finding("zero_off_certificate", "warning", text, sheet.place)], beyond


def apart_findings(readings: Readings, tolerance: float, sheet: Sheet) -> list[Finding]:
    """Tell standstill readings that lie further apart than two within the sheet's tolerance of the zero can."""
    if len(readings.values) < 2 or abs(readings.values[1] - readings.values[0]) <= 2.0 * tolerance:
        return []
    (before, after), unit = readings.values, readings.unit
    text = (
        f"the zero was {before:g} {unit} before and {after:g} {unit} after the run, {abs(after - before):.3g} {unit} "
        f"apart; the sheet allows {tolerance:.3g} {unit} either way: one reading is from another state or sensor, "
        "or the sensor drifts; their mean is used"
    )
    return [Finding("zero_readings_apart", "warning", text, sheet.place)]


def zero_tolerance_of(sheet: Sheet, calibration: SensorCalibration, gain: float) -> float:
    """Return the half width of the zero in SI from the sheet: in volts, in percent of range, or the accuracy."""
    if sheet["zero_tolerance"] is not None:
        return gain * sheet["zero_tolerance"]
    percent, accuracy = sheet.percent("zero_drift_note"), sheet.accuracy()
    if percent is not None:
        return percent / 100.0 * calibration.largest_reading
    return (USUAL_ACCURACY if accuracy is None else accuracy) * calibration.largest_reading

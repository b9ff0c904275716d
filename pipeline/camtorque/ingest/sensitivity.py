"""What the output of a sensor means: the line of its certificate, or the one that its stated sensitivity draws.

A certificate holds points (applied load, output); a straight line goes through all of them. A sensor gives volts, or,
as an unamplified bridge, its output over its supply in mV/V; where the supply was recorded beside it, sample by sample.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from camtorque.config import ChannelSpec
from camtorque.config.quantities import CHANNEL_QUANTITIES
from camtorque.ingest.raw import SUPPLY, PairSource, RawChannel
from camtorque.ingest.sheet import Sheet
from camtorque.ingest.table_file import read_small_table
from camtorque.records import Array, Finding, Refusal
from camtorque.units import tidy_unit, unit_factor

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
FIGURE = r"\d{1,9}(?:[.,]\d{1,9})?"
UNCERTAINTY = (
    re.compile(rf"(?P<percent>{FIGURE})\s*%[\s,;(]{{0,3}}k\s*=\s*(?P<k>{FIGURE})", re.IGNORECASE),
    re.compile(rf"k\s*=\s*(?P<k>{FIGURE}(?![.,]?\d)|\d)\D{{0,30}}?(?P<percent>{FIGURE})\s*%", re.IGNORECASE),
)
"""How a certificate states its uncertainty: 0.05 % (k=2), or (k=2) 0.05 %."""
MOST_UNCERTAIN = 5.0
"""A larger percentage beside the coverage factor is not the uncertainty: humidity stands there too."""
APPLIED = re.compile(r"^applied_(?P<quantity>[a-z]+)_(?P<unit>.+)$")
LEAST_POINTS = 3
STANDS_OUT, STANDS_OUT_PERCENT = 10.0, 0.2
"""A point is told that lies off the line through the others by so many times their scatter, and so much of the range:
hysteresis and reading leave a tenth of a percent."""
LOOKED_AT = 100_000
SUPPLIES = (0.5, 30.0)
"""Supplies of strain gauge bridges [V]: 1 to 24 V in use."""


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


@dataclass(frozen=True)
class CertificateLine:
    """The line through a certificate.

    Attributes
    ----------
    gain : SI per volt
    gain_relative_std : standard uncertainty of the fit alone
    zero_volts : volts at zero load, from the line
    residual_rms : in SI
    reference_relative_std : stated uncertainty of the certificate over its range, k=1; nan where it states none
    findings : a point that the others contradict
    largest : load of the largest point in SI, infinite where no certificate has points
    """

    gain: float
    gain_relative_std: float
    zero_volts: float
    residual_rms: float
    reference_relative_std: float
    findings: tuple[Finding, ...] = ()
    largest: float = math.inf


def read_certificate(path: Path, quantity: str, serial: str, sheet_unit: str, output: str) -> CertificateLine:
    """Fit volts = zero + applied / gain by least squares over all points, loading and unloading, both signs.

    ``output`` is the dimension of the volts: that of a bridge counts in mV/V.
    """
    table = read_small_table(path, "a calibration certificate")
    loads = [match for name in table.columns if (match := APPLIED.match(name))]
    outputs = [name for name in table.columns if name.startswith("output_")]
    if len(loads) != 1 or len(outputs) != 1:
        shown = ", ".join(table.columns)
        raise Refusal(f"{path}: expected columns applied_{quantity}_<unit> and output_<unit>, found {shown}")
    load, output_name, unit = loads[0][0], outputs[0], loads[0]["unit"].replace("_", " ")
    if loads[0]["quantity"] != quantity:
        raise Refusal(f"{path}: column {load!r} is about {loads[0]['quantity']}, the sheet about {quantity}")
    if tidy_unit(unit) != tidy_unit(sheet_unit):
        raise Refusal(f"{path}: the certificate is in {unit!r}, the sheet in {sheet_unit!r}; one of them is wrong")
    named = re.findall(r"\b[A-Z][A-Za-z0-9]*-\d{3,}\b", table.comment)
    if named and serial not in named:
        raise Refusal(
            f"{path}: is the certificate of {named[0]}, the sheet is that of {serial}; take the right certificate"
        )
    applied = table.columns[load] * unit_factor(unit, quantity, f"{path} column {load!r}")
    # mV/V may have been read as a name over its unit
    over = f"/{table.units[output_name]}" if table.units.get(output_name) else ""
    volt_unit = output_name.removeprefix("output_").replace("_per_", "/") + over
    volts = table.columns[output_name] * unit_factor(volt_unit, output, str(path))
    return _fit(path, applied, volts, _stated(path, table.comment))


def _stated(path: Path, comment: str) -> float:
    """Return the relative standard uncertainty that a certificate states, nan where it states none."""
    stated = next((found for pattern in UNCERTAINTY if (found := pattern.search(comment))), None)
    if stated is None:
        return float("nan")
    factor, percent = (float(stated[name].replace(",", ".")) for name in ("k", "percent"))
    if not factor > 0.0:
        raise Refusal(f"{path}: states an uncertainty at k={stated['k']}; k has to be above 0, usually 2")
    if percent > MOST_UNCERTAIN:
        raise Refusal(
            f"{path}: found {stated[0]!r}, an uncertainty of {percent:g} %, expected at most {MOST_UNCERTAIN:g} %; "
            'write it as "0.05 % (k=2)"'
        )
    return percent / 100.0 / factor


def _fit(path: Path, applied: Array, volts: Array, relative: float) -> CertificateLine:
    if applied.size < LEAST_POINTS or np.ptp(applied) == 0.0:
        raise Refusal(f"{path}: {applied.size} points; a line needs at least {LEAST_POINTS} at different loads")
    slope, zero = np.polyfit(applied, volts, 1)
    if slope == 0.0 or not np.isfinite(slope):
        raise Refusal(f"{path}: the output does not change with the load; are the columns right?")
    scatter = float(np.sqrt(np.sum(((volts - zero - slope * applied) / slope) ** 2) / (applied.size - 2)))
    if scatter > 0.05 * np.ptp(applied):
        raise Refusal(f"{path}: the points scatter by {scatter:.3g} (SI) about a line, more than 5 % of their range")
    # std of the slope over the slope: the residuals are in units of the load
    fit_std = scatter / float(np.sqrt(np.sum((applied - applied.mean()) ** 2)))
    findings = _outlying(path, applied, volts, float(slope))
    largest = float(np.max(np.abs(applied)))
    return CertificateLine(1.0 / float(slope), fit_std, float(zero), scatter, relative, findings, largest)


def _outlying(path: Path, applied: Array, volts: Array, slope_of_all: float) -> tuple[Finding, ...]:
    """Return a warning on the point without which the others scatter least, where it lies far off their line."""
    found = []
    for place in range(applied.size if applied.size > LEAST_POINTS + 1 else 0):
        others = np.arange(applied.size) != place
        if np.ptp(applied[others]) == 0.0:
            continue  # the others are no line
        slope, zero = np.polyfit(applied[others], volts[others], 1)
        off = (volts - zero - slope * applied) / slope
        scatter = float(np.sqrt(np.sum(off[others] ** 2) / (applied.size - 3)))
        found.append((scatter, abs(float(off[place])), place, float(slope)))
    scatter, off, place, slope = min(found, default=(0.0, 0.0, 0, 1.0))
    span = float(np.ptp(applied)) / 100.0
    if off <= max(STANDS_OUT * scatter, STANDS_OUT_PERCENT * span):
        return ()
    moved = 100.0 * (slope_of_all / slope - 1.0)
    text = (
        f"point {place + 1} of the certificate lies {off / span:.2g} % of the range off the line through the others, "
        f"which scatter by {scatter / span:.2g} %; a typing error? It is included, and moves the sensitivity by "
        f"{moved:+.2g} %"
    )
    return (Finding("certificate_point", "warning", text, path.name),)


def with_supplies(specs: Sequence[ChannelSpec]) -> tuple[ChannelSpec, ...]:
    """Return the channels to read: those of the recording, then the supplies that they name."""
    supplies = (
        replace(spec, quantity=SUPPLY, channel=spec.supply_channel, unit="V", supply_channel="")
        for spec in specs
        if spec.supply_channel
    )
    return (*specs, *supplies)


def over_supplies(specs: Sequence[ChannelSpec], read: Sequence[RawChannel]) -> list[RawChannel]:
    """Return the channels of the recording from what was read of `with_supplies`.

    Raises
    ------
    Refusal : a supply that has other samples than its bridge, or is none
    """
    supplies = iter(read[len(specs) :])
    channels = zip(specs, read, strict=False)
    return [_over(spec, raw, next(supplies)) if spec.supply_channel else raw for spec, raw in channels]


def _over(spec: ChannelSpec, raw: RawChannel, supply: RawChannel) -> RawChannel:
    where = f"{spec.path} {spec.channel!r} supply_channel {spec.supply_channel!r}"
    alike = raw.source.n_samples == supply.source.n_samples and raw.breaks == supply.breaks
    if not alike or abs(raw.start_time - supply.start_time) * raw.sample_rate > 0.5:
        raise Refusal(
            f"{where}: {supply.source.n_samples} samples at {supply.sample_rate:.8g} Hz from {supply.start_time:g} s "
            f"on, the bridge has {raw.source.n_samples} at {raw.sample_rate:.8g} Hz from {raw.start_time:g} s on; "
            "export both on one time base"
        )
    volts = unit_factor(supply.unit.strip("-") or "V", "voltage", f"{where} unit")
    first = supply.source.read(0, min(supply.source.n_samples, LOOKED_AT)) * volts
    usual = float(np.median(np.abs(first[np.isfinite(first)]))) if np.isfinite(first).any() else 0.0
    if not SUPPLIES[0] <= usual <= SUPPLIES[1]:
        raise Refusal(
            f"{where}: is {usual:.4g} V in the median, expected the supply of a bridge, {SUPPLIES[0]:g} to "
            f"{SUPPLIES[1]:g} V; is it another channel or in mV?"
        )
    factor = 1e3 * unit_factor(spec.unit, "voltage", f"{where} unit") / volts

    def ratio(above: Array, below: Array) -> Array:
        return factor * above / np.where(below == 0.0, np.nan, below)  # without a supply there is no number

    return replace(raw, source=PairSource(raw.source, supply.source, ratio), unit=spec.output_unit)

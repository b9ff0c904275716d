"""A calibration certificate: points (applied load, output), a straight line through all of them, its scatter."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from camtorque.ingest.table_file import read_small_table
from camtorque.records import Array, Finding, Refusal
from camtorque.units import tidy_unit, unit_factor

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
    """

    gain: float
    gain_relative_std: float
    zero_volts: float
    residual_rms: float
    reference_relative_std: float
    findings: tuple[Finding, ...] = ()


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
    return CertificateLine(1.0 / float(slope), fit_std, float(zero), scatter, relative, findings)


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
        f"which scatter by {scatter / span:.2g} %; a slip of the pen? It counts, and moves the sensitivity by "
        f"{moved:+.2g} %"
    )
    return (Finding("certificate_point", "warning", text, path.name),)

"""result.json by its contract (docs/result_schema.md): numbers in border units, null where undetermined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from camtorque.jsonable import jsonable
from camtorque.laws import ROWS
from camtorque.laws.fluid import fuel_temperature
from camtorque.limits import judge, limits_document
from camtorque.records import (
    Alternative,
    Estimate,
    FittedTorque,
    LossEvidence,
    ParameterEstimate,
    ResidualBump,
)
from camtorque.report.bundle import RunResult
from camtorque.report.files import findings_document, inputs_document
from camtorque.report.gaps import STRETCHES, gap_shares
from camtorque.report.measured import measured_document, measured_findings
from camtorque.report.numbers import typeset
from camtorque.report.verdict import verdict
from camtorque.results import SCHEMA
from camtorque.units import BAR, DEGREE, RPM, ZERO_CELSIUS
from camtorque.version import __version__

SENTENCES = ("text", "meaning", "source", "next_measurement")
"""Keys whose values are read by people."""


def result_document(result: RunResult) -> dict[str, Any]:
    """Return the content of result.json."""
    fitted, measured = result.fitted, measured_document(result)
    doc = jsonable(
        {
            "schema": SCHEMA,
            "version": __version__,
            "created": result.created,
            "seed": 0,
            "inputs": inputs_document(result.recording.inputs),
            "recording": _recording(result),
            "findings": findings_document((*result.findings, *measured_findings(measured))),
            "alignment": _alignment(result),
            "explained": fitted.explained,
            "bumps": [_bump(bump) for bump in fitted.bumps],
            "evidence": evidence_document(fitted.evidence),
            "alternatives": [_alternative(row) for row in fitted.alternatives],
            "accuracy": _accuracy(fitted),
            "ladder": [],
            "effects": fitted.effects,
            "parameters": parameters_document(fitted.parameters),
            "uncertainty": uncertainty_document(fitted),
            "metrics": {name: asdict(metrics) for name, metrics in fitted.metrics.items()},
            "losses": {"unit": "J per revolution", **fitted.losses},
            "losses_stderr": {"unit": "J per revolution", **fitted.losses_stderr},
            "gap_by_cause": _gap(result),
            "chamber": _chamber(fitted),
            "measured": measured,
            "forces": _forces(fitted),
            "next_measurement": fitted.next_measurement,
            "timing_s": result.timing,
            "peak_memory_mb": result.peak_memory_mb,
        }
    )
    doc = printed({**doc, "verdict": verdict(doc)})
    return {**doc, "limits": limits_document(judge(doc, result.limits))} if result.limits else doc


def printed(value: Any, key: str = "") -> Any:
    """Return a document whose sentences have the signs of print (`typeset`); names and units stay as they are."""
    if isinstance(value, dict):
        return {name: printed(item, name) for name, item in value.items()}
    if isinstance(value, list):
        return [printed(item, key) for item in value]
    return typeset(value) if key in SENTENCES and isinstance(value, str) else value


def parameters_document(parameters: tuple[ParameterEstimate, ...]) -> dict[str, Any]:
    """Return parameters by name; ``prior`` is [mean, standard deviation] or None.

    A standard error of zero belongs to a value that a bound holds: it was not determined.
    """
    found = {}
    for row in parameters:
        found[row.name] = _but_name(row)
        for key in ("stderr", "stderr_statistical"):
            found[row.name][key] = found[row.name][key] or None
    return found


def evidence_document(evidence: Sequence[LossEvidence]) -> dict[str, Any]:
    """Return the evidence for each loss by its name."""
    return {row.name: _but_name(row) for row in evidence}


def _but_name(row: LossEvidence | ParameterEstimate) -> dict[str, Any]:
    return {key: value for key, value in asdict(row).items() if key != "name"}


def _bump(bump: ResidualBump) -> dict[str, Any]:
    return {
        "start_deg": bump.start / DEGREE, "stop_deg": bump.stop / DEGREE, "peak_nm": bump.peak,
        "times_repeatability": bump.times_repeatability, "phase": bump.phase,
        "frequency_hz": bump.frequency or None,
    }  # fmt: skip


def _alternative(row: Alternative) -> dict[str, Any]:
    return {
        "name": row.name, "probability": row.probability, "rms_nm": row.rms_nm,
        "trigger_angle_deg": row.trigger_angle / DEGREE, "chamber_peak_bar": row.chamber_peak / BAR,
    }  # fmt: skip


def _accuracy(fitted: FittedTorque) -> dict[str, Any]:
    """Return shape of the residual, what the cycles repeat, and what no residual shows, in percent of the peak."""
    held = fitted.metrics["fitted_held_out_cycles"]
    share = held.rms_percent_of_peak / held.rms_nm if held.rms_nm else float("nan")
    blocks = fitted.details.get("block_cv_percent")
    return {
        "shape_residual_percent": held.rms_percent_of_peak,
        "repeatability_percent": share * fitted.odd_even_rms,
        "block_cv_rms_percent": float(np.sqrt(np.mean(np.square(blocks)))) if blocks else None,
        "block_cv_percent": blocks,
        "absolute_uncertainty_percent": fitted.details.get("absolute_uncertainty_percent"),
    }


def uncertainty_document(fitted: FittedTorque) -> dict[str, Any]:
    """Return the budget of a fit by parameter, in the units of the parameters."""
    return {
        "budget": {
            row.name: {typeset(source): value / ROWS[row.name].per_unit for source, value in row.contributions.items()}
            for row in fitted.details.get("budget", ())
        }
    }


def _recording(result: RunResult) -> dict[str, Any]:
    """Return what was measured; date, temperature and pressure, over which trends are drawn, None where untold."""
    config, cycles = result.recording.config, result.cycles
    warm = fuel_temperature(config.fluid, cycles)
    return {
        "name": config.id,
        "pump": config.pump_id,
        "speed_rpm": cycles.mean_speed / RPM,
        "speed_ripple_percent": cycles.speed_ripple_percent,
        "duration_s": cycles.duration,
        "cycles_found": cycles.cycles_found,
        "cycles_used": cycles.index.size,
        "peak_torque_nm": np.max(cycles.mean_torque),
        "odd_even_rms_nm": result.fitted.odd_even_rms,
        "trigger_jitter_s": cycles.trigger_jitter_s,
        "date": None if config.date is None else config.date.isoformat(),
        "fuel_temperature_c": None if warm is None else warm - ZERO_CELSIUS,
        "line_pressure_peak_bar": np.max(cycles.mean_pressure) / BAR,
        "cut_flow": [asdict(row) for row in cycles.cut_flow],
    }


def _estimate(estimate: Estimate, per_unit: float = 1.0) -> dict[str, float]:
    return {name: value / per_unit for name, value in asdict(estimate).items()}


def _alignment(result: RunResult) -> dict[str, Any]:
    fitted, cycles = result.fitted, result.cycles
    return {
        "trigger_angle_deg": _estimate(fitted.trigger_angle, DEGREE),
        "clock": [asdict(clock) for clock in cycles.clocks],
        "torque_delay_s": _estimate(fitted.torque_delay),
        "angle_error_budget_deg": [asdict(row) for row in cycles.angle_errors],
        "angle_error_budget_after_fit_deg": [asdict(row) for row in fitted.angle_errors_after],
    }


def _gap(result: RunResult) -> dict[str, Any]:
    """Return measured minus rigid torque by cause; each column sums to its total."""
    shares = gap_shares(result)
    total = {f"{name}_nm": sum(row.parts[k] for row in shares) for k, name in enumerate(STRETCHES)}
    rows = [
        {
            "cause": row.cause, "text": row.meaning,
            **{f"{name}_nm": row.parts[k] for k, name in enumerate(STRETCHES)},
            **{f"{name}_stderr_nm": None if row.stderr is None else row.stderr[k] for k, name in enumerate(STRETCHES)},
        }
        for row in shares
    ]  # fmt: skip
    return {"total": total, "causes": rows}


def _chamber(fitted: FittedTorque) -> dict[str, Any] | None:
    if fitted.chamber_pressure is None:
        return None
    start, peak = fitted.chamber_return_start, fitted.chamber_peak
    return {
        "peak_bar": None if peak is None else _estimate(peak, BAR),
        "return_start_bar": None if start is None else _estimate(start, BAR),
    }


def _forces(fitted: FittedTorque) -> dict[str, Any]:
    forces = fitted.forces
    return {
        "contact_normal_max_n": _largest(forces.contact_normal),
        "guide_max_n": _largest(np.abs(forces.guide)),
        "bearing_max_n": _largest(np.hypot(forces.bearing_x, forces.bearing_y)),
        "hertz_max_gpa": _largest(forces.hertz) / 1e9,
        "contact_lost": fitted.contact_lost,
    }


def _largest(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else float("nan")

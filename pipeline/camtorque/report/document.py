"""result.json by its contract (docs/result_schema.md): numbers in border units, null where undetermined."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.plain import plain
from camtorque.records import AngleError, Estimate, FittedTorque, ParameterEstimate, Recording
from camtorque.report.bundle import RunResult
from camtorque.report.gaps import gap_shares
from camtorque.units import BAR, DEGREE, RPM
from camtorque.version import __version__

SCHEMA = "camtorque.result/1"


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document under a temporary name, then rename it; NaN is never written."""
    partial = path.with_name(f".{path.name}.partial")
    text = json.dumps(plain(document), indent=1, ensure_ascii=False, allow_nan=False)
    # a path may hold bytes that are no text; escaped, they are JSON again
    partial.write_text(text + "\n", encoding="utf-8", errors="backslashreplace")
    os.replace(partial, path)


def result_document(result: RunResult) -> dict[str, Any]:
    """Return the content of result.json.

    Parameters
    ----------
    result : one finished run
    """
    fitted = result.fitted
    return plain(
        {
            "schema": SCHEMA,
            "version": __version__,
            "created": result.created,
            "seed": result.seed,
            "inputs": inputs_document(result.recording),
            "recording": _recording(result),
            "findings": [asdict(finding) for finding in result.findings],
            "alignment": _alignment(result),
            "ladder": [asdict(rung) for rung in fitted.ladder],
            "effects": fitted.effects,
            "parameters": parameters_document(fitted.parameters),
            "uncertainty": uncertainty_document(fitted),
            "metrics": {name: asdict(metrics) for name, metrics in fitted.metrics.items()},
            "losses": {"unit": "J per revolution", **fitted.losses},
            "gap_by_cause": _gap(result),
            "chamber": _chamber(fitted),
            "forces": _forces(fitted),
            "next_measurement": fitted.next_measurement,
            "timing_s": result.timing,
            "peak_memory_mb": result.peak_memory_mb,
        }
    )


def inputs_document(recording: Recording) -> list[dict[str, str]]:
    """Return every file that was read with its SHA-256."""
    return [{"path": str(item.path), "sha256": item.sha256} for item in recording.inputs]


def parameters_document(parameters: tuple[ParameterEstimate, ...]) -> dict[str, Any]:
    """Return parameters by name; ``prior`` is [mean, standard deviation] or None."""
    return {row.name: {key: value for key, value in asdict(row).items() if key != "name"} for row in parameters}


def uncertainty_document(fitted: FittedTorque) -> dict[str, Any]:
    """Return profiles, bootstrap and budget of a fit by parameter, in the units of the parameters."""
    drawn = fitted.details.get("bootstrap")
    profiles = {
        item.name: {"kind": item.kind, "low": item.low, "high": item.high, "values": item.values, "rise": item.rise}
        for item in fitted.details.get("profiles", ())
    }
    return {
        "profiles": profiles,
        "bootstrap": {} if drawn is None else dict(zip(drawn.names, drawn.std, strict=True)),
        "combinations": [{**asdict(item), "text": item.text} for item in fitted.details.get("combinations", ())],
        "budget": {row.name.split("__")[0]: dict(row.contributions) for row in fitted.details.get("budget", ())},
    }


def _recording(result: RunResult) -> dict[str, Any]:
    cycles = result.cycles
    assert cycles.torque is not None
    return {
        "name": result.recording.config.id,
        "pump": result.recording.config.pump_id,
        "speed_rpm": cycles.mean_speed / RPM,
        "speed_ripple_percent": cycles.speed_ripple_percent,
        "duration_s": cycles.duration,
        "cycles_found": cycles.cycles_found,
        "cycles_used": cycles.index.size,
        "peak_torque_nm": np.max(np.mean(cycles.torque, axis=0)),
        "odd_even_rms_nm": result.fitted.odd_even_rms,
        "trigger_jitter_s": cycles.trigger_jitter_s,
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
        "angle_error_budget_deg": _budget(cycles.angle_errors),
        "angle_error_budget_after_fit_deg": _budget(fitted.angle_errors_after),
    }


def _budget(rows: tuple[AngleError, ...]) -> list[dict[str, Any]]:
    return [asdict(row) for row in rows]


def _gap(result: RunResult) -> dict[str, Any]:
    """Return measured minus rigid torque by cause; each column sums to its total."""
    shares = gap_shares(result)
    columns = ("forward", "return_stroke", "return_minimum")
    total = {f"{name}_nm": sum(getattr(row, name) for row in shares) for name in columns}
    rows = [
        {"cause": row.cause, "text": row.meaning, **{f"{name}_nm": getattr(row, name) for name in columns}}
        for row in shares
    ]
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

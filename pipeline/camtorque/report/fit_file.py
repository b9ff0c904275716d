"""fit.json beside a report: values and covariance of a fit, for predictions of runs that were not made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from camtorque.fit.problem import SEPARATOR
from camtorque.laws import ROWS
from camtorque.records import ParameterEstimate
from camtorque.report.bundle import CampaignResult, RunResult
from camtorque.units import RPM

NAME = "fit.json"
SCHEMA = "camtorque.fit/1"


def run_fit_document(result: RunResult) -> dict[str, Any]:
    """Return fit.json of one recording; its report is the folder itself."""
    fitted = result.fitted
    share = fitted.metrics["fitted_held_out_cycles"].rms_percent_of_peak
    about = (str(fitted.details.get("delivery", "")), share, fitted.explained)
    row = _recording(result.recording.config.id, ".", result.cycles.mean_speed / RPM, about)
    return _document(fitted.parameters, fitted.correlation_names, fitted.correlation, [row])


def campaign_fit_document(result: CampaignResult) -> dict[str, Any] | None:
    """Return fit.json of a joint fit, None where there is none."""
    joint = result.joint
    if joint is None:
        return None
    left = {(item.name, item.mode): item.metrics.rms_percent_of_peak for item in joint.held_out}
    entries = {entry.id: entry for entry in result.entries if entry.status == "ok"}
    rows = []
    for name, fitted in zip(joint.names, joint.fitted, strict=True):
        share = fitted.metrics["fitted_held_out_cycles"].rms_percent_of_peak
        about = (fitted.structure, share, fitted.explained)
        row = _recording(name, entries[name].folder, entries[name].summary["speed_rpm"], about)
        modes = {mode: left.get((name, mode)) for mode in ("own_zero_and_end", "blind")}
        rows.append({**row, "left_out_rms_percent": modes})
    parameters = [row for fitted in joint.fitted for row in fitted.parameters]
    return _document(parameters, joint.correlation_names, joint.correlation, rows)


def _recording(name: str, folder: str, speed: object, about: tuple[str, float, bool]) -> dict[str, Any]:
    """Return what is stated of a recording; ``about`` is its structure, rms residual [% of peak], whether explained."""
    structure, share, explained = about
    return {
        "id": name, "folder": folder, "speed_rpm": speed, "structure": structure, "rms_percent_of_peak": share,
        "left_out_rms_percent": None, "explained": explained,
    }  # fmt: skip


def _document(
    parameters: Sequence[ParameterEstimate], all_names: Sequence[str], all_correlations: Any,
    recordings: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:  # fmt: skip
    rows = {row.name: row for row in parameters}
    kept = [k for k, name in enumerate(all_names) if name in rows]
    names = [all_names[k] for k in kept]
    scale = np.array([ROWS[name.split(SEPARATOR)[0]].per_unit for name in names])
    std = np.array([rows[name].stderr_statistical for name in names], dtype=np.float64) * scale
    correlation = np.asarray(all_correlations)[np.ix_(kept, kept)]
    values = [rows[name].value * factor for name, factor in zip(names, scale, strict=True)]
    return {
        "schema": SCHEMA, "names": names, "units": "SI", "values": values, "stderr": std.tolist(),
        "correlation": correlation.tolist(), "recordings": recordings,
    }  # fmt: skip

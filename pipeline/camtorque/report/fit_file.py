"""fit.json beside a report: values and covariance of a fit, for predictions of runs that were not made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.joint_fit import JointRecording
from camtorque.fit.shared_lift import SharedLift
from camtorque.laws import ROWS
from camtorque.records import Array, FittedTorque
from camtorque.report.bundle import CampaignResult, RunResult
from camtorque.report.files import short
from camtorque.units import RPM

NAME = "fit.json"
SCHEMA = "camtorque.fit/1"
DIGITS = 7
"""Of what ties a recording's own parameters to the shared ones: a thousand recordings fill a file."""


def run_fit_document(result: RunResult) -> dict[str, Any]:
    """Return fit.json of one recording; its report is the folder itself."""
    fitted, speed = result.fitted, result.cycles.mean_speed / RPM
    row = _recording(result.recording.config.id, ".", speed, str(fitted.details.get("delivery", "")), fitted)
    rows = {item.name: item for item in fitted.parameters}
    kept = [k for k, name in enumerate(fitted.correlation_names) if name in rows]
    names = [fitted.correlation_names[k] for k in kept]
    scale = np.array([ROWS[name].per_unit for name in names])
    values = np.array([rows[name].value for name in names], dtype=np.float64) * scale
    std = np.array([rows[name].stderr_statistical for name in names], dtype=np.float64) * scale
    return _document(names, values, std, fitted.correlation[np.ix_(kept, kept)], [row])


def campaign_fit_document(result: CampaignResult) -> dict[str, Any] | None:
    """Return fit.json of a joint fit, None where there is none."""
    joint = result.joint
    if joint is None:
        return None
    left = {(item.name, item.mode): item.metrics.rms_percent_of_peak for item in joint.held_out}
    entries = {entry.id: entry for entry in result.entries if entry.status == "ok"}
    rows = []
    for name, fitted in zip(joint.names, joint.fitted, strict=True):
        row = _recording(name, entries[name].folder, entries[name].summary["speed_rpm"], fitted.structure, fitted)
        modes = {mode: left.get((name, mode)) for mode in ("own_zero_and_end", "blind")}
        rows.append({**row, "left_out_rms_percent": modes})
    document = _document(joint.free, joint.values, *_told(joint.free, rows, joint.covariance), rows)
    if joint.residual_covariance is not None:  # under the key by which files of earlier versions are read, too
        owns: list[dict[str, Any]] = [{} for _ in rows]
        std, correlation = _told(joint.free, owns, joint.residual_covariance)
        document["shown"] = {"stderr": std.tolist(), "correlation": correlation.tolist(), "recordings": owns}
    lift = joint.lift
    document["lift_correction"] = {
        "first_knot": float(lift.knots[0]), "knot_step": float(lift.knots[1] - lift.knots[0]),
        "coefficients": short(lift.values.tolist(), DIGITS), "slope_stderr": short(lift.slope_std.tolist(), DIGITS),
    }  # fmt: skip
    return document


def _told(names: Sequence[str], rows: Sequence[dict[str, Any]], arrow: ArrowCovariance) -> tuple[Array, Array]:
    """Return standard errors and the correlations of the shared parameters; each recording's own go into its row."""
    std = arrow.std
    scale = std[arrow.shared]
    for row, place, through, rest in zip(rows, arrow.own, arrow.through, arrow.rest, strict=True):
        own = std[place]
        row["own"] = {
            "names": [names[k] for k in place], "through": short((through * scale / own[:, None]).tolist(), DIGITS),
            "rest": short((rest / np.outer(own, own)).tolist(), DIGITS),
        }  # fmt: skip
    return std, arrow.matrix / np.outer(scale, scale)


def known_lift(document: Mapping[str, Any]) -> SharedLift | None:
    """Return the correction of the lift table that a fit.json states, None where it states none."""
    stated = document.get("lift_correction")
    if stated is None:
        return None
    values = np.array(stated["coefficients"], dtype=np.float64)
    knots = stated["first_knot"] + stated["knot_step"] * np.arange(values.size + 4)
    return SharedLift(knots, values, np.array(stated["slope_stderr"], dtype=np.float64))


def known_shown(document: Mapping[str, Any]) -> ArrowCovariance | None:
    """Return the covariance that the residual alone shows, None where a fit.json states no other."""
    shown = document.get("shown")
    return None if shown is None else known_covariance({**document, **shown})


def known_covariance(document: Mapping[str, Any]) -> ArrowCovariance:
    """Return the covariance that a fit.json states [SI]; of one recording, no parameter is its own."""
    place = {name: k for k, name in enumerate(document["names"])}
    std = np.array(document["stderr"], dtype=np.float64)
    owns = [row["own"] for row in document["recordings"] if row.get("own")]
    taken = {name for own in owns for name in own["names"]}
    shared = np.array([k for name, k in place.items() if name not in taken], dtype=np.int64)
    scale = std[shared]
    matrix = np.array(document["correlation"], dtype=np.float64) * np.outer(scale, scale)
    places = [np.array([place[name] for name in own["names"]], dtype=np.int64) for own in owns]
    through = [
        np.array(own["through"], dtype=np.float64).reshape(at.size, shared.size) * std[at][:, None] / scale
        for at, own in zip(places, owns, strict=True)
    ]
    rest = [
        np.array(own["rest"], dtype=np.float64).reshape(at.size, at.size) * np.outer(std[at], std[at])
        for at, own in zip(places, owns, strict=True)
    ]
    return ArrowCovariance(shared, matrix, tuple(places), tuple(through), tuple(rest))


def _recording(
    name: str, folder: str, speed: object, structure: str, fitted: FittedTorque | JointRecording
) -> dict[str, Any]:
    return {
        "id": name, "folder": folder, "speed_rpm": speed, "structure": structure,
        "rms_percent_of_peak": fitted.metrics["fitted_held_out_cycles"].rms_percent_of_peak,
        "left_out_rms_percent": None, "explained": fitted.explained,
    }  # fmt: skip


def _document(
    names: Sequence[str], values: Array, std: Array, correlation: Array, recordings: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    return {
        "schema": SCHEMA, "names": list(names), "units": "SI", "values": values.tolist(), "stderr": std.tolist(),
        "correlation": correlation.tolist(), "recordings": recordings,
    }  # fmt: skip

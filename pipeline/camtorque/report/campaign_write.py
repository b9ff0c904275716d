"""A campaign into its folder: campaign.json and campaign.html."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from camtorque.fit.drift import Drift
from camtorque.fit.joint_fit import JointRecording
from camtorque.jsonable import jsonable
from camtorque.report.bundle import OF_RECORDING, OF_RESULT, CampaignEntry, CampaignResult
from camtorque.report.campaign_page import campaign_drawings, campaign_page
from camtorque.report.campaign_view import MANY, campaign_view
from camtorque.report.document import parameters_document
from camtorque.report.drawings import write_figures
from camtorque.report.files import findings_document, write_json, write_page, write_rows
from camtorque.report.fit_file import NAME as FIT_NAME
from camtorque.report.fit_file import campaign_fit_document
from camtorque.results import CAMPAIGN, CAMPAIGN_SCHEMA
from camtorque.version import __version__

JOINT_METRICS = ("fitted", "fitted_held_out_cycles")
"""The rigid model is that of the recording alone."""


def write_campaign(result: CampaignResult, folder: Path, reports: Path | None = None) -> dict[str, Any]:
    """Write campaign.html, figures and campaign.json, return the last; ``reports``: where theirs stand."""
    doc = campaign_document(result)
    view = campaign_view(result.entries, reports or folder)
    drawings = campaign_drawings(result, view)
    thumbnails = {entry.name: entry.thumbnail for entry in result.entries if entry.status == "ok"}
    write_figures(drawings, folder / "figures", lambda name: False)
    write_page(folder / "campaign.html", campaign_page(doc, view, thumbnails, drawings))
    fit = campaign_fit_document(result)
    if fit is not None:
        write_json(folder / FIT_NAME, fit, lines=False)
    write_rows(folder / CAMPAIGN, doc)
    return doc


def campaign_document(result: CampaignResult) -> dict[str, Any]:
    """Return the content of campaign.json."""
    joint = result.joint
    fitted = dict(zip(joint.names, joint.fitted, strict=True)) if joint else {}
    return jsonable({
        "schema": CAMPAIGN_SCHEMA, "version": __version__, "created": result.created,
        "n_refused": sum(entry.status != "ok" for entry in result.entries),
        "recordings": [_entry(entry, fitted.get(entry.id)) for entry in result.entries],
        "shared_parameters": parameters_document(joint.shared_parameters) if joint else {},
        "held_out": [asdict(row) for row in joint.held_out] if joint else [],
        "drifts": [_drift(row) for row in joint.drifts] if joint else [],
        "drift_recordings": joint.drifts[0].recordings if joint and joint.drifts else [],
        "excluded": joint.excluded if joint else [],
        "findings": findings_document((*result.findings, *(joint.findings if joint else ()))),
        "timing_s": result.timing,
    })  # fmt: skip


def _entry(entry: CampaignEntry, fitted: JointRecording | None) -> Mapping[str, Any]:
    row: dict[str, Any] = {
        "name": entry.name, "id": entry.id or None, "status": entry.status, "error": entry.error or None,
        "folder": entry.folder or None, "speed_rpm": None, "metrics": None, "metrics_joint": None,
        "explained_joint": None, "verdict": None, **dict.fromkeys((*OF_RECORDING, *OF_RESULT)), **entry.summary,
    }  # fmt: skip
    if fitted is not None and entry.status == "ok":
        row["metrics_joint"] = {name: asdict(fitted.metrics[name]) for name in JOINT_METRICS}
        row["explained_joint"] = fitted.explained
    return row


def _drift(drift: Drift) -> Mapping[str, Any]:
    """Return a drift, its values in the order of ``drift_recordings``; of many recordings their reports have them."""
    content = {key: value for key, value in asdict(drift).items() if key not in ("recordings", "speeds_rpm")}
    return content if len(drift.recordings) <= MANY else {**content, "values": None, "stderrs": None}

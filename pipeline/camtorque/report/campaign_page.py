"""The page of a campaign: all recordings over each other, trends and maps, what is predicted, what is uncertain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from markupsafe import Markup

from camtorque.fit.drift import Drift
from camtorque.fit.joint_fit import JointRecording
from camtorque.fit.leftout import MODES, PREDICTED_BADLY, error_text, is_poor, own_text
from camtorque.fit.problem import SEPARATOR
from camtorque.fit.valleys import TRIGGER_ANGLE
from camtorque.jsonable import jsonable
from camtorque.records import KNOWLEDGE
from camtorque.report.answer import known_text, needs
from camtorque.report.bundle import OF_RECORDING, OF_RESULT, CampaignEntry, CampaignResult
from camtorque.report.campaign_view import (
    MANY,
    CampaignView,
    campaign_view,
    drift_chart,
    explorer_data,
    overlay,
    predictions,
    trend,
)
from camtorque.report.chart import Chart
from camtorque.report.document import evidence_document, parameters_document
from camtorque.report.files import findings_document, write_json, write_page, write_rows
from camtorque.report.fit_figures import ranking, source_chart
from camtorque.report.fit_file import NAME as FIT_NAME
from camtorque.report.fit_file import campaign_fit_document
from camtorque.report.numbers import (
    UNKNOWN,
    named,
    plus_minus,
    rounded_to_error,
    significant,
    with_decimals,
    with_sign,
    words,
)
from camtorque.report.page import Drawing, drawing_of, render, write_figures
from camtorque.report.texts import parameter_row
from camtorque.report.verdict import called, doubtful, known_metrics, unexplained
from camtorque.results import CAMPAIGN, CAMPAIGN_SCHEMA
from camtorque.units import LOGARITHM
from camtorque.version import __version__

JOINT_METRICS = ("fitted", "fitted_held_out_cycles")
"""The rigid model is that of the recording alone."""


def write_campaign(result: CampaignResult, folder: Path, reports: Path | None = None) -> dict[str, Any]:
    """Write campaign.html, figures and campaign.json, return the last; ``reports``: where theirs stand."""
    doc = campaign_document(result)
    view = campaign_view(result.entries, reports or folder)
    drawings = campaign_drawings(result, view)
    write_figures(drawings, folder / "figures")
    write_page(folder / "campaign.html", campaign_page(doc, view, drawings))
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
        "evidence": evidence_document(joint.evidence) if joint else {},
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
        "explained_joint": None, "trigger_offset_joint": None, "verdict": None,
        **dict.fromkeys((*OF_RECORDING, *OF_RESULT)), **entry.summary,
    }  # fmt: skip
    if fitted is not None and entry.status == "ok":
        row["metrics_joint"] = {name: asdict(fitted.metrics[name]) for name in JOINT_METRICS}
        row["explained_joint"] = fitted.explained
        triggers = tuple(own for own in fitted.parameters if own.name.partition(SEPARATOR)[0] == TRIGGER_ANGLE)
        row["trigger_offset_joint"] = next(iter(parameters_document(triggers).values()), None)
    return row


def _drift(drift: Drift) -> Mapping[str, Any]:
    """Return a drift, its values in the order of ``drift_recordings``; of many recordings their reports have them."""
    content = {key: value for key, value in asdict(drift).items() if key not in ("recordings", "speeds_rpm")}
    return content if len(drift.recordings) <= MANY else {**content, "values": None, "stderrs": None}


MOST_NAMED, MOST_QUOTED = 5, 2
"""Recordings and warnings that the answer names."""
URGENT = {code: place for place, code in enumerate((
    "recording_repeated", "sheets_differ", "no_joint_fit", "recordings_contradict", "joint_unexplained",
    PREDICTED_BADLY, "recording_excluded",
))}  # fmt: skip
"""Warnings in the order in which they are to be dealt with; the others come after them."""
MOST_IN_SIGHT = 30
"""Recordings beyond which the table is folded."""

SOURCES_TEXT = (
    "The name of a parameter means what was known of it before: the sheet, certificate or number to improve first."
)


def campaign_drawings(result: CampaignResult, view: CampaignView) -> list[Drawing]:
    """Return the figures of a campaign; what the recordings do not tell has none."""
    found: list[Drawing] = []

    def add(name: str, title: str, text: str, section: str, chart: Chart | None, wide: bool = True) -> None:
        if chart is not None:
            found.append(drawing_of(name, chart, title, text, section, wide, png=False))

    add("overlay", "All recordings", "From slow (dark) to fast (bright). The nearest curve is named; a click opens its "
        "report.", "overlay", overlay(view))  # fmt: skip
    for column in view.quantities if view.conditions else ():
        if not column.label.startswith("parameter"):
            add(f"trend_{len(found)}", column.label, "", "trends", trend(column, view.conditions[0]), wide=False)
    shown = source_chart(view.budget, "share of the variance, mean over the recordings [%]")
    add("sources", "Which source of uncertainty matters for what", SOURCES_TEXT, "sources", shown)
    joint = result.joint
    if joint is not None and joint.held_out:
        speeds = {entry.id: float(str(entry.summary["speed_rpm"])) for entry in result.entries if entry.status == "ok"}
        add("predictions", "How well a recording is predicted", "Left out: predicted with parameters fitted to the "
            "others.", "held_out", predictions(joint, speeds))  # fmt: skip
    for drift in joint.drifts if joint is not None else ():
        section = "drifting" if drift.significant else "shared"
        add(f"drift_{drift.name}", words(drift.name), "", section, drift_chart(joint, drift), wide=False)  # type: ignore[arg-type]
    return found


def verdict_text(doc: Mapping[str, Any]) -> str:
    """Return how many recordings were used, which are not explained, and how well they predict each other."""
    used = len(doc["recordings"]) - doc["n_refused"]
    aside = f", {len(doc['excluded'])} of them left out of the joint fit" if doc.get("excluded") else ""
    text = f"{used} of {len(doc['recordings'])} recordings used{aside}."
    if odd := unexplained(doc):
        text += f" Not explained: {_some(odd)}."
    if look := doubtful(doc):
        text += f" Look closer at {_some(look)}."
    text += left_out_text(doc)
    serious = sum(row["severity"] != "info" for row in doc["findings"])
    return text + (f" {serious} warning{'s' if serious > 1 else ''} below." if serious else "")


def left_out_text(doc: Mapping[str, Any]) -> str:
    """Return how well recordings are predicted from the others, those that are not by their names."""
    known = [row for row in doc["held_out"] if row["mode"] == MODES[0] and row["metrics"]["rms_percent_of_peak"]]
    known.sort(key=lambda row: row["metrics"]["rms_percent_of_peak"])
    good = [row for row in known if not is_poor(row["mode"], row["metrics"]["rms_percent_of_peak"])]
    bad = reversed(known[len(good) :])
    poor = [f"{row['name']}, {error_text(known_metrics(row['metrics']))}" for row in bad]
    text = ""
    if good:
        ends = dict.fromkeys(significant(row["metrics"]["rms_percent_of_peak"], 2) for row in (good[0], good[-1]))
        who = f"{len(good)} of {len(known)} recordings {'are' if len(good) > 1 else 'is'}"
        text = f" Predicted from the others, with their own {own_text(_fitted_apart(doc))}, "
        text += f"{who} matched within {' to '.join(ends)} % of the peak torque (RMS)."
    return text + (f" Predicted worse: {_some(poor, '; ')}." if poor else "")


def _fitted_apart(doc: Mapping[str, Any]) -> set[str]:
    """Return the names of what is fitted to recordings that are left out."""
    return {name for row in doc["held_out"] for name in row.get("fitted_on_held_out", ())}


def _some(names: Sequence[str], between: str = ", ") -> str:
    return between.join(names[:MOST_NAMED]) + (" and others" if len(names) > MOST_NAMED else "")


def campaign_answer(doc: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return what the campaign tells, what is not the same in all recordings, and what to do."""
    rows = [row for row in doc["recordings"] if row["status"] == "ok"]
    known = doc["shared_parameters"] or {}
    parts = []
    if rows:
        gaps = [row["metrics"]["rigid"]["forward_gap_percent"] or 0.0 for row in rows]
        above = min(gaps) > 0.0
        ends = [(with_decimals if above else with_sign)(gap, 0) for gap in (min(gaps), max(gaps))]
        range_text = f"{' to '.join(dict.fromkeys(ends))} %"
        how = f"lies {range_text} above the rigid model" if above else f"differs from the rigid model by {range_text}"
        text = f"On the loaded forward stroke the measured torque {how}."
        parts.append({"head": "The gap", "text": text})
    if said := needs(doc["evidence"]):
        parts.append({"head": "Losses, by all recordings together", "text": " ".join(said)})
    if known:
        parts.append({"head": "How sure", "text": known_text(known.values(), "shared parameters")})
    odd = unexplained(doc)
    advice = []
    if odd:
        advice.append(f"Not explained: {_some(odd)}; open {'their reports' if len(odd) > 1 else 'its report'} first.")
    if look := doubtful(doc):
        whose = "their reports say" if len(look) > 1 else "its report says"
        advice.append(f"Look closer at {_some(look)}: the top of {whose} why.")
    if doc["n_refused"]:
        advice.append(f"{doc['n_refused']} refused: the reasons are below; fix them and run the same command again.")
    urgent = sorted(doc["findings"], key=lambda row: URGENT.get(row.get("code"), len(URGENT)))
    serious = [row["text"] for row in urgent if row["severity"] != "info"]
    advice += [f"{text[:1].upper()}{text[1:]}." for text in map(named, serious[:MOST_QUOTED])]
    if advice:
        parts.append({"head": "What to do", "text": " ".join(advice)})
    return parts


def _drift_text(row: Mapping[str, Any], drift: Mapping[str, Any] | None) -> str:
    """Return how much a parameter drifts per 1000 rpm; as a factor where it acts by its logarithm."""
    if drift is None or drift["slope_per_1000_rpm"] is None:
        return UNKNOWN
    slope, stderr = drift["slope_per_1000_rpm"], drift["slope_stderr"]
    if LOGARITHM.fullmatch(row["unit"]):
        return f"× {significant(math.exp(slope), 2)} ×/÷ {significant(math.exp(stderr), 2)}"
    return f"{'+' if slope > 0.0 else ''}{rounded_to_error(slope, stderr)} ± {plus_minus(stderr)}"


def campaign_page(doc: Mapping[str, Any], view: CampaignView, drawings: Sequence[Drawing]) -> str:
    """Return campaign.html from campaign.json, the used recordings side by side, and figures."""
    serious = any(row["severity"] != "info" for row in doc["findings"])
    drifts = {row["name"]: row for row in doc["drifts"]}
    best_first = sorted(doc["shared_parameters"].items(), key=lambda item: KNOWLEDGE.index(item[1]["knowledge"]))
    return render(
        "campaign.html", drawings, title="Campaign", doc=doc, verdict=verdict_text(doc),
        good=not (doc["n_refused"] or serious or unexplained(doc) or doubtful(doc)), known_metrics=known_metrics,
        answer=campaign_answer(doc), called=called, apart=own_text(_fitted_apart(doc)),
        shared=[parameter_row(name, row, True) | {"drift": _drift_text(row, drifts.get(name))}
                for name, row in best_first],
        links=dict(zip(view.names, view.links, strict=True)),
        thumbnails=dict(zip(view.names, map(Markup, view.thumbnails), strict=True)),
        folded=len(doc["recordings"]) > MOST_IN_SIGHT, many=len(view.names) > MANY,
        ranking=ranking(view.budget), refused=[row for row in doc["recordings"] if row["status"] != "ok"],
        explorer=explorer_data(view) if view.conditions and view.quantities else "",
    )  # fmt: skip

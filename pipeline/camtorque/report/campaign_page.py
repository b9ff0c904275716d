"""The page of a campaign: recordings, predictions of left-out ones, shared parameters over speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from camtorque.report.bundle import CampaignResult
from camtorque.report.campaign_figures import drift_chart, predictions
from camtorque.report.figures import svg_of
from camtorque.report.numbers import words
from camtorque.report.page import Drawing, live_charts, render


def campaign_drawings(result: CampaignResult) -> list[Drawing]:
    """Return the figures of a campaign; few recordings have no drifts and nothing left out."""
    joint = result.joint
    if joint is None:
        return []
    found = []
    if joint.held_out:
        title, text = "How well a recording is predicted", "Left out: predicted with parameters fitted to the others."
        chart = predictions(joint)
        found.append(Drawing("predictions", title, text, "held_out", True, chart, Markup(svg_of(chart, title))))
    for drift in joint.drifts:
        small = drift_chart(joint, drift)
        title = words(drift.name)
        svg = Markup(svg_of(small, f"{title} over speed"))
        found.append(Drawing(f"drift_{drift.name}", title, "", "shared", False, small, svg))
    return found


def campaign_page(doc: Mapping[str, Any], thumbnails: Mapping[str, str], drawings: Sequence[Drawing] = ()) -> str:
    """Return campaign.html.

    Parameters
    ----------
    doc : content of campaign.json
    thumbnails : recording -> small drawing of its torque
    drawings : figures of the joint fit
    """
    used = len(doc["recordings"]) - doc["n_refused"]
    text = f"{used} of {len(doc['recordings'])} recordings used."
    left_out = [r["metrics"]["rms_percent_of_peak"] for r in doc["held_out"] if r["mode"] == "own_zero_and_end"]
    if left_out:
        text += (
            f" Predicted from the others, with its own zero and end of delivery, a recording is met within "
            f"{min(left_out):.2f} to {max(left_out):.2f} % of its peak torque (RMS)."
        )
    return render(
        "campaign.html", live_charts(drawings), title="Campaign", doc=doc, verdict=text, drawings=drawings,
        thumbnails={name: Markup(svg) for name, svg in thumbnails.items()},
        drifts={row["name"]: row for row in doc["drifts"]},
    )  # fmt: skip

"""Pages from the templates beside: one self-contained file each, every text escaped."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from camtorque.records import LadderRung
from camtorque.report.fit_figures import rung_names
from camtorque.report.numbers import FILTERS
from camtorque.report.texts import (
    METRIC_NAMES,
    alignment_text,
    budget_rows,
    cards,
    check_rows,
    gap_rows,
    gap_text,
    inside_text,
    loss_rows,
    verdict,
)

VERSIONS_OF = ("numpy", "scipy", "h5py", "matplotlib", "lmfit", "numba", "pandas")


def versions() -> str:
    """Return the versions of what computes."""
    found = [f"Python {platform.python_version()}"]
    for name in VERSIONS_OF:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def render(template: str, **values: Any) -> str:
    """Return one page; what a template names and is not given is an error, not an empty text."""
    environment = Environment(
        loader=PackageLoader("camtorque", "report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
    )  # fmt: skip
    environment.filters.update(FILTERS)
    css = (Path(__file__).with_name("page.css")).read_text(encoding="utf-8")
    return environment.get_template(template).render(css=Markup(css), versions=versions(), **values)


def run_page(
    doc: Mapping[str, Any], rungs: Sequence[LadderRung], drawings: Sequence[Mapping[str, Any]], config_text: str
) -> str:
    """Return report.html of a run.

    Parameters
    ----------
    doc : content of result.json
    rungs : the ladder
    drawings : name, title, caption, section, wide, svg of each figure
    config_text : recording.toml as read
    """
    ladder = [{**row, "name": name} for row, name in zip(doc["ladder"], rung_names(rungs), strict=True)]
    alignment = doc["alignment"]
    return render(
        "run.html", title=f"{doc['recording']['name']} - measured against model", doc=doc, drawings=as_markup(drawings),
        verdict=verdict(doc), cards=cards(doc), losses=loss_rows(doc["losses"]), ladder=ladder,
        gaps=gap_rows(doc["gap_by_cause"]), gap_text=gap_text(doc["gap_by_cause"]), inside=inside_text(doc),
        alignment=alignment_text(doc), checks=check_rows(doc), config_text=config_text, metric_names=METRIC_NAMES,
        budget=budget_rows(alignment["angle_error_budget_deg"], alignment["angle_error_budget_after_fit_deg"]),
    )  # fmt: skip


def align_page(doc: Mapping[str, Any], drawings: Sequence[Mapping[str, Any]], config_text: str) -> str:
    """Return align.html: the aligned cycles of a recording without a model."""
    return render(
        "align.html", title=f"{doc['name']} - aligned", doc=doc, drawings=as_markup(drawings), config_text=config_text
    )


def campaign_page(
    doc: Mapping[str, Any], thumbnails: Mapping[str, str], drawings: Sequence[Mapping[str, Any]] = ()
) -> str:
    """Return campaign.html."""
    used = len(doc["recordings"]) - doc["n_refused"]
    text = f"{used} of {len(doc['recordings'])} recordings used."
    left_out = [r["metrics"]["rms_percent_of_peak"] for r in doc["held_out"] if r["mode"] == "own_zero_and_end"]
    if left_out:
        text += (
            f" Predicted from the others, with its own zero and end of delivery, a recording is met within "
            f"{min(left_out):.2f} to {max(left_out):.2f} % of its peak torque (RMS)."
        )
    return render(
        "campaign.html", title="Campaign", doc=doc, verdict=text, drawings=as_markup(drawings),
        thumbnails={name: Markup(svg) for name, svg in thumbnails.items()},
        drifts={row["name"]: row for row in doc["drifts"]},
    )  # fmt: skip


def as_markup(drawings: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return drawings whose SVG is put into the page as it is: it was made here, its texts escaped by matplotlib."""
    return [{**item, "svg": Markup(item["svg"])} for item in drawings]

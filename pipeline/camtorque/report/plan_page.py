"""The page of a plan: which recordings come next, what each is expected to bring, and what it costs."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.fit.planning import TOOTH
from camtorque.report.chart import CYCLE, HALF, Curves, Line, Marks, Panel, RowPanel, Rows
from camtorque.report.files import write_json, write_page
from camtorque.report.numbers import in_a_row, plus_minus, rounded_to_error, unit_text, words
from camtorque.report.page import Drawing, drawing_of, render

MOST_CURVES = 6
"""Lines of the chart of runs on offer: more cannot be distinguished."""


def write_plan(document: Mapping[str, Any], title: str, folder: Path) -> None:
    """Write plan.json and plan.html into an existing folder."""
    write_page(folder / "plan.html", plan_page(document, title))
    write_json(folder / "plan.json", document)


def plan_page(document: Mapping[str, Any], title: str) -> str:
    """Return the page of `camtorque.plan.plan_runs` as HTML."""
    return render(
        "plan.html", plan_drawings(document), title=title, doc=document, answer=plan_answer(document),
        unit=unit_text(document["unit"]),
        name=words(document["target"]), rows=run_rows(document), assumed=assumptions(document),
    )  # fmt: skip


def target_text(document: Mapping[str, Any]) -> str:
    """Return the number that is to be known better, and the recording that it is of, where it is of one."""
    return words(document["target"]) + (f" of {document['of']}" if document["of"] else "")


def plan_answer(document: Mapping[str, Any]) -> str:
    """Return what to record next and what it is expected to bring, in sentences."""
    unit, runs = unit_text(document["unit"]), document["runs"]
    now, wanted = (f"± {plus_minus(document[key])} {unit}".strip() for key in ("stderr_now", "stderr_wanted"))
    value = f"{rounded_to_error(document['value'], document['stderr_now'])} {now}"
    known = f"{target_text(document)} is {value} now, wanted {wanted}."
    if not runs:
        end = "Nothing needs to be recorded." if document["reached"] else (
            "No run on offer narrows it: a better sheet, sensor or certificate is needed; the report's How sure names "
            "which."
        )  # fmt: skip
        return f"{known} {end}"
    after = f"± {plus_minus(runs[-1]['stderr_after'])} {unit}".strip()
    first = f"{'Record' if len(runs) == 1 else 'Begin with'} {run_text(runs[0])}."
    count = "1 run is" if len(runs) == 1 else f"{len(runs)} runs are"
    brought = f"{count} expected to bring {after} in {document['minutes']:.0f} minutes."
    short = "" if document["reached"] else (
        " That is short of what is wanted: no further run on offer does more; a better sheet, sensor or certificate is "
        "needed, too."
    )  # fmt: skip
    return f"{known} {first} {brought}{short}"


def run_text(run: Mapping[str, Any]) -> str:
    """Return one run in words."""
    tooth = f", with {TOOTH}" if run["second_tooth"] else ""
    return f"{run['speed_rpm']:.0f} rpm, load of {run['load_of']}, {run['duration_s']:.0f} s{tooth}"


def run_rows(document: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return a row of texts per proposed run."""
    return [
        {
            "number": str(number), "speed": f"{run['speed_rpm']:.0f}", "load": run["load_of"],
            "duration": f"{run['duration_s']:.0f}", "tooth": "yes" if run["second_tooth"] else "no",
            "minutes": f"{run['minutes']:.0f}", "after": plus_minus(run["stderr_after"]),
            "share": f"{100.0 * run['stderr_after'] / document['stderr_now']:.0f}",
        }
        for number, run in enumerate(document["runs"], 1)
    ]  # fmt: skip


def assumptions(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the assumptions of the plan."""
    durations = ", ".join(f"{value:.0f}" for value in document["durations_s"])
    speeds = sorted({run["speed_rpm"] for run in document["on_offer"]})
    fitted = document["fitted_speeds_rpm"]
    beyond = [f"{v:.0f}" for v in speeds if not 0.98 * fitted[0] <= v <= 1.02 * fitted[-1]]
    texts = [
        f"On offer: {', '.join(f'{value:.0f}' for value in speeds)} rpm, the loads of recordings that were fitted "
        f"(their line pressure over cam angle), {durations} s. Other speeds: --speed.",
        f"Cost: {document['setup_minutes']:.0f} minutes for each setting of the bench, "
        f"{document['tooth_minutes']:.0f} for fitting a second tooth once.",
        "Expected: what a joint fit of all recordings would state, if the laws hold: at the present values, or in the "
        "middle of others that the fit leaves open, whichever gains less. The error of the model is the same in all "
        "runs, so more cycles at one point soon bring nothing.",
        f"The torque zero of a run is read as well as in the middle one of the recordings, ± "
        f"{plus_minus(document['zero_stderr_nm'])} N m.",
    ]
    if document["stderr_between_fits"] > 0.0:
        moved = f"± {plus_minus(document['stderr_between_fits'])} {unit_text(document['unit'])}".strip()
        texts.append(
            f"{moved} of what one recording leaves open is how far other structures and laws move the number: a joint "
            "fit with a run at another speed states no such spread, as two speeds tell them apart."
        )
    if beyond:
        speed = "these speeds" if len(beyond) > 1 else "this speed"
        texts.append(
            f"{in_a_row(beyond)} rpm lie{'' if len(beyond) > 1 else 's'} beyond the fitted speeds: whether rig and "
            f"pump bear {speed} is for you to know, and the model is less sure there."
        )
    return tuple(texts)


def plan_drawings(document: Mapping[str, Any]) -> list[Drawing]:
    """Return what is expected after each run, and what each run on offer would bring alone."""
    found, figure = [], partial(drawing_of, section="plan", wide=False)
    if document["runs"]:
        found.append(
            figure("expected", _expected(document), "Expected uncertainty after each run", "Shaded: as wanted.")
        )
    if len({run["speed_rpm"] for run in document["on_offer"]}) > 1:
        caption = f"One run of {document['on_offer'][0]['duration_s']:.0f} s, after what is there now."
        found.append(figure("offer", _offer(document), "What each run on offer would bring alone", caption))
    return found


def _with_unit(text: str, document: Mapping[str, Any]) -> str:
    unit = unit_text(document["unit"])
    return text + (f" [{unit}]" if unit else "")


def _expected(document: Mapping[str, Any]) -> Rows:
    values = [document["stderr_now"], *(run["stderr_after"] for run in document["runs"])]
    labels = ("now", *(f"after run {k}" for k in range(1, len(values))))
    tones = ("c7", *(len(values) - 1) * ("c1",))
    marks = Marks("", tuple(values), tones)
    notes = tuple(f"± {plus_minus(value)}" for value in values)
    name = _with_unit(f"standard uncertainty of {words(document['target'])}", document)
    panel = RowPanel(name, (marks,), shaded=(0.0, document["stderr_wanted"]), notes=notes,
                     limits=(0.0, 1.25 * max(*values, document["stderr_wanted"])))  # fmt: skip
    return Rows(labels, (panel,), HALF)


def _offer(document: Mapping[str, Any]) -> Curves:
    """Return the expected uncertainty over speed, a line per load, dashed with a second tooth."""
    rows = document["on_offer"]
    speeds = sorted({run["speed_rpm"] for run in rows})
    lines = []
    loads = list(dict.fromkeys(run["load_of"] for run in rows))
    for tooth in (False, True):
        for number, load in enumerate(loads):
            after = {r["speed_rpm"]: r["stderr_after"] for r in rows
                     if r["load_of"] == load and r["second_tooth"] is tooth}  # fmt: skip
            if after:
                label = f"load of {load}" + (", second tooth" if tooth else "")
                values = np.array([after.get(speed, np.nan) for speed in speeds])
                lines.append(Line(label, values, CYCLE[number % len(CYCLE)], 1.6, "6 4" if tooth else ""))
    now, wanted = (np.full(len(speeds), document[key]) for key in ("stderr_now", "stderr_wanted"))
    ends = (Line("now", now, "muted", 1.2, "2 3"), Line("wanted", wanted, "good", 1.2, "2 3"))
    limits = (0.0, 1.08 * max(document["stderr_now"], document["stderr_wanted"]))
    panel = Panel(_with_unit("± one standard uncertainty", document), (*lines[:MOST_CURVES], *ends), limits=limits)
    return Curves(np.array(speeds), "speed [rpm]", (panel,), full_turn=False, width=HALF, live=False)

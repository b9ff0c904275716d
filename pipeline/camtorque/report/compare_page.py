"""The page of a comparison, before and after: overlay, difference with its uncertainty, what changed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from camtorque.fit.changes import TOLD
from camtorque.fit.gains import PRESSURE_GAIN, TORQUE_GAIN
from camtorque.fit.pair import has_other_load
from camtorque.fit.verdicts import HINTS
from camtorque.ingest.stated import TRIGGER
from camtorque.jsonable import jsonable
from camtorque.records import Array, ReadOnly
from camtorque.report.chart import CAM_ANGLE, WIDE, Band, Curves, Line, Marks, Panel, RowPanel, Rows, phases, strokes
from camtorque.report.files import write_json, write_page
from camtorque.report.numbers import UNKNOWN, in_a_row, plus_minus, rounded_to_error, significant, unit_text, words
from camtorque.report.page import Drawing, drawing_of, render, write_figures
from camtorque.units import BAR, COVERAGE, DEGREE, LOGARITHM

EVENTS: dict[str, str] = {
    "leakage": "leakage past the plunger (clearance, wear)",
    "trigger": "trigger mounted at another angle",
    "spring": "preload of the spring",
    "spring_rate": "rate of the spring (another spring, a broken coil)",
    "friction": "friction of bearings, pin or guide",
    "packing": "friction of the packing",
    "damping": "viscous drag (oil, shaft, plunger)",
    "temperature": "a warmer or colder fluid",
    "fluid": "bulk modulus of the fluid",
    "air": "free air in the fluid",
    "feed": "feed pressure",
    "port": "lift at which the inlet port closes",
    "dead_volume": "dead volume of the chamber",
    "valve_opening": "opening pressure of the delivery valve",
    "valve": "motion or area of the delivery valve",
    "shaft": "stiffness or damping of the shaft",
    "coupling": "stiffness or damping of the coupling",
    "drive": "inertia or control of the drive",
    "torque_gain": "gain of the torque transducer (amplifier, range, scaling)",
    "pressure_gain": "gain of the pressure sensor (amplifier, range, scaling)",
}
"""Event -> its name for somebody at the rig."""
NOTHING = "nothing changed"
SENSORS = {TORQUE_GAIN: "torque transducer", PRESSURE_GAIN: "pressure sensor"}
"""Gain -> the sensor whose it is."""
UNEXPLAINED_DIFFERENCE = 2.0
"""Inflation of the difference above which events leave more than the recordings allow."""
FACTOR = "×/÷"
"""Before the uncertainty of what is known to a factor."""
TONES = {"changed": "c1", "not changed": "c2", "cannot tell": "c7"}


@dataclass(frozen=True)
class ComparedCurves(ReadOnly):
    """The mean cycles of two recordings on one angle grid.

    Attributes
    ----------
    name : what the pair is called, such as ``1000 rpm``
    theta, lift : (n,) cam angle [rad], lift [m]
    torque_before, torque_after : (n,) measured mean torque [N m]
    torque_stderr : (n,) standard uncertainty of their difference, shared errors left out [N m]
    pressure_before, pressure_after : (n,) measured mean pressure [Pa]
    chamber_before, chamber_after : (n,) rebuilt chamber pressure [Pa], None where the measured one is that
    place : where the sensor of the measured pressure sits, ``line`` or ``chamber``
    """

    name: str
    theta: Array
    lift: Array
    torque_before: Array
    torque_after: Array
    torque_stderr: Array
    pressure_before: Array
    pressure_after: Array
    chamber_before: Array | None
    chamber_after: Array | None
    place: str = "line"


def write_compare(found: Mapping[str, Any], curves: Sequence[ComparedCurves], folder: Path) -> dict[str, Any]:
    """Write compare.json, compare.html and figures/ into an existing folder; return the content of the first.

    Parameters
    ----------
    found : content of compare.json (docs/result_schema.md)
    curves : pairs of mean cycles; several where campaigns are compared
    """
    document = jsonable(found)
    drawings = compare_drawings(document, curves)
    write_figures(drawings, folder / "figures")
    title = f"{document['before']['name']} against {document['after']['name']}"
    named = phases(curves[0].theta, curves[0].lift) if curves else ()
    html = render(
        "compare.html", drawings, named, title=title, doc=document,
        tables=[(key.capitalize(), compare_rows(document[key])) for key in ("losses", "parameters") if document[key]],
        answer=compare_answer(document), events=compare_events(document), left_out=left_out(document),
        cautions=compare_cautions(document), findings=document.get("findings", ()),
    )  # fmt: skip
    write_page(folder / "compare.html", html)
    write_json(folder / "compare.json", document)
    return document


def compare_answer(document: Mapping[str, Any]) -> str:
    """Return the verdict in words: what changed, by how much, how sure."""
    rows = {**document["parameters"], **document["losses"]}
    named = [f"{words(name)} {_difference(rows[name])}" for name in document["changed"] if name in rows]
    sensor = sensor_caution(document)
    told = ", ".join(named) or ("" if sensor else _unnamed(document))
    torque = document["torque"]
    repeat = f"; odd and even cycles of one recording differ by {significant(torque['odd_even_rms_nm'], 2)} N m"
    text = {
        "changed": f"{told}." if told else "",
        "not changed": "no loss and no parameter moved by more than the smallest change that would have been seen.",
        "cannot tell": "no change of the pump is established; load, end of delivery and zero are each recording's own."
        + _nothing_first(document),
    }[document["verdict"]]
    first = " ".join(filter(None, (text, sensor)))
    return (
        f"{first} The mean torque differs by {significant(torque['rms_difference_nm'], 2)} N m RMS, "
        f"{significant(torque['max_difference_nm'], 2)} N m at most"
        f"{repeat if torque['odd_even_rms_nm'] is not None else ''}."
    )


def _nothing_first(document: Mapping[str, Any]) -> str:
    """Return that nothing is what most probably happened, where it is; a small change is not excluded by that."""
    (event, probability), *_ = compare_events(document) or [("", "")]
    return f" Most probably nothing changed ({probability}); how small a change would have been seen stands below." * (
        event == NOTHING
    )


def sensor_caution(document: Mapping[str, Any]) -> str:
    """Return what stands first where a sensor's gain moved, which no pump does; empty elsewhere."""
    ratio = document.get("torque", {}).get("ratio")
    if ratio is not None:
        return (
            f"The torque after is {significant(ratio, 3)} times that before all around the revolution, at about the "
            "same line pressure: no pump changes so, and no part of it is named; check the torque transducer, its "
            "amplifier, range and certificate first."
        )
    moved = [sensor for gain, sensor in SENSORS.items() if gain in document.get("changed", ())]
    if not moved:
        return ""
    return (
        f"A gain is no part of the pump: check the {in_a_row(moved)} first, with amplifier, range, scaling and "
        "certificate."
    )


def _unnamed(document: Mapping[str, Any]) -> str:
    """Return what happened where it is sure that something did, and no number by itself is told."""
    each: dict[str, float] = {}
    for row in document.get("events", ()):
        for event in row["groups"]:
            each[event] = each.get(event, 0.0) + row["probability"]
    sure = [f"{EVENTS[event]} ({percent(whole)})" for event, whole in each.items() if whole > TOLD]
    events = ", ".join(f"{event} ({probability})" for event, probability in compare_events(document))
    if _left(document) > HINTS:
        return f"something that no event on the list describes; the nearest are: {events}"
    if sure:
        return f"{', '.join(sure)}; which number of it, and by how much, the data cannot tell"
    return f"something, but the data cannot tell what: {events}"


def _left(document: Mapping[str, Any]) -> float:
    """Return the largest inflation of a difference."""
    return max((one for one in document.get("inflation", {}).get("difference", ()) if one is not None), default=0.0)


def compare_cautions(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return why the verdicts are to be taken with care: sheets and loads that differ, events that leave much over."""
    sheets = document.get("sheets_differ", ())
    found = [
        f"{text}: each side is read by its own sheet, so a wrong one shows up as a change of the pump; "
        "correct it; where both are right, leave them" for text in sheets if not text.startswith(TRIGGER)
    ]  # fmt: skip
    triggers = "; ".join(text for text in sheets if text.startswith(TRIGGER))
    if triggers:
        found.append(
            f"{triggers}: each side has its own error of the trigger's angle, and a trigger that was moved cannot be "
            "told; correct a wrong one; where both are right, leave them"
        )
    far = max(document.get("pressure_peak_ratio", ()), key=lambda value: abs(np.log(value)), default=1.0)
    if has_other_load(far):
        found.append(
            f"The highest pressure after is {significant(far, 4)} times that before: another load, a pump that makes "
            "another pressure, or another gain of the pressure sensor. What the laws get wrong cancels at one load "
            "only, and changes that it may stand for are not told; record both at the same load."
        )
    left = _left(document)
    much = f"{significant(left, 2)} times what these recordings allow. Something else changed, or a sensor did"
    if left > HINTS and not document.get("changed"):  # of several pairs another one may have told a name
        found.append(
            f"No event on the list explains the difference: they leave {much}; take events as those that come nearest, "
            "and no more."
        )
    elif left > UNEXPLAINED_DIFFERENCE:
        found.append(
            f"The events named here explain the difference only in part: they leave {much}; take events and sizes as "
            "hints."
        )
    return tuple(found)


def left_out(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return which recordings found no partner of their speed."""
    found = []
    for side in ("before", "after"):
        rows = [
            f"{row['recording']} ({significant(row['speed_rpm'], 4)} rpm)" for row in document[side].get("left_out", ())
        ]
        if rows:
            found.append(f"Left out of {side}, no partner of that speed is left: {', '.join(rows)}.")
    return tuple(found)


def compare_events(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what may have happened, in words, with its probability, the most probable first."""
    return [
        (in_a_row([EVENTS[name] for name in row["groups"]]) or NOTHING, percent(row["probability"]))
        for row in document.get("events", ())
    ]


def percent(probability: float) -> str:
    """Return a probability in percent, never rounded to certainty."""
    return "> 99 %" if probability > 0.99 else f"{100.0 * probability:.0f} %"


def _difference(row: Mapping[str, Any]) -> str:
    shown = _shown(row)
    error = f" {shown['sign']} {shown['error']}" if row["stderr"] else ""
    return f"{shown['difference']}{error} {'' if shown['sign'] == FACTOR else shown['unit']}".strip()


def _shown(row: Mapping[str, Any]) -> dict[str, str]:
    """Return the numbers of a row with as many digits as its uncertainty has; of a logarithm those of what it is of."""
    stderr, moved, least = row["stderr"], row["difference"], row.get("smallest_change")
    logarithm = LOGARITHM.fullmatch(row["unit"])

    def text(value: float | None) -> str:
        if logarithm is None or value is None:
            return rounded_to_error(value, stderr)
        return rounded_to_error(math.exp(value), (stderr or 0.0) * math.exp(value))

    times = "" if moved is None else "× " if logarithm else "+" if moved > 0.0 else ""
    return {
        "before": text(row["before"]), "after": text(row["after"]), "difference": times + text(moved),
        "sign": FACTOR if logarithm else "±", "error": text(stderr) if logarithm else plus_minus(stderr),
        "interval": " … ".join(map(text, row["ci95"])) if stderr else UNKNOWN,
        "smallest": f"× {text(least)}" if logarithm and least is not None else significant(least, 2),
        "unit": unit_text(logarithm[1] if logarithm else row["unit"]),
    }  # fmt: skip


def compare_rows(part: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return the rows of one table: those that changed first, then those that cannot be decided."""
    order = {"changed": 0, "cannot tell": 1, "not changed": 2}
    rows = sorted(part.items(), key=lambda item: order[item[1]["verdict"]])
    return [
        {"name": words(name), "verdict": row["verdict"], **_shown(row)}
        | ({"smallest": UNKNOWN} if row["verdict"] == "changed" else {})
        for name, row in rows
    ]


def compare_drawings(document: Mapping[str, Any], curves: Sequence[ComparedCurves]) -> list[Drawing]:
    """Return the figures: one pair of cycles after the other, then the changes in standard errors."""
    found = []
    for number, pair in enumerate(curves):
        title = "Torque, difference and pressure" + (f": {pair.name}" if len(curves) > 1 else "")
        found.append(drawing_of(f"overlay_{number + 1}", _overlay(pair, document), title,
                           "Difference = after − before, with twice its standard uncertainty; errors that both "
                           "share are left out."))  # fmt: skip
    rows = {**document["losses"], **document["parameters"]}
    known = {name: row for name, row in rows.items() if row["difference"] is not None and row["stderr"]}
    if known:
        found.append(drawing_of("changes", _changes(known), "Changes in standard errors",
                           "Bars of ±1.96 standard errors: a change is stated where the whole list of names would "
                           "rarely do so by chance.", "changes"))  # fmt: skip
    return found


def _overlay(pair: ComparedCurves, document: Mapping[str, Any]) -> Curves:
    before, after = (f"{key}: {document[key]['name']}" for key in ("before", "after"))
    torque = (Line(before, pair.torque_before, "measured", 2.0), Line(after, pair.torque_after, "c1", 1.5))
    difference = pair.torque_after - pair.torque_before
    width = 2.0 * pair.torque_stderr
    band = Band("±2 standard uncertainties", difference - width, difference + width, "chamber")
    pressure = [
        Line(f"{kind}, {when}", values / BAR, tone, 1.4, dash)
        for kind, when, values, tone, dash in (
            (pair.place, "before", pair.pressure_before, "measured", ""),
            (pair.place, "after", pair.pressure_after, "c1", ""),
            ("chamber", "before", pair.chamber_before, "fitted", "6 3"),
            ("chamber", "after", pair.chamber_after, "c3", "6 3"),
        )
        if values is not None
    ]  # fmt: skip
    panels = (
        Panel("torque [N m]", torque, height=220.0),
        Panel("difference [N m]", (Line("after − before", difference, "residual", 1.2),), (band,), 120.0),
        Panel("pressure [bar]", tuple(pressure), height=150.0),
        Panel("lift [mm]", (Line("lift", 1e3 * pair.lift, "c2"),), height=60.0),
    )
    return Curves(pair.theta / DEGREE, CAM_ANGLE, panels, spans=strokes(pair.theta, pair.lift))


def _changes(rows: Mapping[str, Mapping[str, Any]]) -> Rows:
    ratio = np.array([row["difference"] / row["stderr"] for row in rows.values()])
    marks = Marks("", tuple(ratio.tolist()), tuple(TONES[row["verdict"]] for row in rows.values()), "point",
                  tuple((ratio - COVERAGE).tolist()), tuple((ratio + COVERAGE).tolist()))  # fmt: skip
    notes = tuple(row["verdict"] for row in rows.values())
    panel = RowPanel("difference over its standard uncertainty", (marks,), shaded=(-COVERAGE, COVERAGE), notes=notes)
    return Rows(tuple(words(name) for name in rows), (panel,), WIDE)

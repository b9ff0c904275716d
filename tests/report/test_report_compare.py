"""The page of a comparison from a document and two mean cycles."""

from __future__ import annotations

import json
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from camtorque.report.compare_page import (
    ComparedCurves,
    compare_answer,
    compare_cautions,
    compare_drawings,
    compare_rows,
    sensor_caution,
    write_compare,
)
from camtorque.report.numbers import no_break
from report_cases import NASTY


def row(difference: float, stderr: float | None, verdict: str, unit: str = "um") -> dict[str, object]:
    ends = None if stderr is None else [difference - 1.96 * stderr, difference + 1.96 * stderr]
    return {"before": 1.0, "after": 1.0 + difference, "difference": difference, "stderr": stderr, "ci95": ends,
            "unit": unit, "verdict": verdict, "smallest_change": None if stderr is None else 3.32 * stderr}  # fmt: skip


def document(verdict: str = "changed") -> dict[str, object]:
    inputs = [{"path": "a/recording.toml", "sha256": "ab" * 32}]
    return {
        "schema": "camtorque.compare/1",
        "before": {"name": f"A {NASTY}", "speed_rpm": 1000.0, "inputs": inputs},
        "after": {"name": "B", "speed_rpm": None, "inputs": []},
        "verdict": verdict, "changed": ["leakage"] if verdict == "changed" else [],
        "parameters": {"trigger_offset": row(0.01, 0.02, "not changed", "deg"),
                       "leakage": row(0.45, 0.05, "changed", "mm^3/s/bar"), "pin_arm": row(0.0, None, "cannot tell")},
        "losses": {"friction": row(0.02, 0.05, "cannot tell", "J per revolution")},
        "torque": {"rms_difference_nm": 0.41, "max_difference_nm": 1.2, "odd_even_rms_nm": 0.03},
    }  # fmt: skip


def pair(with_chamber: bool = True) -> ComparedCurves:
    theta = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    lift = 4e-3 * (1.0 - np.cos(theta))
    torque = 10.0 * np.sin(theta)
    chamber = 1e7 * (1.0 + np.sin(theta)) if with_chamber else None
    return ComparedCurves("1000 rpm", theta, lift, torque, 1.1 * torque, np.full(720, 0.02), 1e7 + 0 * theta,
                          1.1e7 + 0 * theta, chamber, chamber)  # fmt: skip


def test_cautions_stand_on_the_page(tmp_path: Path) -> None:
    finding = {"code": "torque_drifts", "severity": "warning", "text": "it drifts", "where": "torque", "recording": "B"}
    torque = {"rms_difference_nm": 1.5, "max_difference_nm": 6.2, "odd_even_rms_nm": 0.03, "ratio": 1.1}
    doc = {**document(), "torque": torque, "inflation": {"mean": [4.0], "difference": [5.6]}, "findings": [finding]}
    write_compare(doc, [pair()], tmp_path)
    text = unescape((tmp_path / "compare.html").read_text(encoding="utf-8")).replace("\u00a0", " ")
    for part in ("The torque after is 1.1 times that before", "they leave 5.6 times what", "It drifts"):
        assert part in text
    assert text.index("The torque after is 1.1 times") < text.index("</div>"), "it stands in the headline"
    assert compare_cautions(document()) == ()
    assert "differs by 1.5\u00a0N\u00a0m RMS" in no_break(compare_answer(doc))


def test_a_gain_is_said_to_be_no_part_of_the_pump() -> None:
    """A torque 1 % higher all around had become a preload and a fluid, without a warning."""
    gain = {
        **document(),
        "changed": ["torque_gain_error"],
        "parameters": {"torque_gain_error": row(0.97, 0.04, "changed", "%")},
    }
    told = compare_answer(gain)
    assert told.startswith("torque gain error +0.970 ± 0.040 %. A gain is no part of the pump: check the torque trans")
    assert compare_rows(gain["parameters"])[0]["name"] == "torque gain error"  # type: ignore[arg-type]
    assert sensor_caution({**gain, "changed": ["leakage"]}) == ""
    times = {**gain, "changed": [], "torque": {**gain["torque"], "ratio": 1.1}}  # type: ignore[dict-item]
    assert compare_answer(times).startswith("The torque after is 1.1 times that before all around the revolution")


def test_that_most_probably_nothing_changed_stands_in_the_headline() -> None:
    """Of two copies of one recording it said: no change is established."""
    doc = {**document(), "verdict": "cannot tell", "changed": [], "events": [{"groups": [], "probability": 0.98}]}
    assert "Most probably nothing changed (98 %)" in compare_answer(doc)
    other = {**doc, "events": [{"groups": ["spring"], "probability": 0.6}]}
    assert "nothing changed" not in compare_answer(other)


def test_triggers_that_are_declared_differently_are_told_once_and_as_no_change() -> None:
    sheets = ["[trigger] source is pulses in A, a recorded angle in B", "[trigger] edge is falling in A, rising in B"]
    (caution,) = compare_cautions({**document(), "sheets_differ": sheets})
    assert caution.startswith(f"{sheets[0]}; {sheets[1]}: each side has its own error of the trigger's angle")
    _, pump = compare_cautions({**document(), "sheets_differ": ["[pump] a is 1 in A, 2 in B", *sheets]})[::-1]
    assert "shows up as a change of the pump" in pump


def test_what_no_event_stands_for_is_said_to_be_that() -> None:
    """A coupling of .6 of the stiffness came out as a spring of 7 % more preload, 62 times what is allowed left."""
    far = {**document(), "verdict": "changed", "changed": [], "inflation": {"mean": [1.0], "difference": [62.0]}}
    assert compare_answer(far).startswith("something that no event on the list describes; the nearest are: ")
    (caution,) = compare_cautions(far)
    assert caution.startswith("No event on the list explains the difference: they leave 62 times what these recordings")
    assert caution.endswith("take events as those that come nearest, and no more.")
    for other in ({"inflation": {"difference": [13.0]}}, {"changed": ["leakage"]}):
        assert "explain the difference only in part" in compare_cautions({**far, **other})[0]


def test_another_load_is_told_as_one() -> None:
    """An unchanged pump at a load a tenth higher was told as changed, by probabilities of one in 1e15."""
    far = {**document(), "pressure_peak_ratio": [1.003, 0.974, 1.02]}
    [text] = compare_cautions(far)
    assert text.startswith("The highest pressure after is 0.974 times that before: another load, a pump that makes")
    assert compare_cautions({**document(), "pressure_peak_ratio": [1.011, 0.99]}) == ()


def test_page_says_what_changed_and_what_would_have_been_seen(tmp_path: Path) -> None:
    written = write_compare(document(), [pair()], tmp_path)
    assert json.loads((tmp_path / "compare.json").read_text(encoding="utf-8")) == written
    text = (tmp_path / "compare.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert "<b>Changed:</b> leakage +0.450 ± 0.050 mm³/s/bar." in unescape(text).replace("\u00a0", " ")
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {
        "overlay_1.svg", "overlay_1.png", "changes.svg", "changes.png",
    }  # fmt: skip
    assert len(text) < 1_000_000


def test_rows_stand_in_the_order_of_their_verdict() -> None:
    rows = compare_rows(document()["parameters"])  # type: ignore[arg-type]
    assert [item["verdict"] for item in rows] == ["changed", "cannot tell", "not changed"]
    assert rows[1]["interval"] == rows[1]["error"] == rows[1]["smallest"] == "–"
    assert [item["smallest"] for item in rows] == ["–", "–", "0.066"]  # what changed was seen, however small


def test_a_parameter_that_acts_by_its_logarithm_is_compared_by_factors() -> None:
    bandwidth = row(0.4, 0.05, "changed", "ln(rad/s)") | {"before": 4.5, "after": 4.9}
    (shown,) = compare_rows({"drive_bandwidth": bandwidth})
    assert (shown["before"], shown["after"], shown["unit"]) == ("90.0", "134.3", "rad/s")
    assert (shown["difference"], shown["sign"], shown["error"]) == ("× 1.492", "×/÷", "1.051")
    assert shown["interval"] == "1.353 … 1.645"
    quiet = compare_rows({"drive_bandwidth": {**bandwidth, "verdict": "not changed"}})[0]
    assert quiet["smallest"] == "× 1.181"
    unknown = {**bandwidth, "difference": None, "stderr": None, "ci95": None, "smallest_change": None}
    assert compare_rows({"drive_bandwidth": {**unknown, "verdict": "cannot tell"}})[0]["difference"] == "–"
    doc = {**document(), "changed": ["drive_bandwidth"], "parameters": {"drive_bandwidth": bandwidth}}
    assert compare_answer(doc).startswith("drive bandwidth × 1.492 ×/÷ 1.051. ")


@pytest.mark.parametrize("verdict", ["changed", "not changed", "cannot tell"])
def test_every_verdict_has_its_sentence(verdict: str) -> None:
    assert "0.41 N m RMS" in compare_answer(document(verdict))


def test_a_change_without_a_name_is_one_of_those_that_are_possible() -> None:
    events = [{"groups": ["fluid"], "probability": 0.6}, {"groups": ["dead_volume"], "probability": 0.39}]
    told = compare_answer({**document(), "changed": [], "events": events})
    assert told.startswith("something, but the data cannot tell what: bulk modulus of the fluid (60 %), ")


def test_an_event_that_is_sure_is_named_where_none_of_its_numbers_is() -> None:
    """Another coupling: the shaft's stiffness, alone or beside a leak, and neither stiffness nor damping by itself."""
    events = [{"groups": ["shaft"], "probability": 0.8}, {"groups": ["leakage", "shaft"], "probability": 0.2}]
    told = compare_answer({**document(), "changed": [], "events": events})
    assert told.startswith("stiffness or damping of the shaft (> 99 %); which number of it, and by how much, ")


def test_difference_is_after_minus_before() -> None:
    overlay = compare_drawings(document(), [pair(False)])[0]
    torque, difference, pressure, _ = overlay.chart.panels  # type: ignore[union-attr]
    np.testing.assert_allclose(difference.lines[0].values, torque.lines[1].values - torque.lines[0].values)
    assert difference.lines[0].values.max() == pytest.approx(1.0)
    assert [item.label for item in pressure.lines] == ["line, before", "line, after"]


def test_a_sensor_in_the_chamber_is_called_so() -> None:
    inside = replace(pair(False), place="chamber")
    pressure = compare_drawings(document(), [inside])[0].chart.panels[2]  # type: ignore[union-attr]
    assert [item.label for item in pressure.lines] == ["chamber, before", "chamber, after"]


def test_a_comparison_without_curves_has_its_tables(tmp_path: Path) -> None:
    write_compare(document(), [], tmp_path)
    assert "Parameters" in (tmp_path / "compare.html").read_text(encoding="utf-8")

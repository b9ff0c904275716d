"""The answer on top of the page: what it says when the model explains the data, and when it does not."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from camtorque.limits import Limit
from camtorque.records import Finding, Refusal
from camtorque.report.answer import (
    CHECKS,
    alternatives_text,
    answer,
    cards,
    closing_text,
    known_text,
    left_out_text,
    shape_text,
    unexplained_advice,
    work_parts,
)
from camtorque.report.curve_figures import pressures
from camtorque.report.document import result_document
from camtorque.report.page import run_page
from camtorque.report.texts import budget_rows, by_size, parameter_groups, parameter_row
from camtorque.report.verdict import (
    DOUBTFUL,
    FAR_OFF,
    STAND_INS,
    STATED,
    UNUSUAL,
    missed_limits,
    unexplained_text,
    verdict,
)
from camtorque.report.write import write_pdf, write_run
from report_cases import NASTY, parameter, run_result


def words_of(path: Path) -> str:
    """Return what a reader sees of a page."""
    body = path.read_text(encoding="utf-8").split("<body>")[1].split('<p id="announcer"')[0]
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", re.sub(r"<svg.*?</svg>", " ", body, flags=re.S))))


def test_an_explained_run_says_gap_cause_and_how_sure() -> None:
    doc = result_document(run_result())
    assert verdict(doc)["level"] == "good"
    parts = {part["head"]: part["text"] for part in answer(doc)}
    assert "above the rigid model" in parts["The gap"]
    assert "The data need chamber and driveline." in parts["What closes it"]
    assert (
        "They cannot tell whether they need friction; values given there assume that it acts."
        in parts["What closes it"]
    )
    assert "do not need spring; values given there rest on sheet" in parts["What closes it"]
    assert (
        "Stretches of 20 deg, left out of a fit in turn, are predicted with a median error of 0.2 % of the "
        "peak, the worst (80 to 100 deg) with 0.7 %." in parts["How sure"]
    )
    assert "Absolute torque: ±0.42 % of the peak (k = 1;" in parts["How sure"]
    assert "Not ruled out: spill (10 %)" in parts["How sure"]
    assert parts["What to do"].endswith("To learn more: record standstill readings.")


@pytest.mark.parametrize(("code", "words"), UNUSUAL.items())
def test_values_that_no_bench_has_ask_to_look_closer(code: str, words: str) -> None:
    doc = result_document(run_result())
    unusual = {"code": code, "severity": "warning", "text": "", "where": ""}
    head = verdict({**doc, "findings": [*doc["findings"], unusual]})
    assert (head["level"], head["head"]) == ("look", "Look closer")
    assert head["text"].endswith(f"only with {words}: see the warnings before using the values.")


@pytest.mark.parametrize(("off", "level"), [(3.4, "good"), (-3.4, "good"), (3.6, "look"), (-5.0, "look")])
def test_a_single_value_far_off_asks_to_look_closer(off: float, level: str) -> None:
    doc = result_document(run_result())
    name, row = next((name, row) for name, row in doc["parameters"].items() if row["prior"])
    mean, std = row["prior"]
    head = verdict({**doc, "parameters": {**doc["parameters"], name: {**row, "value": mean + off * std}}})
    assert head["level"] == level
    assert (f"only with {FAR_OFF}: see the warnings" in head["text"]) == (level == "look")


@pytest.mark.parametrize(
    ("name", "off", "level"),
    [(name, limit + way, level) for names, limit in ((STAND_INS, 2.5), (STATED, 3.0)) for name in names
     for way, level in ((-0.1, "good"), (0.1, "look"))],
)  # fmt: skip
def test_a_driveline_beyond_catalogues_and_a_sheet_that_is_contradicted_ask_to_look_closer(
    name: str, off: float, level: str
) -> None:
    doc = result_document(run_result())
    row = {**next(iter(doc["parameters"].values())), "value": off * 1000.0, "prior": [0.0, 1000.0]}
    assert verdict({**doc, "parameters": {**doc["parameters"], name: row}})["level"] == level


@pytest.mark.parametrize(("code", "severity", "text"), [
    *((code, "warning", words) for code, words in DOUBTFUL.items()), ("csv_rows_damaged", "error", "csv rows damaged"),
])  # fmt: skip
def test_an_input_with_errors_or_doubts_asks_to_look_closer(code: str, severity: str, text: str) -> None:
    doc = result_document(run_result())

    def found(how: str) -> dict[str, object]:
        row = {"code": code, "severity": how, "text": "", "where": ""}
        return {**doc, "findings": [*doc["findings"], row, row]}

    head = verdict(found(severity))
    assert (head["level"], head["head"]) == ("look", "Look closer")
    assert head["text"].endswith(
        f" Something it rests on is in doubt ({text}): see the findings before using the values."
    )
    assert verdict(found("info"))["level"] == "good"


def test_the_gap_adds_up_in_words() -> None:
    doc = result_document(run_result())
    row = {"meaning": "", "forward_stderr_nm": None, "return_minimum_stderr_nm": None}
    causes = [
        {**row, "cause": name, "forward_nm": nm, "return_minimum_nm": -nm}
        for name, nm in (("pressure", 4.0), ("bearing", 1.0), ("guide", 0.5), ("pin", 0.25), ("residual", 0.125))
    ]
    doc = {**doc, "gap_by_cause": {"causes": causes, "total": {"forward_nm": 5.875, "return_minimum_nm": -5.875}}}
    text = closing_text(doc)
    forward = "pressure +4.00, bearing +1.00, guide +0.50, all else +0.25; +0.12 left"
    assert f"Forward stroke, measured − rigid, +5.88 N m: {forward}" in text
    assert "Return minimum, measured − rigid, −5.88 N m: pressure −4.00" in text


@pytest.mark.parametrize(
    ("probability", "angle", "told"),
    [(0.45, 21.0, True), (0.2, 21.0, False), (0.45, 20.0, False), (0.45, 20.02, False)],
)
def test_a_second_solution_that_fits_as_well_stands_in_the_headline(
    probability: float, angle: float, told: bool
) -> None:
    doc = result_document(run_result())
    first = {**doc["alternatives"][0], "trigger_angle_deg": 20.0}
    second = {**first, "probability": probability, "trigger_angle_deg": angle}
    head = verdict({**doc, "alternatives": [first, second]})
    assert head["level"] == "good"
    assert ("Another solution fits about as well, with the trigger at 21 deg" in head["text"]) == told


def test_what_was_not_computed_is_not_mentioned() -> None:
    result = run_result()
    doc = result_document(replace(result, fitted=replace(result.fitted, details={}, evidence=(), alternatives=())))
    text = " ".join(part["text"] for part in answer(doc))
    for word in ("left out of the fit", "as such is known", "Not ruled out", "The data need", "None", "nan"):
        assert word not in text


def test_an_unexplained_run_says_so_loudly_and_states_no_interval(tmp_path: Path) -> None:
    result = run_result(explained=False)
    doc = write_run(result, tmp_path)
    head = verdict(doc)
    assert (head["level"], head["head"]) == ("unexplained", "UNEXPLAINED")
    assert "It fails (by the fitted cycles) at 40 to 52 deg" in head["text"]
    assert f"(end of delivery {NASTY}): up to −0.4 N m, 9.5 times" in head["text"]
    assert not any("±" in card["value"] for card in cards(doc))
    text = words_of(tmp_path / "report.html")
    assert "UNEXPLAINED" in text
    for part in ("deg ± ", "± 10 bar", "0.7 … 2.3"):
        assert part not in text
    assert all(row["interval"] == "–" for group in parameter_groups(doc) for row in group["rows"])
    assert "bump 1" in (tmp_path / "figures" / "torque_full.svg").read_text(encoding="utf-8")


def test_what_is_wrong_with_the_input_is_said_first_where_the_model_fails() -> None:
    doc = result_document(run_result(explained=False))
    cause = {"code": "closing_lift_unusual", "severity": "warning", "text": "the angle is wrong", "where": ""}
    parts = {part["head"]: part["text"] for part in answer({**doc, "findings": [*doc["findings"], cause]})}
    assert "First: the angle is wrong. " in parts["What to do"]
    for stated in ("left out of the fit", "Absolute torque", "are measured"):
        assert stated not in parts["How sure"]


def test_parameters_stand_by_what_the_data_added(tmp_path: Path) -> None:
    write_run(run_result(), tmp_path)
    groups = parameter_groups(result_document(run_result()))
    assert [(group["name"], [row["name"] for row in group["rows"]]) for group in groups] == [
        ("measured", ["feed pressure"]), ("from the sheet", ["dead volume", "guide friction"]),
    ]  # fmt: skip
    text = words_of(tmp_path / "report.html")
    assert "2 parameters from the sheet" in text
    assert "± 0 " not in text
    assert "not identifiable" not in text
    assert "ladder" not in text.lower()


@pytest.mark.parametrize(("name", "low", "knowledge", "interval"), [
    ("valve_area", 0.14, "upper limit", "at most 1.77"), ("valve_area", 0.14, "narrowed", "at most 1.77"),
    ("valve_area", 0.5, "measured", "0.50 … 1.77"), ("chamber_peak", 0.5, "measured", "0.50 … 1.77"),
])  # fmt: skip
def test_no_interval_is_printed_below_the_lower_bound_of_its_parameter(
    name: str, low: float, knowledge: str, interval: str
) -> None:
    row = {"value": 0.96, "stderr": 0.41, "ci95": [low, 1.77], "unit": "mm^2", "prior": None, "meaning": "area",
           "knowledge": knowledge, "at_bound": False, "confounded_with": [], "source": ""}  # fmt: skip
    assert parameter_row(name, row, explained=True)["interval"] == interval
    assert "reaches the lower bound, mostly zero" in known_text([{"knowledge": "upper limit"}])


def test_a_parameter_fitted_by_its_logarithm_is_shown_as_it_is() -> None:
    name = "drive_lag"
    fitted = parameter(name, np.log(0.002), unit="ln(s)", stderr=np.log(1.5), prior=(np.log(0.0015), np.log(3.7)),
                       ci95=(np.log(0.001), np.log(0.004)), meaning="logarithm of the lag")  # fmt: skip
    result = run_result()
    doc = result_document(replace(result, fitted=replace(result.fitted, parameters=(fitted,))))
    row = parameter_groups(doc)[0]["rows"][0]
    assert (row["value"], row["error"], row["unit"]) == ("0.002", "×/÷ 1.5", "s")
    assert (row["interval"], row["prior"]) == ("0.001 … 0.004", "0.0015 ×/÷ 3.7")
    assert row["meaning"] == "the lag"


@pytest.mark.parametrize(("warm", "told"), [(None, "fuel temperature not stated"), (40.0, "fuel at 40 °C")])
def test_the_head_of_a_page_states_the_conditions(warm: float | None, told: str) -> None:
    doc = result_document(run_result())
    doc["recording"] |= {"fuel_temperature_c": warm, "line_pressure_peak_bar": 867.4}
    assert f"line pressure up to 867 bar, {told}." in run_page(doc, [], "", (), ((), ()))


def test_a_page_names_the_pressure_of_a_chamber_so() -> None:
    result = run_result()
    assert pressures(result).panels[0].lines[0].label == "line pressure, measured"
    config = SimpleNamespace(**{**vars(result.recording.config), "measures_chamber": True})
    inside = replace(result, recording=replace(result.recording, config=config))
    assert pressures(inside).panels[0].lines[0].label == "chamber pressure, measured"
    doc = result_document(run_result())
    doc["findings"].append({"code": "pressure_in_chamber", "severity": "info", "text": "", "where": ""})
    assert "rpm, pressure in the chamber up to" in run_page(doc, [], "", (), ((), ()))


def test_tables_only_where_there_is_something_to_say(tmp_path: Path) -> None:
    result = run_result()
    passed = tuple(replace(row, cycles=0, cycles_single=0) for row in result.cycles.cut_flow)
    calm = replace(result.cycles, cut_flow=passed, clocks=result.cycles.clocks[:1])
    write_run(replace(result, cycles=calm), tmp_path)
    text = words_of(tmp_path / "report.html")
    assert "passed every cut (missed trigger)" in text
    assert "Clocks" not in text


def test_a_source_of_angle_error_is_listed_once() -> None:
    before = [{"source": "trigger installation", "std_deg": 0.8, "text": "tolerance"},
              {"source": "shaft twist", "std_deg": None, "text": "not corrected"}]  # fmt: skip
    after = [{"source": "trigger angle", "std_deg": 0.1, "text": "fitted"},
             {"source": "shaft compliance", "std_deg": 0.05, "text": ""},
             {"source": "shaft twist", "std_deg": None, "text": "not corrected"}]  # fmt: skip
    rows = {row["source"]: (row["before"], row["after"]) for row in budget_rows(before, after)}
    assert rows == {"trigger angle": (0.8, 0.1), "shaft compliance": (None, 0.05)}


@pytest.mark.parametrize("knowledge", ["measured", "narrowed"])
def test_a_group_without_parameters_is_left_out(knowledge: str) -> None:
    result = run_result()
    rows = (parameter("leakage", 0.2, knowledge=knowledge),)
    doc = result_document(replace(result, fitted=replace(result.fitted, parameters=rows)))
    assert [group["name"] for group in parameter_groups(doc)] == [knowledge]


def test_limits_stand_on_the_page(tmp_path: Path) -> None:
    limits = (Limit("chamber.peak_bar.value", None, 1000.0, "bar", 0.0, f"pipe {NASTY}"),
              Limit("losses.input", 1.0, None))  # fmt: skip
    write_run(replace(run_result(), limits=limits), tmp_path)
    text = words_of(tmp_path / "report.html")
    assert "Limits: fail" in text
    assert f"pipe {NASTY}" in text


def test_a_page_becomes_a_pdf(tmp_path: Path) -> None:
    pytest.importorskip("weasyprint")
    write_run(run_result(), tmp_path)
    path = write_pdf(tmp_path / "report.html")
    assert path.read_bytes().startswith(b"%PDF")
    assert not [item for item in tmp_path.iterdir() if item.name.startswith(".")]


def test_without_weasyprint_a_pdf_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    with pytest.raises(Refusal, match=r"--pdf: WeasyPrint cannot be used .* pip install 'camtorque\[pdf\]'"):
        write_pdf(tmp_path / "report.html")


def test_only_the_limits_that_are_missed_are_named() -> None:
    held = {"rms_percent_of_peak": 0.62, "forward_gap_percent": -0.055, "return_min_measured_nm": -17.9,
            "return_min_model_nm": -17.6}  # fmt: skip
    assert missed_limits(held) == ["residual 0.62 %, at most 0.35 % expected"]
    assert missed_limits({**held, "rms_percent_of_peak": None}) == ["residual – %, at most 0.35 % expected"]
    assert missed_limits({**held, "rms_percent_of_peak": 0.1}) == []


def test_held_out_cycles_test_the_noise_only_where_the_residual_is_noise() -> None:
    accuracy = {"shape_residual_percent": 0.05, "repeatability_percent": 0.04}
    assert shape_text(accuracy).endswith("1.2 times the cycle repeatability (0.04 %).")
    accuracy["repeatability_percent"] = 0.045
    assert "test the noise" in shape_text(accuracy)
    assert "test the noise" not in shape_text(accuracy, stands_out=True)
    accuracy["repeatability_percent"] = 0.04
    large = {**accuracy, "shape_residual_percent": 0.4}
    assert shape_text(large).endswith("10 times the cycle repeatability (0.04 %).")


def test_bumps_of_an_explained_run_are_named() -> None:
    result = run_result()
    bumps = run_result(explained=False).fitted.bumps
    doc = result_document(replace(result, fitted=replace(result.fitted, bumps=bumps)))
    assert "In the fitted cycles it stands out at 40 to 52 deg (end of delivery" in answer(doc)[2]["text"]


def test_what_swings_is_told_with_its_frequency_and_what_to_do() -> None:
    doc = result_document(run_result(explained=False))
    doc["bumps"][0]["frequency_hz"] = 812.0
    doc["parameters"]["shaft_resonance"] = {"value": 1400.0}
    assert "swinging at 812 Hz" in unexplained_text(doc)
    assert "Something swings at 812 Hz, and the fitted shaft rings at 1400 Hz" in unexplained_advice(doc)
    doc["parameters"]["shaft_resonance"] = {"value": 820.0}
    assert "where the fitted shaft rings, with another damping" in unexplained_advice(doc)


@pytest.mark.parametrize("phase", sorted(CHECKS))
def test_every_phase_says_what_to_check(phase: str) -> None:
    doc = result_document(run_result(explained=False))
    doc["bumps"][0].update(phase=phase, frequency_hz=None)
    assert unexplained_advice(doc) == CHECKS[phase]


def test_a_second_minimum_that_says_the_same_is_not_news() -> None:
    doc = result_document(run_result())
    first = {"name": "land", "probability": 0.6, "trigger_angle_deg": 20.8, "chamber_peak_bar": 900.0}
    doc["alignment"]["trigger_angle_deg"]["stderr"], doc["chamber"]["peak_bar"]["stderr"] = 0.2, 10.0
    doc["alternatives"] = [first, {**first, "probability": 0.4, "chamber_peak_bar": 904.0}]
    assert alternatives_text(doc) == ""
    doc["alternatives"][1]["chamber_peak_bar"] = 906.0
    assert "a second minimum of the same structure (40 %)" in alternatives_text(doc)


def test_small_angle_errors_stand_in_a_line_and_large_ones_first() -> None:
    rows = [{"source": name, "before": before, "after": after, "text": ""} for name, before, after in
            (("edge", 0.001, 0.001), ("drive", None, 0.1), ("trigger", 0.8, 0.2), ("ripple", None, None),
             ("switch", 0.0, 0.0))]  # fmt: skip
    large, small = by_size(rows)
    assert [row["source"] for row in large] == ["trigger", "drive"]
    assert [row["source"] for row in small] == ["edge"]


def test_a_section_without_content_is_on_neither_page_nor_list(tmp_path: Path) -> None:
    result = run_result()
    write_run(replace(result, fitted=replace(result.fitted, evidence={})), tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'<h2 id="(\w+)">', page) == re.findall(r'<a href="#(\w+)">', page.split("</nav>", 1)[0])
    assert "evidence" not in re.findall(r'<h2 id="(\w+)">', page)


def test_a_stretch_that_alone_tells_what_acts_there_is_not_given_a_size():
    text = left_out_text([0.2] * 17 + [513.0])
    assert text.endswith("0.2 % of the peak, but 340 to 360 deg not at all: only these angles show what acts there.")
    assert "513" not in text


def test_friction_and_damping_are_told_as_one_where_their_sum_alone_is_known() -> None:
    losses = {"unit": "J", "pressure": 7.0, "friction": 3.0, "damping": 5.0, "input": 15.0, "closure_percent": 0.0}
    mixed = {"pressure": 0.1, "friction": 2.0, "damping": 2.1, "friction_and_damping": 0.5}
    assert work_parts(losses, mixed) == {"friction_and_damping": (8.0, 0.5), "pressure": (7.0, 0.1)}
    apart = {**mixed, "friction": 0.7}
    assert work_parts(losses, apart)["friction"] == (3.0, 0.7)
    assert work_parts(losses, {})["damping"] == (5.0, None)


@pytest.mark.parametrize("doubt", ["", "unexplained", "pulled"])
def test_a_suspicion_before_the_fit_is_a_note_where_the_fit_has_nothing_to_warn_of(doubt: str) -> None:
    result = run_result(explained=doubt != "unexplained")
    before = (Finding("uneven_running", "warning", "9 degrees apart"), Finding("clock_drift", "warning", "fast"))
    pulled = (Finding("prior_pulled", "warning", "far"),) if doubt == "pulled" else ()
    cycles, fitted = replace(result.cycles, findings=before), replace(result.fitted, findings=pulled)
    suspicion, other = replace(result, cycles=cycles, fitted=fitted).findings[:2]
    assert other == before[1]
    assert suspicion.severity == ("warning" if doubt else "info")
    assert suspicion.text.startswith("9 degrees apart" if doubt else "9 degrees apart; but the fitted model reproduces")

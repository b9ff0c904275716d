"""The page of a campaign, for a few recordings and for a thousand."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.drift import Drift
from camtorque.fit.joint import CampaignFit
from camtorque.fit.joint_fit import JointRecording
from camtorque.fit.leftout import HeldOut
from camtorque.fit.shared_lift import SharedLift
from camtorque.report.bundle import OF_RESULT, CampaignEntry, CampaignResult
from camtorque.report.campaign_page import (
    campaign_answer,
    campaign_document,
    campaign_drawings,
    campaign_page,
    left_out_text,
    verdict_text,
    write_campaign,
)
from camtorque.report.campaign_view import CampaignView, Column, campaign_view, explorer_data, overlay, trends_of_losses
from camtorque.report.document import result_document
from camtorque.report.files import write_rows
from camtorque.report.fit_figures import ranking, shares, source_chart
from camtorque.report.write import write_run
from report_cases import NASTY, run_result

SPEEDS = (500.0, 250.0, 1000.0)


def entry(name: str, doc: dict[str, Any], folder: str = "") -> CampaignEntry:
    summary = {
        "speed_rpm": doc["recording"]["speed_rpm"],
        "cycles_found": 9,
        "cycles_used": 9,
        "metrics": doc["metrics"],
    }
    return CampaignEntry(name, f"id {name}", "ok", "", summary, folder)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CampaignResult]:
    folder, entries = tmp_path_factory.mktemp("campaign"), []
    for k, speed in enumerate(SPEEDS):
        case = run_result(f"run {k} #1")
        cycles = replace(case.cycles, speed=np.full(case.cycles.speed.size, speed * np.pi / 30.0))
        place = folder / "runs" / f"key {k}#1"
        place.mkdir(parents=True)
        entries.append(entry(f"run {k} #1", write_run(replace(case, cycles=cycles), place), f"runs/{place.name}"))
    entries.append(CampaignEntry(f"broken {NASTY}", "", "refused", f"no trigger {NASTY}", {}))
    result = CampaignResult(tuple(entries), None, (), {"total": 1.0}, "2026-01-01T00:00:00+00:00")
    write_campaign(result, folder)
    return folder, result


def test_what_is_shown_comes_from_the_reports(small: tuple[Path, CampaignResult]) -> None:
    folder, result = small
    view = campaign_view(result.entries, folder)
    assert view.names == tuple(f"run {k} #1" for k in range(3))
    assert view.links[0] == "runs/key%200%231/report.html"
    assert (folder / "runs" / "key 0#1" / "report.html").is_file()
    speed = next(column for column in view.conditions if column.label == "speed")
    np.testing.assert_allclose(speed.values, SPEEDS)
    by_label = {column.label: column for column in view.quantities}
    assert by_label["chamber peak"].values[0] == pytest.approx(1100.0)
    assert by_label["chamber peak"].stderr[0] == pytest.approx(10.0)
    assert by_label["parameter: feed pressure"].unit == "bar"
    assert view.torque.shape == (3, 360)
    np.testing.assert_allclose(view.torque[0], np.mean(run_result().cycles.torque, axis=0)[::2])


@pytest.mark.parametrize("size", [600, 1000, 3600])
def test_a_curve_stands_at_its_angles_whatever_the_grid_of_its_recording(size: int, tmp_path: Path) -> None:
    angle = 2.0 * np.pi * np.arange(size) / size
    with h5py.File(tmp_path / "cycles.h5", "w") as file:
        file["mean/torque"], file["model/fitted"] = 50.0 * np.cos(angle), 50.0 * np.cos(angle) - np.sin(angle)
    view = campaign_view((CampaignEntry("a", "a", "ok", "", {}),), tmp_path.parent)
    assert np.isnan(view.torque).all(), "there is none of that name"
    view = campaign_view((CampaignEntry("a", "a", "ok", "", {}, tmp_path.name),), tmp_path.parent)
    np.testing.assert_allclose(view.torque[0], 50.0 * np.cos(view.theta), atol=2e-3)
    np.testing.assert_allclose(view.residual[0], np.sin(view.theta), atol=1e-4)


def test_a_trend_shows_no_interval_of_a_recording_that_is_not_explained(tmp_path: Path) -> None:
    entries = []
    for name, explained in (("a", True), ("b", False)):
        (tmp_path / name).mkdir()
        doc = write_run(run_result(name, explained=explained), tmp_path / name)
        doc["uncertainty"]["budget"] = {"feed_pressure": {"the recording itself": 1.0}}
        doc["parameters"]["feed_pressure"]["knowledge"] = "measured"
        (tmp_path / name / "result.json").write_text(json.dumps(doc), encoding="utf-8")
        entries.append(entry(name, doc, name))
    view = campaign_view(entries, tmp_path)
    shown = {column.label: column for column in view.quantities}
    for label in ("chamber peak", "trigger angle", "parameter: feed pressure"):
        assert np.isfinite(shown[label].values).all()
        assert np.isfinite(shown[label].stderr).tolist() == [True, False], label
    assert [bool(campaign_view([one, one], tmp_path).budget) for one in entries] == [True, False]


def test_what_a_revolution_gives_back_is_no_trend() -> None:
    documents = [{"losses": {"unit": "J", "input": 15.0, "friction": 4.0, "inertia": 1e-7, "closure_percent": 0.1}}]
    assert [column.label for column in trends_of_losses(documents)] == ["work: friction"]


def test_curves_stand_from_slow_to_fast_and_open_their_report(small: tuple[Path, CampaignResult]) -> None:
    folder, result = small
    chart = overlay(campaign_view(result.entries, folder))
    assert chart is not None
    assert [item.label for item in chart.panels[0].lines] == ["250 rpm", "500 rpm", "1000 rpm"]
    assert all(panel.keys for panel in chart.panels)
    assert chart.links[0] == "runs/key%201%231/report.html"
    assert chart.panels[0].lines[0].tone == "r0"
    assert chart.panels[0].lines[-1].tone == "r7"


def test_curves_of_one_speed_go_by_their_names_and_many_have_no_legend() -> None:
    def shown(speeds: np.ndarray) -> Any:
        conditions = (Column("speed", "rpm", speeds, np.full(speeds.size, np.nan)),)
        names = tuple(f"run {k}" for k in range(speeds.size))
        curves = np.ones((speeds.size, 4))
        return overlay(CampaignView(names, names, names, conditions, (), np.arange(4.0), curves, curves, {}))

    assert [line.label for line in shown(np.array([800.2, 800.4])).panels[0].lines] == [
        "run 0, 800 rpm",
        "run 1, 800 rpm",
    ]
    assert not shown(np.arange(13.0)).panels[0].keys


def test_a_refused_recording_is_listed_with_its_reason(small: tuple[Path, CampaignResult]) -> None:
    folder, _ = small
    text = (folder / "campaign.html").read_text(encoding="utf-8")
    assert f"no trigger {NASTY}" in unescape(text)
    assert "<script>alert" not in text
    doc = json.loads((folder / "campaign.json").read_text(encoding="utf-8"))
    assert [row["status"] for row in doc["recordings"]] == ["ok", "ok", "ok", "refused"]
    assert doc["recordings"][0]["folder"] == "runs/key 0#1"
    assert {key for row in doc["recordings"] for key in row} == set(doc["recordings"][3]), "null, and never left out"
    assert doc["recordings"][3]["explained"] is None


def test_a_part_of_the_page_without_anything_in_it_has_no_heading(small: tuple[Path, CampaignResult]) -> None:
    folder, result = small
    heads = ['id="overlay"', 'href="#overlay"', 'id="explorer"', 'href="#explorer"']
    for entries, there in ((result.entries, 4), (result.entries[:1], 2), (result.entries[-1:], 0)):
        one = replace(result, entries=entries)
        view = campaign_view(entries, folder)
        page = campaign_page(campaign_document(one), view, campaign_drawings(one, view))
        assert [head in page for head in heads] == [place < there for place in range(4)]


def test_a_recording_whose_report_is_gone_has_its_row_but_no_curve(tmp_path: Path) -> None:
    doc = write_run(run_result(), tmp_path)
    result = CampaignResult((entry("gone", doc),), None, (), {}, "2026-01-01T00:00:00+00:00")
    assert overlay(campaign_view(result.entries, tmp_path)) is None
    write_campaign(result, tmp_path)
    assert 'href="gone/report.html"' in (tmp_path / "campaign.html").read_text(encoding="utf-8")


def test_sources_of_a_variance_are_ranked_and_go_by_the_name_of_their_parameter() -> None:
    parts = {"oils: 1.0-1.8 GPa": 3.0, "cycles and model error": 4.0, "others": 1.0}
    table = {"leakage": shares(parts, {"bulk_modulus": "oils: 1.0-1.8 GPa"}), "gain_error": {"bulk modulus": 100.0}}
    assert table["leakage"] == pytest.approx(
        {"bulk modulus": 900.0 / 26.0, "cycles and model error": 1600.0 / 26.0, "other sources": 100.0 / 26.0}
    )
    chart = source_chart(table, "share [%]")
    assert chart is not None
    marks = chart.panels[0].marks
    assert [item.label for item in marks] == ["bulk modulus", "cycles and model error", "other sources"]
    assert marks[-1].values == pytest.approx((100.0, 100.0))
    assert ranking(table)[0] == {
        "outcome": "leakage", "sources": "cycles and model error 62 %; bulk modulus 35 %; other sources 4 %",
    }  # fmt: skip


def test_many_sources_are_told_together() -> None:
    table = {"leakage": {f"source {k}": 100.0 / 40.0 for k in range(40)}}
    chart = source_chart(table, "share [%]")
    assert chart is not None
    assert len(chart.panels[0].marks) == 10
    assert chart.panels[0].marks[-1].values == pytest.approx((100.0,))


def many(count: int) -> CampaignView:
    """Return a campaign of many recordings without files."""
    random = np.random.default_rng(3)
    theta = np.arange(180) * 2.0 * np.pi / 180.0
    peak = random.uniform(20.0, 80.0, count)
    curves = peak[:, None] * np.exp(-(((theta - 1.0) / 0.4) ** 2)) - 0.6 * peak[:, None] * np.exp(
        -(((theta - 2.2) / 0.3) ** 2)
    )
    speed = Column("speed", "rpm", random.uniform(200.0, 2000.0, count), np.full(count, np.nan))
    load = Column("peak line pressure", "bar", random.uniform(200.0, 1200.0, count), np.full(count, np.nan))
    columns = [
        Column(f"parameter: p{k}", "bar", random.normal(1.0, 0.1, count), np.full(count, 0.05)) for k in range(40)
    ]
    columns += [Column(f"number {k}", "N m", random.normal(5.0, 1.0, count), np.full(count, 0.1)) for k in range(15)]
    names = tuple(f"2026-11-{k:04d} pump A, {speed.values[k]:.0f} rpm" for k in range(count))
    residual = random.normal(0.0, 0.05, curves.shape)
    links = tuple(f"runs/{k:016x}/report.html" for k in range(count))
    return CampaignView(names, links, ("",) * count, (speed, load), tuple(columns), theta, curves, residual,
                        {"leakage": {"literature": 70.0, "the recording itself": 30.0}})  # fmt: skip


def joint_of(view: CampaignView) -> CampaignFit:
    """Return a joint fit of many recordings: 45 shared parameters, each recording left out in turn."""
    case, ids = run_result(), tuple(f"id {name}" for name in view.names)
    found = case.fitted.metrics
    held = tuple(
        HeldOut(name, mode, ("torque_zero",), found["fitted"]) for name in ids for mode in ("own_zero_and_end", "blind")
    )
    speeds = tuple(view.conditions[0].values.tolist())
    values, errors = (tuple(row.tolist()) for row in (view.quantities[0].values, view.quantities[0].stderr))
    drifts = tuple(Drift(f"parameter_{k}", "bar", ids, speeds, values, errors, 0.1, 0.2) for k in range(45))
    one = JointRecording((), "land", found, True)
    cov = ArrowCovariance.whole(np.zeros((0, 0)))
    lift = SharedLift(np.arange(8.0), np.zeros(4), np.zeros(4))
    return CampaignFit(ids, (), (one,) * len(ids), (), np.zeros(0), cov, held, drifts, (), (), None, lift, ())


def page_of_many(count: int) -> str:
    view = many(count)
    doc = result_document(run_result())
    rows = tuple(entry(name, doc) for name in view.names)
    result = CampaignResult(rows, joint_of(view), (), {}, "2026-01-01T00:00:00+00:00")
    drawings = campaign_drawings(result, view)
    return campaign_page(campaign_document(result), view, drawings)


def test_a_shared_parameter_that_acts_by_its_logarithm_is_shown_as_it_is() -> None:
    view, lag = many(3), np.log(2e-3)
    row = replace(run_result().fitted.parameters[0], name="drive_lag", unit="ln(s)", value=lag, stderr=np.log(1.5),
                  ci95=(lag - 1.0, lag + 1.0), prior=(lag, np.log(3.7)), meaning="logarithm of the lag")  # fmt: skip
    joint = joint_of(view)
    drift = replace(joint.drifts[0], name="drive_lag", unit="ln(s)", slope_per_1000_rpm=np.log(0.5))
    rows = tuple(entry(name, result_document(run_result())) for name in view.names)
    result = CampaignResult(rows, replace(joint, shared_parameters=(row,), drifts=(drift,)), (), {}, "")
    page = campaign_page(campaign_document(result), view, ())
    cells = re.findall(r"<td[^>]*>(.*?)</td>", page[page.index("drive lag<small>") - 9 :])[:6]
    assert cells == ["drive lag<small>the lag</small>", "0.002", "×/÷ 1.5", "s", "0.002 ×/÷ 3.7", "× 0.5 ×/÷ 1.2"]
    untold = replace(drift, slope_per_1000_rpm=np.nan, slope_stderr=np.nan)  # all at one speed
    result = replace(result, joint=replace(joint, shared_parameters=(row,), drifts=(untold,)))
    page = campaign_page(campaign_document(result), view, ())
    assert '0.002 ×/÷ 3.7</td><td class="n">–</td>' in page


def test_triggers_that_are_declared_differently_stand_on_the_page_each() -> None:
    view = many(3)
    joint = joint_of(view)
    own = replace(run_result().fitted.parameters[0], name="trigger_offset__one", value=1.0449, stderr=0.168, unit="deg")
    rows = tuple(entry(name, result_document(run_result())) for name in view.names)
    for parameters, shown in (((), False), ((own,), True)):
        fitted = tuple(replace(one, parameters=parameters) for one in joint.fitted)
        shared = (run_result().fitted.parameters[0],)
        found = replace(joint, fitted=fitted, shared_parameters=shared, drifts=joint.drifts[:1])
        doc = campaign_document(CampaignResult(rows, found, (), {}, ""))
        assert [row["trigger_offset_joint"] is not None for row in doc["recordings"]] == [shown] * 3
        page = campaign_page(doc, view, ())
        assert ("Trigger of each recording" in page) == shown
        assert page.count('<td class="n">1.045</td><td class="n">0.168</td>') == 3 * shown


def test_a_thousand_recordings_fit_into_three_megabytes() -> None:
    page = page_of_many(1000)
    assert len(page.encode()) <= 3_000_000
    assert page.count('/report.html"') >= 1000
    assert "<summary>1000 recordings</summary>" in page
    assert "The numbers of all 1000 stand in" in page


def test_the_index_of_a_thousand_recordings_fits_into_three_megabytes(tmp_path: Path) -> None:
    """A line for each recording, what all have in common once; the reports hold every digit."""
    view, doc = many(1000), result_document(run_result())
    summary = {key: doc[key] for key in OF_RESULT} | {"speed_rpm": 1234.56789012}
    rows = tuple(replace(entry(name, doc), summary=summary) for name in view.names)
    index = campaign_document(CampaignResult(rows, joint_of(view), (), {}, ""))
    write_rows(tmp_path / "campaign.json", index)
    text = (tmp_path / "campaign.json").read_text(encoding="utf-8")
    assert len(text) <= 3_000_000
    found = json.loads(text)
    assert found["recordings"][7]["metrics_joint"]["fitted"] == pytest.approx(doc["metrics"]["fitted"], rel=1e-6)
    assert found["recordings"][7]["speed_rpm"] == 1234.568
    assert [len(row) for row in (found["recordings"], found["held_out"], found["drifts"])] == [1000, 2000, 45]
    assert found["drifts"][0]["slope_per_1000_rpm"] == 0.1
    assert found["drifts"][0]["values"] is None
    few = many(5)
    told = campaign_document(CampaignResult(rows[:5], joint_of(few), (), {}, ""))
    assert len(told["drifts"][0]["values"]) == len(told["drift_recordings"]) == 5


def test_of_few_recordings_errors_and_the_left_out_table_are_shown() -> None:
    page = page_of_many(5)
    assert "The same as a table" in page
    assert json.loads(explorer_data(many(5)))["quantities"][0]["e"]
    assert json.loads(explorer_data(many(201)))["quantities"][0]["e"] is None
    none = replace(many(5), quantities=(many(5).conditions[0],))
    assert json.loads(explorer_data(none))["quantities"][0]["e"] is None


def test_no_text_of_a_recording_ends_the_data() -> None:
    view = replace(many(3), names=(NASTY, "b", "c"))
    assert "<script" not in explorer_data(view)
    assert json.loads(explorer_data(view))["names"][0] == NASTY


@pytest.mark.parametrize(("fitted", "told"), [
    ((), "zero and end of delivery"), (("port_closing_lift", "port_span"), "zero and start and end of delivery"),
    (("trigger_offset",), "zero, trigger angle and end of delivery"),
])  # fmt: skip
def test_the_page_says_what_left_out_recordings_have_of_their_own(
    small: tuple[Path, CampaignResult], fitted: tuple[str, ...], told: str
) -> None:
    """A start of delivery, or a trigger's angle, that was fitted to each was passed over in the headline."""
    folder, result = small
    found = {"rms_nm": 0.1, "rms_percent_of_peak": 0.2, "forward_gap_percent": 0.0, "forward_peak_error_nm": 0.0,
                 "return_min_measured_nm": 0.0, "return_min_model_nm": 0.0, "return_rms_nm": 0.0}  # fmt: skip
    row = {"name": "A", "mode": "own_zero_and_end", "fitted_on_held_out": ["torque_zero", *fitted], "metrics": found}
    doc = {**campaign_document(result), "held_out": [row]}
    assert left_out_text(doc).startswith(f" Predicted from the others, with their own {told}, ")
    assert f"its own torque {told} are fitted;" in campaign_page(doc, campaign_view(result.entries, folder), ())


def test_the_answer_names_what_is_not_explained_what_was_refused_and_what_drifts() -> None:
    def row(name: str, explained: bool) -> dict[str, Any]:
        gap = {"rigid": {"forward_gap_percent": 8.2 if explained else 26.4}}
        return {"name": name, "status": "ok", "explained": explained, "metrics": gap}

    text = "coupling_resonance drifts"
    doc = {
        "recordings": [row("A", True), row("B", False)], "n_refused": 1,
        "findings": [{"severity": "warning", "text": text}],
        "shared_parameters": {"leakage": {"knowledge": "measured"}, "spring": {"knowledge": "narrowed"}},
        "evidence": {"friction": {"verdict": "needed"}, "damping": {"verdict": "cannot tell"}},
    }  # fmt: skip
    parts = {part["head"]: part["text"] for part in campaign_answer(doc)}
    assert "lies 8 to 26 % above the rigid model" in parts["The gap"]
    assert "Of 2 shared parameters 1 are measured" in parts["How sure"]
    said = "The data need friction. They cannot tell whether they need damping; values given there assume that it acts."
    assert parts["Losses, by all recordings together"] == said
    assert parts["What to do"].startswith("Not explained: B; open its report first. 1 refused")
    assert parts["What to do"].endswith("Coupling resonance drifts.")
    alike = {part["head"]: part["text"] for part in campaign_answer({**doc, "recordings": [row("A", True)]})}
    assert alike["The gap"].count(" to ") == 0
    quiet = {**doc, "recordings": [row("A", True)], "n_refused": 0, "findings": []}
    assert "What to do" not in {part["head"] for part in campaign_answer(quiet)}


@pytest.mark.parametrize(
    ("severities", "told"),
    [(("info",), ""), (("warning", "info"), " 1 warning below."), (("warning", "error"), " 2 warnings below.")],
)
def test_the_headline_counts_the_warnings(severities: tuple[str, ...], told: str) -> None:
    doc = {"recordings": [{}, {}], "n_refused": 1, "held_out": [], "findings": [{"severity": s} for s in severities]}
    assert verdict_text(doc) == f"1 of 2 recordings used.{told}"
    doc["excluded"] = ["A"]
    assert verdict_text(doc) == f"1 of 2 recordings used, 1 of them left out of the joint fit.{told}"


def left_out(name: str, rms: float, excess: float) -> dict[str, Any]:
    """Return a left-out prediction of a recording with a peak of 40 N m, both errors in percent of it."""
    numbers = dict.fromkeys(("forward_gap_percent", "return_min_measured_nm", "return_min_model_nm", "return_rms_nm"))
    peak = {"rms_nm": 0.4 * rms, "rms_percent_of_peak": rms, "forward_peak_error_nm": -0.4 * excess}
    return {"name": name, "mode": "own_zero_and_end", "metrics": {**numbers, **peak}}


def test_the_headline_names_what_is_predicted_badly_with_its_highest_torque() -> None:
    held = [left_out("A", 0.17, 0.5), left_out("B", 5.46, 41.0), left_out("C", 0.28, -1.0)]
    doc = {"recordings": [{}, {}, {}], "n_refused": 0, "held_out": held, "findings": []}
    text = verdict_text(doc)
    assert "2 of 3 recordings are matched within 0.17 to 0.28 % of the peak torque (RMS)." in text
    assert text.endswith("Predicted worse: B, 5.5 % of the peak (RMS), its highest torque 41 % too high.")
    assert "1 of 2 recordings is matched within 0.17 % of the peak" in verdict_text({**doc, "held_out": held[:2]})


def test_an_unexplained_recording_is_in_the_headline_which_is_not_green(small: tuple[Path, CampaignResult]) -> None:
    folder, result = small
    doc = campaign_document(replace(result, entries=result.entries[:3]))
    view = campaign_view(result.entries[:3], folder)
    calm = campaign_page(doc, view, ())
    assert 'class="verdict good"' in calm
    failed = {**doc, "recordings": [{**doc["recordings"][0], "explained": False}, *doc["recordings"][1:]]}
    page = campaign_page(failed, view, ())
    assert "Not explained: run 0 #1 (id run 0 #1)." in verdict_text(failed)
    assert 'class="verdict look"' in page


def test_a_recording_whose_report_asks_to_look_closer_does_so_on_the_page_of_the_campaign(
    small: tuple[Path, CampaignResult],
) -> None:
    folder, result = small
    asked = replace(result.entries[1], summary={**result.entries[1].summary, "verdict": "look"})
    entries = (result.entries[0], asked)
    doc, view = campaign_document(replace(result, entries=entries)), campaign_view(entries, folder)
    page = campaign_page(doc, view, ())
    assert re.findall(r'">([^<]*)</a> <span class="tag warning">look closer', page) == ["run 1 #1 (id run 1 #1)"]
    assert 'class="verdict look"' in page
    assert "Look closer at run 1 #1 (id run 1 #1)." in verdict_text(doc)
    assert "Look closer at run 1 #1 (id run 1 #1): the top of its report says why." in campaign_answer(doc)[-1]["text"]


def test_every_link_of_the_campaign_page_leads_somewhere(small: tuple[Path, CampaignResult]) -> None:
    folder, _ = small
    page = (folder / "campaign.html").read_text(encoding="utf-8")
    links = re.findall(r'href="#([^"]+)"', page)
    assert {"refused", "table"} <= set(links)
    assert ("sources" in links) == ('id="sources"' in page)
    assert all(f'id="{link}"' in page for link in links)

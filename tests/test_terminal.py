"""What a run prints: no interval where the model fails, work that adds up, causes before their many consequences."""

from __future__ import annotations

import re
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from camtorque import run
from camtorque.align import align
from camtorque.commands import check
from camtorque.commands.texts import campaign_table, finding_lines, loud_findings, run_table
from camtorque.ingest import read_recording
from camtorque.ingest.raw import ArraySource
from camtorque.records import CutFlowRow
from camtorque.report.numbers import UNKNOWN
from camtorque.report.texts import loss_rows
from camtorque.report.verdict import bump_place

EXAMPLE = Path(__file__).resolve().parents[1] / "raw_examples" / "A_1000rpm"
LOSSES = {"unit": "J", "pressure": 7.7, "friction": 4.3, "driveline": -0.2, "inertia": 1e-7}


def document(explained: bool = True) -> dict[str, Any]:
    row = {"rms_nm": 0.02, "rms_percent_of_peak": 0.04, "forward_gap_percent": 0.0, "return_min_model_nm": -51.0,
           "return_min_measured_nm": -51.2}  # fmt: skip
    return {
        "recording": {"name": "r", "speed_rpm": 1000.0, "cycles_used": 4, "cycles_found": 4, "cut_flow": []},
        "explained": explained,
        "bumps": [{"start_deg": 0.0, "stop_deg": 359.9, "phase": "delivery"}],
        "metrics": {"rigid": row, "fitted_held_out_cycles": row},
        "alignment": {"trigger_angle_deg": {"value": 20.83, "stderr": 0.21, "nominal": 20.0}},
        "chamber": {"peak_bar": {"value": 1396.0, "stderr": 12.0}},
        "effects": ["chamber"],
        "evidence": {},
        "losses": {**LOSSES, "input": 12.0, "closure_percent": 100.0 * (12.0 - 11.8) / 12.0},
        "losses_stderr": {"unit": "J", "pressure": 0.2, "friction": 0.3, "driveline": 0.1, "inertia": 0.0},
        "findings": [],
        "parameters": {},
    }


def test_the_parts_of_the_work_add_up() -> None:
    line = next(line for line in run_table(document()).splitlines() if line.startswith("work"))
    total, parts = line.split("J/rev = ")
    assert "pressure 7.70 ± 0.20 + friction 4.30 ± 0.30" in parts
    assert sum(map(float, re.findall(r"(?<!± )-?\d+\.\d\d", parts))) == pytest.approx(float(total.split()[1]), abs=0.02)
    assert "unaccounted for 0.20" in parts
    assert "inertia" not in parts
    doc = document()
    doc["losses_stderr"]["input"] = 0.14
    assert "work      12.00 ± 0.14 J/rev = " in run_table(doc)


def test_what_the_data_do_not_tell_stands_beside_what_they_need() -> None:
    """*effects driveline* alone stood above a chamber pressure of 120 bar."""
    assert "effects   chamber\n" in run_table(document())
    told = {"friction": "cannot tell", "damping": "not needed", "driveline": "not needed"}
    doc = {**document(), "evidence": {name: {"verdict": verdict} for name, verdict in told.items()}}
    assert "effects   chamber; cannot tell: friction; not needed: damping, driveline\n" in run_table(doc)
    told = {"friction": "cannot tell", "damping": "cannot tell", "friction_or_damping": "needed"}
    evidence = {name: {"verdict": verdict} for name, verdict in told.items()}
    both = {**document(), "effects": ["friction_or_damping"], "evidence": evidence}
    assert "effects   friction or damping\n" in run_table(both)


def test_work_without_an_input_has_no_shares() -> None:
    doc = document()
    losses = {**doc["losses"], "input": 0.0, "closure_percent": None}
    assert "unaccounted" not in run_table({**doc, "losses": losses})
    assert {row["share"] for row in loss_rows({**doc, "losses": losses})} == {UNKNOWN}


def test_no_interval_where_the_model_fails() -> None:
    assert "20.83 ± 0.21 deg" in run_table(document())
    rows = [{"reason": name, "cycles": n} for name, n in (("incomplete", 2), ("samples_lost", 9), ("outlier", 0))]
    recording = {**document()["recording"], "cut_flow": rows}
    assert "cycles used (left out: 9 samples lost)" in run_table({**document(), "recording": recording})
    failed = run_table(document(explained=False))
    assert "±" not in failed
    assert "the model fails at all around (largest: delivery)" in failed


def test_a_residual_above_the_limit_of_a_good_fit_is_told() -> None:
    doc = document()
    held = {**doc["metrics"]["fitted_held_out_cycles"], "rms_percent_of_peak": 1.03}
    assert "LOOK CLOSER" not in run_table(doc)
    told = run_table({**doc, "metrics": {**doc["metrics"], "fitted_held_out_cycles": held}}).splitlines()[1]
    assert told == "LOOK CLOSER: residual 1 %, at most 0.35 % expected"
    unusual = {"code": "values_implausible", "severity": "warning", "text": "far off", "where": "cutoff"}
    told = run_table({**doc, "findings": [unusual]}).splitlines()[1]
    assert told == "LOOK CLOSER: values that are unusual together"


@pytest.mark.parametrize(
    ("start", "stop", "text"),
    [
        (24.0, 46.0, "24 to 46 deg (delivery)"),
        (0.0, 120.0, "0 to 120 deg (largest: delivery)"),
        (350.0, 10.0, "350 to 10 deg (delivery)"),
        (5.0, 5.0, "all around (largest: delivery)"),
    ],
)
def test_a_wide_stretch_has_more_than_one_phase(start: float, stop: float, text: str) -> None:
    assert bump_place({"start_deg": start, "stop_deg": stop, "phase": "delivery"}) == text


def test_values_far_from_expected_are_counted_beyond_the_first() -> None:
    rows = [{"code": "prior_pulled", "severity": "warning", "text": f"value {k}", "where": ""} for k in range(5)]
    cause = {"code": "other", "severity": "warning", "text": "cause", "where": ""}
    lines = loud_findings([*rows, cause])
    assert sum("value" in line for line in lines) == 4
    assert "warning   2 more values far from what was expected, see the page" in lines
    assert finding_lines([cause])[0] in lines
    assert "warning   1 more value far from what was expected, see the page" in loud_findings(rows[:4])


class Stop(Exception):
    """Ends a run before its fit."""


def test_a_run_tells_what_check_tells_of_the_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spikes had gone into the mean cycle of a run that did not mention them."""
    recording = read_recording(EXAMPLE)
    torque = recording.of("torque")[0]
    volts = torque.read_volts().astype(float)
    volts[::2003] += 3.0
    spiked = replace(torque, source=ArraySource(volts), scale=1.0)
    channels = tuple(spiked if channel is torque else channel for channel in recording.channels)
    seen: list[Any] = []

    def stop(prepared: Any, *_: Any) -> None:
        seen.append(prepared)
        raise Stop

    monkeypatch.setattr(run, "prepare", stop)
    with pytest.raises(Stop):
        run.analyse_recording(replace(recording, channels=channels), run.RunOptions())
    assert "isolated_samples" in {row.code for row in seen[0].findings}


def test_check_lists_the_cuts_that_reject() -> None:
    cycles = align(read_recording(EXAMPLE))
    assert check.cut_flow_lines(cycles, []) == ["49 of 49 cycles used", "enough for: align, run"]
    cut = replace(cycles, cut_flow=(CutFlowRow("misfire", 2, "no pressure", 2, 47),))
    assert check.cut_flow_lines(cut, ["3 used"])[1:] == [
        f"  {'misfire':24}     2 fail     47 left   no pressure", "enough for: align; run refuses it: 3 used",
    ]  # fmt: skip


def test_a_campaign_names_what_is_unexplained_and_shows_the_peak_of_each_prediction() -> None:
    held = {"rms_nm": 2.0, "rms_percent_of_peak": 5.0, "forward_gap_percent": None, "forward_peak_error_nm": -16.0,
            "return_min_measured_nm": -18.0, "return_min_model_nm": -19.0, "return_rms_nm": None}  # fmt: skip
    good, bad = ({**document(explained), "name": name, "id": name, "status": "ok", "speed_rpm": 470.0,
                  "metrics_joint": None} for name, explained in (("A" * 22, True), ("B", False)))  # fmt: skip
    doc = {
        "recordings": [good, bad], "findings": [], "evidence": {"friction": {"verdict": "needed"}},
        "held_out": [{"name": good["id"], "mode": "own_zero_and_end", "metrics": held}],
    }  # fmt: skip
    lines = campaign_table(doc).splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[1].endswith("5.000 %     +40.0 %")
    assert lines[-2] == "losses    The data need friction."
    assert lines[-1].startswith("UNEXPLAINED: B: the model fails there")
    asked = {**doc, "recordings": [{**good, "verdict": "look"}]}
    assert campaign_table(asked).splitlines()[-1] == f"LOOK CLOSER: {good['name']}: the reports say why"
    copied = {**good, "name": "deep/week 2", "id": "week 1", "verdict": "look"}
    table = campaign_table({**doc, "recordings": [copied, {**good, "name": "deep/week 1", "id": "week 1"}]})
    assert table.count("deep/week 2 (week 1)") == 2, "warnings of the joint fit go by ids"
    assert "deep/week 1 " in table
    lost = {"name": "C" * 30, "status": "refused", "error": "no torque"}
    head, *rows = campaign_table({**doc, "recordings": [good, lost]}).splitlines()
    assert rows[1].split() == [lost["name"], "refused:", "no", "torque"], "a long name ran into the next column"
    assert rows[0].index("470.0") + len("470.0") == head.index("rpm") + len("rpm")


@pytest.mark.parametrize(("gap", "told"), [(-0.004, "+0.00 %"), (-0.006, "-0.01 %"), (18.7, "+18.70 %")])
def test_what_rounds_to_nothing_is_not_negative(gap: float, told: str) -> None:
    doc = document()
    doc["metrics"]["fitted_held_out_cycles"] = {**doc["metrics"]["rigid"], "forward_gap_percent": gap}
    line = next(line for line in run_table(doc).splitlines() if line.startswith("fitted (held-out)"))
    assert told in line


def test_a_place_that_the_text_names_is_not_repeated() -> None:
    row = {"severity": "warning", "text": "shaft_drag drifts", "where": "shaft_drag"}
    assert finding_lines([row]) == ["warning   shaft drag drifts"]
    assert finding_lines([{**row, "where": "cam.csv"}]) == ["warning   shaft drag drifts [cam.csv]"]


def test_a_check_lists_warnings_before_notes() -> None:
    text = check.execute(Namespace(recording=EXAMPLE), lambda _: None).text
    severities = re.findall(r"(?m)^(error|warning|info) ", text)
    assert {"warning", "info"} <= set(severities)
    assert severities == sorted(severities, key=("error", "warning", "info").index)

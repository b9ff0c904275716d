"""Verdicts and evidence of a comparison on cases with a known answer; what is refused."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from camtorque import compare as compare_flow
from camtorque.commands.compare import compare_table
from camtorque.compare import (
    _sheets,
    aligned,
    compare,
    compared_curves,
    left_out_rows,
    matched,
    refuse_same,
)
from camtorque.fit.events import CHANGES, two_ln_odds
from camtorque.fit.gains import GAINS, torque_ratio
from camtorque.fit.verdicts import Difference, of_a_gain, parameter_differences, pooled, verdict, whole_verdict
from camtorque.ingest import read_recording
from camtorque.laws import ROWS
from camtorque.laws.swing import Swing
from camtorque.progress import silent
from camtorque.records import Finding, InputFile, Refusal
from camtorque.report.compare_page import EVENTS, compare_events, left_out
from camtorque.results import recording_path
from camtorque.units import RPM, angle_grid
from damaged.logs import Plan, clean_log, write_folder


def test_not_changed_asks_for_a_small_interval() -> None:
    assert verdict(True, (0.0, 0.1), 1.0) == "changed"
    assert verdict(False, (0.05, 0.1), 1.0) == "not changed"
    assert verdict(False, (0.2, 0.1), 1.0) == "cannot tell"
    assert verdict(False, (0.0, 0.3), 1.0) == "cannot tell"


@pytest.mark.parametrize(("unchanged", "verdicts", "whole"), [
    (0.95, ("cannot tell", "not changed"), "cannot tell"), (0.95, ("not changed",), "not changed"),
    (0.95, ("changed", "cannot tell"), "changed"),
    # three events share the probability, and none of the names has enough of it
    (0.001, ("cannot tell", "not changed"), "changed"),
])  # fmt: skip
def test_something_changed_where_that_nothing_did_is_improbable(
    unchanged: float, verdicts: tuple[str, ...], whole: str
) -> None:
    rows = [SimpleNamespace(verdict=name) for name in verdicts]
    assert whole_verdict(rows, SimpleNamespace(unchanged=unchanged)) == whole  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("moved", "std", "kind"), [(-190.0, 3.0, "changed"), (-190.0, 60.0, "cannot tell"), (-90.0, 3.0, "cannot tell")]
)
def test_of_an_event_of_several_parameters_the_one_that_surely_moved_is_told(
    moved: float, std: float, kind: str
) -> None:
    """A shaft that rang 190 +- 3 Hz slower: which number of it moved, the data could not tell, the headline said."""
    name = "shaft_resonance"
    row = ROWS[name]
    per = row.per_unit
    found = SimpleNamespace(
        names=(name,), mean=np.array([moved * per]), covariance=np.array([[(std * per) ** 2]]),
        free_mean=np.array([moved * per]), free_std=np.array([std * per]), best=("shaft",), inflation=(1.0, 2.0),
        state=SimpleNamespace(before=np.array([1150.0 * per])), moved=lambda *names: 0.97,
    )  # fmt: skip
    pair = SimpleNamespace(other_trigger=False, names=(name,), items=[SimpleNamespace(rows=ROWS)])
    (difference,) = parameter_differences(pair, found)  # type: ignore[arg-type]
    assert (difference.name, difference.verdict) == (name, kind)


def test_the_interval_of_a_change_that_is_told_has_its_sign() -> None:
    told = Difference("leakage", 1.0, 1.2, -0.2, 0.15, "", "changed", 0.3, 0.3)
    assert told.ci95[0] < -0.2 < told.ci95[1] < 0.0
    assert replace(told, verdict="cannot tell").ci95 == pytest.approx((-0.494, 0.094), abs=1e-3)
    sharp = replace(told, stderr=1e-3)
    assert sharp.ci95 == pytest.approx((-0.20196, -0.19804), rel=1e-3)


def means(torque: np.ndarray, pressure: np.ndarray) -> list[SimpleNamespace]:
    return [SimpleNamespace(torque_all=torque, pressure_all=pressure)]


def test_a_gain_is_told_from_a_change_of_the_pump() -> None:
    """A transducer ten percent off had become a spring, a fluid and a valve, with more than 99 %."""
    angle = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    torque = np.where(angle < 1.0, 60.0 * np.sin(np.pi * angle), 0.0)
    line = 1e7 + 5e7 * (angle < 0.8)
    before = means(torque, line)
    assert torque_ratio(before, means(1.1 * torque + 0.3, line)) == pytest.approx(1.1)
    assert torque_ratio(before, means(1.005 * torque, line)) is None
    assert torque_ratio(before, means(1.1 * torque, 1.1 * line)) is None
    kept = line + 20.0 * np.max(line)
    assert torque_ratio(means(torque, kept), means(1.1 * torque, kept)) == pytest.approx(1.1)
    assert torque_ratio(means(torque, kept), means(1.1 * torque, kept + 0.1 * line)) is None, "another load"
    assert torque_ratio(before, means(torque + 2.0 * np.abs(torque) ** 0.5, line)) is None


def test_no_part_of_the_pump_is_named_where_the_torque_is_another_one_times_a_factor() -> None:
    """A transducer 5 % off was told as *changed: spring preload error*."""
    names = ("spring_preload_error", "torque_gain_error", "leakage")
    rows = [Difference(name, 1.0, 1.2, 0.2, 0.02, "", "changed", 0.1, 0.1) for name in names]
    assert [row.name for row in of_a_gain(rows) if row.verdict == "changed"] == ["torque_gain_error"]
    assert [replace(row, verdict="changed") for row in of_a_gain(rows)] == rows


def test_terminal_says_first_that_a_gain_is_no_part_of_the_pump() -> None:
    side = {"name": "A", "speeds_rpm": [900.0]}
    doc = {"before": side, "after": side, "verdict": "changed", "changed": ["torque_gain_error"], "parameters": {},
           "losses": {}, "events": [{"groups": ["torque_gain"], "probability": 0.97}]}  # fmt: skip
    first, second, third, *_ = compare_table(doc).splitlines()
    assert first.endswith("changed")
    assert second.startswith("A gain is no part of the pump: check the torque transducer first")
    assert third.split() == ["97", "%", *EVENTS["torque_gain"].split()]


def test_pairs_of_one_pump_add_what_they_know() -> None:
    rows = [Difference("leakage", 1.0, 1.2, 0.2, 0.1, "", "cannot tell", 0.43, 0.3),
            Difference("leakage", 1.0, 1.0, 0.0, 0.1, "", "cannot tell", 0.43, 0.3)]  # fmt: skip
    found = pooled(rows)
    assert (found.difference, found.stderr) == (pytest.approx(0.1), pytest.approx(0.1 / np.sqrt(2.0)))
    assert found.smallest_change == pytest.approx(0.43 / np.sqrt(2.0))
    assert found.verdict == "cannot tell"


def test_rare_events_have_longer_odds() -> None:
    assert two_ln_odds(("leakage", "port")) == pytest.approx(2.0 * np.log(0.1 / 0.9) + 2.0 * np.log(0.02 / 0.98))


def test_folders_of_recordings_are_paired_by_speed(tmp_path: Path) -> None:
    source = next(iter(sorted((Path(__file__).parents[2] / "raw_examples").glob("*/recording.toml")))).parent
    text = (source / "recording.toml").read_text()
    speed = next(line for line in text.splitlines() if line.startswith("nominal_speed_rpm"))
    for side, speeds in (("old", (500, 894, 900)), ("new", (905, 300))):
        for value in speeds:
            folder = tmp_path / side / str(value)
            shutil.copytree(source, folder, ignore=shutil.ignore_patterns("*.csv", "*.mf4", "*.tdms", "*.h5"))
            (folder / "recording.toml").write_text(text.replace(speed, f"nominal_speed_rpm = {value}.0"))
    found = matched(tmp_path / "old", tmp_path / "new")
    assert [(a.name, b.name) for a, b in found.pairs] == [("900", "905")]
    assert [[path.name for path in side] for side in found.alone] == [["500", "894"], ["300"]], "one partner each"
    with pytest.raises(Refusal, match="expected some speed in both"):
        matched(tmp_path / "old" / "500", tmp_path / "new")


@pytest.mark.parametrize(("content", "message"), [
    ("{", "campaign.json: is not valid JSON"),
    ('{"schema": "other/1"}', "schema is 'other/1', expected camtorque.campaign"),
])  # fmt: skip
def test_a_damaged_index_of_a_campaign_is_refused(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "campaign.json").write_text(content, encoding="utf-8")
    with pytest.raises(Refusal, match=message):
        matched(tmp_path, tmp_path)


def test_recordings_without_a_partner_are_named() -> None:
    """Of a campaign's report their folders were named, which are hashes."""
    alone = [SimpleNamespace(id=name, nominal_speed=speed * RPM) for name, speed in (("A_500", 500.0), ("b", 894.0))]
    doc = {"before": {"left_out": left_out_rows(alone)}, "after": {"left_out": []}}
    assert left_out(doc) == ("Left out of before, no partner of that speed is left: A_500 (500 rpm), b (894 rpm).",)


def test_a_recording_held_against_itself_is_refused() -> None:
    def of(name: str, sheet: str, *logs: str) -> SimpleNamespace:
        inputs = [InputFile(Path(f"{name}/{digest}"), digest) for digest in (sheet, *logs)]
        config = SimpleNamespace(id=name, channels=[SimpleNamespace(path=item.path) for item in inputs[1:]])
        return SimpleNamespace(recording=SimpleNamespace(config=config, inputs=inputs))

    refuse_same(of("a", "sheet", "log"), of("b", "sheet", "other log"))  # type: ignore[arg-type]
    refuse_same(of("a", "sheet", "log", "log 2"), of("b", "sheet", "log", "other log"))  # type: ignore[arg-type]
    with pytest.raises(Refusal, match=r"a and copy have the same logs \(by SHA-256\), expected two measurements"):
        refuse_same(of("a", "sheet", "log", "log 2"), of("copy", "other id", "log 2", "log"))  # type: ignore[arg-type]
    with pytest.raises(Refusal, match=r"a \(before\) and a \(after\) have the same logs"):
        refuse_same(of("a", "sheet", "log"), of("a", "sheet", "log"))  # type: ignore[arg-type]


def of_plunger(folder: Path, diameter: str, revolutions: float = 6.0) -> Path:
    edits = (("plunger_diameter_m = 0.008", f"plunger_diameter_m = {diameter}"),)
    return write_folder(folder, [clean_log(revolutions=revolutions)], Plan("csv", edits=edits))


def test_recordings_of_one_name_are_held_against_each_other_too(tmp_path: Path) -> None:
    """Their sheets were kept by the name of the recording, so that those of the second were held against themselves."""
    paths = (of_plunger(tmp_path / "old" / "plain", "0.008"), of_plunger(tmp_path / "new" / "plain", "0.0081", 7.0))
    both = [aligned(path, silent) for path in paths]
    with pytest.raises(
        Refusal, match=r"plunger_diameter_m is 0\.0081 in plain \(after\), 0\.008 in plain \(before\), ex"
    ):
        compare(*paths, tmp_path / "out")
    found = _sheets([SimpleNamespace(before=both[0], after=both[1])])  # type: ignore[list-item]
    assert found == ["[pump] plunger_diameter_m is 0.0081 in plain (after), 0.008 in plain (before)"]


def test_a_pressure_in_the_chamber_and_one_in_the_line_are_not_compared(tmp_path: Path) -> None:
    """The second was fitted in the structure of the first: a chamber was rebuilt from the chamber's own pressure."""
    line = write_folder(tmp_path / "line", [clean_log(revolutions=6.0)], Plan("csv"))
    inside = write_folder(tmp_path / "inside", [clean_log(revolutions=7.0)], Plan("csv"))
    file = inside / "recording.toml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("[sensors.pressure]", '[sensors.pressure]\nlocation = "chamber"'), encoding="utf-8")
    for pair in ((line, inside), (inside, line)):
        with pytest.raises(
            Refusal, match=r"place is the \w+ in \w+, the .* by its location, expected one place: .* correct loc"
        ):
            compare(*pair, tmp_path / "out")


@pytest.mark.parametrize("inside", [False, True])
def test_what_a_sensor_in_the_chamber_measures_is_not_rebuilt_beside_it(inside: bool) -> None:
    theta, flat = angle_grid(12), np.ones(12)
    config = SimpleNamespace(measures_chamber=inside)
    side = SimpleNamespace(
        recording=SimpleNamespace(config=config), cycles=SimpleNamespace(theta=theta, mean_speed=50.0),
        means=SimpleNamespace(torque_all=flat, pressure_all=flat), rigid=SimpleNamespace(lift=flat),
    )  # fmt: skip
    state = SimpleNamespace(outputs=2 * [SimpleNamespace(pressure=2.0 * flat)])
    chain = SimpleNamespace(theta=theta, swing=None)
    two = SimpleNamespace(items=[SimpleNamespace(chain=chain)] * 2, difference_root=np.eye(12))
    found = SimpleNamespace(before=side, after=side, pair=two, found=SimpleNamespace(state=state))
    curves = compared_curves(found)  # type: ignore[arg-type]
    assert curves.place == ("chamber" if inside else "line")
    assert (curves.chamber_before is None, curves.chamber_after is None) == (inside, inside)


def test_curves_of_a_wheel_stand_over_cam_angle() -> None:
    """The chamber stood over time beside a line pressure over cam angle: degrees apart where the speed swings."""
    theta, even, flat = angle_grid(3600), angle_grid(1800), np.ones(3600)
    lead = 0.05 * np.sin(theta)
    wheel, pulse = (SimpleNamespace(theta=even, swing=swing) for swing in (Swing(lead, lead, 1), None))
    side = SimpleNamespace(
        recording=SimpleNamespace(config=SimpleNamespace(measures_chamber=False)),
        cycles=SimpleNamespace(theta=theta, mean_speed=50.0), means=SimpleNamespace(torque_all=flat, pressure_all=flat),
        rigid=SimpleNamespace(lift=flat),
    )  # fmt: skip
    places = [wheel.swing.cam(1800), even]
    state = SimpleNamespace(outputs=[SimpleNamespace(pressure=np.cos(3.0 * place)) for place in places])
    root = np.diag(2.0 + np.cos(wheel.swing.cam(600) + np.pi / 600.0))
    two = SimpleNamespace(items=[SimpleNamespace(chain=one) for one in (wheel, pulse)], difference_root=root)
    found = SimpleNamespace(before=side, after=side, pair=two, found=SimpleNamespace(state=state))
    curves = compared_curves(found)  # type: ignore[arg-type]
    for chamber in (curves.chamber_before, curves.chamber_after):
        assert chamber == pytest.approx(np.cos(3.0 * theta), abs=1e-4)
    assert curves.torque_stderr == pytest.approx(2.0 + np.cos(theta), abs=1e-3)


def test_a_number_that_several_pairs_state_differently_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def stated_differently(before: str, after: str) -> dict[str, str]:
        return {"gain": f"2 in {after}, 1 in {before}"}

    monkeypatch.setattr(compare_flow, "_stated_differently", stated_differently)
    pairs = [SimpleNamespace(before=f"a{k}", after=f"b{k}") for k in (1, 2, 3, 4, 4)]
    found = _sheets(pairs)  # type: ignore[arg-type]
    assert found == ["gain is 2 in b1, 1 in a1; 2 in b2, 1 in a2; 2 in b3, 1 in a3; other pairs: 1"]


def test_recordings_of_two_speeds_are_refused_before_a_fit(tmp_path: Path) -> None:
    examples, told = Path(__file__).resolve().parents[2] / "raw_examples", []
    with pytest.raises(Refusal, match=r"at 500\.0 rpm and A_1000rpm at 1000\.1 rpm, expected one speed within 2 %"):
        compare(examples / "A_0500rpm", examples / "A_1000rpm", tmp_path / "out", told.append)
    assert not [text for text in told if text.startswith("fitting")]


def test_a_warning_on_both_sides_is_told_of_both(monkeypatch: pytest.MonkeyPatch) -> None:
    """A zero that both transducers have off was told of the recording after alone."""

    def side(name: str, *codes: str) -> SimpleNamespace:
        found = tuple(Finding(code, "warning", f"text of {code}", "sheet.toml") for code in codes)
        cycles = SimpleNamespace(pulses={}, findings=found)
        return SimpleNamespace(recording=SimpleNamespace(config=SimpleNamespace(id=name)), cycles=cycles)

    monkeypatch.setattr(compare_flow, "summarise", lambda recording, pulses: SimpleNamespace(findings=()))
    pair = SimpleNamespace(before=side("old", "zero", "short"), after=side("new", "zero", "hum"))
    rows = compare_flow._loud([pair])
    assert {row["code"]: row["recording"] for row in rows} == {"zero": "old, new", "short": "old", "hum": "new"}


def test_every_event_moves_parameters_that_exist() -> None:
    assert {name for names in CHANGES.values() for name in names} <= {*ROWS, *GAINS}


def test_a_folder_that_is_neither_recording_nor_report_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Refusal, match=r"found neither recording\.toml nor result\.json"):
        recording_path(tmp_path)


def test_a_report_whose_recording_is_gone_is_refused(tmp_path: Path) -> None:
    text = '{"schema": "camtorque.result/1", "inputs": [{"path": "/gone/recording.toml", "sha256": ""}]}'
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(Refusal, match="is not there, neither from"):
        recording_path(tmp_path)


def report_of(folder: Path, inputs: dict[str, bytes]) -> None:
    """Write the report of files of some content."""
    folder.mkdir(parents=True)
    rows = [{"path": path, "sha256": sha256(content).hexdigest()} for path, content in inputs.items()]
    (folder / "result.json").write_text(json.dumps({"schema": "camtorque.result/1", "inputs": rows}))


def test_a_report_of_arrays_is_named_as_that(tmp_path: Path) -> None:
    report_of(tmp_path / "rep", {})
    with pytest.raises(Refusal, match=r"made from arrays by Python, .* save the arrays as a file, write its recording"):
        recording_path(tmp_path / "rep")


def test_a_report_finds_its_recording_from_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / "recording.toml").write_text("first")
    report, elsewhere = tmp_path / "reports" / "a", tmp_path / "elsewhere"
    elsewhere.mkdir()
    report_of(report, {"raw/recording.toml": b"first"})
    monkeypatch.chdir(elsewhere)
    assert recording_path(report) == tmp_path / "raw" / "recording.toml"
    (tmp_path / "raw" / "recording.toml").write_text("another pump")
    told = r"other content in .*raw/recording\.toml than it was made of .* with `camtorque {}`, .*, or run this in the"
    with pytest.raises(Refusal, match=told.format("run")):
        recording_path(report)
    (report / "entry.json").touch()  # one of a campaign, into which `run` writes nothing
    with pytest.raises(Refusal, match=told.format("campaign")):
        recording_path(report)


def test_a_report_never_stands_for_another_recording_that_lies_in_the_place_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder, text in (("own", "first"), ("other", "another pump")):
        (tmp_path / folder / "raw").mkdir(parents=True)
        (tmp_path / folder / "raw" / "recording.toml").write_text(text)
    report_of(tmp_path / "own" / "rep", {"raw/recording.toml": b"first"})
    monkeypatch.chdir(tmp_path / "other")
    assert recording_path(tmp_path / "own" / "rep") == tmp_path / "own" / "raw" / "recording.toml"
    (tmp_path / "own" / "raw" / "recording.toml").unlink()
    with pytest.raises(Refusal, match=r"rep/result\.json: found other content in raw/recording\.toml"):
        recording_path(tmp_path / "own" / "rep")


def test_a_report_whose_log_was_cut_since_is_not_compared(tmp_path: Path) -> None:
    log = clean_log(revolutions=6.0)
    folder = write_folder(tmp_path / "r", [log], Plan("csv"))
    report_of(tmp_path / "rep", {str(item.path): item.path.read_bytes() for item in read_recording(folder).inputs})
    assert aligned(tmp_path / "rep", silent).cycles.cycles_found
    file = next(folder.glob("*.csv"))
    rows = file.read_text().splitlines(keepends=True)
    file.write_text("".join(rows[: len(rows) * 5 // 6]))
    with pytest.raises(Refusal, match=rf"found other content in {file} than it was made of"):
        aligned(tmp_path / "rep", silent)
    assert aligned(folder, silent).cycles.cycles_found, "as a recording it may be what it is"


def test_a_report_stands_for_its_recording(tmp_path: Path) -> None:
    recording = tmp_path / "recording.toml"
    recording.touch()
    report_of(tmp_path / "out", {str(recording): b""})
    assert recording_path(tmp_path / "out") == recording


def test_terminal_tells_changes_first_and_names_the_unknown() -> None:
    row = {"before": 1.0, "after": 1.5, "difference": 0.5, "stderr": 0.1, "smallest_change": 0.4, "unit": "um",
           "ci95": (0.3, 0.7)}  # fmt: skip
    doc = {
        "before": {"name": "A", "speeds_rpm": [900.0]}, "after": {"name": "B", "speeds_rpm": [901.0]},
        "verdict": "changed", "events": [{"groups": ["leakage"], "probability": 0.97}],
        "parameters": {"pin_arm": {**row, "verdict": "cannot tell"}, "bearing_arm": {**row, "verdict": "not changed"},
                       "leakage": {**row, "verdict": "changed"}},
        "losses": {},
    }  # fmt: skip
    lines = compare_table(doc).splitlines()
    assert lines[3] == "before and after share a scale that may be off; only the difference is told:"
    assert lines[5:9:2] == ["changed:", "not changed:"]
    assert lines[6].startswith("leakage")
    assert lines[8].startswith("bearing arm")
    assert lines[-1] == "cannot tell: pin arm"


def test_terminal_gives_digits_by_the_uncertainty_and_fits_into_eighty_columns() -> None:
    row = {"before": 2931.4, "after": 2913.2, "difference": -18.1, "stderr": 25.3, "smallest_change": 109.0,
           "unit": "mm^3/s/bar", "verdict": "not changed", "ci95": (-68.0, 32.0)}  # fmt: skip
    doc = {
        "before": {"name": "A", "speeds_rpm": [900.0]}, "after": {"name": "B", "speeds_rpm": [901.0]},
        "verdict": "cannot tell", "events": [], "parameters": {"spring_stiffness_error": row}, "losses": {},
    }  # fmt: skip
    told = compare_table(doc).splitlines()[-1]
    assert told.split() == ["spring", "stiffness", "error", "2931", "2913", "−18", "±", "25", "109", "mm³/s/bar"]
    assert len(told) <= 80
    small = {**row, "before": -0.0000724, "after": -0.0000721, "difference": 0.0, "stderr": 0.000074}
    told = compare_table({**doc, "parameters": {}, "losses": {"spring": small}}).splitlines()[-1]
    assert told.split()[:5] == ["spring", "−0.000072", "−0.000072", "0.000000", "±"], "numbers ran into one another"


def test_every_event_has_words_for_the_rig() -> None:
    assert set(EVENTS) == set(CHANGES)


def test_events_are_told_in_words_and_never_as_certain() -> None:
    rows = [{"groups": ["leakage", "trigger"], "probability": 0.998}, {"groups": [], "probability": 0.4}]
    found = compare_events({"events": rows})
    assert found[0] == ("leakage past the plunger (clearance, wear) and trigger mounted at another angle", "> 99 %")
    assert found[1] == ("nothing changed", "40 %")
    three = compare_events({"events": [{"groups": ["leakage", "spring", "feed"], "probability": 0.5}]})
    assert three[0][0] == ", ".join([EVENTS["leakage"], f"{EVENTS['spring']} and {EVENTS['feed']}"])

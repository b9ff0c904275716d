"""Limits: read with every slip told, judged with and without a guard, exit status 3."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from camtorque import cli
from camtorque.commands.run import run_options
from camtorque.commands.texts import limit_lines
from camtorque.config.tables import Refusals
from camtorque.laws import STATED_NAMES
from camtorque.limits import (
    UNIT_OF_ENDING,
    Limit,
    judge,
    limits_document,
    overall,
    quantities,
    read_limits,
    refuse_unknown,
)
from camtorque.records import Refusal
from camtorque.report.write import write_run
from camtorque.results import find_results
from report.report_cases import run_result

HEAD = 'schema = "camtorque-limits/1"\n'
DOCUMENT = {
    "metrics": {"fitted": {"rms_nm": 0.2}},
    "parameters": {"leakage": {"value": 0.30, "stderr": 0.05, "unit": "mm^3/s/bar"}},
    "chamber": None,
    "forces": {"contact_lost": False},
}


def limits_file(folder: Path, text: str) -> Path:
    path = folder / "limits.toml"
    path.write_text(HEAD + text, encoding="utf-8")
    return path


def judged(**changes: object) -> tuple[str, str]:
    (row,) = judge(DOCUMENT, [Limit(**{"quantity": "parameters.leakage.value", "min": None, "max": None, **changes})])  # type: ignore[arg-type]
    return row.verdict, row.reason


@pytest.mark.parametrize(
    ("changes", "verdict", "reason"),
    [
        ({"max": 0.30}, "pass", ""),
        ({"max": 0.29}, "fail", "0.01 above the band"),
        ({"min": 0.5}, "fail", "0.2 below the band"),
        ({"max": 0.35, "guard": 2.0}, "cannot tell", "within 2 standard uncertainties"),
        ({"max": 0.45, "guard": 2.0}, "pass", ""),
        ({"max": 0.15, "guard": 2.0}, "fail", "above the band"),
        ({"max": 1.0, "unit": "mm³/s/bar"}, "pass", ""),
        ({"max": 1.0, "unit": "mm3/s/bar"}, "pass", ""),
        ({"max": 1.0, "unit": "l/h"}, "cannot tell", "the band is in l/h, the result in mm^3/s/bar"),
        ({"quantity": "chamber.peak_bar.value", "max": 1.0}, "cannot tell", "no number of that name"),
        ({"quantity": "chamber.peak_bar.value", "max": 1.0}, "cannot tell", "one, recording.line_pressure_peak_bar"),
        ({"quantity": "forces.contact_lost", "max": 1.0}, "cannot tell", "no number of that name"),
        ({"quantity": "metrics.fitted.rms_nm", "max": 1.0, "guard": 2.0}, "cannot tell", "states no uncertainty"),
    ],
)
def test_a_value_and_its_band(changes: dict[str, object], verdict: str, reason: str) -> None:
    told, why = judged(**changes)
    assert told == verdict
    assert reason in why


LOPSIDED = {"value": 0.161, "stderr": 0.069, "unit": "-", "ci95": [0.072, 0.358], "knowledge": "measured"}
AT_BOUND = {"value": 0.0, "stderr": 0.2, "unit": "-", "ci95": [0.0, 0.4], "knowledge": "upper limit"}


@pytest.mark.parametrize(
    ("row", "band", "verdict"),
    [
        (LOPSIDED, {"max": 0.31}, "cannot tell"),  # 0.161 + 2 * 0.069 = 0.30, where the interval ends at 0.36
        (LOPSIDED, {"max": 0.37}, "pass"),
        (LOPSIDED, {"min": 0.06}, "pass"),  # 0.161 - 2 * 0.069 = 0.02, where the interval begins at 0.07
        (AT_BOUND, {"min": 0.0, "max": 0.6}, "pass"),  # nothing lies below the bound
        (AT_BOUND, {"max": 0.3}, "cannot tell"),
        ({**AT_BOUND, "knowledge": "from the sheet"}, {"max": 0.6}, "cannot tell"),
        ({**AT_BOUND, "knowledge": "not told by the data"}, {"max": 0.6}, "cannot tell"),
    ],
)
def test_a_parameter_is_judged_by_its_interval_and_where_it_is_told(
    row: dict[str, object], band: dict[str, float], verdict: str
) -> None:
    document = {"explained": True, "parameters": {"shaft_damping": row}}
    limit = Limit("parameters.shaft_damping.value", band.get("min"), band.get("max"), guard=2.0)
    (found,) = judge(document, [limit])
    assert found.verdict == verdict
    told = row["knowledge"] in ("measured", "upper limit")
    assert ("does not tell it" in found.reason) == (not told)


def test_a_fitted_value_of_an_unexplained_recording_cannot_be_judged() -> None:
    limits = [Limit("parameters.leakage.value", None, 0.45), Limit("metrics.fitted.rms_nm", None, 1.0)]
    fitted, measured = judge({**DOCUMENT, "explained": False}, limits)
    assert (fitted.verdict, measured.verdict) == ("cannot tell", "pass")
    assert "unexplained" in fitted.reason
    at_bound = {"parameters": {"leakage": {"value": 0.0, "stderr": None, "unit": ""}}, "losses": {"friction": 1.0}}
    rows = judge({**at_bound, "explained": False}, [limits[0], Limit("losses.friction", None, 5.0)])
    assert [row.verdict for row in rows] == ["cannot tell", "cannot tell"]


def test_the_worst_verdict_counts() -> None:
    limit = Limit("metrics.fitted.rms_nm", None, 1.0)
    good, bad, open_ = (judge(DOCUMENT, [replace(limit, max=m, guard=g)])[0] for m, g in ((1, 0), (0.1, 0), (1, 2)))
    assert overall([good]) == "pass"
    assert overall([good, open_]) == "cannot tell"
    assert overall([good, open_, bad]) == "fail"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", r"expected at least one \[\[limit\]\]"),
        ('[[limit]]\nquantity = "a.b"\n', "found neither min nor max"),
        ('[[limit]]\nquantity = "a.b"\nmin = 2\nmax = 1\n', "min 2 is above max 1"),
        ('[[limit]]\nquantity = "a.b"\nmaximum = 1\n', "unknown key 'maximum', did you mean 'max'"),
        ("[[limit]]\nmax = 1\n", "quantity: this key is missing"),
        ('[[limit]]\nquantity = "a"\nmax = 1\nguard = -1\n', "expected a number from 0 to 10"),
        ('[[limit]]\nquantity = "a"\nmax = "1"\n', "expected a number"),
        ("[limits]\nx = 1\n", "unknown key 'limits'"),
    ],
)
def test_a_limits_file_that_cannot_be_used(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(Refusal, match=told):
        read_limits(limits_file(tmp_path, text))


def test_each_limit_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    empty, turned = '[[limit]]\nquantity = "a.b"\n', '[[limit]]\nquantity = "c.d"\nmin = 2\nmax = 1\n'
    with pytest.raises(Refusals, match=r"a\.b: found neither min nor max") as refused:
        read_limits(limits_file(tmp_path, empty + turned))
    assert len(refused.value.problems) == 2
    assert "c.d: min 2 is above max 1" in refused.value.problems[1]


def test_another_schema(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text('schema = "other/1"\n', encoding="utf-8")
    with pytest.raises(Refusal, match="schema is 'other/1', expected 'camtorque-limits/1'"):
        read_limits(path)


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("reports")
    for name in ("one", "two"):
        (root / name).mkdir()
        write_run(run_result(name), root / name)
    return root


def test_many_reports_against_limits(tmp_path: Path, reports: Path, capsys: pytest.CaptureFixture[str]) -> None:
    feed = '[[limit]]\nquantity = "parameters.feed_pressure.value"\nunit = "bar"\ntext = "pump sheet"\n'
    assert cli.main(["limits", str(limits_file(tmp_path, feed + "max = 2.0\n")), str(reports), "--json"]) == 0
    doc = json.loads(capsys.readouterr().out)
    assert doc["verdict"] == "pass"
    assert [row["rows"][0]["value"] for row in doc["results"]] == [1.7, 1.7]
    assert cli.main(["limits", str(limits_file(tmp_path, feed + "max = 1.0\n")), str(reports / "one")]) == 3
    printed = capsys.readouterr().out
    assert "fail" in printed
    assert "at most 1 bar; 0.7 above the band; pump sheet" in printed


def test_reports_are_judged_in_the_order_of_their_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The folders of a campaign are named by hashes."""
    for folder, name in (("0a", "B"), ("0b", "A")):
        place = tmp_path / "runs" / folder
        place.mkdir(parents=True)
        document = {"schema": "camtorque.result/1", "recording": {"name": name}, "metrics": {"x": 1.0}}
        (place / "result.json").write_text(json.dumps(document), encoding="utf-8")
    file = limits_file(tmp_path, '[[limit]]\nquantity = "metrics.x"\nmax = 2.0\n')
    cli.main(["limits", str(file), str(tmp_path / "runs"), "--json"])
    assert [row["name"] for row in json.loads(capsys.readouterr().out)["results"]] == ["A", "B"]


@pytest.mark.parametrize(("quantity", "unit", "told"), [
    ("metrics.fitted.rms_nm", "N m", "pass"), ("metrics.fitted.rms_nm", "%", "cannot tell"),
    ("chamber.peak_bar.value", "bar", "pass"), ("chamber.peak_bar.value", "MPa", "cannot tell"),
    ("recording.cycles_used", "1", "cannot tell"), ("metrics.fitted.rms_percent_of_peak", "%", "pass"),
    ("recording.angle.value", "°", "pass"), ("measured.delivered_volume.measured_mm3", "mm³", "pass"),
])  # fmt: skip
def test_a_band_in_another_unit_decides_nothing(quantity: str, unit: str, told: str) -> None:
    document = {"metrics": {"fitted": {"rms_nm": 0.5, "rms_percent_of_peak": 0.1}},
                "chamber": {"peak_bar": {"value": 1.0, "stderr": 0.1}},
                "measured": {"delivered_volume": {"measured_mm3": 5.0}},
                "recording": {"cycles_used": 7, "angle": {"value": 0.5, "unit": "deg"}}}  # fmt: skip
    (verdict,) = judge(document, [Limit(quantity, None, 10.0, unit)])
    assert verdict.verdict == told


def test_every_number_of_a_result_with_a_unit_in_its_name_has_it_in_the_table(reports: Path) -> None:
    document = json.loads((reports / "one" / "result.json").read_text(encoding="utf-8"))
    bare = {"value", "stderr", "nominal", "stderr_statistical", "size", "two_ln_bayes_factor"}
    names = {part for path in quantities(document) for part in path.split(".") if part not in bare}
    endings = {f"_{name.rpartition('_')[2]}" for name in names if "_" in name and len(name.rpartition("_")[2]) <= 3}
    assert endings - set(UNIT_OF_ENDING) <= {"_air", "_arm", "_end", "_lag", "_up"}, "a word, or a unit that is missing"


def test_a_quantity_that_no_report_has(tmp_path: Path, reports: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = limits_file(tmp_path, '[[limit]]\nquantity = "parameters.feed_presure.value"\nmax = 1\n')
    assert cli.main(["limits", str(path), str(reports)]) == 2
    assert "found in no result, did you mean 'parameters.feed_pressure.value'?" in capsys.readouterr().err


@pytest.mark.parametrize("quantity", ["chamber.peak_bar.value", "parameters.feed_pressure.value"])
def test_what_no_fit_needed_cannot_be_told_and_is_no_slip(quantity: str) -> None:
    limits = [Limit(quantity, None, 1.0)]
    refuse_unknown([DOCUMENT], limits, ["feed_pressure"])
    assert judge(DOCUMENT, limits)[0].verdict == "cannot tell"
    for slip in ("metrics.peak_bar", "parameters.feed_pressure.ci95"):
        with pytest.raises(Refusal, match="found in no result"):
            refuse_unknown([DOCUMENT], [Limit(slip, None, 1.0)], ["feed_pressure"])


def test_no_report_and_foreign_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = limits_file(tmp_path, '[[limit]]\nquantity = "a.b"\nmax = 1\n')
    (tmp_path / "r").mkdir()
    for content, told in ((None, "found no result.json"), ("{", "is not valid JSON"), ("{}", "schema is None")):
        if content is not None:
            (tmp_path / "r" / "result.json").write_text(content, encoding="utf-8")
        assert cli.main(["limits", str(path), str(tmp_path / "r")]) == 2
        assert told in capsys.readouterr().err


def test_unfinished_reports_are_left_out(tmp_path: Path) -> None:
    for name in (".a.partial-7", "b/deep"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "result.json").touch()
    assert find_results(tmp_path) == [tmp_path / "b" / "deep" / "result.json"]


def test_results_of_a_campaign_are_those_that_it_names(tmp_path: Path) -> None:
    """What older options or inputs gave stays in `runs` until --prune: a trend showed those recordings twice."""
    for name in ("runs/older", "runs/newer", "runs/refused", "alone"):
        (tmp_path / "campaign" / name).mkdir(parents=True)
    for name in ("runs/older", "runs/newer", "alone"):
        (tmp_path / "campaign" / name / "result.json").touch()
    rows = [{"folder": "runs/newer"}, {"folder": "runs/refused"}, {"folder": None}]
    index = {"schema": "camtorque.campaign/1", "recordings": rows}
    (tmp_path / "campaign" / "campaign.json").write_text(json.dumps(index), encoding="utf-8")
    for path in (tmp_path, tmp_path / "campaign", tmp_path / "campaign" / "campaign.json"):
        named = [file.parent.relative_to(tmp_path / "campaign").as_posix() for file in find_results(path)]
        assert named == ["alone", "runs/newer"]
    assert find_results(tmp_path / "campaign" / "runs" / "older"), "a report that is named itself"


def test_a_recording_that_its_campaign_refused_does_not_pass(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It has no report: the gate passed by the other recordings alone."""
    (tmp_path / "runs" / "a").mkdir(parents=True)
    document = {"schema": "camtorque.result/1", "recording": {"name": "A"}, "metrics": {"x": 1.0}}
    (tmp_path / "runs" / "a" / "result.json").write_text(json.dumps(document), encoding="utf-8")
    rows = [{"name": "A", "status": "ok", "folder": "runs/a"},
            {"name": "B", "status": "refused", "folder": "runs/b", "error": "the file is cut"}]  # fmt: skip
    index = {"schema": "camtorque.campaign/1", "recordings": rows}
    (tmp_path / "campaign.json").write_text(json.dumps(index), encoding="utf-8")
    file = limits_file(tmp_path, '[[limit]]\nquantity = "metrics.x"\nmax = 2.0\n')
    assert cli.main(["limits", str(file), str(tmp_path)]) == 3
    assert "B  cannot tell  [refused: the file is cut]" in capsys.readouterr().out
    assert cli.main(["limits", str(file), str(tmp_path), "--json"]) == 3
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "cannot tell"
    assert [row["refused"] for row in found["results"]] == [None, "the file is cut"]
    assert cli.main(["limits", str(file), str(tmp_path / "runs" / "a")]) == 0


def entry(out: Path, key: str, name: str, created: str, status: str = "ok") -> None:
    """Write what `campaign --only` leaves of a recording."""
    (out / "runs" / key).mkdir(parents=True)
    row = {"schema": "camtorque.entry/1", "created": created, "name": name, "status": status}
    kept = json.dumps({**row, "error": "the log is cut"})
    (out / "runs" / key / "entry.json").write_text(kept, encoding="utf-8")
    if status == "ok":
        document = {"schema": "camtorque.result/1", "recording": {"name": name}, "metrics": {"x": 1.0}}
        (out / "runs" / key / "result.json").write_text(json.dumps(document), encoding="utf-8")


def test_an_index_that_is_older_than_what_was_made_alone_since_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recording that was put right and computed by --only passed and failed by what it had been before."""
    entry(tmp_path, "older", "A", "2026-03-01T09:00:00+00:00")
    entry(tmp_path, "used", "A", "2026-03-01T10:00:00+00:00")
    index = {"schema": "camtorque.campaign/1", "created": "2026-03-01T11:00:00+01:00",
             "recordings": [{"name": "A", "status": "ok", "folder": "runs/used"}]}  # fmt: skip
    (tmp_path / "campaign.json").write_text(json.dumps(index), encoding="utf-8")
    file = limits_file(tmp_path, '[[limit]]\nquantity = "metrics.x"\nmax = 2.0\n')
    assert cli.main(["limits", str(file), str(tmp_path)]) == 0
    entry(tmp_path, "newer", "A", "2026-03-01T10:00:01+00:00")
    for path in (tmp_path, tmp_path / "campaign.json"):
        with pytest.raises(Refusal, match=r"campaign.json: is older than results of A that --only .* run the campaign"):
            find_results(path)
    assert cli.main(["export", "--trend", str(tmp_path), "--out", str(tmp_path / "trend")]) == 2
    assert find_results(tmp_path / "runs" / "used"), "a report that is named itself"
    assert capsys.readouterr().err


def test_an_index_that_still_states_a_refusal_of_what_was_computed_since_is_refused(tmp_path: Path) -> None:
    """What `--only --retry-failed` computes lies in the folder of what was refused: it passed and could not be told."""
    index = {"schema": "camtorque.campaign/1", "created": "2026-03-01T11:00:00+00:00",
             "recordings": [{"name": "A", "status": "refused", "error": "no disk", "folder": "runs/a"}]}  # fmt: skip
    (tmp_path / "campaign.json").write_text(json.dumps(index), encoding="utf-8")
    entry(tmp_path, "a", "A", "2026-03-01T12:00:00+00:00")
    with pytest.raises(Refusal, match=r"campaign.json: is older than results of A that --only"):
        find_results(tmp_path)


def test_what_was_refused_alone_does_not_pass_before_there_is_an_index(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An array job whose last command was left out passed by those of its recordings that had a report."""
    entry(tmp_path, "a", "A", "2026-03-01T10:00:00+00:00")
    entry(tmp_path, "b", "B", "2026-03-01T10:00:00+00:00", "refused")
    (tmp_path / "runs" / "c").mkdir()
    (tmp_path / "runs" / "c" / "entry.json").write_text("[]", encoding="utf-8")
    file = limits_file(tmp_path, '[[limit]]\nquantity = "metrics.x"\nmax = 2.0\n')
    for path in (tmp_path, tmp_path / "runs"):
        assert cli.main(["limits", str(file), str(path)]) == 3
        assert "B  cannot tell  [refused: the log is cut]" in capsys.readouterr().out
    assert cli.main(["limits", str(file), str(tmp_path / "runs" / "a")]) == 0, "a report that is named itself"
    entry(tmp_path, "put right", "B", "2026-03-01T10:00:01+00:00")
    assert cli.main(["limits", str(file), str(tmp_path)]) == 0


def test_a_run_refuses_a_limit_of_no_parameter_before_it_begins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = limits_file(tmp_path, '[[limit]]\nquantity = "parameters.leakge.value"\nmax = 2.0\n')
    assert cli.main(["run", str(tmp_path), "--out", str(tmp_path / "out"), "--limits", str(file)]) == 2
    assert "found parameter 'leakge', did you mean 'leakage'?" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["shaft_damping", "cam_side_inertia", "leakage"])
def test_a_run_may_have_a_limit_of_whatever_a_result_states(tmp_path: Path, name: str) -> None:
    file = limits_file(tmp_path, f'[[limit]]\nquantity = "parameters.{name}.value"\nmax = 2.0\n')
    arguments = cli.build_parser().parse_args(["run", str(tmp_path), "--limits", str(file)])
    (limit,) = run_options(arguments, lambda text: None).limits
    assert limit.quantity == f"parameters.{name}.value"
    refuse_unknown([DOCUMENT], [limit], STATED_NAMES)  # a stiff shaft has none of the first two


def test_limits_stand_in_the_result_of_a_run(tmp_path: Path) -> None:
    limits = (Limit("parameters.feed_pressure.value", None, 1.0),)
    doc = write_run(replace(run_result(), limits=limits), tmp_path)
    assert doc["limits"]["verdict"] == "fail"
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["limits"] == doc["limits"]
    assert "limits" not in write_run(run_result(), tmp_path)


def test_a_loss_is_judged_in_joule_and_the_closure_in_percent() -> None:
    document = {"explained": True, "losses": {"unit": "J per revolution", "friction": 3.0, "closure_percent": 0.5}}
    limits = (
        Limit("losses.friction", None, 4.0, "J"),
        Limit("losses.friction", None, 4.0, "J per revolution"),
        Limit("losses.closure_percent", -1.0, 1.0, "%"),
    )
    assert [row.verdict for row in judge(document, limits)] == ["pass"] * 3
    assert judge(document, [Limit("losses.friction", None, 4.0, "%")])[0].verdict == "cannot tell"


@pytest.mark.parametrize(("quantity", "stated", "unit"), [
    ("chamber.peak_bar.value", "", "bar"), ("losses.friction", "", "J per revolution"), ("losses.friction", "J", "J"),
    ("recording.cycles_used", "", ""), ("parameters.leakage.value", "mm3/s/bar", "mm3/s/bar"),
])  # fmt: skip
def test_a_verdict_has_the_unit_of_its_number_where_the_band_states_none(quantity: str, stated: str, unit: str) -> None:
    document = {
        "explained": True, "chamber": {"peak_bar": {"value": 3.0, "stderr": 0.1}}, "recording": {"cycles_used": 3},
        "losses": {"unit": "J per revolution", "friction": 3.0}, "parameters": {},
    }  # fmt: skip
    (row,) = limits_document(judge(document, [Limit(quantity, 0.0, 4.0, stated)]))["rows"]
    assert row["unit"] == unit


def test_a_line_shows_the_uncertainty_that_decides() -> None:
    """A value of 0.30 that cannot be told to be below 0.35 stood there without a reason to see."""
    guarded = Limit("parameters.leakage.value", None, 0.35, guard=2.0)
    lines = limit_lines(limits_document(judge(DOCUMENT, [guarded, Limit("metrics.fitted.rms_nm", None, 1.0)]))["rows"])
    assert "0.3 ± 0.050    at most 0.35 mm^3/s/bar; within 2" in lines[0]
    assert "±" not in lines[1]


def test_a_guard_on_a_loss_takes_the_uncertainty_that_stands_beside_it() -> None:
    document = {"explained": True, "losses": {"unit": "J per revolution", "friction": 3.7},
                "losses_stderr": {"unit": "J per revolution", "friction": 1.8}}  # fmt: skip
    guarded = [Limit("losses.friction", None, most, guard=2.0) for most in (20.0, 5.0, 0.0)]
    assert [row.verdict for row in judge(document, guarded)] == ["pass", "cannot tell", "fail"]
    assert judge(document, guarded)[0].stderr == 1.8


@pytest.mark.parametrize("quantity", [
    "alignment.torque_delay_s.value", "measured.chamber_pressure.rebuilt_peak_bar",
    "measured.delivered_volume.modelled_mm3.value", "evidence.friction.size", "uncertainty.budget.leakage.others",
])  # fmt: skip
def test_nothing_of_a_fit_that_explains_nothing_passes(quantity: str) -> None:
    *above, last = quantity.split(".")
    document: dict[str, object] = {last: 1.0}
    for name in reversed(above):
        document = {name: document}
    limit = Limit(quantity, 0.0, 2.0)
    assert judge({**document, "explained": True}, [limit])[0].verdict == "pass"
    assert judge({**document, "explained": False}, [limit])[0].verdict == "cannot tell"


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"min": 2.0, "max": 1.0}, "min 2 is above max 1; exchange them"),
        ({"min": float("nan"), "max": None}, r"found \[nan\] with guard 0, expected finite ends"),
        ({"min": None, "max": None}, "found neither min nor max"),
        ({"min": "2 bar", "max": None}, r"limit losses.friction: found \['2 bar'\] with guard 0.0, expected numbers"),
        ({"min": 0.0, "max": None, "guard": -1.0}, "with guard -1, expected finite ends and a guard of 0 or more"),
    ],
)
def test_a_band_that_is_none_is_refused(given, text: str) -> None:
    with pytest.raises(Refusal, match=text):
        Limit("losses.friction", **given)

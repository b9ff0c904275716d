"""What is finished or refused is remembered, what changed is computed again, a damaged store says what to do."""

from __future__ import annotations

import errno
import itertools
import json
import os
import pickle
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import campaign_cases
import numpy as np
import pytest
from campaign_cases import make
from camtorque import cli
from camtorque.align import AlignOptions
from camtorque.campaign import (
    CampaignOptions,
    flow,
    list_recordings,
    prune,
    run_campaign,
    run_only,
    store,
    task,
)
from camtorque.process.workers import Lost
from camtorque.records import Finding, Refusal
from camtorque.report import campaign_view
from camtorque.report.bundle import CampaignEntry
from camtorque.report.files import verify
from camtorque.run import RunOptions

OPTIONS = RunOptions()


@pytest.fixture
def analysed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the recordings that were really computed; everything runs in this process."""
    names: list[str] = []

    def analyse(path: Path, options: object) -> tuple[Any, Finding]:
        names.append(path.name)
        return campaign_cases.analyse(path, options)

    def here(call: Any, items: Any, *_: object) -> Iterator[tuple[Any, Any]]:
        return ((item, call(item)) for item in items)

    monkeypatch.setattr(task, "analyse", analyse)
    monkeypatch.setattr(task, "write_run", campaign_cases.write_run)
    monkeypatch.setattr(task, "thumbnail", lambda result: "<svg></svg>")
    monkeypatch.setattr(task, "joint_input", lambda prepared: prepared)
    monkeypatch.setattr(flow, "joint_fit", campaign_cases.no_joint_fit)
    monkeypatch.setattr(flow, "on_processes", here)
    return names


def statuses(doc: dict[str, Any]) -> dict[str, str]:
    return {row["name"]: row["status"] for row in doc["recordings"]}


def test_finished_and_refused_are_remembered(analysed: list[str], tmp_path: Path) -> None:
    raw, out = make(tmp_path / "raw", a="say", b="refuse torque", c="fail sum"), tmp_path / "out"
    for _ in range(2):
        doc = run_campaign(raw, out, OPTIONS)
        assert statuses(doc) == {"a": "ok", "b": "refused", "c": "refused"}
        assert [row["error"] for row in doc["recordings"]] == [None, "no torque", "unexpected ValueError: sum"]
        assert analysed == ["a", "b", "c"]
        assert doc["findings"][0]["text"] == "a", "the joint fit gets what was kept"
    run_campaign(raw, out, OPTIONS, CampaignOptions(retry_failed=True))
    assert analysed == ["a", "b", "c", "b", "c"]
    refused = out / doc["recordings"][1]["folder"]
    assert {path.name for path in refused.iterdir()} == {"entry.json", "SHA256SUMS"}
    assert verify(out)[1] == {}
    assert (out / doc["recordings"][0]["folder"] / "result.json").is_file()
    assert f"{doc['recordings'][0]['folder']}/report.html" in (out / "campaign.html").read_text()
    assert not list(out.glob(".index*")) + list((out / "runs").glob(".*"))


def test_what_changed_is_computed_again(analysed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    raw, out = make(tmp_path / "raw", a="say", b="say"), tmp_path / "out"
    run_campaign(raw, out, OPTIONS)
    (raw / "a" / "recording.toml").write_text("say again")
    run_campaign(raw, out, OPTIONS)
    assert analysed == ["a", "b", "a"]
    run_campaign(raw, out, RunOptions(AlignOptions(n_theta=1800)))
    assert analysed[3:] == ["a", "b"]
    monkeypatch.setattr(task, "code_digest", lambda: "other code")
    run_campaign(raw, out, OPTIONS)
    assert analysed[5:] == ["a", "b"]


def test_any_edited_file_of_the_package_is_another_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task, "__file__", str(tmp_path / "campaign" / "task.py"))
    law = tmp_path / "laws" / "friction.py"
    law.parent.mkdir()
    digests = set()
    for text in ("a", "b", "b"):
        law.write_text(text)
        digests.add(task.code_digest.__wrapped__())
    law.rename(law.with_name("spring.py"))
    assert len({*digests, task.code_digest.__wrapped__()}) == 3


def test_older_results_are_removed_and_none_that_is_wanted(
    analysed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    raw, out = make(tmp_path / "raw", a="say", b="refuse it"), tmp_path / "out"
    with pytest.raises(Refusal, match="expected the output of an earlier campaign"):
        prune(raw, out, OPTIONS)
    run_campaign(raw, out, OPTIONS)
    run_campaign(raw, out, RunOptions(AlignOptions(n_theta=1800)))
    linked = {path.name for path in (out / "runs").iterdir()}
    (raw / "a" / "recording.toml").write_text("say again")
    run_only("a", raw, out, OPTIONS)
    assert len(list((out / "runs").iterdir())) == 5
    (out / "runs" / "mine").mkdir()
    with store.campaign_folder(out), pytest.raises(Refusal, match="another campaign is writing there"):
        prune(raw, out, OPTIONS)
    # kept: a as it is now and b by these options, both of the index, a folder that is no result
    found = prune(raw, out, OPTIONS)
    assert (found["kept"], found["removed"]) == (5, 1)
    assert found["bytes"] > 0
    assert prune(raw, out, OPTIONS)["removed"] == 0
    assert cli.main(["campaign", str(raw), "--out", str(out), "--prune", "--n-theta", "900"]) == 0
    assert "2 older results removed" in capsys.readouterr().out
    (out / "runs" / "mine").rmdir()
    left = {path.name for path in (out / "runs").iterdir()}
    assert left < linked, "the index links to these"
    (out / "campaign.json").unlink()
    monkeypatch.setattr(task, "code_digest", lambda: "other code")
    with pytest.raises(Refusal, match=r"none of the 2 results .* delete the folder by hand"):
        prune(raw, out, OPTIONS)
    assert {path.name for path in (out / "runs").iterdir()} == left
    (out / "campaign.json").write_text("{")
    with pytest.raises(Refusal, match=r"is damaged .*; run the campaign again first"):
        prune(raw, out, OPTIONS)


def test_the_key_holds_every_file_that_a_recording_names(tmp_path: Path) -> None:
    examples = Path(__file__).resolve().parents[2] / "raw_examples"
    names = {path.name for path in task.input_paths(examples / "A_1250rpm")}
    assert {"recording.toml", "A_1250rpm_all.csv", "cam_A.csv", "torque_T22-40117.toml"} <= names
    first = task.recording_key("a", examples / "A_1250rpm", OPTIONS)
    assert first == task.recording_key("a", examples / "A_1250rpm", OPTIONS)
    assert first != task.recording_key("b", examples / "A_1250rpm", OPTIONS), "equal recordings do not share a folder"


def test_the_key_holds_the_certificate_of_a_bridge(tmp_path: Path) -> None:
    """Its points are in mV/V, which no channel in volts may use."""
    recording, sheet, certificate = (tmp_path / name for name in ("recording.toml", "sheet.toml", "points.csv"))
    recording.write_text(
        'schema = "fip-bench-recording/1"\n[recording]\nid = "a"\nnominal_speed_rpm = 500\n'
        "[trigger]\nnominal_angle_deg = 20\ninstallation_tolerance_deg = 1\n"
        "[sensors.torque]\ncalibration = 'sheet.toml'\n"
        + "".join(
            f'[[channels]]\nquantity = "{quantity}"\nfile = "log.csv"\nchannel = "{quantity}"\nunit = "{unit}"\n'
            "sample_rate_hz = 20000\n"
            for quantity, unit in (("torque", "mV/V"), ("trigger", "V"))
        )
    )
    sheet.write_text('[sensor]\nserial = "B-1"\nquantity = "torque"\nunit = "N m"\ncertificate = "points.csv"\n')
    keys = set()
    for full in (1.5, 1.6):
        certificate.write_text(f"applied_torque_Nm,output_mV_per_V\n0,0\n50,{full / 2}\n100,{full}\n")
        keys.add(task.recording_key("a", tmp_path, OPTIONS))
    assert certificate in task.input_paths(tmp_path)
    assert len(keys) == 2


def test_a_recording_without_a_pump_stops_no_campaign(tmp_path: Path) -> None:
    whole = Path(__file__).resolve().parents[2] / "raw_examples" / "A_1250rpm" / "recording.toml"
    text, count = re.subn(r"\[pump\]\n[^\[]*", "", whole.read_text(encoding="utf-8"))
    (tmp_path / "recording.toml").write_text(text, encoding="utf-8")
    names = {path.name for path in task.input_paths(tmp_path)}
    assert count == 1
    assert {"recording.toml", "A_1250rpm_all.csv", "torque_T22-40117.toml"} <= names
    assert "cam_A.csv" not in names


def test_what_may_be_over_next_time_is_not_remembered(
    analysed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw, out = make(tmp_path / "raw", a="unreadable", b="say"), tmp_path / "out"
    for count in (1, 2):
        doc = run_campaign(raw, out, OPTIONS)
        assert analysed.count("a") == count
    assert "Input/output error" in doc["recordings"][0]["error"]
    monkeypatch.setattr(flow, "_outcomes", lambda tasks, *_: ((item, Lost()) for item in tasks))
    doc = run_campaign(raw, out, OPTIONS)
    assert {row["error"] for row in doc["recordings"]} == {
        "two workers died on it (killed, or out of memory); run it alone by --only"
    }


def test_a_full_disk_stops_the_campaign_and_keeps_what_is_finished(
    analysed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw, out = make(tmp_path / "raw", a="say", b="say", c="say"), tmp_path / "out"
    write = campaign_cases.write_run

    def full(result: Any, folder: Path) -> dict[str, Any]:
        if result.name == "b":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(result, folder)

    monkeypatch.setattr(task, "write_run", full)
    with pytest.raises(Refusal, match="No space left on device"):
        run_campaign(raw, out, OPTIONS)
    assert analysed == ["a", "b"]
    monkeypatch.setattr(task, "write_run", write)
    assert statuses(run_campaign(raw, out, OPTIONS)) == dict.fromkeys("abc", "ok")
    assert analysed == ["a", "b", "b", "c"]


def test_a_campaign_that_finished_nothing_leaves_nothing(
    analysed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(task, "write_run", full)
    raw = make(tmp_path / "raw", a="say")
    with pytest.raises(Refusal, match="No space left on device"):
        run_campaign(raw, tmp_path / "new" / "out", OPTIONS)
    assert [path.name for path in tmp_path.iterdir()] == ["raw"]
    (tmp_path / "own").mkdir()
    with pytest.raises(Refusal, match="No space left on device"):
        run_campaign(raw, tmp_path / "own", OPTIONS)
    assert list((tmp_path / "own").iterdir()) == []


def test_one_alone_and_the_list(analysed: list[str], tmp_path: Path) -> None:
    raw, out = make(tmp_path / "raw", a="say", b="refuse it", **{"deep/c": "say"}), tmp_path / "out"
    assert run_only("deep/c", raw, out, OPTIONS).status == "ok"
    assert run_only("b", raw, out, OPTIONS).error == "no it"
    assert analysed == ["c", "b"]
    rows = list_recordings(raw, out, OPTIONS)
    assert [(row["name"], row["status"]) for row in rows] == [("a", "open"), ("b", "refused"), ("deep/c", "ok")]
    assert not (out / "campaign.json").exists()
    assert statuses(run_campaign(raw, out, OPTIONS)) == {"a": "ok", "b": "refused", "deep/c": "ok"}
    assert analysed == ["c", "b", "a"]
    with pytest.raises(Refusal, match=r"--only nowhere: found no such recording, expected one of a, b, deep/c; see"):
        run_only("nowhere", raw, out, OPTIONS)
    with pytest.raises(Refusal, match=r"--only deep/cc: found no such recording, did you mean 'deep/c'\?"):
        run_only("deep/cc", raw, out, OPTIONS)


def test_what_a_program_reads_of_a_campaign_names_its_schema(
    analysed: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["campaign", str(make(tmp_path / "raw", a="say")), "--out", str(tmp_path / "out"), "--json"]
    for choice, schema in ((["--only", "a"], "only"), (["--list"], "list"), (["--prune"], "prune"), ([], "campaign")):
        assert cli.main([*command, *choice]) == 0
        assert json.loads(capsys.readouterr().out)["schema"] == f"camtorque.{schema}/1"


def test_one_alone_as_a_shell_completes_its_name_and_none_from_elsewhere(analysed: list[str], tmp_path: Path) -> None:
    """Each had a result of its own, which the campaign did not use."""
    raw, out = make(tmp_path / "raw", a="say", **{"deep/c": "say", ".half": "say"}), tmp_path / "out"
    make(tmp_path / "other", x="say")
    found = [run_only(name, raw, out, OPTIONS) for name in ("deep/c", "deep/c/", "./deep/c", "deep//c")]
    assert {(entry.name, entry.folder) for entry in found} == {("deep/c", found[0].folder)}
    assert analysed == ["c"]
    for name in ("../other/x", ".half", str(tmp_path / "other" / "x")):
        with pytest.raises(Refusal, match=f"--only {re.escape(name)}: found no such recording"):
            run_only(name, raw, out, OPTIONS)
    assert run_only(".", raw / "deep" / "c", out, OPTIONS).name == "c"
    with pytest.raises(Refusal, match="--only '': found no such recording"):
        run_only("", raw / "deep" / "c", out, OPTIONS)
    assert cli.main(["campaign", str(raw), "--out", str(out), "--only", ""]) == 2
    assert not (out / "campaign.json").exists(), "an array job whose variable is not set computes nothing"


def test_links_in_a_circle_hold_no_recording(tmp_path):
    (tmp_path / "one").symlink_to("two")
    (tmp_path / "two").symlink_to("one")
    with pytest.raises(Refusal, match="one: found no such folder, expected one with recordings below it"):
        run_only("one", tmp_path / "one", tmp_path / "out", OPTIONS)


def test_one_alone_that_is_called_as_the_folder_is(analysed: list[str], tmp_path: Path) -> None:
    raw = make(tmp_path / "raw", raw="say", b="say")
    assert run_only("raw", raw, tmp_path / "out", OPTIONS).status == "ok"
    assert run_only("b", raw / "b", tmp_path / "out", OPTIONS).status == "ok"


def test_another_process_at_the_same_recording(analysed: list[str], tmp_path: Path) -> None:
    raw, out = make(tmp_path / "raw", a="say"), tmp_path / "out"
    name = list_recordings(raw, out, OPTIONS)[0]["key"]
    runs = store.prepare_folder(out)
    with pytest.raises(KeyboardInterrupt), task.output_folder(runs / name, "entry.json"):  # noqa: PT012
        entry = run_only("a", raw, out, OPTIONS)
        raise KeyboardInterrupt
    assert (entry.status, entry.error) == ("refused", "another process is computing it; run again after its end")
    assert run_only("a", raw, out, OPTIONS).status == "ok"


def test_one_campaign_at_a_time_writes_the_index(analysed: list[str], tmp_path: Path) -> None:
    raw, out = make(tmp_path / "raw", a="say"), tmp_path / "out"
    with store.campaign_folder(out), pytest.raises(Refusal, match="another campaign is writing there"):
        run_campaign(raw, out, OPTIONS)
    run_campaign(raw, out, OPTIONS)


def test_a_campaign_takes_no_foreign_folder_and_no_run_takes_a_campaign(analysed: list[str], tmp_path: Path) -> None:
    raw, out = make(tmp_path / "raw", a="say"), tmp_path / "out"
    run_campaign(raw, out, OPTIONS)
    with pytest.raises(Refusal, match="other files in it"), task.output_folder(out, "entry.json"):
        pass
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(Refusal, match="other files in it"):
        run_campaign(raw, tmp_path / "mine", OPTIONS)


def test_a_damaged_store_says_what_to_do(analysed: list[str], tmp_path: Path) -> None:
    raw, out = make(tmp_path / "raw", a="say"), tmp_path / "out"
    folder = out / run_campaign(raw, out, OPTIONS)["recordings"][0]["folder"]
    whole = (folder / store.JOINT).read_bytes()
    for damaged in (b"", whole[:20], whole[:-9] + b"123456789", zlib.compress(b"no pickle")):
        (folder / store.JOINT).write_bytes(damaged)
        with pytest.raises(Refusal, match=r"joint.bin: cannot be used .*; delete .* and run again"):
            run_campaign(raw, out, OPTIONS)


def test_one_damaged_folder_stops_no_other(analysed: list[str], tmp_path: Path) -> None:
    raw, out = make(tmp_path / "raw", a="say", b="say", c="say"), tmp_path / "out"
    folders = [out / row["folder"] for row in run_campaign(raw, out, OPTIONS)["recordings"]]
    (folders[0] / store.ENTRY).write_text('{"schema": ')
    (folders[1] / store.ENTRY).unlink()
    (folders[1] / "thesis.tex").touch()
    doc = run_campaign(raw, out, OPTIONS)
    assert statuses(doc) == {"a": "refused", "b": "refused", "c": "ok"}
    assert re.search(r"entry.json: is damaged .*; delete .* and run again", doc["recordings"][0]["error"])
    assert "choose another name" in doc["recordings"][1]["error"]
    assert (folders[1] / "thesis.tex").is_file()
    assert [row["status"] for row in list_recordings(raw, out, OPTIONS)] == ["refused", "open", "ok"]
    assert prune(raw, out, OPTIONS)["kept"] == 3


@pytest.mark.parametrize("content", ["{}", "[]", "null", '{"name": "a", "colour": "red"}'])
def test_an_entry_that_is_none_is_damaged(analysed: list[str], tmp_path: Path, content: str) -> None:
    """It ended the campaign as an unexpected error."""
    raw, out = make(tmp_path / "raw", a="say", b="say"), tmp_path / "out"
    folder = out / run_campaign(raw, out, OPTIONS)["recordings"][0]["folder"]
    (folder / store.ENTRY).write_text(content)
    doc = run_campaign(raw, out, OPTIONS)
    assert statuses(doc) == {"a": "refused", "b": "ok"}
    assert re.search(r"entry.json: is damaged .*; delete .* and run again", doc["recordings"][0]["error"])


def test_what_an_earlier_index_had_and_this_one_has_not_is_gone(
    analysed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw, out = make(tmp_path / "raw", a="say", b="say"), tmp_path / "out"
    write, fitted = flow.write_campaign, [True]

    def with_fit(result: Any, folder: Path, reports: Path) -> dict[str, Any]:
        if fitted:
            (folder / "fit.json").write_text(str(len(result.entries)))
        return write(result, folder, reports)

    monkeypatch.setattr(flow, "write_campaign", with_fit)
    run_campaign(raw, out, OPTIONS)
    assert (out / "fit.json").read_text() == "2"
    (out / "notes.txt").write_text("mine")
    (tmp_path / "elsewhere").write_text("mine")
    (out / "figures" / "old.svg").write_text("of more recordings")
    with (out / "SHA256SUMS").open("a") as sums:  # as an earlier version wrote it, and edited by hand
        for name in ("notes.txt", "figures/old.svg", "../elsewhere", "."):
            sums.write(f"{'0' * 64}  {name}\n")
    fitted.clear()
    run_campaign(raw, out, OPTIONS)
    assert not (out / "fit.json").exists()
    assert "fit.json" not in (out / "SHA256SUMS").read_text()
    assert (out / "campaign.html").is_file()
    assert not (out / "figures" / "old.svg").exists()
    assert (out / "notes.txt").is_file()
    assert (tmp_path / "elsewhere").is_file()
    assert verify(out)[1] == {"notes.txt": "not listed"}


class Foreign:
    """Stands for code in a stranger's output."""

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.system, ("false",)


@pytest.mark.parametrize(
    "content",
    [pickle.dumps(Foreign()), b"ccamtorque.cli\nos.system\n(S'false'\ntR.", b"ccamtorque.run\nnow\n(tR.",
     b"\x80\x04\x8c\x12camtorque.campaign\x8c\x0crun_campaign\x93."],
    ids=["system", "dotted", "function", "stack global"],
)  # fmt: skip
def test_a_strangers_output_is_no_code(tmp_path: Path, content: bytes) -> None:
    (tmp_path / store.JOINT).write_bytes(zlib.compress(content))
    with pytest.raises(Refusal, match="is no record"):
        store.read_joint_input(tmp_path)


def test_a_path_is_kept_whatever_python_calls_its_class(tmp_path: Path) -> None:
    store.write_joint_input(tmp_path, tmp_path / "log.csv")  # type: ignore[arg-type]
    assert store.read_joint_input(tmp_path) == tmp_path / "log.csv"


def test_records_of_another_version_are_refused(tmp_path: Path) -> None:
    (tmp_path / store.JOINT).write_bytes(zlib.compress(b"ccamtorque.gone\nRecord\n(tR."))
    with pytest.raises(Refusal, match=r"cannot be used \(No module named 'camtorque.gone'\); delete .* and run again"):
        store.read_joint_input(tmp_path)


def test_progress_tells_what_is_left(analysed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told, clock = list[str](), itertools.count(1000.0, 60.0)
    monkeypatch.setattr(flow, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    raw = make(tmp_path / "raw", a="say", b="refuse it", c="say")
    doc = run_campaign(raw, tmp_path / "out", OPTIONS, progress=told.append)
    assert told[0] == "1 of 3 done, 0 refused, about 2 min left (a: ok)"
    assert told[1] == "2 of 3 done, 1 refused, about 60 s left (b: refused)"
    assert doc["timing_s"] == {"recordings": 300.0, "joint": 60.0, "total": 360.0}
    assert [flow.duration_text(s) for s in (0.0, 89.0, 600.0, 7200.0)] == [
        "about 1 s",
        "about 89 s",
        "about 10 min",
        "about 2.0 h",
    ]


def test_a_page_of_hundreds_has_no_pictures(
    analysed: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw, out = make(tmp_path / "raw", a="say", b="say"), tmp_path / "out"
    run_campaign(raw, out, OPTIONS)
    assert "<svg></svg>" in (out / "campaign.html").read_text()
    monkeypatch.setattr(campaign_view, "MANY", 1)
    run_campaign(raw, out, OPTIONS)
    assert "<svg></svg>" not in (out / "campaign.html").read_text()
    assert json.loads((out / "campaign.json").read_text())["n_refused"] == 0


@pytest.mark.parametrize(
    ("items", "reason"),
    [
        (["a P"], "1 usable recording,"),
        (["a P", "b Q"], "found pumps P (a), Q (b), expected one pump, one group and one id per recording; run a "),
        (["a P", "b P", "a P"], "found recording ids that repeat: a,"),
        (["a P", "b P", "a P", "c Q"], "found pumps P (a, b, a), Q (c) and recording ids that repeat: a,"),
        (["a P", "b P"], None),
        (["a P", "b P", "c P"], "b and c hold the same cycles"),
        (["a P", "b P x"], "found [pump] plunger_diameter_m x in b, 8 in a, expected the dimensions of one pump"),
    ],
)
def test_one_pump_and_one_id_per_recording_are_fitted_together(
    items: list[str], reason: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flow, "HeldOnce", lambda: lambda item: item)
    monkeypatch.setattr(flow, "fit_joint", lambda known, read, threads: [item.name for item in known])
    inputs = [
        SimpleNamespace(
            name=item[0],
            pump_id=item[2],
            measured=np.full(4, float(min(k, 1))),
            stated={"[pump] plunger_diameter_m": item[4:] or "8"},
        )
        for k, item in enumerate(items)
    ]
    fitted, findings = flow.joint_fit(len(inputs), inputs.__getitem__, 1)
    assert fitted == ([item[0] for item in items] if reason is None or "same cycles" in reason else None)
    assert [reason in finding.text for finding in findings] == [True] * (reason is not None)


def test_sheets_that_differ_are_told_beside_ids_that_repeat(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow, "HeldOnce", lambda: lambda item: item)
    items = [
        SimpleNamespace(name=name, pump_id="P", measured=np.zeros(4), stated={"[pump] spring_preload_N": preload})
        for name, preload in (("a", "110"), ("a", "110"), ("a", "140"))
    ]
    fitted, findings = flow.joint_fit(3, items.__getitem__, 1, ["one", "copy", "other"])
    assert fitted is None
    assert [finding.code for finding in findings] == ["no_joint_fit", "sheets_differ"]
    assert "[pump] spring_preload_N is 140 in a (other), 110 in the others" in findings[1].text


def test_a_joint_fit_takes_recordings_by_their_ids_whatever_their_folders_are_called(tmp_path: Path) -> None:
    """Sums in another order have other last digits."""
    entries = [CampaignEntry(f"folder {k}", id_, "ok", "", {}, folder=id_) for k, id_ in enumerate("cab")]
    lost = task.refused("folder 9", "no torque")
    expected = [tmp_path / id_ for id_ in "abc"]
    assert flow.usable_folders(tmp_path, [*entries, lost]) == expected
    assert flow.usable_folders(tmp_path, [lost, *reversed(entries)]) == expected


def test_a_pipe_in_place_of_a_log_stops_no_campaign(tmp_path: Path) -> None:
    example = Path(__file__).resolve().parents[2] / "raw_examples" / "A_1250rpm"
    (tmp_path / "a").mkdir()
    text = (example / "recording.toml").read_text(encoding="utf-8")
    calibration = (example.parents[1] / "calibration").as_posix()
    (tmp_path / "a" / "recording.toml").write_text(text.replace("../../calibration", calibration), encoding="utf-8")
    os.mkfifo(tmp_path / "a" / "A_1250rpm_all.csv")
    found = task.recording_key("a", tmp_path / "a", OPTIONS)
    os.unlink(tmp_path / "a" / "A_1250rpm_all.csv")
    assert found != task.recording_key("a", tmp_path / "a", OPTIONS), "another reason is another key"

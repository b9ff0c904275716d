"""A campaign of real recordings: the same numbers from a worker and alone, remembered and computed, to the last bit."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from camtorque import cli
from camtorque.align import AlignOptions
from camtorque.campaign.flow import joint_fit
from camtorque.fit.joint_input import JointInput
from camtorque.report.files import verify
from camtorque.run import RunOptions, analyse

ROOT = Path(__file__).resolve().parents[2]


def document(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.slow
def test_workers_order_resuming_and_a_broken_recording_change_no_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw, out = tmp_path / "raw", tmp_path / "out"
    shutil.copytree(ROOT / "calibration", tmp_path / "calibration")
    for name in ("A_0300rpm", "A_1000rpm", "A_1250rpm"):
        shutil.copytree(ROOT / "raw_examples" / name, raw / name)
    (raw / "A_1250rpm" / "A_1250rpm_all.csv").write_bytes(b"")
    command = ["campaign", str(raw), "--out", str(out), "--workers", "2", "--n-theta", "1800", "--quiet"]
    assert cli.main(command) == 1
    assert "refused" in capsys.readouterr().out
    first = document(out / "campaign.json")
    assert [row["status"] for row in first["recordings"]] == ["ok", "ok", "refused"]
    assert "A_1250rpm_all.csv" in first["recordings"][2]["error"]
    assert first["shared_parameters"]
    *used, refused = (out / row["folder"] for row in first["recordings"])
    assert {path.name for path in refused.iterdir()} == {"entry.json", "SHA256SUMS"}
    written = {folder: (folder / "report.html").stat().st_mtime_ns for folder in used}

    alone, _ = analyse(raw / "A_0300rpm", RunOptions(AlignOptions(n_theta=1800)))
    worker = document(used[0] / "result.json")["parameters"]
    assert {row.name: row.value for row in alone.fitted.parameters} == {k: v["value"] for k, v in worker.items()}

    assert cli.main(command) == 1
    assert {folder: (folder / "report.html").stat().st_mtime_ns for folder in used} == written, "nothing is done twice"
    again = document(out / "campaign.json")
    for key in ("shared_parameters", "held_out", "drifts"):
        assert again[key] == first[key]
    assert verify(out)[1] == {}


def test_one_usable_recording_makes_no_joint_fit() -> None:
    def read(index: int) -> JointInput:
        raise AssertionError(f"recording {index} is read for nothing")

    fit, (told,) = joint_fit(1, read, 1)
    assert (fit, told.code) == (None, "no_joint_fit")

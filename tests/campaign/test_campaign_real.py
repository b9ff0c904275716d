"""A campaign of real recordings: the same numbers from a worker and alone, remembered and computed, to the last bit."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from camtorque.align import AlignOptions
from camtorque.campaign import CampaignOptions, run_campaign
from camtorque.report.checksums import verify
from camtorque.run import RunOptions, analyse

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = RunOptions(AlignOptions(n_theta=1800))


@pytest.mark.slow
def test_workers_order_and_resuming_change_no_number(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "calibration", tmp_path / "calibration")
    for name in ("A_0300rpm", "A_1000rpm"):
        shutil.copytree(ROOT / "raw_examples" / name, tmp_path / "raw" / name)
    how = CampaignOptions(2)
    first = run_campaign(tmp_path / "raw", tmp_path / "out", OPTIONS, how)
    assert [row["status"] for row in first["recordings"]] == ["ok", "ok"]
    assert first["shared_parameters"]
    reports = {row["name"]: tmp_path / "out" / row["folder"] / "result.json" for row in first["recordings"]}
    written = {name: path.stat().st_mtime_ns for name, path in reports.items()}

    alone, _ = analyse(tmp_path / "raw" / "A_0300rpm", OPTIONS)
    worker = json.loads(reports["A_0300rpm"].read_text(encoding="utf-8"))["parameters"]
    assert {row.name: row.value for row in alone.fitted.parameters} == {k: v["value"] for k, v in worker.items()}

    again = run_campaign(tmp_path / "raw", tmp_path / "out", OPTIONS, how)
    assert {name: path.stat().st_mtime_ns for name, path in reports.items()} == written, "nothing is computed twice"
    for key in ("shared_parameters", "held_out", "drifts"):
        assert again[key] == first[key]
    assert verify(tmp_path / "out")[1] == ()

"""The main job on a raw example: files, targets, what is found and refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import camtorque
import h5py
import numpy as np
import pytest
from camtorque import cli
from camtorque.campaign.find import search
from camtorque.fit.planning import Measuring
from camtorque.fit.residual import metrics
from camtorque.laws import ROWS
from camtorque.plan import usual_spreads
from camtorque.records import Refusal
from camtorque.rehearsal import rigid_torque
from camtorque.report.write import FIGURES

EXAMPLES = Path(__file__).resolve().parents[1] / "raw_examples"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("main") / "A_1000rpm"
    assert cli.main(["run", str(EXAMPLES / "A_1000rpm"), "--out", str(out), "--quiet"]) == 0
    return out


def document(folder: Path, name: str = "result.json") -> dict:
    return json.loads((folder / name).read_text(encoding="utf-8"))


@pytest.mark.slow
def test_main_job_leaves_a_whole_report(report: Path) -> None:
    assert {path.name for path in report.iterdir()} == {
        "result.json", "cycles.h5", "report.html", "figures", "SHA256SUMS", "fit.json", "ro-crate-metadata.json",
    }  # fmt: skip
    assert [path.name for path in report.parent.iterdir()] == ["A_1000rpm"]
    assert {path.stem for path in (report / "figures").iterdir()} <= set(FIGURES)
    assert (report / "figures" / "torque_full.png").stat().st_size > 10_000
    assert (report / "report.html").stat().st_size < 1_000_000


@pytest.mark.slow
def test_main_job_reaches_what_it_must_reach(report: Path) -> None:
    # the limits are those that the product promises for held-out cycles, in percent of the peak torque and N m
    doc = document(report)
    held = doc["metrics"]["fitted_held_out_cycles"]
    assert held["rms_percent_of_peak"] <= 0.35
    assert abs(held["forward_gap_percent"]) <= 0.5
    assert abs(held["return_min_measured_nm"] - held["return_min_model_nm"]) <= 0.4
    assert abs(doc["losses"]["closure_percent"]) <= 1.0
    assert doc["recording"]["cycles_used"] >= 0.95 * doc["recording"]["cycles_found"]
    assert set(doc["evidence"]) == {"chamber", "friction", "damping", "driveline"}
    assert sum(row["cycles"] for row in doc["recording"]["cut_flow"]) == (
        doc["recording"]["cycles_found"] - doc["recording"]["cycles_used"]
    )
    assert {"ingest", "align", "model", "fit", "report", "total"} == set(doc["timing_s"])


@pytest.mark.slow
def test_metrics_and_causes_come_out_of_the_files_again(report: Path) -> None:
    doc = document(report)
    with h5py.File(report / "cycles.h5") as file:
        held = file["cycles/role"][:] == b"held_out"
        model = file["model/fitted_held_out"][:]
        again = metrics(
            file["cycles/torque"][:][held].mean(axis=0), model, file["model/rigid"][:], file["model/lift"][:],
            file["model/lift_velocity"][:],
        )  # fmt: skip
        causes = sum(values[:] for values in file["model/by_cause"].values())
        # sums of a dozen doubles of some 50 N m
        np.testing.assert_allclose(causes, file["model/fitted"][:], atol=1e-9)
        assert file.attrs["configuration"] == (EXAMPLES / "A_1000rpm" / "recording.toml").read_text(encoding="utf-8")
    for key, value in doc["metrics"]["fitted_held_out_cycles"].items():
        assert value == pytest.approx(getattr(again, key), rel=1e-9), key  # the same numbers, summed in another order


def test_a_pressure_that_no_line_can_hold_is_refused_before_the_model() -> None:
    recording = camtorque.read(EXAMPLES / "A_1000rpm")
    cycles = camtorque.align(recording)
    undershot = replace(cycles, pressure=np.asarray(cycles.pressure) - 6.0e5)
    assert rigid_torque(recording, undershot).torque.size == cycles.theta.size
    turned = replace(cycles, pressure=-np.asarray(cycles.pressure))
    with pytest.raises(Refusal, match=r"A_1000rpm: the mean cycle of the line pressure goes down to -8\d\d bar gauge"):
        rigid_torque(recording, turned)


def test_recordings_are_found_at_and_below_a_folder(tmp_path: Path) -> None:
    for name in ("b/deep", "a"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "recording.toml").touch()
    assert list(search(tmp_path)[0]) == ["a", "b/deep"]
    assert list(search(tmp_path / "a")[0]) == ["a"]
    with pytest.raises(Refusal, match="no such folder"):
        search(tmp_path / "c")


@pytest.mark.slow
def test_another_run_has_a_zero_as_unsure_as_the_transducers(report: Path) -> None:
    """The literature's ±0.1 N m had promised twice what a run brings where standstill tells the zero to 1 N m."""
    measuring = Measuring(0.1, usual_spreads([report]))
    _, std = document(report)["parameters"]["torque_zero"]["prior"]
    assert measuring.spread("torque_zero") == pytest.approx(std)
    assert measuring.spread("torque_zero") > ROWS["torque_zero"].prior[1]
    assert Measuring(0.1, {}).spread("torque_zero") == ROWS["torque_zero"].prior[1]

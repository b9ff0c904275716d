"""result.json, cycles.h5 and report.html of a run without files, against the contract."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
import pytest
from camtorque.fit.residual import metrics, parts_of_gap
from camtorque.fit.uncertainty import BudgetRow
from camtorque.records import Finding, Refusal
from camtorque.report import page
from camtorque.report.alignment import write_alignment
from camtorque.report.bundle import CampaignEntry, CampaignResult
from camtorque.report.campaign_page import write_campaign
from camtorque.report.document import uncertainty_document
from camtorque.report.folder import output_folder
from camtorque.report.gaps import gap_curves
from camtorque.report.write import FIGURES, write_run
from report_cases import NASTY, run_result

METRIC_KEYS = {
    "rms_nm", "rms_percent_of_peak", "forward_gap_percent", "forward_peak_error_nm", "return_min_measured_nm",
    "return_min_model_nm", "return_rms_nm",
}  # fmt: skip
CONTRACT = {
    "": {"explained", "bumps", "evidence", "alternatives", "accuracy",
         "schema", "version", "created", "seed", "inputs", "recording", "findings", "alignment", "ladder", "effects",
         "parameters", "metrics", "losses", "chamber", "measured", "forces",
         "next_measurement", "timing_s", "peak_memory_mb"},
    "recording": {"name", "speed_rpm", "speed_ripple_percent", "duration_s", "cycles_found", "cycles_used",
                  "odd_even_rms_nm", "cut_flow"},
    "alignment": {"trigger_angle_deg", "clock", "torque_delay_s", "angle_error_budget_deg"},
    "metrics": {"rigid", "fitted", "fitted_held_out_cycles"},
    "losses": {"unit", "pressure", "friction", "input", "closure_percent"},
    "chamber": {"peak_bar", "return_start_bar"},
    "forces": {"contact_normal_max_n", "guide_max_n", "bearing_max_n", "hertz_max_gpa", "contact_lost"},
    "timing_s": {"ingest", "align", "model", "fit", "report", "total"},
}  # fmt: skip
ROWS = {
    "inputs": {"path", "sha256"},
    "findings": {"code", "severity", "text", "where"},
    "alternatives": {"name", "probability", "rms_nm", "trigger_angle_deg", "chamber_peak_bar"},
}
PARAMETER_KEYS = {
    "value", "unit", "stderr", "stderr_statistical", "ci95", "at_bound", "identifiable", "confounded_with", "prior",
    "knowledge",
}  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write_run(run_result(), folder)
    return folder


def refuse_constant(name: str) -> float:
    raise AssertionError(f"{name} in the file")


def read_json(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse_constant)


def test_result_holds_every_key_of_the_contract(written: Path) -> None:
    doc = read_json(written / "result.json")
    for name, keys in CONTRACT.items():
        assert keys <= set(doc[name] if name else doc), name
    for name, keys in ROWS.items():
        assert all(keys <= set(row) for row in doc[name]), name
    assert all(set(row) >= METRIC_KEYS for row in doc["metrics"].values())
    assert all(set(row) >= PARAMETER_KEYS for row in doc["parameters"].values())
    assert {"value", "stderr", "nominal"} <= set(doc["alignment"]["trigger_angle_deg"])
    assert {"logger", "offset_s", "skew_ppm", "stderr_s"} <= set(doc["alignment"]["clock"][1])
    assert {"source", "std_deg"} <= set(doc["alignment"]["angle_error_budget_deg"][0])
    assert {"reason", "cycles", "text"} <= set(doc["recording"]["cut_flow"][0])


def keys_of(value: object) -> set[str]:
    if isinstance(value, list):
        return set().union(*map(keys_of, value))
    return set(value).union(*map(keys_of, value.values())) if isinstance(value, dict) else set()


def test_the_page_of_the_contract_names_every_key_and_data_set(written: Path) -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "result_schema.md").read_text(encoding="utf-8")
    document = read_json(written / "result.json")
    rows = {name: list(document[name].values()) for name in ("parameters", "evidence")}
    keys = keys_of({**document, **rows, "losses": 0, "losses_stderr": 0, "uncertainty": 0})
    assert not [key for key in keys if f'"{key}"' not in text]
    found: list[str] = []
    with h5py.File(written / "cycles.h5") as file:
        file.visititems(lambda path, item: found.append(path) if isinstance(item, h5py.Dataset) else None)
    names = {"by_cause/<name>" if "by_cause/" in path else path.split("/")[-1] for path in found}
    assert not [name for name in names if name not in text]


def test_undetermined_is_null_and_units_are_those_of_the_key(written: Path) -> None:
    doc = read_json(written / "result.json")
    assert doc["parameters"]["dead_volume"]["stderr"] is None
    assert doc["parameters"]["dead_volume"]["prior"] is None
    assert doc["parameters"]["guide_friction"]["stderr"] is None, "held by its bound: not determined"
    assert doc["evidence"]["driveline"] == {
        "two_ln_bayes_factor": 31.0, "verdict": "needed", "confirmed_by_refit": False, "size": 0.7,
        "size_ci95": [0.6, 0.8], "unit": "deg", "text": "",
    }  # fmt: skip
    assert doc["alternatives"][0]["chamber_peak_bar"] == pytest.approx(1100.0)
    assert doc["chamber"]["return_start_bar"]["value"] is None
    assert doc["chamber"]["peak_bar"]["value"] == pytest.approx(1100.0)
    assert doc["alignment"]["trigger_angle_deg"]["value"] == pytest.approx(math.degrees(0.36))
    assert doc["recording"]["speed_rpm"] == pytest.approx(105.0 * 30.0 / math.pi)


def test_the_budget_is_in_the_units_of_the_parameters() -> None:
    stated = {"dead_volume": (3.0e-8, 4.0e-8), "trigger_offset": (math.radians(0.3), math.radians(0.4))}
    rows = tuple(
        BudgetRow(name, math.hypot(*parts), dict(zip("ab", parts, strict=True))) for name, parts in stated.items()
    )
    budget = uncertainty_document(replace(run_result().fitted, details={"budget": rows}))["budget"]
    assert budget["dead_volume"] == pytest.approx({"a": 30.0, "b": 40.0})
    assert budget["trigger_offset"] == pytest.approx({"a": 0.3, "b": 0.4})


def test_without_chamber_the_contract_says_null(tmp_path: Path) -> None:
    doc = write_run(run_result(with_chamber=False), tmp_path)
    assert doc["chamber"] is None
    with h5py.File(tmp_path / "cycles.h5") as file:
        assert "chamber_pressure" not in file["model"]


def test_cycles_file_has_units_scales_and_checksums(written: Path) -> None:
    with h5py.File(written / "cycles.h5") as file:
        assert {"configuration", "inputs", "version"} <= set(file.attrs)
        assert file["theta"].is_scale

        def look(name: str, item: h5py.Dataset) -> None:
            if isinstance(item, h5py.Dataset):
                assert item.attrs["units"], name
                assert item.attrs["long_name"], name
                assert item.fletcher32, name
                assert item.chunks is not None, name

        file.visititems(look)
        assert file["cycles/torque"].dims[1][0] == file["theta"]
        assert file["cycles/torque"].dims[0][0] == file["cycles/index"]
        assert file["model/fitted"].dims[0][0] == file["theta"]
        assert set(file["cycles/role"][:]) == {b"fitted", b"held_out"}


def test_metrics_come_out_of_the_cycles_file_again(written: Path) -> None:
    doc = read_json(written / "result.json")
    with h5py.File(written / "cycles.h5") as file:
        held = file["cycles/role"][:] == b"held_out"
        torque, rigid = file["cycles/torque"][:], file["model/rigid"][:]
        lift, slope = file["model/lift"][:], file["model/lift_velocity"][:]
        again = {
            "rigid": metrics(torque.mean(axis=0), rigid, rigid, lift, slope),
            "fitted": metrics(torque[~held].mean(axis=0), file["model/fitted"][:], rigid, lift, slope),
            "fitted_held_out_cycles": metrics(
                torque[held].mean(axis=0), file["model/fitted_held_out"][:], rigid, lift, slope
            ),
        }
    for name, row in again.items():
        for key, value in doc["metrics"][name].items():
            assert value == pytest.approx(getattr(row, key), rel=1e-12), (name, key)  # the same doubles, summed alike


def test_cycles_file_opens_in_xarray(written: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    with xarray.open_dataset(written / "cycles.h5", group="cycles", engine="h5netcdf") as data:
        assert data["torque"].dims == ("index", "theta")
        assert data["torque"].attrs["units"] == "N m"
    with xarray.open_dataset(written / "cycles.h5", group="model", engine="h5netcdf") as data:
        assert data["fitted"].dims == ("theta",)


class Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_page_is_self_contained_escaped_and_complete(written: Path) -> None:
    path = written / "report.html"
    text = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 1_000_000
    page = Page()
    page.feed(text)
    tags = [tag for tag, _ in page.tags]
    drawn = [name for name, spec in FIGURES.items() if spec.draw(run_result()) is not None]
    assert tags.count("figure") == len(drawn)
    assert tags.count("script") == 3, "the data, uPlot, and the page's own"
    assert NASTY in "".join(page.words)
    for _, attributes in page.tags:
        assert "style" not in attributes, "the policy of the page forbids it"
        assert not any(key.startswith("on") for key in attributes)
        for key in ("src", "href", "xlink:href"):
            assert not (attributes.get(key) or "").startswith(("http", "//")), attributes
    for name in drawn:
        assert FIGURES[name].title in text


def test_a_key_to_be_written_keeps_its_underscores_on_the_page(tmp_path: Path) -> None:
    result = run_result()
    tooth = "a second tooth (pulses_per_rev = 6) would reduce the uncertainty of trigger offset"
    write_run(replace(result, fitted=replace(result.fitted, next_measurement=(tooth,))), tmp_path)
    assert "pulses_per_rev" in (tmp_path / "report.html").read_text(encoding="utf-8").rpartition('id="next"')[2]


def test_every_figure_is_a_file_too(written: Path) -> None:
    names = {path.name for path in (written / "figures").iterdir()}
    drawn = {name: spec for name, spec in FIGURES.items() if spec.draw(run_result()) is not None}
    assert names == {f"{name}.svg" for name in drawn} | {f"{name}.png" for name, spec in drawn.items() if spec.png}
    assert {"torque_full.png", "pressure.png"} <= names


def test_the_same_run_gives_the_same_page_and_numbers(written: Path, tmp_path: Path) -> None:
    write_run(run_result(), tmp_path)
    assert (tmp_path / "report.html").read_bytes() == (written / "report.html").read_bytes()
    first, second = read_json(written / "result.json"), read_json(tmp_path / "result.json")
    first["timing_s"] = second["timing_s"] = {}
    assert first == second


def test_alignment_page(tmp_path: Path) -> None:
    result = run_result()
    budget = (replace(result.cycles.angle_errors[0], text="0.23 us on a drive of 0.08 kg m^2"),)
    doc = write_alignment(result.recording, replace(result.cycles, angle_errors=budget), result.created, tmp_path)
    assert doc["schema"] == "camtorque.align/1"
    assert read_json(tmp_path / "align.json")["cycles_used"] == result.cycles.index.size
    page = (tmp_path / "align.html").read_text(encoding="utf-8")
    assert NASTY not in page
    assert "0.23 µs on a drive of 0.08 kg m²" in page
    assert '<div class="verdict good">' in page
    wrong = replace(result.cycles, findings=(Finding("several_strokes", "error", "the lift rises once", ""),))
    write_alignment(result.recording, wrong, result.created, tmp_path)
    assert '<div class="verdict look">' in (tmp_path / "align.html").read_text(encoding="utf-8")
    assert "fitted" not in page.split("<main>")[1].split("Provenance")[0]
    with h5py.File(tmp_path / "aligned.h5") as file:
        assert "model" not in file


def test_campaign_page_lists_a_refused_recording(tmp_path: Path) -> None:
    doc = write_run(run_result(), tmp_path)
    summary = {"speed_rpm": 1000.0, "cycles_found": 9, "cycles_used": 9, "metrics": doc["metrics"]}
    entries = (
        CampaignEntry("a", "case", "ok", "", summary),
        CampaignEntry("b", "", "refused", f"no trigger {NASTY}", {}),
    )
    written = write_campaign(CampaignResult(entries, None, (), {"total": 1.0}, "2026-01-01T00:00:00+00:00"), tmp_path)
    assert [row["status"] for row in written["recordings"]] == ["ok", "refused"]
    assert written["n_refused"] == 1
    assert {"schema", "recordings", "shared_parameters", "held_out", "timing_s"} <= set(written)
    page = Page()
    page.feed((tmp_path / "campaign.html").read_text(encoding="utf-8"))
    assert f"no trigger {NASTY}" in "".join(page.words)


def test_output_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with pytest.raises(RuntimeError, match="stop"), output_folder(target, "result.json") as folder:  # noqa: PT012
        (folder / "result.json").write_text("{}", encoding="utf-8")
        raise RuntimeError("stop")
    assert list(tmp_path.iterdir()) == []


def test_only_an_earlier_report_is_replaced(tmp_path: Path) -> None:
    target = tmp_path / "out"
    for text in ("1", "2"):
        with output_folder(target, "result.json") as folder:
            (folder / "result.json").write_text('{"schema": "camtorque.result/1"}', encoding="utf-8")
            (folder / text).touch()
    assert {path.name for path in target.iterdir()} == {"result.json", "2", "SHA256SUMS"}
    assert list(tmp_path.iterdir()) == [target]
    other = tmp_path / "mine"
    other.mkdir()
    (other / "thesis.tex").touch()
    with pytest.raises(Refusal, match="other files in it"), output_folder(other, "result.json"):
        pass
    with pytest.raises(Refusal, match="found a file"), output_folder(other / "thesis.tex", "result.json"):
        pass
    (target / "result.json").write_text('{"schema": "camtor', encoding="utf-8")
    with (
        pytest.raises(Refusal, match=r"found result.json that is damaged .*, or delete it if it is a damaged report"),
        output_folder(target, "result.json"),
    ):
        pass


def test_gap_by_cause_sums_to_measured_minus_rigid(written: Path) -> None:
    doc = read_json(written / "result.json")
    gap, result = doc["gap_by_cause"], run_result()
    forward, fall, lowest = parts_of_gap(result.rigid, result.cycles.mean_torque)
    with h5py.File(written / "cycles.h5") as file:
        distance = file["mean/torque"][:] - file["model/rigid"][:]
    # sums of a few curves of some 10 N m: rounding stays below 1e-12 N m
    for key, value in (("forward_nm", distance[forward].mean()), ("return_stroke_nm", distance[fall].mean()),
                       ("return_minimum_nm", distance[lowest])):  # fmt: skip
        assert gap["total"][key] == pytest.approx(value, abs=1e-11), key
        assert sum(row[key] for row in gap["causes"]) == pytest.approx(value, abs=1e-11), key
    percent = 100.0 * gap["total"]["forward_nm"] / result.rigid.torque[forward].mean()
    assert percent == pytest.approx(doc["metrics"]["rigid"]["forward_gap_percent"], rel=1e-9)
    assert gap["causes"][-1]["cause"] == "residual"


def test_cam_angle_and_plunger_pressure_are_told_apart() -> None:
    result = run_result()
    curves = gap_curves(result)
    lift_slope = np.interp(
        result.cycles.theta + 0.01, result.cycles.theta, result.rigid.lift_velocity, period=2.0 * np.pi
    )
    shifted = 5e-5 * result.cycles.pressure[0] * lift_slope
    # the case's rigid torque is p A y' with the area of its pump: the same product, up to rounding
    np.testing.assert_allclose(curves["cam angle"], shifted - result.rigid.torque, atol=1e-11)
    both = curves["cam angle"] + curves["plunger pressure"]
    np.testing.assert_allclose(both, result.fitted.by_cause["pressure"] - result.rigid.torque, atol=1e-11)


@pytest.mark.parametrize("folder", [Path(page.__file__).parent / "vendor", Path(__file__).parent / "vendor"])
def test_foreign_scripts_are_those_that_were_taken_over(folder: Path) -> None:
    rows = [line.split() for line in (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines()]
    assert rows
    for digest, name in rows:
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest, name
    assert list(folder.glob("*.LICENSE"))

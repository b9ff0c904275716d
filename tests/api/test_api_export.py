"""Export: every format holds the report's numbers; no text becomes a formula; trends over many reports."""

from __future__ import annotations

import errno
import json
import os
from dataclasses import replace
from datetime import date
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from camtorque import cli, export
from camtorque.export import drawn_table, informed_parameters, trend_table
from camtorque.records import Refusal
from camtorque.report.document import result_document
from camtorque.report.plots import trend_figure
from camtorque.report.write import write_run
from report.report_cases import run_result
from scipy.io import loadmat


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reports") / "case"
    folder.mkdir()
    write_run(run_result(), folder)
    return folder


def exported(report: Path, out: Path, file_format: str, capsys: pytest.CaptureFixture[str]) -> list[Path]:
    assert cli.main(["export", str(report), "--format", file_format, "--out", str(out), "--json"]) == 0
    return [Path(name) for name in json.loads(capsys.readouterr().out)["files"]]


def measured(report: Path) -> np.ndarray:
    with h5py.File(report / "cycles.h5") as file:
        return file["mean/torque"][:]


def test_csv_and_parquet(report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = {f"case_{name}" for name in ("torque", "pressure", "cycles", "means", "parameters", "findings")}
    for file_format, read in (("csv", pd.read_csv), ("parquet", pd.read_parquet)):
        paths = exported(report, tmp_path, file_format, capsys)
        assert {path.stem for path in paths} == names
        means = read(tmp_path / f"case_means.{file_format}")
        np.testing.assert_allclose(means["mean_torque_nm"], measured(report), rtol=1e-8)
        assert means["cam_angle_deg"].iloc[-1] == pytest.approx(359.5)
        parameters = read(tmp_path / f"case_parameters.{file_format}").set_index("name")
        assert parameters.loc["feed_pressure", "value"] == 1.7
        assert np.isnan(parameters.loc["dead_volume", "stderr"])
        torque = read(tmp_path / f"case_torque.{file_format}")
        np.testing.assert_allclose(torque.drop(columns="cam_angle_deg").mean(axis=1), measured(report), rtol=1e-7)
    assert not list(tmp_path.glob(".*"))


def test_mat(report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (path,) = exported(report, tmp_path, "mat", capsys)
    content = loadmat(path, simplify_cells=True)
    np.testing.assert_array_equal(content["means"]["mean_torque_nm"], measured(report))
    assert next(iter(content["parameters"]["name"])) == "feed_pressure"


def test_xlsx(report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (path,) = exported(report, tmp_path, "xlsx", capsys)
    sheets = pd.read_excel(path, sheet_name=None)
    assert set(sheets) == {"torque", "pressure", "cycles", "means", "parameters", "findings"}
    np.testing.assert_allclose(sheets["means"]["mean_torque_nm"], measured(report), rtol=1e-12)


def test_a_sheet_of_too_many_columns_is_refused(tmp_path: Path) -> None:
    table = pd.DataFrame(np.zeros((1, export.SHEET_COLUMNS + 1)))
    with pytest.raises(Refusal, match="has 16385 columns, a sheet holds 16384; take csv"):
        export.FORMATS["xlsx"]({"torque": table}, tmp_path / "x")


@pytest.mark.parametrize(
    ("text", "safe"),
    [
        ("=1+1", "'=1+1"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("+x", "'+x"),
        ("-2+3", "'-2+3"),
        ("\tx", "'\tx"),
        ("-", "-"),
        ("a=b", "a=b"),
    ],
)
def test_no_text_becomes_a_formula(text: str, safe: str) -> None:
    assert export.safe_text(text) == safe


def test_texts_of_a_report_are_made_safe(tmp_path: Path) -> None:
    result = run_result()
    evil = replace(result.fitted.parameters[0], meaning='=HYPERLINK("http://x")')
    write_run(replace(result, fitted=replace(result.fitted, parameters=(evil,))), tmp_path)
    document = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    tables = export.report_tables(tmp_path, document)
    assert tables["parameters"]["meaning"].tolist() == ['\'=HYPERLINK("http://x")']


def test_tables_of_an_unexplained_report_state_no_interval(tmp_path: Path) -> None:
    write_run(run_result(explained=False), tmp_path)
    document = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    table = export.report_tables(tmp_path, document)["parameters"]
    assert table[["stderr", "stderr_statistical", "low95", "high95"]].isna().all(axis=None)
    assert not table["explained"].any()
    (row,) = trend_table({"A": document}).to_dict("records")
    assert row["explained"] is False
    assert pd.isna(row["feed_pressure_stderr"])
    assert informed_parameters({"A": document}) == {}


def test_a_trend_names_its_parameters_with_units_as_they_are_printed() -> None:
    row = {"value": 1.0, "knowledge": "measured", "role": "shared"}
    units = {"dead_volume": "mm^3", "bulk_modulus_slope": "-", "bearing_arm": "um"}
    document = {"explained": True, "parameters": {name: {**row, "unit": unit} for name, unit in units.items()}}
    assert list(informed_parameters({"A": document}).values()) == [
        "dead volume / mm³", "bulk modulus slope", "bearing arm / µm",
    ]  # fmt: skip


def test_a_turned_label_of_a_trend_ends_below_its_own_tick() -> None:
    """Dates were centred below theirs and ended below the next one's."""
    table = pd.DataFrame({"date": ["2026-01-05", "2026-03-09"], "speed_rpm": [500.0, 900.0], "x": [1.0, 2.0]})
    dates, speeds = trend_figure(table, {"date": "date", "speed_rpm": "speed / rpm"}, {"x": "x"}).axes
    assert {(text.get_ha(), text.get_rotation()) for text in dates.get_xticklabels()} == {("right", 30.0)}
    assert {(text.get_ha(), text.get_rotation()) for text in speeds.get_xticklabels()} == {("center", 0.0)}


def test_further_channels_have_their_tables(tmp_path: Path) -> None:
    result = run_result()
    shape = result.cycles.pressure.shape
    channels = {"fuel_temperature": np.full(shape, 320.0), "delivered_volume": np.full(shape, 5e-8)}
    write_run(replace(result, cycles=replace(result.cycles, channels=channels)), tmp_path)
    document = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert document["recording"]["fuel_temperature_c"] == pytest.approx(46.85)
    tables = export.report_tables(tmp_path, document)
    assert tables["delivered_volume"]["delivered_volume_1_mm3"].iloc[0] == pytest.approx(50.0)
    assert tables["cycles"]["fuel_temperature_mean_K"].tolist() == pytest.approx([320.0] * shape[0])
    assert tables["cycles"]["speed_rpm"].iloc[0] == pytest.approx(105.0 / (2.0 * np.pi) * 60.0)


def test_a_report_without_its_cycles(report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "result.json").write_bytes((report / "result.json").read_bytes())
    assert cli.main(["export", str(tmp_path)]) == 2
    assert "cycles.h5: no such file; expected it beside result.json" in capsys.readouterr().err


def test_a_report_stays_as_it_was_written(report: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = sorted(report.rglob("*"))
    monkeypatch.chdir(tmp_path)
    assert cli.main(["export", str(report)]) == 0
    assert sorted(report.rglob("*")) == before
    assert (tmp_path / "tables" / "case_means.csv").is_file()


def test_tables_do_not_go_into_a_finished_report(
    report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "SHA256SUMS").touch()
    assert cli.main(["export", str(report), "--out", str(tmp_path)]) == 2
    assert "found a finished report, expected another folder" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.csv"))


def test_reports_of_one_name_do_not_overwrite_each_other(
    report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = ("before", "after 1", "after_1", "after+1")
    here = tmp_path / "elsewhere"
    here.mkdir()
    monkeypatch.chdir(here)
    for above in folders:
        (tmp_path / above / "case").mkdir(parents=True)
        for name in ("result.json", "cycles.h5"):
            (tmp_path / above / "case" / name).write_bytes((report / name).read_bytes())
    paths = exported(Path(".."), tmp_path / "out", "mat", capsys)
    assert len({path.name for path in paths}) == len(folders)
    name = json.loads((report / "result.json").read_text(encoding="utf-8"))["recording"]["name"]
    assert f"{name}_before_case.mat" in {path.name for path in paths}, "the same from wherever the command is given"
    (tmp_path / "before" / "result.json").write_bytes((report / "result.json").read_bytes())
    (tmp_path / "before" / "cycles.h5").write_bytes((report / "cycles.h5").read_bytes())
    paths = exported(tmp_path / "before", tmp_path / "nested", "mat", capsys)
    assert {path.name for path in paths} == {f"{name}.mat", f"{name}_case.mat"}


def test_trend_over_date_speed_and_temperature(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(3):
        result = run_result(f"run{number}")
        config = result.recording.config
        config.date, config.fluid.temperature = date(2026, 1, 3 - number), 300.0 + number
        row = replace(result.fitted.parameters[0], value=1.0 + number, knowledge="measured")
        fitted = replace(result.fitted, parameters=(row, *result.fitted.parameters[1:]))
        (tmp_path / config.id).mkdir()
        write_run(replace(result, fitted=fitted), tmp_path / config.id)
    assert cli.main(["export", "--trend", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    assert len(capsys.readouterr().out.split()) == 3
    table = pd.read_csv(tmp_path / "out" / "reports_trend.csv")
    assert table["date"].tolist() == ["2026-01-01", "2026-01-02", "2026-01-03"]
    assert table["feed_pressure"].tolist() == [3.0, 2.0, 1.0]
    assert table["fuel_temperature_c"].tolist() == pytest.approx([28.85, 27.85, 26.85])
    svg = (tmp_path / "out" / "trend.svg").read_text(encoding="utf-8")
    for label in ("feed pressure / bar", "fuel temperature", "date", "chamber peak"):
        assert label in svg
    assert "speed / rpm" not in svg  # all three ran at one speed


def test_a_recording_of_several_reports_is_one_row_of_a_trend(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder of reports with a campaign in it counted each recording twice."""
    rows = [{"path": "log.csv", "sha256": "1" * 64}]
    for name, created, inputs in (("a", "2026-01-02", rows), ("b", "2026-01-03", rows), ("c", "2026-01-01", [])):
        (tmp_path / name).mkdir()
        write_run(run_result(name), tmp_path / name)
        file = tmp_path / name / "result.json"
        document = json.loads(file.read_text(encoding="utf-8")) | {"created": created, "inputs": inputs}
        file.write_text(json.dumps(document), encoding="utf-8")
    assert cli.main(["export", "--trend", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    assert f"{tmp_path}/a and {tmp_path}/b are of the same inputs" in capsys.readouterr().err
    assert sorted(pd.read_csv(tmp_path / "out" / "reports_trend.csv")["recording"]) == ["b", "c"]


def test_a_trend_of_reports_that_are_all_unexplained(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "case").mkdir()
    write_run(run_result(explained=False), tmp_path / "case")
    assert cli.main(["export", "--trend", str(tmp_path), "--out", str(tmp_path / "out")]) == 0, capsys.readouterr().err
    table = pd.read_csv(tmp_path / "out" / "reports_trend.csv")
    assert table["chamber_peak_bar"].notna().all()
    assert table["chamber_peak_bar_stderr"].isna().all()


def test_a_trend_draws_what_is_measured_and_no_bar_below_a_bound() -> None:
    def document(knowledge: str, explained: bool = True) -> dict[str, object]:
        document = result_document(run_result(explained=explained))
        row = {"value": 0.2, "stderr": 0.3, "ci95": [0.0, 0.9], "unit": "%", "role": "shared", "knowledge": knowledge}
        return {**document, "parameters": {"free_air": row}}

    words = ("narrowed", "from the sheet", "not told by the data")
    documents = {**{word: document(word) for word in words}, "unexplained": document("measured", explained=False)}
    table = trend_table(documents)
    drawn = drawn_table(table, documents, ["free_air"]).set_index("report")
    assert drawn["free_air"].dropna().to_dict() == {"narrowed": 0.2}
    assert drawn.loc["narrowed", ["free_air_down", "free_air_up"]].tolist() == pytest.approx([0.2, 0.3])
    assert table["free_air"].notna().all(), "the table holds all"


def test_a_full_disk_leaves_nothing(
    report: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    assert cli.main(["export", str(report), "--out", str(tmp_path / "new" / "tables")]) == 2
    assert "cannot be written (No space left on device)" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())

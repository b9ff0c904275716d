"""Measured chamber pressure and delivered volume beside what the fit rebuilt: result.json and the page."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from camtorque.records import CamCycles, Estimate, FittedTorque
from camtorque.report.alignment import aligned_cycles, write_alignment
from camtorque.report.bundle import RunResult
from camtorque.report.document import result_document
from camtorque.report.gaps import gap_shares
from camtorque.report.measured import measured_document, measured_findings
from camtorque.report.texts import measured_text
from camtorque.report.write import figures_of, write_run
from report_cases import run_result

BAR = 1e5


def with_channels(**channels: np.ndarray) -> RunResult:
    result = run_result()
    cycles: CamCycles = replace(result.cycles, channels=channels)
    volume = {"delivered_volume": Estimate(66.5e-9, 4e-9)}
    fitted: FittedTorque = replace(result.fitted, details={**result.fitted.details, **volume})
    return replace(result, cycles=cycles, fitted=fitted)


def test_nothing_measured_is_null() -> None:
    assert measured_document(run_result()) == {"chamber_pressure": None, "delivered_volume": None}


def test_a_sensor_in_the_chamber_is_held_against_the_rebuilt_pressure() -> None:
    result = run_result()
    rebuilt = result.fitted.chamber_pressure
    off = np.where(np.arange(rebuilt.size) == 300, 30.0 * BAR, 1.5 * BAR)
    chamber = np.tile(rebuilt + off, (result.cycles.index.size, 1))
    chamber[2, 50] = np.nan  # a cycle that the sensor does not cover
    row = measured_document(with_channels(chamber_pressure=chamber))["chamber_pressure"]
    assert row["rebuilt_peak_bar"] == pytest.approx(rebuilt.max() / BAR)
    assert row["peak_bar"] == pytest.approx(rebuilt.max() / BAR + 1.5)
    assert row["largest_difference_bar"] == pytest.approx(30.0)
    assert row["largest_difference_at_deg"] == pytest.approx(150.0)
    assert row["rms_difference_bar"] == pytest.approx(np.sqrt((30.0**2 + 719 * 1.5**2) / 720), rel=1e-6)
    # the model's standard uncertainty is 1 bar: 1.5 bar is inside two, 30 are not
    loaded = rebuilt > 0.3 * rebuilt.max()
    assert row["loaded_inside_two_std_percent"] == pytest.approx(100.0 * (1.0 - loaded[300] / loaded.sum()))


def test_the_volume_of_a_stroke_stands_beside_that_of_the_model(tmp_path: Path) -> None:
    shape = (run_result().cycles.index.size, 720)
    result = with_channels(delivered_volume=np.full(shape, 70e-9), fuel_temperature=np.full(shape, 330.0))
    row = measured_document(result)["delivered_volume"]
    assert row["modelled_mm3"] == pytest.approx({"value": 66.5, "stderr": 4.0})
    assert (row["measured_mm3"], row["measured_std_mm3"]) == (pytest.approx(70.0), pytest.approx(0.0, abs=1e-9))
    assert row["difference_percent"] == pytest.approx(100.0 * (70.0 / 66.5 - 1.0))
    doc = write_run(result, tmp_path)
    assert doc["measured"]["delivered_volume"]["measured_mm3"] == pytest.approx(70.0)
    assert doc["recording"]["fuel_temperature_c"] == pytest.approx(330.0 - 273.15)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Delivered per stroke: 70 mm³ measured, 66.5 ± 4.0 mm³ by the model (+5.3 %)" in page


@pytest.mark.parametrize(("gain", "contradicts"), [(1.0, False), (1.002, False), (0.7, True), (1.1, True)])
def test_a_measured_chamber_that_contradicts_the_fit_is_in_the_headline(gain: float, contradicts: bool) -> None:
    """1030 bar beside 1472 ± 13 were a sentence far down, and *Explained*."""
    result = run_result()
    chamber = np.tile(gain * result.fitted.chamber_pressure, (result.cycles.index.size, 1))
    doc = result_document(with_channels(chamber_pressure=chamber))
    told = [row for row in doc["findings"] if row["code"] == "chamber_contradicted"]
    assert len(told) == contradicts
    assert ("a measured chamber pressure that contradicts" in doc["verdict"]["text"]) == contradicts
    assert all(
        re.match(r"the measured chamber pressure contradicts the rebuilt one: \d+.* against", row["text"])
        for row in told
    )


@pytest.mark.parametrize(("measured", "contradicts"), [(66.5, False), (74.0, False), (82.0, True), (50.0, True)])
def test_a_measured_delivery_that_contradicts_the_fit_is_in_the_headline(measured: float, contradicts: bool) -> None:
    """The model has 66.5 ± 4 mm³."""
    volume = np.full((run_result().cycles.index.size, 720), measured * 1e-9)
    told = measured_findings(measured_document(with_channels(delivered_volume=volume)))
    assert [row.code for row in told] == ["delivery_contradicted"] * contradicts
    assert all("mm³ a stroke against 66.5 ± 4" in row.text for row in told)


def test_a_temperature_is_shown_in_degrees_centigrade() -> None:
    shape = (run_result().cycles.index.size, 720)
    result = with_channels(fuel_temperature=np.full(shape, 330.0), gallery_pressure=np.full(shape, 4.0e5))
    curves = {panel.ordinate: panel.lines[0].values for panel in aligned_cycles(result.cycles).panels}
    assert curves["fuel temperature [°C]"] == pytest.approx(330.0 - 273.15)
    assert curves["gallery pressure [bar]"] == pytest.approx(4.0)


@pytest.mark.parametrize(("inside", "place"), [(False, "line"), (True, "chamber")])
def test_an_alignment_says_where_its_pressure_was_measured(inside: bool, place: str, tmp_path: Path) -> None:
    result = run_result()
    config = SimpleNamespace(**{**vars(result.recording.config), "measures_chamber": inside})
    write_alignment(replace(result.recording, config=config), result.cycles, "2026-01-02T03:04:05+00:00", tmp_path)
    assert f">{place} pressure [bar]<" in (tmp_path / "align.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("inside", [False, True])
def test_a_run_says_where_its_pressure_was_measured(inside: bool) -> None:
    """The page of a sensor in the chamber spoke of a line, of a delivery valve and of a pressure that is rebuilt."""
    result = run_result(with_chamber=not inside)
    config = SimpleNamespace(**{**vars(result.recording.config), "measures_chamber": inside})
    result = replace(result, recording=replace(result.recording, config=config))
    drawn = figures_of(result)["pressure"]
    told = " ".join([drawn.title, drawn.caption, *(row.meaning for row in gap_shares(result))])
    assert ("line" in told.lower(), "rebuilt from the torque" in told) == (not inside, not inside)
    assert "response to it" in told


def test_nothing_is_said_to_agree_within_uncertainties_where_the_model_fails() -> None:
    chamber = {
        **dict.fromkeys(("peak_bar", "rebuilt_peak_bar", "rms_difference_bar", "rms_difference_percent"), 9.0),
        "largest_difference_bar": 3.0,
        "largest_difference_at_deg": 40.0,
        "loaded_inside_two_std_percent": 98.0,
    }
    volume = {"measured_mm3": 70.0, "modelled_mm3": {"value": 66.5, "stderr": 4.0}, "difference_percent": 5.3}
    doc = {"measured": {"chamber_pressure": chamber, "delivered_volume": volume}}
    sure, unsure = (measured_text({**doc, "explained": explained}) for explained in (True, False))
    assert "(+3 bar), and agree within two standard uncertainties at 98 % of the loaded angles. Delivered" in sure
    assert "66.5 ± 4.0 mm³ by the model" in sure
    assert "(+3 bar). Delivered per stroke: 70 mm³ measured, 66.5 mm³ by the model (+5.3 %)." in unsure


def test_a_channel_that_covers_no_cycle_is_not_compared() -> None:
    shape = (run_result().cycles.index.size, 720)
    nothing = np.full(shape, np.nan)
    result = with_channels(chamber_pressure=nothing, delivered_volume=nothing)
    assert result.cycles.mean_cycle("chamber_pressure") is None
    assert measured_document(result) == {"chamber_pressure": None, "delivered_volume": None}

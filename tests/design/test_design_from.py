"""A design from a fit: its friction, its chamber as load, and the answer run by the fitted model."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from camtorque import design_from
from camtorque.commands.design import fitted_lines
from camtorque.design import read_task
from camtorque.design_from import as_fitted, carried_angles, carried_pressure, fitted_pump, read_known, stroke_angles
from camtorque.fit import forecast
from camtorque.fit.known_ends import Curve
from camtorque.hashes import file_digest
from camtorque.ingest.pump_file import read_pump
from camtorque.mechanism.lift_laws import lift_law
from camtorque.records import Refusal
from camtorque.units import BAR, DEGREE, RPM
from design_cases import PAPER, design_file

ROOT = Path(__file__).resolve().parents[2]
PUMP = ROOT / "calibration" / "pump_A.toml"
THETA = np.arange(1800) * 2.0 * np.pi / 1800
LIFT = '[lift]\nlaw = "modified_sine"\nlift_mm = 8\nrise_deg = 60\ntop_dwell_deg = 20\nreturn_deg = 60\n'
FREE = "follower_offset_mm = [-3, 3]"
AIM = 'peak_torque_nm = "least"'


def known_fit(folder: Path) -> Path:
    """Write what a report leaves behind that a design reads: values of a fit, sheets, line pressure."""
    names = ["guide_friction", "bearing_arm", "end_of_delivery", "pressure_zero"]
    row = {"id": "A_1000rpm", "folder": ".", "speed_rpm": 1000.0, "structure": "land", "rms_percent_of_peak": 0.1,
           "left_out_rms_percent": None, "explained": True}  # fmt: skip
    fit = {"schema": "camtorque.fit/1", "names": names, "values": [0.05, 1e-4, 44.0 * DEGREE, 0.0],
           "stderr": [0.01, 1e-5, 1e-3, 1e4], "correlation": np.eye(4).tolist(), "recordings": [row]}  # fmt: skip
    (folder / "fit.json").write_text(json.dumps(fit))
    sheets = ("raw_examples/A_1000rpm/recording.toml", "calibration/cam_A.csv", "calibration/torque_T22-40117.toml")
    inputs = [{"path": str(ROOT / name), "sha256": file_digest(ROOT / name)} for name in sheets]
    result = {"schema": "camtorque.result/1", "recording": {"pump": "FIP-A"}, "inputs": inputs}
    (folder / "result.json").write_text(json.dumps(result))
    bump = np.exp(-(((THETA / DEGREE - 38.0) / 9.0) ** 2))
    with h5py.File(folder / "cycles.h5", "w") as file:
        file["theta"], file["mean/pressure"] = THETA, (150.0 + 700.0 * bump) * BAR
    return folder


def law_of():
    config, _ = read_pump(PUMP)
    return lift_law(config.cam_table)


def test_angles_of_equal_lift_are_told_on_another_cam() -> None:
    law = law_of()
    lifts = np.array([1e-3, 4e-3])
    angles = stroke_angles(law, lifts)
    assert law.evaluate(angles) == pytest.approx([1e-3, 4e-3, 4e-3, 1e-3], abs=2e-6)
    assert np.all(np.diff(angles) > 0.0)
    later = SimpleNamespace(evaluate=lambda theta: law.evaluate(theta - 0.3))
    found = carried_angles(angles, law, later)  # type: ignore[arg-type]
    assert np.mod(found, 2.0 * np.pi) == pytest.approx(np.mod(angles - 0.3, 2.0 * np.pi), abs=1e-3)
    wider = SimpleNamespace(evaluate=lambda theta: 0.9 * law.evaluate(theta))
    found = carried_angles(angles[:2], law, wider)  # type: ignore[arg-type]
    assert law.evaluate(found) == pytest.approx(0.9 * lifts, abs=2e-6)


def test_a_wave_on_either_flank_leaves_the_angles_in_order() -> None:
    """A lift that is reached twice on the way down was looked up in a table that does not rise."""
    theta = np.array([0.0, 60.0, 70.0, 80.0, 140.0, 200.0, 210.0, 220.0, 280.0, 360.0]) * DEGREE
    lift = np.array([0.0, 5.0, 4.9, 5.0, 9.0, 5.0, 4.9, 5.0, 0.0, 0.0]) * 1e-3
    waved = SimpleNamespace(evaluate=lambda angle: np.interp(np.mod(angle, 2.0 * np.pi), theta, lift))
    lifts = np.array([2.0, 4.95, 4.999, 7.0]) * 1e-3
    angles = stroke_angles(waved, lifts)  # type: ignore[arg-type]
    assert np.all(np.diff(angles) > 0.0)
    assert waved.evaluate(angles) == pytest.approx(np.r_[lifts, lifts[::-1]], abs=5e-6)


def test_line_pressure_stays_with_the_stroke() -> None:
    law = law_of()
    curve = Curve(THETA, 1e7 + 1e9 * law.evaluate(THETA), 100.0)
    later = SimpleNamespace(evaluate=lambda theta: law.evaluate(theta - 0.3))
    assert carried_pressure(curve, law, law, 0.01) == pytest.approx(curve.pressure, rel=2e-3)
    expected = 1e7 + 1e9 * law.evaluate(THETA - 0.3)
    assert carried_pressure(curve, law, later, 0.01) == pytest.approx(expected, rel=5e-3)  # type: ignore[arg-type]


def test_a_cam_without_rest_is_refused() -> None:
    with pytest.raises(Refusal, match="no rest on the base circle"):
        stroke_angles(SimpleNamespace(evaluate=lambda theta: 2.0 + np.cos(theta)), np.array([1.0]))  # type: ignore[arg-type]


def test_the_fit_of_a_cam_of_several_lobes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The line pressure of its other lobes lay on the base circle of the design."""
    law = law_of()
    twice = SimpleNamespace(evaluate=lambda theta: law.evaluate(theta) + law.evaluate(theta - np.pi))
    monkeypatch.setattr(design_from, "lift_law", lambda table: twice)
    with pytest.raises(Refusal, match="found the fit of a cam of 2 lobes, expected one lobe, as a design has; leave"):
        fitted_pump(read_known(known_fit(tmp_path)))


def test_the_fitted_chamber_is_the_load_and_the_same_cam_gives_the_same_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forecast, "DRAWS", 3)
    known = read_known(known_fit(tmp_path))
    fitted = fitted_pump(known)
    load = "[[load]]\nspeed_rpm = [900]\n"
    task = read_task(design_file(tmp_path, lift=LIFT, free=FREE, load=load, aims=AIM, pump=PUMP), fitted)
    assert task.config.friction == pytest.approx((0.05, 1e-4, 0.0))
    assert [(item.name, item.source) for item in task.loads] == [("900 rpm, A_1000rpm", "A_1000rpm")]
    top = float(max(np.max(task.loads[0].pressures), np.max(task.loads[0].back_pressures)))
    stroke = fitted.stroke("A_1000rpm", 900.0 * RPM)
    assert top == pytest.approx(float(np.max(stroke.pressure.pressure)), rel=0.01)
    pump = task.config.pump
    chosen = SimpleNamespace(evaluated=SimpleNamespace(pump=pump))
    rows = as_fitted(known, SimpleNamespace(task=task, chosen=chosen), pump.cam_table_path)  # type: ignore[arg-type]
    (row,) = rows
    for key in ("torque_max_nm", "chamber_peak_bar", "delivered_mm3", "hertz_max_gpa"):
        assert row["design"][key]["value"] == pytest.approx(row["fitted_pump"][key]["value"], rel=4e-3), key
    assert row["fitted_pump"]["chamber_peak_bar"]["value"] == pytest.approx(top / BAR, rel=0.01)
    delivered = row["fitted_pump"]["delivered_mm3"]["value"]
    assert delivered > 10.0
    shown = 1e9 * pump.plunger_area * task.loads[0].delivered(float(np.max(task.loads[0].lifts)))
    assert shown == pytest.approx(delivered, rel=0.15), "less what valve and gallery swallow and give back"
    lines = fitted_lines(rows)
    assert lines[0].startswith("900 rpm, A_1000rpm: by the fitted model")
    assert any("volume delivered in a stroke [mm³]" in line for line in lines)


def test_the_design_of_the_guide_can_be_read_as_it_stands_there(tmp_path: Path) -> None:
    """Settings without lift and dwell stood beside the table of results: nobody could have made it."""
    blocks = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "design.md").read_text(encoding="utf-8"), re.DOTALL)
    (text,) = (block for block in blocks if "pump_A.toml" in block)
    file = tmp_path / "design.toml"
    file.write_text(text.replace("calibration/pump_A.toml", PUMP.as_posix()), encoding="utf-8")
    task = read_task(file, fitted_pump(read_known(known_fit(tmp_path))))
    assert [round(item.speed / RPM) for item in task.loads] == [500, 1000]


@pytest.mark.parametrize(("load", "pump", "text"), [
    ('speed_rpm = 900\nrecording = "A_100rpm"', PUMP, "'A_100rpm' is no recording of .*did you mean 'A_1000rpm'"),
    ("speed_rpm = 900", PAPER, "is a fit of the pump 'FIP-A', expected that of"),
])  # fmt: skip
def test_loads_and_pumps_that_the_fit_does_not_know_are_refused(
    tmp_path: Path, load: str, pump: Path, text: str
) -> None:
    fitted = fitted_pump(read_known(known_fit(tmp_path)))
    path = design_file(tmp_path, lift=LIFT, free=FREE, load=f"[[load]]\n{load}\n", aims=AIM, pump=pump)
    with pytest.raises(Refusal, match=text):
        read_task(path, fitted)


def test_without_a_fitted_chamber_the_pressure_tells_what_is_delivered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forecast, "DRAWS", 40)
    folder = known_fit(tmp_path)
    fit = json.loads((folder / "fit.json").read_text())
    fit["recordings"][0]["structure"] = "line"
    (folder / "fit.json").write_text(json.dumps(fit))
    load = "[[load]]\nspeed_rpm = 1000\n"
    task = read_task(design_file(tmp_path, lift=LIFT, free=FREE, load=load, aims=AIM, pump=PUMP),
                     fitted_pump(read_known(folder)))  # fmt: skip
    assert not task.loads[0].delivering.size
    assert task.loads[0].delivered(8e-3) > 1e-3


def test_a_recording_as_load_without_a_fit_is_refused(tmp_path: Path) -> None:
    load = '[[load]]\nspeed_rpm = 900\nrecording = "A_1000rpm"\n'
    with pytest.raises(Refusal, match="found 'A_1000rpm' without a fit, expected one; name it with --from"):
        read_task(design_file(tmp_path, lift=LIFT, free=FREE, load=load, aims=AIM, pump=PUMP))


def test_a_fitted_cam_that_carries_no_pressure_is_refused_by_the_key_of_its_recording(tmp_path: Path) -> None:
    fitted = fitted_pump(read_known(known_fit(tmp_path)))
    spike = SimpleNamespace(evaluate=lambda theta: np.where(theta == 0.0, 1e-3, 0.0))
    path = design_file(tmp_path, lift=LIFT, free=FREE, load="[[load]]\nspeed_rpm = 900\n", aims=AIM, pump=PUMP)
    with pytest.raises(Refusal, match=r"recording: its cam has no rise and return to carry it by"):
        read_task(path, replace(fitted, law=spike))

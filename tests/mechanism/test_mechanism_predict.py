"""A pump file in, a prediction out; and every way a pump file can be wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.config_pump import load_pump_config, read_lift_table, read_pressure_curve
from pipeline.mechanism import solve_rigid
from pipeline.mechanism.predict import cam_of, mounting_of, predict, prediction_document, pressure_at, sweep_rows
from pipeline.records import Refusal
from pipeline.units import RPM

CALIBRATION = Path(__file__).resolve().parents[2] / "calibration"
PAPER = CALIBRATION / "paper_pump.toml"
TABLE = "# measured, resolution 2 um\ncam_angle_deg,lift_mm\n" + "\n".join(
    f"{angle},{4.0 * (1.0 - np.cos(np.deg2rad(angle))):.3f}" for angle in range(0, 360, 2)
)


def pump_file(folder, *changes, name="pump.toml"):
    """The paper's pump file with pieces of text replaced."""
    text = PAPER.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / name
    path.write_text(text)
    return path


def with_table(folder, extra=""):
    (folder / "lift.csv").write_text(TABLE)
    head, tail = PAPER.read_text().split("[cam]")
    columns = 'cam_table_angle_column = "cam_angle_deg"\ncam_table_lift_column = "lift_mm"\n'
    entry = f'cam_table = "lift.csv"\n{columns}{extra}\n'
    path = folder / "pump.toml"
    path.write_text(head + entry + "[mounting]" + tail.split("[mounting]")[1])
    return path


def test_paper_pump_reaches_the_torque_levels_of_the_paper():
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    row = sweep_rows(predict(load_pump_config(PAPER), [500.0 * RPM], curve))[0]
    # A p y' of 600 bar on 8 mm at the peak slope of the flank, plus the spring
    assert row["pump_torque_max_nm"] == pytest.approx(53.6, rel=0.01)
    assert row["pump_torque_max_deg"] == pytest.approx(30.0, abs=1.0)
    # the paper reads "about -5 N m" off its model on the return stroke
    assert -6.0 < row["shaft_torque_min_nm"] < -4.0
    assert not row["contact_lost"]


def test_prediction_is_the_rigid_solution():
    config = load_pump_config(PAPER)
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    prediction = predict(config, [50.0, 90.0], curve)
    alone = solve_rigid(
        config.pump, cam_of(config), prediction.theta, prediction.pressure, 90.0, mounting=mounting_of(config)
    )
    assert np.array_equal(prediction.pumps[1].torque, alone.torque)
    assert np.allclose(prediction.shaft_torque[1], alone.torque, rtol=1e-12, atol=1e-12)


def test_document_is_json_with_null_for_what_never_happens():
    document = prediction_document(predict(load_pump_config(PAPER), [50.0]))
    text = json.dumps(document, allow_nan=False)
    assert json.loads(text)["schema"] == "camtorque.predict/1"
    assert {f["code"] for f in document["findings"]} >= {"no_pressure", "roller_assumed", "concave_flank"}
    assert document["jump"]["speed_rpm"] == pytest.approx(document["jump_without_pressure"]["speed_rpm"])
    assert len(document["curves"]["theta_deg"]) == len(document["curves"]["hertz_gpa"][0]) == 720


def test_contact_loss_is_reported_with_its_speed():
    prediction = predict(load_pump_config(PAPER), [3000.0 * RPM])
    assert prediction.pumps[0].contact_lost
    assert "contact_lost" in {f.code for f in prediction.findings}
    assert prediction.jump.speed < 3000.0 * RPM


def test_undercut_cam_is_an_error_and_its_stress_null(tmp_path):
    path = pump_file(
        tmp_path,
        ("roller_radius_m = 0.008", "roller_radius_m = 0.020"),
        ("angle_deg = 55.0", "angle_deg = 30.0"),
        ("angle_deg = 225.0", "angle_deg = 250.0"),
    )
    document = prediction_document(predict(load_pump_config(path), [50.0]))
    assert document["undercut"]
    assert document["surface_radius_min_mm"] is None
    assert None in document["curves"]["hertz_gpa"][0]


def test_pumps_on_one_shaft_elastic_or_rigid(tmp_path):
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    shaft = "[shaft]\nphases_deg = [0, 120, 240]\n"
    stiff = "stiffness_N_m_per_rad = 1e7\ndamping_N_m_s_per_rad = 1.0\n"
    rigid = pump_file(tmp_path, ("[mounting]", f"{shaft}[mounting]"))
    elastic = pump_file(tmp_path, ("[mounting]", f"{shaft}{stiff}[mounting]"), name="elastic.toml")
    torque = [predict(load_pump_config(path), [50.0], curve).shaft_torque[0] for path in (rigid, elastic)]
    alone = predict(load_pump_config(PAPER), [50.0], curve).shaft_torque
    assert np.mean(torque[0]) == pytest.approx(3.0 * np.mean(alone), rel=1e-6)
    assert np.max(np.abs(torque[0] - torque[1])) < 5e-3 * np.max(torque[0])


def test_lift_table_states_its_resolution(tmp_path):
    table = load_pump_config(with_table(tmp_path)).cam_table
    assert table.resolution == 2e-6
    assert load_pump_config(with_table(tmp_path, "cam_table_resolution_m = 5e-6")).cam_table.resolution == 5e-6
    (tmp_path / "plain.csv").write_text("angle_deg;lift_mm\n0;0,00\n120;1,25\n240;1,20\n360;0,00\n")
    plain = read_lift_table(tmp_path / "plain.csv", "angle_deg", "lift_mm")
    assert plain.resolution == pytest.approx(1e-5)
    assert plain.theta.size == 3
    assert plain.lift[1] == pytest.approx(1.25e-3)
    assert np.isfinite(predict(load_pump_config(with_table(tmp_path)), [50.0]).shaft_torque).all()


def test_pressure_between_its_points_does_not_overshoot():
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    dense = pressure_at(curve, np.linspace(-7.0, 7.0, 30001))
    assert dense.min() >= curve.pressure.min()
    assert dense.max() <= curve.pressure.max()
    assert np.allclose(pressure_at(curve, curve.theta + 2.0 * np.pi), curve.pressure, rtol=1e-9)


def test_tangent_cam_from_a_file(tmp_path):
    head, tail = PAPER.read_text().split("[cam]")
    cam = '[cam]\n[[cam.sections]]\nkind = "tangent"\nrise_mm = 8.0\nnose_radius_mm = 5.0\n'
    path = tmp_path / "tangent.toml"
    path.write_text(head + cam + "[mounting]" + tail.split("[mounting]")[1])
    with pytest.raises(Refusal, match=r"add up to .* expected 360; adjust the last dwell"):
        predict(load_pump_config(path), [50.0])


REFUSED = [
    (("base_circle_radius_m = 0.020\n", ""), r"\[pump\] lacks base_circle_radius_m; add them"),
    (("base_circle_radius_m", "base_circel_radius_m"), "did you mean 'base_circle_radius_m'"),
    (("cam_mass_kg = 0.25", 'cam_mass_kg = "heavy"'), "cam_mass_kg is 'heavy', expected a finite number"),
    (("cam_mass_kg = 0.25", "cam_mass_kg = -0.25"), r"cam_mass_kg is -0\.25, expected a positive value"),
    (('"camtorque-pump/1"', '"other/1"'), "schema is 'other/1', expected 'camtorque-pump/1'"),
    (('rotation = "positive"', 'rotation = "left"'), "rotation is 'left', expected 'positive' or 'negative'"),
    (("gravity_m_per_s2 = [0.0, 0.0]", "gravity_m_per_s2 = 9.81"), "expected two numbers along X1 and Y1"),
    (("[mounting]", "[shaft]\nphases_deg = []\n[mounting]"), "expected a list with one angle per pump"),
    (("[mounting]", "[shaft]\nstiffness_N_m_per_rad = -1\n[mounting]"), "expected a positive stiffness"),
    (("[mounting]", "[mounting]\nspring_mass_kg = -1"), "spring_mass_kg is -1.0, expected 0 or more"),
    (('kind = "dwell"', "kind = 3"), "has kind 3, expected its name"),
    (("[pump]", "[pump"), "not valid TOML"),
    (("[pump]", '[pump]\ncam_table = "x.csv"'), "names a cam_table but no cam_table_angle_column"),
    (("[cam]   ", "[cam]\nstart_degrees = 3\n#"), "did you mean 'start_deg'"),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_wrong_pump_file_is_refused(tmp_path, change, message):
    with pytest.raises(Refusal, match=message):
        load_pump_config(pump_file(tmp_path, change))


def test_pump_needs_exactly_one_cam(tmp_path):
    path = with_table(tmp_path)
    path.write_text(
        path.read_text().replace("[mounting]", '[[cam.sections]]\nkind = "dwell"\nangle_deg = 360\n[mounting]')
    )
    with pytest.raises(Refusal, match=r"expected either pump.cam_table or cam.sections"):
        load_pump_config(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("angle_deg,lift_mm\n0,0\n10,x\n", "lift_mm in data row 2 is 'x', expected a number"),
        ("angle_deg,lift_mm\n0,0\n10\n", "row 2 has 1 cells, expected 2"),
        ("angle_deg,height\n0,0\n", "no column 'lift_mm', found angle_deg, height"),
        ("angle_deg,lift_mm\n10,0\n0,0\n", "has to increase strictly within one revolution"),
    ],
)
def test_wrong_lift_table_is_refused(tmp_path, content, message):
    (tmp_path / "lift.csv").write_text(content)
    with pytest.raises(Refusal, match=message):
        read_lift_table(tmp_path / "lift.csv", "angle_deg", "lift_mm")


def test_columns_without_unit_and_missing_files_are_refused(tmp_path):
    (tmp_path / "lift.csv").write_text("angle,height\n0,0\n1,1\n")
    with pytest.raises(Refusal, match="'angle' states no unit"):
        read_lift_table(tmp_path / "lift.csv", "angle", "height")
    (tmp_path / "lift2.csv").write_text("angle_deg,height\n0,0\n1,1\n")
    with pytest.raises(Refusal, match="'height' states no unit"):
        read_lift_table(tmp_path / "lift2.csv", "angle_deg", "height")
    with pytest.raises(Refusal, match="no such file, expected a pump file"):
        load_pump_config(tmp_path / "none.toml")
    (tmp_path / "p.csv").write_text("cam_angle_deg,pressure_bar\n10,0\n0,0\n")
    with pytest.raises(Refusal, match="cam_angle_deg has to increase strictly"):
        read_pressure_curve(tmp_path / "p.csv")


@pytest.mark.parametrize("speeds", [[], [0.0], [-5.0], [float("nan")]])
def test_speeds_have_to_be_positive(speeds):
    with pytest.raises(Refusal, match="expected at least one positive speed"):
        predict(load_pump_config(PAPER), speeds)

"""A pump file in, a prediction out; and every way a pump file can be wrong."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.commands import arguments
from camtorque.config.pump import PressureCurve, load_pump_config
from camtorque.config.tables import Refusals
from camtorque.ingest.pump_file import read_pressure_curve, read_pump
from camtorque.mechanism.predict import cam_of, mounting_of, predict, prediction_document, pressure_at, sweep_rows
from camtorque.mechanism.shaft import METHODS
from camtorque.mechanism.solve import solve_rigid
from camtorque.records import Refusal
from camtorque.units import RPM

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


def with_table(folder):
    (folder / "lift.csv").write_text(TABLE)
    head, tail = PAPER.read_text().split("[cam]")
    columns = 'cam_table_angle_column = "cam_angle_deg"\ncam_table_lift_column = "lift_mm"\n'
    entry = f'cam_table = "lift.csv"\n{columns}\n'
    path = folder / "pump.toml"
    path.write_text(head + entry + "[mounting]" + tail.split("[mounting]")[1])
    return path


def test_a_cam_that_is_no_table_hides_nothing_else(tmp_path):
    head, tail = PAPER.read_text().split("[cam]")
    head = re.sub(r"(?m)^plunger_diameter_m.*$", "", head).replace("\n[pump]", "\ncam = 3\n[pump]")
    path = tmp_path / "pump.toml"
    path.write_text(head + "[mounting]" + tail.split("[mounting]")[1])
    with pytest.raises(Refusals, match="plunger_diameter_m: this key is missing") as refused:
        load_pump_config(path)
    assert len(refused.value.problems) == 2
    assert "cam: found 3, expected a table" in refused.value.problems[1]


def test_a_refused_pump_file_names_all_that_is_wrong_with_it(tmp_path):
    text = re.sub(r"(?m)^cam_mass_kg.*$", "cam_mas_kg = 1.0", PAPER.read_text())
    path = tmp_path / "pump.toml"
    path.write_text(re.sub(r"(?m)^spring_preload_N.*$", "", text))
    told = r"unknown key 'cam_mas_kg'.*; also .*spring_preload_N: this key is missing"
    with pytest.raises(Refusal, match=told) as refused:
        load_pump_config(path)
    assert "camtorque check" not in str(refused.value), "it takes recordings, and refuses a pump file"


def test_paper_pump_reaches_the_torque_levels_of_the_paper():
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    row = sweep_rows(predict(load_pump_config(PAPER), [500.0 * RPM], curve))[0]
    # A p y' of 600 bar on 8 mm at the peak slope of the flank, plus the spring
    assert row["pump_torque_max_nm"] == pytest.approx(53.6, rel=0.01)
    assert row["pump_torque_max_deg"] == pytest.approx(30.0, abs=1.0)
    # the paper reads "about -5 N m" off its model on the return stroke
    assert -6.0 < row["shaft_torque_min_nm"] < -4.0
    assert not row["contact_lost"]


def test_a_pressure_that_is_another_one_a_revolution_on_is_refused(tmp_path):
    """The row at 360 degrees was left out without a word, whatever it said."""
    file, rows = tmp_path / "p.csv", "cam_angle_deg,pressure_bar\n0,{}\n90,500\n180,100\n360,{}\n"
    file.write_text(rows.format(60, 65))
    assert read_pressure_curve(file).pressure.tolist() == pytest.approx([60e5, 500e5, 100e5])
    file.write_text(rows.format(60, 90))
    with pytest.raises(Refusal, match="found 60 bar at 0 deg and 90 bar at 360 deg, which are one angle, expected"):
        read_pressure_curve(file)


def test_prediction_is_the_rigid_solution():
    config = load_pump_config(PAPER)
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    prediction = predict(config, [50.0, 90.0], curve)
    alone = solve_rigid(
        config.pump, cam_of(config), prediction.theta, prediction.pressure, 90.0, mounting=mounting_of(config)
    )
    assert np.array_equal(prediction.pumps[1].torque, alone.torque)
    assert np.allclose(prediction.shaft_torque[1], alone.torque, rtol=1e-12, atol=1e-12)


def test_every_method_predicts_the_same_torque_without_friction():
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    assert set(arguments.METHODS) == set(METHODS)
    found = {m: predict(load_pump_config(PAPER), [50.0], curve, n_theta=360, method=m) for m in METHODS}
    for method in ("recursion", "denoc"):
        assert np.allclose(found[method].shaft_torque, found["closed"].shaft_torque, rtol=0.0, atol=1e-10)


def test_friction_of_the_pump_file_adds_to_torque_and_forces(tmp_path):
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    table = "[friction]\nguide = 0.1\nbearing_arm_um = 200\npin_arm_um = 30\n[mounting]"
    config = load_pump_config(pump_file(tmp_path, ("[mounting]", table)))
    stated = prediction_document(predict(config, [50.0]))["friction"]
    assert stated == pytest.approx({"guide": 0.1, "bearing_arm_um": 200.0, "pin_arm_um": 30.0})
    assert config.friction == pytest.approx((0.1, 2e-4, 3e-5))
    rough, smooth = (predict(c, [50.0], curve).pumps[0] for c in (config, load_pump_config(PAPER)))
    # the causes that are not friction stay what they were
    assert np.allclose(rough.by_cause["pressure"], smooth.by_cause["pressure"], rtol=1e-12, atol=1e-12)
    gain = np.max(rough.torque - smooth.torque) / np.max(smooth.torque)
    assert 0.04 < gain < 0.08
    assert np.max(rough.forces.contact_normal) > 1.03 * np.max(smooth.forces.contact_normal)
    with pytest.raises(Refusal, match="method 'denoc' is frictionless, found friction"):
        predict(config, [50.0], curve, method="denoc")


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
    with pytest.raises(Refusal, match="method 'denoc' knows rigid shafts only, found a stiffness"):
        predict(load_pump_config(elastic), [50.0], curve, method="denoc")


def test_a_follower_that_only_the_swing_of_the_shaft_takes_off_its_cam_is_refused():
    config = replace(load_pump_config(PAPER), shaft_stiffness=2000.0, shaft_damping=0.3)
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    slow = predict(config, [1000.0 * RPM], curve)
    assert [row.code for row in slow.findings if "a cam that turns evenly" in row.text] == ["forces_at_even_speed"]
    assert not predict(replace(config, shaft_stiffness=np.inf), [1500.0 * RPM], curve).pumps[0].contact_lost
    with pytest.raises(Refusal, match="at 1500 rpm the follower leaves the cam, and flight on an elastic shaft"):
        predict(config, [1500.0 * RPM], curve)


def test_lift_table_is_read_with_its_resolution(tmp_path):
    config, findings = read_pump(with_table(tmp_path))
    assert config.cam_table.resolution == 2e-6
    assert findings == ()
    assert np.isfinite(predict(config, [50.0]).shaft_torque).all()
    assert np.max(config.cam_table.lift) == pytest.approx(8e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("plunger_diameter_m = 0.008", "plunger_diameter_m = 0.08"), "plunger diameter over base circle radius is 4,"),
        (("cam_inertia_kg_m2 = 5e-5", "cam_inertia_kg_m2 = 0.5"), "cam inertia over its mass times base circle"),
        (("rise_mm = 8.0", "rise_mm = 80.0"), "largest lift over base circle radius is 4,"),
    ],
)
def test_sizes_that_no_pump_has_are_refused_without_a_recording(tmp_path, change, message):
    with pytest.raises(Refusal, match=rf"pump\.toml \[pump\]: {message}"):
        read_pump(pump_file(tmp_path, change))


def test_a_lift_table_in_another_unit_is_refused_without_a_recording(tmp_path):
    path = with_table(tmp_path)
    table = tmp_path / "lift.csv"
    head, *rows = table.read_text().splitlines()
    smaller = (f"{row.split(',')[0]},{float(row.split(',')[1]) / 1000.0:.9f}" for row in rows[1:])
    table.write_text("\n".join([head, rows[0], *smaller]) + "\n")
    with pytest.raises(Refusal, match=r"largest lift over base circle radius is .*the unit of the lift table"):
        read_pump(path)


def test_unusual_sizes_are_told_without_a_recording(tmp_path):
    (found,) = read_pump(pump_file(tmp_path, ("follower_mass_kg = 0.075", "follower_mass_kg = 0.75")))[1]
    assert (found.code, found.severity) == ("pump_unusual", "warning")
    assert "follower_mass_kg" in found.text
    path = pump_file(tmp_path, ("roller_radius_m = 0.008", "roller_radius_m = 0.016"))
    assert any("is it the diameter?" in row.text for row in read_pump(path)[1])


@pytest.mark.parametrize(
    ("cam", "roller", "told"),
    [
        ("210e9", "310e9", []),  # ceramics on steel
        ("210e9", "650e9", []),
        ("2.1e9", "210e9", ["the cam over that of steel is 0.01", "the roller over that of the cam is 100"]),
        ("900e9", "900e9", ["the cam over that of steel is 4.29", "the roller over that of steel is 4.29"]),
        ("120e9", "600e9", ["the roller over that of the cam is 5"]),
    ],
)
def test_moduli_of_no_usual_pair_are_told(tmp_path, cam, roller, told):
    keys = (("youngs_modulus_cam_Pa = 210e9", cam), ("youngs_modulus_roller_Pa = 210e9", roller))
    found = read_pump(pump_file(tmp_path, *((old, f"{old.split('=')[0]}= {value}") for old, value in keys)))[1]
    assert [row.code for row in found] == ["pump_unusual"] * len(told)
    assert all(row.text.startswith(f"Young's modulus of {text}, usual") for row, text in zip(found, told, strict=True))


def test_unread_lift_table_is_refused(tmp_path):
    with pytest.raises(Refusal, match="its lift table has not been read"):
        predict(load_pump_config(with_table(tmp_path)), [50.0])


def test_sections_need_no_reading():
    config, findings = read_pump(PAPER)
    assert config == load_pump_config(PAPER)
    assert findings == ()


def test_pressure_between_its_points_does_not_overshoot():
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    dense = pressure_at(curve, np.linspace(-7.0, 7.0, 30001))
    assert dense.min() >= curve.pressure.min()
    assert dense.max() <= curve.pressure.max()
    assert np.allclose(pressure_at(curve, curve.theta + 2.0 * np.pi), curve.pressure, rtol=1e-9)


def test_a_cam_without_its_return_is_refused(tmp_path):
    head, *sections = PAPER.read_text().split("[[cam.sections]]")
    path = tmp_path / "no_return.toml"
    path.write_text("[[cam.sections]]".join([head, *sections[:2], sections[3]]))
    with pytest.raises(Refusal, match="add up to 305"):
        predict(read_pump(path)[0], [50.0])


def test_tangent_cam_from_a_file(tmp_path):
    head, tail = PAPER.read_text().split("[cam]")
    cam = '[cam]\n[[cam.sections]]\nkind = "tangent"\nrise_mm = 8.0\nnose_radius_mm = 5.0\n'
    path = tmp_path / "tangent.toml"
    path.write_text(head + cam + "[mounting]" + tail.split("[mounting]")[1])
    with pytest.raises(Refusal, match=r"add up to .* expected 360; adjust the last dwell") as refused:
        predict(load_pump_config(path), [50.0])
    taken = float(re.search(r"add up to ([\d.]+) deg", str(refused.value))[1])
    dwell = f'[[cam.sections]]\nkind = "dwell"\nangle_deg = {360.0 - taken:.6f}\n'
    path.write_text(head + cam + dwell + "[mounting]" + tail.split("[mounting]")[1])
    path_of_lobe = predict(load_pump_config(path), [50.0]).kinematics
    assert 1e3 / np.max(path_of_lobe.surface_curvature) == pytest.approx(5.0, rel=1e-6)
    path.write_text(path.read_text().replace("follower_offset_m = 0.0", "follower_offset_m = 0.005"))
    with pytest.raises(Refusal, match=r"found 'tangent' beside a follower_offset_m of 0\.005, expected 0"):
        predict(load_pump_config(path), [50.0])


def test_the_height_of_the_guide_counts_from_the_axis_of_the_cam(tmp_path):
    path = pump_file(tmp_path, ("[mounting]", '[mounting]\nguide_height_m = "?"'))
    with pytest.raises(Refusal, match="guide_height_m: is still '\\?'; middle of the guide above the cam's axis"):
        load_pump_config(path)
    path = pump_file(tmp_path, ("[mounting]", "[mounting]\nguide_height_m = 0.06"))
    found = predict(load_pump_config(path), [50.0], n_theta=360)
    moment, force = found.pumps[0].forces.guide_moment, found.pumps[0].forces.guide
    assert np.allclose(moment, (0.06 - found.kinematics.centre_height) * force, rtol=1e-12)


REFUSED = [
    (("base_circle_radius_m = 0.020\n", ""), r"\[pump\] base_circle_radius_m: this key is missing"),
    (("base_circle_radius_m", "base_circel_radius_m"), "did you mean 'base_circle_radius_m'"),
    (("cam_mass_kg = 0.25", 'cam_mass_kg = "heavy"'), "cam_mass_kg: found 'heavy', expected a number"),
    (("cam_mass_kg = 0.25", "cam_mass_kg = -0.25"), r"cam_mass_kg: found -0\.25, expected a number from 0.001 to"),
    (('"camtorque-pump/1"', '"other/1"'), "schema is 'other/1', expected 'camtorque-pump/1'"),
    (('rotation = "positive"', 'rotation = "left"'), "found 'left', expected one of positive, negative"),
    (("gravity_m_per_s2 = [0.0, 0.0]", "gravity_m_per_s2 = 9.81"), r"found 9\.81, expected two numbers"),
    (("gravity_m_per_s2 = [0.0, 0.0]", "gravity_m_per_s2 = [1.0]"), "expected two numbers in brackets"),
    (("[mounting]", "[shaft]\nphases_deg = []\n[mounting]"), "expected a list of numbers"),
    (("[mounting]", "[shaft]\nphases_deg = [60, 180]\n[mounting]"), "found 60 for the first pump, expected 0"),
    (("[mounting]", "[shaft]\nstiffness_N_m_per_rad = -1\n[mounting]"), "found -1, expected a number from 1 to"),
    (("[mounting]", "[mounting]\nspring_mass_kg = -1"), "spring_mass_kg: found -1, expected a number from 0 to"),
    (('kind = "dwell"', "kind = 3"), "kind: found 3, expected text"),
    (("angle_deg = 20.0", "angle_deg = 20.0\nrise_mm = 3"), "rise_mm: found 3 for a section of kind 'dwell', where"),
    (("rise_mm = 8.0", "rise_mm = 8.0\nnose_radius_mm = 2"), "nose_radius_mm: found 2 for a section of kind 'poly"),
    (("[pump]", "[pump"), "is not valid TOML"),
    (("[pump]", '[pump]\ncam_table = "x.csv"'), "expected either cam_table in"),
    (("[cam]   ", "[cam]\nstart_degrees = 3\n#"), "did you mean 'start_deg'"),
    (("[mounting]", "[friction]\nguide = 1.5\n[mounting]"), r"guide: found 1\.5, expected a number from 0 to 0.999"),
    (("[mounting]", "[weather]\n[mounting]"), "unknown key 'weather'"),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_wrong_pump_file_is_refused(tmp_path, change, message):
    with pytest.raises(Refusal, match=message):
        load_pump_config(pump_file(tmp_path, change))


def test_pump_needs_exactly_one_cam(tmp_path):
    path = tmp_path / "pump.toml"
    head, tail = PAPER.read_text().split("[cam]")
    path.write_text(head + "[mounting]" + tail.split("[mounting]")[1])
    with pytest.raises(Refusal, match="expected either cam_table in"):
        load_pump_config(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("cam_angle_deg,pressure_bar\n10,0\n0,0\n", "cam_angle_deg has to increase strictly"),
        ("cam_angle_deg,pressure_bar\n0,-600\n90,5\n", r"goes down to -600 bar, expected gauge pressures of -1 bar"),
        (
            "cam_angle_deg,pressure_psi\n0,0\n10,0\n",
            "no column 'pressure_bar', convert the values of 'pressure_psi'; there are cam_angle_deg",
        ),
    ],
)
def test_wrong_pressure_curve_is_refused(tmp_path, content, message):
    (tmp_path / "p.csv").write_text(content)
    with pytest.raises(Refusal, match=message):
        read_pressure_curve(tmp_path / "p.csv")


def test_a_measured_line_that_falls_a_little_below_vacuum_is_read(tmp_path):
    (tmp_path / "p.csv").write_text("cam_angle_deg,pressure_bar\n0,-9.3\n90,926\n")  # the sensor's zero is off
    assert read_pressure_curve(tmp_path / "p.csv").pressure[0] == pytest.approx(-9.3e5)


@pytest.mark.parametrize(("turned", "told"), [(0, False), (20, False), (-90, True), (90, True), (180, True)])
def test_a_pressure_that_the_plunger_does_not_make_is_told(turned, told):
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    pressure = np.interp(curve.theta - np.radians(turned), curve.theta, curve.pressure, period=2.0 * np.pi)
    findings = predict(load_pump_config(PAPER), [50.0], replace(curve, pressure=pressure)).findings
    found = {row.code: row.text for row in findings}
    assert ("pressure_misplaced" in found) == told
    assert not told or " % of its rises are where the plunger rises, expected 60 %" in found["pressure_misplaced"]


def test_a_rail_that_rings_has_no_place(tmp_path):
    theta = np.radians(np.arange(0.0, 360.0, 1.0))
    curve = PressureCurve(theta, 1e8 * (1.0 + 0.1 * np.exp(-(((theta - 4.0) / 0.2) ** 2))))
    assert "pressure_misplaced" not in {row.code for row in predict(load_pump_config(PAPER), [50.0], curve).findings}


@pytest.mark.parametrize(("width", "told"), [(0.005, False), (0.0015, True)])
def test_a_contact_stress_that_no_steel_stands_is_told(width, told):
    config = load_pump_config(PAPER)
    narrow = replace(config, pump=replace(config.pump, roller_width=width))
    found = predict(narrow, [50.0], read_pressure_curve(CALIBRATION / "paper_pressure.csv")).findings
    texts = [row.text for row in found if row.code == "contact_stress_unusual"]
    assert bool(texts) == told
    assert all(
        re.search(r"reaches 3\.\d+ GPa at 477 rpm, rolling steel has 0.5 to 2.5; check roller_width_m", t)
        for t in texts
    )


def test_missing_files_are_refused(tmp_path):
    with pytest.raises(Refusal, match="no such file; expected a pump file"):
        load_pump_config(tmp_path / "none.toml")


@pytest.mark.parametrize("speeds", [[], [0.0], [-5.0], [float("nan")]])
def test_speeds_have_to_be_positive(speeds):
    with pytest.raises(Refusal, match=r"found the speeds .* rpm, expected at least one positive speed"):
        predict(load_pump_config(PAPER), speeds)


def test_pressure_angle_beyond_45_degrees_is_told():
    config = load_pump_config(PAPER)
    found = {item.code: item.text for item in predict(config, [50.0]).findings}
    assert "steep_flank" not in found
    small = replace(config, pump=replace(config.pump, base_circle_radius=2e-3, roller_radius=1e-3))
    found = {item.code: item.text for item in predict(small, [50.0]).findings}
    assert "pressure angle reaches" in found["steep_flank"]
    assert "jams the follower" in found["steep_flank"]


def test_friction_that_jams_is_that_of_the_rise_however_steep_the_return(tmp_path):
    # a follower jams while it is pushed out; on its return friction helps the cam
    path = pump_file(
        tmp_path,
        ("base_circle_radius_m = 0.020", "base_circle_radius_m = 0.012"),
        ("angle_deg = 60.0", "angle_deg = 120.0"),
        ("angle_deg = 55.0", "angle_deg = 35.0"),
        ("angle_deg = 225.0", "angle_deg = 185.0"),
    )
    prediction = predict(load_pump_config(path), [50.0])
    rise = prediction.kinematics.tan_pressure_angle.max()
    assert -prediction.kinematics.tan_pressure_angle.min() > 1.0 > rise
    text = {item.code: item.text for item in prediction.findings}["steep_flank"]
    assert f"a guide friction of {1.0 / rise:.2g} jams the follower on its rise" in text


@pytest.mark.parametrize(
    ("theta_deg", "bar", "told"),
    [
        ([0.0, 180.0], [0.0, 300.0], True),
        ([0.0, 180.0], [5.0, 5.0], False),
        # base circle without points, flanks with them
        ([0.0, 20.0, 30.0, 40.0, 50.0], [0.0, 5.0, 300.0, 200.0, 0.0], False),
    ],
)
def test_pressure_curve_with_gaps_is_told(theta_deg, bar, told):
    curve = PressureCurve(np.radians(theta_deg), 1e5 * np.array(bar))
    found = {item.code: item.text for item in predict(load_pump_config(PAPER), [50.0], curve).findings}
    assert ("pressure_curve_coarse" in found) == told
    if told:
        assert "2 points and changes by 100 % of its swing within 180 degrees" in found["pressure_curve_coarse"]


@pytest.mark.parametrize("n_theta", [0, 5, 35, "3600"])
def test_a_grid_that_is_none_is_refused(n_theta) -> None:
    with pytest.raises(Refusal, match="expected a whole number of 36 points or more"):
        predict(read_pump(PAPER)[0], [1000.0 * RPM], n_theta=n_theta)


def test_an_unknown_section_is_refused_with_its_file(tmp_path) -> None:
    config, _ = read_pump(PAPER)
    strange = replace(config, sections=(replace(config.sections[0], kind="dwel"), *config.sections[1:]))
    with pytest.raises(Refusal, match=r"paper_pump.toml \[\[cam.sections\]\] kind: found 'dwel'.* dwell, tangent"):
        cam_of(strange)

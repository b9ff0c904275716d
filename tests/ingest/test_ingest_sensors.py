"""Sheet and certificate to SI with uncertainty; contradictions between papers are refused."""

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.config import SensorRef
from camtorque.ingest import read_recording
from camtorque.ingest.sensitivity import read_certificate
from camtorque.ingest.sensors import certificate_age, read_sensor
from camtorque.ingest.zeros import zero_of_readings
from camtorque.records import Refusal
from camtorque.units import ATMOSPHERE
from damaged.logs import CALIBRATION, Plan, clean_log, edit, write_folder

TORQUE, PRESSURE = "torque_T22-40117.toml", "pressure_K4067-40117.toml"


@pytest.fixture
def papers(tmp_path: Path) -> Path:
    folder = tmp_path / "papers"
    shutil.copytree(CALIBRATION, folder)
    return folder


def reference(folder: Path, quantity: str = "torque", before=None, after=None) -> SensorRef:
    name, serial = {"torque": (TORQUE, "T22-40117"), "pressure": (PRESSURE, "K4067-40117")}[quantity]
    return SensorRef(quantity, serial, folder / name, before, after)


def test_gain_is_the_line_through_all_points():
    calibration = read_sensor(reference(CALIBRATION)).calibration
    points = np.loadtxt(CALIBRATION / "torque_T22-40117.csv", delimiter=",", skiprows=2)
    # normal equations written out, another way than the product's
    load, volts = points.T
    slope = np.sum((load - load.mean()) * (volts - volts.mean())) / np.sum((load - load.mean()) ** 2)
    assert calibration.gain == pytest.approx(1.0 / slope, rel=1e-12)
    # k=2 of 0.05 % halved, and the scatter of the fit on top
    assert 2.5e-4 < calibration.gain_relative_std < 3.0e-4
    assert calibration.range_min == -200.0
    assert calibration.output_max_volts == 5.0
    assert (calibration.cutoff_hz, calibration.filter_order) == (1000.0, 2)
    assert calibration.delay_std == pytest.approx(0.03 * 0.45e-3 / math.sqrt(3.0))


@pytest.mark.parametrize(
    ("stated", "order"),
    [("low-pass, 4th order, Bessel", 4), ("Fourth-order Butterworth", 4), ("6-pole Bessel", 6), ("Bessel", 0),
     ("Butterworth, order 4", 4),
     ("Tiefpass 4. Ordnung", 4)],
)  # fmt: skip
def test_the_order_of_a_low_pass_is_read_as_sheets_write_it(papers: Path, stated: str, order: int):
    edit(papers / TORQUE, "low-pass, 2nd order", stated)
    edit(papers / TORQUE, "group_delay_s = 0.00045", "group_delay_s = 0.0009")
    assert read_sensor(reference(papers)).calibration.filter_order == order


def test_pressure_is_in_pascal_and_an_unstated_delay_tolerance_is_told():
    sensor = read_sensor(reference(CALIBRATION, "pressure"))
    assert sensor.calibration.gain == pytest.approx(200e5, rel=5e-3)
    assert sensor.calibration.range_max == 2000e5
    assert math.isnan(sensor.calibration.cutoff_hz)
    assert [finding.code for finding in sensor.findings] == ["delay_tolerance_assumed"]


def test_zero_from_standstill_or_certificate():
    both = read_sensor(reference(CALIBRATION, before=-0.02, after=-0.03)).calibration
    assert both.zero_source == "standstill"
    assert both.zero_volts == pytest.approx(-0.025)
    one = read_sensor(reference(CALIBRATION, before=-0.02)).calibration
    assert one.zero_volts == -0.02
    assert one.zero_std > both.zero_std
    none = read_sensor(reference(CALIBRATION)).calibration
    assert none.zero_source == "certificate"
    assert none.zero_std == pytest.approx(0.05 * none.gain / math.sqrt(3.0))
    thermal = read_sensor(reference(CALIBRATION, "pressure")).calibration
    assert thermal.zero_std == pytest.approx(0.0015 * 2000e5 / math.sqrt(3.0))


def scatter_by_quadrature(difference: float, least: float, most: float) -> float:
    """Return the standard error of a mean of two readings, by adding up over their unknown scatter."""
    scatter = np.geomspace(least, most, 200_001)
    weight = np.exp(-(difference**2) / (4.0 * scatter**2)) / scatter  # times ds/s, even on a logarithmic scale
    return float(np.sqrt(np.sum(weight * scatter**2) / np.sum(weight) / 2.0))


@pytest.mark.parametrize("difference", [0.0, 2e-4, 3e-3, 0.02])
def test_two_readings_that_agree_do_not_make_a_zero_exact(difference: float):
    zero, std = zero_of_readings([0.01, 0.01 + difference], 1e-4, 0.05)
    assert zero == pytest.approx(0.01 + 0.5 * difference)
    least, most = 1e-4 / math.sqrt(12.0), 0.05 / math.sqrt(3.0)
    assert std == pytest.approx(scatter_by_quadrature(difference, least, most), rel=1e-3)
    assert std > zero_of_readings([0.01, 0.01], 1e-5, 0.05)[1]  # what is noted finer is known better
    assert std < zero_of_readings([0.01], 1e-4, 0.05)[1] < zero_of_readings([], 1e-4, 0.05)[1]


def test_the_stated_zero_holds_the_true_one_whatever_its_scatter():
    rng = np.random.default_rng(3)
    scatter = np.exp(rng.uniform(np.log(1e-4 / math.sqrt(12.0)), np.log(0.05 / math.sqrt(3.0)), 4000))
    readings = np.round(scatter[:, None] * rng.standard_normal((4000, 2)) + rng.uniform(-5e-5, 5e-5, (4000, 1)), 4)
    stated = [zero_of_readings(list(pair), 1e-4, 0.05) for pair in readings]
    inside = np.mean([abs(zero) < 2.0 * std for zero, std in stated])
    assert 0.94 < inside < 0.99  # half of the difference as one standard uncertainty: 0.75


def test_an_absolute_sensor_shows_the_atmosphere_at_zero_gauge(papers: Path):
    gauge = read_sensor(reference(papers, "pressure")).calibration
    edit(papers / PRESSURE, '"gauge"', '"absolute"')
    absolute = read_sensor(reference(papers, "pressure")).calibration
    assert absolute.gain * (absolute.zero_volts - gauge.zero_volts) == pytest.approx(ATMOSPHERE)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (TORQUE, 'serial = "T22-40117"', 'serial = "T22-1"', "is the sheet of T22-1"),
        (TORQUE, 'quantity = "torque"', 'quantity = "pressure"', "names it for 'torque'"),
        (TORQUE, 'unit = "N m"', 'unit = "Nn"', "unknown unit 'Nn'"),
        (TORQUE, 'unit = "N m"', 'unit = "kN m"', "the certificate is in 'Nm', the sheet in 'kN m'"),
        (TORQUE, "nominal_range = [-200.0, 200.0]", "nominal_range = [200.0]", "expected two numbers"),
        (TORQUE, "= 0.025", "= 0.25", "unit or certificate is wrong"),
        (
            TORQUE,
            "nominal_range = [-200.0, 200.0]",
            "nominal_range = [200.0, -200.0]",
            "expected \\[lowest, highest\\]",
        ),
        (TORQUE, 'certificate = "torque_T22-40117.csv"', "", "nothing says what a volt means"),
        (TORQUE, "torque_T22-40117.csv", "none.csv", "no such file; expected a calibration certificate"),
        (TORQUE, '"2024-11-05"', '"last autumn"', "expected a date"),
        (TORQUE, "[sensor]", "[sensr]", "the table \\[sensor\\] is missing, is it 'sensr'"),
        ("torque_T22-40117.csv", "T22-40117", "T22-40118", "is the certificate of T22-40118"),
        ("torque_T22-40117.csv", "applied_torque_Nm", "applied_pressure_bar", "is about pressure"),
        ("torque_T22-40117.csv", "output_V", "reading", "expected columns applied_torque_<unit>"),
        ("torque_T22-40117.csv", "40.0,1.00292", "40.0,x", "is not a row of numbers"),
    ],
)
def test_contradictions_are_refused(papers: Path, file: str, old: str, new: str, message: str):
    edit(papers / file, old, new)
    with pytest.raises(Refusal, match=message):
        read_sensor(reference(papers))


@pytest.mark.parametrize("line", ["output_range_V = [-5.0, 5.0]\n", "nominal_range = [-200.0, 200.0]\n"])
def test_a_sheet_with_its_certificate_may_leave_a_range_open(papers: Path, line: str):
    with_range = read_sensor(reference(papers), "V", 4.0).calibration
    edit(papers / TORQUE, line, "")
    sensor = read_sensor(reference(papers), "V", 4.0)
    assert not sensor.findings
    assert sensor.calibration.gain == with_range.gain
    left_open = "output" in line
    assert sensor.calibration.output_max_volts == (math.inf if left_open else 5.0)
    assert sensor.calibration.range_max == pytest.approx(200.0 if left_open else 160.0, rel=0.01)


SHEET_NUMBERS = [line for line in (CALIBRATION / TORQUE).read_text().splitlines() if re.search(r"= -?[\d.e-]+$", line)]


@pytest.mark.parametrize("line", SHEET_NUMBERS)
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e308", "1" + "0" * 400, '"1"', "true", "[]", '"?"'])
def test_no_number_of_a_sheet_may_be_nonsense(papers: Path, line: str, value: str):
    key = line.split(" = ")[0]
    edit(papers / TORQUE, line, f"{key} = {value}")
    with pytest.raises(Refusal, match=key):
        read_sensor(reference(papers))


def test_an_unknown_sheet_key_is_a_finding(papers: Path):
    edit(papers / TORQUE, "zero_tolerance_V = 0.05", "zero_tolerance_V = 0.05\ngroup_delay_ms = 0.45")
    findings = read_sensor(reference(papers)).findings
    assert [finding.code for finding in findings] == ["unknown_key"]
    assert "did you mean 'group_delay_s'" in findings[0].text


def test_a_zero_beyond_the_sheet_is_a_finding():
    assert not read_sensor(reference(CALIBRATION, before=0.05, after=0.05)).findings
    inside = read_sensor(reference(CALIBRATION, before=0.05, after=0.05)).calibration
    found = read_sensor(reference(CALIBRATION, before=0.06, after=0.06))
    assert [finding.code for finding in found.findings] == ["zero_off_certificate"]
    assert found.calibration.zero_std == inside.zero_std
    # what lies beyond the tolerances of both zeros is an uncertainty of the one that is used
    far = read_sensor(reference(CALIBRATION, before=0.13, after=0.13))
    beyond = (far.calibration.zero_std**2 - inside.zero_std**2) ** 0.5
    assert beyond == pytest.approx(0.03 * far.calibration.gain, rel=0.05)
    assert "what lies beyond twice that (0.58 %) counts as its uncertainty" in far.findings[0].text


def test_a_zero_beyond_the_sheet_of_a_sensor_for_one_direction_is_a_finding(papers: Path):
    edit(papers / TORQUE, "nominal_range = [-200.0, 200.0]", "nominal_range = [-200.0, 0.0]")
    edit(papers / TORQUE, "output_range_V = [-5.0, 5.0]", "output_range_V = [-5.0, 0.0]")
    certificate = papers / "torque_T22-40117.csv"
    rows = [row for row in certificate.read_text().splitlines() if row[:1] in "#a-" or row.startswith("0.0")]
    certificate.write_text("\n".join(rows) + "\n")
    (found,) = read_sensor(reference(papers, before=0.06, after=0.06)).findings
    assert found.text.startswith("the standstill zero differs from the certificate's by 1.2 % of the range")
    with pytest.raises(Refusal, match=r"found 40 and 40 V, 8e\+02 % of the range off"):
        read_sensor(reference(papers, before=40.0, after=40.0))


def test_an_old_or_too_young_certificate_is_a_finding():
    sensor = read_sensor(reference(CALIBRATION))  # calibrated on 2024-11-05
    day = 86400.0
    stamp = 1_730_764_800.0  # 2024-11-05 UTC
    assert certificate_age(sensor, stamp + 100 * day, "log") == []
    for unknown in (None, 0.0):
        assert [f.code for f in certificate_age(sensor, unknown, "log")] == ["certificate_age_unknown"]
    assert "400 days old" in certificate_age(sensor, stamp + 400 * day, "log")[0].text
    assert "dated 3 days after the recording" in certificate_age(sensor, stamp - 3 * day, "log")[0].text


@pytest.mark.parametrize(("wrong", "told"), [("4.25000", True), ("4.02000", False)])
def test_a_point_that_the_other_points_contradict_is_a_finding(papers: Path, wrong: str, told: bool):
    edit(papers / "torque_T22-40117.csv", "160.0,4.01156", f"160.0,{wrong}")
    sensor = read_sensor(reference(papers))
    assert [finding.code for finding in sensor.findings] == ["certificate_point"] * told
    if told:
        assert re.search(r"point 5 .* 2\.4 % of the range .* moves the sensitivity by \+0\.56", sensor.findings[0].text)


@pytest.mark.parametrize(
    ("loads", "wrong"), [((0, 25, 50, 75, 100), 2), ((0, 20, 40, 80, 160), 1), ((0, 0, 0, 0, 200), -1)]
)
def test_a_slip_beside_the_only_far_load_is_found_and_repeated_zeros_are_no_slip(papers: Path, loads, wrong):
    scatter = np.array([0.5, -0.5, 0.3, -0.4, 0.2]) * 1e-5
    volts = 0.025 * np.array(loads) + scatter + 0.15 * (np.arange(5) == wrong)
    rows = "".join(f"{load},{volt:.6f}\n" for load, volt in zip(loads, volts, strict=True))
    head = "# certificate torque transducer T22-40117, k=2 uncertainty 0.05 % of nominal\napplied_torque_Nm,output_V\n"
    (papers / "torque_T22-40117.csv").write_text(head + rows)
    found = [row for row in read_sensor(reference(papers)).findings if row.code == "certificate_point"]
    assert len(found) == (wrong >= 0)
    assert all(f"point {wrong + 1} of the certificate" in row.text for row in found)


@pytest.mark.parametrize(
    "comment",
    ["k=2 uncertainty 0.05 % of nominal", "U = 0.05 % (k = 2)", "expanded 0.05 % (k=2), 45 % r.h.", "k=2,0.05 %",
     "Messunsicherheit 0,05 % (k=2)", "k = 2,0: 0,05 %"],
)  # fmt: skip
def test_the_uncertainty_is_the_figure_beside_its_coverage_factor(papers: Path, comment: str):
    rows = "".join(f"{load},{0.025 * load}\n" for load in (-200, 0, 200))
    certificate = papers / "torque_T22-40117.csv"
    certificate.write_text(f"# torque transducer T22-40117, {comment}\napplied_torque_Nm,output_V\n{rows}")
    assert read_certificate(certificate, "torque", "T22-40117", "N m", "voltage").reference_relative_std == (
        pytest.approx(2.5e-4)
    )
    certificate.write_text(f"# T22-40117 at k=2, 45 % r.h.\napplied_torque_Nm,output_V\n{rows}")
    with pytest.raises(Refusal, match="an uncertainty of 45 %, expected at most 5 %"):
        read_certificate(certificate, "torque", "T22-40117", "N m", "voltage")


@pytest.mark.parametrize(
    ("keys", "delay", "said"),
    [
        ({}, 0.5e-3, "0.5 ms +/- 100 % is assumed"),
        ({"cutoff_hz": 1000.0, "filter": "4th order, Bessel"}, 0.5e-3, "0.5 ms +/- 100 % is assumed"),
        ({"cutoff_hz": 100.0}, 2.295e-3, "2.3 ms of its low-pass +/- 100 % is assumed"),
        ({"cutoff_hz": 100.0, "filter": "4th order, Bessel"}, 3.506e-3, "3.51 ms of its low-pass +/- 100 % is"),
    ],
)
def test_an_unstated_delay_is_no_shorter_than_that_of_the_low_pass(keys: dict, delay: float, said: str):
    sheet = {"unit": "N m", "sensitivity_V_per_unit": 0.025, **keys}
    sensor = read_sensor(SensorRef("torque", "", None, None, None, sheet=sheet), "V", 5.0)
    assert sensor.calibration.delay == pytest.approx(delay, rel=1e-3)
    assert any(said in finding.text for finding in sensor.findings if finding.code == "delay_assumed")


@pytest.mark.parametrize(("keys", "told"), [({}, True), ({"cutoff_hz": 2000.0}, False)])
def test_an_unstated_low_pass_of_the_torque_is_told(keys: dict, told: bool):
    sheet = {"unit": "N m", "sensitivity_V_per_unit": 0.025, **keys}
    sensor = read_sensor(SensorRef("torque", "", None, None, None, sheet=sheet), "V", 5.0)
    said = [finding.text for finding in sensor.findings if finding.code == "low_pass_assumed"]
    assert said == ["nothing states the low-pass; 1 kHz +/- 100 % is assumed, give cutoff_hz"] * told


def test_a_note_of_the_delay_without_a_percentage_is_told_as_that(papers: Path):
    edit(papers / TORQUE, "typical, +/-3 %", "typical, +/-3 us")
    (found,) = (row for row in read_sensor(reference(papers)).findings if row.code == "delay_tolerance_assumed")
    assert "+/-3 us' names no percentage of the delay of 0.00045 s; +/-10 % is assumed" in found.text


def test_a_range_that_nobody_states_holds_what_the_channel_shows_beyond_its_zero():
    given = SensorRef("torque", "", None, None, None, zero_before=-3.0, zero_after=-3.0)
    calibration = read_sensor(given, "N m", 5.0).calibration
    assert (calibration.range_min, calibration.range_max) == (-8.0, 8.0)


def test_header_only_certificate_is_refused(papers: Path):
    (papers / "torque_T22-40117.csv").write_text("# certificate\napplied_torque_Nm,output_V\n")
    with pytest.raises(Refusal, match="with 0 rows"):
        read_sensor(reference(papers))


def test_negative_rotation_turns_the_torque(tmp_path: Path):
    log = clean_log(revolutions=3.0)
    positive = read_recording(write_folder(tmp_path / "p", [log], Plan("hdf5")))
    negative = read_recording(write_folder(tmp_path / "n", [log], Plan("hdf5", edits=(('"positive"', '"negative"'),))))
    assert np.array_equal(negative.of("torque")[0].read(), -positive.of("torque")[0].read())
    assert np.array_equal(negative.of("pressure")[0].read(), positive.of("pressure")[0].read())


def test_zero_from_a_marked_idle_stretch(tmp_path: Path):
    log = clean_log(revolutions=5.0)
    volts = log.volts["torque"].copy()
    volts[:2000] = 0.0123
    edits = (("zero_before_V = 0.0299\nzero_after_V = 0.0301", "idle_from_s = 0.01\nidle_to_s = 0.19"),)
    folder = write_folder(tmp_path / "r", [log.with_volts("torque", volts)], Plan("hdf5", edits=edits))
    calibration = read_recording(folder).of("torque")[0].calibration
    assert calibration.zero_source == "idle stretch"
    assert calibration.zero_volts == pytest.approx(0.0123, abs=1e-12)
    running = replace(Plan("hdf5"), edits=((edits[0][0], "idle_from_s = 0.2\nidle_to_s = 0.4"),))
    with pytest.raises(
        Refusal, match=r"the idle stretch 0\.2\.\.0\.4 s swings by \d+ % of what the whole log does, expect"
    ):
        read_recording(write_folder(tmp_path / "m", [log.with_volts("torque", volts)], running))
    short = replace(Plan("hdf5"), edits=((edits[0][0], "idle_from_s = 90.0\nidle_to_s = 91.0"),))
    with pytest.raises(Refusal, match=r"the idle stretch 90\.\.91 s holds 0 samples"):
        read_recording(write_folder(tmp_path / "s", [log], short))


def stated(quantity: str, unit: str = "V", readings: tuple[float | None, ...] = (None, None), **sheet: object):
    volts = readings if unit == "V" else (None, None)
    scaled = readings if unit != "V" else (None, None)
    ref = SensorRef(quantity, "", None, *volts, zero_before=scaled[0], zero_after=scaled[1], sheet=sheet)
    return read_sensor(ref, unit, 100.0)


def test_the_ends_of_both_ranges_say_what_a_volt_means():
    sheet = {"unit": "bar", "nominal_range": (0.0, 2000.0), "output_range": (0.5, 4.5)}
    sensor = read_sensor(SensorRef("pressure", "", None, None, None, sheet=sheet), "V", 4.5)
    assert sensor.calibration.gain == pytest.approx(500e5)
    assert sensor.calibration.zero_volts == pytest.approx(0.5)
    with pytest.raises(Refusal, match="with nominal_range and output_range_V, which belong together"):
        stated("pressure", output_range=(0.5, 4.5))


@pytest.mark.parametrize(("sensitivity", "told"), [(0.025, 0), (0.0252, 0), (0.05, 1), (-0.025, 0), (-0.05, 1)])
def test_ranges_that_draw_another_line_than_the_sensitivity_are_told(sensitivity: float, told: int):
    sheet = {"unit": "N m", "nominal_range": (-200.0, 200.0), "output_range": (-5.0, 5.0)}
    sheet["sensitivity_V_per_unit"] = sensitivity
    sensor = read_sensor(SensorRef("torque", "", None, None, None, sheet=sheet), "V", 5.0)
    texts = [finding.text for finding in sensor.findings if finding.code == "sensitivity_off_ranges"]
    assert len(texts) == told
    if told:
        said = "-5 to 5 V at -200 to 200 N m are 0.025 V per unit, the sensitivity is"
        assert texts[0].startswith(said)


@pytest.mark.parametrize("kind", ["high-pass, 2nd order", "Bandpass", "Hochpass 2. Ordnung"])
def test_a_filter_behind_which_a_torque_has_no_mean_is_refused(kind: str):
    with pytest.raises(Refusal, match=r"filter: found '.*', expected the low-pass .* behind a high-pass a torque has"):
        stated("torque", "N m", filter=kind)


def test_a_sheet_in_degrees_celsius_counts_from_ice_in_volts_and_scaled():
    scaled = stated("fuel_temperature", "degC").calibration
    assert scaled.gain * (40.0 - scaled.zero_volts) == pytest.approx(313.15)
    volts = read_sensor(
        SensorRef("fuel_temperature", "", None, None, None, sheet={"unit": "degC", "sensitivity_V_per_unit": 0.01}),
        "V", 1.0,
    ).calibration  # fmt: skip
    assert volts.gain * (0.4 - volts.zero_volts) == pytest.approx(313.15)


@pytest.mark.parametrize(("after", "told"), [(1.5, False), (3.1, True)])
def test_standstill_readings_further_apart_than_the_sheet_allows_are_told(after: float, told: bool):
    # 1 % of +/-150 N m is 1.5 N m to either side
    sheet = {"unit": "N m", "nominal_range": (-150.0, 150.0), "accuracy_percent_fs": 1.0}
    scaled = stated("torque", "N m", (0.0, after), **{k: v for k, v in sheet.items() if k != "unit"})
    volts = read_sensor(
        SensorRef("torque", "", None, 0.0, 0.1 * after, sheet={**sheet, "sensitivity_V_per_unit": 0.1}), "V", 1.0
    )
    for sensor in (scaled, volts):
        texts = [finding.text for finding in sensor.findings if finding.code == "zero_readings_apart"]
        assert bool(texts) == told
        assert all("the sheet allows" in text for text in texts)

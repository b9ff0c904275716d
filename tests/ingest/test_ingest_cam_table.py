"""The lift table: units in the column names, resolution, one revolution that closes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.config.recording import load_recording_config
from camtorque.ingest.cam_table import read_cam_table
from camtorque.records import Refusal
from damaged.logs import CALIBRATION

ROOT = CALIBRATION.parent


def pump(path: Path, lift: str = "lift_mm"):
    base = load_recording_config(ROOT / "raw_examples" / "A_0300rpm").pump
    return replace(base, cam_table_path=path, cam_table_lift_column=lift)


def rows(angles: np.ndarray, lift_mm: np.ndarray, head: str = "cam_angle_deg,lift_mm") -> str:
    return "\n".join([head, *(f"{a:g},{y:.3f}" for a, y in zip(angles, lift_mm, strict=True))]) + "\n"


ANGLES = np.arange(0.0, 360.0, 2.0)
LIFT = 4.0 - 4.0 * np.cos(np.deg2rad(ANGLES))
LIFT_A = np.loadtxt(CALIBRATION / "cam_A.csv", delimiter=",", skiprows=2)[:, 1]


def test_the_example():
    table, findings = read_cam_table(pump(CALIBRATION / "cam_A.csv"))
    assert table.theta.size == 360
    assert table.resolution == pytest.approx(1e-6)
    assert table.lift.max() == pytest.approx(8e-3, rel=1e-3)
    assert [(finding.code, finding.severity) for finding in findings] == [("lift_negative", "info")]


def test_a_table_far_below_its_base_circle_is_a_warning(tmp_path: Path):
    file = tmp_path / "cam.csv"
    file.write_text(rows(ANGLES, np.where((ANGLES > 100.0) & (ANGLES < 130.0), -0.1, LIFT)))
    findings = read_cam_table(pump(file))[1]
    assert [finding.severity for finding in findings if finding.code == "lift_negative"] == ["warning"]


def test_a_repeated_end_is_dropped_and_resolution_comes_from_the_decimals(tmp_path: Path):
    file = tmp_path / "cam.csv"
    file.write_text(rows(np.append(ANGLES, 360.0), np.append(LIFT, LIFT[0])))
    table, _ = read_cam_table(pump(file))
    assert table.theta.size == ANGLES.size
    assert table.resolution == pytest.approx(1e-6)


def test_a_repeated_end_in_radians_closes_to_the_digits_that_are_written(tmp_path: Path):
    file = tmp_path / "cam.csv"
    closed = zip(np.radians([*ANGLES, 360.0]), [*LIFT, LIFT[0]], strict=True)
    file.write_text("\n".join(["Angle [rad];Lift [mm]", *(f"{a:.8f};{y:.3f}".replace(".", ",") for a, y in closed)]))
    table, _ = read_cam_table(replace(pump(file, "Lift"), cam_table_angle_column="Angle"))
    assert table.theta.size == ANGLES.size


def test_resolution_is_the_step_that_all_values_share(tmp_path: Path):
    file = tmp_path / "cam.csv"
    text = rows(ANGLES, np.round(LIFT / 0.005) * 0.005)
    file.write_text(text)
    assert read_cam_table(pump(file))[0].resolution == pytest.approx(5e-6)
    file.write_text(text + "359,0.001\n")
    assert read_cam_table(pump(file))[0].resolution == pytest.approx(1e-6)


@pytest.mark.parametrize(
    ("text", "lift", "message"),
    [
        (rows(np.r_[ANGLES[1], ANGLES[0], ANGLES[2:]], LIFT), "lift_mm", "does not increase at row 2; sort the table"),
        (
            rows(np.r_[ANGLES[0], ANGLES[0], ANGLES[2:]], LIFT),
            "lift_mm",
            "at row 2; it stands there twice",
        ),
        (rows(2.0 * ANGLES, LIFT), "lift_mm", "degrees of a crank that turns twice are to be halved"),
        (rows(ANGLES, LIFT + 20.0), "lift_mm", "never falls below 20 mm, .* the column holds a radius"),
        (rows(ANGLES[:90], LIFT[:90]), "lift_mm", "expected one whole revolution"),
        (rows(ANGLES, 0.0 * LIFT), "lift_mm", "is the column right"),
        (rows(np.append(ANGLES, 360.0), np.append(LIFT, 1.0)), "lift_mm", "does not close"),
        (rows(ANGLES, LIFT + 0.3 * ANGLES / 360.0), "lift_mm", "by 296 um; .* spread the difference over its rows"),
        (rows(ANGLES / 2.0, LIFT), "lift_mm", "cam has 2 equal lobes, write the rows of the first again"),
        (rows(np.radians(ANGLES), LIFT), "lift_mm", "look like radians: .* such as cam_angle_rad"),
        (rows(ANGLES / 36.0, LIFT), "lift_mm", "one whole revolution of the cam without gaps$"),  # no 36 lobes
        (rows(ANGLES, LIFT, "cam_angle_deg,v_mm_per_rad"), "v_mm_per_rad", "holds a slope, expected the lift itself"),
        (rows(ANGLES, LIFT), "lif_mm", "did you mean 'lift_mm'.*meant as cam_table_lift_column in"),
        (
            rows(ANGLES, LIFT, "Winkel_deg,lift_mm"),
            "lift_mm",
            "there are Winkel_deg, lift_mm: .* cam_table_angle_column in",
        ),
        (rows(ANGLES, LIFT, "cam_angle_deg,lift_xy"), "lift_xy", "has no known unit"),
        (rows(ANGLES[:3], LIFT[:3]), "lift_mm", "3 rows, expected at least"),
        (rows(ANGLES, LIFT).replace("4,", "4,4,", 1), "lift_mm", "one per column"),
        ("cam_angle_deg,lift_mm\n", "lift_mm", "a lift table with 0 rows"),
    ],
)
def test_bad_tables_are_refused(tmp_path: Path, text: str, lift: str, message: str):
    file = tmp_path / "cam.csv"
    file.write_text(text)
    with pytest.raises(Refusal, match=message):
        read_cam_table(pump(file, lift))


@pytest.mark.parametrize(("place", "off"), [(0, 0.05), (-1, 0.05), (90, 0.05), (0, 0.0)])
def test_a_point_that_sticks_out_at_the_seam_is_no_table_that_does_not_close(tmp_path: Path, place: int, off: float):
    file = tmp_path / "cam.csv"
    lift = LIFT.copy()
    lift[place] += off
    file.write_text(rows(ANGLES, lift))
    assert ("lift_outlier" in {finding.code for finding in read_cam_table(pump(file))[1]}) is (off > 0.0)


@pytest.mark.parametrize(("turned", "start"), [(150, "15[0-3]"), (240, "24[0-3]"), (320, "32[0-3]")])
def test_a_table_that_does_not_count_from_the_start_of_lift_is_refused(tmp_path: Path, turned: int, start: str):
    file = tmp_path / "cam.csv"
    file.write_text(rows(np.arange(360.0), np.roll(LIFT_A, turned)))
    said = rf"zero at the start of lift .* starts at about {start} deg: write cam_table_zero_deg = {start} in \[pump\]"
    with pytest.raises(Refusal, match=said):
        read_cam_table(pump(file))


@pytest.mark.parametrize("zero", [150.0, 240.0, 320.0, -40.0])
def test_a_table_that_begins_elsewhere_is_counted_from_the_start_of_lift(tmp_path: Path, zero: float):
    file = tmp_path / "cam.csv"
    file.write_text(rows(np.arange(360.0), np.roll(LIFT_A, int(zero))))
    table, findings = read_cam_table(replace(pump(file), cam_table_zero=np.deg2rad(zero)))
    np.testing.assert_allclose(table.theta, np.deg2rad(np.arange(360.0)), atol=1e-12)
    np.testing.assert_allclose(1e3 * table.lift, LIFT_A, atol=5.1e-4)  # rows are written to a micrometre
    assert findings[-1].code == "lift_table_zero"
    assert f"at {zero:g} deg of the lift table" in findings[-1].text
    with pytest.raises(Refusal, match=rf"at {zero + 90.0:g} deg, cam_table_zero_deg, .* write cam_table_zero_deg = "):
        read_cam_table(replace(pump(file), cam_table_zero=np.deg2rad(zero + 90.0)))


@pytest.mark.parametrize(
    ("nominal", "zero", "turned"), [(170.0, 150.0, 20.0), (10.0, 320.0, 50.0), (300.0, 0.0, 300.0)]
)
def test_the_trigger_counts_from_the_start_of_lift_with_the_table(tmp_path, nominal, zero, turned):
    text = (ROOT / "raw_examples" / "A_0300rpm" / "recording.toml").read_text()
    text = text.replace("nominal_angle_deg = 20.0", f"nominal_angle_deg = {nominal}")
    file = tmp_path / "recording.toml"
    file.write_text(text.replace("[pump]", f"[pump]\ncam_table_zero_deg = {zero}"))
    trigger = load_recording_config(file).trigger
    assert np.rad2deg(trigger.nominal_angle) == pytest.approx(turned)
    assert np.rad2deg(trigger.stated_angle) == pytest.approx(nominal)


@pytest.mark.parametrize("lower", [0.0, 0.002, 0.02])
def test_a_later_lobe_may_be_ground_higher_than_the_first(tmp_path: Path, lower: float):
    file = tmp_path / "cam.csv"
    lobe = LIFT_A[:360:2]
    file.write_text(rows(np.arange(360.0), np.concatenate([(1.0 - lower) * lobe, lobe])))
    assert np.argmax(read_cam_table(pump(file))[0].lift) == np.argmax(lobe) + (180 if lower else 0)


@pytest.mark.parametrize(("step", "told"), [(2, False), (5, False), (30, True)])
def test_a_table_whose_flanks_have_few_rows_is_told(tmp_path: Path, step: int, told: bool):
    file = tmp_path / "cam.csv"
    file.write_text(rows(np.arange(0.0, 360.0, step), LIFT_A[::step]))
    texts = [finding.text for finding in read_cam_table(pump(file))[1] if finding.code == "lift_table_coarse"]
    assert len(texts) == told
    if told:
        assert texts[0].startswith("the lift changes by 57 % of its stroke from 90 deg to the next row 30 deg on")


def test_a_missing_table_is_refused(tmp_path: Path):
    with pytest.raises(Refusal, match="no such file; expected a lift table"):
        read_cam_table(pump(tmp_path / "none.csv"))


def test_a_workbook_with_a_unit_row_is_a_lift_table(tmp_path: Path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (
        ["cam 12, resolution 2 um"],
        ["Winkel", "Hub"],
        ["deg", "mm"],
        *zip(ANGLES, LIFT.round(3), strict=True),
    ):
        book.active.append(list(row))
    book.save(tmp_path / "cam.xlsx")
    named = replace(pump(tmp_path / "cam.xlsx", "Hub"), cam_table_angle_column="Winkel")
    table, _ = read_cam_table(named)
    assert table.theta.size == ANGLES.size
    assert table.lift.max() == pytest.approx(8e-3)
    assert table.resolution == 2e-6
    with pytest.raises(Refusal, match="no column 'Hubb', did you mean 'Hub'"):
        read_cam_table(replace(named, cam_table_lift_column="Hubb"))


def test_a_unit_row_serves_a_text_too_and_a_column_without_a_unit_is_refused(tmp_path: Path):
    text = rows(ANGLES, LIFT, "cam_angle_deg;hub\ndeg;mm").replace(",", ";")
    file = tmp_path / "cam.csv"
    file.write_text(text)
    assert read_cam_table(pump(file, "hub"))[0].lift.max() == pytest.approx(8e-3)
    file.write_text(text.replace("deg;mm\n", ""))
    with pytest.raises(Refusal, match="has no known unit; write it at the end of the name"):
        read_cam_table(pump(file, "hub"))


PAIRS = list(zip(ANGLES, LIFT, strict=True))
STRANGERS = {
    "brackets": ("Angle [deg],Lift [mm]", [f"{a:g},{y:.3f}" for a, y in PAIRS]),
    "title and micrometres": (
        "Cam A;measured\nAngle;Lift\n[°];[µm]", [f"{a:g};{1e3 * y:.1f}".replace(".", ",") for a, y in PAIRS]
    ),
    "decimal commas in both columns": (
        "Angle [rad];Lift [m]", [f"{np.radians(a):.8f};{1e-3 * y:.7f}".replace(".", ",") for a, y in PAIRS]
    ),
    "inches": ("Angle (deg),Lift (in)", [f"{a:g},{y / 25.4:.6f}" for a, y in PAIRS]),
    "radians and blanks": ("Angle Lift\nrad m", [f"{np.radians(a):.8f}  {1e-3 * y:.7f}" for a, y in PAIRS]),
    "backwards": ("Angle [deg],Lift [mm]", [f"{a:g},{y:.3f}" for a, y in PAIRS[::-1]]),
    "begun within the revolution": ("Angle [deg],Lift [mm]", [f"{a:g},{y:.3f}" for a, y in PAIRS[50:] + PAIRS[:50]]),
    "remarks": ("Angle [deg],Lift [mm],remark", [f"{a:g},{y:.3f},ok" for a, y in PAIRS]),
    "empty column and rows": ("Angle [deg];Lift [mm];", [*(f"{a:g};{y:.3f};" for a, y in PAIRS), ";;", ";;"]),
    "quoted decimal commas": ('"Angle [deg]","Lift [mm]"', [f'"{a:g}","{y:.3f}"'.replace(".", ",") for a, y in PAIRS]),
}  # fmt: skip


@pytest.mark.parametrize("name", STRANGERS)
def test_tables_of_strangers(tmp_path: Path, name: str):
    head, body = STRANGERS[name]
    file = tmp_path / "cam.csv"
    file.write_text("\n".join([head, *body]) + "\n", encoding="utf-8")
    for angle, lift in (("Angle", "Lift"), *([("Angle [deg]", "Lift [mm]")] if "[mm]" in head else [])):
        table, _ = read_cam_table(replace(pump(file, lift), cam_table_angle_column=angle))
        np.testing.assert_allclose(table.theta, np.radians(ANGLES), atol=1e-7)
        np.testing.assert_allclose(table.lift, 1e-3 * LIFT, atol=6e-7)


def test_a_lift_that_stays_a_little_above_zero_is_told(tmp_path: Path):
    file = tmp_path / "cam.csv"
    file.write_text(rows(ANGLES, LIFT + 0.3))
    assert [finding.code for finding in read_cam_table(pump(file))[1]] == ["lift_above_zero"]


def test_a_table_that_runs_the_other_way_is_told(tmp_path: Path):
    file = tmp_path / "cam.csv"
    for turned, told in ((np.roll(LIFT_A[::-1], 1), True), (np.roll(LIFT_A, 320), False)):
        file.write_text(rows(np.arange(360.0), turned))
        with pytest.raises(Refusal, match="write cam_table_zero_deg = ") as refused:
            read_cam_table(pump(file))
        assert (
            "against the direction of running: then each angle is 360 deg less itself" in str(refused.value)
        ) == told


@pytest.mark.parametrize(("separator", "sign"), [(";", "."), (",", ",")])
def test_points_or_commas_between_thousands_of_micrometres(tmp_path: Path, separator: str, sign: str):
    file = tmp_path / "cam.csv"
    body = [f'{a:g}{separator}"{f"{1e3 * y:,.0f}".replace(",", sign)}"' for a, y in zip(ANGLES, LIFT, strict=True)]
    file.write_text("\n".join([f"cam_angle_deg{separator}lift_um", *body]) + "\n")
    table, _ = read_cam_table(pump(file, "lift_um"))
    np.testing.assert_allclose(table.lift, 1e-3 * LIFT, atol=1e-6)


def test_a_lift_of_the_other_sign_is_refused_as_that(tmp_path: Path):
    file = tmp_path / "cam.csv"
    file.write_text(rows(ANGLES, -LIFT))
    with pytest.raises(Refusal, match=r"goes from -8 to -?0 mm, expected it above the base circle; turn its sign"):
        read_cam_table(pump(file))


def test_a_row_without_a_finite_number_says_how_many_it_has(tmp_path: Path):
    file = tmp_path / "cam.csv"
    file.write_text("cam_angle_deg,lift_mm\n0,0\n10,nan\n20,1\n")
    with pytest.raises(Refusal, match="line 3: found 2 fields, 1 of them finite numbers, expected 2 of these"):
        read_cam_table(pump(file))


def test_the_stated_resolution_may_have_a_decimal_comma(tmp_path: Path):
    file = tmp_path / "cam.csv"
    file.write_text("# resolution 0,5 um\n" + rows(ANGLES, LIFT))
    assert read_cam_table(pump(file))[0].resolution == pytest.approx(0.5e-6)


@pytest.mark.parametrize(("comment", "found"), [("resolution 1.2.3 um", "1.2.3 um"), ("resolution: 0.001", "0.001")])
def test_a_stated_resolution_that_cannot_be_read_is_told(tmp_path: Path, comment: str, found: str):
    file = tmp_path / "cam.csv"
    file.write_text(f"# {comment}\n" + rows(ANGLES, LIFT))
    table, findings = read_cam_table(pump(file))
    assert table.resolution == pytest.approx(1e-6)
    (told,) = (row.text for row in findings if row.code == "lift_resolution_unread")
    assert found in told
    file.write_text("# measured with high resolution\n" + rows(ANGLES, LIFT))
    assert not [row for row in read_cam_table(pump(file))[1] if row.code == "lift_resolution_unread"]


@pytest.mark.parametrize(("digits", "told"), [("%.4g", True), ("%.3f", False), ("%.2f", False)])
def test_angles_whose_digits_were_cut_off_are_the_even_ones(tmp_path: Path, digits: str, told: bool):
    """99.75, 100, 100.2, 100.5: a slope that jumped by a fifth from row to row was read as it stood."""
    angles = np.arange(0.0, 360.0, 0.25)
    lift = 4.0 - 4.0 * np.cos(np.deg2rad(angles))
    file = tmp_path / "cam.csv"
    body = [f"{digits % a},{y:.5f}" for a, y in zip(angles, lift, strict=True)]
    file.write_text("\n".join(["cam_angle_deg,lift_mm", *body]) + "\n")
    table, findings = read_cam_table(pump(file))
    np.testing.assert_allclose(np.rad2deg(table.theta), angles, atol=1e-9)
    assert ("lift_angles_rounded" in {finding.code for finding in findings}) is told


def test_angles_that_were_measured_unevenly_stay_as_they_are(tmp_path: Path):
    angles = np.arange(0.0, 360.0, 2.0) + np.r_[0.0, 0.02 * np.random.default_rng(1).standard_normal(179)].round(3)
    file = tmp_path / "cam.csv"
    file.write_text(
        "\n".join(["cam_angle_deg,lift_mm", *(f"{a:.3f},{y:.4f}" for a, y in zip(angles, LIFT, strict=True))])
    )
    table, findings = read_cam_table(pump(file))
    np.testing.assert_allclose(np.rad2deg(table.theta), angles, atol=1e-9)
    assert "lift_angles_rounded" not in {finding.code for finding in findings}

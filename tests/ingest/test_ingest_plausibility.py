"""Slips that no single number shows: sizes that no one pump has, torque that the pressure cannot cause."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.config import PumpData
from camtorque.ingest import read_recording
from camtorque.ingest.check import summarise
from camtorque.ingest.plausibility import check_loads, check_trigger_exchanged
from camtorque.ingest.pump_sizes import PUMP_RATIOS, check_pump
from camtorque.ingest.raw import ArraySource
from camtorque.ingest.recording import _of_damaged
from camtorque.records import CamTable, Finding, Refusal
from damaged.logs import CALIBRATION, edit

EXAMPLE = CALIBRATION.parent / "raw_examples" / "A_1000rpm"
TORQUE = "torque_T22-40117.toml"


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    shutil.copytree(EXAMPLE, tmp_path / "raw_examples" / "A")
    shutil.copytree(CALIBRATION, tmp_path / "calibration")
    return tmp_path


def read(bench: Path):
    return read_recording(bench / "raw_examples" / "A")


def codes(bench: Path) -> set[str]:
    return {finding.code for finding in read(bench).findings}


def change_lift(bench: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Change the lift column of the cam table."""
    file = bench / "calibration" / "cam_A.csv"
    lines = file.read_text().splitlines()
    angle, lift = np.array([[float(field) for field in line.split(",")] for line in lines[2:]]).T
    rows = [f"{a:g},{y:.6f}" for a, y in zip(angle, change(lift), strict=True)]
    file.write_text("\n".join([*lines[:2], *rows]) + "\n")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("plunger_diameter_m = 0.008", "plunger_diameter_m = 0.08", "plunger diameter over base circle radius is 4"),
        ("plunger_diameter_m = 0.008", "plunger_diameter_m = 0.0016", r"plunger_diameter_m \(7\.39 mm would fit\)"),
        ("cam_inertia_kg_m2 = 5e-05", "cam_inertia_kg_m2 = 0.05", "cam inertia over its mass times"),
        ("follower_mass_kg = 0.075", "follower_mass_kg = 75", "follower mass over that of a steel cube"),
        (
            "spring_preload_N = 110.0",
            "roller_mass_kg = 0.2\nspring_preload_N = 110.0",
            "roller mass over follower mass",
        ),
        ("roller_width_m = 0.005", "roller_width_m = 0.0005", "contact stress at the largest pressure is .* GPa"),
        ("nominal_angle_deg = 20.0", "nominal_angle_deg = 110.0", "the lift rises from .* to .* degrees"),
        ("zero_before_V = 0.0011\nzero_after_V = -0.0003", "zero_before_V = 0.4\nzero_after_V = 0.4", "mean 0.4 mV"),
    ],
)
def test_impossible_pumps_are_refused(bench: Path, old: str, new: str, message: str):
    edit(bench / "raw_examples" / "A" / "recording.toml", old, new)
    with pytest.raises(Refusal, match=message):
        read(bench)


@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (10.0, "largest lift over base circle radius is 4"),
        (25.4, "largest lift over base circle radius"),
        (0.1, "the unit of the lift table"),
    ],
)
def test_a_lift_table_in_another_unit_is_refused(bench: Path, factor: float, message: str):
    change_lift(bench, lambda lift: factor * lift)
    with pytest.raises(Refusal, match=message):
        read(bench)


def test_a_crowned_foot_that_slides_is_no_roller_of_strange_size(bench: Path):
    toml = bench / "raw_examples" / "A" / "recording.toml"
    edit(toml, "roller_radius_m = 0.008", "roller_radius_m = 0.09")
    with pytest.raises(Refusal, match=r"roller radius over base circle radius is 4\.5"):
        read(bench)
    edit(toml, "roller_radius_m = 0.09", "roller_radius_m = 0.09\nroller_mass_kg = 0.0\nroller_inertia_kg_m2 = 0.0")
    with pytest.raises(Refusal, match="curvature of its path") as caught:  # this cam's flanks are too hollow for it
        read(bench)
    assert "over base circle radius" not in str(caught.value)
    assert "disc" not in str(caught.value)


def test_a_flat_foot_is_no_point_of_the_cam(bench: Path):
    """A crown of 0.3 m is nearly all of the curvature of its path: each flat foot was said to be unusual."""
    pump = replace(read(bench).config.pump, roller_radius=0.3, roller_mass=0.0, roller_inertia=0.0)
    angle = np.radians(np.arange(0.0, 360.0))
    table = CamTable(angle, 0.0025 * (1.0 - np.cos(angle)), 1e-6)
    assert PUMP_RATIOS["undercut"].value(pump, table) > PUMP_RATIOS["undercut"].usual[1]
    assert check_pump(pump, table, 1, Path("r.toml"), but={"lift", "size"}) == []


def test_a_turned_lift_table_is_refused(bench: Path):
    change_lift(bench, lambda lift: np.roll(lift, 90))
    with pytest.raises(Refusal, match=r"the lift rises from 9\d to 14\d degrees; the lift table is shifted in angle"):
        read(bench)


@pytest.mark.parametrize("turned", [-25, 12])
def test_a_lift_table_turned_a_little_is_told(bench: Path, turned: int):
    assert "closing_lift_unusual" not in codes(bench)
    change_lift(bench, lambda lift: np.roll(lift, turned))
    assert "closing_lift_unusual" in codes(bench)


def test_a_wrong_point_of_a_lift_table_is_named_in_place_of_the_roller(bench: Path):
    table = bench / "calibration" / "cam_A.csv"
    edit(table, "\n42,6.794\n", "\n42,6.894\n")
    assert [row.where for row in read(bench).findings if row.code == "lift_outlier"] == ["42 deg"]
    edit(table, "\n42,6.894\n", "\n42,6.794\n")
    edit(table, "\n40,6.449\n", "\n40,7.449\n")
    with pytest.raises(
        Refusal, match=r"curvature of its path .*; 1 point\(s\) of the lift table .* at 40 deg: measure"
    ):
        read(bench)


@pytest.mark.parametrize(
    ("name", "told"), [("A_0750rpm_press.tdms", True), ("A_1000rpm_press.tdms", False), ("press.tdms", False)]
)
def test_a_log_named_for_another_run_is_told(bench: Path, name: str, told: bool):
    folder = bench / "raw_examples" / "A"
    log = next(folder.glob("*.tdms"))
    log.rename(folder / name)
    edit(folder / "recording.toml", log.name, name)
    assert ("log_of_other_run" in codes(bench)) == told


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("group_delay_s = 0.00045", "group_delay_s = 0.0", "shorter than the 0.00023 s of its own low-pass"),
        ("group_delay_s = 0.00045", "group_delay_s = 0.45", "did you mean 0.45 ms = 0.00045"),
        ("residual_ripple_V = 0.005", "residual_ripple_V = nan", "residual_ripple_V: found nan"),
        ("accuracy_class = 0.5", "accuracy_class = -0.5", "accuracy_class: found -0.5"),
    ],
)
def test_impossible_sheets_are_refused(bench: Path, old: str, new: str, message: str):
    edit(bench / "calibration" / TORQUE, old, new)
    with pytest.raises(Refusal, match=message):
        read(bench)


@pytest.mark.parametrize(("delay", "told"), [("0.00045", False), ("0.0045", True), ("0.012", True)])
def test_the_delay_of_telemetry_is_taken_and_told(bench: Path, delay: str, told: bool):
    """12 ms of a telemetry were refused, and nothing said what to do."""
    edit(bench / "calibration" / TORQUE, "group_delay_s = 0.00045", f"group_delay_s = {delay}")
    assert ("delay_long" in codes(bench)) == told


def test_unusual_pumps_are_told(bench: Path):
    toml = bench / "raw_examples" / "A" / "recording.toml"
    assert not codes(bench) & {"pump_unusual", "torque_against_pressure", "contact_stress_unusual"}
    edit(toml, "follower_mass_kg = 0.075", "follower_mass_kg = 0.75")
    edit(toml, "spring_stiffness_N_per_m = 20000.0", "spring_stiffness_N_per_m = 200000.0")
    texts = [finding.text for finding in read(bench).findings if finding.code == "pump_unusual"]
    assert ["follower_mass_kg" in texts[0], "spring_stiffness_N_per_m" in texts[1]] == [True, True]


SHEET_SLIPS = {
    "diameter of the base circle": (("base_circle_radius_m = 0.02", "base_circle_radius_m = 0.04"), "is it the diamet"),
    "diameter of the roller": (("roller_radius_m = 0.008", "roller_radius_m = 0.016"), "roller_radius_m (is it the di"),
    "both": (
        (
            "base_circle_radius_m = 0.02\nroller_radius_m = 0.008",
            "base_circle_radius_m = 0.04\nroller_radius_m = 0.016",
        ),
        "base_circle_radius_m (is it the diameter?)",
    ),
    "radius of the plunger": (
        ("plunger_diameter_m = 0.008", "plunger_diameter_m = 0.004"),
        "one is wrong: plunger_diameter_m",
    ),
    "roller weighed with its pin": (
        ("spring_preload_N", "roller_mass_kg = 0.02\nspring_preload_N"),
        "a steel disc of its",
    ),
    "inertia of a larger roller": (
        ("spring_preload_N", "roller_mass_kg = 0.008\nroller_inertia_kg_m2 = 6.3e-7\nspring_preload_N"),
        "with a bore,",
    ),
    "follower without its roller": (
        ("follower_mass_kg = 0.075", "follower_mass_kg = 0.005"),
        "slides has roller_inertia",
    ),
}


@pytest.mark.parametrize("slip", SHEET_SLIPS)
def test_slips_that_each_band_allows_are_told(bench: Path, slip: str):
    (old, new), said = SHEET_SLIPS[slip]
    edit(bench / "raw_examples" / "A" / "recording.toml", old, new)
    texts = [finding.text for finding in read(bench).findings if finding.severity == "warning"]
    assert any(said in text for text in texts)


def test_sizes_that_cannot_be_built_are_refused(bench: Path):
    toml = bench / "raw_examples" / "A" / "recording.toml"
    edit(toml, "spring_preload_N", "roller_mass_kg = 0.008\nroller_inertia_kg_m2 = 6.3e-8\nspring_preload_N")
    with pytest.raises(
        Refusal, match=r"roller inertia over its mass times radius squared, 0.5 to 1 for a disc .* is 0.12"
    ):
        read(bench)
    edit(toml, "roller_mass_kg = 0.008\nroller_inertia_kg_m2 = 6.3e-8\n", "")
    edit(toml, "base_circle_radius_m = 0.02", "base_circle_radius_m = 0.007")
    with pytest.raises(Refusal, match=r"curvature of its path .* is 1\.\d+, usual"):
        read(bench)


def test_the_curvature_of_the_path_is_that_of_its_points(bench: Path):
    recording = read(bench)
    pump, table = recording.config.pump, recording.lift_table
    assert table is not None
    assert PUMP_RATIOS["undercut"].value(pump, table) == pytest.approx(largest_curvature(pump, table), rel=0.05)


def largest_curvature(pump: PumpData, table: CamTable) -> float:
    angle = np.radians(np.arange(0.0, 360.0, 5.0))
    distance = np.sqrt((pump.base_circle_radius + pump.roller_radius) ** 2 - pump.follower_offset**2)
    out = distance + table.at(angle)
    # the cam at rest, the follower led about it: three points make a circle
    x = pump.follower_offset * np.cos(angle) - out * np.sin(-angle)
    y = pump.follower_offset * np.sin(-angle) + out * np.cos(angle)
    points = x + 1j * y
    a, b = points - np.roll(points, 1), np.roll(points, -1) - points
    signed = 2.0 * np.imag(np.conj(a) * b) / (np.abs(a) * np.abs(b) * np.abs(a + b))
    return float(pump.roller_radius * np.max(np.abs(signed) * np.sign(signed * np.sign(np.sum(signed)))))


def test_the_curvature_counts_the_offset_as_the_cam_sees_it(bench: Path):
    toml = bench / "raw_examples" / "A" / "recording.toml"
    edit(toml, "base_circle_radius_m = 0.02", "base_circle_radius_m = 0.007")
    told = []
    for offset, rotation in ((2.0e-3, "positive"), (-2.0e-3, "negative"), (-2.0e-3, "positive")):
        text = toml.read_text(encoding="utf-8")
        text = re.sub(r"follower_offset_m = \S+", f"follower_offset_m = {offset}", text)
        toml.write_text(re.sub(r'rotation = "\w+"', f'rotation = "{rotation}"', text), encoding="utf-8")
        with pytest.raises(Refusal, match="curvature of its path") as refused:
            read(bench)
        told.append(re.search(r"curvature of its path .*? is (\S+),", str(refused.value)))
    forward, backward, other = (found[1] for found in told if found)
    assert forward == backward != other


def test_a_torque_too_large_for_the_pressure_is_told_before_it_is_refused(bench: Path):
    edit(bench / "raw_examples" / "A" / "recording.toml", "plunger_diameter_m = 0.008", "plunger_diameter_m = 0.004")
    assert "torque_beyond_pressure" in codes(bench)


def test_a_chamber_may_be_pressed_highest_where_the_lift_hardly_rises(bench: Path):
    """A sound pump that is closed at last has 1245 bar and 0.55 of the torque that these make on the steepest rise."""
    toml = bench / "raw_examples" / "A" / "recording.toml"
    edit(toml, "plunger_diameter_m = 0.008", "plunger_diameter_m = 0.0105")
    assert "torque_against_pressure" in codes(bench)
    edit(toml, '"high-pressure line, pump end"', '"plunger chamber"')
    assert "torque_against_pressure" not in codes(bench)
    edit(toml, "plunger_diameter_m = 0.0105", "plunger_diameter_m = 0.0145")
    assert "torque_against_pressure" in codes(bench)


def test_columns_under_each_others_name_are_among_the_causes_of_an_impossible_torque(bench: Path):
    toml = bench / "raw_examples" / "A" / "recording.toml"
    text = toml.read_text(encoding="utf-8")
    exchanged = {'quantity = "torque"': 'quantity = "pressure"', 'sensor = "T22-40117"': 'sensor = "K4067-40117"'}
    exchanged |= {new: old for old, new in exchanged.items()}
    toml.write_text(re.sub("|".join(map(re.escape, exchanged)), lambda found: exchanged[found[0]], text))
    with pytest.raises(Refusal, match="torque and pressure are exchanged"):
        read(bench)


def test_a_pressure_in_the_wrong_unit_is_told_although_the_pump_then_seems_idle(bench: Path):
    toml = bench / "raw_examples" / "A" / "recording.toml"
    text = toml.read_text(encoding="utf-8")
    sheet = 'unit = "{}"\nnominal_range = [0, 2000]\noutput_range_V = [0, 10]\ngroup_delay_s = 1e-5\n\n[[loggers]]'
    for unit in ("kPa", "bar"):
        pressure = "[sensors.pressure]\n" + sheet.format(unit)
        toml.write_text(re.sub(r"\[sensors\.pressure\].*?\[\[loggers\]\]", pressure, text, count=1, flags=re.DOTALL))
        if unit == "bar":
            assert "torque_without_pressure" not in codes(bench)
            continue
        with pytest.raises(Refusal, match="the pressure looks like bar read as kPa: correct its unit"):
            read(bench)


def test_stale_and_future_certificates_are_told_by_the_date_of_the_recording(bench: Path):
    toml = bench / "raw_examples" / "A" / "recording.toml"
    edit(toml, '[recording]\nid = "A_1000rpm"', '[recording]\nid = "A_1000rpm"\ndate = 2030-01-01')
    assert "certificate_age" in codes(bench)
    edit(toml, "2030-01-01", "2020-01-01")
    texts = [finding.text for finding in read(bench).findings if finding.code == "certificate_age"]
    assert "days after the recording" in texts[0]


def test_every_limit_holds_what_was_seen():
    for ratio in PUMP_RATIOS.values():
        assert ratio.possible[0] <= ratio.usual[0] <= ratio.seen[0] <= ratio.seen[1] <= ratio.usual[1]
        assert ratio.usual[1] <= ratio.possible[1]


@pytest.mark.parametrize(("quantity", "group", "name"), [("torque", "Grp_torque", "Torque"),
                                                         ("pressure", "Grp_pressure", "Line_Pressure")])  # fmt: skip
def test_a_trigger_under_another_name_is_told_by_its_shape(bench: Path, quantity: str, group: str, name: str):
    toml = bench / "raw_examples" / "A" / "recording.toml"
    text = toml.read_text(encoding="utf-8")
    blocks = re.findall(rf'group = "(?:{group}|Grp_trigger)"\n.*\n.*\n.*\nsample_rate_hz = .*', text)
    assert len(blocks) == 2
    toml.write_text(text.replace(blocks[0], "@").replace(blocks[1], blocks[0]).replace("@", blocks[1]))
    said = rf"{quantity} and trigger are exchanged: 'Prox_Trigger', .* two levels for 100 % .*, '{name}', named trigger"
    with pytest.raises(Refusal, match=said):
        read(bench)


def with_samples(bench: Path, quantity: str, places: np.ndarray | slice, volts: float | np.ndarray):
    """Return the recording with some samples of a channel replaced."""
    recording = read(bench)
    (channel,) = recording.of(quantity)
    values = channel.source.read(0, channel.n_samples).astype(float)
    values[places] = volts
    changed = replace(channel, source=ArraySource(values))
    return replace(recording, channels=tuple(changed if c is channel else c for c in recording.channels))


def test_stray_samples_are_no_pulses_of_a_trigger(bench: Path):
    strays = np.random.default_rng(0).integers(0, 60_000, 40)
    # as many as pulses, steep and at two levels: they had been taken for a trigger
    check_trigger_exchanged(with_samples(bench, "torque", strays, 500.0))


@pytest.mark.parametrize(("factor", "slip"), [(1e3, "N mm read as N m, or N m as"), (1e-3, "N m read as N mm, or")])
def test_a_torque_off_by_a_thousand_is_told_by_its_unit(bench: Path, factor: float, slip: str):
    recording = read(bench)
    (torque,) = recording.of("torque")
    assert torque.calibration is not None
    wrong = replace(torque, calibration=replace(torque.calibration, gain=factor * torque.calibration.gain))
    changed = replace(recording, channels=tuple(wrong if c is torque else c for c in recording.channels))
    with pytest.raises(Refusal, match=f"the torque looks like {slip} .*: correct its unit; else one is wrong: plunger"):
        check_loads(changed)


@pytest.mark.parametrize("lost", [False, True])
def test_counts_that_ran_over_are_told_and_drop_outs_are_none(bench: Path, lost: bool):
    """A torque of wrapped counts was explained by a trigger 28 degrees off."""
    recording = read(bench)
    (torque,) = recording.of("torque")
    values = torque.source.read(0, torque.n_samples).astype(float)
    top = np.max(values)
    limit = 0.6 * top
    wrapped = np.where(values > limit, values - 2.0 * limit, values)
    if lost:  # single samples, at the peaks too
        wrapped = values.copy()
        wrapped[::97] = np.min(values)
    changed = with_samples(bench, "torque", np.arange(values.size), wrapped)
    assert ("values_wrap" in {row.code for row in check_loads(changed)}) != lost
    assert "values_wrap" not in {row.code for row in check_loads(recording)}


@pytest.mark.parametrize("quantity", ["torque", "pressure"])
def test_a_mark_for_missing_samples_is_named_as_that(bench: Path, quantity: str):
    with pytest.raises(Refusal, match=r"the largest .* at exactly -9999, far beyond all others: where that marks"):
        check_loads(with_samples(bench, quantity, slice(5_000, 5_600), -9999.0))


def test_a_mark_for_missing_samples_of_a_pressure_without_a_range_is_no_contact_stress(bench: Path):
    recording = with_samples(bench, "pressure", slice(5_000, 5_600), -9999.0)
    (pressure,) = recording.of("pressure")
    assert pressure.calibration is not None
    endless = replace(pressure, calibration=replace(pressure.calibration, range_max=np.inf))
    changed = replace(recording, channels=tuple(endless if c is pressure else c for c in recording.channels))
    with pytest.raises(Refusal, match=r"contact stress .* GPa, .*; samples of .* stand at exactly -9999"):
        check_loads(changed)


@pytest.mark.parametrize(("quantity", "unit", "volts"), [("torque", "N m", 1.5), ("pressure", "bar", 1.5e5)])
def test_a_channel_that_is_scaled_already_is_told_in_its_own_unit(bench: Path, quantity: str, unit: str, volts: float):
    recording = with_samples(bench, quantity, slice(None), 1.5)
    (channel,) = recording.of(quantity)
    scaled = replace(channel, scale=volts / 1.5)
    specs = tuple(replace(s, unit=unit) if s.quantity == quantity else s for s in recording.config.channels)
    channels = tuple(scaled if c is channel else c for c in recording.channels)
    found = summarise(replace(recording, config=replace(recording.config, channels=specs), channels=channels)).findings
    (text,) = (finding.text for finding in found if finding.code == "channel_constant")
    assert text.startswith(f"the channel never changes (1.5 {unit});")
    high = with_samples(bench, quantity, slice(3), 1.5e4)
    found = summarise(replace(high, config=replace(high.config, channels=specs))).findings
    (text,) = (finding.text for finding in found if finding.code == "out_of_range")
    assert f" to 1.5e+04 {unit}, the sensor gives " in text


@pytest.mark.parametrize(("slip", "times"), [(100.0, r"43\.\d"), (14.5037, r"6\.\d+")])
def test_a_pressure_far_beyond_its_sensor_is_told_by_its_unit(bench: Path, slip: float, times: str):
    recording = read(bench)
    pressure = recording.of("pressure")[0]
    calibration = pressure.calibration
    assert calibration is not None
    wrong = replace(pressure, calibration=replace(calibration, gain=calibration.gain * slip))
    changed = replace(recording, channels=tuple(wrong if c is pressure else c for c in recording.channels))
    with pytest.raises(
        Refusal, match=rf"'Line_Pressure' unit: .* bar, {times} times the end .* check the unit \(found"
    ):
        check_loads(changed)


@pytest.mark.parametrize("quantity", ["torque", "pressure"])
def test_a_channel_that_never_changes_is_not_held_against_the_others(bench: Path, quantity: str):
    recording = read(bench)
    channel = recording.of(quantity)[0]
    flat = replace(channel, source=ArraySource(np.full(channel.n_samples, 0.7)))
    changed = replace(recording, channels=tuple(flat if c is channel else c for c in recording.channels))
    assert check_loads(changed) == []
    assert "channel_constant" in {finding.code for finding in summarise(changed).findings}
    none = replace(flat, source=ArraySource(np.full(channel.n_samples, np.nan)))
    changed = replace(recording, channels=tuple(none if c is channel else c for c in recording.channels))
    assert any(finding.text.startswith("the channel holds no number") for finding in summarise(changed).findings)


def test_a_sensor_beyond_its_nominal_range_is_told(bench: Path):
    sheet = bench / "calibration" / TORQUE
    assert "beyond_nominal_range" not in codes(bench)
    lines = [line for line in sheet.read_text(encoding="utf-8").splitlines() if line.startswith("nominal_range")]
    edit(sheet, lines[0], f"{lines[0].split('=')[0]}= [-20.0, 20.0]")
    (found,) = (finding for finding in read(bench).findings if finding.code == "beyond_nominal_range")
    assert "the torque reaches 309 % of nominal_range" in found.text


def test_a_load_beyond_the_points_of_the_certificate_is_told(bench: Path):
    assert "beyond_certificate" not in codes(bench)
    certificate = (bench / "calibration" / TORQUE).with_suffix(".csv")
    rows = certificate.read_text(encoding="utf-8").splitlines(keepends=True)
    below = [row for row in rows if not re.match(r"-?\d", row) or abs(float(row.split(",")[0])) <= 40.0]
    certificate.write_text("".join(below), encoding="utf-8")
    (found,) = (finding for finding in read(bench).findings if finding.code == "beyond_certificate")
    assert re.match(r"the torque reaches 1\.\d+ times the largest point of its certificate", found.text)


def test_an_amplifier_that_goes_on_beyond_the_output_of_its_sheet_is_told(bench: Path):
    sheet = bench / "calibration" / TORQUE
    edit(sheet, "output_range_V = [-5.0, 5.0]", "output_range_V = [-1.5, 1.5]")
    (found,) = (finding for finding in summarise(read(bench)).findings if finding.code == "beyond_nominal_range")
    assert "the output range of its sheet is -1.5 to 1.5: beyond it nothing states" in found.text


@pytest.mark.parametrize("quantity", ["torque", "pressure"])
def test_a_sensor_whose_range_a_loaded_pump_hardly_uses_is_told(bench: Path, quantity: str):
    recording = read(bench)
    (channel,) = recording.of(quantity)
    sheet = channel.calibration
    assert sheet is not None
    for factor, told in ((10.0, []), (100.0, [sheet.serial])):
        wide = replace(sheet, range_min=factor * sheet.range_min, range_max=factor * sheet.range_max)
        changed = tuple(replace(c, calibration=wide) if c is channel else c for c in recording.channels)
        found = check_loads(replace(recording, channels=changed))
        assert [row.where for row in found if row.code == "far_below_nominal_range"] == told
        assert all(f"the {quantity} reaches 0." in row.text for row in found)


def test_a_sensor_of_a_pump_without_load_may_be_large(bench: Path):
    recording = read(bench)
    sheets = {c.quantity: c.calibration for c in recording.channels if c.calibration is not None}
    idle = {name: replace(sheet, gain=0.005 * sheet.gain) for name, sheet in sheets.items()}
    changed = tuple(replace(c, calibration=idle.get(c.quantity)) for c in recording.channels)
    found = {row.code for row in check_loads(replace(recording, channels=changed))}
    assert "far_below_nominal_range" not in found


def test_a_pressure_read_in_another_unit_is_named_beside_a_stiff_spring(bench: Path):
    toml = bench / "raw_examples" / "A" / "recording.toml"
    edit(toml, "plunger_diameter_m = 0.008", "plunger_diameter_m = 0.0026")  # a tenth of the force
    edit(toml, "spring_preload_N = 110.0", "spring_preload_N = 500.0")
    told = [finding.text for finding in read(bench).findings if finding.code == "torque_beyond_pressure"]
    assert "the pressure looks like MPa read as bar: correct its unit; else" in told[0]


def test_cells_that_cannot_be_read_come_before_what_the_rest_contradicts() -> None:
    """A pressure in "1,23,456.0" lost all but what lies below 100 bar; a plunger of 22 mm was asked for, no more."""
    cells = Finding("csv_cells_damaged", "error", "107717 cells are not numbers", "a.csv")
    said = str(_of_damaged(Refusal("plunger_diameter_m is wrong"), [Finding("other", "info", "note", "b.csv"), cells]))
    assert said == "a.csv: 107717 cells are not numbers; with what is left of it: plunger_diameter_m is wrong"
    assert str(_of_damaged(Refusal("plunger_diameter_m is wrong"), ())) == "plunger_diameter_m is wrong"

"""Measured against rigid torque where the pressure loads the cam: another plunger, another run."""

from dataclasses import replace

import numpy as np
import pytest
from camtorque.align import align
from camtorque.ingest import read_recording
from camtorque.mechanism.load_check import (
    base_findings,
    further_findings,
    load_findings,
    load_ratio,
    ratio_findings,
    rises_together,
)
from camtorque.records import CamCycles, Recording, Refusal
from camtorque.rehearsal import rigid_torque
from damaged.logs import CALIBRATION

EXAMPLES = CALIBRATION.parent / "raw_examples"


@pytest.fixture(scope="module")
def aligned() -> tuple[Recording, CamCycles]:
    recording = read_recording(EXAMPLES / "A_0500rpm")
    return recording, align(recording)


def told(recording: Recording, cycles: CamCycles, diameter: float = 0.008) -> bool:
    pump = replace(recording.config.pump, plunger_diameter=diameter)
    recording = replace(recording, config=replace(recording.config, pump_sheet=pump))
    found = load_findings(recording, cycles, rigid_torque(recording, cycles))
    assert all(finding.code == "torque_against_model" for finding in found)
    return bool(found)


@pytest.mark.parametrize(("diameter", "seen"), [(0.008, False), (0.009, True), (0.0055, True), (0.0075, False)])
def test_a_plunger_a_size_too_large_is_told(aligned, diameter: float, seen: bool):
    assert told(*aligned, diameter) == seen


def test_the_pressure_of_another_run_is_told(aligned):
    recording, cycles = aligned
    assert told(recording, replace(cycles, pressure=0.5 * cycles.pressure))
    assert not told(recording, replace(cycles, pressure=0.9 * cycles.pressure))


def test_a_diameter_is_proposed_where_one_would_explain_the_torque(aligned):
    recording, cycles = aligned

    def text(factor: float) -> str:
        (found,) = ratio_findings(factor * load_ratio(cycles, rigid_torque(recording, cycles)), recording.config.pump)
        return found.text

    assert "(8 mm, 5.5 mm would be usual)" in text(0.5)
    assert "check plunger_diameter_m (8 mm), the lift table" in text(-0.2)
    assert "whether a low-pass of amplifier or logger smooths the torque" in text(0.5)
    assert "low-pass" not in text(2.0)


@pytest.mark.parametrize(
    ("degrees", "tolerance", "diameter", "seen"),
    [(-15.0, 1.5, 0.008, True), (-15.0, 25.0, 0.008, False), (18.0, 25.0, 0.008, False), (18.0, 25.0, 0.0055, True)],
)
def test_a_trigger_within_its_tolerance_makes_no_other_pump(aligned, degrees, tolerance, diameter, seen):
    """A sheet that admits 25 degrees admits the torque of a trigger that is 18 off."""
    recording, cycles = aligned
    steps = round(degrees / 360.0 * cycles.theta.size)
    turned = replace(cycles, torque=np.roll(cycles.torque, steps, 1), pressure=np.roll(cycles.pressure, steps, 1))
    trigger = replace(recording.config.trigger, installation_tolerance=np.radians(tolerance))
    recording = replace(recording, config=replace(recording.config, trigger=trigger))
    assert told(recording, turned, diameter) == seen


def test_where_pressure_hardly_loads_the_cam_nothing_is_said(aligned):
    recording, cycles = aligned
    cycles = replace(cycles, pressure=np.full_like(cycles.pressure, 1e5))
    assert np.isnan(load_ratio(cycles, rigid_torque(recording, cycles)))
    assert not told(recording, cycles)


@pytest.mark.parametrize(("share", "zero_std", "seen"), [(0.2, 0.1, False), (0.4, 0.1, True), (0.4, 20.0, False)])
def test_a_torque_too_large_for_drag_alone_is_told(aligned, share: float, zero_std: float, seen: bool):
    recording, cycles = aligned
    cycles = replace(cycles, torque=cycles.torque + share * np.max(cycles.mean_torque))
    found = base_findings(cycles, rigid_torque(recording, cycles), zero_std)
    assert [row.code for row in found] == ["base_torque_large"] * seen
    assert all("drag alone makes at most 19 %" in row.text for row in found)
    dry = replace(cycles, pressure=np.full_like(cycles.pressure, 1e5))  # little but drag beside it
    assert not base_findings(dry, rigid_torque(recording, dry), zero_std)


@pytest.mark.parametrize(("off", "seen"), [(0.0, False), (-0.5, False), (-1.0, True), (-4.0, True)])
def test_a_torque_that_is_negative_where_only_drag_acts_is_told(aligned, off: float, seen: bool):
    recording, cycles = aligned
    cycles = replace(cycles, torque=cycles.torque + off)
    found = base_findings(cycles, rigid_torque(recording, cycles), 0.05)
    assert [row.code for row in found] == ["base_torque_negative"] * seen
    assert all("N m in the mean, where nothing drives the cam" in row.text for row in found)
    assert not base_findings(cycles, rigid_torque(recording, cycles), float("inf"))
    rigid = rigid_torque(recording, cycles)
    above = replace(rigid, lift=rigid.lift + 0.05 * np.max(rigid.lift))
    assert base_findings(cycles, above, 0.05) == found, "a lift table may stay above zero"


def test_without_torque_nothing_is_said(aligned):
    recording, cycles = aligned
    assert not told(recording, replace(cycles, torque=None))


@pytest.mark.parametrize("part", [0.25, 0.5, 0.75])
def test_a_pressure_that_the_plunger_does_not_make_is_refused(aligned, part: float):
    recording, cycles = aligned
    shifted = replace(cycles, pressure=np.roll(cycles.pressure, round(part * cycles.theta.size), axis=1))
    with pytest.raises(
        Refusal,
        match=r"not while the plunger delivers.*check that both logs are of one run.* nominal_angle_deg in \[tr",
    ):
        told(recording, shifted)


def test_a_line_that_a_rail_holds_steady_does_not_tell_its_place(aligned):
    recording, cycles = aligned
    rail, ringing = 3e7, 1.5e7 * np.sin(9.0 * cycles.theta + 1.0)
    told(recording, replace(cycles, pressure=np.tile(rail + ringing, (cycles.pressure.shape[0], 1))))


@pytest.mark.parametrize(("low", "refused"), [(0.5, False), (0.2, True)])
def test_a_rail_that_rings_more_than_the_pump_raises_it_is_told_and_not_refused(aligned, low: float, refused: bool):
    recording, cycles = aligned
    mean = np.roll(cycles.mean_pressure, cycles.theta.size // 2)
    rail = 5e7 * (low + (1.0 - low) * (mean - np.min(mean)) / np.ptp(mean))
    rung = replace(cycles, pressure=np.tile(rail, (cycles.pressure.shape[0], 1)))
    if refused:
        with pytest.raises(Refusal, match="not while the plunger delivers"):
            load_findings(recording, rung, rigid_torque(recording, rung))
        return
    (found,) = (row for row in load_findings(recording, rung, rigid_torque(recording, rung)) if "rail" in row.text)
    assert (found.code, found.severity) == ("pressure_misplaced", "warning")
    assert "not while the plunger delivers" in found.text
    assert "a ringing rail may do this, else check that both logs are of one run" in found.text


def test_a_rail_that_keeps_its_pressure_until_the_return_is_of_this_pump(aligned):
    recording, cycles = aligned
    lift = rigid_torque(recording, cycles).lift
    top = cycles.theta[int(np.argmax(lift))]
    filled = np.where(cycles.theta < top, lift / np.max(lift), 1.0)
    injected = np.clip((cycles.theta - top - 1.2) / 0.2, 0.0, 1.0)  # on the return, when the plunger is down again
    rail = 9e7 + 3e7 * (filled - injected)
    told(recording, replace(cycles, pressure=np.tile(rail, (cycles.pressure.shape[0], 1))))


def test_a_line_that_holds_its_pressure_after_delivery_is_no_wrong_plunger(aligned):
    recording, cycles = aligned
    pressure = cycles.mean_pressure
    end = int(np.argmax(pressure))
    held = np.where(np.arange(pressure.size) > end, np.maximum(pressure, 0.95 * pressure[end]), pressure)
    cycles = replace(cycles, pressure=np.tile(held, (cycles.pressure.shape[0], 1)))
    assert not told(recording, cycles)
    assert told(recording, cycles, 0.009)


def test_rises_together_wherever_the_pressure_is():
    theta = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    lift = 4e-3 * (1.0 - np.cos(theta))
    for place, here in ((0.0, 1.0), (0.5 * np.pi, 0.5), (np.pi, 0.0)):
        pressure = 1e7 * (1.0 - np.cos(theta - place))
        assert rises_together(pressure, lift) == pytest.approx((here, 1.0), abs=0.03)
    assert rises_together(np.full(720, 1e7), lift) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_small_swing_beside_the_torque_is_not_judged(aligned):
    recording, cycles = aligned
    small = np.roll(0.1 * cycles.pressure, cycles.theta.size // 2, axis=1)
    assert not told(recording, replace(cycles, pressure=small))


@pytest.mark.parametrize(("factor", "seen"), [(1.2, False), (10.0, True), (0.1, True)])
def test_a_chamber_pressure_in_another_unit_is_told(aligned, factor: float, seen: bool):
    _, cycles = aligned
    both = replace(cycles, channels={"chamber_pressure": factor * cycles.pressure})
    found = further_findings(both)
    assert [row.code for row in found] == ["chamber_against_line"] * seen
    assert all("expected 0.5 to 3 times as much in the chamber: check unit" in row.text for row in found)


@pytest.mark.parametrize(("factor", "seen"), [(1.0, False), (-1.0, False), (2.0, False), (1.0 / 60.0, True)])
def test_a_speed_that_contradicts_the_trigger_is_told(aligned, factor: float, seen: bool):
    _, cycles = aligned
    speed = np.full(cycles.pressure.shape, factor * cycles.mean_speed)
    speed[0] = np.nan  # that the channel does not cover
    found = further_findings(replace(cycles, channels={"shaft_speed": speed}))
    assert [row.code for row in found] == ["speed_against_trigger"] * seen
    assert all("check the unit of the one (rpm, Hz, rad/s)" in row.text for row in found)


def test_a_channel_that_covers_no_cycle_is_held_against_nothing(aligned):
    _, cycles = aligned
    nothing = np.full(cycles.pressure.shape, np.nan)
    assert not further_findings(replace(cycles, channels={"shaft_speed": nothing, "chamber_pressure": nothing}))

"""Where torque and pressure place the lift table: uneven running, wrong trigger angle, wrong direction."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from camtorque.align import align
from camtorque.align.flanks import APART_DEG, _local_best, check_flanks, flank_places
from camtorque.align.polarity import lift_velocity
from camtorque.ingest import read_recording
from camtorque.records import CamTable, Recording, Refusal
from rig_bridge import cycles_of, recording_of
from rigs.families import FAMILIES
from rigs.rig import simulate

EXAMPLES = Path(__file__).resolve().parents[2] / "raw_examples"
TURN = 2.0 * np.pi

SLOW = ("closed_volume", "spill", "negative_rotation", "soft_driveline", "foreign_yielding_drive")
"""Families that are also run slowly: both endings, both directions, drives that swing."""


@cache
def rig(family: str, rpm: float) -> tuple[Recording, dict[str, np.ndarray], float]:
    """Return a simulated recording, its typical cycle and its speed."""
    run = simulate(FAMILIES[family](np.random.default_rng(int(rpm))), rpm, 0.8, 3, seed=1, step=1e-5)
    cycles = cycles_of(run)
    typical = {name: getattr(cycles, name).mean(axis=0)[::5] for name in ("torque", "pressure")}
    return recording_of(run), typical, cycles.mean_speed


def moved(typical: dict[str, np.ndarray], shift: np.ndarray | float) -> dict[str, np.ndarray]:
    """Read the cycle ``shift`` [rad] further on."""
    theta = np.arange(typical["torque"].size) * (TURN / typical["torque"].size)
    return {name: np.interp(theta + shift, theta, values, period=TURN) for name, values in typical.items()}


def mirrored(table: CamTable) -> CamTable:
    """Return the table that a cam measured in the other direction gives."""
    theta = np.mod(-table.theta, TURN)
    order = np.argsort(theta)
    return CamTable(theta[order], table.lift[order], table.resolution)


@pytest.mark.parametrize(
    ("family", "rpm"), [(family, 1100.0) for family in sorted(FAMILIES)] + [(family, 400.0) for family in SLOW]
)
def test_sound_rigs_raise_nothing(family: str, rpm: float) -> None:
    recording, typical, speed = rig(family, rpm)
    assert check_flanks(typical, recording, speed) == ()


@pytest.mark.parametrize("folder", sorted(path.name for path in EXAMPLES.glob("A_*")))
def test_examples_raise_nothing(folder: str) -> None:
    codes = {finding.code for finding in align(read_recording(EXAMPLES / folder)).findings}
    assert not codes & {"uneven_running", "trigger_angle_doubtful", "direction_unchecked", "torque_inverted"}


@pytest.mark.parametrize("family", ["closed_volume", "spill", "negative_rotation"])
@pytest.mark.parametrize("phase_deg", [60.0, 180.0])
def test_twenty_percent_of_ripple_are_told(family: str, phase_deg: float) -> None:
    recording, typical, speed = rig(family, 400.0)
    theta = np.arange(720) * (TURN / 720)
    shift = 0.1 * np.sin(2.0 * theta + np.radians(phase_deg))
    shift -= np.interp(recording.config.trigger.nominal_angle, theta, shift)
    (found,) = check_flanks(moved(typical, shift), recording, speed)
    assert found.code == "uneven_running"
    assert found.severity == "warning"
    assert "degrees apart" in found.text


@pytest.mark.parametrize("shift_deg", [-11.0, 11.0])
def test_trigger_angle_far_off_is_told(shift_deg: float) -> None:
    recording, typical, speed = rig("closed_volume", 400.0)
    (found,) = check_flanks(moved(typical, np.radians(shift_deg)), recording, speed)
    assert found.code == "trigger_angle_doubtful"
    assert "nominal_angle_deg" in found.text


@pytest.mark.parametrize("family", ["closed_volume", "spill", "plain", "negative_rotation"])
@pytest.mark.parametrize("shift_deg", [-28.0, 26.0])
def test_a_trigger_at_another_tooth_is_told_or_refused(family: str, shift_deg: float) -> None:
    """So far that no place of the table is found where it is looked for, though all torque falls on the rising lift."""
    recording, typical, speed = rig(family, 400.0)
    try:
        (found,) = check_flanks(moved(typical, np.radians(shift_deg)), recording, speed)
    except Refusal as refusal:
        text = str(refusal)
    else:
        assert found.code == "trigger_far_off"
        text = found.text
    place = float(re.search(r"angle moved by ([+-][\d.]+) degrees", text)[1])
    assert place == pytest.approx(shift_deg, abs=6.0)
    assert "nominal_angle_deg" in text


@pytest.mark.parametrize(("tolerance_deg", "told"), [(1.5, True), (10.0, True), (25.0, False)])
def test_a_trigger_within_the_tolerance_that_its_sheet_states_is_not_doubted(tolerance_deg: float, told: bool) -> None:
    recording, typical, speed = rig("closed_volume", 400.0)
    trigger = replace(recording.config.trigger, installation_tolerance=np.radians(tolerance_deg))
    recording = replace(recording, config=replace(recording.config, trigger=trigger))
    found = check_flanks(moved(typical, np.radians(22.0)), recording, speed)
    assert [row.code for row in found] == ["trigger_far_off"] * told


@pytest.mark.parametrize("family", ["closed_volume", "spill", "other_geometry", "negative_rotation"])
def test_table_read_against_the_direction_of_running_is_refused(family: str) -> None:
    recording, typical, speed = rig(family, 400.0)
    wrong = replace(recording, lift_table=mirrored(recording.cam_table))
    with pytest.raises(Refusal, match=r"driving torque falls where the declared lift does not rise.*direction"):
        check_flanks(typical, wrong, speed)


@pytest.mark.parametrize("late_deg", [60.0, 90.0])
def test_a_torque_that_alone_comes_late_is_refused_with_its_delay(late_deg: float) -> None:
    """A telemetry of 12 ms was refused as a wrong trigger, lift table or rotation."""
    recording, typical, speed = rig("closed_volume", 400.0)
    steps = round(late_deg * typical["torque"].size / 360.0)
    with pytest.raises(Refusal, match="does not rise") as refused:
        check_flanks({**typical, "torque": np.roll(typical["torque"], steps)}, recording, speed)
    found = re.search(r"the torque alone that comes ([\d.]+) ms later .*group_delay_s", str(refused.value))
    assert found
    assert float(found[1]) == pytest.approx(1e3 * np.radians(late_deg) / speed, rel=0.1)


def test_a_hub_that_rings_at_a_low_order_is_no_wrong_table() -> None:
    recording, typical, speed = rig("closed_volume", 1100.0)
    theta = np.arange(typical["torque"].size) * (TURN / typical["torque"].size)
    told = set()
    for phase in np.linspace(0.0, TURN, 8, endpoint=False):
        ringing = 2.0 * np.max(typical["torque"]) * np.cos(6.0 * theta + phase)
        found = check_flanks({**typical, "torque": typical["torque"] + ringing}, recording, speed)
        told |= {(item.code, item.severity) for item in found}
    assert ("torque_misses_rise", "warning") in told


def test_direction_that_cannot_be_told_is_said() -> None:
    recording, typical, speed = rig("bare", 400.0)
    table = recording.cam_table
    # the zero of table and angle is put into the middle between the flanks, where the mirrored table lies over itself
    zero = -0.5 * flank_places(*typical.values(), table, recording.config.pump, speed).mirrored.shift
    lift = table.at(table.theta + zero)
    found = check_flanks(moved(typical, zero), replace(recording, lift_table=CamTable(table.theta, lift, 1e-6)), speed)
    assert [(item.code, item.severity) for item in found] == [("direction_unchecked", "info")]


def test_limits_leave_room_above_sound_rigs() -> None:
    spread = {"spring": 0.0, "all": 0.0}
    for family in FAMILIES:
        recording, typical, speed = rig(family, 1100.0)
        places = flank_places(*typical.values(), recording.cam_table, recording.config.pump, speed).places
        spring = [shift for name, shift in places.items() if name != "delivery"]
        for kind, shifts in (("spring", spring), ("all", list(places.values()))):
            spread[kind] = max(spread[kind], float(np.degrees(np.ptp(shifts))) if shifts else 0.0)
    for kind, widest in spread.items():
        assert widest < APART_DEG[kind] / 1.15


def test_a_line_that_rests_at_a_high_pressure_hides_what_the_chamber_does_before() -> None:
    recording, typical, speed = rig("closed_volume", 400.0)
    pump = recording.config.pump
    rest = 10.0 * pump.spring_preload / pump.plunger_area
    high = {**typical, "pressure": typical["pressure"] + rest}
    assert "start of the rise" in flank_places(*typical.values(), recording.cam_table, pump, speed).places
    assert "start of the rise" not in flank_places(*high.values(), recording.cam_table, pump, speed).places


@pytest.mark.parametrize(("gained", "place_deg"), [(0.002, None), (0.02, -6.0)])
def test_a_delivery_that_follows_its_nominal_place_as_well_lies_nowhere_else(gained: float, place_deg: float) -> None:
    shift = np.arange(720) * (TURN / 720)
    scores = 0.9 + gained * np.cos(shift + np.radians(6.0)) / (1.0 - np.cos(np.radians(6.0)))
    found = _local_best(scores - np.max(scores) + 0.95)
    assert (found is None) if place_deg is None else (np.degrees(found) == pytest.approx(place_deg, abs=0.5))


def test_logs_that_do_not_start_together_are_among_the_causes_of_a_torque_elsewhere() -> None:
    recording, typical, speed = rig("closed_volume", 1100.0)
    late = {**typical, "torque": moved(typical, np.radians(120.0))["torque"]}
    with pytest.raises(Refusal, match=r"driving torque falls where .* of the trigger$"):
        check_flanks(late, recording, speed)
    files = tuple(replace(row, path=Path(f"{row.quantity}.csv")) for row in recording.channels)
    with pytest.raises(Refusal, match=r"or the starts of pressure\.csv, torque\.csv, which have to count from one"):
        check_flanks(late, replace(recording, channels=files), speed)


@pytest.mark.parametrize("from_share", [0.1, 0.15])
def test_a_line_that_keeps_its_pressure_after_a_spill_tells_no_place_of_the_delivery(from_share: float) -> None:
    recording, _, speed = rig("spill", 400.0)
    table, pump, theta = recording.cam_table, recording.config.pump, np.arange(720) * (TURN / 720)
    slope, lift = lift_velocity(table, 720), table.at(theta)
    delivers = (slope > 0.0) & (lift > from_share * np.max(lift)) & (lift < (from_share + 0.45) * np.max(lift))
    line = np.zeros(720)
    for k in range(3 * 720):  # an orifice empties it eight times as slowly as the pump fills it
        gap, degrees = (300.0e5 - line[k % 720 - 1], 6.0) if delivers[k % 720] else (-line[k % 720 - 1], 40.0)
        line[k % 720] = line[k % 720 - 1] + gap * (1.0 - np.exp(-0.5 / degrees))
    chamber = np.where(delivers, line + 20.0e5, 0.0)
    force = pump.spring_preload + pump.spring_stiffness * lift + pump.plunger_area * chamber
    assert check_flanks({"torque": force * slope, "pressure": line}, recording, speed) == ()

"""What sheets of one pump state differently."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from camtorque.ingest import read_recording
from camtorque.ingest.stated import DIMENSIONS, difference_findings, differences, other_triggers, stated
from camtorque.records import Recording

EXAMPLE = Path(__file__).resolve().parents[2] / "raw_examples" / "A_1250rpm"


@pytest.fixture(scope="module")
def recording() -> Recording:
    return read_recording(EXAMPLE)


def changed(recording: Recording, **pump: float) -> Recording:
    config = recording.config
    return replace(recording, config=replace(config, pump_sheet=replace(config.pump, **pump)))


def test_numbers_stand_as_the_bench_writes_them(recording: Recording) -> None:
    found = stated(recording)
    assert found["[pump] plunger_diameter_m"] == "0.008"
    assert found["[trigger] nominal_angle_deg"] == "20"
    assert found["[trigger] edge"] == "rising"
    assert float(found["torque sensor, delay [s]"]) == recording.of("torque")[0].calibration.delay  # type: ignore[union-attr]
    assert set(DIMENSIONS) < set(found)
    assert not any("note" in name or "level" in name for name in found)


def test_what_differs_is_told_with_who_states_what(recording: Recording) -> None:
    same = stated(recording)
    sides = {"A": same, "B": stated(changed(recording, plunger_diameter=0.0082)), "C": same, "D": same}
    assert differences(sides) == {"[pump] plunger_diameter_m": "0.0082 in B, 0.008 in the others"}
    pair = {"A": same, "B": stated(changed(recording, spring_preload=200.0))}
    (finding,) = difference_findings(differences(pair))
    assert finding.text.startswith("[pump] spring_preload_N is 200 in B, 110 in A: each is read by its own sheet")
    assert finding.text.endswith("correct it; where all are right, part the recordings by group in [recording]")
    assert difference_findings(differences({"A": same, "B": same})) == ()


def test_other_triggers_are_told_once_and_not_as_a_change_of_the_pump(recording: Recording) -> None:
    trigger = replace(recording.config.trigger, pulses_per_rev=60, nominal_angle=0.0)
    other = stated(replace(recording, config=replace(recording.config, trigger=trigger)))
    same = stated(recording)
    (finding,) = difference_findings(differences({"A": same, "B": other, "C": same}))
    assert (finding.code, finding.where) == ("triggers_differ", "[trigger]")
    assert "nominal_angle_deg is 0 in B, 20 in the others; [trigger] pulses_per_rev is 60 in B" in finding.text
    assert "each recording has its own error of the trigger's angle in the joint fit, which is fitted" in finding.text
    assert finding.text.endswith("and taken as none in a blind prediction; correct a wrong one")
    assert other_triggers([same, other])
    assert not other_triggers([same, same])


def test_a_transducer_calibrated_in_between_is_no_slip(recording: Recording) -> None:
    torque = recording.of("torque")[0]
    sheet = replace(torque.calibration, gain=39.97)  # type: ignore[type-var]
    channels = tuple(replace(c, calibration=sheet) if c is torque else c for c in recording.channels)
    found = differences({"A": stated(recording), "B": stated(replace(recording, channels=channels))})
    (finding,) = difference_findings(found)
    assert finding.text.startswith("torque sensor, gain [N m/V] is 39.97 in B, ")
    assert finding.text.endswith("correct it; where all are right, as after a calibration, leave them")


def test_a_lift_table_is_compared_as_a_whole(recording: Recording) -> None:
    table = recording.cam_table
    other = replace(recording, lift_table=replace(table, lift=table.lift * 1.001))
    assert list(differences({"A": stated(recording), "B": stated(other)})) == ["lift table"]


def test_values_that_a_logger_has_scaled_state_no_gain_of_one(recording: Recording) -> None:
    """'gain [N m/V] is 1 in B, 39.9 in A': no transducer has that."""
    torque = recording.of("torque")[0]
    scaled = replace(torque, calibration=replace(torque.calibration, gain=1.0))  # type: ignore[type-var]
    channels = tuple(scaled if c is torque else c for c in recording.channels)
    specs = tuple(replace(s, unit="N m") if s.quantity == "torque" else s for s in recording.config.channels)
    other = replace(recording, channels=channels, config=replace(recording.config, channels=specs))
    found = differences({"A": stated(recording), "B": stated(other)})
    assert found["torque sensor, gain [N m/V]"].startswith("the logger's in B, ")


def test_a_transducer_of_ten_newton_metres_at_ten_volts_has_a_gain_of_one(recording: Recording) -> None:
    """Its volts were said to be 'the logger's'."""
    torque = recording.of("torque")[0]
    small = replace(torque, calibration=replace(torque.calibration, gain=1.0))  # type: ignore[type-var]
    channels = tuple(small if c is torque else c for c in recording.channels)
    found = differences({"A": stated(recording), "B": stated(replace(recording, channels=channels))})
    assert found["torque sensor, gain [N m/V]"].startswith("1 in B, ")


def test_a_low_pass_that_one_sheet_leaves_out_is_nothing_there(recording: Recording) -> None:
    """'cut-off [Hz] is nan in B, 1000 in A'."""
    torque = recording.of("torque")[0]
    open_one = replace(torque, calibration=replace(torque.calibration, cutoff_hz=float("nan")))  # type: ignore[type-var]
    channels = tuple(open_one if c is torque else c for c in recording.channels)
    found = differences({"A": stated(recording), "B": stated(replace(recording, channels=channels))})
    assert found == {"torque sensor, cut-off [Hz]": "nothing in B, 1000 in A"}


def test_a_key_that_one_recording_leaves_out_is_nothing_there(recording: Recording) -> None:
    """'reference is index in B,  in A': a blank in place of a value."""
    trigger = replace(recording.config.trigger, reference="index")
    other = replace(recording, config=replace(recording.config, trigger=trigger))
    assert differences({"A": stated(recording), "B": stated(other)}) == {
        "[trigger] reference": "index in B, nothing in A"
    }

"""The angle error budget and what is written beside the cycles."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from align_truth import Rig, make
from camtorque.align import AlignOptions, align, alignment_summary
from camtorque.records import Finding

RIG = Rig(torque_noise=0.3, pressure_noise=1.0e5, duration=1.5)


def budget(rig: Rig) -> dict[str, float]:
    return {row.source: row.std_deg for row in align(make(rig)).angle_errors}


def test_summary_is_json_and_says_null_where_nothing_is_known() -> None:
    summary = alignment_summary(align(make(RIG)))
    text = json.dumps(summary, allow_nan=False)
    assert json.loads(text) == summary
    rows = {row["source"]: row["std_deg"] for row in summary["angle_error_budget_deg"]}
    assert rows["speed ripple within a revolution"] is None
    assert summary["triggers"]["DAQ"]["missed"] == 0
    assert summary["resampling"]["torque"]["rule"] == "cubic"
    assert summary["cycles_used"] == summary["cut_flow"][-1]["cycles_left"]


def test_budget_rows_scale_with_speed() -> None:
    slow = budget(RIG)
    fast = budget(replace(RIG, shaft=replace(RIG.shaft, rpm=1000.0)))
    for source in ("torque delay", "pressure delay", "trigger switching delay"):
        assert fast[source] == pytest.approx(2.0 * slow[source], rel=0.01)
    assert fast["trigger installation"] == slow["trigger installation"]


def test_budget_of_the_delay_is_its_tolerance_in_degrees() -> None:
    # 2 % of 450 us at 500 rpm, 3 degrees per millisecond.
    assert budget(RIG)["torque delay"] == pytest.approx(0.02 * 0.45 * 3.0, rel=1e-3)


def test_budget_of_an_edge_is_the_noise_over_its_slope_in_degrees() -> None:
    # 0.03 V of noise on a flank of 5 V in 200 us: 1.2 us, at 500 rpm 3 degrees per millisecond
    slow_flank = replace(RIG, flank=2e-4, trigger_noise=0.03, trigger_rate=100e3)
    assert budget(slow_flank)["trigger edge time"] == pytest.approx(0.0036, rel=0.1)


def test_one_pulse_cannot_tell_the_ripple_and_a_wheel_can() -> None:
    assert math.isnan(budget(RIG)["speed ripple within a revolution"])
    wheel = budget(replace(RIG, pulses_per_rev=60, missing_teeth=2, trigger_rate=50e3))
    assert "speed ripple within a revolution" not in wheel


def test_budget_counts_the_clock_of_the_other_logger() -> None:
    rows = budget(replace(RIG, clock_kind="independent", duration=3.0))
    assert 0.0 < rows["clock of logger B"] < 0.01


def test_cycles_are_read_only_and_complete_at_birth() -> None:
    cycles = align(make(RIG))
    assert not cycles.torque.flags.writeable
    assert np.isfinite(cycles.torque).all()
    assert np.isfinite(cycles.pressure).all()


def test_notes_of_the_options_stand_among_the_findings() -> None:
    note = Finding("grid_error", "info", "chosen")
    assert note in align(make(RIG), AlignOptions(notes=(note,))).findings


def test_note_on_ripple_gives_the_angle_that_the_torque_makes() -> None:
    (note,) = (item for item in align(make(RIG)).findings if item.code == "ripple_unseen")
    assert re.search(r"by 1 degree at most on a drive of 0\.\d+ kg m\^2, less on heavier", note.text)

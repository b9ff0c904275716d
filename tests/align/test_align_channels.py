"""Channels beside torque and pressure, and recordings that lack one of them, the pump or the lift table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from align_truth import Rig, Samples, angle_error_deg, make, pressure_of, sampled, torque_of
from camtorque.align import align
from camtorque.config import LoggerSpec
from camtorque.records import Channel
from camtorque.report.alignment import write_alignment
from wheel_truth import Wheel, wheel_recording

RIG = Rig(torque_noise=0.3, pressure_noise=1e5)


def extra(quantity: str, values: np.ndarray, rate: float, logger: str = "DAQ") -> Channel:
    return Channel(quantity, logger, Samples(values), 0.0, rate, None, Path("extra.dat"), quantity)


def test_other_channels_are_aligned_and_handed_on() -> None:
    recording = make(RIG)
    theta = RIG.shaft.angle(sampled(RIG, "trigger", 20e3))
    channels = (
        *recording.channels,
        extra("needle_lift", 2e-4 * (1.0 + np.cos(theta - 1.0)), 20e3),
        extra("fuel_temperature", np.linspace(310.0, 312.0, 40), 10.0),
    )
    cycles = align(replace(recording, channels=channels))
    plain = align(recording)
    np.testing.assert_array_equal(cycles.torque, plain.torque)
    assert set(cycles.channels) == {"needle_lift", "fuel_temperature"}
    np.testing.assert_allclose(
        cycles.channels["needle_lift"], np.tile(2e-4 * (1.0 + np.cos(cycles.theta - 1.0)), (plain.index.size, 1)),
        atol=2e-4 * 0.002,
    )  # fmt: skip
    means = cycles.means("fuel_temperature")
    # 0.12 s a cycle: 0.06 K from one to the next; cycles before the second sample are not covered
    np.testing.assert_allclose(np.diff(means[np.isfinite(means)]), 2.0 / 3.9 * 0.12, rtol=0.02)
    assert np.isnan(means).sum() <= 2


@pytest.mark.parametrize("kept", ["torque", "pressure"])
def test_one_of_torque_and_pressure_is_enough_without_pump_and_table(kept: str) -> None:
    recording = make(RIG)
    channels = tuple(c for c in recording.channels if c.quantity in (kept, "trigger"))
    config = replace(recording.config, pump_sheet=None)
    cycles = align(replace(recording, config=config, channels=channels, lift_table=None))
    values, law = (cycles.torque, torque_of) if kept == "torque" else (cycles.pressure, pressure_of)
    assert abs(angle_error_deg(values, law, cycles.theta)) < 0.05
    assert cycles.torque is None or not cycles.pressure.size


def test_neither_torque_nor_pressure() -> None:
    recording = make(RIG)
    theta = RIG.shaft.angle(sampled(RIG, "trigger", 20e3))
    channels = (recording.channels[-1], extra("chamber_pressure", 1e7 * (1.0 + np.sin(theta)), 20e3))
    cycles = align(replace(recording, channels=channels, lift_table=None))
    expected = np.tile(1e7 * (1.0 + np.sin(cycles.theta)), (cycles.index.size, 1))
    np.testing.assert_allclose(cycles.channels["chamber_pressure"], expected, atol=2e4)


def test_channel_that_nothing_ties_is_left_out_and_told() -> None:
    recording = make(RIG)
    config = replace(recording.config, loggers=(*recording.config.loggers, LoggerSpec("T", "independent")))
    channels = (*recording.channels, extra("fuel_temperature", np.full(40, 310.0), 10.0, "T"))
    cycles = align(replace(recording, config=config, channels=channels))
    assert not cycles.channels
    assert "channel_untied" in {finding.code for finding in cycles.findings}


def test_channel_of_another_time_is_left_out_and_told() -> None:
    recording = make(RIG)
    late = replace(extra("fuel_temperature", np.full(40, 310.0), 10.0), start_time=100.0)
    cycles = align(replace(recording, channels=(*recording.channels, late)))
    assert not cycles.channels
    assert "channel_not_covering" in {finding.code for finding in cycles.findings}


def test_files_hold_what_was_aligned(tmp_path: Path) -> None:
    wheel = Wheel(duration=2.0)
    recording = wheel_recording(wheel)
    channels = tuple(c for c in recording.channels if c.quantity != "pressure")
    warm = replace(extra("housing_temperature", np.linspace(320.0, 321.0, 40), 20.0), calibration=None)
    recording = replace(recording, channels=(*channels, warm), lift_table=None)
    doc = write_alignment(recording, align(recording), "2026-01-01T00:00:00+00:00", tmp_path)
    with h5py.File(tmp_path / "aligned.h5") as file:
        assert file["cycles/housing_temperature"].attrs["units"] == "K"
        assert file["cycles/housing_temperature_mean"].shape == (doc["cycles_used"],)
        assert file["mean/angle_deviation"].attrs["units"] == "rad"
        assert "cycles/pressure" not in file
    assert "housing temperature [°C]" in (tmp_path / "align.html").read_text(encoding="utf-8")

"""Samples that a log lost, clocks that run apart, and running that changes: found from how late each cycle comes."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.align import align, lags
from camtorque.align.lags import cycle_lags
from camtorque.ingest import read_recording
from camtorque.ingest.raw import ArraySource
from camtorque.records import Array, CamCycles, Recording

EXAMPLES = Path(__file__).resolve().parents[2] / "raw_examples"
FULL = read_recording(EXAMPLES / "A_0500rpm")
TURN_SAMPLES = FULL.of("pressure")[0].sample_rate * 60.0 / 500.0


def changed(change, *quantities: str) -> Recording:
    """Return the example with the samples of some channels changed."""
    channels = tuple(
        replace(item, source=ArraySource(change(item.read_volts()))) if item.quantity in quantities else item
        for item in FULL.channels
    )
    return replace(FULL, channels=channels)


def faster(ppm: float):
    def change(volts: Array) -> Array:
        place = np.arange(volts.size) / (1.0 + 1e-6 * ppm)
        return np.interp(place[place <= volts.size - 1.0], np.arange(volts.size), volts)

    return change


def without(share: float, count: int):
    def change(volts: Array) -> Array:
        first = int(share * volts.size)
        return np.delete(volts, slice(first, first + count))

    return change


def told(cycles: CamCycles) -> dict[str, str]:
    codes = ("samples_lost", "trigger_slipped", "clock_wanders", "running_changes", "running_alternates")
    return {f"{item.code} {item.where}": item.text for item in cycles.findings if item.code in codes}


def wander(cycles: CamCycles) -> list[float]:
    return [row.std_deg for row in cycles.angle_errors if row.source.startswith("wandering")]


@pytest.fixture(scope="module")
def sound() -> CamCycles:
    return align(FULL)


def test_a_lag_is_found_to_a_hundredth_of_a_degree() -> None:
    theta = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
    lags = np.deg2rad([0.0, 0.05, -0.3, 2.0, -90.0, 0.0])
    rows = np.array([np.exp(4.0 * np.cos(theta - 1.0 - lag)) for lag in lags])
    sound = np.array([True, True, True, True, True, False])
    found = cycle_lags(rows, sound)
    assert np.isnan(found[-1])
    assert np.degrees(np.ptp((found - lags)[:-1])) < 0.01


@pytest.mark.parametrize("place", [6, 12, 17])
def test_an_edge_that_moves_on_by_one_sample_is_no_drift(place: int) -> None:
    """A shaft that nearly keeps step with the logger's clock: all later turns meet the next sample at once."""
    theta, turns = np.linspace(0.0, 2.0 * np.pi, 1800, endpoint=False), np.arange(24)
    sample = np.deg2rad(0.225)
    least = max(float(lags.LEAST_MOVE) * np.pi / 180.0, lags.SAMPLES_WIDE * sample / np.sqrt(12.0))

    def drift(lag: Array) -> float:
        rows = np.array([np.exp(4.0 * np.cos(theta - 1.0 - one)) for one in lag])
        return lags._drift(rows, turns, cycle_lags(rows, np.ones(turns.size, dtype=bool)), 0.08 * turns, least)

    assert drift(np.where(turns < place, 0.0, sample)) == 0.0
    assert drift(3.0 * sample * turns / 23.0) * 0.08 * 23 == pytest.approx(3.0 * sample, rel=0.02)


def test_a_sound_recording_is_left_as_it_is(sound: CamCycles) -> None:
    assert told(sound) == {}
    assert wander(sound) == []


@pytest.mark.parametrize(
    ("quantities", "unsure"), [(("torque",), [0.0, 0.84]), (("pressure",), [0.84, 0.84]), (("trigger",), [0.84, 0.0])]
)
def test_clocks_that_run_apart_are_told_taken_off_and_budgeted(
    sound: CamCycles, quantities: tuple[str, ...], unsure: list[float]
) -> None:
    found = align(changed(faster(100.0), *quantities))
    (text,) = told(found).values()
    names = " and ".join(quantities) if quantities != ("trigger",) else "torque and pressure"
    assert text.startswith(f"{names} wander")
    assert "against the trigger, by a shift alone: clocks that differ by" in text
    assert wander(found) == pytest.approx(unsure, abs=0.03)
    # both clocks began together here, so that the mean cycle is that of the sound recording
    for one, other in ((found.mean_torque, sound.mean_torque), (found.mean_pressure, sound.mean_pressure)):
        assert np.sqrt(np.mean((one - other) ** 2)) < 0.01 * np.ptp(other)


@pytest.mark.parametrize("quantity", ["torque", "pressure", "trigger"])
@pytest.mark.parametrize("share", [0.2, 0.6])
def test_behind_lost_samples_no_cycle_is_used(sound: CamCycles, quantity: str, share: float) -> None:
    found = align(changed(without(share, 20), quantity))
    assert any(key.startswith(("trigger_slipped", "samples_lost")[quantity != "trigger"]) for key in told(found))
    text = "".join(told(found).values())
    # torque and pressure that come later alike are moved by what both are held against
    both = "on the torque and pressure come " in text and "the trigger slipped, or its log lost samples there" in text
    assert both == (quantity == "trigger")
    assert both or (f"on the {quantity} comes " in text and ": a log lost samples there" in text)
    assert 0.2 * sound.index.size * share < found.index.size <= share * sound.index.size + 1.0
    assert np.sqrt(np.mean((found.mean_torque - sound.mean_torque) ** 2)) < 0.01 * np.ptp(sound.mean_torque)
    lost = next(row for row in found.cut_flow if row.reason == "samples_lost")
    assert lost.cycles > 0


def test_two_losses_leave_what_is_before_the_first() -> None:
    found = align(changed(lambda volts: without(0.3, 8)(without(0.7, 8)(volts)), "torque"))
    assert found.index[-1] < 0.31 * 50
    assert len(told(found)) == 1


def test_a_wrong_sample_rate_is_told_as_one() -> None:
    assert "a sample rate 0.05 % off" in "".join(told(align(changed(faster(500.0), "torque"))).values())


def test_another_load_is_told_as_another_running() -> None:
    def loaded(volts: Array) -> Array:
        return volts * np.where(np.arange(volts.size) > 0.7 * volts.size, 1.2, 1.0)

    found = align(changed(loaded, "torque", "pressure"))
    assert list(told(found)) == ["running_changes cut-flow"]
    assert "load, speed or state changed there" in told(found)["running_changes cut-flow"]
    assert found.index.size == pytest.approx(0.7 * 48, abs=2)


def left_in_the_line(share: float, every: int):
    """Keep the pressure above a share of its swing for most of a turn after the peak, in one of ``every`` cycles."""

    def change(volts: Array) -> Array:
        since = (np.arange(volts.size) - np.argmax(volts[: int(TURN_SAMPLES)])) / TURN_SAMPLES
        raised = (np.floor(since) % every == 0) & (since % 1.0 < 0.8)
        lacking = np.maximum(volts.min() + share * np.ptp(volts) - volts, 0.0)
        return volts + np.where(raised, 0.9 * lacking, 0.0)

    return change


def test_a_pump_that_now_and_then_runs_otherwise_is_reported_as_most_cycles_go() -> None:
    found = align(changed(left_in_the_line(0.2, 3), "pressure"))
    assert list(told(found)) == ["running_alternates cut-flow"]
    assert "runs in more than one way" in told(found)["running_alternates cut-flow"]
    assert found.index.size == pytest.approx(0.66 * 48, abs=3)
    assert np.ptp(np.min(found.pressure, axis=1)) < 0.05 * np.ptp(found.mean_pressure)


def test_a_pump_whose_line_is_full_every_other_stroke_follows_the_cam() -> None:
    alternating = left_in_the_line(0.6, 2)
    channels = tuple(
        replace(item, source=ArraySource((alternating(volts) if item.quantity == "pressure" else volts)[:kept]))
        for item in FULL.channels
        for volts in (item.read_volts(),)
        for kept in (int(0.825 * volts.size),)
    )
    assert align(replace(FULL, channels=channels)).index.size > 18


@pytest.mark.parametrize(("name", "every"), [("A_0500rpm", 20), ("A_1000rpm", 25), ("A_1250rpm", 20)])
def test_edges_that_beat_with_a_coarse_clock_are_no_lost_samples(name: str, every: int) -> None:
    """A sample of the trigger is three degrees here: neighbouring turns meet it at nearly the same place."""
    recording = read_recording(EXAMPLES / name)
    channels = tuple(
        replace(item, source=ArraySource(item.read_volts()[::every]), sample_rate=item.sample_rate / every)
        if item.quantity == "trigger"
        else item
        for item in recording.channels
    )
    cycles = align(replace(recording, channels=channels))
    assert told(cycles) == {}
    assert cycles.index.size > 40


def test_what_wanders_behind_a_start_up_is_told_by_its_rate_and_over_the_whole_recording() -> None:
    def started(volts: Array) -> Array:
        share = np.arange(volts.size) / volts.size
        place = np.where(share < 0.5, 0.5 * share * (1.0 + share), share - 0.125)
        return np.interp(volts.size * place, np.arange(volts.size), volts)

    started_all = changed(started, "torque", "pressure", "trigger")
    channels = tuple(
        replace(item, source=ArraySource(faster(250.0)(item.read_volts()))) if item.quantity == "pressure" else item
        for item in started_all.channels
    )
    cycles = align(replace(started_all, channels=channels))
    assert cycles.index.size < 0.6 * cycles.cycles_found
    (text,) = [item.text for item in cycles.findings if item.code == "clock_wanders"]
    ppm = float(re.search(r"clocks that differ by (\S+) ppm", text)[1])
    assert ppm == pytest.approx(250.0, rel=0.05)
    over_all = 250.0e-6 * 360.0 * cycles.mean_speed / (2.0 * np.pi) * cycles.duration
    assert wander(cycles)[0] == pytest.approx(0.5 * over_all, rel=0.05)

"""Levels that move during a recording are told, and so is a recording of which little is used."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque import stacks
from camtorque.align import align
from camtorque.align.drift import FEWEST, changed_load, drift_findings, level_drifts, size_findings
from camtorque.ingest import read_recording
from camtorque.ingest.raw import ArraySource
from camtorque.records import Refusal

EXAMPLES = Path(__file__).resolve().parents[2] / "raw_examples"
N = 360
IDLE = np.arange(200, N)
CYCLE = np.where(np.arange(N) < 60, 50.0, 0.0)


def told(quantity: str, drift: float, cycles: int = 40, scatter: float = 0.05, size: float = 1.0) -> str:
    level = drift * np.linspace(0.0, 1.0, cycles) + np.random.default_rng(2).normal(0.0, scatter, cycles)
    rows = size * (CYCLE + level[:, None])
    mean = np.mean(rows, axis=0)
    drifts = level_drifts(IDLE, {quantity: (rows, mean)}, np.arange(cycles))
    found = drift_findings(drifts, {quantity: float(np.max(mean))})
    return found[0].text if found else ""


def test_a_drifting_zero_is_told_with_its_size() -> None:
    assert re.match(r"the torque on the base circle drifts by \+2 N m \(3\.9 % of the peak\)", told("torque", 2.0))
    assert "drifts by -2" in told("torque", -2.0)


def resident_share(stack: np.memmap) -> float:
    """Share of a stack on disk that the process holds in memory."""
    start = f"{stack.ctypes.data:x}-"
    mapping = Path("/proc/self/smaps").read_text().split(f"\n{start}")[1]
    found = re.search(r"Rss: +(\d+) kB", mapping)
    assert found
    return 1024.0 * int(found[1]) / stack.nbytes


@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="the system does not say what a process holds")
def test_a_long_stack_is_given_back_after_its_drift_is_sought(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stacks, "LARGEST_IN_MEMORY", 1000)
    rows = stacks.empty_stack(400, N)
    rows[:] = CYCLE
    assert isinstance(rows, np.memmap)
    assert resident_share(rows) > 0.9
    level_drifts(IDLE, {"torque": (rows, CYCLE)}, np.arange(400))
    assert resident_share(rows) < 0.1


def test_a_rest_pressure_that_moves_is_told_in_bar() -> None:
    assert re.match(r"the pressure .* drifts by \+5 bar", told("pressure", 5.0, size=1e5, scatter=0.01))
    assert told("pressure", 0.5, size=1e5) == ""


@pytest.mark.parametrize(("drift", "cycles", "scatter"), [(0.2, 40, 0.05), (0.5, 40, 1.0), (2.0, FEWEST - 1, 0.05)])
def test_a_small_drift_one_within_the_scatter_and_few_cycles_are_not_told(drift, cycles, scatter) -> None:
    assert told("torque", drift, cycles, scatter) == ""


def sampled(recording, quantity: str, change):
    """Return the recording with the voltages of one channel changed: change(volts, first sample)."""

    def changed(channel):
        if channel.quantity != quantity:
            return channel
        return replace(channel, source=ArraySource(change(channel.read_volts().astype(float))), scale=1.0)

    return replace(recording, channels=tuple(changed(channel) for channel in recording.channels))


def test_a_zero_that_drifts_through_the_alignment_is_told() -> None:
    recording = read_recording(EXAMPLES / "A_1000rpm")
    clean = {row.code for row in align(recording).findings}
    drifting = align(sampled(recording, "torque", lambda volts: volts + 0.05 * np.linspace(0.0, 1.0, volts.size)))
    assert "torque_drifts" in {row.code for row in drifting.findings}
    assert not {"torque_drifts", "pressure_drifts", "few_cycles_used"} & clean


def test_a_gain_that_drifts_is_told_and_a_load_that_does_is_not() -> None:
    recording = read_recording(EXAMPLES / "A_1000rpm")
    zero = recording.of("torque")[0].calibration.zero_volts
    grown = align(sampled(recording, "torque", lambda v: zero + (v - zero) * np.linspace(1.0, 1.05, v.size)))
    (row,) = [item for item in grown.findings if item.code == "torque_size_drifts"]
    assert re.match(r"the torque of a cycle changes by \+4\.\d % .*, its line pressure by [+-]?0\.\d+ %: the", row.text)
    assert row.severity == "warning"
    assert "torque_size_drifts" not in {item.code for item in align(recording).findings}
    rng, theta, index = np.random.default_rng(3), np.linspace(0.0, 2.0 * np.pi, 360), np.arange(40.0)
    stroke = np.maximum(np.sin(theta), 0.0)
    load = 1.0 + 0.04 * index[:, None] / 40.0 + 0.01 * rng.standard_normal((40, 1))
    rows = [load * stroke * peak + 1e-3 * peak * rng.standard_normal((40, 360)) for peak in (50.0, 5e7)]
    torque, pressure = ((values, values.mean(axis=0)) for values in rows)
    assert size_findings(torque, pressure, index) == ()
    assert size_findings((torque[0][:5], torque[1]), (pressure[0][:5], pressure[1]), index[:5]) == ()
    ramp = 1.0 + 0.4 * index[:, None] / 40.0
    rows = [ramp * stroke * peak + 1e-3 * peak * rng.standard_normal((40, 360)) for peak in (50.0, 5e7)]
    rows[1] *= 1.0 + 0.1 * (ramp - 1.0)  # of two straight lines and a bend a regression takes the wrong one
    torque_along, pressure_along = ((values, values.mean(axis=0)) for values in rows)
    assert size_findings(torque_along, pressure_along, index) == ()
    flat = (np.full((40, 360), 2e5), np.full(360, 2e5))
    assert size_findings(torque, flat, index)[0].code == "torque_size_drifts"


@pytest.mark.parametrize(
    ("sizes", "how"),
    [
        (
            np.repeat([0.9, 1.1], 20),
            r"from one fifth of the recording to the next \(90, 90, 100, 110, 110 %\): cut",
        ),
        (np.linspace(0.95, 1.05, 40), r"from one fifth of the recording to the next \(9\d\.\d, .* %\): cut the logs"),
        (np.tile([0.95, 1.05], 20), r"every other cycle by 10 %: record where the pump runs evenly"),
        (np.tile([0.9, 1.0, 1.1, 1.0], 10), r"from cycle to cycle: record once the load is steady"),
        (np.tile([0.99, 1.0, 1.01, 1.0], 10), ""),
        (np.linspace(0.98, 1.02, 40), ""),
        (np.repeat([0.9, 1.1], 4), ""),
    ],
)
def test_several_loads_in_one_recording_are_told(sizes, how: str) -> None:
    """Three loads joined were one *Explained* report of 62 of 62 cycles, with a chamber peak that none of them had."""
    theta = np.linspace(0.0, 2.0 * np.pi, 360)
    rows = 2.0 + 50.0 * sizes[:, None] * np.maximum(np.sin(theta), 0.0)
    found = changed_load((rows, rows.mean(axis=0)))
    assert len(found) == bool(how)
    assert all(re.search(how, row.text) and row.severity == "warning" for row in found)


def test_a_step_of_a_coarse_converter_is_no_drift() -> None:
    """8 bits over 10 V: the base circle crosses the border of two steps of 0.8 N m for a drift of 0.03 N m."""

    def coarse(volts):
        return np.round(volts * 25.6) / 25.6

    recording = read_recording(EXAMPLES / "A_1000rpm")
    assert "torque_drifts" not in {row.code for row in align(sampled(recording, "torque", coarse)).findings}
    drifting = sampled(recording, "torque", lambda v: coarse(v + np.linspace(0.0, 0.1, v.size)))
    assert "torque_drifts" in {row.code for row in align(drifting).findings}


def test_a_channel_that_died_is_refused_as_such() -> None:
    def dead(volts):
        volts[volts.size // 4 :] = volts[volts.size // 4]
        return volts

    with pytest.raises(Refusal, match=r"the torque stands still in 7\d % of the cycles, expected in few"):
        align(sampled(read_recording(EXAMPLES / "A_1000rpm"), "torque", dead))


def test_missing_pulses_that_leave_two_strokes_in_a_revolution_are_told() -> None:
    """Every second pulse is gone: the rest are regular."""

    def halved(volts):
        rising = np.flatnonzero((volts[1:] > 2.5) & (volts[:-1] <= 2.5))
        for start in rising[::2]:
            volts[start - 200 : start + 400] = 0.0
        return volts

    recording = read_recording(EXAMPLES / "A_1000rpm")
    texts = [row.text for row in align(sampled(recording, "trigger", halved)).findings if row.code == "several_strokes"]
    assert len(texts) == 1
    assert texts[0].startswith("a revolution by the pulses holds the same torque 2 times, the lift table rises once")
    assert "several_strokes" not in {row.code for row in align(recording).findings}


def test_a_recording_of_which_most_is_rejected_is_told() -> None:
    """A speed that rises by a tenth: only the revolutions of one speed are used."""

    def ramp(volts):
        place = np.arange(volts.size)
        return np.interp(place + 0.1 * place * (volts.size - place) / volts.size, place, volts)

    recording = read_recording(EXAMPLES / "A_1000rpm")
    for quantity in ("torque", "pressure", "trigger"):
        recording = sampled(recording, quantity, ramp)
    texts = [row.text for row in align(recording).findings if row.code == "few_cycles_used"]
    assert len(texts) == 1
    assert re.match(r"only \d+ of \d+ complete cycles are used, most others fail 'speed_outlier'", texts[0])

"""Edges of digital pick-ups: logic levels, any speed, hum, standstill; a coarse period is no jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from align_truth import Rig, Samples, Shaft, make, trigger_channel
from camtorque.align import align
from camtorque.signal import edges as edge_search
from camtorque.signal.edges import find_edges


def logic(rig: Rig, rate: float) -> np.ndarray:
    """Levels 0 and 1 only, as a logic analyser or a digital input writes them."""
    return (trigger_channel(replace(rig, trigger_noise=0.0, flank=1e-9), rate=rate).source.values > 2.5).astype(float)


def edge_errors(rig: Rig, time: np.ndarray) -> np.ndarray:
    truth = rig.pulse_times() + rig.switching_delay
    return time - truth[np.argmin(np.abs(time[:, None] - truth[None, :]), axis=1)]


@pytest.mark.parametrize("rate", [2e3, 10e3])
def test_logic_level_edges_are_known_to_one_sample_and_say_so(rate: float) -> None:
    rig = Rig(shaft=Shaft(rpm=1234.0), duration=20.0)
    channel = replace(trigger_channel(rig, rate=rate), source=Samples(logic(rig, rate)))
    edges = find_edges(channel, "rising")
    rms = np.sqrt(np.mean(edge_errors(rig, edges.time) ** 2))
    assert edges.noise == pytest.approx(1.0 / np.sqrt(12.0) / rate, rel=0.01)
    # 400 edges: their rms is known to 4 %; stated over actual lies between 1 and 2 but for that
    assert 0.92 < edges.noise / rms < 2.0


def test_coarsely_sampled_levels_are_neither_jumps_nor_unsteady() -> None:
    # 3000 rpm at 5 kHz: a sample is 1 % of the period
    rig = Rig(shaft=Shaft(rpm=3000.0), duration=4.0, trigger_rate=5e3)
    recording = make(rig)
    trigger = replace(recording.channels[-1], source=Samples(logic(rig, 5e3)))
    cycles = align(replace(recording, channels=(*recording.channels[:-1], trigger)))
    assert "clock_jump" not in {finding.code for finding in cycles.findings}
    assert not [row for row in cycles.cut_flow if row.cycles and row.reason in ("start_stop", "speed_outlier")]


@pytest.mark.parametrize("part", [0.1, 0.25, 0.5])
def test_few_edges_with_flanks_of_a_part_of_a_sample_are_stated_as_unsure_as_they_are(part: float) -> None:
    """Too few to tell how long the flank is: most show no sample on it."""
    rate, errors, stated = 5e3, [], []
    for seed in range(12):
        rig = Rig(shaft=Shaft(start=0.3 + 0.37 * seed), duration=2.0, trigger_rate=rate, flank=part / rate,
                  trigger_noise=0.01, seed=seed)  # fmt: skip
        edges = find_edges(trigger_channel(rig), "rising")
        errors.append(edge_errors(rig, edges.time))
        stated.append(edges.noise)
    assert 0.95 < np.median(stated) / np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 1.3


def test_edges_of_a_short_log_of_a_coarse_trigger_are_no_lost_samples() -> None:
    for seed in range(12):
        rig = Rig(shaft=Shaft(rpm=1500.0, start=0.3 + 0.37 * seed), duration=1.0, trigger_rate=5e3, flank=2e-5,
                  trigger_noise=0.01, torque_noise=0.3, pressure_noise=1e5, seed=seed)  # fmt: skip
        assert not {"samples_lost", "clock_jump"} & {finding.code for finding in align(make(rig)).findings}


@pytest.mark.parametrize("rpm", [5.0, 60.0, 3000.0, 20000.0])
def test_edges_are_found_at_any_speed_beside_hum_and_standstill(rpm: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edge_search, "BLOCK", 8192)
    rate = max(2e3, 1000.0 * rpm / 60.0)
    rig = Rig(shaft=Shaft(rpm=rpm), duration=12.0 * 60.0 / rpm, trigger_rate=rate, flank=2.0 / rate)
    channel = trigger_channel(rig)
    still = np.full(channel.n_samples // 2, 0.06)
    volts = np.r_[still, channel.source.values]
    volts = volts + 0.4 * np.sin(2.0 * np.pi * 50.0 * np.arange(volts.size) / rate)
    edges = find_edges(replace(channel, source=Samples(volts)), "rising")
    truth = rig.pulse_times() + rig.switching_delay
    truth = truth[(truth > 0.0) & (truth < rig.duration - 4.0 / rate)]
    assert edges.time.size == truth.size
    np.testing.assert_allclose(edges.time - still.size / rate, truth, atol=1.0 / rate)

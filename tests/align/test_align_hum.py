"""Mains hum on the torque is told from what the cam does."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from camtorque.align import hum
from camtorque.align.hum import MAINS_HZ, hum_findings

N = 3600
THETA = np.arange(N) * 2.0 * np.pi / N
LIFT = 8e-3 * np.where(THETA < 2.4, np.sin(np.pi * THETA / 2.4) ** 2, 0.0)
CLEAN = 0.4 + 50.0 * np.exp(-(((THETA - 0.7) / 0.25) ** 2)) - 30.0 * np.exp(-(((THETA - 1.7) / 0.2) ** 2))


def cycles(rpm: float, hertz: float, amplitude: float, drift: float = 0.0, noise: float = 0.1, seed: int = 1):
    """Return torque (40, N), speed and index of cycles with hum, cycle scatter and low-passed noise."""
    rng = np.random.default_rng(seed)
    speed = rpm * np.pi / 30.0 * (1.0 + drift * np.linspace(-1.0, 1.0, 40))
    start = np.r_[0.0, np.cumsum(2.0 * np.pi / speed)[:-1]]
    time = start[:, None] + THETA / speed[:, None]
    white = np.fft.rfft(rng.normal(0.0, noise, (40, N)), axis=1) / (1.0 + (np.arange(N // 2 + 1) / 120.0) ** 2)
    scatter = np.fft.irfft(white, N, axis=1) + CLEAN * rng.normal(0.0, 2e-3, (40, 1))
    return CLEAN + scatter + amplitude * np.sin(2.0 * np.pi * hertz * time + 0.4), speed, np.arange(40)


def hum_of(torque, speed, index):
    return hum_findings(THETA, torque, np.mean(torque, axis=0), speed, index, LIFT)


def told(*arguments, **options) -> str:
    torque, speed, index = cycles(*arguments, **options)
    found = hum_of(torque, speed, index)
    return found[0].text if found else ""


@pytest.mark.parametrize(("rpm", "hertz"), [(500.0, 50.0), (300.0, 50.0), (600.0, 60.0), (1000.0, 50.0)])
def test_locked_hum_is_told_on_the_base_circle(rpm, hertz):
    text = told(rpm, hertz, 0.03)
    assert text.startswith(f"{hertz:.0f} Hz hum of 0.0")
    assert float(text.split()[4]) == pytest.approx(0.03, rel=0.05)
    assert "stays in the mean cycle" in text


@pytest.mark.parametrize(("amplitude", "severity"), [(0.03, "info"), (1.0, "warning")])
def test_large_hum_that_stays_in_the_mean_cycle_is_a_warning(amplitude, severity):
    torque, speed, index = cycles(1000.0, 50.0, amplitude)
    assert [row.severity for row in hum_of(torque, speed, index)] == [severity]


@pytest.mark.parametrize("hertz", MAINS_HZ)
def test_drifting_hum_is_told_by_the_cycles(hertz):
    text = told(517.0, hertz, 0.03, drift=0.002)
    assert text.startswith(f"{hertz:.0f} Hz hum of 0.03") or text.startswith(f"{hertz:.0f} Hz hum of 0.02")
    assert "drifts over the cycles" in text


@pytest.mark.parametrize("rpm", [300.0, 500.0, 517.0, 750.0, 1250.0])
@pytest.mark.parametrize("seed", range(4))
def test_no_hum_no_word(rpm, seed):
    assert told(rpm, 50.0, 0.0, seed=seed) == ""


@pytest.mark.parametrize("hertz", [37.0, 75.0])
def test_another_frequency_is_not_called_mains(hertz):
    assert told(517.0, hertz, 0.03) == ""


def test_ringing_after_the_stroke_is_not_called_mains():
    torque, speed, index = cycles(500.0, 50.0, 0.0)
    ringing = np.where(THETA > 2.4, 0.3 * np.exp(-(THETA - 2.4) / 0.5) * np.sin(6.0 * 6.3 * (THETA - 2.4)), 0.0)
    assert hum_of(torque + ringing, speed, index) == ()


def test_the_hum_of_many_cycles_is_told_in_pieces(monkeypatch):
    """An hour has 60 000 cycles: their waves would take a gigabyte."""
    torque, speed, index = cycles(517.0, 50.0, 0.03, drift=0.002)
    whole = hum_of(torque, speed, index)
    monkeypatch.setattr(hum, "PIECE", 7)
    assert hum_of(torque, speed, index) == whole
    chance = np.random.default_rng(1)
    speed = chance.normal(105.0, 0.3, 5000)
    bins, start = chance.normal(size=(5000, hum.POINTS)), np.r_[0.0, np.cumsum(2.0 * np.pi / speed)][:-1]
    monkeypatch.setattr(hum, "PIECE", 100)
    tracemalloc.start()
    hum._over_cycles(50.0, bins, speed, start)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < bins.nbytes / 3.0


@pytest.mark.parametrize("size", [360, 540, 700, 1000])
def test_bins_hold_a_whole_revolution_on_any_grid(size):
    """As means over uneven bins: a sine of the revolution comes out as it is, to the width of a bin."""
    angle = np.arange(size) * 2.0 * np.pi / size
    bins = hum._binned(np.tile(np.sin(angle), (3, 1)))
    assert bins.shape == (3, hum.POINTS)
    middle = (np.arange(hum.POINTS) + 0.5) * 2.0 * np.pi / hum.POINTS
    assert np.max(np.abs(bins - np.sin(middle))) < 2.0 * np.pi / hum.POINTS


def test_a_grid_with_fewer_points_than_bins_tells_nothing():
    angle = np.arange(300) * 2.0 * np.pi / 300
    torque = np.tile(np.sin(angle), (5, 1))
    assert hum_findings(angle, torque, torque[0], np.full(5, 60.0), np.arange(5), np.sin(angle)) == ()

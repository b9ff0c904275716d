"""What the fit refuses before it starts, and how bins are weighed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.prepare import CORRELATION, DISCREPANCY, bin_weights, halves
from camtorque.records import CamCycles, Refusal
from rig_bridge import cycles_of
from rigs.families import FAMILIES
from rigs.rig import simulate


def cycles(n_theta: int = 3600, n_cycles: int = 6) -> CamCycles:
    theta = 2 * np.pi * np.arange(n_theta) / n_theta
    rows = np.ones((n_cycles, n_theta))
    truth = FAMILIES["bare"](np.random.default_rng(0))
    template = cycles_of(simulate(truth, speed_rpm=1200, n_cycles=4, seed=0, step=2e-5), n_theta=360)
    index = np.arange(n_cycles)
    return replace(
        template, theta=theta, torque=rows * 5.0, pressure=rows * 1e5, speed=np.full(n_cycles, 100.0), index=index,
        held_out=index % 2 == 1, cycles_found=n_cycles,
    )  # fmt: skip


@pytest.mark.parametrize("n_theta", [360, 3601, 1799])
def test_grid_that_the_chamber_cannot_use_is_refused(n_theta):
    with pytest.raises(Refusal, match=f"angle grid of {n_theta} points, expected a multiple of 5 and at least 1800"):
        halves(cycles(n_theta))


def test_too_few_cycles_are_refused():
    with pytest.raises(Refusal, match="3 usable cycles, at least 4 are needed"):
        halves(cycles(n_cycles=3))


def test_recording_without_torque_is_refused():
    with pytest.raises(Refusal, match="no torque channel"):
        halves(replace(cycles(), torque=None))


def test_weight_is_one_over_scatter_and_model_error():
    torque = np.array([0.0, 100.0])
    weight = bin_weights(torque, 0.03, DISCREPANCY, CORRELATION)
    quiet = 1.0 / np.sqrt(CORRELATION * (0.03**2 + (2e-4 * 100.0) ** 2))
    loaded = 1.0 / np.sqrt(CORRELATION * (0.03**2 + (2e-4 * 100.0) ** 2 + (DISCREPANCY * 100.0) ** 2))
    np.testing.assert_allclose(weight, [quiet, loaded], rtol=1e-12)

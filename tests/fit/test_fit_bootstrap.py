"""Cycle-block bootstrap against what resampling has to give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.bootstrap import block_indices, bootstrap, resampled
from camtorque.fit.problem import build_problem
from camtorque.fit.solve import solve
from camtorque.records import CamCycles, Estimate
from fit_cases import NOISE, THETA, N, fit_data

CYCLES = 24


def cycles_of(item, generator, scatter: float) -> CamCycles:
    """Return cycles about the mean torque of a case: one zero per cycle, and white noise."""
    mean = np.repeat(item.torque, N // item.torque.size)
    drift = scatter * generator.standard_normal((CYCLES, 1))
    torque = mean + drift + 0.01 * generator.standard_normal((CYCLES, N))
    return CamCycles(
        theta=np.array(THETA), torque=torque, pressure=np.tile(item.chain.line_pressure, (CYCLES, 1)),
        speed=np.full(CYCLES, item.chain.speed), index=np.arange(CYCLES), held_out=np.arange(CYCLES) % 2 == 1,
        cycles_found=CYCLES, duration=1.0, speed_ripple_percent=0.0, cut_flow=(), clocks=(), angle_errors=(),
        trigger_jitter_s=0.0, findings=(), torque_delay=Estimate(4.5e-4, 0.0, 4.5e-4),
    )  # fmt: skip


@pytest.fixture(scope="module")
def case():
    item = fit_data()
    free = replace(item, rows={**item.rows, "torque_zero": replace(item.rows["torque_zero"], prior=None)})
    problem = build_problem([free], ("trigger",))
    return problem, solve(problem), cycles_of(item, np.random.default_rng(3), 0.3)


@pytest.mark.parametrize(("n_cycles", "block"), [(1, 1), (7, 3), (12, 3), (5, 8)])
def test_blocks_are_neighbours_and_fill_the_count(n_cycles, block):
    drawn = block_indices(n_cycles, block, np.random.default_rng(0))
    assert drawn.size == n_cycles
    assert set(drawn) <= set(range(n_cycles))
    for start in range(0, n_cycles, block):
        piece = drawn[start : start + block]
        assert np.array_equal(piece, (piece[0] + np.arange(piece.size)) % n_cycles)


def test_zero_scatters_as_the_mean_of_the_cycles(case):
    problem, solution, cycles = case
    found = bootstrap(problem, solution, [cycles], count=100, seed=1, block=1)
    fitted = cycles.torque[~cycles.held_out].mean(axis=1)
    # the zero follows the cycles' mean; 100 draws tell a deviation to 7 %, three of which are allowed
    assert found.std[found.names.index("torque_zero")] == pytest.approx(np.std(fitted) / np.sqrt(fitted.size), rel=0.21)
    assert found.samples.shape == (100, len(found.names))
    assert np.all(found.low <= found.high)


def test_held_out_cycles_are_never_drawn(case):
    problem, _, cycles = case
    spoiled = np.array(cycles.torque)
    spoiled[cycles.held_out] = 1e6
    item = resampled(problem.data[0], replace(cycles, torque=spoiled), 3, np.random.default_rng(0))
    assert np.max(np.abs(item.torque)) < 1e3
    assert np.std(item.torque - problem.data[0].torque) < 3.0 * NOISE


def test_same_seed_same_draws(case):
    problem, solution, cycles = case
    one, two = (bootstrap(problem, solution, [cycles], count=3, seed=5) for _ in range(2))
    assert np.array_equal(one.samples, two.samples)


def test_cycles_of_every_recording_are_asked_for(case):
    problem, solution, _ = case
    with pytest.raises(ValueError, match="0 sets of cycles for 1 recordings"):
        bootstrap(problem, solution, [])

"""What the weights leave open during delivery, and a drive that only several speeds can tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit import fit_joint
from camtorque.fit.delivery import DISTRUSTED, drop_torque, with_valve_error
from camtorque.fit.prepare import CORRELATION
from camtorque.fit.problem import FIT_EFFECTS, SEVERAL_SPEEDS, build_problem, offered_effects
from camtorque.fit.single import FitOptions
from camtorque.fit.solve import try_at
from camtorque.laws.chain import BIN
from rig_prepared import prepared_run
from rigs.families import FAMILIES, change
from rigs.rig import simulate

SPEEDS = (380.0, 640.0, 1060.0)


@pytest.fixture(scope="module")
def controlled():
    """One pump on a light drive with a fast controller, at three speeds."""
    truth = FAMILIES["plain"](np.random.default_rng(7))
    truth = change(truth, driveline__drive_inertia=0.5, driveline__control_bandwidth_hz=11.0)
    runs = [
        simulate(truth, speed_rpm=speed, load=0.75, n_cycles=12, seed=k, step=1e-5) for k, speed in enumerate(SPEEDS)
    ]
    prepared = [prepared_run(run) for run in runs]
    return truth, [replace(p, data=replace(p.data, name=f"run{k}")) for k, p in enumerate(prepared)]


def test_drop_counts_where_the_valve_delivers(controlled):
    _, prepared = controlled
    item = prepared[0].data
    problem = build_problem([item], ("chamber", "trigger"))
    trial = try_at(problem, problem.start())
    values = problem.values(trial.x, 0)
    drop = drop_torque(problem.data[0].chain, trial.outputs[0], values)
    delivers = trial.outputs[0].flows[:, 2].reshape(-1, BIN).max(axis=1) > 0.0
    assert drop.shape == item.torque.shape
    assert np.all(drop[~delivers] == 0.0)
    assert np.max(drop) > 0.01 * np.max(item.torque)
    softer = with_valve_error(item, drop, DISTRUSTED)
    wanted = 1.0 / item.weight**2 + CORRELATION * (DISTRUSTED * drop) ** 2
    np.testing.assert_allclose(1.0 / softer.weight**2, wanted, rtol=1e-12)


def test_controller_is_offered_over_several_speeds(controlled):
    _, prepared = controlled
    assert offered_effects([p.data for p in prepared]) == FIT_EFFECTS
    assert not set(SEVERAL_SPEEDS) & set(offered_effects([prepared[0].data]))


def test_controlled_drive_is_recovered_from_three_speeds(controlled):
    truth, prepared = controlled
    effects = tuple(name for name in FIT_EFFECTS if name not in ("coupling", "spring"))
    campaign = fit_joint(prepared, FitOptions(effects=effects, use_ladder=False))
    found = {row.name: row for row in campaign.shared_parameters}
    trigger, frequency, admittance = (found[n] for n in ("trigger_offset", "drive_frequency", "drive_admittance"))
    assert abs(trigger.value - np.rad2deg(truth.trigger.angle_offset)) < 0.1
    assert abs(frequency.value - 11.0) < max(3.0 * frequency.stderr, 1.0)
    assert frequency.stderr < 6.0
    assert abs(admittance.value - 2.0) < max(3.0 * admittance.stderr, 0.2)
    for name in SEVERAL_SPEEDS:
        assert name in campaign.effects
    assert not {drift.name for drift in campaign.drifts} & {"drive_frequency", "drive_damping"}

"""Starts: from drawn values into one minimum, past a spill that hides and a drive that swings elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.joint import solve_joint
from camtorque.fit.prepare import with_rows
from camtorque.fit.problem import build_problem
from camtorque.fit.solve import solve
from camtorque.fit.starts import SCAN_EFFECTS, SWEPT, VALLEYS, find_start, past_valleys
from rig_prepared import prepared_run
from rigs.families import FAMILIES
from rigs.rig import simulate

EFFECTS = ("chamber", "trigger", "driveline", "sensor", "friction", "damping", "controller")


@pytest.fixture(scope="module")
def spill():
    run = simulate(
        FAMILIES["plain_spill"](np.random.default_rng(4)), speed_rpm=520.0, load=0.7, n_cycles=8, seed=1, step=1e-5
    )
    return prepared_run(run).data


@pytest.fixture(scope="module")
def pair():
    truth = FAMILIES["plain"](np.random.default_rng(4))
    items = []
    for k, speed in enumerate((450.0, 980.0)):
        run = simulate(truth, speed_rpm=speed, load=0.7, n_cycles=8, seed=k, step=1e-5)
        items.append(replace(prepared_run(run).data, name=f"run{k}"))
    return items


@pytest.mark.parametrize("seed", range(3))
def test_scattered_starts_find_the_spill(spill, seed):
    rng = np.random.default_rng(seed)
    wanted = solve(build_problem([spill], SCAN_EFFECTS)).chi_square
    names = (*SWEPT, "spill_lift", "trigger_offset", "shaft_compliance", "bulk_modulus_slope")
    changes = {}
    for name in names:
        row = spill.rows[name]
        changes[name] = {"start": float(np.clip(row.start * 2.0 ** rng.uniform(-1.0, 1.0), row.lower, row.upper))}
    found = find_start(with_rows(spill, changes))
    assert found.data.delivery == "spill"
    # a start is some iterations short of the minimum, and other valleys are tens of times higher
    assert solve(build_problem([found.data], SCAN_EFFECTS)).chi_square < 1.1 * wanted


@pytest.mark.parametrize("seed", range(3))
def test_scattered_starts_end_in_one_joint_minimum(pair, seed):
    rng = np.random.default_rng(seed)
    _, wanted = solve_joint(pair, EFFECTS)
    scattered = []
    factors = {name: 2.0 ** rng.uniform(-1.0, 1.0) for name in (*SWEPT, "shaft_compliance", "drive_admittance")}
    for item in pair:
        changes = {}
        for name, factor in factors.items():
            row = item.rows[name]
            changes[name] = {"start": float(np.clip(row.start * factor, row.lower, row.upper))}
        scattered.append(find_start(with_rows(item, changes)).data)
    _, found = solve_joint(scattered, EFFECTS)
    assert found.chi_square == pytest.approx(wanted.chi_square, rel=1e-4)


def test_valleys_are_searched_only_where_they_exist_and_never_for_worse(pair):
    problem = build_problem(pair, ("chamber", "trigger"))
    bottom = solve(problem)
    assert past_valleys(problem, bottom, solve).chi_square <= bottom.chi_square
    bare = build_problem(pair, ("trigger",))
    flat = solve(bare)
    assert past_valleys(bare, flat, solve) is flat
    full = {slot.name for slot in build_problem(pair, EFFECTS).nonlinear}
    assert all(set(valley) <= full for valley in VALLEYS)

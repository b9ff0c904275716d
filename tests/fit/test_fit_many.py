"""Many recordings by summaries: the same minimum, left-out recordings without another fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit import many
from camtorque.fit.joint import joint_start, left_out_error, without
from camtorque.fit.many import (
    MANY,
    layout,
    left_out_misfit,
    left_out_steps,
    minimise,
    reduced,
    solve_many,
    summarise,
    without_one,
)
from camtorque.fit.predict import left_out, shared_values
from camtorque.fit.problem import build_problem
from camtorque.fit.solve import solve
from rig_prepared import prepared_run
from rigs.families import FAMILIES
from rigs.rig import simulate

SPEEDS = (420.0, 540.0, 660.0, 790.0, 900.0, 1010.0)
EFFECTS = ("chamber", "trigger", "driveline", "friction", "lift")


@pytest.fixture(scope="module")
def data():
    truth = FAMILIES["plain"](np.random.default_rng(11))
    items = []
    for k, speed in enumerate(SPEEDS):
        run = simulate(truth, speed_rpm=speed, load=0.6 + 0.04 * k, n_cycles=8, seed=k, step=1e-5)
        items.append(replace(prepared_run(run).data, name=f"run{k}"))
    return joint_start(items)


@pytest.fixture(scope="module")
def minimum(data):
    problem = build_problem(data, EFFECTS)
    return problem, solve(problem)


def test_summaries_lead_to_the_same_minimum(minimum):
    problem, wanted = minimum
    # from nearby: port and valve have kinks, and a flat valley may hold two minima that differ by 1e-5
    found = solve_many(problem, wanted.x * (1.0 + 2e-5))
    assert found.converged
    # two routes of one Gauss-Newton iteration: equal but for the tolerance that ends each
    assert found.chi_square == pytest.approx(wanted.chi_square, rel=1e-6)
    np.testing.assert_allclose(found.hessian, wanted.hessian, atol=2e-3 * np.max(np.abs(wanted.hessian)))
    for mine, other in zip(found.residuals, wanted.residuals, strict=True):
        np.testing.assert_allclose(mine, other, atol=2e-3)


def test_own_parameters_are_eliminated_exactly(minimum):
    # The shared step of the reduced system is that of the whole one (Schur complement).
    problem, solution = minimum
    places = layout(problem)
    values = np.r_[solution.x, solution.c] + 1e-3 * places.steps
    values = np.clip(values, places.lower, places.upper)
    summaries = [summarise(problem, places, values, k) for k in range(len(SPEEDS))]
    parts = [reduced(s, places, values, k, 0.1) for k, s in enumerate(summaries)]
    size = values.size
    whole, pull = np.zeros((size, size)), -places.inverse * (values - places.mean) * places.steps
    for summary, own in zip(summaries, places.own, strict=True):
        used = np.r_[places.shared, own]
        whole[np.ix_(used, used)] += summary.gram
        pull[used] += summary.pull
    own_all = np.concatenate(places.own)
    damped = np.where(places.is_nonlinear, 0.1 * np.diag(whole), 0.0)
    damped[places.shared] = 0.0
    whole += np.diag(places.inverse * places.steps**2 + damped + 1e-12)
    cross, block = whole[np.ix_(own_all, places.shared)], whole[np.ix_(own_all, own_all)]
    matrix = whole[np.ix_(places.shared, places.shared)] - cross.T @ np.linalg.solve(block, cross)
    prior = np.diag((places.inverse * places.steps**2)[places.shared] + 1e-12)
    np.testing.assert_allclose(sum(p.matrix for p in parts) + prior, matrix, rtol=1e-6, atol=1e-9 * np.max(matrix))
    vector = pull[places.shared] - cross.T @ np.linalg.solve(block, pull[own_all])
    mine = sum(p.vector for p in parts)
    mine = mine - (places.inverse * (values - places.mean) * places.steps)[places.shared]
    np.testing.assert_allclose(mine, vector, rtol=1e-6, atol=1e-8 * np.max(np.abs(vector)))


def test_leaving_one_out_needs_no_other_fit(minimum):
    problem, solution = minimum
    steps = left_out_steps(problem, solution)
    for index in (0, 2, 5):
        fewer, moved = without_one(problem, solution, index, steps[index][1])
        exact_problem, exact = without(problem, solution, index)
        assert [s.name for s in fewer.nonlinear] == [s.name for s in exact_problem.nonlinear]
        predicted = left_out(fewer, moved, problem.data[index])[1]
        wanted = left_out(exact_problem, exact, problem.data[index])[1]
        rms = [float(np.sqrt(np.mean(s.residuals[0] ** 2))) for s in (predicted, wanted)]
        # first order against a fit of its own, a sixth of the data gone: within a quarter of the error itself
        assert rms[0] == pytest.approx(rms[1], rel=0.25)
        assert shared_values(fewer, moved)[0].keys() == shared_values(exact_problem, exact)[0].keys()


def test_misfit_of_left_out_recordings_exceeds_that_of_the_fit(minimum):
    problem, solution = minimum
    told = left_out_misfit(problem, solution)
    assert told.misfit > solution.data_chi_square
    assert told.rms == pytest.approx(left_out_error(problem, solution).rms, rel=0.35)


def test_many_recordings_go_by_summaries(data, monkeypatch):
    called = []
    monkeypatch.setattr(many, "solve_many", lambda *a: called.append("many"))
    monkeypatch.setattr(many, "solve", lambda *a: called.append("few"))
    minimise(build_problem(data, ("chamber",)))
    crowd = [replace(data[k % 3], name=f"copy{k}") for k in range(MANY)]
    minimise(build_problem(crowd, ("chamber",)))
    assert called == ["few", "many"]

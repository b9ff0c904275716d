"""The solver against scipy on the same problem: minimum, bounds, priors, marginal lift correction, convergence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.descent import Effort
from camtorque.fit.problem import FitData, build_problem, with_rows, with_starts
from camtorque.fit.quadratic import bounded_quadratic
from camtorque.fit.solver import (
    LiftModes,
    lift_modes,
    no_lift,
    normal_equations,
    smoother,
    solve,
    try_at,
)
from camtorque.laws import ROWS
from camtorque.laws.chain import BINS, COLUMN_NAMES, NONLINEAR_NAMES, binned, evaluate, filtered, transfer
from camtorque.laws.lift import lift_correction
from camtorque.units import DEGREE, angle_grid
from dense_solver import dense_solve
from fit_chain import chain_input
from scipy.optimize import least_squares, lsq_linear

FREE = ("trigger_offset", "guide_friction", "cutoff", "bearing_arm", "shaft_drag", "plunger_viscous", "torque_zero")
TRUE = {
    "trigger_offset": 0.4 * DEGREE, "guide_friction": 0.11, "cutoff": 930.0, "bearing_arm": 2.4e-4, "shaft_drag": 0.3,
    "plunger_viscous": 31.0, "torque_zero": -0.08,
}  # fmt: skip
NOISE = 0.05


@pytest.fixture(scope="module")
def data() -> FitData:
    chain = chain_input(n=BINS, uses_chamber=False)
    theta = angle_grid(BINS)
    basis = lift_correction(theta, chain.law.evaluate(theta, 0), 1e-6, 1e-6, DEGREE)
    item = FitData("one", chain, np.zeros(BINS), np.full(BINS, 1.0 / NOISE), "line", dict(ROWS), basis)
    problem = only_free(item)
    values, coefficients = problem.values(np.array([TRUE[parameter.row.name] for parameter in problem.parameters]), 0)
    output = evaluate(chain, values, coefficients)
    torque = output.torque + output.linear @ coefficients
    return replace(item, torque=torque + NOISE * np.random.default_rng(7).standard_normal(BINS))


def only_free(item, names=FREE):
    held = {name: ROWS[name].start for name in NONLINEAR_NAMES if name not in names}
    return build_problem([item], {**held, **{name: 0.0 for name in COLUMN_NAMES if name not in names}})


def plain(problem):
    """Return scipy's minimum of the same sum of squares over all free parameters at once."""
    item, steps = problem.data[0], problem.steps
    means, stds = problem.priors
    lower, upper = problem.bounds

    def residual(scaled):
        z = scaled * steps
        values, coefficients = problem.values(z, 0)
        output = evaluate(item.chain, values, coefficients)
        missing = (item.torque - output.torque - output.linear @ coefficients) * item.weight
        return np.r_[missing, (z - means) / stds]

    start = np.clip(problem.start, lower + 1e-6 * steps, upper - 1e-6 * steps) / steps
    found = least_squares(residual, start, "3-point", bounds=(lower / steps, upper / steps), xtol=1e-12, ftol=1e-12)
    return found.x * steps, 2.0 * found.cost


def test_minimum_is_that_of_scipy(data):
    problem = only_free(data)
    found = solve(problem, None, Effort(60), no_lift())
    expected, chi_square = plain(problem)
    assert found.converged
    assert found.chi_square == pytest.approx(chi_square, abs=0.01 + 1e-4 * chi_square)
    std = np.sqrt(np.diag(np.linalg.inv(found.hessian)))
    # it stops where an undamped step promises no more than that: its root in standard errors
    assert np.max(np.abs(found.z - expected) / std) < np.sqrt(0.01 + 1e-4 * chi_square)
    assert found.evaluations < 60


def test_truth_lies_where_noise_and_priors_allow(data):
    problem = only_free(data)
    found = solve(problem, None, Effort(60), no_lift())
    std = np.sqrt(np.diag(np.linalg.inv(found.hessian)))
    error = found.z - np.array([TRUE[parameter.row.name] for parameter in problem.parameters])
    assert np.max(np.abs(error) / std) < 3.5
    assert found.data_chi_square == pytest.approx(BINS, abs=5.0 * np.sqrt(2.0 * BINS))


@pytest.mark.parametrize("name", ["guide_friction", "bearing_arm"])
def test_a_bound_in_the_way_holds(data, name):
    below = 0.5 * TRUE[name]
    problem = only_free(with_rows(data, {name: {"upper": below, "start": 0.5 * below, "prior": None}}))
    found = solve(problem, None, Effort(60), no_lift())
    expected, chi_square = plain(problem)
    place = problem.index(name)
    assert found.z[place] == pytest.approx(below, rel=1e-12)
    assert expected[place] == pytest.approx(below, rel=1e-3)
    assert found.chi_square == pytest.approx(chi_square, rel=1e-3)
    assert found.gradient[place] > 0.0


def test_a_narrow_prior_wins_over_the_data(data):
    narrow = {"prior": (0.02, 1e-6), "start": 0.05}
    found = solve(only_free(with_rows(data, {"guide_friction": narrow})), None, Effort(60), no_lift())
    assert found.z[only_free(data).index("guide_friction")] == pytest.approx(0.02, abs=1e-4)
    wide = solve(only_free(data), None, Effort(60), no_lift())
    assert found.data_chi_square > wide.data_chi_square + 10.0


def test_an_unfinished_search_says_so(data):
    far = with_starts(data, {"trigger_offset": -2.0 * DEGREE, "guide_friction": 0.3, "cutoff": 500.0})
    problem = only_free(far)
    short = solve(problem, None, Effort(1), no_lift())
    assert not short.converged
    whole = solve(problem, None, Effort(60), no_lift())
    assert whole.converged
    assert whole.chi_square < short.chi_square
    again = solve(problem, whole.z, Effort(60), no_lift())
    assert again.converged
    assert again.chi_square == pytest.approx(whole.chi_square, abs=0.05)


def test_gradient_is_half_of_the_descent_of_chi_square(data):
    problem = only_free(data)
    z = problem.start
    trial = try_at(problem, z, no_lift())
    for _ in range(4):  # until the torque is linearised about the linear parameters that are found
        trial = try_at(problem, trial.z, no_lift())
    means, stds = problem.priors
    matrix, vector, _ = normal_equations(problem, trial.z, trial.residual, no_lift())
    descent = vector - problem.steps**2 / stds**2 * (trial.z - means) / problem.steps
    for place, name in enumerate(NONLINEAR_NAMES):
        k = problem.index(name)
        if k < 0:
            continue
        h = 1e-3 * problem.steps[k]
        sides = [try_at(problem, trial.z + sign * h * (np.arange(z.size) == k), no_lift()) for sign in (1.0, -1.0)]
        # the linear parameters are solved again at either side: the envelope's slope is that of chi-square
        slope = (sides[0].chi_square - sides[1].chi_square) / (2.0 * h) * problem.steps[k]
        assert -2.0 * descent[k] == pytest.approx(slope, rel=1e-3, abs=1e-3), (place, name)
    assert np.allclose(matrix, matrix.T)


@pytest.mark.parametrize("seed", range(4))
def test_linear_parameters_within_bounds_are_those_of_scipy(seed):
    rng = np.random.default_rng(seed)
    columns, target = rng.standard_normal((40, 6)), rng.standard_normal(40)
    lower, upper = np.full(6, -0.05), np.full(6, 0.08)
    expected = lsq_linear(columns, target, (lower, upper), tol=1e-14).x
    start = np.zeros(6) if seed % 2 else np.clip(expected + 0.02, lower, upper)
    found = bounded_quadratic(columns.T @ columns, columns.T @ target, lower, upper, start)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert np.any(found == lower) or np.any(found == upper)


def test_lift_correction_is_integrated_out(data):
    # the same chi-square as with its coefficients as explicit columns under their own prior
    problem = only_free(data)
    values, coefficients = problem.values(problem.start, 0)
    output = evaluate(data.chain, values)
    modes = lift_modes(data, output, (values, coefficients))
    residual = np.random.default_rng(3).standard_normal(BINS)
    basis = data.lift_basis
    columns = binned(output.load)[:, None] * basis.basis(binned(output.motion.theta), 1)
    shaft, measured, *_ = transfer(data.chain, values, BINS)
    columns = filtered(columns, shaft * measured) * data.weight[:, None] * basis.prior_std
    stacked = np.vstack([columns, np.eye(basis.n_basis)])
    best = np.linalg.lstsq(stacked, np.r_[residual, np.zeros(basis.n_basis)], rcond=None)[0]
    explicit = np.sum((residual - columns @ best) ** 2) + np.sum(best**2)
    assert modes.product(residual, residual) == pytest.approx(explicit, rel=2e-3)  # weak modes are left out
    assert np.any(modes.shrink > 0.5)
    left, right = columns[:, :3], residual
    full = np.linalg.solve(np.eye(BINS) + columns @ columns.T, right)
    np.testing.assert_allclose(modes.product(left, right), left.T @ full, atol=2e-2 * np.abs(left.T @ right).max())
    twice = lift_modes(data, output, (values, coefficients), inflate=2.0)
    assert twice.product(residual, residual) < modes.product(residual, residual)


def test_no_lift_changes_nothing():
    residual = np.arange(float(BINS))
    assert no_lift().product(residual, residual) == residual @ residual
    assert isinstance(no_lift(), LiftModes)


def test_smoothing_keeps_the_mean_and_takes_the_fast_part():
    theta = angle_grid(BINS)
    signal = 2.0 + np.cos(theta) + np.cos(60.0 * theta)
    found = smoother(7.0 * DEGREE)(signal)
    np.testing.assert_allclose(found, 2.0 + np.exp(-0.5 * (7.0 * DEGREE) ** 2) * np.cos(theta), atol=1e-6)
    assert smoother(0.0)(signal) is signal


def test_own_parameters_of_two_recordings_are_their_own(data):
    other = replace(data, name="two", torque=data.torque + 0.5)
    held = {name: ROWS[name].start for name in NONLINEAR_NAMES if name not in FREE}
    held.update({name: 0.0 for name in COLUMN_NAMES if name not in FREE})
    problem = build_problem([data, other], held)
    names = problem.names
    assert names.count("guide_friction") == 1
    assert {"torque_zero__one", "torque_zero__two"} <= set(names)
    wide = [with_rows(item, {"torque_zero": {"prior": (0.0, 5.0)}}) for item in (data, other)]
    wider = build_problem(wide, held)
    found = dense_solve(wider, wider.start, 40, (no_lift(), no_lift()))
    zeros = [found.z[names.index(f"torque_zero__{name}")] for name in ("one", "two")]
    assert zeros[1] - zeros[0] == pytest.approx(0.5, abs=1e-6)


def test_data_that_do_not_match_are_refused(data):
    with pytest.raises(ValueError, match="differ"):
        replace(data, weight=np.ones(3))
    with pytest.raises(ValueError, match="expected one of"):
        replace(data, structure="helix")
    with pytest.raises(ValueError, match="multiple of"):
        evaluate(chain_input(n=BINS + 1), dict.fromkeys(NONLINEAR_NAMES, 0.0))


def test_columns_beyond_the_largest_square_are_infinite_without_a_warning():
    lift = LiftModes(np.eye(BINS, 2), np.ones(2), np.zeros((2, 2)))
    assert not np.isfinite(lift.gram(np.full((BINS, 2), 1e200))).any()

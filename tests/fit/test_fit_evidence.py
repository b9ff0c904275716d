"""Evidence: Savage-Dickey and boxes against closed forms; scenes with and without a loss."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque import laws
from camtorque.fit import evidence
from camtorque.fit.descent import Effort
from camtorque.fit.evidence import (
    LOSSES,
    NEEDED,
    PROBABLE,
    SURELY_NOT,
    Weighed,
    evidence_of,
    laplace,
    loss_evidence,
    present,
    prior_of,
    where_unexplained,
)
from camtorque.fit.kinds import chamber_evidence, structure_probabilities
from camtorque.fit.presence import savage_dickey
from camtorque.fit.problem import build_problem
from camtorque.fit.residual import explains
from camtorque.fit.single import switching_shift, switching_std
from camtorque.fit.solver import solve
from camtorque.fit.truncated import Gaussian
from camtorque.fit.uncertainty import covariance
from camtorque.laws.chain import derivative_by
from camtorque.records import EITHER_LOSS, AngleError
from fit_cases import bridged, quick


def tiny_problem():
    found = quick(("closed_volume", 0, 1000.0))
    return replace(found.problem, parameters=found.problem.parameters[:2])


def test_savage_dickey_is_the_ratio_of_densities_at_zero():
    problem = tiny_problem()
    lower, upper = problem.bounds
    middle, before = 0.5 * (lower + upper), np.array([0.02, 0.02]) * (upper - lower)
    parameters = tuple(
        replace(parameter, row=replace(parameter.row, prior=(float(m), float(b)), lower=-1e30, upper=1e30))
        for parameter, m, b in zip(problem.parameters, middle, before, strict=True)
    )
    problem = replace(problem, parameters=parameters)
    std = 0.1 * before
    mean = middle + 0.4 * before
    posterior = Gaussian(mean, np.diag(std**2), *problem.bounds)
    found = savage_dickey(posterior, prior_of(problem, before), np.array([0]))

    def density(at, sigma):
        return -0.5 * (at / sigma) ** 2 - np.log(sigma)

    expected = 2.0 * (density(middle[0], before[0]) - density(mean[0], std[0]))
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("off", "inflation"), [(0.5, 1.0), (-0.3, 1.0), (-2.0, 4.0), (-6.0, 1.0)])
def test_evidence_of_a_linear_fit_is_the_integral_over_its_box(off, inflation):
    """What bounds cost is in the share of the Gaussian within them, and not in chi-square a second time."""
    found = quick(("closed_volume", 0, 1000.0))
    lower, upper, before = np.zeros(2), np.array([3.0, 4.0]), np.array([1.5, 2.0])
    parameters = tuple(
        replace(
            parameter, row=replace(parameter.row, start=1.0, prior=(1.0, float(b)), lower=float(low), upper=float(high))
        )
        for parameter, b, low, high in zip(found.problem.parameters[:2], before, lower, upper, strict=True)
    )
    problem = replace(found.problem, parameters=parameters)
    weight, unbounded = np.array([[3.0, 0.8], [0.8, 2.0]]), np.array([off, 1.3])

    def data_chi(z):
        return 7.0 + np.einsum("...i,ij,...j->...", z - unbounded, weight, z - unbounded)

    def prior_chi(z):
        return np.sum(((z - 1.0) / before) ** 2, axis=-1)

    x, y = np.meshgrid(*(np.linspace(low, high, 2001) for low, high in zip(lower, upper, strict=True)), indexing="ij")
    inside = np.stack([x, y], axis=-1)
    likelihood, known = data_chi(inside) / inflation, np.exp(-0.5 * prior_chi(inside))
    expected = -2.0 * np.log(np.sum(known * np.exp(-0.5 * likelihood)) / np.sum(known))
    at = np.unravel_index(np.argmin(likelihood + prior_chi(inside)), x.shape)
    z = inside[at]
    slope = weight @ (unbounded - z) + inflation * (1.0 - z) / before**2  # of the priors as the inflation leaves them
    solution = replace(
        found.solution, z=z, chi_square=float(data_chi(z) + prior_chi(z)), data_chi_square=float(data_chi(z)),
        data_hessian=weight, gradient=slope,
    )  # fmt: skip
    # sums over a grid, a little expectation propagation
    assert laplace(problem, solution, inflation) == pytest.approx(expected, abs=0.06)


@pytest.fixture(scope="module")
def scenes():
    result = {}
    for family in ("closed_volume", "chamber_only"):
        key = (family, 0, 1000.0)
        found = quick(key)
        cov = covariance(found.problem, found.solution)
        result[family] = {row.name: row for row in loss_evidence(found.problem, found.solution, cov)}
    return result


def test_losses_that_are_there_are_needed(scenes):
    rows = scenes["closed_volume"]
    assert set(rows) == set(LOSSES)
    assert rows["friction"].verdict == "needed"
    assert rows["friction"].two_ln_bayes_factor > NEEDED
    assert rows["driveline"].verdict == "needed"
    assert rows["driveline"].unit == "deg"
    assert rows["driveline"].confirmed_by_refit
    # some millijoule of a shaft's and a plunger's film beside drag and bearings: never claimed to be absent
    assert rows["damping"].verdict != "not needed"
    low, high = rows["friction"].size_ci95
    assert low < rows["friction"].size < high
    assert "need" in rows["friction"].text


def test_losses_that_are_not_there_are_not_claimed(scenes):
    for name, row in scenes["chamber_only"].items():
        assert row.verdict in ("not needed", "cannot tell"), (name, row)
    assert scenes["chamber_only"]["driveline"].size < 0.1
    verdicts = [row.verdict for row in scenes["chamber_only"].values()]
    assert "not needed" in verdicts


def test_what_is_surely_not_there_may_twist_twice_as_far(scenes, monkeypatch):
    found = quick(("chamber_only", 0, 1000.0))
    row = scenes["chamber_only"]["driveline"]
    assert row.two_ln_bayes_factor < SURELY_NOT
    largest = np.radians(row.size_ci95[1])

    def verdict() -> str:
        rows = loss_evidence(found.problem, found.solution, covariance(found.problem, found.solution))
        return next(item.verdict for item in rows if item.name == "driveline")

    monkeypatch.setattr(evidence, "SMALL_ANGLE", 0.6 * largest)
    assert verdict() == "not needed"
    monkeypatch.setattr(evidence, "SURELY_NOT", -1000.0)
    assert verdict() == "cannot tell"
    monkeypatch.undo()
    monkeypatch.setattr(evidence, "SMALL_ANGLE", 0.4 * largest)
    assert verdict() == "cannot tell"


def test_a_constant_torque_is_friction_or_damping_and_nobody_knows_which(scenes):
    assert EITHER_LOSS not in scenes["chamber_only"], "nothing is told of losses that are not there"
    key = ("chamber_only", 0, 1000.0)
    found = quick(key)
    data = [replace(item, torque=item.torque + 0.2) for item in found.problem.data]
    problem = build_problem(data)
    solution = solve(problem, found.solution.z, Effort(25), found.solution.lift)
    rows = {row.name: row for row in loss_evidence(problem, solution, covariance(problem, solution))}
    assert {rows["friction"].verdict, rows["damping"].verdict} == {"cannot tell"}
    assert rows[EITHER_LOSS].verdict == "needed"
    assert rows[EITHER_LOSS].two_ln_bayes_factor > PROBABLE
    assert rows[EITHER_LOSS].size == pytest.approx(0.2, abs=0.02)
    assert rows[EITHER_LOSS].text.startswith("the data need friction or damping (")


def test_what_an_unexplained_recording_does_not_need_may_be_what_is_missing(scenes):
    rows = tuple(scenes["chamber_only"].values())
    withdrawn = where_unexplained(rows)
    assert {row.verdict for row in withdrawn} == {"cannot tell"}
    changed = [(row, new) for row, new in zip(rows, withdrawn, strict=True) if row.verdict == "not needed"]
    assert changed
    for row, new in changed:
        assert new.text.startswith(row.text)
        assert "unexplained" in new.text
        assert new.two_ln_bayes_factor == row.two_ln_bayes_factor
    needed = tuple(row for row in scenes["closed_volume"].values() if row.verdict == "needed")
    assert where_unexplained(needed) == needed


def test_a_residual_beyond_the_cycles_leaves_a_recording_unexplained():
    found = quick(("closed_volume", 0, 1000.0))
    peak = float(np.max(found.data.torque))
    far = replace(found.solution, residual=found.solution.residual + 0.01 * peak * found.data.weight)
    assert explains(found.data, found.solution, 1e-3 * peak)
    assert not explains(found.data, far, 1e-3 * peak)
    assert explains(found.data, far, 4e-3 * peak)  # within three times what odd and even cycles differ


def test_line_pressure_on_the_plunger_is_told_from_a_chamber():
    found = quick(("closed_volume", 0, 1000.0))
    none = chamber_evidence((found,), 1.0)
    assert none.verdict == "cannot tell"
    assert none.text == "not compared"
    data = replace(found.data, structure="line", chain=replace(found.data.chain, uses_chamber=False))
    residual = found.solution.residual + 3.0
    problem = build_problem([data])
    z = found.solution.z[[found.problem.index(name) for name in problem.names]]
    worse = replace(found.solution, z=z, chi_square=found.solution.chi_square + 600.0, residual=residual)
    line = replace(found, data=data, problem=problem, solution=worse)
    row = chamber_evidence((found, line), 1.0)
    assert row.verdict == "needed"
    assert row.size == pytest.approx(float(np.sqrt(np.mean((3.0 / data.weight) ** 2))))
    slight = replace(worse, residual=found.solution.residual + 5e-4 * np.max(data.torque) * data.weight)
    assert chamber_evidence((found, replace(line, solution=slight)), 1.0).verdict == "cannot tell"
    even = replace(line, solution=replace(worse, chi_square=found.solution.chi_square))
    alike = chamber_evidence((even, found), 1.0)
    assert alike.verdict == "not needed"
    for factor, verdict in ((-7.0, "not needed"), (-5.0, "cannot tell")):  # strong evidence either way is 6
        gain = factor - alike.two_ln_bayes_factor
        less = replace(even, solution=replace(even.solution, chi_square=found.solution.chi_square + gain))
        row = chamber_evidence((less, found), 1.0)
        assert (row.verdict, round(row.two_ln_bayes_factor, 6)) == (verdict, factor)


def test_probabilities_of_structures_follow_chi_square_under_inflation():
    found = quick(("closed_volume", 0, 1000.0))
    worse = replace(found, solution=replace(found.solution, chi_square=found.solution.chi_square + 8.0))
    best, other = structure_probabilities((found, worse), 1.0)
    assert best + other == pytest.approx(1.0)
    assert other / best == pytest.approx(np.exp(-4.0))
    assert structure_probabilities((found, worse), 4.0)[1] == pytest.approx(np.exp(-1.0) / (1.0 + np.exp(-1.0)))


def test_a_structure_with_more_parameters_pays_for_them():
    found = quick(("closed_volume", 0, 1000.0))
    data = replace(found.data, structure="spill" if found.data.structure == "open" else "open")
    problem = build_problem([data])
    kept = np.array([name in problem.names for name in found.problem.names])
    assert kept.sum() < kept.size
    places = np.ix_(kept, kept)
    alike = replace(
        found.solution, z=found.solution.z[kept], gradient=found.solution.gradient[kept],
        hessian=found.solution.hessian[places], data_hessian=found.solution.data_hessian[places],
    )  # fmt: skip
    fewer = replace(found, data=data, problem=problem, solution=alike)
    pair = (found, fewer)
    paid = laplace(fewer.problem, alike, 1.0) - laplace(found.problem, found.solution, 1.0)
    by_evidence = 1.0 / (1.0 + np.exp(0.5 * paid))
    more, less = structure_probabilities(pair, 1.0)
    assert more + less == pytest.approx(1.0)
    assert less == pytest.approx(0.5 * (0.5 + by_evidence))  # chi-square is the same
    far = replace(fewer, solution=replace(alike, chi_square=alike.chi_square + 50.0))
    assert structure_probabilities((found, far), 1.0)[1] == pytest.approx(np.exp(-25.0))


def test_what_the_switch_may_be_late_is_in_the_trigger_angle_alone():
    problem, cycles = quick(("closed_volume", 0, 1000.0)).problem, bridged(("closed_volume",))[1]
    late = replace(cycles, angle_errors=(AngleError("trigger switching delay", 0.03, ""),))
    shift = switching_shift(problem, [switching_std(late)])
    assert shift[problem.index("trigger_offset")] == pytest.approx(np.radians(0.03))
    assert np.count_nonzero(shift) == 1
    assert switching_std(replace(cycles, angle_errors=())) == 0.0


@pytest.mark.parametrize(("viscous", "verdict"), [(0.0, "not needed"), (6.0, "cannot tell"), (11.0, "needed")])
def test_damping_is_needed_where_one_part_of_it_is(viscous, verdict):
    """A plunger's film has a shape of its own, which does not get lost beside a constant that nobody knows."""
    key = ("chamber_only", 0, 1000.0)
    found = quick(key)
    added = viscous * derivative_by(found.solution.output, ["plunger_viscous"])[:, 0]
    problem = build_problem([replace(item, torque=item.torque + added) for item in found.problem.data])
    solution = solve(problem, found.solution.z, Effort(25), found.solution.lift)
    rows = loss_evidence(problem, solution, covariance(problem, solution))
    row = next(row for row in rows if row.name == "damping")
    assert row.verdict == verdict
    assert (row.two_ln_bayes_factor > PROBABLE) == (verdict == "needed")


def torque_losses(values: tuple[float, float, float], known: float = 0.1) -> Weighed:
    """Return two parts of friction and one of damping, independent of one another, in units of their priors."""
    names = ("bearing_arm", "pin_arm", "plunger_viscous")
    rows, box = tuple(laws.ROWS[name] for name in names), (np.full(3, -100.0), np.full(3, 100.0))
    posterior = Gaussian(np.array(values), known**2 * np.eye(3), *box)
    moves = {"friction": np.eye(2), "damping": np.eye(1), EITHER_LOSS: np.eye(3)}
    return Weighed(rows, posterior.mean, posterior, Gaussian(np.zeros(3), np.eye(3), *box), moves, 1.0)


def test_presence_is_the_mean_over_sets_of_parts():
    """Independent parts: a set's weight is the product of those of its parts."""
    values, known = (0.3, 0.0, -0.2), 0.1
    first, second, damped = (np.exp(0.5 * (value / known) ** 2) * known for value in values)  # each against none of it
    friction = 0.5 * (0.5 * (first + second)) + 0.5 * first * second
    found = present(torque_losses(values, known))
    assert found["friction"] == pytest.approx(2.0 * np.log(friction))
    assert found["damping"] == pytest.approx(2.0 * np.log(damped))
    assert found[EITHER_LOSS] == pytest.approx(2.0 * np.log((friction + damped + friction * damped) / 3.0))


@pytest.mark.parametrize(("values", "verdicts"), [
    ((0.0, 0.5, 0.0), ("needed", "not needed")), ((0.0, 0.0, 0.5), ("not needed", "needed")),
    ((0.0, 0.0, 0.25), ("not needed", "cannot tell")), ((0.0, 0.0, 0.0), ("not needed", "not needed")),
])  # fmt: skip
def test_a_torque_loss_is_needed_where_one_part_of_it_is(values, verdicts):
    rows = {row.name: row for row in evidence_of(torque_losses(values, 0.09), ("friction", "damping"))}
    assert (rows["friction"].verdict, rows["damping"].verdict) == verdicts


@pytest.mark.parametrize(("added", "verdict"), [(np.nan, "not needed"), (-5.0, "not needed"), (6.0, "cannot tell")])
def test_a_refit_that_misses_a_loss_keeps_it_from_being_needless(added, verdict):
    fit = torque_losses((0.0, 0.0, 0.0), 0.05)
    apart = [fit.factor(fit.members(loss)) + added for loss in ("friction", "damping")]
    rows = evidence_of(fit, ("friction", "damping"), lambda left_out: apart)
    assert [row.verdict for row in rows] == [verdict, verdict]
    assert [row.confirmed_by_refit for row in rows] == [not np.isnan(added)] * 2


@pytest.mark.parametrize(("refit", "verdict"), [(np.nan, "cannot tell"), (-25.0, "not needed"), (-3.0, "cannot tell")])
def test_a_driveline_is_judged_by_its_refit(refit, verdict):
    """The Gaussian at a shaft that hardly yields knows its compliance badly: -5 stood in the way of -38 by a refit."""
    row = laws.ROWS["shaft_compliance"]
    box = np.zeros(1), np.full(1, row.upper)
    value, known = 2.0 * row.step, 0.8 * row.step
    posterior = Gaussian(np.array([value]), np.array([[known**2]]), *box)
    prior = Gaussian(np.array([0.0]), np.array([[(50.0 * row.step) ** 2]]), *box)
    moves = dict.fromkeys(("driveline", EITHER_LOSS), np.array([[(1e-3 / value) ** 2]]))
    fit = Weighed((row,), posterior.mean, posterior, prior, moves, 1.0)
    assert -10.0 < fit.factor(("shaft_compliance",)) < 0.0
    rows = evidence_of(fit, ["driveline"], lambda left_out: [refit] * len(left_out))
    found = next(row for row in rows if row.name == "driveline")
    assert found.verdict == verdict

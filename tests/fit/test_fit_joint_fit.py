"""A pump in many recordings: all together tell the kind of its pin, and the other kind, or a stiff shaft, widens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.joint import joint_fit_of, solve_joint
from camtorque.fit.joint_fit import other_kind_at, with_likelier_pin
from camtorque.fit.joint_input import joint_input
from camtorque.fit.joint_solver import solve_many
from camtorque.fit.kinds import KINDS, PIN, other_kind
from camtorque.fit.problem import build_problem, started_at, with_rows
from camtorque.fit.single import SOFTER
from camtorque.fit.valleys import COMPLIANCE, STIFF
from camtorque.laws import ROWS
from camtorque.process.threads import in_turn
from fit_cases import quick_prepared, rig

SPEEDS, IN_PLAIN = (700.0, 1200.0), "plain_bush"
BUSH = KINDS[PIN]
ARM = BUSH.parameter
NEEDLES = ROWS[ARM]
IN_BUSH = replace(NEEDLES, **BUSH.rows(NEEDLES)[1])


@pytest.fixture(scope="module")
def bushed():
    inputs = [joint_input(quick_prepared(IN_PLAIN, 0, rpm)) for rpm in SPEEDS]
    return inputs, *with_likelier_pin(*solve_joint(inputs), in_turn)


@pytest.mark.parametrize(("likeliest", "width"), [(180e-6, 30e-6), (20e-6, 60e-6), (-50e-6, 40e-6), (90e-6, 400e-6)])
@pytest.mark.parametrize("begun", [NEEDLES, IN_BUSH])
def test_the_other_kind_is_what_bayes_rule_makes_of_the_same_data(likeliest, width, begun):
    arm = np.linspace(begun.lower, begun.upper, 200_001)
    variance = 1.0 / (width**-2 + begun.prior[1] ** -2)
    mean = variance * (likeliest / width**2 + begun.prior[0] / begun.prior[1] ** 2)

    def with_prior(prior):
        before = np.exp(-0.5 * ((arm - prior[0]) / prior[1]) ** 2)
        product = np.exp(-0.5 * ((arm - likeliest) / width) ** 2) * before / np.trapezoid(before, arm)
        evidence = np.trapezoid(product, arm)
        return np.log(evidence), np.trapezoid(arm * product, arm) / evidence

    found = other_kind(BUSH, begun, mean, np.sqrt(variance))
    (log_now, now), (log_other, other) = with_prior(begun.prior), with_prior(found.rows["prior"])
    share = BUSH.share if begun is NEEDLES else 1.0 - BUSH.share
    assert found.log_odds == pytest.approx(log_other - log_now + np.log(share / (1.0 - share)), abs=1e-6)
    assert found.moved == pytest.approx(other - now, abs=1e-10)


def test_recordings_that_were_taken_for_needles_tell_a_bush_together(bushed):
    _, problem, solution = bushed
    needles = {ARM: {"prior": NEEDLES.prior, "source": NEEDLES.source}}
    begun = build_problem([with_rows(item, needles) for item in started_at(problem, solution.z)])
    start = solve_many(begun, begun.start, 25)
    ended, found = with_likelier_pin(begun, start, in_turn)
    assert {item.rows[ARM].source for item in ended.data} == {BUSH.source}
    rub = rig(IN_PLAIN, 0, SPEEDS[0]).truth.friction
    true, place = rub.pin_mu * rub.pin_radius, ended.index(ARM)
    assert abs(found.z[place] - true) < 0.7 * abs(start.z[place] - true)
    assert with_likelier_pin(ended, found, in_turn) == (ended, found)  # and that is where it stays


def test_the_other_kind_widens_what_it_moves(bushed):
    inputs, problem, solution = bushed
    fit = joint_fit_of(inputs, problem, solution)
    other = other_kind_at(problem, solution, fit.covariance)
    place = problem.index(ARM)
    probability = 1.0 / (1.0 + np.exp(-other.log_odds))
    assert 0.0 < probability < 0.5
    assert fit.shifts[PIN][0, place] == pytest.approx(np.sqrt(probability) * other.moved)
    # all else follows the arm as it is correlated with it
    cov = fit.covariance.arrow.among(range(problem.size))
    np.testing.assert_allclose(fit.shifts[PIN][0], fit.shifts[PIN][0, place] * cov[:, place] / cov[place, place])


def test_a_foot_that_slides_has_no_other_kind(bushed):
    inputs, problem, solution = bushed
    foot = build_problem([with_rows(item, {ARM: {"source": "a foot that slides"}}) for item in problem.data])
    assert with_likelier_pin(foot, solution, in_turn) == (foot, solution)
    assert not np.any(joint_fit_of(inputs, foot, solution).shifts[PIN])


def test_a_stiff_shaft_is_as_uncertain_as_the_walk_along_its_valley():
    inputs = [joint_input(quick_prepared("stiff_shaft", 0, rpm)) for rpm in SPEEDS]
    problem, solution = solve_joint(inputs)
    place = problem.index(COMPLIANCE)
    row = problem.parameters[place].row
    stiffest = np.where(np.arange(problem.size) == place, row.lower, solution.z)
    bound = build_problem(started_at(problem, stiffest))
    there = solve_many(bound, bound.start, 25)
    fit = joint_fit_of(inputs, bound, there)
    walked, known = abs(fit.shifts[SOFTER][0, place]), fit.covariance.std[place]
    assert there.z[place] <= row.lower + STIFF * known
    true = 1.0 / rig("stiff_shaft", 0, SPEEDS[0]).truth.driveline.shaft_stiffness
    assert there.z[place] + 2.0 * np.hypot(walked, known) > true
    assert walked > 0.5 * known


def test_a_shaft_that_yields_is_not_walked(bushed):
    inputs, problem, solution = bushed
    fit = joint_fit_of(inputs, problem, solution)
    place = problem.index(COMPLIANCE)
    assert solution.z[place] > problem.parameters[place].row.lower + STIFF * fit.covariance.std[place]
    assert not np.any(fit.shifts[SOFTER])

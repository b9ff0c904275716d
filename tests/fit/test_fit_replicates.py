"""The reference for stated uncertainties: replicates scatter as theory says where everything is linear."""

from __future__ import annotations

import numpy as np
from camtorque.fit.problem import build_problem
from camtorque.fit.solve import solve
from camtorque.fit.uncertainty import covariance, parameter_names
from camtorque.studies.replicates import (
    replicate_deviation,
    stated_by_covariance,
    stated_by_profiles,
    uncertainty_points,
)
from fit_cases import fit_data

COUNT = 120


def case():
    problem = build_problem([fit_data()], ("trigger", "friction"))
    return problem, solve(problem)


def test_replicates_scatter_as_the_covariance_says():
    problem, solution = case()
    found = replicate_deviation(problem, solution, COUNT, seed=3)
    wanted = np.sqrt(np.diag(covariance(problem, solution).matrix))
    names = parameter_names(problem)
    for name in ("trigger_offset", "torque_zero", "shaft_drag"):
        k = names.index(name)
        # a deviation from 120 draws is known to 6.5 %: four of these; trigger and zero are linear here
        assert 0.74 * wanted[k] < found[k] < 1.26 * wanted[k], name


def test_error_of_a_stated_uncertainty_is_its_distance_from_the_reference():
    reference, free = np.array([1.0, 2.0, 4.0, 0.0]), np.array([1.0, 1.0, 1.0, 1.0])
    rows = [("exact", "", reference, 1.0), ("half", "", 0.5 * reference, 2.0),
            ("some", "", np.array([1.1, np.nan, np.nan, np.nan]), 3.0)]  # fmt: skip
    exact, half, some = uncertainty_points(reference, iter(rows), lambda family: family == "exact", free)
    assert (exact.error, exact.default) == (0.0, True)
    assert (half.error, half.default, half.cost) == (0.5, False, 2.0)
    assert abs(some.error - 0.1) < 1e-12


def test_profiles_state_what_the_covariance_states_where_the_valley_is_straight():
    problem, solution = case()
    names = parameter_names(problem)
    linear, curved = stated_by_covariance(problem, solution)[2], stated_by_profiles(problem, solution)[2]
    k = names.index("trigger_offset")
    assert abs(curved[k] / linear[k] - 1.0) < 0.05
    assert np.isnan(curved[names.index("torque_zero")])

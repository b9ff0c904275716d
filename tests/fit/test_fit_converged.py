"""`converged` speaks of where the search ended, not of what ended it."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.fit.problem import build_problem
from camtorque.fit.solve import solve
from fit_cases import fit_data


@pytest.fixture(scope="module")
def problem():
    return build_problem([fit_data("A", 1, 60.0), fit_data("B", 2, 120.0)], ("trigger", "friction", "damping"))


def far(problem):
    return np.array([slot.row.upper for slot in problem.nonlinear])


def test_search_that_gives_up_far_from_the_minimum_has_not_converged(problem):
    # a tolerance of 1 accepts any progress as too little: the search ends after its first step
    early = solve(problem, far(problem), tolerance=1.0)
    assert early.chi_square > 1.001 * solve(problem).chi_square
    assert not early.converged


def test_minimum_has_converged_though_no_iteration_was_left(problem):
    found = solve(problem)
    assert found.converged
    assert solve(problem, found.x, max_iterations=0).converged

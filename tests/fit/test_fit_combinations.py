"""What cannot be told apart is told together."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.fit.combinations import TELLING, Combination, combinations
from camtorque.fit.problem import build_problem
from camtorque.fit.solve import solve
from camtorque.fit.uncertainty import covariance, parameter_names
from fit_cases import TRUE_LINEAR, TRUE_ZERO, fit_data


@pytest.fixture(scope="module")
def case():
    problem = build_problem([fit_data()], ("trigger", "friction", "damping"))
    solution = solve(problem)
    return problem, solution, covariance(problem, solution)


def test_drag_and_viscous_drag_are_one_number_at_one_speed(case):
    found = combinations(*case)
    group = next(item for item in found if "shaft_viscous" in item.names)
    assert {"shaft_drag", "shaft_viscous"} <= set(group.names)
    weight = dict(zip(group.names, group.coefficients, strict=True))
    # drag + speed x viscous drag (+ zero): the speed is 60 rad/s, and the shaft's ripple is left out of it
    assert weight["shaft_viscous"] / weight["shaft_drag"] == pytest.approx(60.0, rel=0.02)
    true = sum(weight[name] * TRUE_LINEAR.get(name, 0.0) for name in group.names if name != "torque_zero")
    true += weight.get("torque_zero", 0.0) * TRUE_ZERO
    assert abs(group.value - true) < 5.0 * group.stderr
    assert group.stderr < TELLING * group.alone[0]


def test_a_combination_is_never_looser_than_the_covariance_says(case):
    problem, solution, cov = case
    names = parameter_names(problem)
    slots = {slot.name: slot for slot in (*problem.nonlinear, *problem.linear)}
    for item in combinations(problem, solution, cov):
        rows = [names.index(name) for name in item.names]
        scaled = np.array([c / slots[n].row.per_unit for n, c in zip(item.names, item.coefficients, strict=True)])
        variance = scaled @ cov.matrix[np.ix_(rows, rows)] @ scaled
        assert item.stderr == pytest.approx(np.sqrt(variance), rel=1e-9)
        assert item.coefficients[0] == 1.0


def test_text_names_the_sum_and_its_members():
    item = Combination(("shaft_drag", "pin_arm"), (1.0, -50.0), ("N m", "-"), 0.5, 0.02, (0.1, 0.003))
    assert item.text == (
        "shaft_drag - 50 x pin_arm = 0.5 +- 0.02 N m (each by itself: shaft_drag +- 0.1 N m, pin_arm +- 0.003)"
    )


def test_nothing_is_combined_where_everything_is_told():
    problem = build_problem([fit_data()], ("trigger",))
    solution = solve(problem)
    assert combinations(problem, solution, covariance(problem, solution)) == ()

"""The integrators of the studies against each other and against the package's own periodic solution."""

import numpy as np
import pytest
from camtorque.mechanism.elastic import solve_by_harmonics, solve_elastic
from camtorque.mechanism.periodic import gauss
from camtorque.studies.driveline import (
    TABLE,
    Shaft,
    alpha_accelerations,
    at_angles,
    collocation,
    elastic,
    load_rows,
    march_periodic,
)
from camtorque.units import angle_grid

CHECK = angle_grid(1009)


@pytest.fixture(scope="module")
def reference():
    return at_angles(*collocation(Shaft(), 360, 6), check=CHECK)


def test_gauss_integrates_polynomials_exactly():
    nodes, weights, matrix = gauss(4)
    assert weights @ nodes**7 == pytest.approx(1.0 / 8.0, rel=1e-13)  # order 2 s
    np.testing.assert_allclose(matrix @ nodes**3, nodes**4 / 4.0, atol=1e-14)


@pytest.mark.parametrize(("scheme", "order"), [("RK4", 4), ("Heun", 2), ("generalized-alpha 0.8", 2)])
def test_fixed_steps_converge_at_their_order(reference, scheme, order):
    table = load_rows(angle_grid(TABLE))
    errors = []
    for steps in (1440, 2880):
        theta, torque, bounded = march_periodic(table, Shaft(), scheme, steps)
        assert bounded
        errors.append(np.max(np.abs(at_angles(theta, torque, check=CHECK) - reference)))
    # the steps resolve the steepest pressure flank only just: half an order of leeway
    assert np.log2(errors[0] / errors[1]) > order - 0.5


@pytest.mark.parametrize("solve", [solve_elastic, solve_by_harmonics])
def test_package_solutions_are_the_same_orbit(reference, solve):
    found = at_angles(*elastic(Shaft(), 1800, solve), check=CHECK)
    # quasi-spectral in drive angle against collocation in cam angle: 1e-6 of the peak, set by the knots of the law
    np.testing.assert_allclose(found, reference, atol=1e-6 * np.max(reference))


def test_explicit_steps_run_away_beyond_their_limit():
    table = load_rows(angle_grid(TABLE))
    assert not march_periodic(table, Shaft(stiffness=1e6), "RK4", 1800)[2]
    assert march_periodic(table, Shaft(stiffness=1e6), "generalized-alpha 0.8", 1800)[2]


def test_multiplier_of_the_cut_joint_converges_only_with_damping():
    # a smooth lift: second order for the acceleration, and rho = 1 keeps what the start put in
    def error(steps, rho, turns):
        theta = angle_grid(steps)
        found = alpha_accelerations(1.0 - np.cos(theta), 2.0 * np.pi / steps, turns, rho, (0.0, 1.0))
        return np.max(np.abs(found - np.cos(theta)))

    assert np.log2(error(180, 0.5, 5) / error(360, 0.5, 5)) > 1.8
    wrong_start = [np.max(np.abs(alpha_accelerations(np.zeros(90), 0.1, turns, 1.0, (0.0, 1.0)))) for turns in (1, 10)]
    assert wrong_start[1] >= 0.99 * wrong_start[0]
    assert np.max(np.abs(alpha_accelerations(np.zeros(90), 0.1, 2, 0.8, (0.0, 1.0)))) < 1e-6

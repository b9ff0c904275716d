"""A Gaussian cut off at a box against closed forms, scipy and draws that are kept only inside."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.fit.truncated import Gaussian, log_share_below, truncated
from camtorque.fit.uncertainty import deviation_within
from scipy.special import log_ndtr, ndtr
from scipy.stats import multivariate_normal, truncnorm


@pytest.mark.parametrize("x", [-np.inf, -1e5, -60.0, -37.0, -36.99, -5.0, 0.0, 1.0, 9.0, np.inf])
def test_share_below_is_that_of_scipy(x):
    assert log_share_below(x) == pytest.approx(float(log_ndtr(x)), rel=1e-12)


def test_box_of_independent_parameters_is_the_product():
    gaussian = Gaussian(np.array([0.3, -0.5]), np.diag([1.0, 4.0]), np.array([0.0, -1.0]), np.array([1.0, 3.0]))
    expected = (ndtr(0.7) - ndtr(-0.3)) * (ndtr(1.75) - ndtr(-0.25))
    found = truncated(gaussian)
    assert found.log_probability == pytest.approx(np.log(expected), abs=1e-9)
    for k, (mean, std, low, high) in enumerate(((0.3, 1.0, 0.0, 1.0), (-0.5, 2.0, -1.0, 3.0))):
        inside = truncnorm((low - mean) / std, (high - mean) / std, mean, std)
        assert found.mean[k] == pytest.approx(inside.mean(), rel=1e-9)
        assert found.matrix[k, k] == pytest.approx(inside.var(), rel=1e-9)


def test_a_box_that_is_wide_changes_nothing():
    matrix = np.array([[1.0, 0.9], [0.9, 2.0]])
    found = truncated(Gaussian(np.array([1.0, 2.0]), matrix, np.full(2, -1e9), np.full(2, 1e9)))
    assert found.log_probability == 0.0
    np.testing.assert_allclose(found.mean, [1.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(found.matrix, matrix, rtol=1e-14)


def test_orthant_of_two_mixed_parameters_is_that_of_scipy():
    matrix = np.array([[1.0, 0.7], [0.7, 2.0]])
    gaussian = Gaussian(np.array([0.2, -0.3]), matrix, np.zeros(2), np.full(2, 50.0))
    # Pr(x > 0, y > 0) is a distribution function of the mirrored variable
    expected = multivariate_normal(-gaussian.mean, matrix).cdf(np.zeros(2))
    assert truncated(gaussian).log_probability == pytest.approx(np.log(expected), abs=0.005)


def test_moments_of_mixed_parameters_are_those_of_draws_inside():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((5, 7)) / np.sqrt(7.0)
    matrix, mean = root @ root.T, 0.5 * rng.standard_normal(5)
    lower, upper = np.zeros(5), np.array([2.0, np.inf, 2.0, np.inf, 2.0])
    found = truncated(Gaussian(mean, matrix, lower, upper))
    drawn = rng.multivariate_normal(mean, matrix, 400_000)
    inside = drawn[np.all((drawn > lower) & (drawn < upper), axis=1)]
    assert found.log_probability == pytest.approx(np.log(inside.shape[0] / drawn.shape[0]), abs=0.03)
    np.testing.assert_allclose(found.mean, np.mean(inside, axis=0), atol=0.02)
    np.testing.assert_allclose(found.matrix, np.cov(inside.T), atol=0.02)


@pytest.mark.parametrize("distance", [9.0, 29.0, 31.0, 300.0])
def test_a_box_far_out_in_either_tail_is_not_lost_to_rounding(distance):
    for mean, lower, upper, sign in ((-distance, 0.0, 50.0, 1.0), (distance, -50.0, 0.0, -1.0)):
        found = truncated(Gaussian(np.array([mean]), np.eye(1), np.array([lower]), np.array([upper])))
        assert found.log_probability == pytest.approx(log_ndtr(-distance), rel=1e-6)
        # the tail is an exponential of this rate, to the second order
        assert sign * found.mean[0] == pytest.approx(1.0 / distance - 2.0 / distance**3, rel=4e-3)
        assert found.matrix[0, 0] == pytest.approx(1.0 / distance**2 - 6.0 / distance**4, rel=2e-2)


def test_a_box_dozens_of_deviations_away_is_improbable_and_no_warning():
    matrix = np.array([[1.0, -0.141904592135], [-0.141904852304, 1.0]])  # symmetric but for rounding
    low, high = np.array([8.728804035764, 86.728275283016]), np.array([21.312126229608, 228.874835483352])
    found = truncated(Gaussian(np.zeros(2), matrix, low, high))
    assert -7000.0 < found.log_probability < -3700.0  # 86.7^2 / 2 = 3760 of the second alone


@pytest.mark.parametrize(("distance", "alike"), [(60.0, 0.99999), (1000.0, 0.99)])
def test_a_box_hundreds_of_deviations_from_mixed_parameters_is_improbable_and_finite(distance, alike):
    matrix = np.array([[1.0, -alike], [-alike, 1.0]])  # rounding leaves the factor of the other bound no Gaussian
    found = truncated(Gaussian(-distance * np.array([1.0, 1.05]), matrix, np.zeros(2), np.full(2, np.inf)))
    assert found.log_probability < -0.5 * distance**2
    assert np.all(np.isfinite(found.mean))
    assert np.all(np.isfinite(found.matrix))


def test_deviation_within_bounds_is_that_of_draws_from_the_stated_values():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((3, 5)) / np.sqrt(5.0)
    matrix, mean, lower = root @ root.T, np.array([-0.4, 0.3, 0.1]), np.array([0.0, -np.inf, 0.0])
    known, stated = Gaussian(mean, matrix, lower, np.full(3, np.inf)), np.array([0.0, 0.5, 0.2])
    drawn = rng.multivariate_normal(mean, matrix, 400_000)
    off = drawn[np.all(drawn > lower, axis=1)] - stated
    np.testing.assert_allclose(deviation_within(known, stated), off.T @ off / off.shape[0], atol=0.02)

"""The correction of the lift table: where it acts, how large it may be, its slope."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.laws.lift import KNOT_STEP, lift_correction
from camtorque.units import DEGREE

THETA = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
LIFT = np.where((THETA > 0.5) & (THETA < 2.5), 8e-3 * np.sin((THETA - 0.5) * np.pi / 2.0) ** 2, 0.0)
STEP = 0.5 * DEGREE


@pytest.fixture(scope="module")
def basis():
    return lift_correction(THETA, LIFT, 1e-6, 0.0, STEP)


def test_it_acts_on_the_lifted_part_and_three_degrees_around_it(basis):
    lifted = THETA[LIFT > 2.001e-6]
    whole = basis.basis(THETA).sum(axis=1)
    np.testing.assert_allclose(whole[LIFT > 2.001e-6], 1.0, atol=1e-12)  # B-splines sum to one where all are there
    acting = THETA[whole > 0.999]
    assert 2.9 * DEGREE < lifted.min() - acting.min() < 3.5 * DEGREE
    assert 2.9 * DEGREE < acting.max() - lifted.max() < 3.5 * DEGREE + KNOT_STEP  # the last knot step is a whole one
    assert np.all(whole[(acting.min() - 6.0 * KNOT_STEP > THETA) | (acting.max() + 7.0 * KNOT_STEP < THETA)] == 0.0)


def test_prior_is_the_tables_rounding_or_its_noise_over_the_knots(basis):
    assert basis.prior_std == pytest.approx(1e-6 / np.sqrt(12.0) * np.sqrt(STEP / KNOT_STEP))
    noisy = lift_correction(THETA, LIFT, 1e-6, 2e-6, STEP)
    assert noisy.prior_std == pytest.approx(2e-6 * np.sqrt(STEP / KNOT_STEP))


def test_slope_is_the_derivative_and_repeats_every_revolution(basis):
    coefficients = np.random.default_rng(2).normal(size=basis.n_basis) * 1e-7
    h = 1e-5
    found = (basis.correction(THETA + h, coefficients) - basis.correction(THETA - h, coefficients)) / (2.0 * h)
    stated = basis.correction(THETA, coefficients, 1)
    np.testing.assert_allclose(stated, found, atol=1e-3 * np.max(np.abs(found)))
    np.testing.assert_allclose(basis.correction(THETA - 2.0 * np.pi, coefficients, 1), stated, atol=1e-12)
    assert np.max(np.abs(basis.correction(THETA, coefficients))) <= np.max(np.abs(coefficients))

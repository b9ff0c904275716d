"""Periodic splines in numpy against those of scipy and a dense solution; functions that are plain and compiled."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.compiled import elementwise, njit
from camtorque.mechanism.lift_laws import cubic_law, quintic_law, spectral_law
from camtorque.mechanism.periodic_spline import DENSE, PeriodicSplines, solve_cyclic
from camtorque.mechanism.smoothing import _root
from camtorque.records import CamTable
from camtorque.units import TURN
from mechanism_cases import analytic_law
from scipy.interpolate import BPoly, BSpline, CubicSpline, make_interp_spline

SIZES = (13, DENSE, DENSE + 1, 360, 1001)


def uneven_angles(size):
    steps = np.random.default_rng(1).uniform(0.5, 1.5, size)
    return 0.3 + np.append(0.0, np.cumsum(steps)) * TURN / np.sum(steps)


@pytest.mark.parametrize("derivative", [0, 1, 3])
@pytest.mark.parametrize("degree", [3, 5])
def test_basis_is_that_of_scipy(degree, derivative):
    splines = PeriodicSplines(uneven_angles(40), degree)
    angle = np.random.default_rng(2).uniform(splines.breaks[0], splines.breaks[-1], 500)
    values, places = splines.rows(angle, derivative)
    for k in (0, 7, 39):
        one = np.arange(40 + degree) % 40 == k
        expected = BSpline(splines.knots, one.astype(float), degree)(angle, derivative)
        found = np.sum(values * (places == k), axis=1)
        np.testing.assert_allclose(found, expected, atol=1e-11 * np.max(np.abs(expected)))


@pytest.mark.parametrize("size", SIZES)
def test_cyclic_bands_are_solved_as_the_whole_matrix_is(size):
    splines = PeriodicSplines(uneven_angles(size), 5)
    theta = splines.breaks[:-1]
    bands = splines.normal(theta, np.ones(size)) + 1e-12 * splines.normal(theta + 1e-3, np.ones(size), 3)
    whole = np.zeros((size, size))
    for derivative, scale, angle in ((0, 1.0, theta), (3, 1e-12, theta + 1e-3)):
        values, places = splines.rows(angle, derivative)
        design = np.zeros((size, size))
        np.add.at(design, (np.arange(size)[:, None], places), values)
        whole += scale * design.T @ design
    right = np.random.default_rng(3).standard_normal(size)
    np.testing.assert_allclose(whole @ solve_cyclic(bands, right), right, atol=1e-8)


@pytest.mark.parametrize("size", [40, 360])
def test_interpolants_are_those_of_scipy(size):
    theta = uneven_angles(size)
    lift = analytic_law("cycloidal").evaluate(theta)
    table, fine = CamTable(theta[:-1], lift[:-1], 1e-6), np.linspace(theta[0], theta[-1], 2001)
    lift[-1] = lift[0]
    cubic, quintic = (
        CubicSpline(theta, lift, bc_type="periodic"),
        make_interp_spline(theta, lift, 5, bc_type="periodic"),
    )
    for law, expected in ((cubic_law(table), cubic), (quintic_law(table), quintic)):
        for derivative in range(3):
            truth = expected(fine, derivative)
            np.testing.assert_allclose(law.evaluate(fine, derivative), truth, atol=1e-8 * np.max(np.abs(truth)))


def test_pieces_of_the_spectral_law_are_those_of_scipy():
    theta = np.arange(360) * TURN / 360
    law = spectral_law(CamTable(theta, analytic_law("cycloidal").evaluate(theta), 1e-6))
    ends = np.array([law.evaluate(law.knots, k) for k in range(3)])
    fine = np.linspace(law.knots[0], law.knots[-1], 3001)[:-1]
    expected = BPoly.from_derivatives(law.knots, ends.T)
    np.testing.assert_allclose(law.evaluate(fine), expected(fine), atol=1e-14)
    np.testing.assert_allclose(law.evaluate(fine, 2), expected(fine, 2), atol=1e-9)


@pytest.mark.parametrize("size", [12, 24, 25])
def test_a_table_of_few_even_points_has_a_law_for_torque(size):
    theta = np.arange(size) * TURN / size
    lift = 4e-3 * (1.0 - np.cos(theta))
    law = spectral_law(CamTable(theta, lift, 1e-6))
    np.testing.assert_allclose(law.evaluate(theta), lift, atol=1e-5)


@pytest.mark.parametrize("root", [-57.3, -1.0, 0.25, 29.9])
def test_root_is_found_however_flat_the_ends_are(root):
    assert _root(lambda x: float(np.tanh(0.5 * (x - root))), -60.0, 30.0) == pytest.approx(root, abs=1e-8)


@pytest.mark.parametrize(("value", "end"), [(-1.0, 30.0), (1.0, -60.0)])
def test_without_a_root_the_end_is_found(value, end):
    assert _root(lambda _: value, -60.0, 30.0) == pytest.approx(end, abs=1e-6)


def test_laws_in_numpy_and_compiled_are_the_same():
    law, angle = analytic_law("modified_sine"), np.linspace(-9.0, 9.0, 4001)
    for plain, compiled in zip(law.derivatives(angle), law.compiled_derivatives(angle), strict=True):
        np.testing.assert_allclose(compiled, plain, atol=1e-13 * np.max(np.abs(plain)))


def test_an_elementwise_function_is_plain_in_python_and_compiled_in_compiled_code():
    @elementwise
    def halved(x):
        return 0.5 * x

    @njit
    def total(x):
        sum_of = 0.0
        for value in x:
            sum_of += halved(value)
        return sum_of

    np.testing.assert_array_equal(halved(np.array([2.0, 4.0])), [1.0, 2.0])
    assert "dispatcher" not in vars(halved)
    assert total(np.array([2.0, 4.0])) == 3.0
    assert "dispatcher" in vars(halved)

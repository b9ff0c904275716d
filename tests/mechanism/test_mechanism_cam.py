"""Lift laws from tables: what rounding costs, flat dwells, periodicity, any spacing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.lift_laws import LIFT_METHODS, lift_law
from camtorque.mechanism.smoothing import _unrolled, smoothing_law, table_error
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import CamTable, Refusal
from camtorque.units import TURN
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanism_cases import DEGREE, analytic_law, paper_pump
from scipy.interpolate import PPoly

FINE = np.arange(7200) * (TURN / 7200)
KINDS = ("polynomial_4567", "cycloidal", "modified_sine")
MICRON = 1e-6


def rounded_table(kind, resolution, step_deg=1.0):
    theta = np.arange(0.0, 360.0, step_deg) * DEGREE
    lift = analytic_law(kind).evaluate(theta)
    return CamTable(theta, np.round(lift / resolution) * resolution, resolution)


def errors(law, truth):
    """Greatest error of y, y', y'' over the greatest true value."""
    ours, exact = law.derivatives(FINE, 2), truth.derivatives(FINE, 2)
    return np.max(np.abs(ours - exact), axis=1) / np.max(np.abs(exact), axis=1)


# Greatest errors (y', y'') of the smoothing law that a resolution is allowed, relative to the greatest value. Rounding
# of one step in 8 mm is 1.25e-4 per um; the slope may err by a tenth of the step per degree, and y'' is limited at the
# ends of flanks whose jerk jumps (cycloidal, modified sine), where every smooth curve cuts the corner.
ALLOWED = {
    ("polynomial_4567", 0.1): (5e-4, 0.01),
    ("polynomial_4567", 1.0): (1.5e-3, 0.02),
    ("polynomial_4567", 10.0): (6e-3, 0.05),
    ("cycloidal", 0.1): (1e-3, 0.05),
    ("cycloidal", 1.0): (3e-3, 0.08),
    ("cycloidal", 10.0): (1e-2, 0.12),
    ("modified_sine", 0.1): (1.5e-3, 0.08),
    ("modified_sine", 1.0): (4e-3, 0.12),
    ("modified_sine", 10.0): (1.5e-2, 0.2),
}


@pytest.mark.parametrize(("kind", "microns"), ALLOWED)
def test_rounding_does_not_ruin_slope_and_acceleration(kind, microns):
    truth = analytic_law(kind)
    found = errors(lift_law(rounded_table(kind, microns * MICRON)), truth)
    slope, acceleration = ALLOWED[kind, microns]
    # greatest of 360 residuals of standard deviation 0.29 steps is 1 step, and half as much where a corner is cut
    assert found[0] * truth.lift < 1.5 * microns * MICRON
    assert found[1] < slope
    assert found[2] < acceleration


@pytest.mark.parametrize("kind", KINDS)
def test_interpolating_a_rounded_table_is_far_worse(kind):
    # the reason for the default: with 1 um steps both interpolants miss y'' by more than twice as much
    table, truth = rounded_table(kind, MICRON), analytic_law(kind)
    smooth = errors(lift_law(table), truth)[2]
    for method in ("cubic", "quintic"):
        assert errors(lift_law(table, method), truth)[2] > 2.0 * smooth, method


@pytest.mark.parametrize("kind", KINDS)
def test_hertz_and_curvature_of_a_micron_table_are_sound(kind):
    pump = paper_pump()
    exact = closed_form_tables(pump, analytic_law(kind), FINE)
    ours = closed_form_tables(pump, lift_law(rounded_table(kind, MICRON)), FINE)
    assert not np.any(ours.kinematics.undercut)
    stress = [tables.hertz(3e7, 50.0) for tables in (exact, ours)]
    # 2 % of the peak stress: it goes with the root of the curvature, whose error is that of y''
    assert np.max(np.abs(stress[1] - stress[0])) < 0.02 * np.max(stress[0])


@pytest.mark.parametrize("microns", [0.1, 1.0, 10.0])
def test_dwells_stay_flat(microns):
    law = lift_law(rounded_table("polynomial_4567", microns * MICRON))
    dwells = FINE[((FINE > 66 * DEGREE) & (FINE < 74 * DEGREE)) | ((FINE > 150 * DEGREE) & (FINE < 345 * DEGREE))]
    lift, velocity, _ = law.derivatives(dwells, 2)
    off = np.minimum(np.abs(lift), np.abs(lift - 8e-3))
    assert np.max(off) < 0.05 * microns * MICRON
    # the interpolants ring there with about a tenth of a step per degree
    assert np.max(np.abs(velocity)) < 0.02 * microns * MICRON / DEGREE


def test_exact_table_is_interpolated_by_the_quintic():
    truth = analytic_law()
    theta = np.arange(0.0, 360.0, 1.0) * DEGREE
    law = lift_law(CamTable(theta, truth.evaluate(theta), MICRON), "quintic")
    assert errors(law, truth)[2] < 2e-3


@pytest.mark.parametrize("method", LIFT_METHODS)
def test_uneven_table_gives_the_same_cam(method):
    truth = analytic_law()
    # steps between 0.5 and 1.5 degrees
    theta = (np.arange(360) + np.random.default_rng(2).uniform(-0.25, 0.25, 360)) * DEGREE + 0.3
    table = CamTable(theta, np.round(truth.evaluate(theta), 7), 1e-7)
    found = errors(lift_law(table, method), truth)
    assert found[1] < 2e-3
    assert found[2] < 0.1


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("step_deg", [0.1, 0.5, 2.0])
def test_finer_and_coarser_tables_are_smoothed_as_well(kind, step_deg):
    # the dwell's margin is an angle, not a number of points, and dense points take a smaller share of the freedom
    found = errors(lift_law(rounded_table(kind, MICRON, step_deg)), analytic_law(kind))
    assert found[1] < 4e-3
    assert found[2] < 0.12


def test_table_of_random_angles_is_smoothed_too():
    # mean step half a degree, least step a ten-thousandth of it: the knots have to be thinner than the points
    truth = analytic_law()
    theta = np.sort(np.random.default_rng(0).uniform(0.0, TURN, 720))
    found = errors(lift_law(CamTable(theta, np.round(truth.evaluate(theta), 6), MICRON)), truth)
    assert found[1] < 1.5e-3
    assert found[2] < 0.02


def test_scatter_beyond_the_resolution_is_smoothed_too():
    random = np.random.default_rng(4)
    truth, theta = analytic_law(), np.arange(360) * DEGREE
    noisy = np.round((truth.evaluate(theta) + 2e-6 * random.standard_normal(360)) / MICRON) * MICRON
    table = CamTable(theta, noisy, MICRON)
    # 2 um of noise and 0.29 um of rounding; a median over 360 points is good to 10 % (three standard errors 25 %)
    assert table_error(table) == pytest.approx(2.02e-6, rel=0.25)
    assert errors(lift_law(table), truth)[2] < 0.15
    assert lift_law(table).lift_std == table_error(table)


def test_rounding_alone_is_not_taken_for_scatter():
    table = rounded_table("cycloidal", MICRON)
    assert table_error(table) == pytest.approx(MICRON / np.sqrt(12.0))


def test_constant_table_is_a_circle():
    law = lift_law(CamTable(np.arange(360) * DEGREE, np.zeros(360), MICRON))
    assert np.max(np.abs(law.derivatives(FINE))) < 1e-15


@pytest.mark.parametrize("method", LIFT_METHODS)
def test_law_is_smooth_across_its_knots_and_the_turn(method):
    jumps = lift_law(rounded_table("polynomial_4567", MICRON), method).continuity_at_knots().max(axis=1)
    # rounding of the piece ends: 1e-16 of the lift, per knot distance for each derivative
    assert np.all(jumps[:3] < [1e-15, 1e-13, 1e-11])


@given(st.floats(-50.0, 50.0), st.integers(-3, 3))
@settings(max_examples=60, deadline=None)
def test_law_is_periodic_and_is_its_polynomial(angle, turns):
    law = lift_law(rounded_table("modified_sine", MICRON), "cubic")
    reference = PPoly(law.coefficients, law.knots)
    wrapped = np.mod(angle, TURN)
    for derivative in range(4):
        value = law.evaluate(np.array([angle + turns * TURN]), derivative)[0]
        # y''' of a cubic jumps at the knots, which rounding of the wrapped angle may cross
        tolerance = 1e-9 if derivative < 3 else 10.0
        assert value == pytest.approx(reference(wrapped, derivative), abs=tolerance)


def test_shape_and_order_of_the_angles_do_not_matter():
    law = analytic_law()
    angles = np.random.default_rng(1).uniform(-9.0, 9.0, (4, 5))
    together = law.evaluate(angles, 1)
    assert together.shape == (4, 5)
    assert together[2, 3] == law.evaluate(angles[2:3, 3], 1)[0]


def test_refusals_say_what_to_do():
    table = rounded_table("cycloidal", MICRON)
    with pytest.raises(Refusal, match="method 'linear' is unknown, expected one of smoothing"):
        lift_law(table, "linear")
    with pytest.raises(Refusal, match="5 points in one revolution, expected at least 12"):
        lift_law(CamTable(np.arange(5.0), np.zeros(5), MICRON))
    with pytest.raises(Refusal, match="expected a positive step"):
        smoothing_law(replace(table, resolution=0.0))
    with pytest.raises(ValueError, match="over exactly one revolution"):
        CamLaw(np.array([0.0, 1.0]), np.zeros((4, 1)))
    with pytest.raises(ValueError, match="do not belong"):
        CamLaw(np.array([0.0, TURN]), np.zeros((4, 2)))


def test_angles_beyond_the_table_go_on_by_a_revolution():
    closed = np.deg2rad(np.arange(361.0))  # the last point is the first of the next revolution
    found = _unrolled(closed, np.array([-5, 3, 359, 360, 365]))
    np.testing.assert_allclose(found, np.deg2rad([-5.0, 3.0, 359.0, 360.0, 365.0]), atol=1e-12)


@pytest.mark.parametrize(("rows", "noise"), [(720, 0.45), (1440, 0.46)])
def test_a_scatter_of_half_a_step_is_not_followed_into_the_curvature(rows: int, noise: float) -> None:
    """Taken for rounding alone it was: a Hertz pressure of 1.24 GPa for 0.77, a curvature ten times the cam's."""
    theta = np.arange(rows) * 2.0 * np.pi / rows
    resolution = 0.5e-6
    lift = 2.5e-3 * (1.0 - np.cos(theta)) + noise * resolution * np.random.default_rng(rows).standard_normal(rows)
    law = smoothing_law(CamTable(theta, np.round(lift / resolution) * resolution, resolution))
    assert law.derivatives(theta, 2)[2] == pytest.approx(2.5e-3 * np.cos(theta), abs=0.02 * 2.5e-3)


@pytest.mark.parametrize("rows", [90, 180, 360, 1440])
def test_rounding_alone_is_no_scatter(rows: int) -> None:
    theta = np.arange(rows) * 2.0 * np.pi / rows
    for power in (4, 8, 12):
        for resolution in (0.3e-6, 1.0e-6, 7.0e-6):
            lift = np.round(8e-3 * np.cos(0.5 * theta - 0.3) ** power / resolution) * resolution
            assert table_error(CamTable(theta, lift, resolution)) == pytest.approx(resolution / np.sqrt(12.0))

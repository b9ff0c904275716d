"""Pumps on an elastic shaft against time integration written from scratch, and in the limits."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.mechanism.elastic import solve_by_harmonics, solve_elastic
from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.periodic import _sweep, gauss
from camtorque.mechanism.shaft import solve_shaft
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import Refusal
from mechanism_cases import analytic_law, paper_pump
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

LAW = analytic_law()
SIZE = 1800
THETA = np.arange(SIZE) * (2.0 * np.pi / SIZE)
SPEED = 52.36
LOAD = 3e7 * np.exp(-(((THETA - 0.5) / 0.12) ** 2))


def units(count):
    return [PumpUnit(paper_pump(), LAW, 2.0 * np.pi * k / count) for k in range(count)]


def loads(count):
    return np.stack([np.roll(LOAD, SIZE * k // count) for k in range(count)])


def integrate(count, stiffness, damping):
    """Integrate the lobes over two revolutions from rest in twist; torque at the drive end over the last one."""
    unit, fine = units(1)[0], np.linspace(0.0, 2.0 * np.pi, 4 * SIZE + 1)
    # constant, pressure, speed squared and inertia of the torque on one cam, over its own angle
    parts = CubicSpline(fine, closed_form_tables(unit.pump, LAW, fine).outputs["torque"].T, bc_type="periodic")

    def pressure(angle, k):
        local = np.mod(angle - 2.0 * np.pi * k / count, 2.0 * np.pi)
        return 3e7 * np.exp(-(((local - 0.5) / 0.12) ** 2))

    def rates(time, state):
        twist, rate = state[:count], state[count:]
        across = np.diff(twist, prepend=0.0)
        across_rate = np.diff(rate, prepend=0.0)
        section = -(stiffness * across + damping * across_rate)
        net = section - np.append(section[1:], 0.0)
        change = np.empty(count)
        for k in range(count):
            angle = SPEED * time + twist[k]
            table = parts(np.mod(angle - 2.0 * np.pi * k / count, 2.0 * np.pi))
            known = table[0] + table[1] * pressure(angle, k) + table[2] * (SPEED + rate[k]) ** 2
            change[k] = (net[k] - known) / table[3]
        return np.concatenate([rate, change])

    period = 2.0 * np.pi / SPEED
    times = (1.0 + THETA[::30] / (2.0 * np.pi)) * period
    solved = solve_ivp(
        rates, (0.0, 2.0 * period), np.zeros(2 * count), "LSODA", times, rtol=1e-8, atol=1e-10, max_step=period / 400
    )
    return -(stiffness * solved.y[0] + damping * solved.y[count])


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_periodic_solution_is_that_of_time_integration(count):
    # well damped (zeta about 0.5), so that the start has died out after one revolution
    stiffness, damping = 2000.0, 0.35
    ours = solve_elastic(units(count), loads(count), SPEED, np.full(count, stiffness), np.full(count, damping))
    theirs = integrate(count, stiffness, damping)
    # the lift law's knots limit the order of both; the integrator's tolerance is below it
    assert np.max(np.abs(ours.torque[::30] - theirs)) < 3e-4 * np.max(theirs)


def test_stiff_shaft_is_rigid():
    rigid = solve_shaft(units(3), THETA, loads(3), SPEED)
    stiff = solve_elastic(units(3), loads(3), SPEED, np.full(3, 1e7), np.full(3, 1.0))
    # twist of 1e-5 rad, times a torque slope of some 300 N m/rad, of 27 N m
    assert np.max(np.abs(stiff.torque - rigid.torque)) < 1e-3 * np.max(rigid.torque)


def test_mean_torque_does_not_depend_on_the_shaft():
    # without damping nothing is lost; the pressure belongs to the cam angle, so the fluid takes the same work
    rigid = solve_shaft(units(1), THETA, loads(1), SPEED)
    soft = solve_elastic(units(1), loads(1), SPEED, np.array([3000.0]), np.array([0.2]))
    lost = np.mean(0.2 * (soft.speed[0] - SPEED) ** 2) / SPEED
    assert np.mean(soft.torque) == pytest.approx(np.mean(rigid.torque) + lost, rel=1e-3)


def test_section_torque_drops_by_the_torque_of_the_lobe():
    solved = solve_elastic(units(3), loads(3), SPEED, np.full(3, 4000.0), np.full(3, 0.5))
    for k, unit in enumerate(units(3)):
        angle = THETA + solved.twist[k]
        local = np.mod(angle, 2.0 * np.pi)
        pressure = np.interp(local, np.append(THETA, 2.0 * np.pi), np.append(loads(3)[k], loads(3)[k, 0]))
        tables = closed_form_tables(unit.pump, LAW, angle - unit.phase)
        expected = tables.evaluate("torque", pressure, solved.speed[k], solved.acceleration[k])
        outboard = solved.section_torque[k + 1] if k < 2 else 0.0
        # the pressure is interpolated linearly here, by cubics there
        assert np.max(np.abs(solved.section_torque[k] - outboard - expected)) < 2e-3 * np.max(np.abs(expected))


def test_too_soft_a_shaft_is_refused():
    with pytest.raises(Refusal, match=r"no periodic motion was found at .* order 11\.1 of the cam.*or turn back"):
        solve_elastic(units(1), loads(1), SPEED, np.array([20.0]), np.array([0.0]))


def test_cam_that_turns_back_is_refused():
    # an orbit of the equations exists, on which the cam runs backwards; the chamber knows no such motion
    with pytest.raises(Refusal, match="expected a cam that keeps turning forward"):
        solve_elastic(units(1), loads(1), SPEED, np.array([200.0]), np.array([1e-6]))


@pytest.mark.parametrize("solve", [solve_elastic, solve_by_harmonics])
@pytest.mark.parametrize("stiffness", [3e1, 5e4, 1e5, 2e5])
def test_orbit_is_found_where_the_fixed_point_runs_away(stiffness, solve):
    # resonance below the highest harmonic (900), or a shaft so soft that the cam nearly stops
    solved = solve(units(1), loads(1), SPEED, np.array([stiffness]), np.array([0.5]))
    angle = THETA + solved.twist[0]
    periodic = CubicSpline(np.append(THETA, 2.0 * np.pi), np.append(LOAD, LOAD[0]), bc_type="periodic")
    pressure = periodic(np.mod(angle, 2.0 * np.pi))
    expected = closed_form_tables(units(1)[0].pump, LAW, angle).evaluate(
        "torque", pressure, solved.speed[0], solved.acceleration[0]
    )
    # Newton ends at 1e-11 of the twist; two time derivatives at harmonic 900 make 1e-5 of it, times J w^2 = 0.2 N m
    assert np.max(np.abs(solved.section_torque[0] - expected)) < 1e-4 * np.max(np.abs(expected))


@pytest.mark.parametrize(
    ("count", "stiffness", "damping"), [(2, 1e5, 0.0), (2, 2e5, 0.0), (2, 2e5, 0.05), (3, 5e5, 0.0), (4, 2e4, 0.0)]
)
def test_orbit_of_several_lobes_is_found_without_damping_and_at_resonance(count, stiffness, damping):
    # the shaft's own order lies among the harmonics; only a shaft as soft as its load turns has no orbit
    solved = solve_elastic(units(count), loads(count), SPEED, np.full(count, stiffness), np.full(count, damping))
    for k, unit in enumerate(units(count)):
        angle = THETA + solved.twist[k]
        curve = CubicSpline(np.append(THETA, 2.0 * np.pi), np.append(loads(count)[k], loads(count)[k, 0]))
        tables = closed_form_tables(unit.pump, LAW, angle - unit.phase)
        expected = tables.evaluate("torque", curve(np.mod(angle, 2.0 * np.pi)), solved.speed[k], solved.acceleration[k])
        outboard = solved.section_torque[k + 1] if k + 1 < count else 0.0
        # 720 elements of order 8: the knots of the law inside them leave 1e-7
        assert np.max(np.abs(solved.section_torque[k] - outboard - expected)) < 1e-6 * np.max(np.abs(expected))
    rigid = solve_shaft(units(count), THETA, loads(count), SPEED).torque
    assert np.max(np.abs(solved.torque - rigid)) < 0.1 * np.max(rigid)


def test_every_lobe_is_in_balance_to_the_tolerance_of_the_iteration():
    # a constant load needs no interpolation, and at this speed inertia is a tenth of the torque
    constant = np.full((3, SIZE), 2e6)
    solved = solve_elastic(units(3), constant, 150.0, np.full(3, 2e4), np.full(3, 2.0))
    for k, unit in enumerate(units(3)):
        tables = closed_form_tables(unit.pump, LAW, THETA + solved.twist[k] - unit.phase)
        expected = tables.evaluate("torque", constant[k], solved.speed[k], solved.acceleration[k])
        outboard = solved.section_torque[k + 1] if k < 2 else 0.0
        difference = np.max(np.abs(solved.section_torque[k] - outboard - expected))
        # the iteration ends at 1e-12 of the twist; two time derivatives at harmonic 900 make 1e-6 of that
        assert difference < 1e-5 * np.max(np.abs(expected))


@pytest.mark.parametrize("stiffness", [3e3, 2e4])
def test_collocation_and_harmonics_give_the_same_motion(stiffness):
    arguments = (units(1), loads(1), SPEED, np.array([stiffness]), np.array([0.5]))
    one, other = solve_elastic(*arguments), solve_by_harmonics(*arguments)
    # harmonics up to 900 against the 6-stage rule: the knots of the law and the cubic curves between stages
    for name, share in (("torque", 1e-5), ("twist", 1e-5), ("speed", 1e-5), ("acceleration", 1e-3)):
        ours, theirs = getattr(one, name), getattr(other, name)
        assert np.max(np.abs(ours - theirs)) < share * np.max(np.abs(theirs)), name


def test_newtons_matrix_of_the_period_is_how_the_end_depends_on_the_start():
    nodes, weights, matrix = gauss(3)
    borders = np.linspace(0.0, 2.0 * np.pi, 25)
    theta = (borders[:-1, None] + nodes * np.diff(borders)[:, None]).ravel()
    rows = np.stack([5.0 * np.sin(theta), 1e-4 * np.cos(theta), 2e-3 + 5e-4 * np.cos(theta)])

    def end(start):
        state = np.zeros((2, theta.size))
        turns, *found = _sweep(rows, np.diff(borders), weights, matrix, (300.0, 0.2, 50.0), start, state)
        assert turns
        return found

    slopes = [(end(step)[0] - end(-step)[0]) / (2.0 * np.sum(step)) for step in np.diag([1e-5, 1e-3])]
    _, stated = end(np.zeros(2))
    assert stated == pytest.approx(np.transpose(slopes), rel=1e-4)

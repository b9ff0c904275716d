"""Laws of mechanics that the rigid solution has to satisfy to rounding, whatever pump, motion and method.

Tolerance 1e-12 of the greatest value: double precision leaves about 1e-15 per operation, and a solution takes some
hundred of them. The tangential force is a thousandth of the normal one and comes out of the same 2 x 2 system, so the
matrix form is compared on the scale of the contact force.
"""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.mechanism import denoc
from camtorque.mechanism.friction import Friction, jamming_friction
from camtorque.mechanism.kinematics import flat_pressure_angle, kinematics
from camtorque.mechanism.mounting import Mounting, PumpUnit, assumed_roller
from camtorque.mechanism.shaft import METHODS, solve_shaft
from camtorque.mechanism.solve import forces_of, solve_rigid
from camtorque.mechanism.torque import OUTPUTS, closed_form_tables
from camtorque.records import Refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanism_cases import (
    CASES,
    STEP,
    analytic_law,
    case,
    contact_geometry,
    kinetic_energy_per_speed,
    lift_series,
    motion,
    newton_euler,
    paper_pump,
    worst,
)

EXACT = 1e-12
LAW = analytic_law()


def solve(name, method="closed"):
    pump, mounting, run = case(name)
    return solve_shaft(
        [PumpUnit(pump, LAW, mounting=mounting)], run.theta, run.pressure, run.speed, run.acceleration, method=method
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", CASES)
def test_solution_is_that_of_newton_and_euler_from_scratch(name, method):
    pump, mounting, run = case(name)
    ours = solve(name, method).outputs[0]
    rows = zip(run.theta, run.pressure, run.speed, run.acceleration, strict=True)
    reference = [newton_euler(pump, LAW, mounting, *row) for row in rows]
    scale = max(abs(row["contact_normal"]) for row in reference)
    for output in OUTPUTS:
        expected = np.array([row[output] for row in reference])
        # forces on the scale of the contact force, torque and moment on that force times a centimetre
        lever = 0.01 if output in ("torque", "guide_moment") else 1.0
        assert np.max(np.abs(ours[output] - expected)) < EXACT * scale * lever, output


@pytest.mark.parametrize("friction", [Friction(guide=0.1), Friction(bearing_arm=3e-4), Friction(pin_arm=4e-5)])
@pytest.mark.parametrize("name", CASES)
def test_friction_is_that_of_newton_and_euler_from_scratch(name, friction):
    pump, mounting, run = case(name)
    unit = PumpUnit(pump, LAW, mounting=mounting, friction=friction)
    ours = solve_shaft([unit], run.theta, run.pressure, run.speed, run.acceleration).outputs[0]
    rows = zip(run.theta, run.pressure, run.speed, run.acceleration, strict=True)
    reference = [newton_euler(pump, LAW, mounting, *row, friction) for row in rows]
    frictionless = solve(name).outputs[0]
    slope = np.abs(LAW.evaluate(run.theta, 1))
    # between standing and sliding the sign of the velocity turns smoothly
    clear = (slope < 1e-9) | (slope > 2e-3)
    scale = max(abs(row["contact_normal"]) for row in reference)
    assert np.max(np.abs(ours["torque"] - frictionless["torque"])) > 1e-5 * scale
    for output in OUTPUTS:
        expected = np.array([row[output] for row in reference])
        lever = 0.01 if output in ("torque", "guide_moment") else 1.0
        assert np.max(np.abs(ours[output] - expected)[clear]) < 1e-6 * scale * lever, output


@pytest.mark.parametrize("name", CASES)
def test_torque_is_that_of_lagrange_from_energies(name):
    # tau = d/dt dT/domega - dT/dtheta + dV/dtheta + A p y' with T = J(theta) omega^2 / 2
    pump, mounting, run = case(name)
    expected = []
    for theta, pressure, speed, acceleration in zip(run.theta, run.pressure, run.speed, run.acceleration, strict=True):
        _, _, ratio = contact_geometry(pump, LAW, mounting, theta)
        inertia = kinetic_energy_per_speed(pump, LAW, mounting, theta, ratio)
        slope = np.imag(inertia(1j * STEP)) / STEP
        lift, velocity, _ = (f(0.0) for f in lift_series(LAW, theta))
        mass = pump.follower_mass + mounting.spring_mass / 3.0
        axial = pump.spring_preload + pump.spring_stiffness * lift - mass * mounting.gravity[1]
        expected.append(
            inertia(0.0) * acceleration + 0.5 * slope * speed**2 + velocity * (axial + pump.plunger_area * pressure)
        )
    assert worst(solve(name).torque, expected) < EXACT


@pytest.mark.parametrize("name", CASES)
def test_power_of_the_motor_is_what_the_bodies_gain_and_the_fluid_takes(name):
    pump, mounting, run = case(name)
    out = solve(name).outputs[0]
    path = kinematics(pump, LAW, run.theta, mounting.rotation)
    mass = pump.follower_mass + mounting.spring_mass / 3.0
    rise = path.velocity * run.speed
    rise_rate = path.acceleration * run.speed**2 + path.velocity * run.acceleration
    spin = path.roller_ratio * run.speed
    spin_rate = path.roller_ratio_slope * run.speed**2 + path.roller_ratio * run.acceleration
    roller = assumed_roller(pump)
    kinetic = (
        pump.cam_inertia * run.speed * run.acceleration + mass * rise * rise_rate + roller.inertia * spin * spin_rate
    )
    stored = (pump.spring_preload + pump.spring_stiffness * path.lift - mass * mounting.gravity[1]) * rise
    fluid = pump.plunger_area * run.pressure * rise
    assert worst(out["torque"] * run.speed, kinetic + stored + fluid) < EXACT


@pytest.mark.parametrize("name", CASES)
def test_contact_force_does_no_work_because_both_surfaces_move_alike(name):
    pump, mounting, run = case(name)
    path = kinematics(pump, LAW, run.theta, mounting.rotation)
    contact_x, contact_y = path.contact_point
    cam = np.array([-contact_y, contact_x]) * run.speed
    spin = path.roller_ratio * run.speed
    arm_x, arm_y = contact_x - path.offset, contact_y - path.centre_height
    roller = np.array([-spin * arm_y, path.velocity * run.speed + spin * arm_x])
    assert worst(roller, cam) < EXACT


@pytest.mark.parametrize("name", CASES)
def test_complement_is_orthogonal_to_the_constraint_wrenches(name):
    pump, mounting, run = case(name)
    out = solve(name, "denoc").outputs[0]
    turn = mounting.rotation
    chain = denoc.follower_chain(pump, mounting)
    zero = np.zeros_like(run.theta)
    # guide on follower, minus the reaction of the roller on it; pin on roller
    follower = np.stack([zero, zero, zero, turn * (out["guide"] - out["pin_x"]), -out["pin_y"], zero], axis=1)
    roller = np.stack([zero, zero, zero, turn * out["pin_x"], out["pin_y"], zero], axis=1)
    work = np.concatenate([follower, roller], axis=1) @ chain.complement
    assert np.max(np.abs(work)) < EXACT * np.max(np.abs(out["contact_normal"]))
    # and it is no accident of a zero complement: the same wrenches out of step do work
    assert np.max(np.abs(np.concatenate([follower, 0.0 * roller], axis=1) @ chain.complement)) > 100.0


def test_guide_and_bearing_wrenches_are_orthogonal_to_the_joint_motions():
    chain = denoc.camshaft_chain([paper_pump()] * 3)
    force = np.tile([0.0, 0.0, 0.0, 3.0, -7.0, 2.0], 3)
    assert np.all(force @ chain.complement == 0.0)


@pytest.mark.parametrize("pumps", [1, 3])
def test_generalised_mass_is_symmetric_and_positive(pumps):
    pump, mounting, _ = case("offset, varying speed")
    for chain in (denoc.camshaft_chain([pump] * pumps), denoc.follower_chain(pump, mounting)):
        reduced = chain.complement.T @ chain.mass @ chain.complement
        for matrix in (chain.mass, reduced):
            assert np.array_equal(matrix, matrix.T)
            assert np.all(np.linalg.eigvalsh(matrix) > 0.0)


def test_joint_space_mass_of_the_camshaft_counts_every_lobe_beyond_the_joint():
    chain = denoc.camshaft_chain([paper_pump(cam_inertia=value) for value in (1e-5, 2e-5, 4e-5)])
    reduced = chain.complement.T @ chain.mass @ chain.complement
    assert np.allclose(reduced[0], [7e-5, 6e-5, 4e-5], rtol=1e-15)


def test_twist_propagation_carries_a_rotation_to_a_distant_point():
    # v_i = v_j + omega x r_ji, r_ji from j to i; B_ij takes the arm from i to j
    twist = np.array([0.0, 0.0, 2.0, 1.0, 0.0, 0.0])
    carried = denoc.twist_propagation(np.array([-0.5, 0.0, 0.0])) @ twist
    assert np.array_equal(carried, [0.0, 0.0, 2.0, 1.0, 1.0, 0.0])


@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize("pumps", [1, 3])
def test_matrix_recursion_and_closed_form_agree(pumps, varying):
    run = motion(varying, size=60)
    units = [
        PumpUnit(paper_pump(follower_offset=1e-3 * k), LAW, phase=2.0 * k, mounting=Mounting(gravity=(1.0, -9.81)))
        for k in range(pumps)
    ]
    load = run.pressure * np.array([1.0, 0.4, 0.7])[:pumps, None]
    solved = {m: solve_shaft(units, run.theta, load, run.speed, run.acceleration, method=m) for m in METHODS}
    reference = solved["closed"]
    scale = np.max(np.abs(reference.outputs[0]["contact_normal"]))
    for method in ("denoc", "recursion"):
        assert worst(solved[method].section_torque, reference.section_torque) < EXACT
        for ours, theirs in zip(solved[method].outputs, reference.outputs, strict=True):
            for name in OUTPUTS:
                assert np.max(np.abs(ours[name] - theirs[name])) < EXACT * scale, (method, name)


def test_pumps_on_one_shaft_add_up():
    run = motion(True)
    units = [PumpUnit(paper_pump(), LAW, phase) for phase in (0.0, 2.1, 4.2)]
    alone = [
        solve_shaft([PumpUnit(u.pump, LAW)], run.theta - u.phase, run.pressure, run.speed, run.acceleration).torque
        for u in units
    ]
    together = solve_shaft(units, run.theta, run.pressure, run.speed, run.acceleration)
    assert worst(together.torque, np.sum(alone, axis=0)) < EXACT


@pytest.mark.parametrize("method", METHODS)
def test_turning_the_shaft_the_other_way_mirrors_the_offset(method):
    run = motion(True)
    solved = []
    for offset, rotation in ((5e-3, 1), (-5e-3, -1)):
        unit = PumpUnit(paper_pump(follower_offset=offset), LAW, mounting=Mounting(rotation, guide_height=0.04))
        solved.append(solve_shaft([unit], run.theta, run.pressure, run.speed, run.acceleration, method=method))
    here, mirrored = (s.outputs[0] for s in solved)
    for name in OUTPUTS:
        sign = -1.0 if name in ("contact_x", "bearing_x", "guide", "guide_moment", "pin_x") else 1.0
        assert np.array_equal(mirrored[name], sign * here[name]), name


def test_offset_towards_x1_relieves_the_rise_of_positive_rotation():
    theta = np.linspace(0.0, np.pi / 3.0, 400)
    greatest = [
        np.max(kinematics(paper_pump(follower_offset=e), LAW, theta, rotation).pressure_angle)
        for e, rotation in ((0.0, 1), (5e-3, 1), (5e-3, -1))
    ]
    assert greatest[1] < greatest[0] < greatest[2]


def test_causes_add_up_to_the_torque():
    pump, mounting, run = case("offset, varying speed")
    solved = solve_rigid(pump, LAW, run.theta, run.pressure, run.speed, run.acceleration, mounting=mounting)
    assert worst(np.sum(list(solved.by_cause.values()), axis=0), solved.torque) < EXACT
    assert np.max(np.abs(solved.by_cause["gravity"])) > 0.0
    assert set(solved.by_cause) == {
        "pressure",
        "spring",
        "inertia_follower",
        "inertia_cam",
        "inertia_roller",
        "gravity",
    }
    friction = Friction(0.08, 2e-4, 3e-5)
    rough = solve_rigid(
        pump, LAW, run.theta, run.pressure, run.speed, run.acceleration, mounting=mounting, friction=friction
    )
    assert worst(np.sum(list(rough.by_cause.values()), axis=0), rough.torque) < EXACT
    for name in ("guide_friction", "bearing_friction", "pin_friction"):
        # no friction drives its own motor
        assert np.min(rough.by_cause[name]) >= 0.0 < np.max(rough.by_cause[name]), name
    assert worst(rough.by_cause["spring"], solved.by_cause["spring"]) < EXACT


def test_a_foot_rubs_by_what_the_cam_slides_along_it():
    mu, pump = 0.05, paper_pump(roller_inertia=0.0, follower_offset=2e-3)
    mounting, run = case("offset, varying speed")[1:]
    tables = closed_form_tables(pump, LAW, run.theta, mounting, Friction(0.0, 0.0, mu * pump.roller_radius))
    lost = tables.torque_by_cause(run.pressure, run.speed, run.acceleration)["pin_friction"]
    force = tables.evaluate("contact_normal", run.pressure, run.speed, run.acceleration)
    slips = np.empty_like(run.theta)
    for k, angle in enumerate(run.theta):
        centre, normal = (part(0.0) for part in contact_geometry(pump, LAW, mounting, angle)[:2])
        contact = centre - pump.roller_radius * normal
        # the cam turns about the origin, the foot follows the lift and does not turn
        slip = np.array([-contact[1], contact[0] - lift_series(LAW, angle)[1](0.0)])
        slips[k] = abs(slip @ np.array([normal[1], -normal[0]]))
    # its own tangential force leaves the normal one by mu tan phi, which the law neglects, as it does for a pin
    assert worst(lost, mu * force * slips) < mu * np.max(np.abs(tables.kinematics.tan_pressure_angle))


def test_spring_and_inertia_give_nothing_over_a_revolution():
    theta = np.arange(3600) * (2.0 * np.pi / 3600)
    solved = solve_rigid(paper_pump(), LAW, theta, np.zeros(3600), 50.0)
    for cause in ("spring", "inertia_follower", "inertia_roller"):
        assert abs(np.mean(solved.by_cause[cause])) < 1e-6 * np.max(np.abs(solved.by_cause[cause])), cause


def test_surface_curvature_is_that_of_the_envelope():
    # osculating circle through three close points of Q in the cam's frame: error h^2 of the curve, about 1e-6
    pump = paper_pump(follower_offset=3e-3)
    theta = np.array([0.2, 0.5, 0.9, 1.3, 1.9, 2.2, 4.0])
    h = 1e-4
    points = []
    for shift in (-h, 0.0, h):
        x, y = kinematics(pump, LAW, theta + shift).contact_point
        c, s = np.cos(theta + shift), np.sin(theta + shift)
        points.append(np.array([c * x + s * y, c * y - s * x]))
    a, b, c = points
    first, second = (c - a) / (2 * h), (a - 2 * b + c) / h**2
    # the surface runs clockwise in the cam's frame: convex is a right turn
    turning = -(first[0] * second[1] - first[1] * second[0]) / np.hypot(*first) ** 3
    assert np.allclose(kinematics(pump, LAW, theta).surface_curvature, turning, rtol=1e-4)
    arc = kinematics(pump, LAW, theta).surface_arc
    assert np.allclose(arc, np.hypot(*first), rtol=1e-5)


def test_hertz_of_a_roller_on_the_base_circle_is_the_line_contact_formula():
    # two steel cylinders of 20 and 8 mm, length 5 mm, 110 N preload: Johnson 1985, equations 4.43 to 4.45
    solved = solve_rigid(paper_pump(), LAW, np.array([4.0]), np.zeros(1), 50.0)
    modulus = 210e9 / (2.0 * (1.0 - 0.09))
    radius = 1.0 / (1.0 / 0.02 + 1.0 / 0.008)
    p0 = np.sqrt(110.0 * modulus / (np.pi * 0.005 * radius))
    half_width = np.sqrt(4.0 * 110.0 * radius / (np.pi * 0.005 * modulus))
    assert solved.forces.hertz[0] == pytest.approx(p0, rel=1e-9)
    assert solved.forces.hertz_shear_depth[0] == pytest.approx(0.786 * half_width, rel=1e-9)
    assert solved.forces.hertz_shear_max[0] == pytest.approx(0.3 * p0, rel=1e-9)


def test_tables_serve_every_cycle_at_once():
    theta = np.linspace(0.0, 2.0, 50)
    pressure = np.random.default_rng(0).uniform(0.0, 6e7, (4, 50))
    speed = np.array([[30.0], [50.0], [80.0], [120.0]])
    tables = closed_form_tables(paper_pump(), LAW, theta)
    together = tables.evaluate("guide", pressure, speed)
    for row in range(4):
        alone = solve_rigid(paper_pump(), LAW, theta, pressure[row], speed[row, 0])
        assert np.allclose(together[row], alone.forces.guide, rtol=1e-13, atol=0.0)
        forces = forces_of(paper_pump(), tables, pressure[row], speed[row, 0])
        assert np.allclose(forces.hertz, alone.forces.hertz, rtol=1e-13, atol=0.0)


def test_follower_jumps_just_above_the_jump_speed_and_there():
    theta = np.arange(7200) * (2.0 * np.pi / 7200)
    pump = paper_pump()
    loss = closed_form_tables(pump, LAW, theta).jump()
    below = solve_rigid(pump, LAW, theta, np.zeros(7200), 0.999 * loss.speed)
    above = solve_rigid(pump, LAW, theta, np.zeros(7200), 1.001 * loss.speed)
    assert not below.contact_lost
    assert above.contact_lost
    lost = theta[above.forces.contact_normal == 0.0]
    assert lost.min() - 1e-9 <= loss.theta <= lost.max() + 1e-9
    assert np.all(above.forces.hertz[above.forces.contact_normal == 0.0] == 0.0)


def test_without_contact_bearing_and_guide_carry_weight_alone():
    theta = np.arange(720) * (2.0 * np.pi / 720)
    pump, mounting = paper_pump(follower_offset=2e-3), Mounting(gravity=(3.0, -9.81), guide_height=0.05)
    solved = solve_rigid(pump, LAW, theta, np.zeros(720), 500.0, mounting=mounting)
    lost = solved.forces.contact_normal == 0.0
    assert np.any(lost)
    expected = {
        "contact_tangential": 0.0,
        "bearing_x": -3.0 * pump.cam_mass,
        "bearing_y": 9.81 * pump.cam_mass,
        "guide": -3.0 * pump.follower_mass,
    }
    scale = np.max(solved.forces.contact_normal)
    for name, value in expected.items():
        assert np.allclose(getattr(solved.forces, name)[lost], value, rtol=0.0, atol=EXACT * scale), name
    height = kinematics(pump, LAW, theta).centre_height
    moment = (height - 0.05) * 3.0 * pump.follower_mass
    assert np.allclose(solved.forces.guide_moment[lost], moment[lost], rtol=0.0, atol=EXACT * scale)


def test_heavy_spring_never_lets_go():
    theta = np.linspace(3.0, 6.0, 20)
    loss = closed_form_tables(paper_pump(), LAW, theta).jump()
    assert np.isinf(loss.speed)
    assert np.isnan(loss.theta)


def test_assumed_roller_is_a_steel_disk_capped_by_the_follower():
    disk = assumed_roller(paper_pump(roller_mass=None, roller_inertia=None))
    assert disk.assumed
    assert disk.mass == pytest.approx(7850.0 * np.pi * 0.008**2 * 0.005)
    assert disk.inertia == pytest.approx(0.5 * disk.mass * 0.008**2)
    light = assumed_roller(paper_pump(roller_mass=None, roller_inertia=None, follower_mass=0.01))
    assert light.mass == 0.005
    assert not assumed_roller(paper_pump()).assumed


def test_follower_jams_where_friction_meets_the_steepest_rise():
    path = kinematics(paper_pump(follower_offset=-6e-3), LAW, np.linspace(0.0, 2.0 * np.pi, 3600))
    limit, theta = jamming_friction(path)
    rising = path.velocity > 1e-3
    assert limit == pytest.approx(1.0 / np.max(path.tan_pressure_angle[rising]), rel=1e-4)
    assert rising[np.argmin(np.abs(path.theta - theta))]
    arguments = (paper_pump(follower_offset=-6e-3), LAW, path.theta, np.zeros(3600), 50.0)
    solve_rigid(*arguments, friction=Friction(guide=0.99 * limit))
    with pytest.raises(Refusal, match=r"the follower jams in its guide at .* degrees of cam angle.*below 1\.3"):
        solve_rigid(*arguments, friction=Friction(guide=1.01 * limit))


def test_guide_friction_raises_the_contact_load():
    path = kinematics(paper_pump(), LAW, np.linspace(0.0, 2.5, 400))
    axial = 110.0 + 2e4 * path.lift + paper_pump().plunger_area * 2e7
    loaded = closed_form_tables(paper_pump(), LAW, path.theta, friction=Friction(guide=0.1)).evaluate(
        "contact_y", 2e7, 0.0
    )
    # 2.5 % of the peak at a tangent of 0.5 and a friction of 0.05: what frictionless forces leave out
    assert np.max(loaded / axial) == pytest.approx(1.0 / (1.0 - 0.1 * np.tan(np.deg2rad(27.72))), rel=1e-3)
    assert np.min(loaded / axial) < 0.95  # on the fall it carries a part of the load


def test_frictionless_methods_refuse_friction():
    unit = PumpUnit(paper_pump(), LAW, friction=Friction(guide=0.1))
    for method in ("denoc", "recursion"):
        with pytest.raises(Refusal, match=f"method '{method}' is frictionless, found friction; use 'closed'"):
            solve_shaft([unit], np.zeros(3), np.zeros(3), 50.0, method=method)
    with pytest.raises(ValueError, match="expected coefficients of 0 or more"):
        Friction(guide=-0.1)


def test_refusals_say_what_to_do():
    theta = np.linspace(0.0, 1.0, 5)
    with pytest.raises(Refusal, match="method 'magic' is unknown, expected one of closed"):
        solve_rigid(paper_pump(), LAW, theta, np.zeros(5), 50.0, method="magic")
    with pytest.raises(Refusal, match="speed varies from 50 to 60 rad/s without an acceleration"):
        solve_rigid(paper_pump(), LAW, theta, np.zeros(5), np.linspace(50.0, 60.0, 5))
    with pytest.raises(Refusal, match=r"follower offset 0\.03 m, expected less than the 0\.028 m"):
        kinematics(paper_pump(follower_offset=0.03), LAW, theta)
    with pytest.raises(Refusal, match="a shaft without pumps"):
        solve_shaft([], theta, np.zeros(5), 50.0)
    with pytest.raises(ValueError, match="rotation is 2, expected"):
        Mounting(rotation=2)
    with pytest.raises(ValueError, match="spring mass is -1"):
        Mounting(spring_mass=-1.0)


def test_offset_relieves_the_reactions_and_leaves_the_torque():
    # the closing claim of the paper, answered in docs/cam_profiles.md
    theta = np.arange(720) * (2.0 * np.pi / 720)
    pressure = 6e7 * np.exp(-(((theta - 0.5) / 0.15) ** 2))
    massless = {"roller_inertia": 0.0}
    on_axis, shifted = (
        solve_rigid(paper_pump(follower_offset=e, **massless), LAW, theta, pressure, 52.0) for e in (0.0, 6e-3)
    )
    assert worst(shifted.torque, on_axis.torque) < EXACT
    for name in ("guide", "contact_normal", "bearing_x"):
        peaks = [np.max(np.abs(getattr(solved.forces, name))) for solved in (shifted, on_axis)]
        assert peaks[0] < peaks[1], name


def test_rolling_roller_turns_against_the_cam_and_faster():
    # on the base circle omega_2 / omega = 1 - (r_b + r_r) / r_r = -r_b / r_r, and the surface runs at r_b omega
    path = kinematics(paper_pump(), LAW, np.array([4.0]))
    assert path.roller_ratio[0] == pytest.approx(-0.02 / 0.008)
    assert path.surface_arc[0] == pytest.approx(0.02)
    assert path.surface_curvature[0] == pytest.approx(1.0 / 0.02)
    assert not path.concave[0]


def test_flat_check_bounds_the_pressure_angle_closely():
    theta = np.arange(3600) * (2.0 * np.pi / 3600)
    for offset in (0.0, 5e-3, 2e-2):
        for rotation in (1, -1):
            pump = paper_pump(follower_offset=offset)
            steep, back = flat_pressure_angle(pump, LAW, rotation)
            exact = kinematics(pump, LAW, theta, rotation).pressure_angle
            # the rise of the centre at the steepest point, 4 of 28 mm, is what it leaves out
            assert exact.max() <= steep < exact.max() + 0.1
            assert exact.min() >= back > exact.min() - 0.1


@given(
    st.floats(-0.012, 0.012),
    st.sampled_from([1, -1]),
    st.floats(0.0, 0.02),
    st.floats(0.0, 2e-6),
    st.floats(5.0, 300.0),
    st.floats(-2e4, 2e4),
)
@settings(max_examples=40, deadline=None)
def test_methods_agree_for_any_pump(offset, rotation, roller_mass, roller_inertia, speed, acceleration):
    pump = paper_pump(follower_offset=offset, roller_mass=roller_mass, roller_inertia=roller_inertia)
    unit = PumpUnit(pump, LAW, mounting=Mounting(rotation, gravity=(-4.0, 9.81), spring_mass=0.05))
    theta = np.linspace(0.0, 2.4, 12)
    solved = [solve_shaft([unit], theta, 2e7, speed, acceleration, method=m).outputs[0] for m in METHODS]
    scale = max(np.max(np.abs(solved[0][name])) for name in ("contact_normal", "contact_tangential", "pin_y"))
    for other in solved[1:]:
        for name in OUTPUTS:
            assert np.max(np.abs(other[name] - solved[0][name])) < EXACT * scale, name

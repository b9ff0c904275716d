"""Identities of the chamber: mass is kept whatever the step, through vapour too; closed forms of its parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.laws.chain import evaluate, with_substeps
from camtorque.laws.chamber import FLOW, KERNEL_UNITS, LOWEST
from camtorque.laws.fluid import ATMOSPHERE, specific_volume
from camtorque.laws.leakage import leak_flow
from camtorque.laws.ports import LAMINAR, SUCTION_OPENS, SUCTION_SOFT, flow_root, opening, suction_root
from camtorque.laws.valve import CUSHION, LIFTED, STOP, STOP_CUSHION, STOP_LOSS, lifted, seat_drop, stop_force, swept
from laws_cases import N, chain_input, refined, start_values

CLOSED = {"port_width": 0.0, "leakage": 0.0, "end_of_delivery": -9.0, "outlet_return": 0.0}
"""Neither port nor leak nor outlet."""


def specific(pressure, values):
    """Return the specific volume at gauge pressures [Pa]."""
    numbers = values["bulk_modulus"] * 1e-5, values["bulk_modulus_slope"], values["free_air"]
    return np.array([specific_volume(p * 1e-5, *numbers)[0] for p in pressure])


def volume(data, output, values):
    return values["dead_volume"] + data.pump.plunger_area * (data.top_lift - output.motion.lift[0])


@pytest.mark.parametrize("air", [0.0, 3e-3])
@pytest.mark.parametrize("n", [600, 3600])
def test_closed_chamber_keeps_its_mass_whatever_the_step(n, air):
    data, values = chain_input(n=n), {**start_values(), **CLOSED, "free_air": air, "dead_volume": 4e-6}
    output = evaluate(data, values)
    mass = volume(data, output, values) / specific(output.pressure, values)
    assert output.pressure.max() > 400e5
    np.testing.assert_allclose(mass, mass[0], rtol=1e-9)


def test_a_suction_valve_fills_what_no_port_does():
    values = {**start_values("land"), "port_width": 0.0, "leakage": 0.0, "free_air": 0.0, "suction_area": 1.5e-6}
    data = refined(chain_input(n=7200), values)
    output = evaluate(data, values)
    swept = -data.pump.plunger_area * output.motion.lift[1] * output.motion.rate
    drawing = (output.flows[:, 0] < 0.0) & (swept > 0.2 * np.max(swept))
    drawn = (
        FLOW
        * values["suction_area"]
        * np.array([suction_root((values["feed_pressure"] - p) * 1e-5)[0] for p in output.pressure[drawing]])
    )
    assert drawing.sum() > 300
    # liquid hardly gives at a few bar: what the plunger sweeps comes in through the valve
    inside = slice(30, None)  # the valve opens
    np.testing.assert_allclose(drawn[inside], swept[drawing][inside], rtol=0.02)
    assert not output.flows[output.pressure > values["feed_pressure"], 0].any()


@pytest.mark.parametrize("inertance", [0.0, 20.0e6])
def test_oil_between_valve_and_sensor_takes_pressure_to_be_accelerated(inertance):
    values = {**start_values("spill"), "line_inertance": inertance, "pressure_zero": 0.0, "retraction_volume": 2e-9}
    data = chain_input(n=7200)
    output = evaluate(data, values)
    step = 2.0 * np.pi / 7200 / data.speed
    gallery, swept, seat = output.states[:, 0], output.states[:, 1] * 1e-9, output.flows[:, 2]
    into_line = np.diff(swept, prepend=0.0) / step + seat
    entry = data.line_pressure + inertance * np.diff(into_line, prepend=0.0) / step
    flowing = seat > 0.2 * np.max(seat)
    assert flowing.sum() > 300
    roots = np.array([flow_root(drop)[0] for drop in (gallery - entry * 1e-5)[flowing]])
    lifts = np.array([lifted(u, values["retraction_volume"] * 1e9)[0] for u in output.states[flowing, 1]])
    stated = 1e-6 * FLOW * values["seat_gain"] * 1e-3 * lifts * roots  # mm^3/ms per mm^3 and root of a bar
    np.testing.assert_allclose(stated, seat[flowing], rtol=1e-3)
    assert np.max(np.abs(entry - data.line_pressure)[flowing]) >= 0.15 * inertance


@pytest.mark.parametrize("share", [0.0, 1e-3, 1.0, 300.0, 1e5])
@pytest.mark.parametrize("total", [-2000.0, -0.3, -1e-5, 0.0, 1e-5, 0.02, 5.0, 2000.0])
def test_the_drop_over_the_seat_and_what_the_oil_takes_add_up(total, share):
    drop = seat_drop(total, share)
    assert drop + share * flow_root(drop)[0] == pytest.approx(total, rel=1e-9, abs=1e-9)
    assert drop * total >= 0.0


def test_the_root_of_a_suction_valve_has_no_corner():
    differences = SUCTION_OPENS + np.linspace(-3.0, 3.0, 601) * SUCTION_SOFT
    values, slopes = np.array([suction_root(x) for x in differences]).T
    assert not values[differences < SUCTION_OPENS - SUCTION_SOFT].any()
    step = differences[1] - differences[0]
    np.testing.assert_allclose(np.gradient(values, step)[1:-1], slopes[1:-1], atol=2.0 * step / SUCTION_SOFT)
    assert suction_root(30.0)[0] == flow_root(30.0 - SUCTION_OPENS)[0]


def test_an_outlet_that_opens_on_the_return_lets_what_it_trapped_into_the_line():
    trapped = {**start_values("land"), "leakage": 0.0, "outlet_return": 0.0}
    released = {**trapped, "outlet_return": 1.0}
    data = refined(chain_input(n=7200), trapped)
    kept, let_go = evaluate(data, trapped), evaluate(data, released)
    back = let_go.motion.theta > data.top_angle
    end_lift = data.law.derivatives(np.array([trapped["end_of_delivery"]]), 0)[0, 0]
    closed = let_go.motion.lift[0] > end_lift + 0.05e-3  # the corner of the opening
    # the revolution begins with what is left at its end: 11.2 and 11.0 bar
    np.testing.assert_allclose(let_go.pressure[~back | closed], kept.pressure[~back | closed], rtol=1e-9, atol=0.3e5)
    early = let_go.motion.theta < 0.5 * trapped["end_of_delivery"]
    loaded = ~early & (~back | closed)
    np.testing.assert_allclose(let_go.pressure[loaded], kept.pressure[loaded], rtol=1e-9)
    assert not kept.flows[back, 2].any()
    assert let_go.flows[back & ~closed, 2].max() > 0.0
    assert np.all(let_go.pressure[back & ~closed] <= kept.pressure[back & ~closed] + 1e4)


@pytest.mark.parametrize("area", [0.03e-6, 0.2e-6, 1.5e-6])
def test_a_revolution_begins_with_what_a_suction_valve_has_left_at_its_end(area):
    values = {**start_values("spill"), "port_width": 0.0, "leakage": 0.0, "free_air": 1e-3, "suction_area": area}
    data = refined(chain_input(n=7200), values)
    output = evaluate(data, values)
    mass = volume(data, output, values) / specific(output.pressure, values)
    whole = volume(data, output, values)[0] / specific([values["feed_pressure"]], values)[0]
    starved = whole - mass[-1] > 0.01 * whole
    assert starved == (area < 0.1e-6)
    # what flows in a step of 0.05 degrees lies between both ends, and what the valve sweeps, which begins at its seat
    np.testing.assert_allclose(mass[0], mass[-1], rtol=3e-4)
    known = evaluate(data, values, tangents=True, known=output.path)
    np.testing.assert_allclose(known.pressure, output.pressure, rtol=1e-9, atol=1.0)


@pytest.mark.parametrize("retraction", [0.0, 0.4e-9, 12e-9])
def test_a_line_does_not_run_back_through_a_valve_that_rests(retraction):
    """The seat's opening had a tail: 123 of 196 mm^3 that a pump delivered in a stroke ran back at 250 bar."""
    values = {**start_values("spill"), "retraction_volume": retraction, "line_inertance": 0.0}
    data = chain_input(n=3600)
    output = evaluate(replace(data, line_pressure=np.full(data.theta.size, 250e5)), values)
    seat, resting = output.flows[:, 2], output.states[:, 1] < CUSHION - LIFTED
    assert np.count_nonzero(resting) > 0.6 * resting.size
    assert np.all(seat[resting] == 0.0)
    assert np.sum(seat[seat > 0.0]) > 50.0 * abs(np.sum(seat[seat < 0.0]))


def test_mass_is_kept_through_vapour():
    # the port closes at the top instead of the foot: the plunger draws the closed volume down to vapour, and back
    data, values = chain_input(), {**start_values(), **CLOSED, "free_air": 0.0, "dead_volume": 4e-6}
    values["trigger_offset"] += 1.4  # the revolution starts at full lift, as the chamber is filled
    output = evaluate(data, values)
    mass = volume(data, output, values) / specific(output.pressure, values)
    assert output.pressure.min() < -0.9e5
    assert output.pressure.min() > LOWEST * 1e5
    np.testing.assert_allclose(mass, mass[0], rtol=1e-8)


@pytest.mark.parametrize(("end", "until"), [("land", 900), ("spill", 7200), ("open", 7200)])
def test_what_leaves_chamber_and_gallery_is_what_flows(end, until):
    # a land that has closed leaves gallery and valve alone: up to there; the others over the whole revolution
    values = start_values(end)
    data = refined(chain_input(n=7200), values)
    output = evaluate(data, values)
    gallery = values["gallery_volume"] + np.array([swept(u)[0] for u in output.states[:, 1]]) * 1e-9
    mass = volume(data, output, values) / specific(output.pressure, values)
    mass = (mass + gallery / specific(output.states[:, 0] * 1e5, values))[:until]
    flow = output.flows.sum(axis=1)[:until]
    out = np.r_[0.0, np.cumsum(0.5 * (flow[1:] + flow[:-1]))] * 2.0 * np.pi / 7200 / data.speed
    assert output.flows[:until, 2].max() > 1e-5
    # trapezium between grid points, where the steps are finer
    assert np.max(np.abs(mass - mass[0] + out)) < 4e-3 * np.ptp(mass)


def test_a_seat_that_a_rail_presses_in_takes_no_room() -> None:
    """As much as a chamber of 150 mm^3 took at 1850 bar, for which its fuel became stiffer: trigger 1 degree off."""
    values = {**start_values("open"), "port_width": 0.0, "leakage": 0.0, "free_air": 0.0, "dead_volume": 5e-8,
              "gallery_volume": 1e-8, "suction_area": 0.0}  # fmt: skip
    data = chain_input(n=3600)
    output = evaluate(replace(data, line_pressure=np.full(data.theta.size, 1850e5)), values)
    shut = np.flatnonzero(output.pressure > 1700e5)[0]  # the rail presses with 1850 bar at first, with 150 at last
    assert output.states[0, 1] < -4.0
    assert output.states[shut, 1] > -1.0
    gallery = values["gallery_volume"] / specific(output.states[:shut, 0] * 1e5, values)
    mass = volume(data, output, values)[:shut] / specific(output.pressure[:shut], values) + gallery
    np.testing.assert_allclose(mass, mass[0], rtol=3e-4)


def test_mass_behind_a_closed_land_leaves_by_the_leak_alone():
    values = {**start_values("land"), "outlet_return": 0.0}
    data = refined(chain_input(n=7200), values)
    output = evaluate(data, values)
    part = slice(1000, 3000)  # 50 to 150 degrees
    mass = (volume(data, output, values) / specific(output.pressure, values))[part]
    leak = output.flows[part, 3]
    assert not output.flows[part, :3].any()
    lost = np.sum(0.5 * (leak[1:] + leak[:-1])) * 2.0 * np.pi / 7200 / data.speed
    assert mass[0] - mass[-1] == pytest.approx(lost, rel=1e-3)


def test_a_valve_of_little_mass_is_a_check_valve():
    values = {**start_values(), "retraction_volume": 2e-9, "valve_mass": 3e5, "valve_damping": 4e4}
    data = refined(chain_input(), values)
    output = evaluate(data, values)
    drop = output.states[:, 0] * 1e5 - (data.line_pressure - values["pressure_zero"])
    flow = output.flows[:, 2]
    flowing = flow > 0.3 * flow.max()
    assert flowing.sum() > N // 60
    assert drop[flowing].min() > 0.7 * values["valve_opening"]
    assert np.abs(flow[drop < 0.0]).max() < 0.02 * flow.max()


def test_fine_steps_are_where_the_valve_moves():
    data, values = chain_input(), start_values()
    output = evaluate(data, values)
    steps = with_substeps(data, output, values)
    moving = output.states[:, 1] > 0.05
    assert moving.any()
    assert steps[moving & (output.pressure > 10e5)].min() > 1
    assert steps.min() == 1
    assert np.mean(steps == 1) > 0.3


def test_fluid_has_the_modulus_that_it_states():
    modulus, slope = 14000.0, 9.0
    for pressure in (5.0, 100.0, 1500.0):
        value, by_pressure, *_ = specific_volume(pressure, modulus, slope, 0.0)
        assert -value / by_pressure == pytest.approx(modulus + slope * pressure, rel=1e-5)
    # air of a share alpha at atmospheric pressure takes alpha of the liquid's room there
    assert specific_volume(0.0, modulus, slope, 0.01)[0] - specific_volume(0.0, modulus, slope, 0.0)[0] == (
        pytest.approx(0.01, rel=0.01)
    )
    # half of it (to the power 1/1.2) at twice the absolute pressure
    twice = specific_volume(ATMOSPHERE, modulus, slope, 0.01)[0] - specific_volume(ATMOSPHERE, modulus, slope, 0.0)[0]
    assert twice == pytest.approx(0.01 * 0.5 ** (1.0 / 1.2), rel=0.01)


@pytest.mark.parametrize("function", ["volume", "root", "opening", "lifted", "leak", "stop"])
def test_functions_of_the_kernel_have_the_derivatives_that_they_state(function):
    # complex steps do not pass max and abs: central differences of the second order, away from zero
    def compare(call, at, stated, step):
        found = (call(at + step) - call(at - step)) / (2.0 * step)
        assert stated == pytest.approx(found, rel=2e-6, abs=1e-12)

    if function == "volume":
        for p in (-0.95, 0.3, 50.0, 900.0):
            numbers = [p, 14000.0, 9.0, 0.003]
            result = specific_volume(*numbers)
            for k, step in enumerate((1e-5, 1.0, 1e-4, 1e-6)):

                def moved(v, k=k, numbers=numbers):
                    return specific_volume(*[v if j == k else x for j, x in enumerate(numbers)])[0]

                compare(moved, numbers[k], result[1 + k], step)
    if function == "root":
        for p in (-40.0, -0.5, 0.0, 1.0, 300.0):
            compare(lambda v: flow_root(v)[0], p, flow_root(p)[1], 1e-4)
        assert flow_root(900.0)[0] == pytest.approx(30.0, rel=1e-5)
        assert flow_root(1e-3 * LAMINAR)[0] == pytest.approx(1e-3 * np.sqrt(LAMINAR), rel=1e-5)
    if function == "opening":
        for x in (-1.0, -0.03, 0.05, 0.4, 0.95, 1.05, 2.0):
            compare(lambda v: opening(v, 0.3)[0], x, opening(x, 0.3)[1], 1e-6)
            compare(lambda v, x=x: opening(x, v)[0], 0.3, opening(x, 0.3)[2], 1e-6)
        assert [opening(x, 0.7)[0] for x in (-1.0, 2.0)] == [0.0, 1.0]
        assert opening(0.4, 0.0)[0] == 0.4
        assert opening(0.4, 1.0)[0] == pytest.approx(3 * 0.16 - 2 * 0.064)
    if function == "lifted":
        compare(lambda v: lifted(v, 12.0)[0], 12.4, lifted(12.4, 12.0)[1], 1e-6)
        assert lifted(32.0, 12.0)[0] == 20.0 - CUSHION
        assert lifted(0.0, 0.0) == (0.0, 0.0), "a valve on its seat is shut"
    if function == "leak":
        numbers = [700.0, 4.0, 0.3, 3e-4]
        result = leak_flow(*numbers)
        for k, step in enumerate((1e-2, 1e-3, 1e-4, 1e-7)):

            def moved(v, k=k):
                return leak_flow(*[v if j == k else x for j, x in enumerate(numbers)])[0]

            compare(moved, numbers[k], result[1 + k], step)
        assert leak_flow(504.0, 4.0, 0.3, 0.0)[0] == pytest.approx(150.0)
        # a gap widened by a tenth leaks with its third power
        wide = leak_flow(1000.0, 0.0, 1.0, 0.001)[0] / leak_flow(500.0, 0.0, 1.0, 0.001)[0]
        assert wide == pytest.approx(2.0 * (2.0 / 1.5) ** 3)
    if function == "stop":
        dt, top = 0.01, 40.0
        cases = ((-2.0, -0.4), (-0.02, -0.4), (0.3, -3.0), (top + 0.03, 0.6), (top - 0.2, -30.0), (top + 2.0, 5.0))
        for u, velocity in cases:
            force, by_u, by_old, by_top = stop_force(u, velocity, dt, top)
            assert force * (u - 0.5 * top) > 0.0  # on the side of inertia: it pushes back
            old = u - dt * velocity
            compare(lambda v, o=old: stop_force(v, (v - o) / dt, dt, top)[0], u, by_u, 1e-7)
            compare(lambda v, u=u: stop_force(u, (u - v) / dt, dt, top)[0], old, by_old, 1e-7)
            compare(lambda v, u=u, w=velocity: stop_force(u, w, dt, v)[0], top, by_top, 1e-7)
        for u, depth, sign in ((-5.0, 5.0, -1.0), (top + 5.0, 5.0, 1.0)):  # behind the cushion: stiffness alone
            assert stop_force(u, 0.0, dt, top)[0] == pytest.approx(sign * STOP * depth)
            assert stop_force(u, sign * 3.0, dt, top)[0] == pytest.approx(sign * STOP * depth * (1 + 3.0 * STOP_LOSS))
        for u in (CUSHION, top - STOP_CUSHION):
            assert stop_force(u, 10.0, dt, top) == (0.0, 0.0, 0.0, 0.0)
            for side in (u - 1e-9, u + 1e-9):  # neither force nor stiffness jumps
                np.testing.assert_allclose(stop_force(side, 0.0, dt, top), 0.0, atol=1e-5)


def test_units_of_the_kernel_are_those_of_the_rows():
    # bar, mm, mm^3, ms: 1 mm^2 at a root of 1 bar flows FLOW mm^3/ms
    assert KERNEL_UNITS["valve_area"] * 1e-6 == 1.0
    flow = FLOW * 1e-6  # m^3/s
    assert flow == pytest.approx(0.7 * np.sqrt(2.0 / 830.0) * np.sqrt(1e5) * 1e-6)
    assert KERNEL_UNITS["leakage"] * 1e-14 * 1e5 == pytest.approx(1e-14 * 1e5 * 1e11)


@pytest.mark.parametrize("roundness", [0.0, 0.6, 1.0, 1.5])
def test_a_port_opens_from_nothing_to_all_of_its_area(roundness: float):
    areas = np.array([opening(x, roundness)[0] for x in np.linspace(-0.2, 1.2, 1401)])
    assert (areas[0], areas[-1], areas.min(), areas.max()) == (0.0, 1.0, 0.0, 1.0)
    assert np.all(np.diff(areas) >= 0.0)

"""A follower that leaves its cam, against an integration of its own, and what the numbers behind it say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.config.pump import load_pump_config
from camtorque.mechanism.flight import fly, is_revolution
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.predict import predict
from camtorque.mechanism.solve import solve_rigid
from camtorque.mechanism.torque import closed_form_tables
from camtorque.records import Refusal
from camtorque.units import RPM
from mechanism_cases import analytic_law, paper_pump
from scipy.integrate import solve_ivp
from test_mechanism_predict import pump_file

LAW, PUMP = analytic_law(), paper_pump()
THETA = np.arange(3600) * (2.0 * np.pi / 3600)
FAST = 320.0
DRY = np.zeros(3600)


def airborne(speed=FAST, pressure=DRY):
    return fly(PUMP, LAW, THETA, pressure, (np.full(3600, speed), np.zeros(3600)), Mounting())


def test_flight_is_that_of_an_integration_with_events():
    flights, _ = airborne()
    assert len(flights) >= 1
    first = flights[0]
    jump = closed_form_tables(PUMP, LAW, THETA).outputs["contact_normal"]
    force = jump[0] + jump[2] * FAST**2
    assert first.start == pytest.approx(THETA[np.argmax(force < 0.0)], abs=THETA[1])

    def rates(theta, state):
        return [state[1], -(PUMP.spring_preload + PUMP.spring_stiffness * state[0]) / PUMP.follower_mass / FAST**2]

    def meets(theta, state):
        return state[0] - LAW.evaluate(np.array([theta]))[0] + (1e-9 if theta < first.start + 0.01 else 0.0)

    meets.terminal, meets.direction = True, -1.0
    start = [float(LAW.evaluate(np.array([first.start]), k)[0]) for k in (0, 1)]
    found = solve_ivp(
        rates, (first.start, first.start + 6.0), start, events=meets, rtol=1e-10, atol=1e-13, max_step=0.01
    )
    assert first.landing == pytest.approx(found.t[-1], abs=2e-3)
    speed = FAST * (LAW.evaluate(found.t[-1:], 1)[0] - found.y[1, -1])
    assert first.speed == pytest.approx(speed, rel=5e-3)
    assert first.impulse == pytest.approx(PUMP.follower_mass * speed, rel=5e-3)


def test_cam_carries_nothing_in_flight():
    solved = solve_rigid(PUMP, LAW, THETA, DRY, FAST)
    _, mask = airborne()
    pulled = closed_form_tables(PUMP, LAW, THETA).evaluate("contact_normal", 0.0, FAST) <= 0.0
    assert solved.contact_lost
    # the follower is in the air longer than the cam would pull: it has to come down
    assert np.count_nonzero(mask & ~pulled) > 50
    assert np.all(solved.torque[mask] == 0.0)
    assert np.all(solved.forces.contact_normal[mask] == 0.0)
    assert np.all(solved.forces.hertz[mask] == 0.0)
    assert np.allclose(np.sum(list(solved.by_cause.values()), axis=0), solved.torque, rtol=0.0, atol=1e-12)
    held = closed_form_tables(PUMP, LAW, THETA).evaluate("torque", 0.0, FAST)
    assert np.allclose(solved.torque[~mask & ~pulled], held[~mask & ~pulled], rtol=1e-12, atol=1e-12)


def test_nothing_flies_below_the_jump_speed():
    speed = closed_form_tables(PUMP, LAW, THETA).jump().speed
    assert airborne(0.999 * speed)[0] == ()
    assert not airborne(0.999 * speed)[1].any()
    assert len(airborne(1.02 * speed)[0]) >= 1


def test_a_follower_without_preload_leaves_its_cam_where_inertia_pulls_alone():
    # on the base circle its force is zero: it rests there, and nothing pulls
    loose = replace(PUMP, spring_preload=0.0)
    jump = closed_form_tables(loose, LAW, THETA).jump()
    assert 50.0 < jump.speed < closed_form_tables(PUMP, LAW, THETA).jump().speed
    assert not solve_rigid(loose, LAW, THETA, DRY, 0.99 * jump.speed).contact_lost
    assert solve_rigid(loose, LAW, THETA, DRY, 1.01 * jump.speed).contact_lost


def test_without_a_revolution_the_torque_is_refused_where_the_cam_would_pull():
    part = THETA[200:1500]
    assert is_revolution(THETA)
    assert is_revolution(np.linspace(0.0, 2.0 * np.pi, 721))
    assert not is_revolution(part)
    assert not is_revolution(THETA[::-1])
    solved = solve_rigid(PUMP, LAW, part, np.zeros(part.size), FAST)
    pulled = closed_form_tables(PUMP, LAW, part).evaluate("contact_normal", 0.0, FAST) <= 0.0
    assert np.array_equal(np.isnan(solved.torque), pulled)


def test_follower_that_never_lands_is_refused():
    with pytest.raises(Refusal, match=r"after 5 revolutions at 47746 rpm the follower has not landed, or flies"):
        fly(replace(PUMP, spring_stiffness=0.0, spring_preload=1.0), LAW, THETA, DRY,
            (np.full(3600, 5000.0), np.zeros(3600)), Mounting())  # fmt: skip


def test_flights_that_repeat_every_second_revolution_are_not_called_endless():
    # from 30 degrees it flies to 563, and takes off again at 30 of the revolution after
    with pytest.raises(Refusal, match="or flies otherwise from one revolution to the next, expected flights that rep"):
        airborne(16000.0 * RPM)


def test_prediction_tells_take_off_and_landing(tmp_path):
    shaft = pump_file(tmp_path, ("[mounting]", "[shaft]\nphases_deg = [0, 180]\n[mounting]"))
    config = load_pump_config(shaft)
    prediction = predict(config, [3000.0 * RPM])
    found = [row for row in prediction.findings if row.code == "contact_lost"]
    assert "and lands at" in found[0].text
    assert "N s that the curves do not show" in found[0].text
    one = prediction.pumps[0].torque
    assert np.allclose(prediction.shaft_torque[0], one + np.roll(one, one.size // 2), rtol=0.0, atol=1e-9)
    elastic = pump_file(tmp_path, ("[mounting]", "[shaft]\nstiffness_N_m_per_rad = 1e5\n[mounting]"), name="e.toml")
    with pytest.raises(Refusal, match="at 3000 rpm the follower leaves the cam, and flight on an elastic shaft is not"):
        predict(load_pump_config(elastic), [3000.0 * RPM])

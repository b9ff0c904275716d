"""Independent multibody engines give the same torque and forces (extra ``validation``; skipped where not installed).

Tolerance 1e-11 of the greatest value: both sides are exact to rounding, and the engines solve with general matrices.
"""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from camtorque.mechanism.mounting import Mounting, PumpUnit
from camtorque.mechanism.shaft import solve_shaft
from engine_cases import ENGINES, agreement
from exudyn_case import integrate, pressure_over
from mechanism_cases import Motion, analytic_law, motion, paper_pump

MODULES = {"pinocchio": "pinocchio", "mujoco": "mujoco"}
EXACT = 1e-11
LAW = analytic_law()


def units_and_motion(offset, varying, pumps):
    mounting = Mounting(rotation=-1 if offset < 0.0 else 1, gravity=(2.0, -9.81), spring_mass=0.03)
    units = [PumpUnit(paper_pump(follower_offset=offset), LAW, 2.1 * k, mounting) for k in range(pumps)]
    run = motion(varying, 40)
    return units, Motion(run.theta, run.pressure * np.array([1.0, 0.4, 0.7])[:pumps, None], run.speed, run.acceleration)


@pytest.mark.parametrize("pumps", [1, 3])
@pytest.mark.parametrize("varying", [False, True])
@pytest.mark.parametrize("offset", [0.0, 5e-3, -4e-3])
@pytest.mark.parametrize("engine", ENGINES)
def test_engine_agrees(engine, offset, varying, pumps):
    if importlib.util.find_spec(MODULES[engine]) is None:
        pytest.skip(f"{MODULES[engine]} is not installed (extra 'validation')")
    units, run = units_and_motion(offset, varying, pumps)
    ours = solve_shaft(units, run.theta, run.pressure, run.speed, run.acceleration)
    found = agreement(engine, units, run, ours)
    assert max(found.values()) < EXACT, found


@pytest.mark.parametrize("ripple", [0.0, 0.02])
@pytest.mark.parametrize("offset", [0.0, 5e-3])
def test_time_integration_from_position_constraints_agrees(offset, ripple):
    if importlib.util.find_spec("exudyn") is None:
        pytest.skip("exudyn is not installed (extra 'validation')")
    pump = paper_pump(follower_offset=offset, roller_inertia=0.0)
    worst = []
    for steps in (720, 1440):
        drive, time, theirs = integrate(pump, LAW, ripple, steps)
        angle, rate, change = drive.angle(time), drive.rate(time), drive.rate_change(time)
        ours = solve_shaft([PumpUnit(pump, LAW)], angle, pressure_over(angle), rate, change).outputs[0]
        # the start has to settle: five degrees
        settled = time > time[-1] / 72.0
        worst.append(max(np.max(np.abs(theirs[n] - ours[n])[settled]) / np.max(np.abs(ours[n])) for n in theirs))
    # a second-order method: half the step, a quarter of the error (a third is asked for), down to 1e-4 already
    assert worst[0] < 1e-4
    assert worst[1] < worst[0] / 3.0

"""The package's rigid model against the independent rig, over both directions of running and an offset follower.

Two programs that share nothing: a time-stepping rig and the closed-form DeNOC solution, given the rig's own pressure,
speed and acceleration. Agreement holds signs, offset, rotation and roller spin at once.
"""

from dataclasses import replace

import numpy as np
import pytest
from camtorque.mechanism.lift_laws import quintic_law
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.solve import solve_rigid
from camtorque.records import CamTable
from rig_bridge import cycles_of, pump_data, recording_of
from rigs.families import bare, closed_volume
from rigs.rig import lift_of, simulate
from rigs.truth import RigTruth, change


def exact_law(run):
    angle = np.radians(np.arange(0.0, 360.0, 0.05))
    return quintic_law(CamTable(angle, lift_of(run.truth, angle), 1e-12))


@pytest.mark.parametrize(("rotation", "offset"), [(1, 0.0), (1, 4e-3), (-1, 4e-3), (1, -4e-3)])
@pytest.mark.parametrize("elastic", [False, True])
def test_rigid_model_meets_the_rig(rotation, offset, elastic):
    truth = change(bare(np.random.default_rng(1)), rotation=rotation, pump__follower_offset=offset)
    if elastic:
        truth = change(truth, driveline=RigTruth().driveline)
    run = simulate(truth, 1200.0, n_cycles=1)
    n = 3600
    theta = 2.0 * np.pi * np.arange(n) / n
    pressure, speed, acceleration = (
        run.true_cycles(name, n)[0] for name in ("chamber_pressure", "cam_speed", "cam_acceleration")
    )
    pump = replace(pump_data(run), roller_mass=0.01, roller_inertia=truth.pump.roller_inertia)
    mounting = Mounting(rotation=rotation)
    rigid = solve_rigid(pump, exact_law(run), theta, pressure, speed, acceleration, mounting=mounting)
    torque = run.true_cycles("torque", n)[0] - truth.driveline.camshaft_inertia * acceleration
    # linear interpolation of the rig's rows (0.06 degrees apart) on the angle grid
    assert np.abs(torque - rigid.torque).max() < 1e-4 * torque.max()
    normal = run.true_cycles("contact_normal", n)[0]
    assert np.abs(normal - rigid.forces.contact_normal).max() < 1e-4 * normal.max()
    side = run.true_cycles("guide_force", n)[0]
    assert np.abs(side - np.abs(rigid.forces.guide)).max() < 1e-3 * side.max()


def test_bridged_records_are_complete():
    run = simulate(closed_volume(np.random.default_rng(2)), 1000.0, n_cycles=4, step=1e-5)
    recording, cycles = recording_of(run), cycles_of(run)
    assert cycles.torque.shape == (4, 3600)
    assert [channel.quantity for channel in recording.channels] == ["torque", "pressure"]
    assert list(cycles.held_out) == [False, True, False, True]
    with pytest.raises(AssertionError, match="no raw samples"):
        recording.channels[0].read_volts(0, 1)

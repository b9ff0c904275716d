"""A simulated rig's run, ready to be fitted, without files."""

from __future__ import annotations

import numpy as np
from camtorque.fit import Prepared, prepare
from camtorque.mechanism import Mounting, lift_law, solve_rigid
from rig_bridge import cycles_of, recording_of
from rigs.rig import RigRun


def prepared_run(run: RigRun) -> Prepared:
    """Return a run whose fit has found its start."""
    recording, cycles = recording_of(run), cycles_of(run)
    config = recording.config
    rigid = solve_rigid(
        config.pump, lift_law(recording.cam_table), cycles.theta, np.mean(cycles.pressure, axis=0), cycles.mean_speed,
        mounting=Mounting(rotation=config.rotation),
    )  # fmt: skip
    return prepare(recording, cycles, rigid)

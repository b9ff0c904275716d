"""The steps of a run between alignment and search (rigid model, mean cycles, priors), which `check` tries too."""

from __future__ import annotations

import numpy as np

from camtorque.fit.prepare import fit_data, mean_cycles
from camtorque.ingest.check import least_pressure
from camtorque.mechanism.lift_laws import lift_law, spectral_law
from camtorque.mechanism.load_check import load_findings
from camtorque.mechanism.mounting import Mounting
from camtorque.mechanism.solve import solve_rigid
from camtorque.records import CamCycles, Finding, Recording, Refusal, RigidTorque
from camtorque.units import BAR

UNDERSHOOT = 0.2
"""Share of the highest pressure by which a mean cycle may go below zero."""


def rigid_torque(recording: Recording, cycles: CamCycles) -> RigidTorque:
    """Return the rigid solution for the mean line pressure at the mean speed."""
    config = recording.config
    law = lift_law(recording.cam_table)
    if not cycles.pressure.size:
        raise Refusal(
            f"{config.id}: no pressure channel, expected one; the model needs the line pressure ('camtorque align' "
            'does not); add a [[channels]] entry with quantity = "pressure"'
        )
    pressure = cycles.mean_pressure
    # a mean cycle undershoots steep ends by some percent
    if np.min(pressure) < min(least_pressure(recording), -UNDERSHOOT * float(np.max(pressure))):
        raise Refusal(
            f"{config.id}: the mean cycle of the line pressure goes down to {np.min(pressure) / BAR:.3g} bar gauge, "
            "expected what a line can hold; turn the sign of its sensitivity, or exchange torque and pressure: see "
            "`camtorque check`"
        )
    mounting = Mounting(rotation=config.rotation)
    return solve_rigid(config.pump, law, cycles.theta, pressure, cycles.mean_speed, mounting=mounting)


def rehearse(recording: Recording, cycles: CamCycles) -> tuple[Finding, ...]:
    """Do all that a run does before its search, and return what the model says of the measured load.

    Raises
    ------
    Refusal : what the run would refuse after minutes
    """
    rigid, means = rigid_torque(recording, cycles), mean_cycles(cycles)
    law = spectral_law(recording.cam_table)
    fit_data(recording, cycles, law, means)
    return load_findings(recording, cycles, rigid)

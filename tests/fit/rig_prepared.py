"""A simulated rig's run as the fit room receives it, without files: `Recording`, `CamCycles`, `RigidTorque`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rigs.cycles import as_cycles
from rigs.rig import RigRun, lift_of

from pipeline.config import LoggerSpec, PumpData, RecordingConfig, TriggerSpec
from pipeline.fit import Prepared, prepare
from pipeline.mechanism import Mounting, solve_rigid
from pipeline.mechanism.spectral import spectral_law
from pipeline.records import (
    CamCycles,
    CamTable,
    Channel,
    ClockFit,
    Estimate,
    Recording,
    RigidTorque,
    SensorCalibration,
)


class _NoSamples:
    n_samples = 0

    def read(self, start: int, stop: int) -> np.ndarray:
        raise AssertionError("the fit reads cycles, not samples")


def lift_table(run: RigRun, seed: int = 0, noise: float = 1e-6) -> CamTable:
    """Return the lift table of the rig as a bench measures it: 1 degree steps, noise, rounded to 1 um."""
    theta = np.deg2rad(np.arange(360.0))
    lift = lift_of(run.truth, theta) + noise * np.random.default_rng(seed).standard_normal(360)
    return CamTable(theta, np.round(lift, 6), 1e-6)


def recording_of(run: RigRun, name: str = "rig", zero_std: float = 0.05) -> Recording:
    """Return the recording's configuration, sheets and lift table; its channels hold no samples."""
    truth = run.truth
    p = truth.pump
    pump = PumpData(
        p.base_circle_radius, p.roller_radius, p.roller_width, p.follower_offset, p.cam_mass, p.cam_inertia,
        p.follower_mass, p.spring_stiffness, p.spring_preload, p.plunger_diameter, 2.1e11, 2.1e11, Path("cam.csv"),
        "angle", "lift",
    )  # fmt: skip
    t = truth.trigger
    trigger = TriggerSpec(t.nominal_angle, t.tolerance, "rising", 1, 5.0, t.switching_delay)
    config = RecordingConfig(
        Path(name), "", name, "rig", float(np.mean(as_speed(run))), "memory", "", "", truth.rotation, "", pump, trigger,
        {}, (LoggerSpec("DAQ", "single"),), (),
    )  # fmt: skip
    torque = SensorCalibration(
        "T", "torque", 40.0, 0.001, 0.0, zero_std, "standstill", 0.02, truth.torque_sensor.delay,
        0.03 * truth.torque_sensor.delay / np.sqrt(3.0), 1000.0, 2, -200.0, 200.0, -5.0, 5.0,
    )  # fmt: skip
    pressure = SensorCalibration(
        "P", "pressure", 2e7, 0.001, 0.0, 0.5e5, "standstill", 1e4, 4e-6, 1e-6, float("nan"), 0, 0.0, 2e8, 0.0, 10.0
    )
    channels = tuple(
        Channel(quantity, "DAQ", _NoSamples(), 0.0, 2e4, sheet, Path(name), quantity)
        for quantity, sheet in (("torque", torque), ("pressure", pressure))
    )
    return Recording(config, channels, lift_table(run), (), ())


def as_speed(run: RigRun) -> np.ndarray:
    """Return the mean speed of each cycle [rad/s]."""
    return as_cycles(run)["speed"]


def cycles_of(run: RigRun, n_theta: int = 3600) -> CamCycles:
    """Return perfectly nominal cycles."""
    data = as_cycles(run, n_theta)
    n = data["speed"].size
    delay = run.truth.torque_sensor.delay
    return CamCycles(
        data["theta"], data["torque"], data["pressure"], data["speed"], np.arange(n), np.arange(n) % 2 == 1, n,
        float(n * 2 * np.pi / data["speed"].mean()), 0.0, (), (ClockFit("DAQ", 0.0, 0.0, 0.0),), (), 0.0, (),
        Estimate(delay, 0.0, delay),
    )  # fmt: skip


def rigid_of(recording: Recording, cycles: CamCycles) -> RigidTorque:
    """Return the rigid solution of the mean pressure."""
    config = recording.config
    law = spectral_law(recording.cam_table)
    return solve_rigid(
        config.pump, law, cycles.theta, cycles.pressure.mean(axis=0), cycles.mean_speed,
        mounting=Mounting(rotation=config.rotation),
    )  # fmt: skip


def prepared_run(run: RigRun, name: str = "rig") -> Prepared:
    """Return a run ready to be fitted."""
    recording, cycles = recording_of(run, name), cycles_of(run)
    return prepare(recording, cycles, rigid_of(recording, cycles))

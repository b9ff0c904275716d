"""From a simulated run to the package's own records without files, for fast fit tests.

Kept outside `rigs`, which knows nothing of the package: here only what a bench sheet says goes across.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from camtorque.config import PumpData, RecordingConfig, SensorRef, TriggerSpec
from camtorque.records import CamCycles, CamTable, Channel, Estimate, Recording, SensorCalibration
from rigs.cycles import as_cycles
from rigs.rig import RigRun, lift_of

NOWHERE = Path("simulated")
TORQUE_GAIN_STD, PRESSURE_GAIN_STD = 0.0006, 0.0008
"""Relative standard uncertainty of the gains: what `rigs.families` draws them with."""
TORQUE_ZERO_STD, PRESSURE_ZERO_STD = 0.05, 0.5e5
DELAY_TOLERANCE = 0.03
RESOLUTION = 1.0e-6


class NoSamples:
    """A channel without samples: the cycles are given, so nothing may read it."""

    n_samples = 0

    def read(self, start: int, stop: int) -> np.ndarray:
        raise AssertionError("a bridged recording has no raw samples")


def pump_data(run: RigRun) -> PumpData:
    """Return the catalogue values."""
    pump = run.truth.pump
    return PumpData(
        base_circle_radius=pump.base_circle_radius,
        roller_radius=pump.roller_radius,
        roller_width=pump.roller_width,
        follower_offset=pump.follower_offset,
        cam_mass=pump.cam_mass,
        cam_inertia=pump.cam_inertia,
        follower_mass=pump.follower_mass,
        spring_stiffness=pump.spring_stiffness,
        spring_preload=pump.spring_preload,
        plunger_diameter=pump.plunger_diameter,
        youngs_modulus_cam=210e9,
        youngs_modulus_roller=210e9,
        cam_table_path=NOWHERE,
        cam_table_angle_column="cam_angle_deg",
        cam_table_lift_column="lift_mm",
    )


def cam_table(run: RigRun, step_deg: float = 1.0, noise: float = 0.5e-6, seed: int = 0) -> CamTable:
    """Return the measured lift table: noisy, rounded to 1 um; ``noise`` 0 and a fine step for the exact law."""
    theta = np.radians(np.arange(0.0, 360.0, step_deg))
    lift = lift_of(run.truth, theta) + noise * np.random.default_rng(seed).standard_normal(theta.size)
    return CamTable(theta, np.round(lift / RESOLUTION) * RESOLUTION, RESOLUTION)


def calibrations(run: RigRun) -> dict[str, SensorCalibration]:
    """Return what certificate and standstill reading give of both sensors."""
    torque, pressure = run.truth.torque_sensor, run.truth.pressure_sensor
    return {
        "torque": SensorCalibration(
            serial="T",
            quantity="torque",
            gain=1.0 / torque.volts_per_unit,
            gain_relative_std=TORQUE_GAIN_STD,
            zero_volts=torque.volts_per_unit * torque.zero,
            zero_std=TORQUE_ZERO_STD,
            zero_source="standstill",
            nonlinearity_std=0.02,
            delay=torque.delay,
            delay_std=torque.delay * DELAY_TOLERANCE / np.sqrt(3.0),
            cutoff_hz=torque.cutoff_hz,
            filter_order=2,
            range_min=-200.0,
            range_max=200.0,
            output_min_volts=-5.0,
            output_max_volts=5.0,
        ),
        "pressure": SensorCalibration(
            serial="P",
            quantity="pressure",
            gain=1.0 / pressure.volts_per_unit,
            gain_relative_std=PRESSURE_GAIN_STD,
            zero_volts=pressure.volts_per_unit * pressure.zero,
            zero_std=PRESSURE_ZERO_STD,
            zero_source="standstill",
            nonlinearity_std=0.5e5,
            delay=pressure.delay,
            delay_std=0.1 * pressure.delay,
            cutoff_hz=float("nan"),
            filter_order=0,
            range_min=0.0,
            range_max=2000e5,
            output_min_volts=0.0,
            output_max_volts=10.0,
        ),
    }


def recording_config(run: RigRun, name: str) -> RecordingConfig:
    """Return what recording.toml would say."""
    trigger = run.truth.trigger
    return RecordingConfig(
        path=NOWHERE,
        text="",
        id=name,
        pump_id=run.truth.name,
        nominal_speed=run.speed_rpm * 2.0 * np.pi / 60.0,
        file_format="simulated",
        csv_dialect="",
        rotation=run.truth.rotation,
        pump_sheet=pump_data(run),
        trigger=TriggerSpec(
            nominal_angle=trigger.nominal_angle,
            installation_tolerance=trigger.tolerance,
            edge="rising",
            pulses_per_rev=1,
            switching_delay=trigger.switching_delay,
        ),
        sensors={quantity: SensorRef(quantity, quantity, NOWHERE, None, None) for quantity in ("torque", "pressure")},
        loggers=(),
        channels=(),
    )


def recording_of(run: RigRun, name: str = "rig", table: CamTable | None = None) -> Recording:
    """Return a recording without samples: configuration, certificates, lift table."""
    channels = tuple(
        Channel(quantity, "DAQ1", NoSamples(), 0.0, 20e3, calibration, NOWHERE, quantity)
        for quantity, calibration in calibrations(run).items()
    )
    return Recording(recording_config(run, name), channels, table or cam_table(run), (), ())


def cycles_of(run: RigRun, n_theta: int = 3600, noise: bool = True, seed: int | None = None) -> CamCycles:
    """Return nominally aligned cycles, every one used, even ones held out."""
    data = as_cycles(run, n_theta, noise=noise, seed=seed)
    n = data["speed"].size
    delay = run.truth.torque_sensor.delay
    return CamCycles(
        theta=data["theta"],
        torque=data["torque"],
        pressure=data["pressure"],
        speed=data["speed"],
        index=np.arange(1, n + 1),
        held_out=np.arange(n) % 2 == 1,
        cycles_found=n,
        duration=float(run.time[-1]),
        speed_ripple_percent=100.0 * float(np.std(data["speed"]) / np.mean(data["speed"])),
        cut_flow=(),
        clocks=(),
        angle_errors=(),
        trigger_jitter_s=run.truth.trigger.jitter,
        findings=(),
        torque_delay=Estimate(delay, delay * DELAY_TOLERANCE / np.sqrt(3.0), delay),
    )

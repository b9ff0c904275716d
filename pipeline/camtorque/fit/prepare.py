"""Aligned cycles and certificates -> what the fit needs: bins, weights, and rows with this rig's priors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from camtorque.config import RecordingConfig
from camtorque.fit.problem import FitData
from camtorque.laws import ROWS
from camtorque.laws.chain import BIN, ChainInput, binned
from camtorque.laws.lift import lift_correction
from camtorque.laws.rows import ParameterRow
from camtorque.mechanism.cam import CamLaw
from camtorque.mechanism.mounting import assumed_roller
from camtorque.records import Array, CamCycles, CamTable, Recording, Refusal, SensorCalibration, freeze_arrays

SMALLEST_SHARE = 2.0e-4
"""Least standard deviation of a bin, as a share of the peak torque: quantisation and grid."""
DISCREPANCY = 1.0e-3
"""Model error per torque that the weights admit; a larger one widens the intervals afterwards."""
LEAST_GRID = 1800
"""Points per revolution below which the chamber's time step smears port and valve."""
CORRELATION = 12.0
"""Bins (of half a degree) that carry one independent value: what the 1 kHz low-pass and smooth model errors leave."""


@dataclass(frozen=True)
class Halves:
    """Mean cycles of the fitted and of the held-out half, on the fine grid.

    torque, pressure : (n_theta,) of the fitted cycles [N m, Pa]; held_torque, held_pressure : of the held-out ones;
    torque_all, pressure_all, torque_std : of all used cycles; scatter_of_mean : rms of the mean's standard error
    """

    torque: Array
    pressure: Array
    held_torque: Array
    held_pressure: Array
    torque_all: Array
    pressure_all: Array
    torque_std: Array
    scatter_of_mean: float

    def __post_init__(self) -> None:
        freeze_arrays(self)


def halves(cycles: CamCycles) -> Halves:
    """Return the mean cycles of both halves.

    Raises
    ------
    Refusal
        Without torque, or with fewer than four used cycles (two to fit, two to score).
    """
    if cycles.torque is None:
        raise Refusal("fit: the recording has no torque channel; use `camtorque align` for pressure and trigger only")
    if cycles.theta.size < LEAST_GRID or cycles.theta.size % BIN:
        raise Refusal(
            f"fit: found an angle grid of {cycles.theta.size} points, expected a multiple of {BIN} and at least "
            f"{LEAST_GRID}; choose another --n-theta"
        )
    if cycles.speed.size < 4 or cycles.held_out.all() or not cycles.held_out.any():
        raise Refusal(f"fit: {cycles.speed.size} usable cycles, at least 4 are needed (2 to fit, 2 to score)")
    fit, held = ~cycles.held_out, cycles.held_out
    std = np.std(cycles.torque, axis=0, ddof=1)
    return Halves(
        np.mean(cycles.torque[fit], axis=0), np.mean(cycles.pressure[fit], axis=0),
        np.mean(cycles.torque[held], axis=0), np.mean(cycles.pressure[held], axis=0),
        np.mean(cycles.torque, axis=0), np.mean(cycles.pressure, axis=0), std,
        float(np.sqrt(np.mean(std**2) / fit.sum())),
    )  # fmt: skip


def rig_rows(
    config: RecordingConfig, law: CamLaw, torque: SensorCalibration, pressure: SensorCalibration
) -> dict[str, ParameterRow]:
    """Return every parameter row with the starts, bounds and priors that sheets and certificates give."""
    rows = dict(ROWS)
    trigger, pump = config.trigger, config.pump
    tolerance = max(trigger.installation_tolerance, 1e-4)
    _set(rows, "trigger_offset", prior=(0.0, tolerance / np.sqrt(3.0)), lower=-2.5 * tolerance, upper=2.5 * tolerance)
    _set(rows, "gain_error", prior=(0.0, max(torque.gain_relative_std, 1e-5)))
    _set(rows, "torque_zero", prior=(0.0, max(torque.zero_std, 1e-4)))
    _set(rows, "pressure_zero", prior=(0.0, max(pressure.zero_std, 1e3)))
    _set(rows, "delay_error", prior=(0.0, max(torque.delay_std, 1e-7)))
    inertia = max(pump.cam_inertia, 1e-6)
    _set(rows, "cam_side_inertia", lower=inertia, start=1.5 * inertia, upper=100.0 * inertia, step=0.2 * inertia)
    if np.isfinite(torque.cutoff_hz):
        cutoff = torque.cutoff_hz
        _set(rows, "cutoff", start=cutoff, lower=0.5 * cutoff, upper=2.0 * cutoff, step=0.05 * cutoff,
             prior=(cutoff, 0.05 * cutoff))  # fmt: skip
    top = float(np.max(law.evaluate(np.linspace(0.0, 2.0 * np.pi, 721), 0)))
    closing = float(law.evaluate(np.array([trigger.nominal_angle]), 0)[0])
    closing = float(np.clip(closing, 0.02 * top, 0.9 * top))
    _set(rows, "port_closing_lift", start=closing, lower=min(0.01 * top, 0.5 * closing), upper=0.98 * top)
    swept = pump.plunger_area * top
    _set(rows, "dead_volume", start=4.0 * swept, lower=0.05 * swept, upper=60.0 * swept, step=0.3 * swept)
    _set(rows, "spill_lift", start=0.8 * top, lower=0.5 * closing, upper=1.2 * top)
    return rows


def _set(rows: dict[str, ParameterRow], name: str, **changes: object) -> None:
    rows[name] = replace(rows[name], **changes)  # type: ignore[arg-type]


def bin_weights(torque: Array, scatter: float, discrepancy: float, correlation: float) -> Array:
    """Return the weight of each bin: scatter of the mean, model error in proportion to the torque, correlation.

    Parameters
    ----------
    torque : (m,) mean measured torque in bins [N m]
    scatter : standard error of the mean of one bin [N m]
    discrepancy : model error per torque
    correlation : bins that carry the information of one independent value
    """
    peak = float(np.max(np.abs(torque)))
    variance = scatter**2 + (SMALLEST_SHARE * peak) ** 2 + (discrepancy * np.abs(torque)) ** 2
    return 1.0 / np.sqrt(variance * max(correlation, 1.0))


def chain_input(recording: Recording, cycles: CamCycles, law: CamLaw, torque: Array, pressure: Array) -> ChainInput:
    """Return the chain's input for one pair of mean cycles (n_theta,) [N m, Pa]."""
    config: RecordingConfig = recording.config
    table: CamTable = recording.cam_table
    step = float(np.median(np.diff(table.theta)))
    basis = lift_correction(cycles.theta, law.evaluate(cycles.theta, 0), table.resolution, law.lift_std, step)
    return ChainInput(
        theta=cycles.theta, speed=cycles.mean_speed, line_pressure=pressure, shaft_torque=torque,
        trigger_angle=config.trigger.nominal_angle, pump=config.pump, law=law,
        offset=config.pump.follower_offset * config.rotation, roller_inertia=assumed_roller(config.pump).inertia,
        lift_basis=basis,
    )  # fmt: skip


def fit_data(recording: Recording, cycles: CamCycles, law: CamLaw, means: Halves) -> FitData:
    """Return one recording ready to be fitted; the type of the end of delivery is still ``closed``."""
    torque_channels, pressure_channels = recording.of("torque"), recording.of("pressure")
    torque_sheet, pressure_sheet = torque_channels[0].calibration, pressure_channels[0].calibration
    assert torque_sheet is not None
    assert pressure_sheet is not None
    rows = rig_rows(recording.config, law, torque_sheet, pressure_sheet)
    chain = chain_input(recording, cycles, law, means.torque, means.pressure)
    binned_torque = binned(means.torque)
    weight = bin_weights(binned_torque, means.scatter_of_mean, DISCREPANCY, CORRELATION)
    return FitData(recording.config.id, chain, binned_torque, means.torque, weight, "closed", rows)


def held_out_data(data: FitData, means: Halves) -> FitData:
    """Return the same recording with its held-out cycles instead of the fitted ones."""
    chain = replace(data.chain, line_pressure=means.held_pressure, shaft_torque=means.held_torque)
    return replace(data, chain=chain, torque=binned(means.held_torque), mean_torque=means.held_torque)


def with_rows(data: FitData, changes: Mapping[str, Mapping[str, float]]) -> FitData:
    """Return the recording with some fields of some rows replaced."""
    rows = dict(data.rows)
    for name, fields in changes.items():
        rows[name] = replace(rows[name], **fields)  # type: ignore[arg-type]
    return replace(data, rows=rows)


def swapped(data: FitData, torque: Array, pressure: Array) -> ChainInput:
    """Return the chain's input with the mean cycles of another half; what the low-pass hides stays."""
    chain = data.chain
    hidden = chain.shaft_torque - data.mean_torque
    return ChainInput(
        chain.theta, chain.speed, pressure, torque + hidden, chain.trigger_angle, chain.pump, chain.law, chain.offset,
        chain.roller_inertia, chain.lift_basis, chain.uses_chamber,
    )  # fmt: skip

"""Two recordings made from the model itself, so that what differs between them is known exactly."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from camtorque.fit.gains import GAIN_ROWS, GAINS
from camtorque.fit.pair import TwoRecordings
from camtorque.fit.prepare import on_grid
from camtorque.fit.problem import FitData
from camtorque.laws import ROWS
from camtorque.laws.chain import BINS, COLUMN_NAMES, NONLINEAR_NAMES, evaluate
from camtorque.laws.lift import lift_correction
from camtorque.records import Array, CamCycles, ClockFit, Estimate
from camtorque.units import DEGREE, angle_grid

sys.path.append(str(Path(__file__).resolve().parents[1] / "laws"))

from laws_cases import chain_input, start_values

NAMES = (
    "torque_zero", "trigger_offset", "delay_error", "leakage", "bulk_modulus", "spring_preload_error",
    "spring_stiffness_error", *GAINS,
)  # fmt: skip
NOISE, CYCLES = 0.02, 12


def made_pair(
    changed: dict[str, float], left: Array | None = None, clock: str = "reference", late: float = 0.0,
    tooth: float = 0.0, gains: tuple[float, float] = (0.0, 0.0),
) -> TwoRecordings:  # fmt: skip
    """Return two recordings of one pump.

    Parameters
    ----------
    changed : parameter -> difference of the second recording [SI]
    left : (BINS,) what no law explains, over the true cam angle [N m]
    clock : how torque and trigger are tied
    late : error of the start of the second torque file [s]
    tooth : how far behind that of the first the tooth of the second recording is [rad]
    gains : by how much of itself the second recording has torque and pressure too large
    """
    rng = np.random.default_rng(11)
    first = chain_input(n=BINS)
    theta = angle_grid(BINS)
    basis = lift_correction(theta, first.law.evaluate(theta, 0), 1e-6, 1e-6, DEGREE)
    values = {**start_values(), **dict.fromkeys(COLUMN_NAMES, 0.0), "leakage": 6e-15, **dict.fromkeys(GAINS, 0.0)}
    left = np.zeros(BINS) if left is None else left
    items, cycles = [], []
    for side in (0, 1):
        mine = {name: value + side * changed.get(name, 0.0) for name, value in values.items()}
        mine["delay_error"] += side * late
        chain = replace(first, trigger_angle=first.trigger_angle + side * tooth)
        linear = np.array([mine[name] for name in COLUMN_NAMES])
        nonlinear = {name: mine[name] for name in NONLINEAR_NAMES}
        output = evaluate(chain, nonlinear)
        beside = float(np.mean(output.motion.theta - evaluate(first, nonlinear).motion.theta))
        turn = beside + side * (changed.get("trigger_offset", 0.0) - late * chain.speed)
        orders = np.arange(BINS // 2 + 1)
        seen = np.fft.irfft(np.exp(1j * orders * turn) * np.fft.rfft(left), BINS)
        sensors = [1.0 + side * gain for gain in gains]
        torque = sensors[0] * (output.torque + output.linear @ linear + seen)
        noisy = torque + NOISE * rng.standard_normal((CYCLES, BINS))
        weight = np.full(BINS, 1.0 / (0.05 + np.max(np.abs(left))))
        chain = replace(
            chain, shaft_torque=sensors[0] * chain.shaft_torque, line_pressure=sensors[1] * chain.line_pressure
        )
        items.append(FitData("pump", chain, np.mean(noisy, axis=0), weight, "land", {**ROWS, **GAIN_ROWS}, basis))
        cycles.append(made_cycles(noisy, chain.line_pressure, chain.speed, clock))
    mean = np.diag(1.0 / items[0].weight ** 2)
    apart = np.eye(BINS) * 2.0 * NOISE**2 / CYCLES
    return TwoRecordings(
        tuple(items), tuple(cycles), NAMES, values, *map(np.linalg.cholesky, (mean, apart)), float(BINS)
    )


def made_cycles(torque: Array, pressure: Array, speed: float, clock: str) -> CamCycles:
    """Return cycles of known torque, (n, BINS) [N m]."""
    n = torque.shape[0]
    fine = np.array([on_grid(row, 1800) for row in torque])
    return CamCycles(
        theta=angle_grid(1800), torque=fine, pressure=np.tile(on_grid(pressure, 1800), (n, 1)), speed=np.full(n, speed),
        index=np.arange(n), held_out=np.arange(n) % 2 == 1, cycles_found=n, duration=n * 2 * np.pi / speed,
        speed_ripple_percent=0.0, cut_flow=(), clocks=(ClockFit("L", 0.0, 0.0, 0.0, clock),), angle_errors=(),
        trigger_jitter_s=1e-7, findings=(), torque_delay=Estimate(0.0, 0.0, "s", "sheet"),
    )  # fmt: skip

"""Small problems whose truth is known because the chain itself made them: for interfaces, not for physics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from camtorque.config import PumpData
from camtorque.fit.prepare import CORRELATION
from camtorque.fit.problem import IDENTITY, FitData
from camtorque.laws import ROWS
from camtorque.laws.chain import LINEAR_NAMES, NONLINEAR_NAMES, ChainInput, evaluate_chain
from camtorque.laws.lift import lift_correction
from camtorque.units import BAR, DEGREE

N = 3600
THETA = np.arange(N) * 2.0 * np.pi / N
NOISE = 0.05
"""Standard deviation of an independent bin [N m]."""
TRUE_LINEAR = {"bearing_arm": 2.0e-4, "shaft_drag": 0.12, "shaft_viscous": 5.0e-3, "plunger_viscous": 25.0}
TRUE_NONLINEAR = {"trigger_offset": 0.25 * DEGREE, "guide_friction": 0.07}
TRUE_ZERO = 0.04


class CosineLaw:
    """Lift 8 mm cos((theta - 1.4)/2)^8 as its Fourier sum, every derivative exact."""

    amplitudes = 8.0e-3 * np.array([35.0, 56.0, 28.0, 8.0, 1.0]) / 128.0

    def derivatives(self, theta, highest=3):
        return np.array([self.evaluate(theta, k) for k in range(highest + 1)])

    def evaluate(self, theta, derivative=0):
        k = np.arange(5.0)
        phase = np.multiply.outer(np.asarray(theta, dtype=float) - 1.4, k) + derivative * np.pi / 2.0
        # 0**0 is 1: the constant counts in the lift and in no derivative
        return np.cos(phase) @ (self.amplitudes * k**derivative)


def pump() -> PumpData:
    return PumpData(
        0.02, 0.008, 0.005, 0.002, 0.25, 5e-5, 0.075, 2e4, 110.0, 0.008, 2.1e11, 2.1e11, Path("x"), "a", "b"
    )


def chain(speed: float = 60.0, scale: float = 1.0) -> ChainInput:
    line = (3.0 + scale * 500.0 * np.exp(-(((THETA - 0.7) / 0.2) ** 2))) * BAR
    torque = scale * (40.0 * np.exp(-(((THETA - 0.7) / 0.25) ** 2)) - 20.0 * np.exp(-(((THETA - 1.9) / 0.25) ** 2)))
    law = CosineLaw()
    basis = lift_correction(THETA, law.evaluate(THETA), 1e-6, 1e-6, DEGREE)
    return ChainInput(
        theta=THETA, speed=speed, line_pressure=line, shaft_torque=torque, trigger_angle=20 * DEGREE, pump=pump(),
        law=law, offset=0.002, roller_inertia=3e-7, lift_basis=basis, uses_chamber=False,
    )  # fmt: skip


def fit_data(name: str = "A", seed: int = 0, speed: float = 60.0, noise: float = NOISE) -> FitData:
    """Return a run without chamber: trigger angle, guide, bearing, drag, viscous terms and zero are at work."""
    data = chain(speed)
    values = {**IDENTITY, **{n: IDENTITY[n] for n in NONLINEAR_NAMES}, **TRUE_NONLINEAR}
    output = evaluate_chain(data, values)
    coefficients = np.zeros(output.linear.shape[1])
    for key, value in TRUE_LINEAR.items():
        coefficients[LINEAR_NAMES.index(key)] = value
    torque = output.torque + output.linear @ coefficients + TRUE_ZERO
    m = torque.size
    torque = torque + noise * np.random.default_rng(seed).standard_normal(m)
    weight = np.full(m, 1.0 / (NOISE * np.sqrt(CORRELATION)))
    return FitData(
        name=name, chain=data, torque=torque, mean_torque=np.repeat(torque, N // m), weight=weight, delivery="closed",
        rows=dict(ROWS),
    )  # fmt: skip

"""A pump with a smooth lift and a usual cycle: what the tests of the laws evaluate."""

from __future__ import annotations

import numpy as np
from camtorque.laws import ROWS
from camtorque.laws.chain import COLUMN_NAMES, NONLINEAR_NAMES, ChainInput, evaluate, with_substeps
from camtorque.laws.chamber import NEVER
from camtorque.studies.case import study_pump
from camtorque.units import BAR, DEGREE, angle_grid

N = 1800
THETA = angle_grid(N)
COEFFICIENTS = np.array([
    1e-4, 1e-5, 0.1, 5e-3, 20.0, 0.01, 0.02, 12.0, 0.01, 3e-7, 3e-5, -4e-5, 0.05, -0.07, 0.3, 0.2, -0.1,
])  # fmt: skip
"""One value per column of the chain, in the order of `COLUMN_NAMES` [SI]."""
assert COEFFICIENTS.size == len(COLUMN_NAMES)


class HarmonicLaw:
    """A lift of 8 mm, 8 mm cos^8((theta - a)/2) as a Fourier sum: every derivative is exact."""

    amplitudes = np.array([35.0, 56.0, 28.0, 8.0, 1.0]) / 128.0
    top = 1.4

    def derivatives(self, theta, highest=3):
        return np.array([self.evaluate(theta, k) for k in range(highest + 1)])

    compiled_derivatives = derivatives

    def is_round(self, slope):
        return np.zeros(slope.shape, dtype=bool)

    def evaluate(self, theta, derivative=0):
        total = np.zeros_like(np.asarray(theta, float))
        for k, amplitude in enumerate(self.amplitudes):
            if k or derivative == 0:
                phase = k * (np.asarray(theta) - self.top) + derivative * np.pi / 2.0
                total = total + amplitude * float(k) ** derivative * np.cos(phase)
        return 8.0e-3 * total


def chain_input(**changes) -> ChainInput:
    """Return a cycle: the line is pumped up to 560 bar around 40 degrees."""
    n = changes.pop("n", N)
    theta = angle_grid(n)
    line = (60.0 + 500.0 * np.exp(-(((theta - 0.75) / 0.2) ** 2))) * BAR
    torque = 5.0 + 40.0 * np.exp(-(((theta - 0.7) / 0.25) ** 2)) - 20.0 * np.exp(-(((theta - 1.9) / 0.25) ** 2))
    arguments = {
        "theta": theta, "speed": 60.0, "line_pressure": line, "shaft_torque": torque, "trigger_angle": 20 * DEGREE,
        "pump": study_pump(), "law": HarmonicLaw(), "offset": 0.002,
    }  # fmt: skip
    return ChainInput(**{**arguments, **changes})


def start_values(end: str = "land") -> dict[str, float]:
    """Return values at which every law acts; delivery ends by a ``land``, by ``spill``, or is not ``open``-ended."""
    values = {name: ROWS[name].start for name in NONLINEAR_NAMES}
    values.update(
        dead_volume=1.0e-6, port_closing_lift=1.0e-3, end_of_delivery=47.3 * DEGREE, spill_lift=5.5e-3,
        drive_admittance=2.0, coupling_compliance=9e-5, trigger_offset=0.3 * DEGREE, end_width=1.33 * DEGREE,
        pressure_zero=0.4e5, gain_error=0.003, delay_error=4e-6, free_air=2e-3, valve_range=10e5,
        half_inertia=0.05e-3, valve_stroke=2.3e-9, outlet_return=0.9,
    )  # fmt: skip
    if end != "land":
        values["end_of_delivery"] = NEVER
    if end != "spill":
        values["spill_lift"] = NEVER
    return values


def refined(data: ChainInput, values: dict[str, float]) -> ChainInput:
    """Return the cycle with the fine time steps that the fit uses."""
    return chain_input(n=data.theta.size, bins=data.bins, substeps=with_substeps(data, evaluate(data, values), values))


def total_torque(data: ChainInput, values: dict[str, float]) -> np.ndarray:
    output = evaluate(data, values, COEFFICIENTS)
    return output.torque + output.linear @ COEFFICIENTS

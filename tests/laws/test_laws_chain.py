"""The chain's exact derivatives against central differences, and its identities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from camtorque.config import PumpData
from camtorque.laws import ROWS, chain
from camtorque.laws.chain import (
    LINEAR_NAMES,
    NONLINEAR_NAMES,
    ChainInput,
    chain_derivative,
    contact_load,
    evaluate_chain,
)
from camtorque.laws.lift import lift_correction
from camtorque.records import Refusal
from camtorque.units import BAR, DEGREE

N = 3600
THETA = np.arange(N) * 2.0 * np.pi / N


class HarmonicLaw:
    """A smooth lift with exact derivatives: 8 mm, raised to the fourth power for a long base circle."""

    def derivatives(self, theta, highest=3):
        return np.array([self.evaluate(theta, k) for k in range(highest + 1)])

    def evaluate(self, theta, derivative=0):
        # 8 mm * cos((theta - a)/2)^8 as a Fourier sum
        c = np.array([35.0, 56.0, 28.0, 8.0, 1.0]) / 128.0
        a = 1.4
        total = np.zeros_like(np.asarray(theta, float))
        for k, amplitude in enumerate(c):
            phase = k * (np.asarray(theta) - a) + derivative * np.pi / 2.0
            total = total + amplitude * float(k) ** derivative * np.cos(phase) if k or derivative == 0 else total
        return 8.0e-3 * total


def pump() -> PumpData:
    return PumpData(
        0.02, 0.008, 0.005, 0.002, 0.25, 5e-5, 0.075, 2e4, 110.0, 0.008, 2.1e11, 2.1e11, Path("x"), "a", "b"
    )


def chain_input(**changes) -> ChainInput:
    line = (60.0 + 500.0 * np.exp(-(((THETA - 0.7) / 0.2) ** 2))) * BAR
    torque = 5.0 + 40.0 * np.exp(-(((THETA - 0.7) / 0.25) ** 2)) - 20.0 * np.exp(-(((THETA - 1.9) / 0.25) ** 2))
    law = HarmonicLaw()
    basis = lift_correction(THETA, law.evaluate(THETA), 1e-6, 1e-6, DEGREE)
    arguments = {
        "theta": THETA, "speed": 60.0, "line_pressure": line, "shaft_torque": torque, "trigger_angle": 20 * DEGREE,
        "pump": pump(), "law": law, "offset": 0.002, "roller_inertia": 3e-7, "lift_basis": basis,
    }  # fmt: skip
    return ChainInput(**{**arguments, **changes})


def start_values() -> dict[str, float]:
    values = {name: ROWS[name].start for name in NONLINEAR_NAMES}
    values.update(
        dead_volume=1.5e-6, port_closing_lift=1.0e-3, end_of_delivery=47.3 * DEGREE, spill_lift=7.45e-3,
        drive_admittance=2.0, coupling_compliance=9e-5, trigger_offset=0.3 * DEGREE, end_width=1.33 * DEGREE,
    )  # fmt: skip
    return values


@pytest.mark.parametrize("name", NONLINEAR_NAMES)
def test_derivative_is_that_of_the_chain(name):
    # Central differences with h of 2e-3 steps: truncation about 1e-5, and kinks where an edge crosses a grid point.
    data, values = chain_input(), start_values()
    rng = np.random.default_rng(1)
    coefficients = np.r_[1e-4, 1e-5, 0.1, 5e-3, 20.0, 0.01, 0.02, rng.normal(0.0, 3e-7, data.lift_basis.n_basis)]
    output = evaluate_chain(data, values)
    exact = chain_derivative(data, values, output, coefficients, (name,))[:, 0]
    h = 2e-3 * ROWS[name].step
    sides = []
    for sign in (1.0, -1.0):
        side = evaluate_chain(data, {**values, name: values[name] + sign * h})
        sides.append(side.torque + side.linear @ coefficients)
    numeric = (sides[0] - sides[1]) / (2.0 * h)
    scale = np.max(np.abs(exact))
    assert scale > 0.0
    assert np.max(np.abs(exact - numeric)) < 1e-3 * scale


def test_linear_names_are_the_linear_rows():
    named = {name for name, row in ROWS.items() if row.is_linear}
    assert named == set(LINEAR_NAMES) | {"torque_zero"}
    assert set(ROWS) == set(LINEAR_NAMES) | set(NONLINEAR_NAMES) | {"torque_zero"}


def test_closed_chamber_keeps_its_mass():
    # Without port, valve, spill and leak the implicit rule is exact: rho V is constant whatever the step.
    data, values = chain_input(), start_values()
    values.update(port_width=0.0, valve_area=0.0, leakage=0.0, spill_width=0.0, dead_volume=4e-6)
    output = evaluate_chain(data, values)
    volume = values["dead_volume"] + data.pump.plunger_area * (data.top_lift - output.motion.lift[0])
    slope, modulus = values["bulk_modulus_slope"], values["bulk_modulus"]
    mass = volume * (1.0 + slope * output.pressure / modulus) ** (1.0 / slope)
    full = output.pressure > -0.89e5
    assert full.sum() > N // 2
    assert np.ptp(mass[full & (THETA < 1.3)]) < 1e-12 * mass[0]


def test_bins_divide_the_grid():
    assert N % chain.BIN == 0


def test_guide_friction_at_which_the_follower_jams_is_refused() -> None:
    data = chain_input()
    lift = tuple(data.law.derivatives(THETA, 2))
    tangent = (lift[1] - data.offset) / (np.sqrt(0.028**2 - data.offset**2) + lift[0])
    least = 1.0 / float(np.max(tangent))
    rates = (60.0 + 0.0 * THETA, 0.0 * THETA)
    # the factor is smoothed around standstill: two percent on either side of the closed form are clear of it
    assert np.all(contact_load(data, lift, rates, data.line_pressure, 0.98 * least) > 0.0)
    with pytest.raises(Refusal, match=r"the follower jams in its guide at .* expected less than 1"):
        contact_load(data, lift, rates, data.line_pressure, 1.02 * least)

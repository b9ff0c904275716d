"""A pump that strokes several times a revolution: every stroke begins and ends as the first one does."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.laws.chain import NONLINEAR_NAMES, ChainInput, evaluate
from camtorque.mechanism.cam import lobe_count
from camtorque.units import DEGREE, angle_grid
from laws_cases import HarmonicLaw, N, chain_input, start_values

LOBES = 3
THETA = angle_grid(LOBES * N)
STILL = {"coupling_compliance": 0.0, "drive_admittance": 0.0, "shaft_compliance": 0.0}
"""Nothing between cam and logger yields: the cam is where the trigger says."""
ENDS = ("end_of_delivery", "end_width", "trigger_offset")


class Lobed(HarmonicLaw):
    """The lift of `HarmonicLaw` once a lobe; ``worn`` shares of it are gone from the second one on [-]."""

    def __init__(self, lobes: int, worn: float = 0.0) -> None:
        self.lobes, self.worn = lobes, worn

    def evaluate(self, theta, derivative=0):
        lift = super().evaluate(self.lobes * np.asarray(theta), derivative) * float(self.lobes) ** derivative
        return lift * np.where(np.asarray(theta) % (2.0 * np.pi) < 2.0 * np.pi / self.lobes, 1.0, 1.0 - self.worn)


def lobed(worn: float = 0.0) -> ChainInput:
    """Return the cycle of `chain_input` three times a revolution, at a third of the speed."""
    one = chain_input()
    parts = {name: np.tile(getattr(one, name), LOBES) for name in ("line_pressure", "shaft_torque")}
    law = Lobed(LOBES, worn)
    return chain_input(n=LOBES * N, speed=one.speed / LOBES, law=law, trigger_angle=one.trigger_angle / LOBES, **parts)


def lobed_values() -> dict[str, float]:
    values = {**start_values("land"), **STILL}
    return {name: value / LOBES if name in ENDS else value for name, value in values.items()}


def test_a_land_ends_every_stroke():
    strokes = evaluate(lobed(), lobed_values()).pressure.reshape(LOBES, N)
    one = evaluate(chain_input(), {**start_values("land"), **STILL}).pressure
    np.testing.assert_allclose(strokes[0], one, rtol=1e-6)
    # the second begins with what the first has left behind the delivery valve
    np.testing.assert_allclose(strokes[1], strokes[2], rtol=1e-6)
    np.testing.assert_allclose(strokes[1], one, atol=0.02 * np.max(one))


@pytest.mark.parametrize("name", ["end_of_delivery", "end_width", "trigger_offset", "outlet_return"])
def test_its_derivatives_are_those_of_all_strokes(name):
    data, values = lobed(), lobed_values()
    step = {"outlet_return": 1e-5}.get(name, 1e-6 * DEGREE)
    ends = [evaluate(data, {**values, name: values[name] + way * step}).pressure for way in (1.0, -1.0)]
    exact = evaluate(data, values, tangents=True).pressure_tangents
    column = exact[:, NONLINEAR_NAMES.index(name)]
    measured = (ends[0] - ends[1]) / (2.0 * step)
    np.testing.assert_allclose(column, measured, atol=2e-3 * np.max(np.abs(measured)))
    assert all(np.any(part) for part in column.reshape(LOBES, N))


@pytest.mark.parametrize("lobes", [1, 2, 3, 4, 5, 6, 8, 12])
def test_lobes_are_counted(lobes):
    assert lobe_count(Lobed(lobes).evaluate(THETA)) == lobes


def test_lobes_that_are_ground_or_worn_differently_count_as_long_as_they_are_alike():
    assert lobe_count(Lobed(LOBES, worn=0.03).evaluate(THETA)) == LOBES
    assert lobe_count(Lobed(LOBES, worn=0.3).evaluate(THETA)) == 1
    assert lobe_count(5e-3 * (1.0 - np.cos(THETA))) == 1


def test_the_top_of_the_first_lobe_counts_where_a_later_one_is_higher():
    data = lobed(worn=-0.01)
    assert (data.lobes, data.top_lift) == (LOBES, pytest.approx(1.01 * np.max(Lobed(LOBES).evaluate(THETA))))
    assert data.top_angle == pytest.approx(HarmonicLaw.top / LOBES, abs=0.2 * DEGREE)

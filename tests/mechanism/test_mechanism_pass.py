"""The compiled pass gives what the tables give."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from camtorque.mechanism.torque import closed_form_tables

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))
from mechanism_cases import CASES, analytic_law, case
from mechanism_pass import cycle_rows, evaluate_cycles

LAW = analytic_law()
OUTPUTS = ("torque", "contact_normal", "contact_tangential", "bearing_x", "bearing_y", "guide", "guide_moment")
"""Rows of the result, in this order; the Hertz pressure follows."""


@pytest.mark.parametrize("name", CASES)
def test_compiled_pass_is_the_closed_form(name):
    pump, mounting, run = case(name)
    tables = closed_form_tables(pump, LAW, run.theta, mounting)
    pressure = run.pressure * np.array([[1.0], [0.3], [0.0]])
    speed = np.array([40.0, 90.0, 400.0])
    result = np.empty((8, *pressure.shape))
    evaluate_cycles(cycle_rows(tables), tables.constants, pressure, speed, result)
    for row, output in enumerate(OUTPUTS):
        expected = tables.evaluate(output, pressure, speed[:, None])
        # rounding, on the scale of the forces that are added up to it
        scale = np.max(np.abs(expected)) + 1e-3 * np.max(np.abs(result[1]))
        assert np.max(np.abs(result[row] - expected)) < 1e-13 * scale, output
    assert np.allclose(result[-1], tables.hertz(pressure, speed[:, None]), rtol=1e-12, atol=1e-3)
    # at 400 rad/s the dry pump loses contact: the stress is 0 there, not nan
    assert np.min(result[1, 2]) < 0.0
    assert np.all(result[-1, 2][result[1, 2] < 0.0] == 0.0)

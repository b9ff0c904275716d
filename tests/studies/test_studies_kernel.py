"""The compiled pass gives what the tables give."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from camtorque.mechanism.friction import Friction
from camtorque.mechanism.torque import closed_form_tables
from camtorque.studies.kernel import CYCLE_OUTPUTS, cycle_tables, evaluate_cycles

sys.path.append(str(Path(__file__).resolve().parents[1] / "mechanism"))
from mechanism_cases import CASES, analytic_law, case

LAW = analytic_law()


@pytest.mark.parametrize("friction", [Friction(), Friction(0.1, 2e-4, 3e-5)])
@pytest.mark.parametrize("name", CASES)
def test_compiled_pass_is_the_closed_form(name, friction):
    pump, mounting, run = case(name)
    tables = closed_form_tables(pump, LAW, run.theta, mounting, friction)
    pressure = run.pressure * np.array([[1.0], [0.3], [0.0]])
    speed = np.array([40.0, 90.0, 400.0])
    result = evaluate_cycles(cycle_tables(tables), pressure, speed)
    for row, output in enumerate(CYCLE_OUTPUTS[:-1]):
        expected = tables.evaluate(output, pressure, speed[:, None])
        # rounding, on the scale of the forces that are added up to it
        scale = np.max(np.abs(expected)) + 1e-3 * np.max(np.abs(result[1]))
        assert np.max(np.abs(result[row] - expected)) < 1e-13 * scale, output
    assert np.allclose(result[-1], tables.hertz(pressure, speed[:, None]), rtol=1e-12, atol=1e-3)
    # at 400 rad/s the dry pump loses contact: the stress is 0 there, not nan
    assert np.min(result[1, 2]) < 0.0
    assert np.all(result[-1, 2][result[1, 2] < 0.0] == 0.0)


def test_preallocated_result_is_written_in_place():
    pump, mounting, run = case("on axis, constant speed")
    compiled = cycle_tables(closed_form_tables(pump, LAW, run.theta, mounting))
    out = np.zeros((8, 1, run.theta.size))
    assert evaluate_cycles(compiled, run.pressure[None], np.array([50.0]), out) is out
    assert np.any(out != 0.0)


def test_wrong_shapes_are_named():
    pump, mounting, run = case("on axis, constant speed")
    compiled = cycle_tables(closed_form_tables(pump, LAW, run.theta, mounting))
    with pytest.raises(ValueError, match="tables have 97 angles"):
        evaluate_cycles(compiled, np.zeros((2, 96)), np.ones(2))
    with pytest.raises(ValueError, match="out has shape"):
        evaluate_cycles(compiled, np.zeros((2, 97)), np.ones(2), np.zeros((8, 1, 97)))

"""A pressure sensor in the plunger's chamber: what it measures is on the plunger, nothing is rebuilt beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from camtorque.fit.one_ending import searched_anew
from camtorque.fit.prepare import fit_data, mean_cycles
from camtorque.fit.problem import STRUCTURES
from camtorque.fit.result import fitted_torque
from camtorque.fit.single import fit_prepared, prepare
from camtorque.mechanism.lift_laws import lift_law, spectral_law
from camtorque.mechanism.solve import solve_rigid
from camtorque.records import Recording
from fit_cases import bridged, rig
from rig_bridge import cycles_of

RUN = ("closed_volume", 0, 1000.0)
PLACE = "pump head, in the plunger chamber"


def sits(recording: Recording, location: str) -> Recording:
    sensor = replace(recording.config.sensors["pressure"], location=location)
    sensors = {**recording.config.sensors, "pressure": sensor}
    return replace(recording, config=replace(recording.config, sensors=sensors))


@pytest.mark.parametrize(("location", "inside"), [
    ("drilling into the plunger chamber", True), ("at the plunger chamber (before the delivery valve)", True),
    ("Chamber", True), ("high-pressure line, pump end", False), ("line, 0.1 m from the chamber", False),
    ("spring chamber of the delivery valve", False), ("delivery valve chamber", False), ("feed chamber", False),
    ("injection chamber of the rate meter", False), ("outlet of the chamber", False), ("pumping chamber", True),
    ("2 m downstream of the chamber", False), ("low-pressure chamber", False), ("high-pressure chamber", True),
    ("pump head", False), ("", False),
])  # fmt: skip
def test_a_location_that_names_the_chamber_is_in_it(location: str, inside: bool):
    recording, cycles, _ = bridged(RUN)
    recording = sits(recording, location)
    assert recording.config.measures_chamber == inside
    data = fit_data(recording, cycles, spectral_law(recording.cam_table), mean_cycles(cycles))
    assert data.structures == (("line",) if inside else tuple(STRUCTURES))
    assert (searched_anew(data).structure == "line") == inside  # by the values of a joint fit, too


def test_a_measured_chamber_gives_the_trigger_and_the_losses_back():
    run = rig(*RUN)
    inside = replace(run, history={**run.history, "line_pressure": run.history["chamber_pressure"]})
    recording, cycles = sits(bridged(RUN)[0], PLACE), cycles_of(inside, 1800)
    law = lift_law(recording.cam_table)
    rigid = solve_rigid(recording.config.pump, law, cycles.theta, cycles.mean_pressure, cycles.mean_speed)
    prepared = prepare(recording, cycles, rigid)
    assert {item.data.structure for item in prepared.candidates} == {"line"}
    fitted = fitted_torque(fit_prepared(prepared), recording, cycles, rigid, mean_cycles(cycles))
    assert fitted.explained
    assert "chamber" not in {row.name for row in fitted.evidence}
    found = {row.name: row for row in fitted.parameters}
    truth = run.truth
    for name, value in {
        "trigger_offset": np.degrees(truth.trigger.angle_offset),
        "bearing_arm": 1e6 * truth.friction.bearing_mu * truth.friction.bearing_radius,
    }.items():
        low, high = found[name].ci95
        assert low <= value <= high
    assert 2.0 * found["trigger_offset"].stderr < 1.0

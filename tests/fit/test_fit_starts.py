"""What the search starts from: no pump of the usual kind is far from one of its starts."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.fit.starts import first_starts
from fit_cases import quick_data

DATA = ("closed_volume", 3)
USUAL_VOLUMES = np.geomspace(0.8, 9.0, 30)
"""Dead volumes in swept volumes."""
FACTOR = 2.0
"""From half and from twice the true dead volume a smoothed search leads down to it."""


@pytest.mark.parametrize("structure", ["land", "spill", "open"])
def test_a_start_is_near_every_usual_dead_volume(structure):
    data = quick_data(DATA)
    swept = data.chain.pump.plunger_area * data.chain.top_lift
    tried = np.unique([item.rows["dead_volume"].start / swept for item in first_starts(data, structure)])
    factor = np.exp(np.abs(np.log(USUAL_VOLUMES[:, None] / tried)))
    assert np.all(np.min(factor, axis=1) <= FACTOR)


@pytest.mark.parametrize("structure", ["land", "spill"])
def test_a_start_is_near_every_end_of_delivery(structure):
    data = quick_data(DATA)
    starts = [item.rows for item in first_starts(data, structure)]
    if structure == "land":
        tried = data.chain.law.evaluate(np.array([rows["end_of_delivery"].start for rows in starts]), 0)
    else:
        tried = np.array([rows["spill_lift"].start for rows in starts])
    ends = np.linspace(0.41, 0.95, 20)
    assert np.max(np.min(np.abs(ends[:, None] - tried / data.chain.top_lift), axis=1)) < 0.1


def test_a_recording_without_a_chamber_has_one_start():
    (item,) = first_starts(quick_data(DATA), "line")
    assert not item.chain.uses_chamber

"""A wrong point of a lift table is found; rounding, noise, flanks of all kinds and coarse steps are not."""

import numpy as np
import pytest
from camtorque.ingest.cam_table import outlying_points
from camtorque.records import CamTable
from mechanism_cases import analytic_law

KINDS = ("polynomial_4567", "polynomial_345", "cycloidal", "modified_sine", "simple_harmonic")


def table(kind="polynomial_4567", step=1.0, resolution=1e-6, noise=0.0, spikes=()):
    theta = np.radians(np.arange(0.0, 360.0, step))
    lift = analytic_law(kind).evaluate(theta) + noise * np.random.default_rng(1).standard_normal(theta.size)
    for place, size in spikes:
        lift[place] += size
    return CamTable(theta, np.round(lift / resolution) * resolution, resolution)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("step", [0.25, 0.5, 1.0, 2.0, 5.0])
@pytest.mark.parametrize("noise", [0.0, 3e-6])
def test_sound_tables_have_none(kind, step, noise):
    assert outlying_points(table(kind, step, noise=noise)).size == 0


@pytest.mark.parametrize("place", [0, 37, 200, 359])
@pytest.mark.parametrize("size", [5e-5, -2e-5])
def test_wrong_point_is_found(place, size):
    assert outlying_points(table(spikes=[(place, size)])).tolist() == [place]


def test_uneven_steps_are_left_alone():
    given = table(spikes=[(37, 5e-5)])
    theta = given.theta + 1e-3 * np.sin(given.theta)
    assert outlying_points(CamTable(theta, given.lift, 1e-6)).size == 0

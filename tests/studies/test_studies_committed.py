"""What the committed studies say: defaults near the front, no default fails in silence, the grid table is theirs."""

from pathlib import Path

import pytest
from camtorque.grid_choice import GRID_ERRORS, choose_grid, grid_note
from camtorque.records import Refusal
from camtorque.studies.study import CHARTS, MAPS
from study_cases import FRONT_FACTOR, front_factor, read_charts, read_maps, silent_defaults

FOLDER = Path(__file__).resolve().parents[2] / "reports" / "studies"
CHART_LIST = read_charts(FOLDER / "speed_accuracy.json")
MAP_LIST = read_maps(FOLDER / "stability.json")


@pytest.mark.parametrize("chart", CHART_LIST, ids=lambda chart: chart.name)
def test_defaults_lie_within_the_factor_of_the_front(chart):
    defaults = [point for point in chart.points if point.default]
    assert defaults
    assert [point.family for point in defaults if front_factor(chart, point) > FRONT_FACTOR] == []


def test_no_default_fails_silently():
    assert [(item.condition, item.method) for part in MAP_LIST for item in silent_defaults(part.cells)] == []


def test_every_map_has_been_written_and_judges_a_default():
    assert [part.name for part in MAP_LIST] == list(MAPS)
    assert all(any(item.default for item in part.cells) for part in MAP_LIST)


def test_every_part_of_the_study_has_its_charts():
    names = " ".join(chart.name for chart in CHART_LIST)
    for part in ("grid", "lift_table", "dynamics", "driveline", "resampling"):
        assert part in names
    assert len(CHARTS) == 4


def test_every_picture_is_there():
    for part in (*CHART_LIST, *MAP_LIST):
        assert (FOLDER / f"{part.name}.png").exists()
        assert (FOLDER / f"{part.name}.svg").exists()


def test_grid_table_is_that_of_the_study():
    chart = next(c for c in CHART_LIST if c.name == "grid")
    studied = {(round(360.0 / float(p.setting.split()[0])), p.family): p.error for p in chart.points}
    for key, error in GRID_ERRORS.items():
        assert studied[key] <= error < 1.1 * studied[key]


@pytest.mark.parametrize(("tolerance", "points"), [(1e-2, 180), (1e-4, 360), (1e-6, 1800), (1e-8, 3600)])
def test_choice_is_the_coarsest_grid_that_serves(tolerance, points):
    n_theta, method, implied = choose_grid(tolerance)
    assert n_theta == points
    assert implied <= tolerance
    assert GRID_ERRORS[n_theta, method] == implied


@pytest.mark.parametrize(
    ("tolerance", "text"), [(0.0, "expected a positive"), (float("nan"), "positive"), (1e-15, "finer than")]
)
def test_impossible_tolerances_are_refused(tolerance, text):
    with pytest.raises(Refusal, match=text):
        choose_grid(tolerance)


def test_note_on_the_grid_says_what_it_implies():
    n_theta, note = grid_note(1e-3)
    assert (n_theta, note.severity) == (360, "info")
    assert "360 points per revolution leave at most 2.1e-05 of the rigid torque" in note.text
    assert "the fitted model keeps a grid of its own" in note.text
    raised, note = grid_note(1e-2, least=360)
    assert raised == 360
    assert "180 points per revolution, raised to the 360 that the fit needs" in note.text

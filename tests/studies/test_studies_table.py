"""The Pareto front, the factor to it, and what may stand in a table."""

from dataclasses import asdict

import numpy as np
import pytest
from camtorque.report.files import write_json
from camtorque.report.plots import _front, study_figure
from camtorque.studies.table import Cell, Chart, Point, document
from study_cases import front_factor, read_charts


def points():
    return (
        Point("a", "1", 1e-2, 1.0),
        Point("a", "2", 1e-4, 4.0),
        Point("b", "1", 1e-3, 6.0, default=True),
        Point("c", "1", 1e-9, 0.1, candidate=False),
    )


def test_front_leaves_out_the_beaten_and_the_foreign():
    assert [(p["family"], p["setting"]) for p in _front([asdict(p) for p in points()])] == [("a", "1"), ("a", "2")]


def test_factor_compares_with_the_cheapest_as_accurate():
    chart = Chart("x", "x", "e", "c", points())
    assert front_factor(chart, chart.points[2]) == pytest.approx(1.5)
    assert front_factor(chart, chart.points[1]) == 1.0


def test_factor_at_given_cost_compares_errors():
    same = (Point("a", "1", 2e-3, 360.0), Point("b", "1", 1e-3, 360.0), Point("b", "2", 1e-5, 720.0))
    assert front_factor(Chart("x", "x", "e", "c", same, given_cost=True), same[0]) == pytest.approx(2.0)


def test_written_chart_comes_back(tmp_path):
    chart = Chart("x", "x", "e", "c", (Point("a", "1", np.inf, 1.0), Point("a", "2", 0.125, 2.0)))
    write_json(tmp_path / "study.json", document("speed-accuracy", [chart], quick=True))
    assert read_charts(tmp_path / "study.json") == (chart,)


def test_point_without_measurement_is_refused():
    with pytest.raises(ValueError, match="no measurement"):
        Point("a", "1", float("nan"), 1.0)


def test_loud_cell_needs_its_text():
    with pytest.raises(ValueError, match="what is read"):
        Cell("condition", "method", "fails loudly", "")


@pytest.mark.parametrize("given_cost", [True, False])
def test_lines_of_one_method_share_a_colour_and_those_of_one_variant_a_marker(given_cost):
    families = ("spline, 1 um", "spline, 2 um", "harmonics, 1 um")
    lines = tuple(Point(family, str(n), 10.0**-n, 360.0 * n) for family in families for n in (1, 2))
    drawn = study_figure(asdict(Chart("x", "x", "e", "c", lines, given_cost=given_cost))).axes[0].get_lines()
    first, second, other = (next(line for line in drawn if line.get_label() == family) for family in families)
    if given_cost:
        assert first.get_color() == second.get_color() != other.get_color()
        assert first.get_marker() == other.get_marker() != second.get_marker()
    else:
        assert len({line.get_color() for line in (first, second, other)}) == 3
        assert len({line.get_marker() for line in (first, second, other)}) == 1

"""Charts as SVG and as data of the script: what is drawn is what was given, escaped and compact."""

from __future__ import annotations

import base64
import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from camtorque.jsonable import clean
from camtorque.records import LossEvidence, ResidualBump
from camtorque.report.chart import Band, Curves, Line, Marks, Panel, RowPanel, Rows, Span, bump_spans, phases, strokes
from camtorque.report.charts_svg import curves_svg, rows_svg
from camtorque.report.fit_figures import EVIDENCE_SHOWN, evidence
from camtorque.report.numbers import (
    exponents,
    named,
    plus_minus,
    rounded_to_error,
    significant,
    typeset,
    unit_text,
    with_decimals,
    with_sign,
)
from camtorque.report.payload import MISSING, chart_data, packed
from camtorque.report.svg import Scale, dots, path_data, simplified, text_width, tick_text, ticks
from camtorque.report.write import FIGURES
from report_cases import NASTY, run_result


def path_points(text: str) -> np.ndarray:
    """Return the points of relative path data in tenths of a pixel."""
    steps = [tuple(map(int, pair.split())) for pair in re.split("[Ml]", text)[1:]]
    return np.cumsum(np.array(steps), axis=0)


def test_a_simplified_curve_stays_within_a_third_of_a_pixel() -> None:
    x = np.linspace(0.0, 900.0, 2000)
    y = 100.0 * np.sin(x / 40.0) + 20.0 * np.exp(-(((x - 300.0) / 2.0) ** 2))
    few_x, few_y = simplified(x, y)
    assert few_x.size < 500
    assert np.max(np.abs(np.interp(x, few_x, few_y) - y)) <= 0.3 + 1e-9


def test_a_dense_curve_keeps_its_spikes() -> None:
    x, y = np.linspace(0.0, 100.0, 20_000), np.zeros(20_000)
    y[12_345] = 50.0
    few_x, few_y = simplified(x, y)
    assert few_y.max() == 50.0
    assert few_x.size < 20


def test_path_data_are_the_points_in_tenths() -> None:
    x, y = np.array([0.0, 1.04, 1.04, 3.3]), np.array([5.0, 5.5, 5.5, -2.0])
    np.testing.assert_array_equal(path_points(path_data(x, y)), [[0, 50], [10, 55], [33, -20]])


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(0.0, 10.0, ["0", "2", "4", "6", "8", "10"]), (-0.03, 0.021, ["−0.03", "−0.02", "−0.01", "0.00", "0.01", "0.02"])],
)
def test_ticks_are_round_and_have_the_digits_they_need(low: float, high: float, expected: list[str]) -> None:
    found = ticks(low, high)
    assert [tick_text(value, found[1] - found[0]) for value in found] == expected


def test_dots_are_the_points_in_tenths() -> None:
    x, y = np.array([10.04, 300.0, 12.5]), np.array([5.0, 0.0, 99.96])
    steps = re.findall(r"m(-?\d+) (-?\d+)h0", dots(x, y, "fitted", 5.0))
    places = np.cumsum(np.array(steps, dtype=int), axis=0)
    np.testing.assert_array_equal(places, [[100, 50], [3000, 0], [125, 1000]])


def test_places_on_a_logarithmic_scale() -> None:
    scale = Scale(0.1, 100.0, 0.0, 300.0, log=True)
    np.testing.assert_allclose(scale.places(np.array([0.1, 1.0, 100.0])), [0.0, 100.0, 300.0], atol=1e-9)


def curves(label: str = "measured") -> Curves:
    x = np.arange(0.0, 360.0, 0.5)
    y = np.cos(np.deg2rad(x))
    y[100:120] = np.nan
    panel = Panel("torque [N m]", (Line(label, y, "measured"),), (Band("band", y - 0.1, y + 0.1),))
    return Curves(x, "cam angle [deg]", (panel,), spans=(Span(10.0, 60.0, label), Span(80.0, 90.0, label, loud=True)))


def test_a_stretch_outside_what_is_shown_hides_no_other() -> None:
    spans = (Span(0.0, 50.0, "before"), Span(120.0, 180.0, "within", loud=True), Span(300.0, 310.0, "after"))
    drawn = curves_svg(replace(curves(), x_range=(100.0, 200.0), spans=spans), "torque")
    assert [name in drawn for name in ("before", "within", "after")] == [False, True, False]


def test_names_of_near_bumps_stand_below_each_other() -> None:
    starts = (40.0, 27.0, 120.0, 34.0, 356.0)
    spans = tuple(Span(low, low + 4.0, f"bump {k}", loud=True) for k, low in enumerate(starts, 1))
    drawn = curves_svg(replace(curves(), spans=spans), "torque")
    found = [re.search(rf'x="([\d.]+)" y="([\d.]+)"[^>]*>bump {k}<', drawn) for k in range(1, 6)]
    places = [(float(one[1]), float(one[2])) for one in found if one]
    assert len(places) == len(starts)
    for k, (x, y) in enumerate(places):
        assert all(abs(x - other[0]) > text_width("bump 1") or abs(y - other[1]) >= 12.0 for other in places[:k])
    assert places[0][1] == places[2][1], "names with room stand in one line"
    assert places[-1][0] + 0.5 * text_width("bump 5") <= curves().width
    assert drawn.rindex('class="f-warnsoft"') < drawn.index(">bump 1<"), "no stretch covers the name of another"


@pytest.mark.parametrize(("values", "left"), [((0.0, 1.0), 64.0), ((999.7, 1000.4), 28.0 + text_width("1000.2"))])
def test_ticks_leave_room_for_the_name_of_their_ordinate(values: tuple[float, float], left: float) -> None:
    lines = (Line("speed", np.array(values), "measured"),)
    svg = curves_svg(Curves(np.array([0.0, 1.0]), "cycle", (Panel("speed [rpm]", lines),), full_turn=False), "")
    assert f'<line x1="{left:.1f}"' in svg
    ends = [float(x) for x in re.findall(r'<text x="([\d.]+)" y="[\d.]+" text-anchor="end"', svg)]
    assert set(ends) == {round(left - 6.0, 1)}


def test_a_gap_in_a_curve_stays_a_gap() -> None:
    drawn = curves_svg(curves(), "torque")
    data = re.search(r'd="([^"]*)" fill="none"', drawn)
    assert data is not None
    assert data[1].count("M") == 2


def test_texts_of_a_drawing_and_of_its_data_are_escaped() -> None:
    for text in (curves_svg(curves(NASTY), NASTY), rows_svg(rows(NASTY), NASTY), str(chart_data({"a": curves(NASTY)}))):
        assert "<script" not in text
        assert "alert" in text
    assert "\x1b" not in str(chart_data({"a": curves("\x1b[31m")}))


def rows(label: str) -> Rows:
    marks = Marks(
        label, (1.0, -2.0, float("nan")), ("c0",), "point", (0.5, -3.0, float("nan")), (1.5, -1.0, float("nan"))
    )
    return Rows((label, "b", "c"), (RowPanel(label, (marks,), notes=(label, "", "unknown")),))


def test_a_row_without_a_value_has_no_mark() -> None:
    assert rows_svg(rows("a"), "rows").count('r="4"') == 3, "two values and the legend"


def unpacked(data: dict[str, Any]) -> np.ndarray:
    """Return the values of `packed`, as the script of a page does."""
    numbers = np.frombuffer(base64.b64decode(data["d"]), dtype="<i2")
    return np.where(numbers == MISSING, np.nan, data["o"] + data["k"] * numbers)


def test_curves_come_out_of_the_data_again() -> None:
    values = np.array([1.0, np.nan, -3.5, 7.25])
    again = unpacked(packed(values))
    np.testing.assert_allclose(again, values, atol=10.75 / 65_000)
    np.testing.assert_allclose(unpacked(packed(np.full(3, 4.2))), 4.2)


def test_phases_are_those_of_the_lift() -> None:
    theta = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
    degrees = np.rad2deg(theta)
    lift = np.interp(degrees, [0.0, 20.0, 60.0, 90.0, 150.0, 360.0], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    found = {span.label: (span.low, span.high) for span in phases(theta, lift) if span.label != "base circle"}
    for name, ends in (("forward stroke", (20.0, 60.0)), ("top", (60.0, 90.0)), ("return stroke", (90.0, 150.0))):
        assert found[name] == pytest.approx(ends, abs=0.4), name


def test_a_stroke_may_pass_the_zero_of_the_angle() -> None:
    theta = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    lift = np.maximum(np.cos(theta), 0.0) ** 40
    found = [(span.label, round(span.low), round(span.high)) for span in phases(theta, lift)]
    assert [name for name, *_ in found] == ["return stroke", "base circle", "forward stroke"]
    assert found[0][1] == 0
    assert found[-1][2] == 360


def test_each_lobe_has_its_strokes() -> None:
    theta = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    lift = np.maximum(np.sin(3.0 * theta - 0.6), 0.0) ** 2 * (1.0 - 0.1 * np.cos(theta))
    found = [(span.label, span.low, span.high) for span in phases(theta, lift)]
    assert [name for name, *_ in found] == ["base circle", *3 * ["forward stroke", "return stroke", "base circle"]]
    ends = [low for _, low, _ in found[1:]] + [360.0]
    assert [high for *_, high in found[1:]] == pytest.approx(ends[1:])
    assert [low for name, low, _ in found if name == "forward stroke"] == pytest.approx([11.5, 131.5, 251.5], abs=2.0)
    assert [span.label for span in strokes(theta, lift)] == 3 * ["forward stroke", "return stroke"]


def test_a_bump_over_the_zero_of_the_angle_is_marked_on_both_sides() -> None:
    bump = ResidualBump(np.deg2rad(350.0), np.deg2rad(10.0), 0.3, 5.0, "delivery")
    ends = [(round(span.low), round(span.high)) for span in bump_spans((bump,))]
    assert ends == [(350, 360), (0, 10)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("leakage 0.1 +- 0.02 mm^3/s/bar", "leakage 0.1 ± 0.02 mm³/s/bar"),
        ("1.03 um, +/-10 %, 12 kg m^2", "1.03 µm, ±10 %, 12 kg m²"),
        ("a + 1.88 x b, 3 mm^2", "a + 1.88 × b, 3 mm²"),
        ("9 Nm at 212 urad/(N m); this tells us more", "9 N m at 212 µrad/(N m); this tells us more"),
    ],
)
def test_one_typography(text: str, expected: str) -> None:
    assert typeset(text) == expected


def test_signs_of_documents_are_those_of_any_terminal_and_pages_have_powers_of_ten() -> None:
    assert typeset("4e-06 s, 12 kg m^2, 3 um, 5 +- 1") == "4e-06 s, 12 kg m², 3 µm, 5 ± 1"
    typeset("4e-06 s, 12 kg m^2, 3 um, 5 +- 1, 2 x b").encode("cp1252")
    assert exponents("1.88e+03 and -8.2e-05") == "1.88·10³ and −8.2·10⁻⁵"


def test_units_and_errors_as_texts() -> None:
    assert [unit_text(unit) for unit in ("-", "um", "mm^3/s/bar", "us")] == ["", "µm", "mm³/s/bar", "µs"]
    assert [plus_minus(value) for value in (0.0, None, 0.0312)] == ["–", "–", "0.031"]
    assert rounded_to_error(50.0, 0.0) == "50"
    assert [with_decimals(value, 1) for value in (-0.04, -0.06, 0.0)] == ["0.0", "−0.1", "0.0"]
    assert clean("a\x1b[2J\u202eb\tc") == "a\ufffd[2J\ufffdb\tc"


@pytest.mark.parametrize(("text", "expected"), [
    ("lift goes down to -7 um", "lift goes down to −7 µm"), ("(-0.3 to 2)", "(−0.3 to 2)"),
    ("0.05-0.8, 3-10 g", "0.05–0.8, 3–10 g"), ("valve mass is 20.3 10^6 kg/m^4", "valve mass is 20.3 × 10⁶ kg/m⁴"),
    ("T22-40117, 2026-11-22, run-3", "T22-40117, 2026-11-22, run-3"),
    ("teeth of 36-1, of 12-17 and of the others", "teeth of 36-1, of 12-17 and of the others"),
    ("1-60 Hz, 20-50 mm^2, 0.1-1 ms, 2-6 um", "1–60 Hz, 20–50 mm², 0.1–1 ms, 2–6 µm"),
])  # fmt: skip
def test_signs_and_ranges_in_a_sentence(text: str, expected: str) -> None:
    assert exponents(typeset(text)) == expected


def test_numbers_are_written_out_and_names_of_parameters_are_words() -> None:
    assert (significant(120.4, 2), significant(1.5e7, 2)) == ("120", "1.5·10⁷")
    assert (with_sign(0.0351), with_sign(-0.0064), with_sign(0.001), with_sign(None)) == ("+0.04", "−0.01", "0.00", "–")
    assert named("coupling_resonance drifts; set zero_before_V") == "coupling resonance drifts; set zero_before_V"


def test_the_caption_of_the_evidence_says_where_its_bars_end() -> None:
    assert f"bars end at {EVIDENCE_SHOWN:g}" in FIGURES["evidence"].caption


def test_the_chart_of_evidence_has_limits_where_a_verdict_was_not_computed() -> None:
    result = run_result()
    row = LossEvidence("chamber", math.nan, "needed", False, math.nan, (math.nan, math.nan), "N m", "not compared")
    rows = evidence(replace(result, fitted=replace(result.fitted, evidence=(row, *result.fitted.evidence))))
    assert rows is not None
    assert all(math.isfinite(end) for end in rows.panels[0].limits)

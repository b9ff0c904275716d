"""The page of a plan: what to record first, what it is expected to bring, what is taken for granted."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from camtorque.report.plan_page import plan_answer, plan_drawings, plan_page, write_plan


def run(speed: float, after: float, **changed: Any) -> dict[str, Any]:
    return {"speed_rpm": speed, "load_of": "A_<1>", "duration_s": 20.0, "second_tooth": False, "minutes": 10.3,
            "stderr_after": after, **changed}  # fmt: skip


def plan_document(**changed: Any) -> dict[str, Any]:
    """Return a plan of two runs for a leakage."""
    offers = [run(speed, after, load_of=load, second_tooth=tooth) for load, tooth in (("A_<1>", False), ("B", True))
              for speed, after in ((490.0, 0.06), (700.0, 0.09), (1015.0, 0.08))]  # fmt: skip
    return {
        "schema": "camtorque.plan/1", "target": "leakage", "of": "", "unit": "mm^3/s/bar", "value": 0.8132,
        "stderr_now": 0.1, "stderr_wanted": 0.05, "reached": True, "minutes": 65.7, "on_offer": offers,
        "setup_minutes": 10.0, "tooth_minutes": 45.0, "durations_s": [20.0, 60.0], "fitted_speeds_rpm": [600.0, 1100.0],
        "zero_stderr_nm": 0.1337, "stderr_between_fits": 0.0,
        "runs": [run(490.0, 0.0611), run(1015.0, 0.0442, second_tooth=True, minutes=55.3)], **changed,
    }  # fmt: skip


def test_the_answer_comes_first_with_digits_of_its_uncertainty() -> None:
    page = plan_page(plan_document(), "next")
    answer = plan_answer(plan_document())
    assert answer == (
        "leakage is 0.81 ± 0.10 mm³/s/bar now, wanted ± 0.050 mm³/s/bar. Begin with 490 rpm, load of A_<1>, 20 s. "
        "2 runs are expected to bring ± 0.044 mm³/s/bar in 66 minutes."
    )
    assert page.index("Reached as planned") < page.index("Recordings to make") < page.index("What is gained")
    assert "A_&lt;1&gt;" in page
    assert "A_<1>" not in page


def test_every_run_has_a_row_with_cost_and_gain() -> None:
    page = plan_page(plan_document(), "next")
    cells = [re.sub("<[^>]*>", "|", row).split("||") for row in re.findall("<tr>(<td>.*)</tr>", page)]
    assert [part.strip("|") for part in cells[0]] == ["1.", "490", "A_&lt;1&gt;", "20", "no", "10", "0.061", "61"]
    assert [part.strip("|") for part in cells[1]] == ["2.", "1015", "A_&lt;1&gt;", "20", "yes", "55", "0.044", "44"]
    assert 'data-label="Then ± [mm³/s/bar]">0.061<' in page, "on a narrow screen rows stand as blocks"
    assert "490 rpm lies beyond the fitted speeds" in page


def test_speeds_beyond_the_fitted_ones_stand_in_a_row() -> None:
    found = plan_document()
    found["on_offer"] = [{**found["on_offer"][0], "speed_rpm": speed} for speed in (300.0, 2000.0, 400.0, 2500.0)]
    assert "300, 400, 2000 and 2500 rpm lie beyond the fitted speeds: " in plan_page(found, "next")


def test_what_is_expected_is_said() -> None:
    page = plan_page(plan_document(), "next").replace("\u00a0", " ")
    assert "is read as well as in the middle one of the recordings, ± 0.13 N m" in page
    assert "other structures and laws" not in page
    alone = plan_page(plan_document(stderr_between_fits=0.0712), "next").replace("\u00a0", " ")
    assert (
        "± 0.071 mm³/s/bar of what one recording leaves open is how far other structures and laws move the number"
        in alone
    )


def test_what_is_gained_is_drawn_with_quantity_and_unit() -> None:
    expected, offer = plan_drawings(plan_document())
    assert expected.chart.labels == ("now", "after run 1", "after run 2")  # type: ignore[union-attr]
    panel = expected.chart.panels[0]  # type: ignore[union-attr]
    assert panel.abscissa == "standard uncertainty of leakage [mm³/s/bar]"
    assert panel.notes == ("± 0.10", "± 0.061", "± 0.044")
    assert panel.shaded == (0.0, 0.05)
    assert panel.limits == (0.0, pytest.approx(0.125)), "an uncertainty begins at zero"
    assert [line.label for line in offer.chart.panels[0].lines] == [  # type: ignore[union-attr]
        "load of A_<1>", "load of B, second tooth", "now", "wanted",
    ]  # fmt: skip
    assert list(offer.chart.panels[0].lines[0].values) == [0.06, 0.09, 0.08]  # type: ignore[union-attr]


@pytest.mark.parametrize(("changed", "told", "verdict"), [
    ({"runs": [], "reached": False}, "No run on offer narrows it", "Not reached"),
    ({"runs": [], "stderr_wanted": 0.2}, "Nothing needs to be recorded.", "Known well enough"),
    ({"reached": False, "stderr_wanted": 0.01}, "That is short of what is wanted", "Not reached"),
    ({"runs": [run(490.0, 0.04)], "unit": "-"}, "Record 490 rpm", "Reached as planned"),
])  # fmt: skip
def test_the_page_says_where_recording_does_not_help(changed: dict[str, Any], told: str, verdict: str) -> None:
    page = plan_page(plan_document(**changed), "next")
    assert told in page.replace("\u00a0", " ")
    assert f"<b>{verdict}:</b>" in page
    assert ("Recordings to make" in page) == bool(plan_document(**changed)["runs"])


def test_page_and_numbers_are_written(tmp_path: Path) -> None:
    write_plan(plan_document(), "next", tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"plan.html", "plan.json"}
    page = (tmp_path / "plan.html").read_text()
    assert 'src="' not in page
    assert "<script" not in page
    assert "script-src &#39;none&#39;" in page

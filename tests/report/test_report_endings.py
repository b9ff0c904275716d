"""Land or spill: which ending a load that is given has, what it would be if it ended the other way."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from camtorque import predict_from as flow
from camtorque.commands.arguments import ENDINGS as WORDS
from camtorque.commands.texts import fit_name
from camtorque.finished_fit import FinishedFit
from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.endings import EITHER, ENDINGS, UNKNOWN_STD, either, endings_of, if_it_ended_so, load_for, own_ending
from camtorque.fit.forecast import Forecast
from camtorque.fit.known_ends import Curve
from camtorque.fit.known_fit import FittedAt, KnownFit, LoadKnowledge, draws
from camtorque.jsonable import jsonable
from camtorque.laws import ROWS
from camtorque.predict_from import fitted_load
from camtorque.records import Estimate, Forces, Refusal
from camtorque.report.forecast_page import _drawing, end_text, ending_text, flight_text, sweep_row, with_band
from camtorque.report.numbers import UNKNOWN
from camtorque.units import DEGREE
from report_cases import THETA, falling

BOTH_STRUCTURES = {"a": "land", "b": "land", "c": "spill"}


def known(structures: dict[str, str]) -> KnownFit:
    recordings = tuple(FittedAt(name, 50.0 * 1.25**k, structure, 0.01, True)
                       for k, (name, structure) in enumerate(structures.items()))  # fmt: skip
    names = tuple(f"end_of_delivery__{name}" for name in structures)
    return KnownFit(names, np.full(len(names), 0.8), ArrowCovariance.whole(1e-6 * np.eye(len(names))), recordings)


def run(torque: float, std: float, ending: str, chamber: float = 1e7) -> Forecast:
    flat = np.ones(4)
    causes = {"pressure": torque * flat}
    return Forecast(
        speed=50.0, theta=np.arange(4.0), torque=torque * flat, torque_std=std * flat, shape_std=0.5 * std * flat,
        mean_std=std, by_cause=causes, by_cause_std={"pressure": std * flat}, pressure=chamber * flat,
        pressure_std=1e5 * flat, contact=flat, contact_std=0.1 * flat, plunger_force=flat, true_angle=flat, flow=flat,
        delivered=1e-7, delivered_std=1e-9, law_share=0.01, beyond=0.0, ending=ending,
    )  # fmt: skip


def test_words_of_the_command_line_are_those_of_the_fit() -> None:
    assert WORDS == ENDINGS


@pytest.mark.parametrize(("structures", "speed", "asked", "wanted"), [
    ({"a": "land", "b": "land"}, 50.0, "", [("a", "land")]),
    ({"a": "land", "b": "land"}, 50.0, "spill", [("a", "spill")]),
    ({"a": "land", "b": "land"}, 70.0, "either", [("b", "land"), ("b", "spill")]),
    (BOTH_STRUCTURES, 50.0, "", [("a", "land"), ("c", "spill")]),
    (BOTH_STRUCTURES, 90.0, "", [("c", "spill"), ("b", "land")]),
    (BOTH_STRUCTURES, 90.0, "land", [("b", "land")]),
    ({"a": "line"}, 50.0, "", [("a", "line")]),
])  # fmt: skip
def test_an_ending_is_what_was_asked_for_or_seen_and_both_where_the_recordings_differ(
    structures: dict[str, str], speed: float, asked: str, wanted: list[tuple[str, str]]
) -> None:
    assert [(item.id, item.structure) for item in endings_of(known(structures), speed, asked)] == wanted


def test_the_load_of_a_fitted_recording_ends_as_that_does() -> None:
    fit = known({"a": "land", "b": "line", "c": "spill"})
    assert [own_ending(fit, name) for name in ("a", "b", "c", "d", "")] == ["land", "", "spill", "", ""]


def test_the_load_of_a_fitted_recording_is_told_from_another_of_its_name() -> None:
    """Its end was looked for by shape, as of a load that nobody had fitted: 1460 +- 150 bar for 1468 +- 16."""
    fit = known({"a": "land", "b": "line", "c": "spill"})
    rise = 600e5 * np.exp(-(((THETA - 0.7) / 0.2) ** 2))
    templates = {name: Curve(THETA, rise, 100.0) for name in "abc"}
    coarser = Curve(THETA[::4], rise[::4] * 1.002, 100.0)
    another = Curve(THETA, 1.05 * rise, 100.0)

    def found(name: str, curve: Curve, ending: str = "") -> FittedAt | None:
        return fitted_load(fit, templates, name, curve, ending)

    assert [found(name, coarser) for name in ("a", "b", "c")] == list(fit.recordings)
    assert [found("d", coarser), found("a", another), found("a", coarser, "spill")] == [None, None, None]
    assert found("a", coarser, "land") is fit.recordings[0]


def test_an_ending_that_nothing_can_tell_is_refused() -> None:
    with pytest.raises(Refusal, match="no fitted recording shows where delivery ends"):
        endings_of(known({"a": "line"}), 50.0, "spill")
    with pytest.raises(Refusal, match="found 'lid', expected one of land, spill, either"):
        endings_of(known({"a": "land"}), 50.0, "lid")


def test_an_ending_without_a_load_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow, "read_fit", lambda path: FinishedFit(known({"a": "land"}), tmp_path, []))
    with pytest.raises(Refusal, match="found --ending land without a load"):
        flow.predict_from(tmp_path, [500.0], ending="land")


def test_bands_of_either_hold_both_and_are_no_wider() -> None:
    found = either(run(10.0, 1.0, "land"), run(4.0, 0.5, "spill"))
    assert found.ending == EITHER
    assert ending_text(found)[0].endswith("--ending land or --ending spill predicts one of them.")
    assert "if spill ends delivery" in str(_drawing("speed_1", found).svg)
    low, high = 4.0 - 1.96 * 0.5, 10.0 + 1.96
    assert found.torque == pytest.approx(np.full(4, 0.5 * (low + high)), abs=1e-3)
    assert found.torque_std == pytest.approx(np.full(4, 0.5 * (high - low) / 1.96), abs=1e-3)
    assert found.by_cause["pressure"] == pytest.approx(found.torque)
    for one in found.both:
        assert np.all(np.abs(one.torque - found.torque) + 1.959 * one.shape_std <= 1.96 * found.shape_std)


def test_extremes_of_either_hold_those_of_both() -> None:
    item = either(run(10.0, 1.0, "land", 1e8), run(4.0, 0.5, "spill", 2e7))
    forces: list[Forces] = [SimpleNamespace(hertz=np.full(4, value)) for value in (3e9, 2e9)]  # type: ignore[misc]
    row = sweep_row(item, forces)
    low, high = row["chamber_peak_bar"]["ci95"]
    assert low == pytest.approx(200.0 - 1.96, abs=0.01)
    assert high == pytest.approx(1000.0 + 1.96, abs=0.01)
    assert row["hertz_max_gpa"]["ci95"][1] > 3.0 > 2.0 > row["hertz_max_gpa"]["ci95"][0]
    alone = sweep_row(run(10.0, 1.0, "land"), forces[:1])
    assert alone["torque_max_nm"]["value"] == pytest.approx(10.0)
    assert (alone["ending"], alone["other_ending"]) == ("land", None)
    line = sweep_row(run(10.0, 1.0, "line"), forces[:1])["delivered_mm3"]
    assert with_band(line) == with_band(jsonable(line)) == UNKNOWN


def test_a_measured_pressure_has_no_interval_of_the_fit() -> None:
    """That of a sensor in the chamber was told as 1143.6 ± 0.2 bar: its zero alone, its gain is none of the fit's."""
    forces: list[Forces] = [SimpleNamespace(hertz=np.full(4, 3e9))]  # type: ignore[list-item]
    measured = sweep_row(run(10.0, 1.0, "line"), forces)["chamber_peak_bar"]
    assert with_band(measured) == with_band(jsonable(measured)) == UNKNOWN


def test_a_page_names_a_fit_by_its_only_recording_or_its_folder(tmp_path: Path) -> None:
    (tmp_path / "campaign.json").touch()
    assert fit_name(tmp_path / "5e1f", ["A_1000rpm"]) == "A_1000rpm"
    assert fit_name(tmp_path / "campaign.json", ["A", "B"]) == tmp_path.name
    assert fit_name(tmp_path / ".", ["A", "B"]) == tmp_path.name


def test_what_the_other_ending_would_make_is_told_where_the_band_does_not_hold_it() -> None:
    item = run(10.0, 1.0, "land")
    assert if_it_ended_so(item, run(8.5, 1.0, "spill")) is None
    other = if_it_ended_so(item, run(4.0, 1.0, "spill"))
    text = ending_text(replace(item, other=other))[0]
    assert "by a land" not in text
    assert "it is a land as in the fitted recordings. If spill ends it" in text
    assert "up to 6 N m lower at 0 deg of cam angle: --ending spill predicts it" in text
    assert ending_text(item) == ()
    text = ending_text(replace(item, other=if_it_ended_so(item, run(-140.0, 1.0, "spill"))))[0]
    assert "up to 150 N m lower at" in text


def test_an_ending_whose_pressure_no_pump_holds_is_no_other_one_and_nothing_to_build_on() -> None:
    """Of a spill pump of 36 N m a land was offered as '405 N m higher', and predicted as 6000 ± 72000 bar."""
    item, pressed = run(10.0, 1.0, "spill"), run(400.0, 1.0, "land", 6e8)
    assert if_it_ended_so(item, pressed) is None
    assert if_it_ended_so(item, replace(pressed, pressure=np.full(4, 3e8))) is not None
    told = r"Do not rely on the run at 477.5 rpm: if a land ended .* pressed to 6000 bar, which no pump holds"
    for found in (pressed, either(item, pressed)):
        assert re.match(told, *flow.pressed_text(found))
    assert flow.pressed_text(item) == ()


def test_an_ending_that_no_fitted_recording_has_lies_where_theirs_do_and_is_less_sure() -> None:
    fit = known({"a": "land", "b": "land", "c": "land"})
    templates = {item.id: falling(0.8, item.speed) for item in fit.recordings}
    law = SimpleNamespace(evaluate=lambda theta, order: 0.01 * np.sin(theta / 2.0))
    chain = SimpleNamespace(theta=THETA, lobes=1, law=law)
    curve = falling(0.9, 60.0)
    land = load_for(fit, fit.recordings[0], templates, chain, curve)  # type: ignore[arg-type]
    spill = load_for(fit, replace(fit.recordings[0], structure="spill"), templates, chain, curve)  # type: ignore[arg-type]
    end, lift = land.ends["end_of_delivery"], spill.ends["spill_lift"]
    assert lift.value == pytest.approx(0.01 * np.sin(0.5 * end.value), rel=1e-3)
    assert lift.stderr > UNKNOWN_STD * 0.005 * np.cos(0.5 * end.value)
    assert (spill.ends["spill_width"].value, spill.ends["spill_width"].stderr) == ROWS["spill_width"].prior
    assert not spill.means
    texts = end_text(spill.ends, replace(fit.recordings[0], structure="spill"), fit, 500.0)
    assert "by spill, as no fitted recording does" in texts[0]
    at, how = end_text(land.ends, fit.recordings[0], fit, 500.0)
    assert f"ends at {end.value / DEGREE:.3g}" in at
    # the same at every speed: told once
    assert end_text(land.ends, fit.recordings[0], fit, 900.0)[1] == how


@pytest.mark.parametrize("structure", ["line", "open"])
def test_where_no_end_was_fitted_nothing_is_said_of_it(structure: str) -> None:
    fit = known({"a": structure})
    assert end_text({}, fit.recordings[0], fit, 500.0) == ()


def test_parameters_of_an_ending_that_was_not_fitted_are_drawn() -> None:
    load = LoadKnowledge({"spill_width": Estimate(5e-3, 1e-3)})
    mean = {"end_of_delivery": 0.8, "torque_zero": 0.0, "pressure_zero": 0.0, "spill_width": 5e-3}
    fit = replace(known({"a": "land"}), names=("end_of_delivery__a", "pressure_zero"),
                  values=np.zeros(2), covariance=ArrowCovariance.whole(np.eye(2)))  # fmt: skip
    drawn = [
        item["spill_width"] for item in draws(fit, {"end_of_delivery": 0, "pressure_zero": 1}, mean, load, 1.0, 60)
    ]
    assert np.std(drawn) == pytest.approx(1e-3, rel=0.25)


def test_a_follower_that_leaves_the_cam_is_told_with_its_angle_and_the_pull() -> None:
    flat, stays = Forces(*[np.ones(4)] * 9), run(50.0, 0.5, "land")
    assert stays.take_off is None
    assert flight_text(stays) == ()
    assert not sweep_row(stays, (flat,))["contact_lost"]
    rests = replace(stays, contact=np.array([0.0, 50.0, 90.0, 0.0]))
    assert rests.take_off is None, "a follower without preload rests on its base circle"
    flies = replace(stays, contact=np.array([-20.0, 5.0, -1.0, -146.0]), contact_std=np.full(4, 3.0))
    assert flies.take_off == pytest.approx(2.0), "a pull across the zero of the angle is one pull"
    (text,) = flight_text(flies)
    assert "the follower leaves the cam at 115 deg of cam angle" in text
    assert "those of a cam that pulls (with up to 146 N); ask for lower speeds" in text
    row = sweep_row(flies, (flat,))
    assert row["contact_lost"]
    assert row["contact_min_n"]["value"] == pytest.approx(-146.0)
    assert either(stays, flies).take_off == pytest.approx(2.0), "either ending may let it fly"
    assert replace(stays, contact=-np.ones(4)).take_off == 0.0
